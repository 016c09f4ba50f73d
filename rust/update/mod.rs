//! B = M V, frame after frame, for any V: choosing (`choosing/`) is apart from multiplying (`multiplying/`).

pub mod change;
pub mod choosing;
pub mod multiplying;
pub mod pace;
pub mod updater;

pub use change::{Term, Update};
pub use choosing::{Approximation, BandTest, Budget, Colours, Method, Norm, Settings};
pub use multiplying::{
    BandNorms, Bound, Grid, Measured, Response, RowNorm, bound_rows, kernel, light_norm, multiply, multiply_gridded,
};
pub use pace::Pace;
pub use updater::{Initial, Step, Updater};
