//! Distant light: cubemaps of radiance, and environment maps that are rotated and resampled to them every frame.

pub mod cubemap;
pub mod environment;
pub mod projection;

mod bright;
mod lookup;
mod resample;

pub use environment::{EnvironmentMap, Layout};
pub use projection::{HARMONIC_FACE, HarmonicProjection};
