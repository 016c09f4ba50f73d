//! Choosing: it sees vectors only; no matrix, no scene.

pub mod approximation;
mod band_test;
mod candidates;
mod harmonic;
mod largest;
pub mod method;
mod select;

pub use approximation::Approximation;
pub use method::{BandTest, Budget, Colours, Method, Norm, Settings};
