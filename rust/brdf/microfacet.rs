//! Rough surfaces with Smith's masking: f = F D G1(wi) G1(wo) / (4 n.wi n.wo) (Walter et al. 2007, eq. 20 and 23).
//!
//! G1 is kept over its own cosine, which is finite at the horizon: nothing is divided by n.wi n.wo.

use std::f64::consts::TAU;

use crate::error::Result;

use super::albedo::over_facets;
use super::curve::{Curved, Share};
use super::direction::{Direction, Half, reflected, unit};
use super::facets::{Facets, HalfModel};
use super::fresnel::Fresnel;
use super::model::{Brdf, dense};
use super::slopes::Slopes;

/// Facets with normally distributed slopes. Sampled by all facets, not only those that are seen: to sample those, the error
/// function must be inverted, and only wide lobes at grazing angles would gain.
#[derive(Clone, Copy, Debug)]
pub struct Beckmann {
    slopes: Slopes,
    fresnel: Fresnel,
}

impl Beckmann {
    /// A roughness along x, and one along y.
    pub fn new(alpha: [f64; 2], fresnel: Fresnel) -> Result<Beckmann> {
        Ok(Beckmann { slopes: Slopes::new(["alpha", "alpha_v"], alpha)?, fresnel })
    }

    /// G1 over its cosine, by Walter's rational function (eq. 27), within 0.35 % of the exact one.
    #[inline]
    fn seen(&self, direction: Direction) -> f64 {
        let [x, y, cosine] = self.slopes.stretched(direction);
        let across = (x * x + y * y).sqrt();
        let a = cosine / across;
        if a < 1.6 { (3.535 + 2.181 * a) / (across * (1.0 + a * (2.276 + 2.577 * a))) } else { 1.0 / cosine }
    }
}

impl HalfModel for Beckmann {
    fn value(&self, half: &Half) -> f64 {
        let seen = self.seen(half.wi) * self.seen(half.wo);
        0.25 * self.fresnel.at(half.cos_d) * self.slopes.normals(half) * seen
    }

    fn facets(&self) -> &impl Facets {
        &self.slopes
    }

    fn curved(&self) -> Option<&dyn Curved> {
        Some(self)
    }
}

/// Facets of an ellipsoid, whose lobe has the long tail of most real surfaces (Trowbridge and Reitz 1975; "GGX" of Walter et
/// al. 2007, eq. 33 and 34). Sampled by the facets that are seen: f cos / pdf is F G1(wi), never above 1.
#[derive(Clone, Copy, Debug)]
pub struct Ggx {
    slopes: Slopes,
    fresnel: Fresnel,
}

impl Ggx {
    /// A roughness along x, and one along y.
    pub fn new(alpha: [f64; 2], fresnel: Fresnel) -> Result<Ggx> {
        Ok(Ggx { slopes: Slopes::new(["alpha", "alpha_v"], alpha)?, fresnel })
    }

    /// D, 1 / sr.
    fn normals(&self, half: &Half) -> f64 {
        let square = half.cos_h * half.cos_h * (1.0 + self.slopes.squared(half.slope));
        1.0 / (self.slopes.area() * square * square)
    }

    /// G1 over its cosine.
    #[inline]
    fn seen(&self, direction: Direction) -> f64 {
        let [x, y, cosine] = self.slopes.stretched(direction);
        2.0 / (cosine + (x * x + y * y + cosine * cosine).sqrt())
    }
}

impl Brdf for Ggx {
    fn evaluate(&self, wi: Direction, wo: Direction) -> f64 {
        Half::between(wi, wo).map_or(0.0, |half| {
            0.25 * self.fresnel.at(half.cos_d) * self.normals(&half) * self.seen(wi) * self.seen(wo)
        })
    }

    /// A cap of the sphere, stretched (Dupuy and Benyoub 2023, listing 3).
    fn sample(&self, wo: Direction, u: [f64; 2]) -> Option<(Direction, f64)> {
        let eye = unit(self.slopes.stretched(wo));
        // The height of the cap's point, and the half vector's height, in which the eye's cosine would cancel.
        let up = (1.0 - u[0]) * (1.0 + eye[2]);
        let height = up - eye[2];
        let (radius, (sine, cosine)) = (((1.0 - height) * (1.0 + height)).max(0.0).sqrt(), (TAU * u[1]).sin_cos());
        let half = [radius * cosine + eye[0], radius * sine + eye[1], up];
        let wi = reflected(wo, unit(self.slopes.stretched(half)))?;
        dense(self, wi, wo)
    }

    /// D G1(wo) h.wo / n.wo is the density of the facets that are seen; h.wo cancels in that of directions.
    fn pdf(&self, wi: Direction, wo: Direction) -> f64 {
        Half::between(wi, wo).map_or(0.0, |half| 0.25 * self.normals(&half) * self.seen(wo))
    }

    fn curved(&self) -> Option<&dyn Curved> {
        Some(self)
    }

    fn albedo(&self, wo: Direction) -> f64 {
        over_facets(wo, self.slopes.widths(), |wi| self.evaluate(wi, wo))
    }
}

/// The masking stays that of this roughness, whatever becomes of the curve.
impl Curved for Beckmann {
    fn curve(&self, u: f64) -> f64 {
        self.slopes.normals_at(u)
    }

    #[inline]
    fn share(&self, half: &Half) -> Share {
        let (u, flatter) = self.slopes.abscissa(half);
        let quotient = 0.25 * flatter * self.seen(half.wi) * self.seen(half.wo) * half.cos_i;
        Share { u, cos_d: half.cos_d, quotient }
    }

    fn fresnel(&self) -> Fresnel {
        self.fresnel
    }
}

/// The masking stays that of this roughness, whatever becomes of the curve.
impl Curved for Ggx {
    fn curve(&self, u: f64) -> f64 {
        1.0 / (self.slopes.area() * self.slopes.ellipsoid(u))
    }

    #[inline]
    fn share(&self, half: &Half) -> Share {
        let (u, flatter) = self.slopes.abscissa(half);
        let quotient = 0.25 * flatter * self.seen(half.wi) * self.seen(half.wo) * half.cos_i;
        Share { u, cos_d: half.cos_d, quotient }
    }

    fn fresnel(&self) -> Fresnel {
        self.fresnel
    }
}
