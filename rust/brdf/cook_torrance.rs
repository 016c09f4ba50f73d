//! Facets that are the sides of long grooves.

use crate::error::Result;

use super::curve::{Curved, Share};
use super::direction::Half;
use super::facets::{Facets, HalfModel};
use super::fresnel::Fresnel;
use super::slopes::Slopes;

/// f = F D G / (4 n.wi n.wo) with Beckmann's D, 1 / pi inside, and the V-shaped grooves' masking G = min(1, 2 n.h n.wo / h.wo,
/// 2 n.h n.wi / h.wo) (Cook and Torrance 1982, with the constant of Walter et al. 2007, eq. 20: METHODS X10). Sampled by
/// Beckmann's facets.
#[derive(Clone, Copy, Debug)]
pub struct CookTorrance {
    slopes: Slopes,
    fresnel: Fresnel,
}

impl CookTorrance {
    /// By the root mean square slope times the root of 2.
    pub fn new(sigma: f64, fresnel: Fresnel) -> Result<CookTorrance> {
        Ok(CookTorrance { slopes: Slopes::new(["sigma", "sigma"], [sigma, sigma])?, fresnel })
    }
}

impl HalfModel for CookTorrance {
    fn value(&self, half: &Half) -> f64 {
        // G / (n.wi n.wo) without the quotient of two small numbers: the smaller cosine divides itself away.
        let masked = 2.0 * half.cos_h / (half.cos_d * half.cos_i.max(half.cos_o));
        let seen = masked.min(1.0 / (half.cos_i * half.cos_o));
        0.25 * self.fresnel.at(half.cos_d) * self.slopes.normals(half) * seen
    }

    fn facets(&self) -> &impl Facets {
        &self.slopes
    }

    fn curved(&self) -> Option<&dyn Curved> {
        Some(self)
    }
}

impl Curved for CookTorrance {
    fn curve(&self, u: f64) -> f64 {
        self.slopes.normals_at(u)
    }

    /// The smaller of the cosines divides itself away, and the light's is multiplied by (METHODS H7, NUMERICS 2f).
    #[inline]
    fn share(&self, half: &Half) -> Share {
        let (u, _) = self.slopes.abscissa(half);
        let masked = 2.0 * half.cos_h * half.cos_i / (half.cos_d * half.cos_i.max(half.cos_o));
        Share { u, cos_d: half.cos_d, quotient: 0.25 * masked.min(1.0 / half.cos_o) }
    }

    fn fresnel(&self) -> Fresnel {
        self.fresnel
    }
}
