//! Ward's elliptic lobe, and Dür's correction of it.

use crate::error::Result;

use super::curve::{Curved, Share};
use super::direction::Half;
use super::facets::{Facets, HalfModel};
use super::fresnel::Fresnel;
use super::slopes::Slopes;

/// f = exp(-tan²theta_h / alpha²) / (4 pi alpha² sqrt(n.wi n.wo)), elliptic in general (Ward 1992, eq. 5; the half vector's
/// slopes as in Walter 2005). Sampled as Walter says, over all facets.
#[derive(Clone, Copy, Debug)]
pub struct Ward {
    slopes: Slopes,
}

/// Ward's lobe over n.wi n.wo instead of its root (Dür 2006, eq. 7): as bright at grazing angles as at others, and brighter
/// than the light where the lobe is wide.
#[derive(Clone, Copy, Debug)]
pub struct WardDuer {
    slopes: Slopes,
}

impl Ward {
    /// A roughness along x, and one along y.
    pub fn new(alpha: [f64; 2]) -> Result<Ward> {
        Ok(Ward { slopes: Slopes::new(["alpha", "alpha_v"], alpha)? })
    }
}

impl WardDuer {
    /// A roughness along x, and one along y.
    pub fn new(alpha: [f64; 2]) -> Result<WardDuer> {
        Ok(WardDuer { slopes: Slopes::new(["alpha", "alpha_v"], alpha)? })
    }
}

/// exp(-tan²theta_h / alpha²) / (4 pi alpha²)
fn lobe(slopes: &Slopes, half: &Half) -> f64 {
    libm::exp(-slopes.squared(half.slope)) / (4.0 * slopes.area())
}

impl HalfModel for Ward {
    fn value(&self, half: &Half) -> f64 {
        lobe(&self.slopes, half) / (half.cos_i * half.cos_o).sqrt()
    }

    fn facets(&self) -> &impl Facets {
        &self.slopes
    }

    fn curved(&self) -> Option<&dyn Curved> {
        Some(self)
    }
}

impl HalfModel for WardDuer {
    fn value(&self, half: &Half) -> f64 {
        lobe(&self.slopes, half) / (half.cos_i * half.cos_o)
    }

    fn facets(&self) -> &impl Facets {
        &self.slopes
    }

    fn curved(&self) -> Option<&dyn Curved> {
        Some(self)
    }
}

/// The lobe at an abscissa.
fn lobe_at(slopes: &Slopes, u: f64) -> f64 {
    slopes.at(u).0 / (4.0 * slopes.area())
}

impl Curved for Ward {
    fn curve(&self, u: f64) -> f64 {
        lobe_at(&self.slopes, u)
    }

    #[inline]
    fn share(&self, half: &Half) -> Share {
        let (u, _) = self.slopes.abscissa(half);
        Share { u, cos_d: half.cos_d, quotient: (half.cos_i / half.cos_o).sqrt() }
    }

    fn fresnel(&self) -> Fresnel {
        Fresnel::None
    }
}

impl Curved for WardDuer {
    fn curve(&self, u: f64) -> f64 {
        lobe_at(&self.slopes, u)
    }

    #[inline]
    fn share(&self, half: &Half) -> Share {
        let (u, _) = self.slopes.abscissa(half);
        Share { u, cos_d: half.cos_d, quotient: 1.0 / half.cos_o }
    }

    fn fresnel(&self) -> Fresnel {
        Fresnel::None
    }
}
