//! How far the response shown can be from the untruncated product: guaranteed, per receiver and as one number.
//!
//! With T the true transport, T' the stored one, V the light and V~ what has been applied of it,
//!
//! ```text
//!     T V - T' V~ = T' (V - V~) + (T - T') V,
//! ```
//!
//! so that by Cauchy-Schwarz in each band b
//!
//! ```text
//!     |B - B~|_i <= sum_b |T'_i,b| |(V - V~)_b| + sum_b |(T - T')_i,b| |V_b| + 2^-24 |B~_i|,
//! ```
//!
//! the last for rounding B~ to f32. V is the light before it was rounded to the grid: that error is thereby included.

use rayon::prelude::*;

use crate::basis::Bands;
use crate::transport::entry::{Channels, bf16};
use crate::transport::{Tile, TransportMatrix};

use super::grid::{above, norm_of_squares, squares};

/// For each band and colour a norm of coefficients, never below the true one.
pub type BandNorms = Vec<[f64; 3]>;

/// Half a unit in the last place of an f32, relative; and of the smallest, absolute.
pub(in crate::update) const ROUNDING: f64 = 1.0 / (1u64 << 24) as f64;
pub(super) const SMALLEST: f64 = f32::MIN_POSITIVE as f64 * ROUNDING;

/// What a bound needs to know of the light and of what has been applied of it.
pub struct Measured {
    /// V - V~ in each band.
    pub remaining: BandNorms,
    /// V in each band.
    pub light: BandNorms,
    /// The largest norm of a colour of V~.
    pub applied: f64,
}

impl Measured {
    /// One pass over `light` V and `values` V~.
    pub fn new(bands: &Bands, light: &[[f64; 3]], values: &[[f64; 3]]) -> Measured {
        let of_band = |band: usize| squares(&light[bands.range(band)], &values[bands.range(band)]);
        let sums: Vec<_> = (0..bands.count()).map(of_band).collect();
        let norms = |which: usize| sums.iter().map(|sums| sums[which].map(|square| above(square.sqrt()))).collect();
        let applied = norm_of_squares(sums.iter().map(|sums| sums[2]));
        Measured { remaining: norms(0), light: norms(1), applied }
    }
}

impl Measured {
    /// And the same as if all of V had been applied: what truncation alone takes.
    pub fn and_settled(self) -> [Measured; 2] {
        let (remaining, light) = (vec![[0.0; 3]; self.remaining.len()], self.light.clone());
        let settled = Measured { remaining, light, applied: self.applied };
        [self, settled]
    }

    /// V itself may be off by so much: so then may be what remains of it.
    pub fn add(&mut self, unsure: &BandNorms) {
        for norms in [&mut self.remaining, &mut self.light] {
            for (norm, unsure) in norms.iter_mut().zip(unsure) {
                norm.iter_mut().zip(unsure).for_each(|(norm, unsure)| *norm += unsure);
            }
        }
    }
}

/// The largest norms of a row in each band, tile by tile: what the one number needs.
pub struct Bound {
    channels: Channels,
    /// `[tile][band][channel]`: of the stored rows, and of what was dropped.
    tiles: Vec<Vec<(f64, f64)>>,
}

impl Bound {
    /// One pass over the stored norms of all rows, in parallel.
    pub fn new(matrix: &TransportMatrix) -> Bound {
        let a_row = matrix.bands.count() * matrix.channels.count();
        let largest = |norms: &[u16], place: usize| {
            norms.iter().skip(place).step_by(a_row).map(|&norm| f64::from(bf16(norm))).fold(0.0, f64::max)
        };
        let tile = |tile: &Tile| (0..a_row).map(|at| (largest(&tile.kept, at), largest(&tile.dropped, at))).collect();
        Bound { channels: matrix.channels, tiles: matrix.tiles.par_iter().map(tile).collect() }
    }

    /// For each band the largest norm of a stored row, in any channel.
    pub fn largest_rows(&self) -> Vec<f64> {
        let channels = self.channels.count();
        let bands = self.tiles.first().map_or(0, |tile| tile.len() / channels);
        let of = |band: usize| self.tiles.iter().flat_map(move |tile| &tile[band * channels..(band + 1) * channels]);
        (0..bands).map(|band| of(band).fold(0.0, |most, &(kept, _)| f64::max(most, kept))).collect()
    }

    /// No receiver's red, green or blue is further off than this.
    pub fn largest(&self, Measured { remaining, light, .. }: &Measured) -> [f64; 3] {
        let mut largest = [0.0f64; 3];
        for bands in &self.tiles {
            for (colour, largest) in largest.iter_mut().enumerate() {
                let mut bound = 0.0;
                let own = bands.iter().skip(self.channels.of(colour)).step_by(self.channels.count());
                for (band, &(kept, dropped)) in own.enumerate() {
                    let (remaining, light) = (remaining[band][colour], light[band][colour]);
                    // What is shown is at most the response to |V| + |V - V~|.
                    bound += kept * remaining + dropped * light + ROUNDING * kept * (light + remaining);
                }
                *largest = largest.max(above(bound + SMALLEST));
            }
        }
        largest
    }
}

/// The one number for several responses, each with its own, that are added with weights up to those given.
pub fn largest_of_all(all: impl Iterator<Item = ([f64; 3], f64)>) -> [f64; 3] {
    all.fold([0.0; 3], |sum, (largest, weight)| {
        std::array::from_fn(|c| if weight == 1.0 { sum[c] + largest[c] } else { above(sum[c] + weight * largest[c]) })
    })
}

/// A picture beyond what an f32 holds is infinite there, and no bound is true of it but an infinite one.
pub fn with_overflow(bound: [f64; 3], shown: &[f32]) -> [f64; 3] {
    // Rounding alone is this share of the largest value: below it nobody needs to look.
    if bound.iter().all(|&bound| bound < ROUNDING * f64::from(f32::MAX)) {
        return bound;
    }
    std::array::from_fn(|c| {
        let finite = shown.iter().skip(c).step_by(3).all(|value| value.is_finite());
        if finite { bound[c] } else { f64::INFINITY }
    })
}

/// The bound of every row, but for the rounding of what is shown.
pub fn bound_rows(matrix: &TransportMatrix, Measured { remaining, light, .. }: &Measured) -> Vec<[f64; 3]> {
    let (bands, channels) = (matrix.bands.count(), matrix.channels.count());
    let of_row = |(kept, dropped): (&[u16], &[u16])| {
        std::array::from_fn(|colour| {
            let own = (0..bands).map(|band| (band, band * channels + matrix.channels.of(colour)));
            own.fold(0.0, |bound, (band, at)| {
                let bound = bound + f64::from(bf16(kept[at])) * remaining[band][colour];
                bound + f64::from(bf16(dropped[at])) * light[band][colour]
            })
        })
    };
    let norms = |tile: &Tile| -> Vec<[f64; 3]> {
        let a_row = bands * channels;
        tile.kept.chunks_exact(a_row).zip(tile.dropped.chunks_exact(a_row)).map(of_row).collect()
    };
    matrix.tiles.par_iter().flat_map_iter(norms).collect()
}

/// The bound of every receiver for the picture `shown`, rows x 3, into `out` of the same form: `terms(row, add)` adds the
/// bounds of the rows that a receiver's B is made of, each with its weight.
pub fn finish_bounds(shown: &[f32], out: &mut [f32], terms: impl Fn(usize, &mut dyn FnMut([f64; 3], f64)) + Sync) {
    debug_assert!(shown.len() == out.len());
    let rows = out.par_chunks_exact_mut(3).zip(shown.par_chunks_exact(3)).enumerate();
    rows.for_each(|(row, (out, shown))| {
        let mut bound = [SMALLEST; 3];
        terms(row, &mut |of: [f64; 3], weight: f64| (0..3).for_each(|c| bound[c] += weight * of[c]));
        for colour in 0..3 {
            out[colour] = round_up(above(bound[colour] + ROUNDING * f64::from(shown[colour].abs())));
        }
    });
}

/// The least f32 that is not below x.
fn round_up(x: f64) -> f32 {
    let nearest = x as f32;
    if (nearest as f64) < x { nearest.next_up() } else { nearest }
}
