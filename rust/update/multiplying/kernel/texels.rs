//! The walk over texel columns: bits and cosines instead of stored integers.
//!
//! All peaks of a frame are added bundle by bundle, so that normals and sums pass through the cache once. Plain Rust,
//! compiled a second time for AVX2: the loops are over sixteen lanes.

use super::columns::{Move, Sums, Target};
use super::portable::publish;
use crate::transport::entry::{GROUP, Rows16};
use crate::transport::sight::{BUNDLE, Sight, TexelColumn, texel_columns, whole};

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
    let mut masks = vec![0u64; moves.len()];
    for (bundle, groups) in target.sums.chunks_mut(BUNDLE / GROUP).enumerate() {
        for (mask, &texel) in masks.iter_mut().zip(&texels) {
            *mask = sight.mask(bundle, texel);
        }
        for (k, sums) in groups.iter_mut().enumerate() {
            let group = bundle * (BUNDLE / GROUP) + k;
            if target.afresh {
                *sums = Sums::ZERO;
            }
            let normals = sight.group_normals(group);
            for (peak, mask) in peaks.iter().zip(&masks) {
                let open = (mask >> (k * GROUP)) as u16;
                if open != 0 {
                    add(sums, &normals, peak, open);
                }
            }
            if let Some(out) = &mut target.out {
                publish(sums, &mut out[group * 3 * GROUP..]);
            }
        }
    }
}

/// Sixteen rows of a texel's column times its change. All sums are exact: fused or not is the same.
#[inline(always)]
fn add(sums: &mut Sums, normals: &[Rows16; 3], peak: &Peak, open: u16) {
    let values = peak.column.values(normals);
    let mut wide = [0.0f64; GROUP];
    for lane in 0..GROUP {
        let seen = if open & 1 << lane != 0 { values[lane] } else { 0.0 };
        wide[lane] = whole(seen);
    }
    for (sums, change) in sums.0.iter_mut().zip(peak.change) {
        for lane in 0..GROUP {
            sums[lane] += wide[lane] * change;
        }
    }
}
