//! deltalux: **B = M V**. M is the light transport of a still scene (receivers x columns), V is what the user moves.
//!
//! ```text
//! Mesh, Camera -> Tracer, Receivers -> precompute (a pass, one bundle of 64 rows at a time)
//!                 -> transport (compress_group -> Tile -> TransportMatrix -> Product; Writer -> files -> open)
//!
//! EnvironmentMap -> cubemap -> Haar or harmonics -> V -> Updater over a Chain
//!                 (Approximation chooses an Update -> Response -> B) -> relight::shade -> picture
//! ```
//!
//! | room | what is in it | uses |
//! |---|---|---|
//! | [`basis`] | columns and bands; cubemaps, Haar wavelets on them and on trees, spherical harmonics | nothing |
//! | [`brdf`] | models of reflectance and measured tables: evaluate, sample, pdf, albedo; lobes as curves; families of models | basis |
//! | [`light`] | environment maps: rotation, resampling, projection | basis |
//! | [`scene`] | triangles, camera, rays, receivers | nothing |
//! | [`transport`] | M: tiles, truncation, what links several matrices, files | basis |
//! | [`precompute`] | passes that make M | scene, transport, basis, brdf |
//! | [`update`] | B = M V, frame after frame: choosing, multiplying, and a bound | transport, basis |
//! | [`relight`] | responses to pictures | nothing |
//!
//! [`error`], [`sampling`] (numbers and directions spread evenly) and `twice` (code compiled twice) may be used by all. `python` (behind its feature) uses everything and is used by nothing.

#![warn(missing_docs)]

pub mod basis;
pub mod brdf;
pub mod error;
pub mod light;
pub mod precompute;
pub mod relight;
pub mod sampling;
pub mod scene;
pub mod transport;
mod twice;
pub mod update;

#[cfg(feature = "python")]
mod python;
