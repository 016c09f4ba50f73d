//! How far the response shown can be from the untruncated product: guaranteed, per receiver and as one number.
//!
//! With T the true transport, T' the stored one, V the light and V~ what has been applied of it,
//!
//! ```text
//!     T V - T' V~ = T' (V - V~) + (T - T') V,
//! ```
//!
//! so that by Cauchy-Schwarz in each band b (NUMERICS 2c, eq. 2)
//!
//! ```text
//!     |B - B~|_i <= sum_b |T'_i,b| |(V - V~)_b| + sum_b |(T - T')_i,b| |V_b| + 2^-24 |B~_i|,
//! ```
//!
//! the last for rounding B~ to f32. V is the light before it was rounded to the grid: that error is thereby included.

use rayon::prelude::*;

use crate::basis::Bands;
use crate::transport::{Tile, TransportMatrix};

use super::grid::{above, norm_of_squares, norm_value, squares};

/// For each band and colour a norm of coefficients, never below the true one.
pub type BandNorms = Vec<[f64; 3]>;

/// Half a unit in the last place of an f32, relative; and of the smallest, absolute.
const ROUNDING: f64 = 1.0 / (1u64 << 24) as f64;
const SMALLEST: f64 = f32::MIN_POSITIVE as f64 * ROUNDING;

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

/// The largest norms of a row in each band, tile by tile: what the one number needs.
pub struct Bound {
    /// `[tile][band]`: of the stored rows, and of what was dropped.
    tiles: Vec<Vec<(f64, f64)>>,
}

impl Bound {
    pub fn new(matrix: &TransportMatrix) -> Bound {
        let bands = matrix.bands.count();
        let largest = |norms: &[u16], band: usize| {
            norms.iter().skip(band).step_by(bands).map(|&norm| norm_value(norm)).fold(0.0, f64::max)
        };
        let tile =
            |tile: &Tile| (0..bands).map(|band| (largest(&tile.kept, band), largest(&tile.dropped, band))).collect();
        Bound { tiles: matrix.tiles.par_iter().map(tile).collect() }
    }

    /// No receiver's red, green or blue is further off than this.
    pub fn largest(&self, Measured { remaining, light, .. }: &Measured) -> [f64; 3] {
        let mut largest = [0.0f64; 3];
        for bands in &self.tiles {
            for (colour, largest) in largest.iter_mut().enumerate() {
                let mut bound = 0.0;
                for (band, &(kept, dropped)) in bands.iter().enumerate() {
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

/// The bound of every receiver for the picture `shown`, rows x 3, into `out` of the same form.
pub fn bound_rows(matrix: &TransportMatrix, measured: &Measured, shown: &[f32], out: &mut [f32]) {
    let Measured { remaining, light, .. } = measured;
    debug_assert!(shown.len() == 3 * matrix.rows && out.len() == shown.len());
    let bands = matrix.bands.count();
    let rows = 3 * matrix.tile_rows.max(1);
    matrix.tiles.par_iter().zip(shown.par_chunks(rows)).zip(out.par_chunks_mut(rows)).for_each(
        |((tile, shown), out)| {
            let norms = tile.kept.chunks_exact(bands).zip(tile.dropped.chunks_exact(bands));
            for ((kept, dropped), (shown, out)) in norms.zip(shown.chunks_exact(3).zip(out.chunks_exact_mut(3))) {
                for colour in 0..3 {
                    let mut bound = ROUNDING * shown[colour].abs() as f64 + SMALLEST;
                    for band in 0..bands {
                        bound += norm_value(kept[band]) * remaining[band][colour];
                        bound += norm_value(dropped[band]) * light[band][colour];
                    }
                    out[colour] = round_up(above(bound));
                }
            }
        },
    );
}

/// The least f32 that is not below x.
fn round_up(x: f64) -> f32 {
    let nearest = x as f32;
    if (nearest as f64) < x { nearest.next_up() } else { nearest }
}
