//! deltalux: **B = M V**. M is the light transport of a still scene (receivers x columns), V is what the user moves.
//! (The map of the rooms is completed at the end; see README.md.)

pub mod basis;
pub mod error;
pub mod precompute;
pub mod relight;
pub mod scene;
pub mod light;
pub mod transport;
pub mod update;

#[cfg(feature = "python")]
mod python;
