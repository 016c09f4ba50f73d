//! Several lights in one walk over a tile: what the entries of a group stand for is worked out once, and then added for
//! each light.
//!
//! All entries of a tile are sorted by group, and taken block by block: a block's numbers, and what of each light they are
//! multiplied by, stay in a core's nearest cache, and the sums of a group in twelve registers. A light alone spends more
//! on finding and converting an entry than on adding it; here that is shared.

use super::columns::{Columns, Integer, Item, Move, Sorted, Sums};
use crate::transport::entry::GROUP;

/// Entries of a group that are worked out at a time: 8 kB of numbers of one channel.
const BLOCK: usize = 64;

/// The numbers of some entries, 16 in each channel. PERF: none of them lies across two cache lines.
#[repr(C, align(64))]
struct Block<const C: usize>([[[f64; GROUP]; C]; BLOCK]);

/// Several lights and what a tile adds to each.
pub struct Lights<'a> {
    /// The columns that some light needs, ascending; what they move by is not looked at.
    pub moves: &'a [Move],
    /// What they move by, times 2^quantum: `[move][light]`.
    pub changes: &'a [[f64; 3]],
    /// Of each light the sums of the tile's groups.
    pub sums: &'a mut [Vec<Sums>],
}

/// Adds the entries of a tile: `fill` works out those from a place of a list on, `add` adds them to a group's sums, times
/// every so many of the changes.
#[inline(always)]
pub(super) fn walk<T: Integer, const C: usize>(
    columns: &Columns<'_, T, C>,
    sorted: &mut Sorted,
    Lights { moves, changes, sums }: Lights<'_>,
    fill: impl Fn(&[Item], usize, &mut [[[f64; GROUP]; C]]),
    add: impl Fn(&mut Sums, &[[[f64; GROUP]; C]], &[Item], &[[f64; 3]], usize),
) {
    sorted.set(columns, moves);
    let (mut block, mut from, lights) = (Block([[[0.0; GROUP]; C]; BLOCK]), 0, sums.len());
    for group in 0..sums.first().map_or(0, Vec::len) {
        let mut items = sorted.group(group, &mut from);
        while !items.is_empty() {
            let count = items.len().min(BLOCK);
            fill(&sorted.items, items.start, &mut block.0[..count]);
            let own = &sorted.items[items.start..items.start + count];
            for (light, sums) in sums.iter_mut().enumerate() {
                add(&mut sums[group], &block.0[..count], own, &changes[light..], lights);
            }
            items.start += count;
        }
    }
}
