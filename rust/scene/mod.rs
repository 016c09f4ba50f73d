//! Geometry and surfaces; immutable once built.

pub mod beam;
mod lanes;
pub mod mesh;
pub mod tracer;

pub use beam::{BUNDLE, Bundle, Walk};
pub use mesh::Mesh;
pub use tracer::{Hit, LIFT, Tracer};
