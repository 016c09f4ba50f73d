//! deltalux: **B = M V**. M is the light transport of a still scene (receivers x columns), V is what the user moves.
//!
//! ```text
//! Scene -> precompute (a pass, one tile of rows at a time) -> transport (truncate -> Tile -> TransportMatrix -> file)
//!                                                                         |
//! Environment -> Cubemap -> V -> update (Approximation chooses an Update) -> Response B -> relight::shade -> picture
//! ```
//!
//! | room | what is in it | uses |
//! |---|---|---|
//! | [`basis`] | columns, bands, transforms | nothing |
//! | [`light`] | cubemaps and environments | basis |
//! | [`scene`] | triangles, rays, receivers | nothing |
//! | [`transport`] | M: tiles, truncation, files | basis |
//! | [`precompute`] | passes that make M | scene, light, transport, basis |
//! | [`update`] | B = M V, frame after frame | transport, basis |
//! | [`relight`] | responses to pictures | update, transport, light |
//!
//! [`error`] may be used by all. `python` (behind its feature) uses everything and is used by nothing.

#![warn(missing_docs)]

pub mod basis;
pub mod error;
pub mod light;
pub mod precompute;
pub mod relight;
pub mod scene;
pub mod transport;
pub mod update;

#[cfg(feature = "python")]
mod python;
