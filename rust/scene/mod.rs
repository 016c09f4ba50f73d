//! Geometry and surfaces; immutable once built.

pub mod beam;
pub mod bundle;
mod lanes;
pub mod mesh;
mod shadow;
mod shaft;
pub mod tracer;

pub use beam::Walk;
pub use bundle::{BUNDLE, Bundle};
pub use mesh::Mesh;
pub use tracer::{Hit, LIFT, Tracer};
