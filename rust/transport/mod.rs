//! M and its forms: rows x columns, nothing else. No rays and no images here.

pub mod matrix;
pub mod tile;

pub use matrix::TransportMatrix;
pub use tile::{CompressedGroup, GROUP, MAX_TILE_ROWS, Slab, Tile, Values, Width};
