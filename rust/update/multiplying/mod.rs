//! Multiplying: it sees M and what changes of V; it does not ask why.

pub(in crate::update) mod adjoint;
pub mod bound;
pub(in crate::update) mod clustered;
pub mod finish;
pub mod grid;
pub mod kernel;
pub(in crate::update) mod merged;
pub mod product;
pub mod response;

pub use bound::{BandNorms, Bound, Measured, bound_rows, finish_bounds};
pub use finish::Mix;
pub use grid::{Grid, Span, light_norm};
pub use product::{multiply, multiply_gridded};
pub use response::Response;
