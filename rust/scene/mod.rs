//! Geometry and surfaces; immutable once built.

pub mod beam;
pub mod bundle;
pub mod camera;
mod lanes;
pub mod mesh;
pub mod reach;
pub mod receivers;
mod shadow;
mod shaft;
pub mod tracer;

pub use beam::Walk;
pub use bundle::{BUNDLE, Bundle};
pub use camera::Camera;
pub use mesh::Mesh;
pub use receivers::{PixelSampling, Receivers};
pub use tracer::{Hit, LIFT, Tracer};
