//! Making M: the only room that meets both rays and transport. A pass is a function of (scene, settings, rows), so that
//! any split over threads, machines or interrupted runs gives the same M.

pub mod direct;
pub mod pass;
mod projection;
mod texels;
mod visibility;

pub use direct::DirectPass;
pub use pass::{Made, Pass, Probed, Rays, Shape, Surveyed, probe, survey, tile};
