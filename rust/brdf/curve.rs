//! A lobe as a curve that is edited, and what is left of the model: rho = c(u) F(theta_d) q (Overbeck 2006, eq. 3.5).
//!
//! ```text
//!     f(wi, wo) cos theta_i = c(u) F(cos theta_d) q(wi, wo)        u = sqrt(|n - h| / sqrt 2) = (1 - cos theta_h)^(1/4)
//! ```
//!
//! u is 0 at the highlight and 1 at the horizon, close to the root of the angle, so that evenly spaced nodes are dense where
//! highlights are narrow; it takes no arc cosine, and cancels nowhere. q never divides by the light's cosine (METHODS A7;
//! NUMERICS 2f).
//!
//! Where a lobe is elliptic, u is that of the angle at which a round lobe of the narrower width is as bright.

use std::fmt::Debug;

use super::direction::{Direction, Half, above};
use super::fresnel::Fresnel;
use crate::twice::compiled_twice;

/// What a pair of directions takes of a curve.
#[derive(Clone, Copy, Debug)]
pub struct Share {
    /// Where the curve is looked up, from 0 to 1.
    pub u: f64,
    /// h . wi, where Fresnel's reflectance is looked up.
    pub cos_d: f64,
    /// f cos theta_i over c(u) and F.
    pub quotient: f64,
}

/// A model whose lobe is a curve times what does not depend on its width.
pub trait Curved: Debug + Send + Sync {
    /// c at an abscissa from 0 to 1.
    fn curve(&self, u: f64) -> f64;

    /// What two directions above the horizon take of it.
    fn share(&self, half: &Half) -> Share;

    /// `share` of many directions to the light, one coordinate a list, and one to the eye: u, the cosine and the quotient, all
    /// 0 below the horizon. All lists are as long.
    fn shares(&self, wi: [&[f64]; 3], wo: Direction, out: [&mut [f64]; 3]) {
        shares_of(self, wi, wo, out);
    }

    /// F, a factor beside the curve.
    fn fresnel(&self) -> Fresnel;

    /// Whether the curve is about a direction of the light, not of the half vector, which turns by half.
    fn about_mirror(&self) -> bool {
        false
    }
}

compiled_twice! {
    fn shares_of[C: Curved + ?Sized](curved: &C, wi: [&[f64]; 3], wo: Direction, out: [&mut [f64]; 3]) = shares_any;
}

#[inline(always)]
fn shares_any<C: Curved + ?Sized>(curved: &C, wi: [&[f64]; 3], wo: Direction, [u, cos_d, quotient]: [&mut [f64]; 3]) {
    let count = u.len();
    let ([x, y, z], cos_d, quotient) = (wi.map(|own| &own[..count]), &mut cos_d[..count], &mut quotient[..count]);
    for k in 0..count {
        let wi = [x[k], y[k], z[k]];
        let share = curved.share(&Half::of(wi, wo));
        let lit = above(wi) && above(wo);
        u[k] = if lit { share.u } else { 0.0 };
        cos_d[k] = if lit { share.cos_d } else { 0.0 };
        quotient[k] = if lit { share.quotient } else { 0.0 };
    }
}

/// The fourth root of 1 - cos, from 0 to 1.
#[inline]
pub(super) fn abscissa_of_versine(versine: f64) -> f64 {
    versine.clamp(0.0, 1.0).sqrt().sqrt()
}

/// The abscissa of an angle by the square of its tangent: 1 - cos = tan² / ((1 + tan²) (1 + cos)).
#[inline]
pub(super) fn abscissa_of_slope(square: f64) -> f64 {
    let cosine = 1.0 / (1.0 + square).sqrt();
    // Infinite where the half vector lies on the horizon.
    if square.is_finite() { abscissa_of_versine(square / ((1.0 + square) * (1.0 + cosine))) } else { 1.0 }
}

/// tan² and the cosine at an abscissa.
pub(super) fn slope_at(u: f64) -> [f64; 2] {
    let versine = u.powi(4);
    let cosine = 1.0 - versine;
    [versine * (2.0 - versine) / (cosine * cosine), cosine]
}
