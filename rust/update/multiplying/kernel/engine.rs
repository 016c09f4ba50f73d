//! Which code walks: the same bits from each.

use crate::transport::entry::{Channels, GROUP};
use crate::transport::tile::{Tile, Values};

#[cfg(target_arch = "x86_64")]
use super::avx2;
use super::columns::{Batch, Columns, Integer, Move, Read, Scratch, Sums, Target};
use super::{portable, texels};

/// One batch and where it goes.
struct Work<'a> {
    tile: &'a Tile,
    read: Read,
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
        let work = Work { tile, read: batch.read, moves, scratch, target };
        match (&tile.values, tile.channels) {
            (Values::I8(values), Channels::One) => self.walk_columns::<i8, 1>(bytemuck::cast_slice(values), work),
            (Values::I8(values), Channels::Three) => self.walk_columns::<i8, 3>(bytemuck::cast_slice(values), work),
            (Values::I16(values), Channels::One) => self.walk_columns::<i16, 1>(bytemuck::cast_slice(values), work),
            (Values::I16(values), Channels::Three) => self.walk_columns::<i16, 3>(bytemuck::cast_slice(values), work),
        }
    }

    /// Adds one batch of moves of several lights, which have their columns in common, to the sums of each.
    pub fn walk_together(
        self,
        tile: &Tile,
        batch: &Batch,
        moves: &[Vec<Move>],
        scratch: &mut Scratch,
        sums: &mut [Vec<Sums>],
    ) {
        #[cfg(target_arch = "x86_64")]
        if self == Engine::Native
            && batch.read == Read::Marked
            && tile.channels == Channels::One
            && avx2::available()
            && let ([a, b, c, d], [w, x, y, z]) = (moves, &mut *sums)
        {
            let own = [a, b, c, d].map(|moves| &moves[batch.moves.clone()]);
            let sums = [&mut w[..], &mut x[..], &mut y[..], &mut z[..]];
            let (starts, words): (&[u32], &[u16]) = (&tile.starts, &tile.words);
            // SAFETY: the processor has what the code needs.
            return match &tile.values {
                Values::I8(values) => unsafe {
                    let columns = Columns { starts, words, entries: bytemuck::cast_slice(values) };
                    avx2::walk_together::<i8>(&columns, own, &mut scratch.marks, sums)
                },
                Values::I16(values) => unsafe {
                    let columns = Columns { starts, words, entries: bytemuck::cast_slice(values) };
                    avx2::walk_together::<i16>(&columns, own, &mut scratch.marks, sums)
                },
            };
        }
        for (moves, sums) in moves.iter().zip(sums) {
            self.walk(tile, batch, moves, scratch, Target { sums, afresh: false, out: None });
        }
    }

    fn walk_columns<T: Integer, const C: usize>(self, entries: &[[[T; GROUP]; C]], work: Work<'_>) {
        let Work { tile, read, moves, scratch, target } = work;
        let columns = Columns { starts: &tile.starts, words: &tile.words, entries };
        #[cfg(target_arch = "x86_64")]
        if self == Engine::Native && avx2::available() {
            // SAFETY: the processor has what the code needs.
            return match read {
                Read::Sorted => unsafe { avx2::walk_sorted(&columns, moves, &mut scratch.sorted, target) },
                Read::Marked | Read::Texels => unsafe {
                    avx2::walk_marked(&columns, moves, &mut scratch.marks, target)
                },
            };
        }
        match read {
            Read::Sorted => portable::walk_sorted(&columns, moves, &mut scratch.sorted, target),
            Read::Marked | Read::Texels => portable::walk_marked(&columns, moves, &mut scratch.marks, target),
        }
    }
}
