//! Powers of a cosine to the mirror direction, or to another that follows the eye: Phong and Lafortune.

use std::f64::consts::TAU;

use libm::{exp, log, log1p};

use crate::error::{Error, Result};
use crate::sampling::frame;

use super::curve::{Curved, Share, abscissa_of_versine};
use super::direction::{Direction, Half, above, dot, unit};
use super::fresnel::Fresnel;
use super::model::{Brdf, dense};
use super::range::exponent;

/// The exponent that is as narrow as a roughness of 0.002: half vectors turn by half, so a quarter of theirs.
const NARROWEST: f64 = 1.25e5;

/// f = (n + 2) / 2 pi max(0, C_x wi_x wo_x + C_y wi_y wo_y + C_z wi_z wo_z)^n / max|C|^n (Lafortune et al. 1997, eq. 6;
/// METHODS H7's constant). Sampled as the power of the cosine, which ignores the horizon.
#[derive(Clone, Copy, Debug)]
pub struct Lafortune {
    exponent: f64,
    /// C / max|C|
    scale: [f64; 3],
}

/// Phong's lobe about the mirror direction, f = (n + 2) / 2 pi max(0, r . wi)^n (Lafortune and Willems 1994, eq. 9): C is
/// (-1, -1, 1).
pub fn phong(exponent: f64) -> Result<Lafortune> {
    Lafortune::new(exponent, [-1.0, -1.0, 1.0])
}

/// The direction (C_x wo_x, C_y wo_y, C_z wo_z) / max|C| that a lobe is about, and its length to the power n.
struct Axis {
    direction: Direction,
    height: f64,
}

impl Lafortune {
    /// Checks the exponent and the coefficients.
    pub fn new(n: f64, coefficients: [f64; 3]) -> Result<Lafortune> {
        let largest = coefficients.iter().fold(0.0f64, |most, c| most.max(c.abs()));
        if !coefficients.iter().all(|c| c.is_finite()) || largest == 0.0 {
            let message = format!("expected three finite coefficients, not all 0, got {coefficients:?}");
            return Err(Error::input(message));
        }
        Ok(Lafortune { exponent: exponent("exponent", n, NARROWEST)?, scale: coefficients.map(|c| c / largest) })
    }

    /// 1 - |C wo / max|C||² without the subtraction: for Phong it is 0.
    fn short(&self, wo: Direction) -> f64 {
        (0..3).map(|k| (1.0 - self.scale[k]) * (1.0 + self.scale[k]) * wo[k] * wo[k]).sum()
    }

    /// None where the lobe is nowhere.
    fn about(&self, wo: Direction) -> Option<Axis> {
        let axis: Direction = std::array::from_fn(|k| self.scale[k] * wo[k]);
        let short = self.short(wo);
        let square = dot(axis, axis);
        let logarithm = if short < 0.5 { log1p(-short) } else { log(square) };
        let height = exp(0.5 * self.exponent * logarithm);
        (above(wo) && square > 0.0).then(|| Axis { direction: unit(axis), height })
    }

    /// The cosine to the axis to the power n.
    fn power(&self, axis: Direction, wi: Direction) -> f64 {
        let cosine = dot(axis, wi);
        if cosine <= 0.0 {
            return 0.0;
        }
        // Near the axis the cosine has lost what a high power needs: |a - b|² = 2 - 2 cos keeps it.
        let apart: Direction = std::array::from_fn(|k| axis[k] - wi[k]);
        let square = dot(apart, apart);
        let logarithm = if square < 1.0 { log1p(-0.5 * square) } else { log(cosine) };
        exp(self.exponent * logarithm)
    }

    /// A constant times the power, where both directions are above the horizon.
    fn lobe(&self, wi: Direction, wo: Direction, constant: impl Fn(&Axis) -> f64) -> f64 {
        match self.about(wo) {
            Some(axis) if above(wi) => constant(&axis) * self.power(axis.direction, wi) / TAU,
            _ => 0.0,
        }
    }
}

impl Brdf for Lafortune {
    fn evaluate(&self, wi: Direction, wo: Direction) -> f64 {
        self.lobe(wi, wo, |axis| (self.exponent + 2.0) * axis.height)
    }

    fn sample(&self, wo: Direction, u: [f64; 2]) -> Option<(Direction, f64)> {
        let up = self.about(wo)?.direction;
        let [right, forward] = frame(up);
        let logarithm = (-u[0]).ln_1p() / (self.exponent + 1.0);
        let (sine, cosine) = ((-(2.0 * logarithm).exp_m1()).sqrt(), logarithm.exp());
        let (y, x) = (TAU * u[1]).sin_cos();
        let wi = std::array::from_fn(|k| sine * (x * right[k] + y * forward[k]) + cosine * up[k]);
        dense(self, wi, wo)
    }

    fn pdf(&self, wi: Direction, wo: Direction) -> f64 {
        self.lobe(wi, wo, |_| self.exponent + 1.0)
    }

    fn curved(&self) -> Option<&dyn Curved> {
        Some(self)
    }

    fn axis(&self, wo: Direction) -> Direction {
        self.about(wo).map_or(wo, |axis| axis.direction)
    }
}

/// Its variable is no half vector but its own base b: the abscissa is the fourth root of 1 - b.
impl Curved for Lafortune {
    fn curve(&self, u: f64) -> f64 {
        (self.exponent + 2.0) / TAU * (1.0 - u.powi(4)).powf(self.exponent)
    }

    /// 1 - b is half of |C wo / max|C| - wi|² + 1 - |C wo / max|C||², in which nothing cancels near the axis.
    #[inline]
    fn share(&self, half: &Half) -> Share {
        let apart: Direction = std::array::from_fn(|k| self.scale[k] * half.wo[k] - half.wi[k]);
        let versine = 0.5 * (dot(apart, apart) + self.short(half.wo));
        // Below the base's zero there is no lobe, whatever the exponent.
        let quotient = if versine < 1.0 { half.cos_i } else { 0.0 };
        Share { u: abscissa_of_versine(versine), cos_d: half.cos_d, quotient }
    }

    fn fresnel(&self) -> Fresnel {
        Fresnel::None
    }

    fn about_mirror(&self) -> bool {
        true
    }
}
