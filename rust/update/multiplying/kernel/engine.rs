//! Which code walks: the same bits from each.

use crate::transport::entry::{Channels, GROUP};
use crate::transport::tile::{Tile, Values};

#[cfg(target_arch = "x86_64")]
use super::avx2;
use super::columns::{Batch, Columns, Integer, Move, Read, Scratch, Target};
use super::together::Lights;
use super::{portable, texels};

/// One batch and where it goes.
struct Work<'a> {
    tile: &'a Tile,
    sorted: bool,
    moves: &'a [Move],
    scratch: &'a mut Scratch,
    target: Target<'a>,
}

/// Which code runs; both leave the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Engine {
    /// Plain Rust, for any processor.
    Portable,
    /// The fastest that this processor has.
    Native,
}

impl Engine {
    /// Adds one batch of moves to a tile's sums.
    pub fn walk<'a>(
        self,
        tile: &'a Tile,
        batch: &Batch,
        moves: &'a [Move],
        scratch: &'a mut Scratch,
        target: Target<'a>,
    ) {
        debug_assert!(target.sums.len() == tile.groups());
        let moves = &moves[batch.moves.clone()];
        if let (Read::Texels, Some(sight)) = (batch.read, &tile.sight) {
            return texels::walk(sight, tile.columns(), moves, self == Engine::Native, target);
        }
        let work = Work { tile, sorted: batch.read == Read::Sorted, moves, scratch, target };
        match (&tile.values, tile.channels) {
            (Values::I8(values), Channels::One) => self.walk_columns::<i8, 1>(bytemuck::cast_slice(values), work),
            (Values::I8(values), Channels::Three) => self.walk_columns::<i8, 3>(bytemuck::cast_slice(values), work),
            (Values::I16(values), Channels::One) => self.walk_columns::<i16, 1>(bytemuck::cast_slice(values), work),
            (Values::I16(values), Channels::Three) => self.walk_columns::<i16, 3>(bytemuck::cast_slice(values), work),
        }
    }

    /// Adds the stored columns of several lights, all of them at once.
    pub fn walk_together(self, tile: &Tile, scratch: &mut Scratch, lights: Lights<'_>) {
        debug_assert!(lights.changes.len() == lights.moves.len() * lights.sums.len());
        match (&tile.values, tile.channels) {
            (Values::I8(values), Channels::One) => {
                self.columns_together::<i8, 1>(bytemuck::cast_slice(values), tile, scratch, lights)
            }
            (Values::I8(values), Channels::Three) => {
                self.columns_together::<i8, 3>(bytemuck::cast_slice(values), tile, scratch, lights)
            }
            (Values::I16(values), Channels::One) => {
                self.columns_together::<i16, 1>(bytemuck::cast_slice(values), tile, scratch, lights)
            }
            (Values::I16(values), Channels::Three) => {
                self.columns_together::<i16, 3>(bytemuck::cast_slice(values), tile, scratch, lights)
            }
        }
    }

    fn columns_together<T: Integer, const C: usize>(
        self,
        entries: &[[[T; GROUP]; C]],
        tile: &Tile,
        scratch: &mut Scratch,
        lights: Lights<'_>,
    ) {
        let columns = Columns { starts: &tile.starts, words: &tile.words, entries };
        #[cfg(target_arch = "x86_64")]
        if self == Engine::Native && avx2::available() {
            // SAFETY: the processor has what the code needs.
            return unsafe { avx2::walk_together(&columns, &mut scratch.sorted, lights) };
        }
        portable::walk_together(&columns, &mut scratch.sorted, lights)
    }

    fn walk_columns<T: Integer, const C: usize>(self, entries: &[[[T; GROUP]; C]], work: Work<'_>) {
        let Work { tile, sorted, moves, scratch, target } = work;
        let columns = Columns { starts: &tile.starts, words: &tile.words, entries };
        #[cfg(target_arch = "x86_64")]
        if self == Engine::Native && avx2::available() {
            return match sorted {
                // SAFETY: the processor has what the code needs.
                false => unsafe { avx2::walk_marked(&columns, moves, &mut scratch.marks, target) },
                // SAFETY: as above.
                true => unsafe { avx2::walk_sorted(&columns, moves, &mut scratch.sorted, target) },
            };
        }
        match sorted {
            false => portable::walk_marked(&columns, moves, &mut scratch.marks, target),
            true => portable::walk_sorted(&columns, moves, &mut scratch.sorted, target),
        }
    }
}
