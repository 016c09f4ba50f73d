//! M and its forms: rows x columns, nothing else. No rays and no images here.

pub mod dense;
pub mod file;
pub mod manifest;
pub mod matrix;
pub mod shard;
pub mod tile;
pub mod truncate;
pub mod writer;

pub use dense::Dense;
pub use file::{Audit, Opened, ReceiverTable, open};
pub use matrix::{Csr, TransportMatrix};
pub use tile::{CompressedGroup, GROUP, MAX_TILE_ROWS, Slab, Tile, Values, Width};
pub use truncate::{Choice, Lanes, Survey, Truncation, compress_group, threshold_for};
pub use writer::{Description, Writer};
