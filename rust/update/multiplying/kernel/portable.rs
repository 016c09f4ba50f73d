//! The walk in plain Rust: for other processors, and the check of the vector code.

use super::columns::{Columns, Integer, Item, Marks, Move, POWERS, Sorted, Sums, Target};
use super::together::{self, Lights};
use crate::transport::entry::{GROUP, GROUP_BITS};

/// Adds a batch of at most 64 moves, found by their marks.
pub(super) fn walk_marked<T: Integer, const C: usize>(
    columns: &Columns<'_, T, C>,
    moves: &[Move],
    marks: &mut Marks,
    target: Target<'_>,
) {
    marks.set(columns, moves, |_| ());
    walk(target, |group, sums| {
        let mut bits = std::mem::take(&mut marks.groups[group]);
        while bits != 0 {
            let bit = bits.trailing_zeros() as usize;
            bits &= bits - 1;
            add(sums, columns, &moves[bit], marks.cursors[bit] as usize);
            marks.cursors[bit] += 1;
        }
    });
}

/// Adds a batch of any number of moves, sorted by group.
pub(super) fn walk_sorted<T: Integer, const C: usize>(
    columns: &Columns<'_, T, C>,
    moves: &[Move],
    sorted: &mut Sorted,
    target: Target<'_>,
) {
    sorted.set(columns, moves);
    let mut from = 0;
    walk(target, |group, sums| {
        for item in &sorted.items[sorted.group(group, &mut from)] {
            add(sums, columns, &moves[item.moved as usize], item.entry as usize);
        }
    });
}

/// Adds the columns of several lights.
pub(super) fn walk_together<T: Integer, const C: usize>(
    columns: &Columns<'_, T, C>,
    sorted: &mut Sorted,
    lights: Lights<'_>,
) {
    let fill = |items: &[Item], from: usize, block: &mut [[[f64; GROUP]; C]]| {
        for (values, item) in block.iter_mut().zip(&items[from..]) {
            let (entry, power) = (item.entry as usize, power_of(columns.words[item.entry as usize]));
            for (values, lanes) in values.iter_mut().zip(&columns.entries[entry]) {
                values.iter_mut().zip(lanes).for_each(|(value, &lane)| *value = lane.into() * power);
            }
        }
    };
    let add = |sums: &mut Sums, block: &[[[f64; GROUP]; C]], items: &[Item], changes: &[[f64; 3]], lights: usize| {
        for (values, item) in block.iter().zip(items) {
            let change = changes[item.moved as usize * lights];
            for (colour, (sums, change)) in sums.0.iter_mut().zip(change).enumerate() {
                sums.iter_mut().zip(&values[colour % C]).for_each(|(sum, value)| *sum += value * change);
            }
        }
    };
    together::walk(columns, sorted, lights, fill, add);
}

fn walk(mut target: Target<'_>, mut add_group: impl FnMut(usize, &mut Sums)) {
    for (group, sums) in target.sums.iter_mut().enumerate() {
        if target.afresh {
            *sums = Sums::ZERO;
        }
        add_group(group, sums);
        if let Some(out) = &mut target.out {
            publish(sums, &mut out[group * 3 * GROUP..]);
        }
    }
}

fn add<T: Integer, const C: usize>(sums: &mut Sums, columns: &Columns<'_, T, C>, moved: &Move, entry: usize) {
    let power = power_of(columns.words[entry]);
    for (colour, (sums, change)) in sums.0.iter_mut().zip(moved.change).enumerate() {
        for (sum, &value) in sums.iter_mut().zip(&columns.entries[entry][colour % C]) {
            *sum += value.into() * (change * power);
        }
    }
}

/// 2^shift of an entry's word.
#[inline(always)]
fn power_of(word: u16) -> f64 {
    POWERS[(word >> GROUP_BITS) as usize]
}

/// Rounds a group's sums, once, into rows of red, green, blue; `out` may end inside the group.
pub(super) fn publish(sums: &Sums, out: &mut [f32]) {
    for (lane, row) in out.chunks_exact_mut(3).take(GROUP).enumerate() {
        for (value, sums) in row.iter_mut().zip(&sums.0) {
            *value = sums[lane] as f32;
        }
    }
}
