//! An elliptic power of the cosine to the half vector, as bright at grazing angles as physics asks.

use std::f64::consts::PI;

use crate::error::Result;

use super::curve::{Curved, Share};
use super::direction::Half;
use super::facets::{Facets, HalfModel};
use super::fresnel::Fresnel;
use super::power::Power;

/// f = sqrt((e_x + 1) (e_y + 1)) / 8 pi (n.h)^e F / (h.wo max(n.wi, n.wo)), e = e_x cos²phi_h + e_y sin²phi_h (Ashikhmin and
/// Shirley 2000, eq. 3, without their diffuse term). Sampled as they say (eq. 9 and 10).
#[derive(Clone, Copy, Debug)]
pub struct AshikhminShirley {
    lobe: Power,
    fresnel: Fresnel,
}

impl AshikhminShirley {
    /// An exponent along x, and one along y.
    pub fn new(exponent: [f64; 2], fresnel: Fresnel) -> Result<AshikhminShirley> {
        Ok(AshikhminShirley { lobe: Power::new(exponent)?, fresnel })
    }
}

impl HalfModel for AshikhminShirley {
    fn value(&self, half: &Half) -> f64 {
        let constant = self.lobe.root() / (8.0 * PI);
        constant * self.lobe.of(half) * self.fresnel.at(half.cos_d) / (half.cos_d * half.cos_i.max(half.cos_o))
    }

    fn facets(&self) -> &impl Facets {
        &self.lobe
    }

    fn curved(&self) -> Option<&dyn Curved> {
        Some(self)
    }
}

impl Curved for AshikhminShirley {
    fn curve(&self, u: f64) -> f64 {
        self.lobe.root() / (8.0 * PI) * self.lobe.at(u)
    }

    #[inline]
    fn share(&self, half: &Half) -> Share {
        let quotient = half.cos_i / (half.cos_d * half.cos_i.max(half.cos_o));
        Share { u: self.lobe.abscissa(half), cos_d: half.cos_d, quotient }
    }

    fn fresnel(&self) -> Fresnel {
        self.fresnel
    }
}
