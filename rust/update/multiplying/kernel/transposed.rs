//! The transposed loops: what the rows of a tile, each times its number, add to columns.
//!
//! The numbers of R are whole and so are the values of M. The 16 products of an entry are summed in f64, exactly; an entry's
//! sum is shifted into an integer of 128 bits. Columns are read one after the other and R, which fits a core's cache, by
//! group. Plain Rust, compiled a second time for AVX2.

use std::ops::Range;

use super::columns::{Columns, Integer, Sums};
use crate::transport::entry::{Channels, GROUP, group_of, shift_of};
use crate::transport::sight::{BUNDLE, Sight, Texels};
use crate::transport::tile::{Tile, Values};
use crate::twice::compiled_twice;

/// Sums of columns in red, green and blue, in whole units.
pub type Totals = [i128; 3];

/// Bits of the lower part of a number of R, where texels' values, of up to 27 bits, would not leave all of them exact.
const LOW: u32 = 17;

/// The rows' numbers by group of 16: whole, and below 2^34 in magnitude.
#[derive(Clone, Copy)]
pub struct Numbers<'a> {
    /// As they are.
    pub whole: &'a [Sums],
    /// In units of 2^17, rounded, and what is left; empty where no texels ask for them.
    pub parts: [&'a [Sums]; 2],
}

/// Splits numbers as `Numbers::parts` are.
pub fn parts(whole: &[Sums]) -> [Vec<Sums>; 2] {
    let unit = f64::from(1u32 << LOW);
    let high = |Sums(colours): &Sums| Sums(colours.map(|lanes| lanes.map(|x| (x / unit).trunc())));
    let low = |(Sums(whole), Sums(high)): (&Sums, &Sums)| {
        let lanes = |c: usize| std::array::from_fn(|lane| whole[c][lane] - unit * high[c][lane]);
        Sums(std::array::from_fn(lanes))
    };
    let above: Vec<Sums> = whole.iter().map(high).collect();
    let below = whole.iter().zip(&above).map(low).collect();
    [above, below]
}

/// Adds to the totals of some columns what the rows of a tile make of them.
pub fn add(tile: &Tile, columns: Range<usize>, numbers: Numbers, totals: &mut [Totals]) {
    let texels = columns.start.max(tile.columns())..columns.end.max(tile.columns());
    let (stored, of_texels) = totals.split_at_mut(columns.len() - texels.len());
    let own = columns.start..columns.start + stored.len();
    match (&tile.values, tile.channels) {
        (Values::I8(values), Channels::One) => {
            entries::<i8, 1>(tile, bytemuck::cast_slice(values), own, numbers, stored)
        }
        (Values::I8(values), Channels::Three) => {
            entries::<i8, 3>(tile, bytemuck::cast_slice(values), own, numbers, stored)
        }
        (Values::I16(values), Channels::One) => {
            entries::<i16, 1>(tile, bytemuck::cast_slice(values), own, numbers, stored)
        }
        (Values::I16(values), Channels::Three) => {
            entries::<i16, 3>(tile, bytemuck::cast_slice(values), own, numbers, stored)
        }
    }
    if let Some(sight) = tile.sight.as_ref().filter(|_| !texels.is_empty()) {
        let first = tile.columns();
        sighted(sight, texels.start - first..texels.end - first, numbers, of_texels);
    }
}

fn entries<T: Integer, const C: usize>(
    tile: &Tile,
    entries: &[[[T; GROUP]; C]],
    own: Range<usize>,
    numbers: Numbers,
    totals: &mut [Totals],
) {
    let columns = Columns { starts: &tile.starts, words: &tile.words, entries };
    by_columns(&columns, own, numbers, totals)
}

compiled_twice! {
    fn by_columns[T: Integer, const C: usize](
        columns: &Columns<'_, T, C>,
        own: Range<usize>,
        numbers: Numbers,
        totals: &mut [Totals],
    ) = entries_any;

    /// Texels, whose values are made anew bundle by bundle.
    fn sighted(sight: &Sight, texels: Range<usize>, numbers: Numbers, totals: &mut [Totals]) = sighted_any;
}

#[inline(always)]
fn entries_any<T: Integer, const C: usize>(
    columns: &Columns<'_, T, C>,
    own: Range<usize>,
    numbers: Numbers,
    totals: &mut [Totals],
) {
    for (totals, column) in totals.iter_mut().zip(own) {
        for entry in columns.starts[column] as usize..columns.starts[column + 1] as usize {
            let (word, Sums(rows)) = (columns.words[entry], &numbers.whole[group_of(columns.words[entry])]);
            let values = columns.entries[entry].map(|lanes| lanes.map(Into::into));
            for (colour, total) in totals.iter_mut().enumerate() {
                *total += i128::from(dot(&values[colour % C], &rows[colour]) as i64) << shift_of(word);
            }
        }
    }
}

/// Of whole numbers whose sum f64 holds: in any order the same.
#[inline(always)]
fn dot(a: &[f64; GROUP], b: &[f64; GROUP]) -> f64 {
    let mut sums = [0.0; 4];
    for k in 0..GROUP / 4 {
        for lane in 0..4 {
            sums[lane] += a[4 * k + lane] * b[4 * k + lane];
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

#[inline(always)]
fn sighted_any(sight: &Sight, texels: Range<usize>, numbers: Numbers, totals: &mut [Totals]) {
    let places = Texels::new(sight.size, texels.clone());
    let mut masks = vec![0u64; texels.len()];
    let mut seen = Vec::with_capacity(texels.len());
    let mut values = vec![[0.0; GROUP]; texels.len()];
    for group in 0..numbers.whole.len() {
        let within = group % (BUNDLE / GROUP);
        if within == 0 {
            sight.masks(group / (BUNDLE / GROUP), &places, &mut masks);
        }
        seen.clear();
        let open = masks.iter().map(|mask| (mask >> (within * GROUP)) as u16);
        seen.extend(texels.clone().zip(open).filter(|(_, open)| *open != 0));
        sight.integers(group, &seen, &mut values);
        // All values of a group are multiples of its step; in units of it they have at most 27 bits.
        let shift = sight.shift(group) as u32;
        let step = (1u64 << shift) as f64;
        let [high, low] = numbers.parts.map(|part| &part[group].0);
        for ((texel, _), values) in seen.iter().zip(&values) {
            let units = values.map(|value| value / step);
            for (colour, total) in totals[texel - texels.start].iter_mut().enumerate() {
                let sum = |part: &[[f64; GROUP]; 3]| i128::from(dot(&units, &part[colour]) as i64) << shift;
                *total += (sum(high) << LOW) + sum(low);
            }
        }
    }
}
