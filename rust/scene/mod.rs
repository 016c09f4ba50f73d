//! Geometry and surfaces; immutable once built.

pub mod beam;
pub mod camera;
mod lanes;
pub mod mesh;
pub mod receivers;
pub mod tracer;

pub use beam::{BUNDLE, Bundle, Walk};
pub use camera::Camera;
pub use mesh::Mesh;
pub use receivers::{PixelSampling, Receivers};
pub use tracer::{Hit, LIFT, Tracer};
