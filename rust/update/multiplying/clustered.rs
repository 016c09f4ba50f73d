//! The bound of clustered transport, whose two stages are known as one.
//!
//! With t a receiver's true row, w its weights, R the stored representatives, V the light, V~ what has been applied of it,
//! P = R V~ (exact) and P~ what the second stage has applied of P,
//!
//! ```text
//!     t V - w P~ = (t - w R) V + w R (V - V~) + w (P - P~),
//! ```
//!
//! so that by Cauchy-Schwarz, in each band b of the light and in each cluster c that the row takes from,
//!
//! ```text
//!     |B - B~| <= sum_b |t - w R|_b |V_b| + sum_b |w R|_b |(V - V~)_b| + sum_c |w_c| |(P - P~)_c| + 2^-24 |B~|.
//! ```
//!
//! What clustering and truncation lose stands in the first sum, with the norms of whole rows (`transport/row_norms.rs`): norms
//! of the two stages one after the other would count the representatives of all clusters against every row.

use std::collections::BTreeMap;

use crate::basis::ColumnSpace;
use crate::transport::entry::{Channels, GROUP, bf16};
use crate::transport::{RowNorms, Tile, TransportMatrix};

use super::bound::{Measured, ROUNDING, SMALLEST};
use super::grid::above;

/// What a bound needs to know of the rows of two stages.
pub struct Clustered {
    clusters: usize,
    norms: RowNorms,
    /// For each row the clusters that it takes from, each with the norm of its weights in the channel where that is largest.
    starts: Vec<u32>,
    taken: Vec<(u32, f32)>,
    /// Of rows that take from the same clusters, the largest norms.
    profiles: Vec<Profile>,
}

/// What is not above the norms of some rows that take from the same clusters.
struct Profile {
    clusters: Vec<(u32, f64)>,
    /// `[band][channel]`: what is kept, and what is off.
    norms: Vec<(f64, f64)>,
}

impl Clustered {
    /// Looks once through the weights of all rows, which are `then`.
    pub fn new(then: &TransportMatrix, norms: &RowNorms) -> Clustered {
        let ColumnSpace::Representatives { clusters, .. } = then.space else { unreachable!("the product is checked") };
        let rows = then.tiles.iter().flat_map(|tile| rows_of(then, tile));
        let (mut starts, mut taken, mut profiles) = (vec![0u32], Vec::new(), BTreeMap::new());
        for (row, own) in rows.enumerate() {
            let key: Vec<u32> = own.iter().map(|&(cluster, _)| cluster).collect();
            let (kept, dropped) = norms.row(row);
            let profile = profiles.entry(key).or_insert_with(|| Profile {
                clusters: own.iter().map(|&(cluster, _)| (cluster, 0.0)).collect(),
                norms: vec![(0.0, 0.0); kept.len()],
            });
            profile.clusters.iter_mut().zip(&own).for_each(|(most, own)| most.1 = most.1.max(f64::from(own.1)));
            for (most, (&kept, &dropped)) in profile.norms.iter_mut().zip(kept.iter().zip(dropped)) {
                *most = (most.0.max(f64::from(bf16(kept))), most.1.max(f64::from(bf16(dropped))));
            }
            taken.extend(own);
            starts.push(taken.len() as u32);
        }
        let profiles = profiles.into_values().collect();
        Clustered { clusters, norms: norms.clone(), starts, taken, profiles }
    }

    /// How many there are.
    pub fn clusters(&self) -> usize {
        self.clusters
    }

    /// For each cluster the norm of P - P~ in each colour: `light` is P, `applied` P~.
    pub fn unsent(&self, light: &[[f64; 3]], applied: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let square = |light: &[f64; 3], applied: &[f64; 3]| std::array::from_fn(|c| (light[c] - applied[c]).powi(2));
        // The means, and then as many representatives of each cluster: PERF: a column need not be asked where it belongs.
        let (means, rest) = light.split_at(self.clusters);
        let mut squares: Vec<[f64; 3]> =
            means.iter().zip(applied).map(|(light, applied)| square(light, applied)).collect();
        let each = (rest.len() / self.clusters).max(1);
        let own = rest.chunks(each).zip(applied[self.clusters..].chunks(each));
        for (sums, (light, applied)) in squares.iter_mut().zip(own) {
            for square in light.iter().zip(applied).map(|(light, applied)| square(light, applied)) {
                (0..3).for_each(|c| sums[c] += square[c]);
            }
        }
        squares.into_iter().map(|sums| sums.map(|square: f64| above(square.sqrt()))).collect()
    }

    /// For each band of the light the largest norm of a row, in any channel.
    pub fn largest_rows(&self) -> Vec<f64> {
        let (bands, channels) = self.norms.shape();
        let of = |profile: &Profile, band: usize| {
            let own = &profile.norms[band * channels.count()..(band + 1) * channels.count()];
            own.iter().fold(0.0, |most: f64, &(kept, _)| most.max(kept))
        };
        (0..bands)
            .map(|band| self.profiles.iter().fold(0.0, |most: f64, profile| most.max(of(profile, band))))
            .collect()
    }

    /// No receiver's red, green or blue is further off than this.
    pub fn largest(&self, Measured { remaining, light, .. }: &Measured, unsent: &[[f64; 3]]) -> [f64; 3] {
        let channels = self.norms.shape().1;
        std::array::from_fn(|colour| {
            let of = |profile: &Profile| {
                let own = profile.norms.iter().skip(channels.of(colour)).step_by(channels.count());
                let bands = own.zip(remaining.iter().zip(light)).map(|(&(kept, dropped), (remaining, light))| {
                    let (remaining, light) = (remaining[colour], light[colour]);
                    // What is shown is at most the response to |V| + |V - V~|, and what is unsent of P.
                    kept * remaining + dropped * light + ROUNDING * kept * (light + remaining)
                });
                let taken = profile.clusters.iter().map(|&(cluster, norm)| norm * unsent[cluster as usize][colour]);
                above(bands.sum::<f64>() + (1.0 + ROUNDING) * taken.sum::<f64>() + SMALLEST)
            };
            self.profiles.iter().map(of).fold(0.0, f64::max)
        })
    }

    /// The bound of every row, but for the rounding of what is shown.
    pub fn rows(&self, Measured { remaining, light, .. }: &Measured, unsent: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let (bands, channels) = self.norms.shape();
        let of_row = |row: usize, colour: usize| {
            let (kept, dropped) = self.norms.row(row);
            let bands = (0..bands).map(|band| {
                let at = band * channels.count() + channels.of(colour);
                f64::from(bf16(kept[at])) * remaining[band][colour] + f64::from(bf16(dropped[at])) * light[band][colour]
            });
            let own = &self.taken[self.starts[row] as usize..self.starts[row + 1] as usize];
            let taken = own.iter().map(|&(cluster, norm)| f64::from(norm) * unsent[cluster as usize][colour]);
            bands.sum::<f64>() + taken.sum::<f64>()
        };
        (0..self.norms.rows()).map(|row| std::array::from_fn(|colour| of_row(row, colour))).collect()
    }
}

/// For each row of a tile the clusters that it takes from, ascending, and the norms of its weights there, rounded up.
fn rows_of(then: &TransportMatrix, tile: &Tile) -> Vec<Vec<(u32, f32)>> {
    let (starts, entries) = tile.by_group();
    let channels: &[usize] = if tile.channels == Channels::One { &[0] } else { &[0, 1, 2] };
    let mut rows = Vec::with_capacity(tile.rows);
    for range in starts.windows(2) {
        let mut squares: BTreeMap<u32, [[f64; GROUP]; 3]> = BTreeMap::new();
        for &(column, entry) in &entries[range[0] as usize..range[1] as usize] {
            let sums = squares.entry(then.space.cluster_of(column as usize) as u32).or_default();
            for &channel in channels {
                let lanes = tile.lanes(entry as usize, channel, then.quantum);
                sums[channel].iter_mut().zip(lanes).for_each(|(sum, weight)| *sum += f64::from(weight).powi(2));
            }
        }
        for lane in 0..GROUP.min(tile.rows - rows.len()) {
            let norm = |sums: &[[f64; GROUP]; 3]| above(sums.iter().fold(0.0, |most, own| own[lane].max(most)).sqrt());
            let own = squares.iter().map(|(&cluster, sums)| (cluster, (norm(sums) as f32).next_up()));
            // The least positive number is the next of a norm of nothing.
            rows.push(own.filter(|&(_, norm)| norm > f32::from_bits(1)).collect());
        }
    }
    rows
}
