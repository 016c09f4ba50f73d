//! Distant light: cubemaps of radiance, and environment maps that are rotated and resampled to them every frame.

pub mod cubemap;
pub mod environment;

pub use environment::EnvironmentMap;
