//! A power of the cosine between the normal and the half vector.

use std::f64::consts::PI;

use crate::error::Result;

use super::curve::{Curved, Share};
use super::direction::Half;
use super::facets::{Facets, HalfModel};
use super::fresnel::Fresnel;
use super::power::Power;

/// f = (n + 2) (n + 4) / (8 pi (2^(-n / 2) + n)) (n . h)^n (Blinn 1977): the constant by which all light is reflected at
/// normal incidence, and less elsewhere; the (n + 2) / 2 pi in use is that of Phong's lobe and reflects four times it
/// (METHODS X13). Sampled as the power, over facets.
#[derive(Clone, Copy, Debug)]
pub struct BlinnPhong {
    lobe: Power,
    constant: f64,
}

impl BlinnPhong {
    /// Checks the exponent.
    pub fn new(n: f64) -> Result<BlinnPhong> {
        let lobe = Power::new([n, n])?;
        Ok(BlinnPhong { lobe, constant: (n + 2.0) * (n + 4.0) / (8.0 * PI * (libm::exp2(-0.5 * n) + n)) })
    }
}

impl HalfModel for BlinnPhong {
    fn value(&self, half: &Half) -> f64 {
        self.constant * self.lobe.of(half)
    }

    fn facets(&self) -> &impl Facets {
        &self.lobe
    }

    fn curved(&self) -> Option<&dyn Curved> {
        Some(self)
    }
}

impl Curved for BlinnPhong {
    fn curve(&self, u: f64) -> f64 {
        self.constant * self.lobe.at(u)
    }

    #[inline]
    fn share(&self, half: &Half) -> Share {
        Share { u: self.lobe.abscissa(half), cos_d: half.cos_d, quotient: half.cos_i }
    }

    fn fresnel(&self) -> Fresnel {
        Fresnel::None
    }
}
