//! M and its forms: rows x columns, nothing else. No rays and no images here.

pub mod clustering;
mod csr_rows;
pub mod dense;
pub mod entry;
pub mod file;
pub mod freeze;
pub mod lobes;
pub mod matrix;
pub mod product;
pub mod quantize;
pub mod receivers;
pub mod row_norms;
pub mod sight;
pub mod slab;
pub mod survey;
pub mod tile;
pub mod truncate;
pub mod weights;

pub use clustering::{Clustering, Clusters, cluster};
pub use dense::Dense;
pub use entry::{Channels, GROUP, MAX_TILE_ROWS, Rows16, Width, bf16, bf16_up};
pub use file::{
    Array, Audit, Beside, Description, Numbers, Opened, Part, Writer, open, rewrite, survey as survey_stored,
};
pub use freeze::freeze;
pub use lobes::{LobeModels, Lobes, RowLobe};
pub use matrix::{Csr, TransportMatrix};
pub use product::{Factors, Link, Product};
pub use receivers::{ReceiverKind, ReceiverTable};
pub use row_norms::RowNorms;
pub use sight::{Seen, Sight};
pub use slab::Slab;
pub use survey::{Measure, Survey, Threshold};
pub use tile::{CompressedGroup, Tile, Values};
pub use truncate::{Truncation, compress_group};
pub use weights::Weights;
