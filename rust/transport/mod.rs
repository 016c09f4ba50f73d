//! M and its forms: rows x columns, nothing else. No rays and no images here.

pub mod matrix;
pub mod tile;
pub mod truncate;

pub use matrix::TransportMatrix;
pub use tile::{CompressedGroup, GROUP, MAX_TILE_ROWS, Slab, Tile, Values, Width};
pub use truncate::{Choice, Lanes, Survey, Truncation, compress_group, threshold_for};
