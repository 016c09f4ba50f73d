//! B = M V, frame after frame, for any V: choosing (approximation) is apart from multiplying (response).

pub mod approximation;
mod band_test;
pub mod bound;
pub mod change;
mod frame;
pub mod grid;
mod harmonic;
pub mod kernel;
pub mod multiply;
pub mod pace;
pub mod response;
mod select;
pub mod updater;

pub use approximation::{Approximation, Channels, Method, Norm, Settings};
pub use band_test::BandTest;
pub use bound::{BandNorms, Bound, Measured, bound_rows};
pub use change::{Term, Update};
pub use grid::{Grid, RowNorm, light_norm};
pub use multiply::multiply;
pub use pace::Pace;
pub use response::Response;
pub use select::Budget;
pub use updater::{Initial, Step, Updater};
