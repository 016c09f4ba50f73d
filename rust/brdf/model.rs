//! What a model of reflectance is asked.

use std::fmt::Debug;

use super::albedo::about_axis;
use super::curve::Curved;
use super::direction::{Direction, mirrored};
use super::lobe::half_width;

/// A model of reflectance. Its constructor checks its parameters; no direction makes a NaN.
///
/// ```
/// use _core::brdf::{Brdf, Ggx, Fresnel};
/// let glossy = Ggx::new([0.2, 0.2], Fresnel::None)?;
/// let wo = [0.6, 0.0, 0.8];
/// let (wi, pdf) = glossy.sample(wo, [0.3, 0.7]).expect("above the horizon");
/// assert_eq!(pdf, glossy.pdf(wi, wo));
/// assert!(glossy.evaluate(wi, wo) * wi[2] / pdf <= 1.0);
/// # Ok::<(), _core::error::Error>(())
/// ```
pub trait Brdf: Debug + Send + Sync {
    /// Reflected radiance over the irradiance that makes it, per steradian; finite and >= 0.
    fn evaluate(&self, wi: Direction, wo: Direction) -> f64;

    /// A direction to the light and its `pdf`, which is above 0, from two numbers in [0, 1): near numbers give near directions, so strata
    /// stay strata. None where the lobe's direction falls below the horizon: that share of the numbers is lost.
    fn sample(&self, wo: Direction, u: [f64; 2]) -> Option<(Direction, f64)>;

    /// The density of `sample` over solid angle. Its integral is what `sample` does not lose, 1 or less.
    fn pdf(&self, wi: Direction, wo: Direction) -> f64;

    /// Where the lobe points to: the mirror direction, if a model says nothing else.
    fn axis(&self, wo: Direction) -> Direction {
        mirrored(wo)
    }

    /// Radians from the lobe's axis to where it has fallen to a half, across the narrower way (to a root of 2 where an
    /// anisotropic lobe is oblique): what texels must be finer than. At most pi / 2.
    fn half_width(&self, wo: Direction) -> f64 {
        half_width(self.axis(wo), |wi| self.evaluate(wi, wo))
    }

    /// Its curve and what is left; None of a model that has no lobe to be edited.
    fn curved(&self) -> Option<&dyn Curved> {
        None
    }

    /// The share of the light that is reflected to `wo` from an even sky (and, of a reciprocal model, of the light from
    /// there that is reflected at all): the integral of `evaluate` times the cosine, to about 1e-6.
    fn albedo(&self, wo: Direction) -> f64 {
        about_axis(self.axis(wo), self.half_width(wo), |wi| self.evaluate(wi, wo))
    }
}

/// A sampled direction with its density; None where there is none.
pub(super) fn dense(model: &impl Brdf, wi: Direction, wo: Direction) -> Option<(Direction, f64)> {
    let pdf = model.pdf(wi, wo);
    (pdf > 0.0).then_some((wi, pdf))
}
