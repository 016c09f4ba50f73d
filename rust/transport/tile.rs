//! A tile: a contiguous range of neighbouring receivers, held column by column.
//!
//! For each column that is not empty it keeps the *groups* of 16 neighbouring rows that the column touches: one 16-bit
//! word and 16 integers each, or 3 x 16 where the colours have their own. One index then serves 16 rows and 3 colours. An
//! entry's word holds the group's number in the tile (low 10 bits) and a binary shift (high 6 bits), so that the value of
//! lane l is, in channel c of C,
//!
//! ```text
//!     values[(e C + c) 16 + l] * 2^(quantum + shift)
//! ```
//!
//! with one `quantum` for the whole matrix. All values of M are thus integers times 2^quantum: sums of such values with
//! coefficients from a dyadic grid are exact in f64, in any order (`update/multiplying/grid.rs`).

use std::ops::Range;

use crate::error::Result;

use super::entry::{Channels, GROUP, GROUP_BITS, MAX_TILE_ROWS, Rows16, Width, group_of, power_of_two, shift_of};
use super::sight::Sight;
use super::slab::Slab;

/// The integers of a tile, 16 for each entry and channel. Eight bits are enough for images; sixteen serve untruncated
/// transport.
#[derive(Clone)]
pub enum Values {
    /// Magnitudes up to 127.
    I8(Slab<i8>),
    /// Magnitudes up to 32,767.
    I16(Slab<i16>),
}

/// A tile of M.
#[derive(Clone)]
pub struct Tile {
    /// Rows of the tile; those that pad the last group are zero.
    pub rows: usize,
    /// One number for all colours, or one each.
    pub channels: Channels,
    /// The exponent of two that all values are multiples of: that of the whole matrix.
    pub quantum: i32,
    /// Entries of column j are `starts[j]..starts[j + 1]`; the length is columns + 1, texels not counted.
    pub starts: Slab<u32>,
    /// For each entry: group number | shift << 10. Inside a column the group numbers ascend.
    pub words: Slab<u16>,
    /// `[entry][channel][lane]`.
    pub values: Values,
    /// Norm of each stored row in each band, `[row][band][channel]`, bfloat16 rounded up (never below the true norm).
    pub kept: Slab<u16>,
    /// Norm of what truncation and rounding took from each row in each band, likewise.
    pub dropped: Slab<u16>,
    /// The bits of texel columns, where there are any; then there is one channel.
    pub sight: Option<Sight>,
}

impl Tile {
    /// The columns that have entries: those after them are texels.
    pub fn columns(&self) -> usize {
        self.starts.len() - 1
    }

    /// The entries of a column; none of a texel's.
    #[inline(always)]
    pub fn entries(&self, column: usize) -> Range<usize> {
        match self.starts.get(column + 1) {
            Some(&end) => self.starts[column] as usize..end as usize,
            None => 0..0,
        }
    }

    /// Groups of 16 rows, of which the last may be padded.
    pub fn groups(&self) -> usize {
        self.rows.div_ceil(GROUP)
    }

    /// Bytes in memory, which are those on disk.
    pub fn nbytes(&self) -> usize {
        let values = match &self.values {
            Values::I8(values) => values.len(),
            Values::I16(values) => 2 * values.len(),
        };
        let halves: usize = [&self.words, &self.kept, &self.dropped].map(|slab: &Slab<u16>| slab.len()).iter().sum();
        4 * self.starts.len() + 2 * halves + values + self.sight.as_ref().map_or(0, Sight::nbytes)
    }
}

/// One group of 16 rows after truncation: what a pass hands over, column after column.
#[derive(Clone, Debug, Default)]
pub struct CompressedGroup {
    /// Ascending.
    pub columns: Vec<u32>,
    /// The binary shift of each entry.
    pub shifts: Vec<u8>,
    /// 16 integers for each entry and channel; within -127..=127 where the tile is to hold eight bits.
    pub values: Vec<i16>,
    /// Norm of each stored row in each band, `[lane][band][channel]`, bfloat16 rounded up.
    pub kept: Vec<u16>,
    /// Norm of what each row lost in each band (truncation and rounding), likewise.
    pub dropped: Vec<u16>,
    /// The least shift that an entry may have: what the group's texel columns are in units of.
    pub least: u8,
}

impl Tile {
    /// Turns groups (row order) into columns: a counting sort by column, stable in the group number.
    pub fn assemble(
        rows: usize,
        columns: usize,
        channels: Channels,
        (width, quantum): (Width, i32),
        groups: &[CompressedGroup],
    ) -> Tile {
        debug_assert!(rows <= MAX_TILE_ROWS && groups.len() == rows.div_ceil(GROUP));
        let mut starts = vec![0u32; columns + 1];
        for group in groups {
            for &column in &group.columns {
                starts[column as usize + 1] += 1;
            }
        }
        for column in 0..columns {
            starts[column + 1] += starts[column];
        }

        let entries = starts[columns] as usize;
        let mut next = starts.clone();
        let mut words = vec![0u16; entries];
        let each = GROUP * channels.count();
        let mut wide = vec![0i16; if width == Width::I16 { entries * each } else { 0 }];
        let mut narrow = vec![0i8; if width == Width::I8 { entries * each } else { 0 }];
        for (number, group) in groups.iter().enumerate() {
            for (k, &column) in group.columns.iter().enumerate() {
                let entry = next[column as usize] as usize;
                next[column as usize] += 1;
                words[entry] = number as u16 | (group.shifts[k] as u16) << GROUP_BITS;
                let values = &group.values[k * each..(k + 1) * each];
                match width {
                    Width::I16 => wide[entry * each..(entry + 1) * each].copy_from_slice(values),
                    Width::I8 => {
                        for (slot, &value) in narrow[entry * each..(entry + 1) * each].iter_mut().zip(values) {
                            *slot = value as i8;
                        }
                    }
                }
            }
        }

        let norms = |of: fn(&CompressedGroup) -> &Vec<u16>| -> Slab<u16> {
            let mut all: Vec<u16> = groups.iter().flat_map(|group| of(group).iter().copied()).collect();
            let a_row = all.len() / (groups.len() * GROUP).max(1);
            all.truncate(rows * a_row);
            all.into()
        };
        Tile {
            rows,
            channels,
            quantum,
            starts: starts.into(),
            words: words.into(),
            values: if width == Width::I16 { Values::I16(wide.into()) } else { Values::I8(narrow.into()) },
            kept: norms(|group| &group.kept),
            dropped: norms(|group| &group.dropped),
            sight: None,
        }
    }
}

impl Tile {
    /// Entries of each group in column order: `(starts, (column, entry))`, the transpose of the tile's own order.
    pub fn by_group(&self) -> (Vec<u32>, Vec<(u32, u32)>) {
        let mut starts = vec![0u32; self.groups() + 1];
        for &word in self.words.iter() {
            starts[group_of(word) + 1] += 1;
        }
        for group in 0..self.groups() {
            starts[group + 1] += starts[group];
        }
        let mut next = starts.clone();
        let mut entries = vec![(0, 0); self.words.len()];
        for (column, range) in self.starts.windows(2).enumerate() {
            for entry in range[0]..range[1] {
                let slot = &mut next[group_of(self.words[entry as usize])];
                entries[*slot as usize] = (column as u32, entry);
                *slot += 1;
            }
        }
        (starts, entries)
    }

    /// The 16 stored values of an entry in one channel.
    pub fn lanes(&self, entry: usize, channel: usize, quantum: i32) -> Rows16 {
        let step = power_of_two(quantum + shift_of(self.words[entry]));
        let first = (entry * self.channels.count() + channel) * GROUP;
        let range = first..first + GROUP;
        let mut lanes = [0.0; GROUP];
        match &self.values {
            Values::I8(values) => lanes.iter_mut().zip(&values[range]).for_each(|(x, &q)| *x = f32::from(q) * step),
            Values::I16(values) => lanes.iter_mut().zip(&values[range]).for_each(|(x, &q)| *x = f32::from(q) * step),
        }
        lanes
    }

    /// Calls `visit(group, planes)` with each group made dense, in order: columns x 16 rows for each channel.
    pub fn for_each_group(
        &self,
        columns: usize,
        quantum: i32,
        mut visit: impl FnMut(usize, &[&[Rows16]]) -> Result<()>,
    ) -> Result<()> {
        let (starts, entries) = self.by_group();
        let mut dense = vec![vec![[0.0; GROUP]; columns]; self.channels.count()];
        for (group, range) in starts.windows(2).enumerate() {
            let here = &entries[range[0] as usize..range[1] as usize];
            for &(column, entry) in here {
                for (channel, plane) in dense.iter_mut().enumerate() {
                    plane[column as usize] = self.lanes(entry as usize, channel, quantum);
                }
            }
            let planes: Vec<&[Rows16]> = dense.iter().map(Vec::as_slice).collect();
            visit(group, &planes)?;
            for &(column, _) in here {
                dense.iter_mut().for_each(|plane| plane[column as usize] = [0.0; GROUP]);
            }
        }
        Ok(())
    }
}
