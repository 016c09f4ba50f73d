//! Distant light: environment maps, rotated and resampled to cubemaps every frame.

pub mod environment;
pub mod layout;

mod bright;
mod lookup;
pub mod peaks;
pub mod radiance;
mod resample;

pub use environment::{Behind, EnvironmentMap};
pub use layout::{Layout, Rows};
