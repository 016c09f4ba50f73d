//! B = M V, frame after frame, for any V: choosing (`choosing/`) is apart from multiplying (`multiplying/`).

mod adjoint;
pub mod chain;
pub mod change;
pub mod choosing;
pub mod multiplying;
pub mod pace;
pub mod stage;
pub mod updater;

pub use chain::Chain;
pub use change::{Applied, Term, Update};
pub use choosing::{Approximation, BandTest, Budget, Colours, Method, Norm, Settings};
pub use multiplying::{
    BandNorms, Bound, Grid, Measured, Mix, Response, Span, bound_rows, finish_bounds, kernel, light_norm, multiply,
    multiply_gridded,
};
pub use pace::Pace;
pub use stage::{Chosen, Stage};
pub use updater::{Initial, Step, Updater};
