//! B = M V, frame after frame, for any V: choosing (approximation) is apart from multiplying (response).

pub mod bound;
pub mod change;
pub mod grid;
pub mod kernel;
pub mod multiply;
pub mod response;

pub use bound::{BandNorms, Bound, band_norms, bound_rows};
pub use change::{Term, Update};
pub use grid::{Grid, RowNorm, light_norm};
pub use multiply::multiply;
pub use response::Response;
