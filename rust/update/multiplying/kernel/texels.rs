//! The walk over texel columns: bits and cosines instead of stored integers.
//!
//! All peaks of a frame are added bundle by bundle, so that normals and sums pass through the cache once. Plain Rust,
//! compiled a second time for AVX2: the loops are over sixteen lanes.

// By index: loops over lanes of several arrays at once.
#![allow(clippy::needless_range_loop)]

use super::columns::{Move, Sums, Target};
use super::portable::publish;
use crate::transport::entry::{GROUP, Rows16};
use crate::transport::sight::{BUNDLE, Sight, TexelColumn, Texels, texel_columns, whole};

/// A texel column that moves.
#[derive(Clone, Copy)]
struct Peak {
    column: TexelColumn,
    change: [f64; 3],
}

/// Adds moves of texel columns, of which the first is column `first` of M, to a tile's sums.
pub(super) fn walk(sight: &Sight, first: usize, moves: &[Move], native: bool, target: Target<'_>) {
    #[cfg(target_arch = "x86_64")]
    if native && is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
        // SAFETY: the processor has both.
        return unsafe { walk_avx2(sight, first, moves, target) };
    }
    let _ = native;
    walk_any(sight, first, moves, target)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn walk_avx2(sight: &Sight, first: usize, moves: &[Move], target: Target<'_>) {
    walk_any(sight, first, moves, target)
}

#[inline(always)]
fn walk_any(sight: &Sight, first: usize, moves: &[Move], mut target: Target<'_>) {
    let columns = texel_columns(sight.size);
    let texels: Vec<usize> = moves.iter().map(|moved| moved.column as usize - first).collect();
    let peak = |(&texel, moved): (&usize, &Move)| Peak {
        column: columns[texel].in_units(sight.quantum),
        change: moved.change,
    };
    let peaks: Vec<Peak> = texels.iter().zip(moves).map(peak).collect();
    let places = Texels::new(sight.size, texels.iter().copied());
    let mut masks = vec![0u64; moves.len()];
    let mut seen = vec![Seen { values: [0.0; GROUP], change: [0.0; 3] }; moves.len()];
    for (bundle, groups) in target.sums.chunks_mut(BUNDLE / GROUP).enumerate() {
        sight.masks(bundle, &places, &mut masks);
        for (k, sums) in groups.iter_mut().enumerate() {
            let group = bundle * (BUNDLE / GROUP) + k;
            if target.afresh {
                *sums = Sums::ZERO;
            }
            let normals = sight.group_normals(group);
            let mut count = 0;
            for (peak, mask) in peaks.iter().zip(&masks) {
                let open = (mask >> (k * GROUP)) as u16;
                if open != 0 {
                    seen[count] = Seen { values: values(&normals, peak, open), change: peak.change };
                    count += 1;
                }
            }
            add(sums, &seen[..count]);
            if let Some(out) = &mut target.out {
                publish(sums, &mut out[group * 3 * GROUP..]);
            }
        }
    }
}

/// Sixteen rows of a texel's column, and what it moves by.
#[derive(Clone, Copy)]
struct Seen {
    values: [f64; GROUP],
    change: [f64; 3],
}

/// A column in sixteen rows: whole numbers, zero where the texel is not open.
#[inline(always)]
fn values(normals: &[Rows16; 3], peak: &Peak, open: u16) -> [f64; GROUP] {
    let values = peak.column.values(normals);
    let mut wide = [0.0; GROUP];
    for lane in 0..GROUP {
        let seen = if open & 1 << lane != 0 { values[lane] } else { 0.0 };
        wide[lane] = whole(seen);
    }
    wide
}

/// Colour by colour, so that a colour's sums stay in registers. All sums are exact: fused or not is the same.
#[inline(always)]
fn add(sums: &mut Sums, seen: &[Seen]) {
    for (colour, sums) in sums.0.iter_mut().enumerate() {
        let mut lanes = *sums;
        for column in seen {
            let change = column.change[colour];
            for lane in 0..GROUP {
                lanes[lane] += column.values[lane] * change;
            }
        }
        *sums = lanes;
    }
}
