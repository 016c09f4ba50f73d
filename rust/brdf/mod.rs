//! Reflectance: what share of the light from `wi` a surface sends to `wo`, per steradian.
//!
//! Directions are unit vectors of the local frame: z is the normal, x the tangent of anisotropic models; both point away
//! from the surface, `wi` to the light and `wo` to the eye. Where one of them is not above the horizon, all is 0.
//!
//! ```text
//! model.rs      what a model is asked
//! direction.rs  the half vector, in forms that keep their digits at grazing angles and in narrow lobes
//! lobe.rs albedo.rs quadrature.rs      what follows from any model's values: half width, directional albedo
//! facets.rs     models that follow the half vector, and how they are sampled
//! curve.rs quotient.rs      a lobe as a curve that is edited, and what is left of the material
//! fresnel.rs slopes.rs power.rs      parts of models: Fresnel; facets by their slopes (Beckmann), by powers of cosines
//! lambert.rs mirror.rs blinn_phong.rs ward.rs cook_torrance.rs microfacet.rs ashikhmin_shirley.rs      the models
//! stored.rs     a model by its number and parameters, as in files
//! family/       a model over the range of its parameter, as few functions that span it
//! factor.rs     of a lobe that is seen from anywhere, what depends on the light
//! measured/     tables of measured materials, in three colours
//! ```
//!
//! Values of the models are made of what IEEE 754 rounds, and of exponentials and logarithms of the crate libm: they are the
//! same to the bit on every machine, as texel columns are made anew from them. Samples, densities of measured tables and
//! albedos, which are stored or summed up, take the platform's functions.
//!
//! Lobes narrower than that of a roughness of 0.002 are refused: mirrors need another method than integrals over texels.

mod albedo;
pub mod ashikhmin_shirley;
pub mod blinn_phong;
pub mod cook_torrance;
pub mod curve;
mod direction;
mod facets;
pub mod factor;
pub mod family;
pub mod fresnel;
pub mod lambert;
mod lobe;
pub mod measured;
pub mod microfacet;
pub mod mirror;
pub mod model;
mod power;
mod quadrature;
pub mod quotient;
mod range;
mod slopes;
pub mod stored;
pub mod ward;

pub use ashikhmin_shirley::AshikhminShirley;
pub use blinn_phong::BlinnPhong;
pub use cook_torrance::CookTorrance;
pub use curve::{Curved, Share};
pub use direction::Direction;
pub use factor::Factor;
pub use fresnel::Fresnel;
pub use lambert::Lambert;
pub use measured::Measured;
pub use microfacet::{Beckmann, Ggx};
pub use mirror::{Lafortune, phong};
pub use model::Brdf;
pub use quotient::Quotient;
pub use stored::Stored;
pub use ward::{Ward, WardDuer};
