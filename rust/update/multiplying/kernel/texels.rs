//! The walk over texel columns: bits, and cosines or lobes made anew, instead of stored integers.
//!
//! All peaks of a frame are added bundle by bundle, so that normals and sums pass through the cache once. Plain Rust,
//! compiled a second time for AVX2: the loops are over sixteen lanes.

// By index: loops over lanes of several arrays at once.
#![allow(clippy::needless_range_loop)]

use super::columns::{Move, Sums, Target};
use super::portable::publish;
use crate::transport::entry::GROUP;
use crate::transport::sight::{BUNDLE, Sight, Texels};

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
    let texels: Vec<usize> = moves.iter().map(|moved| moved.column as usize - first).collect();
    let places = Texels::new(sight.size, texels.iter().copied());
    let mut masks = vec![0u64; moves.len()];
    let mut seen = Vec::with_capacity(moves.len());
    let mut changes = Vec::with_capacity(moves.len());
    let mut values = vec![[0.0; GROUP]; moves.len()];
    for (bundle, groups) in target.sums.chunks_mut(BUNDLE / GROUP).enumerate() {
        sight.masks(bundle, &places, &mut masks);
        for (k, sums) in groups.iter_mut().enumerate() {
            let group = bundle * (BUNDLE / GROUP) + k;
            if target.afresh {
                *sums = Sums::ZERO;
            }
            seen.clear();
            changes.clear();
            for ((&texel, moved), mask) in texels.iter().zip(moves).zip(&masks) {
                let open = (mask >> (k * GROUP)) as u16;
                if open != 0 {
                    seen.push((texel, open));
                    changes.push(moved.change);
                }
            }
            sight.integers(group, &seen, &mut values);
            add(sums, &values[..seen.len()], &changes);
            if let Some(out) = &mut target.out {
                publish(sums, &mut out[group * 3 * GROUP..]);
            }
        }
    }
}

/// Colour by colour, so that a colour's sums stay in registers. All sums are exact: fused or not is the same.
#[inline(always)]
fn add(sums: &mut Sums, values: &[[f64; GROUP]], changes: &[[f64; 3]]) {
    for (colour, sums) in sums.0.iter_mut().enumerate() {
        let mut lanes = *sums;
        for (values, change) in values.iter().zip(changes) {
            let change = change[colour];
            for lane in 0..GROUP {
                lanes[lane] += values[lane] * change;
            }
        }
        *sums = lanes;
    }
}
