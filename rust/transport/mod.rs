//! M and its forms: rows x columns, nothing else. No rays and no images here.

pub mod dense;
pub mod file;
pub mod manifest;
pub mod matrix;
pub mod quantize;
pub mod rewrite;
pub mod shard;
pub mod survey;
pub mod tile;
pub mod truncate;
pub mod writer;

pub use dense::Dense;
pub use file::{Audit, Opened, ReceiverTable, open};
pub use matrix::{Csr, TransportMatrix};
pub use quantize::Lanes;
pub use rewrite::{rewrite, survey};
pub use survey::{Choice, Survey, threshold_for};
pub use tile::{CompressedGroup, GROUP, MAX_TILE_ROWS, Slab, Tile, Values, Width};
pub use truncate::{Truncation, bf16, bf16_up, compress_group};
pub use writer::{Description, Writer};
