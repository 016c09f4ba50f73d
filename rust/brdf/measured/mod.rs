//! Measured materials: tables of three colours, as two laboratories publish them. Files are read in Python; what comes here
//! is checked for its shape and for numbers that no measurement gives.

mod colour;
mod merl;
mod patches;
mod rgl;
mod table;
mod warp;

pub use colour::Colour;
pub use merl::{MERL, Merl};
pub use rgl::{Rgl, RglTables};
pub use table::Measured;
