//! Rays: the tree, its one tracer, and fans of rays that walk it together.

mod cone;
mod eight;
mod facets;
pub mod fan;
mod holes;
mod segments;
pub mod tracer;
mod tree;
pub mod walk;

pub use cone::Apex;
pub use fan::{FAN, Fan, Octant, fans};
pub use holes::{Holes, Opacity, Picture, Wrap};
pub use segments::Segments;
pub use tracer::{Hit, LIFT, Tracer};
pub use walk::Walk;
