//! B = M V, frame after frame, for any V: choosing (approximation) is apart from multiplying (response).

pub mod approximation;
mod band_test;
pub mod change;
mod frame;
mod harmonic;
mod select;

pub use approximation::{Approximation, Channels, Method, Norm, Settings};
pub use band_test::BandTest;
pub use change::{Term, Update};
pub use select::Budget;
