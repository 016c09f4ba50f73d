//! Reflectance: what share of the light from `wi` a surface sends to `wo`, per steradian.
//!
//! Directions are unit vectors of the local frame: z is the normal, x the tangent of anisotropic models; both point away
//! from the surface, `wi` to the light and `wo` to the eye. Where one of them is not above the horizon, all is 0.
//!
//! ```text
//! direction.rs  the half vector, in forms that keep their digits at grazing angles and in narrow lobes
//! lobe.rs albedo.rs quadrature.rs      what follows from any model's values: half width, directional albedo
//! facets.rs     models that follow the half vector, and how they are sampled
//! fresnel.rs slopes.rs power.rs      parts of models: Fresnel; facets by their slopes (Beckmann), by powers of cosines
//! lambert.rs mirror.rs blinn_phong.rs ward.rs cook_torrance.rs microfacet.rs ashikhmin_shirley.rs      the models
//! measured/     tables of measured materials, in three colours
//! ```
//!
//! Lobes narrower than that of a roughness of 0.002 are refused: mirrors need another method than integrals over texels.

use std::fmt::Debug;

mod albedo;
pub mod ashikhmin_shirley;
pub mod blinn_phong;
pub mod cook_torrance;
mod direction;
mod facets;
pub mod fresnel;
pub mod lambert;
mod lobe;
pub mod microfacet;
pub mod mirror;
mod power;
mod quadrature;
mod range;
mod slopes;
pub mod ward;

pub use ashikhmin_shirley::AshikhminShirley;
pub use blinn_phong::BlinnPhong;
pub use cook_torrance::CookTorrance;
pub use direction::Direction;
pub use fresnel::Fresnel;
pub use lambert::Lambert;
pub use microfacet::{Beckmann, Ggx};
pub use mirror::{Lafortune, phong};
pub use ward::{Ward, WardDuer};

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

    /// A direction to the light and its `pdf`, from two numbers in [0, 1): near numbers give near directions, so strata
    /// stay strata. None where the lobe's direction falls below the horizon: that share of the numbers is lost.
    fn sample(&self, wo: Direction, u: [f64; 2]) -> Option<(Direction, f64)>;

    /// The density of `sample` over solid angle. Its integral is what `sample` does not lose, 1 or less.
    fn pdf(&self, wi: Direction, wo: Direction) -> f64;

    /// Where the lobe points to: the mirror direction, if a model says nothing else.
    fn axis(&self, wo: Direction) -> Direction {
        direction::mirrored(wo)
    }

    /// Radians from the lobe's axis to where it has fallen to a half, across the narrower way (to a root of 2 where an
    /// anisotropic lobe is oblique): what texels must be finer than. At most pi / 2.
    fn half_width(&self, wo: Direction) -> f64 {
        lobe::half_width(self.axis(wo), |wi| self.evaluate(wi, wo))
    }

    /// The share of the light that is reflected to `wo` from an even sky (and, of a reciprocal model, of the light from
    /// there that is reflected at all): the integral of `evaluate` times the cosine, to about 1e-6.
    fn albedo(&self, wo: Direction) -> f64 {
        albedo::about_axis(self.axis(wo), self.half_width(wo), |wi| self.evaluate(wi, wo))
    }
}
