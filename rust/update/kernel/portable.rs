//! The walk in plain Rust: for other processors, and the check of the vector code.

use super::{Columns, Integer, Marks, Move, POWERS, Sums, Target, WORD};
use crate::transport::tile::{GROUP, GROUP_BITS};

pub(super) fn walk<T: Integer, const WORDS: usize>(
    columns: &Columns<'_, T>,
    moves: &[Move],
    marks: &mut Marks<WORDS>,
    mut target: Target<'_>,
) {
    marks.set(columns.starts, columns.words, moves, |_| ());
    for (group, sums) in target.sums.iter_mut().enumerate() {
        if target.afresh {
            *sums = Sums::ZERO;
        }
        for word in 0..WORDS {
            let mut bits = std::mem::take(&mut marks.groups[group][word]);
            while bits != 0 {
                let bit = bits.trailing_zeros() as usize;
                bits &= bits - 1;
                let entry = marks.cursors[word][bit] as usize;
                marks.cursors[word][bit] += 1;
                add(sums, columns, &moves[word * WORD + bit], entry);
            }
        }
        if let Some(out) = &mut target.out {
            publish(sums, &mut out[group * 3 * GROUP..]);
        }
    }
}

fn add<T: Integer>(sums: &mut Sums, columns: &Columns<'_, T>, moved: &Move, entry: usize) {
    let power = POWERS[(columns.words[entry] >> GROUP_BITS) as usize];
    for (sums, change) in sums.0.iter_mut().zip(moved.change) {
        for (sum, &value) in sums.iter_mut().zip(&columns.lanes[entry]) {
            *sum += value.into() * (change * power);
        }
    }
}

/// Rounds a group's sums, once, into rows of red, green, blue; `out` may end inside the group.
pub(super) fn publish(sums: &Sums, out: &mut [f32]) {
    for (lane, row) in out.chunks_exact_mut(3).take(GROUP).enumerate() {
        for (value, sums) in row.iter_mut().zip(&sums.0) {
            *value = sums[lane] as f32;
        }
    }
}
