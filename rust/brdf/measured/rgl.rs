//! The tables of EPFL's laboratory (Dupuy and Jakob 2018): isotropic or anisotropic, over a grid that follows the facets
//! that the eye sees.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::error::{Error, Result};

use super::super::direction::{Direction, Half, reflected};
use super::super::model::{Brdf, dense};
use super::patches::{Axes, Mix, ONLY, Patches};
use super::table::{Measured, luminance};
use super::warp::Warp;

/// What a file says, in its own names and shapes; tables in C order.
pub struct RglTables<'a> {
    /// Azimuths of the eye: up to 2 of an isotropic material, else all around, or a half or a quarter by symmetry.
    pub phi_i: &'a [f32],
    /// Angles between the eye and the normal.
    pub theta_i: &'a [f32],
    /// The facets' distribution: (phi, theta), with its shape.
    pub ndf: (&'a [f32], [usize; 2]),
    /// What the facets show to each direction of the eye: (phi, theta).
    pub sigma: (&'a [f32], [usize; 2]),
    /// The facets that are seen: (phi_i, theta_i, phi, theta), with its last two lengths.
    pub vndf: (&'a [f32], [usize; 2]),
    /// By what sampling follows the light: (phi_i, theta_i, y, x).
    pub luminance: (&'a [f32], [usize; 2]),
    /// Reflectance in the warped square: (phi_i, theta_i, 3, y, x).
    pub rgb: (&'a [f32], [usize; 2]),
    /// Whether `rgb` is over ndf / 4 sigma.
    pub jacobian: bool,
}

/// A table. The eye is what it is parametrised by, so it is reciprocal only as far as the measurement is. Sampled as its
/// authors do: by `luminance`, then by the facets that are seen.
#[derive(Debug)]
pub struct Rgl {
    axes: Axes,
    /// 0 where the material is isotropic, 1 all around, 2 and 4 by half turns and mirrors.
    symmetry: u8,
    ndf: Patches,
    sigma: Patches,
    vndf: Warp,
    luminance: Warp,
    rgb: Patches,
    jacobian: bool,
}

/// Where two directions are in the tables.
struct Place {
    mix: Mix,
    /// The eye's place in `sigma`.
    eye: [f64; 2],
    /// The half vector's place in `ndf` and `vndf`.
    facet: [f64; 2],
}

impl Rgl {
    /// Checks all shapes and numbers.
    pub fn new(tables: &RglTables) -> Result<Rgl> {
        let axes = Axes::new([tables.phi_i, tables.theta_i])?;
        let flat = |name, (points, [height, width]): (&[f32], [usize; 2]), count| {
            Patches::new(name, points, [width, height], count)
        };
        let sigma = flat("sigma", tables.sigma, 1)?;
        if sigma.points.contains(&0.0) {
            return Err(Error::input("expected sigma above 0, got 0"));
        }
        let warp =
            |name, (points, [height, width]): (&[f32], [usize; 2])| Warp::new(name, points, [width, height], &axes);
        Ok(Rgl {
            symmetry: symmetry(axes.axis(0))?,
            ndf: flat("ndf", tables.ndf, 1)?,
            sigma,
            vndf: warp("vndf", tables.vndf)?,
            luminance: warp("luminance", tables.luminance)?,
            rgb: flat("rgb", tables.rgb, 3 * axes.tables())?,
            jacobian: tables.jacobian,
            axes,
        })
    }

    /// The signs of x and y by which an eye is moved to where it was measured.
    fn signs(&self, wo: Direction) -> [f64; 2] {
        let away = |x: f64| if x > 0.0 { -1.0 } else { 1.0 };
        match self.symmetry {
            2 => [away(wo[1]); 2],
            4 => [away(wo[0]), away(wo[1])],
            _ => [1.0; 2],
        }
    }

    /// The eye's azimuth, its place in `sigma`, and the tables between which it is.
    fn eye(&self, wo: Direction) -> (f64, [f64; 2], Mix) {
        let (phi, theta) = (wo[1].atan2(wo[0]), wo[0].hypot(wo[1]).atan2(wo[2]));
        (phi, [(theta / FRAC_PI_2).sqrt(), (phi + PI) / TAU], self.axes.mix([phi, theta]))
    }

    fn find(&self, half: &Half) -> Place {
        let [x, y] = self.signs(half.wo);
        let (phi, eye, mix) = self.eye([x * half.wo[0], y * half.wo[1], half.wo[2]]);
        let slope = [x * half.slope[0], y * half.slope[1]];
        let turned = slope[1].atan2(slope[0]) - if self.symmetry == 0 { phi } else { 0.0 };
        let theta = slope[0].hypot(slope[1]).atan();
        Place { mix, eye, facet: [(theta / FRAC_PI_2).sqrt(), ((turned + PI) / TAU).rem_euclid(1.0)] }
    }
}

impl Measured for Rgl {
    fn colour(&self, wi: Direction, wo: Direction) -> [f64; 3] {
        let Some(half) = Half::between(wi, wo) else { return [0.0; 3] };
        let Place { mix, eye, facet } = self.find(&half);
        let numbers = self.vndf.numbers(&mix, facet);
        let facets = if self.jacobian { self.ndf.at(&ONLY, facet) / (4.0 * self.sigma.at(&ONLY, eye)) } else { 1.0 };
        // The tables hold f cos theta_i.
        std::array::from_fn(|c| {
            let mix = mix.map(|(table, share)| (3 * table + c, share));
            self.rgb.at(&mix, numbers) * facets / half.cos_i
        })
    }
}

impl Brdf for Rgl {
    fn evaluate(&self, wi: Direction, wo: Direction) -> f64 {
        luminance(self.colour(wi, wo))
    }

    fn sample(&self, wo: Direction, u: [f64; 2]) -> Option<(Direction, f64)> {
        let [x, y] = self.signs(wo);
        let (phi, _, mix) = self.eye([x * wo[0], y * wo[1], wo[2]]);
        let [u, v] = self.vndf.place(&mix, self.luminance.place(&mix, u));
        let turned = TAU * v - PI + if self.symmetry == 0 { phi } else { 0.0 };
        let ((sine, cosine), (b, a)) = ((FRAC_PI_2 * u * u).sin_cos(), turned.sin_cos());
        let wi = reflected(wo, [x * sine * a, y * sine * b, cosine])?;
        dense(self, wi, wo)
    }

    fn pdf(&self, wi: Direction, wo: Direction) -> f64 {
        let Some(half) = Half::between(wi, wo) else { return 0.0 };
        let Place { mix, facet, .. } = self.find(&half);
        let density = self.vndf.density(&mix, facet) * self.luminance.density(&mix, self.vndf.numbers(&mix, facet));
        // theta_h = pi / 2 u² and phi_h = 2 pi v - pi; about the pole itself the density is taken as flat.
        let sine = half.cos_h * half.slope[0].hypot(half.slope[1]);
        density / (TAU * PI * facet[0] * sine).max(1e-6) / (4.0 * half.cos_d)
    }
}

/// How many times the azimuths of a file cover the circle; 0 if the material is isotropic.
fn symmetry(phi: &[f64]) -> Result<u8> {
    if phi.len() <= 2 {
        return Ok(0);
    }
    let span = phi[phi.len() - 1] - phi[0];
    match (TAU / span).round() {
        1.0 => Ok(1),
        2.0 => Ok(2),
        4.0 => Ok(4),
        _ => Err(Error::input(format!("expected phi_i over a whole, a half or a quarter turn, got {span} radians"))),
    }
}
