//! The light transport matrix M: tiles one above the other, and what can be asked of it.
//!
//! Multiplying by light, frame after frame, is `update/multiplying/response.rs`; here is what is asked once: rows, norms,
//! copies for other libraries, the transpose, a smaller version.

use rayon::prelude::*;

use crate::basis::{Bands, ColumnSpace};
use crate::error::Result;

use super::entry::{Channels, GROUP, Rows16, bf16, group_of};
use super::sight::{BUNDLE, Texels, texel_columns};
use super::tile::Tile;
use super::truncate::Truncation;

/// Columns that one thread takes at a time where the work goes by columns.
const COLUMNS: usize = 256;

/// M: `rows` receivers by `bands.columns()` columns, for all colours alike or for each its own.
pub struct TransportMatrix {
    /// What the columns are.
    pub space: ColumnSpace,
    /// How they group into bands; follows from `space`.
    pub bands: Bands,
    /// Receivers, over all tiles.
    pub rows: usize,
    /// One number for all colours, or one each.
    pub channels: Channels,
    /// Every value of M is an integer times 2^quantum.
    pub quantum: i32,
    /// Rows of every tile but the last; a multiple of `GROUP`.
    pub tile_rows: usize,
    /// One above the other, from the first row to the last.
    pub tiles: Vec<Tile>,
}

/// M row by row, for other libraries: entries of row i are `indptr[i]..indptr[i + 1]`, columns ascending.
#[derive(Clone, Debug, PartialEq)]
pub struct Csr {
    /// Where each row begins in the other two; rows + 1 numbers.
    pub indptr: Vec<i64>,
    /// The column of each entry.
    pub indices: Vec<i32>,
    /// The value of each entry, exactly as stored.
    pub data: Vec<f32>,
}

impl TransportMatrix {
    /// Bytes of M itself, norms included.
    pub fn nbytes(&self) -> usize {
        self.tiles.iter().map(Tile::nbytes).sum()
    }

    /// Stored groups of 16 rows.
    pub fn entries(&self) -> usize {
        self.tiles.iter().map(|tile| tile.words.len()).sum()
    }

    /// One transport vector, dense: columns x channels. Every stored value is a 32-bit float exactly.
    pub fn row(&self, row: usize) -> Vec<f32> {
        let tile = &self.tiles[row / self.tile_rows];
        let (group, lane) = (row % self.tile_rows / GROUP, row % GROUP);
        let channels = self.channels.count();
        let mut dense = vec![0.0; self.bands.columns() * channels];
        for (range, values) in tile.starts.windows(2).zip(dense.chunks_exact_mut(channels)) {
            let (start, end) = (range[0] as usize, range[1] as usize);
            // Groups ascend inside a column.
            let entry = start + tile.words[start..end].partition_point(|&word| group_of(word) < group);
            if entry < end && group_of(tile.words[entry]) == group {
                for (channel, value) in values.iter_mut().enumerate() {
                    *value = tile.lanes(entry, channel, self.quantum)[lane];
                }
            }
        }
        if let Some(sight) = &tile.sight {
            let mut masks = vec![0; self.bands.texels];
            sight.masks(row % self.tile_rows / BUNDLE, &Texels::new(sight.size, 0..masks.len()), &mut masks);
            let values = dense[self.bands.stored()..].iter_mut().zip(masks).enumerate();
            values.for_each(|(texel, (value, mask))| {
                let open = (mask >> (group * GROUP % BUNDLE)) as u16;
                *value = sight.lanes(group, open, texel)[lane];
            });
        }
        dense
    }

    /// A copy of one channel by rows, without the zeros that groups hold.
    pub fn to_csr(&self, channel: usize) -> Csr {
        let texels = self.bands.stored();
        let parts: Vec<Csr> = self.tiles.par_iter().map(|tile| tile.to_csr(channel, texels, self.quantum)).collect();
        let entries = parts.iter().map(|part| part.data.len()).sum();
        let mut all = Csr {
            indptr: Vec::with_capacity(self.rows + 1),
            indices: Vec::with_capacity(entries),
            data: Vec::with_capacity(entries),
        };
        all.indptr.push(0);
        for part in parts {
            let before = all.data.len() as i64;
            all.indptr.extend(part.indptr[1..].iter().map(|end| end + before));
            all.indices.extend(part.indices);
            all.data.extend(part.data);
        }
        all
    }

    /// The L2 norm of each column, over all channels.
    pub fn column_norms(&self) -> Vec<f64> {
        let mut norms = vec![0.0; self.bands.columns()];
        self.by_columns(&mut norms, 1, |_, _, lanes, out| {
            out[0] += lanes.iter().map(|&value| f64::from(value) * f64::from(value)).sum::<f64>();
        });
        norms.iter_mut().for_each(|norm: &mut f64| *norm = norm.sqrt());
        norms
    }

    /// Groups that each column touches: what it costs to stream it.
    pub fn column_entries(&self) -> Vec<u32> {
        let mut entries = vec![0; self.bands.columns()];
        for tile in &self.tiles {
            for (count, range) in entries.iter_mut().zip(tile.starts.windows(2)) {
                *count += range[1] - range[0];
            }
        }
        let counts = self.tiles.par_iter().filter_map(|tile| {
            let sight = tile.sight.as_ref()?;
            let mut counts = vec![0; self.bands.texels];
            sight.for_each_open(&Texels::new(sight.size, 0..counts.len()), |_, texel, _| counts[texel] += 1);
            Some(counts)
        });
        for counts in counts.collect::<Vec<Vec<u32>>>() {
            entries[self.bands.stored()..].iter_mut().zip(counts).for_each(|(entries, count)| *entries += count);
        }
        entries
    }

    /// The squared norms of all rows of a tile, in each channel: `[row][channel]`, rounded up.
    pub fn row_squares<'a>(&self, tile: &'a Tile) -> impl Iterator<Item = f64> + use<'a> {
        let channels = self.channels.count();
        let a_row = self.bands.count() * channels;
        tile.kept.chunks_exact(a_row).flat_map(move |norms| {
            let square = |bits: &u16| f64::from(bf16(*bits)).powi(2);
            (0..channels).map(move |channel| norms[channel..].iter().step_by(channels).map(square).sum::<f64>())
        })
    }

    /// M under a coarser rule, tile by tile. What its rows are stated to lose includes what they had lost before.
    pub fn truncated(&self, rule: &Truncation) -> Result<TransportMatrix> {
        let tiles = self.tiles.par_iter().map(|tile| tile.retruncate(&self.bands, self.quantum, rule));
        Ok(TransportMatrix {
            space: self.space,
            bands: self.bands.clone(),
            rows: self.rows,
            channels: self.channels,
            quantum: rule.quantum,
            tile_rows: self.tile_rows,
            tiles: tiles.collect::<Result<_>>()?,
        })
    }

    /// Calls `add(first row, channel, 16 values, the column's k results)` for all entries, down each column; columns in
    /// parallel.
    fn by_columns(&self, results: &mut [f64], k: usize, add: impl Fn(usize, usize, &Rows16, &mut [f64]) + Sync) {
        results.par_chunks_mut((COLUMNS * k).max(1)).enumerate().for_each(|(chunk, results)| {
            for (number, tile) in self.tiles.iter().enumerate() {
                for (column, out) in (chunk * COLUMNS..).zip(results.chunks_mut(k)) {
                    for entry in tile.entries(column) {
                        let row = number * self.tile_rows + group_of(tile.words[entry]) * GROUP;
                        for channel in 0..self.channels.count() {
                            add(row, channel, &tile.lanes(entry, channel, self.quantum), out);
                        }
                    }
                }
                // Of the chunk's columns those that are texels, all of them in one reading of the bits.
                let Some(sight) = &tile.sight else { continue };
                let stored = self.bands.stored();
                let first = (chunk * COLUMNS).max(stored);
                let texels = first - stored..(chunk * COLUMNS + results.len() / k).max(first) - stored;
                sight.for_each_open(&Texels::new(sight.size, texels.clone()), |group, place, open| {
                    let row = number * self.tile_rows + group * GROUP;
                    let at = (first - chunk * COLUMNS + place) * k;
                    add(row, 0, &sight.lanes(group, open, texels.start + place), &mut results[at..at + k]);
                });
            }
        });
    }
}

impl Tile {
    /// `texels`: the number of the first texel column.
    fn to_csr(&self, channel: usize, texels: usize, quantum: i32) -> Csr {
        let (starts, entries) = self.by_group();
        let mut csr = Csr { indptr: vec![0], indices: Vec::new(), data: Vec::new() };
        let list = self.sight.as_ref().map(|sight| Texels::new(sight.size, 0..texel_columns(sight.size).len()));
        let mut masks = vec![0; self.sight.as_ref().map_or(0, |sight| texel_columns(sight.size).len())];
        for (number, range) in starts.windows(2).enumerate() {
            let group = &entries[range[0] as usize..range[1] as usize];
            let mut lanes: Vec<(u32, Rows16)> =
                group.iter().map(|&(column, entry)| (column, self.lanes(entry as usize, channel, quantum))).collect();
            if let Some((sight, list)) = self.sight.as_ref().zip(list.as_ref()) {
                let first = number * GROUP % BUNDLE;
                if first == 0 {
                    sight.masks(number * GROUP / BUNDLE, list, &mut masks);
                }
                // Texels stand behind all other columns.
                let open = |(texel, mask): (usize, &u64)| (texel, (mask >> first) as u16);
                let seen = masks.iter().enumerate().map(open).filter(|(_, open)| *open != 0);
                lanes.extend(seen.map(|(texel, open)| ((texels + texel) as u32, sight.lanes(number, open, texel))));
            }
            for lane in 0..GROUP.min(self.rows + 1 - csr.indptr.len()) {
                for (column, values) in &lanes {
                    if values[lane] != 0.0 {
                        csr.indices.push(*column as i32);
                        csr.data.push(values[lane]);
                    }
                }
                csr.indptr.push(csr.data.len() as i64);
            }
        }
        csr
    }
}
