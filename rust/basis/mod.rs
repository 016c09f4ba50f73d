//! Pure mathematics: the bases in which light and transport are measured. No rays, no images.

pub mod bands;
pub mod haar;
pub mod spherical_harmonics;

pub use bands::{Bands, ColumnSpace};
