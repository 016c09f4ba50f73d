//! Freezing: several matrices of the same rows and columns, each times a number, become one that is shorter than they are.
//!
//! ```text
//!     T = sum_k c_k T_k                  (Nguyen 2010, section 6: an object that is not edited keeps one matrix)
//! ```
//!
//! Rows are added group by group in f64 and truncated once, by a threshold or as many entries as are asked for in the mean.
//! What a row lost before, times |c_k|, is in what it has lost. Freezing again starts from the T_k, never from a frozen T.

use std::sync::Arc;

use rayon::prelude::*;

use crate::error::{Error, Result};

use super::entry::{Channels, GROUP, Rows16, bf16, bf16_up};
use super::matrix::TransportMatrix;
use super::product::Factors;
use super::tile::{CompressedGroup, Tile};
use super::truncate::{Truncation, compress_group};

/// The sum of all factors, each times its number.
pub fn freeze(factors: &Factors, numbers: &[f64], rule: &Truncation) -> Result<TransportMatrix> {
    let first = factors.first();
    if numbers.len() != factors.count() || !numbers.iter().all(|number| number.is_finite()) {
        let (expected, found) = (factors.count(), numbers.len());
        return Err(Error::input(format!("expected {expected} finite numbers, one a matrix, got {found}")));
    }
    let plain = |matrix: &Arc<TransportMatrix>| matrix.channels == Channels::One && matrix.bands.texels == 0;
    let alike = |matrix: &Arc<TransportMatrix>| (matrix.rows, matrix.tile_rows) == (first.rows, first.tile_rows);
    if !factors.iter().all(|matrix| plain(matrix) && alike(matrix)) {
        return Err(Error::input("expected matrices of one channel and the same rows, without texels, to freeze"));
    }
    let of_tile = |number: usize| -> Result<Tile> {
        let tiles: Vec<(&Tile, i32)> = factors.iter().map(|matrix| (&matrix.tiles[number], matrix.quantum)).collect();
        let by_group: Vec<_> = tiles.iter().map(|(tile, _)| tile.by_group()).collect();
        let groups = (0..tiles[0].0.groups()).into_par_iter().map_init(
            || Sum::new(first.bands.columns()),
            |sum, group| {
                for (((tile, quantum), (starts, entries)), &c) in tiles.iter().zip(&by_group).zip(numbers) {
                    let own = &entries[starts[group] as usize..starts[group + 1] as usize];
                    own.iter().for_each(|&(column, entry)| {
                        sum.add(column as usize, &tile.lanes(entry as usize, 0, *quantum), c);
                    });
                }
                let mut out = CompressedGroup::default();
                compress_group(&[sum.rounded()], &first.bands, rule, 0.0, &mut out)?;
                let norms = GROUP * first.bands.count();
                for (at, lost) in out.dropped.iter_mut().enumerate() {
                    let before: f64 = tiles
                        .iter()
                        .zip(numbers)
                        .map(|((tile, _), c)| {
                            c.abs() * f64::from(tile.dropped.get(group * norms + at).map_or(0.0, |&norm| bf16(norm)))
                        })
                        .sum();
                    *lost = bf16_up(f64::from(bf16(*lost)) + before);
                }
                sum.clear();
                Ok(out)
            },
        );
        let groups = groups.collect::<Result<Vec<_>>>()?;
        let rows = tiles[0].0.rows;
        Ok(Tile::assemble(rows, first.bands.columns(), Channels::One, (rule.width, rule.quantum), &groups))
    };
    let tiles = (0..first.tiles.len()).map(of_tile).collect::<Result<_>>()?;
    Ok(TransportMatrix {
        space: first.space,
        bands: first.bands.clone(),
        rows: first.rows,
        channels: Channels::One,
        quantum: rule.quantum,
        tile_rows: first.tile_rows,
        tiles,
    })
}

/// 16 rows as they add up, and which of their columns are touched.
struct Sum {
    wide: Vec<[f64; GROUP]>,
    rounded: Vec<Rows16>,
    touched: Vec<u32>,
}

impl Sum {
    fn new(columns: usize) -> Sum {
        Sum { wide: vec![[0.0; GROUP]; columns], rounded: vec![[0.0; GROUP]; columns], touched: Vec::new() }
    }

    #[inline]
    fn add(&mut self, column: usize, lanes: &Rows16, number: f64) {
        let sum = &mut self.wide[column];
        (0..GROUP).for_each(|lane| sum[lane] += number * f64::from(lanes[lane]));
        self.touched.push(column as u32);
    }

    fn rounded(&mut self) -> &[Rows16] {
        for &column in &self.touched {
            self.rounded[column as usize] = self.wide[column as usize].map(|x| x as f32);
        }
        &self.rounded
    }

    fn clear(&mut self) {
        for column in self.touched.drain(..) {
            self.wide[column as usize] = [0.0; GROUP];
            self.rounded[column as usize] = [0.0; GROUP];
        }
    }
}
