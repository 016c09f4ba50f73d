//! The light transport matrix M: tiles one above the other.

use crate::basis::{Bands, ColumnSpace};

use super::tile::Tile;

/// M: `rows` receivers by `bands.columns()` columns, one channel.
pub struct TransportMatrix {
    pub space: ColumnSpace,
    pub bands: Bands,
    pub rows: usize,
    /// Every value of M is an integer times 2^quantum.
    pub quantum: i32,
    /// Rows of every tile but the last; a multiple of `GROUP`.
    pub tile_rows: usize,
    pub tiles: Vec<Tile>,
}
