//! Rays: the tree, its one tracer, and bundles of parallel rays that walk it together.

pub mod beam;
pub mod bundle;
mod eight;
pub mod reach;
mod shadow;
mod shaft;
pub mod tracer;

pub use beam::Walk;
pub use bundle::{BUNDLE, Bundle};
pub use tracer::{Hit, LIFT, Tracer};
