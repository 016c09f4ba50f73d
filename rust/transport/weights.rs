//! Weights by which receivers take from nodes: sparse, and few a row. Those of factors of lobes are of either sign.
//!
//! ```text
//!     B_x = T_x V + sum_n w_xn (I_n V)
//! ```
//!
//! Nothing of it is incremental: it is summed whole and in this order in every frame, so that it is a function of exact
//! sums, and B after any history is that of a fresh product.

use rayon::prelude::*;

use crate::error::{Error, Result};

use super::slab::Slab;

/// In the number of a node: its weight is negative.
pub const NEGATIVE: u32 = 1 << 31;

/// The node that a number names, whatever the sign of its weight.
#[inline(always)]
pub fn named(number: u32) -> usize {
    (number & !NEGATIVE) as usize
}

/// A weight with the sign that the number of its node gives it.
#[inline(always)]
pub fn signed(number: u32, weight: u16) -> f64 {
    // PERF: the highest bit becomes that of the f64, without a branch.
    f64::from_bits(f64::from(weight).to_bits() ^ (u64::from(number & NEGATIVE) << 32))
}

/// `rows` x `nodes` weights, row by row: integers times 2^exponent.
#[derive(Clone)]
pub struct Weights {
    /// Those of row x are `starts[x]..starts[x + 1]`.
    starts: Slab<u32>,
    /// With `NEGATIVE` where the weight is.
    nodes: Slab<u32>,
    weights: Slab<u16>,
    exponent: i32,
    /// The largest sum of the magnitudes of a row.
    largest_sum: f64,
}

impl Weights {
    /// Exponents far from where f64 ends.
    const EXPONENTS: std::ops::RangeInclusive<i32> = -64..=16;

    /// Refuses starts that do not ascend to the number of weights, and nodes from `node_count` on.
    pub fn new(
        starts: Slab<u32>,
        nodes: Slab<u32>,
        weights: Slab<u16>,
        exponent: i32,
        node_count: usize,
    ) -> Result<Self> {
        let ends = (starts.first().copied(), starts.last().map(|&last| last as usize));
        if ends != (Some(0), Some(weights.len())) || starts.windows(2).any(|pair| pair[0] > pair[1]) {
            let count = weights.len();
            return Err(Error::input(format!("expected starts of rows that ascend from 0 to {count}, got {ends:?}")));
        }
        if nodes.len() != weights.len() {
            let (nodes, weights) = (nodes.len(), weights.len());
            return Err(Error::input(format!("expected a node for each of {weights} weights, got {nodes}")));
        }
        if let Some(node) = nodes.iter().map(|&number| named(number)).find(|&node| node >= node_count) {
            return Err(Error::input(format!("expected nodes below {node_count}, found {node}")));
        }
        if !Self::EXPONENTS.contains(&exponent) {
            return Err(Error::input(format!("expected an exponent in {:?}, got {exponent}", Self::EXPONENTS)));
        }
        let sum = |row: &[u32]| weights[row[0] as usize..row[1] as usize].iter().map(|&w| u64::from(w)).sum::<u64>();
        let most = starts.windows(2).map(sum).max().unwrap_or(0);
        let largest_sum = most as f64 * f64::from(exponent).exp2();
        Ok(Weights { starts, nodes, weights, exponent, largest_sum })
    }

    /// Receivers.
    pub fn rows(&self) -> usize {
        self.starts.len() - 1
    }

    /// What the stored integers count: units of 2^exponent.
    pub fn exponent(&self) -> i32 {
        self.exponent
    }

    /// What one unit of weight is.
    pub fn unit(&self) -> f64 {
        f64::from(self.exponent).exp2()
    }

    /// The arrays, as they are stored.
    pub fn arrays(&self) -> (&[u32], &[u32], &[u16]) {
        (&self.starts, &self.nodes, &self.weights)
    }

    /// The nodes of a row and their weights.
    pub fn row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> {
        let range = self.starts[row] as usize..self.starts[row + 1] as usize;
        let unit = self.unit();
        let pairs = self.nodes[range.clone()].iter().zip(&self.weights[range]);
        pairs.map(move |(&number, &weight)| (named(number), signed(number, weight) * unit))
    }

    /// What all rows take of values of nodes.
    pub fn taken(&self, values: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let unit = self.unit();
        let one = |row: usize| {
            let own = self.starts[row] as usize..self.starts[row + 1] as usize;
            let mut sum = [0.0; 3];
            for (&number, &weight) in self.nodes[own.clone()].iter().zip(&self.weights[own]) {
                let (value, weight) = (values[named(number)], signed(number, weight));
                (0..3).for_each(|c| sum[c] += weight * value[c]);
            }
            sum.map(|x| unit * x)
        };
        (0..self.rows()).into_par_iter().with_min_len(256).map(one).collect()
    }

    /// Whether any is negative.
    pub fn any_negative(&self) -> bool {
        self.nodes.iter().any(|number| number & NEGATIVE != 0)
    }

    /// The least number that is above those of all nodes.
    pub fn node_count(&self) -> usize {
        self.nodes.iter().map(|&number| named(number) + 1).max().unwrap_or(0)
    }

    /// The largest sum of the magnitudes of a row.
    pub fn largest_sum(&self) -> f64 {
        self.largest_sum
    }

    /// Bytes of the three arrays.
    pub fn nbytes(&self) -> usize {
        4 * (self.starts.len() + self.nodes.len()) + 2 * self.weights.len()
    }
}
