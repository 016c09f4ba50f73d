//! Geometry and surfaces; immutable once built.

pub mod camera;
mod curve;
pub mod gather_samples;
pub mod lamps;
pub mod mesh;
pub mod near;
pub mod nodes;
pub mod pieces;
pub mod rays;
pub mod receivers;
pub mod surface;
pub mod vertices;

pub use camera::Camera;
pub use gather_samples::GatherSamples;
pub use lamps::{Beam, Glints, Lamp, Sights, Source};
pub use mesh::Mesh;
pub use nodes::{CELL, Node, Nodes, Placed, Spacing, Wanted};
pub use receivers::{PixelSampling, Receivers};
pub use surface::{Point, Points, Surfaces};
pub use vertices::{Faces, Shading, Vertices};
