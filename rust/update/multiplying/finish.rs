//! From exact sums to B: as they are, mixed by row, or with what nodes add. Each sums in a fixed order in f64 and rounds
//! once, so that B is a function of the sums and nothing else.

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::transport::weights::{Weights, named, signed};
use crate::transport::{GROUP, TransportMatrix};
use crate::twice::compiled_twice;

use super::kernel::Sums;

/// The exact sums of a matrix's rows, tile by tile, group by group.
pub(in crate::update) type Tiles = [Vec<Sums>];

/// What B is rounded to, once.
pub trait Rounded: Copy + Send {
    /// The nearest number of this kind.
    fn rounded(sum: f64) -> Self;
}

impl Rounded for f32 {
    #[inline(always)]
    fn rounded(sum: f64) -> f32 {
        sum as f32
    }
}

impl Rounded for f64 {
    #[inline(always)]
    fn rounded(sum: f64) -> f64 {
        sum
    }
}

/// How the K responses of a receiver make one: rows x K weights, or K that are all rows'.
///
/// Changing it changes no response: another view of a glossy scene, or another BRDF of a family, costs a mix.
#[derive(Clone, Debug, PartialEq)]
pub struct Mix {
    rows: usize,
    factors: usize,
    /// Of each row, or of all alike.
    weights: Vec<f32>,
    /// For each factor the largest magnitude of a weight.
    largest: Vec<f64>,
}

impl Mix {
    /// From finite weights, row by row.
    pub fn new(weights: Vec<f32>, factors: usize) -> Result<Self> {
        if factors == 0 || !weights.len().is_multiple_of(factors) {
            let count = weights.len();
            return Err(Error::input(format!("expected {factors} weights a row, got {count} in all")));
        }
        Mix::checked(weights.len() / factors, factors, weights)
    }

    /// The same finite weights for all rows.
    pub fn alike(weights: Vec<f32>, rows: usize) -> Result<Self> {
        if weights.is_empty() {
            return Err(Error::input("expected weights of factors, got none"));
        }
        Mix::checked(rows, weights.len(), weights)
    }

    fn checked(rows: usize, factors: usize, weights: Vec<f32>) -> Result<Self> {
        if let Some(weight) = weights.iter().find(|weight| !weight.is_finite()) {
            return Err(Error::input(format!("expected finite weights, got {weight}")));
        }
        let of = |factor: usize| weights.iter().skip(factor).step_by(factors).map(|weight| f64::from(weight.abs()));
        let largest = (0..factors).map(|factor| of(factor).fold(0.0, f64::max)).collect();
        Ok(Mix { rows, factors, weights, largest })
    }

    /// (rows, factors)
    pub fn shape(&self) -> (usize, usize) {
        (self.rows, self.factors)
    }

    /// For each factor the largest magnitude of a weight.
    pub fn largest(&self) -> &[f64] {
        &self.largest
    }

    /// The weights of a row.
    pub fn row(&self, row: usize) -> &[f32] {
        if self.weights.len() == self.factors {
            return &self.weights;
        }
        &self.weights[row * self.factors..(row + 1) * self.factors]
    }

    /// R as the `factor`-th response takes part in it: each row times its weight.
    pub(in crate::update) fn share(&self, factor: usize, r: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let weighted = |(row, r): (usize, &[f64; 3])| r.map(|x| f64::from(self.row(row)[factor]) * x);
        r.iter().enumerate().map(weighted).collect()
    }

    /// B_x = sum_k weight_xk B_k,x.
    pub(in crate::update) fn write<T: Rounded>(&self, matrix: &TransportMatrix, responses: &[&Tiles], out: &mut [T]) {
        each_row(matrix, out, |tile, row, within| {
            let mut sum = [0.0; 3];
            for (response, &weight) in responses.iter().zip(self.row(row)) {
                let lanes = &response[tile][within / GROUP].0;
                (0..3).for_each(|c| sum[c] += f64::from(weight) * lanes[c][within % GROUP]);
            }
            sum
        });
    }
}

/// B as it is.
pub(in crate::update) fn write<T: Rounded>(matrix: &TransportMatrix, response: &Tiles, out: &mut [T]) {
    each_row(matrix, out, |tile, _, within| at(&response[tile], within));
}

/// The nodes' response.
#[derive(Clone, Copy)]
pub(in crate::update) struct Node<'a> {
    /// The exact sums of all nodes.
    pub response: &'a Tiles,
    /// Nodes of every tile but the last.
    pub tile_rows: usize,
}

/// B_x = B_x + sum_n w_xn B_n.
pub(in crate::update) fn add_nodes<T: Rounded>(
    matrix: &TransportMatrix,
    receivers: &Tiles,
    weights: &Weights,
    nodes: Node,
    out: &mut [T],
) {
    // PERF: one node after the other, and a lane more than there are colours: a node is one load.
    let rows: usize = nodes.response.iter().map(|sums| GROUP * sums.len()).sum();
    let mut values = vec![[0.0; 4]; rows.next_multiple_of(nodes.tile_rows)];
    for (values, sums) in values.chunks_mut(nodes.tile_rows).zip(nodes.response) {
        for (values, Sums([red, green, blue])) in values.chunks_mut(GROUP).zip(sums) {
            for (lane, value) in values.iter_mut().enumerate() {
                *value = [red[lane], green[lane], blue[lane], 0.0];
            }
        }
    }
    let tiles = out.par_chunks_mut(3 * matrix.tile_rows.max(1)).zip(receivers).enumerate();
    tiles.for_each(|(tile, (rows, sums))| add_to_tile(tile * matrix.tile_rows, sums, weights, &values, rows));
}

compiled_twice! {
    /// The rows of a tile, from row `first` on.
    fn add_to_tile[T: Rounded](first: usize, sums: &[Sums], weights: &Weights, values: &[[f64; 4]], rows: &mut [T])
        = add_to_tile_any;
}

#[inline(always)]
fn add_to_tile_any<T: Rounded>(first: usize, sums: &[Sums], weights: &Weights, values: &[[f64; 4]], rows: &mut [T]) {
    let ((starts, from, by), unit) = (weights.arrays(), weights.unit());
    for ((rows, sums), first) in rows.chunks_mut(3 * GROUP).zip(sums).zip((first..).step_by(GROUP)) {
        for (lane, row) in rows.chunks_exact_mut(3).enumerate() {
            let own = starts[first + lane] as usize..starts[first + lane + 1] as usize;
            let mut taken = [0.0; 4];
            for (&number, &weight) in from[own.clone()].iter().zip(&by[own]) {
                let (value, weight) = (&values[named(number)], signed(number, weight));
                (0..4).for_each(|c| taken[c] += weight * value[c]);
            }
            (0..3).for_each(|c| row[c] = T::rounded(sums.0[c][lane] + unit * taken[c]));
        }
    }
}

/// The sums of one row of a tile.
fn at(groups: &[Sums], row: usize) -> [f64; 3] {
    groups[row / GROUP].0.map(|lanes: [f64; GROUP]| lanes[row % GROUP])
}

/// Writes `sum(tile, row, row within the tile)` of every row, rounded once.
fn each_row<T: Rounded>(matrix: &TransportMatrix, out: &mut [T], sum: impl Fn(usize, usize, usize) -> [f64; 3] + Sync) {
    out.par_chunks_mut(3 * matrix.tile_rows.max(1)).enumerate().for_each(|(tile, rows)| {
        for (within, row) in rows.chunks_exact_mut(3).enumerate() {
            let sum = sum(tile, tile * matrix.tile_rows + within, within);
            row.iter_mut().zip(sum).for_each(|(value, sum)| *value = T::rounded(sum));
        }
    });
}
