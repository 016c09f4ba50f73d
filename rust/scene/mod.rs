//! Geometry and surfaces; immutable once built.

pub mod camera;
pub mod mesh;
pub mod rays;
pub mod receivers;

pub use camera::Camera;
pub use mesh::Mesh;
pub use receivers::{PixelSampling, Receivers};
