//! The transpose of a matrix times a number for each row, M^T R: how much each column has to do with them.
//!
//! Columns of M are as long as there are rows: a grid that leaves room for the norm of a column in 53 bits (`grid.rs`) would
//! leave R few. So R alone says what its grid is, 2^-34 of its largest number, and sums are of whole numbers in 128 bits
//! (`kernel/transposed.rs`). They are exact in any order, and rounded to f64 once: M^T R is the transpose of the product, bit
//! for bit, wherever R lies on its grid and the result has no more bits than f64.

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::transport::weights::{Weights, named, signed};
use crate::transport::{GROUP, TransportMatrix};

use super::grid::{SPACINGS, exponent_above, power_of_two, round};
use super::kernel::Sums;
use super::kernel::transposed::{Numbers, Totals, add, parts};

/// Bits of the largest number: with the 15 of an entry's integers and the 4 of its rows, an f64 is full.
const BITS: i32 = 34;
/// Columns that one thread takes at a time.
const COLUMNS: usize = 256;
/// Receivers whose weights one thread passes on at a time.
const ROWS: usize = 4096;

/// R on its grid, group by group.
pub(in crate::update) struct Gridded {
    /// A number is whole times 2^exponent.
    exponent: i32,
    groups: Vec<Sums>,
}

impl Gridded {
    /// Refuses what is not finite, and sizes far beyond any light.
    pub fn new(rows: &[[f64; 3]]) -> Result<Gridded> {
        let (numbers, limit) = (rows.as_flattened(), power_of_two(*SPACINGS.end()));
        // What is not a number is below nothing.
        if !numbers.iter().all(|x| x.abs() < limit) {
            return Err(Error::input("expected finite numbers of sane size for the rows"));
        }
        let largest = numbers.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        let exponent = exponent_above(largest) - BITS;
        let units = power_of_two(-exponent);
        let group = |rows: &[[f64; 3]]| {
            let mut lanes = Sums::ZERO;
            for (lane, row) in rows.iter().enumerate() {
                (0..3).for_each(|c| lanes.0[c][lane] = round(row[c] * units));
            }
            lanes
        };
        Ok(Gridded { exponent, groups: rows.par_chunks(GROUP).map(group).collect() })
    }

    fn row(&self, row: usize) -> [f64; 3] {
        self.groups[row / GROUP].0.map(|lanes| lanes[row % GROUP])
    }
}

/// M^T R, of a matrix of as many rows: one triple a column, of texels only where they are asked for.
pub(in crate::update) fn adjoint(matrix: &TransportMatrix, r: &Gridded, texels: bool) -> Vec<[f64; 3]> {
    let columns = if texels { matrix.bands.columns() } else { matrix.bands.stored() };
    let [high, low] = if columns > matrix.bands.stored() { parts(&r.groups) } else { [Vec::new(), Vec::new()] };
    let mut totals = vec![[0; 3]; columns];
    let a_tile = (matrix.tile_rows / GROUP).max(1);
    totals.par_chunks_mut(COLUMNS).enumerate().for_each(|(chunk, totals)| {
        let columns = chunk * COLUMNS..chunk * COLUMNS + totals.len();
        for (number, tile) in matrix.tiles.iter().enumerate() {
            let own = number * a_tile..number * a_tile + tile.groups();
            let parts = [&high, &low].map(|part| part.get(own.clone()).unwrap_or_default());
            let numbers = Numbers { whole: &r.groups[own], parts };
            add(tile, columns.clone(), numbers, totals);
        }
    });
    rounded(&totals, matrix.quantum + r.exponent)
}

/// W^T R: what so many nodes are to the receivers that take from them.
pub(in crate::update) fn given(weights: &Weights, nodes: usize, r: &Gridded) -> Vec<[f64; 3]> {
    let (starts, from, by) = weights.arrays();
    let of_rows = |first: usize| {
        let mut totals = vec![[0; 3]; nodes];
        for row in first..weights.rows().min(first + ROWS) {
            let (own, numbers) = (starts[row] as usize..starts[row + 1] as usize, r.row(row));
            for (&number, &weight) in from[own.clone()].iter().zip(&by[own]) {
                let total: &mut Totals = &mut totals[named(number)];
                (0..3).for_each(|c| total[c] += i128::from((signed(number, weight) * numbers[c]) as i64));
            }
        }
        totals
    };
    let both = |mut a: Vec<Totals>, b: Vec<Totals>| {
        a.as_flattened_mut().iter_mut().zip(b.as_flattened()).for_each(|(a, b)| *a += b);
        a
    };
    let parts = (0..weights.rows()).into_par_iter().step_by(ROWS).map(of_rows);
    rounded(&parts.reduce(|| vec![[0; 3]; nodes], both), weights.exponent() + r.exponent)
}

fn rounded(totals: &[Totals], exponent: i32) -> Vec<[f64; 3]> {
    let unit = power_of_two(exponent);
    totals.iter().map(|total| total.map(|sum| sum as f64 * unit)).collect()
}
