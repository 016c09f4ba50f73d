//! Geometry and surfaces; immutable once built.

pub mod camera;
pub mod mesh;
pub mod near;
pub mod nodes;
pub mod rays;
pub mod receivers;
pub mod surface;

pub use camera::Camera;
pub use mesh::Mesh;
pub use nodes::{CELL, Node, Nodes, Spacing};
pub use receivers::{PixelSampling, Receivers};
pub use surface::{Point, Points, Surfaces};
