//! Making M: the only floor that meets both rays and transport. A pass is a function of (scene, settings, rows), so that
//! any split over threads, machines or interrupted runs gives the same M.

pub mod direct;
mod projection;
mod texels;

pub use direct::{DirectPass, Rays};
