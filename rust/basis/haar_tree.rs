//! Haar wavelets over a balanced binary tree of surface samples, orthonormal under their areas.
//!
//! Leaves lie in the order of the tree, padded to a power of two with leaves of no area. A leaf's coefficient is its value
//! times the root of its area; a pair whose parts cover the areas a0 and a1 is turned by (Nguyen 2010 with the areas in
//! the basis, not in the rows)
//!
//! ```text
//!     s = p x0 + q x1,   d = q x0 - p x1,   p = sqrt(a0 / (a0 + a1)),  q = sqrt(a1 / (a0 + a1))
//! ```
//!
//! so that a constant is one coefficient, and the squares of coefficients sum to the integral of the square. Columns run
//! from the scaling function to the finest wavelets, as `ColumnSpace::Tree` says.

use crate::error::{Error, Result};

use super::bands::ColumnSpace;

/// The transform over one tree.
#[derive(Clone, Debug, PartialEq)]
pub struct HaarTree {
    /// Of the samples, in the order of the tree, without padding.
    areas: Vec<f64>,
    /// `turns[l]` holds (p, q) of the 2^l pairs of level l; level 0 is the coarsest.
    turns: Vec<Vec<[f64; 2]>>,
}

impl HaarTree {
    /// From the areas of the samples, in the order of the tree. They are not negative, and not all zero.
    pub fn new(areas: Vec<f64>) -> Result<Self> {
        if let Some(area) = areas.iter().find(|area| !(area.is_finite() && **area >= 0.0)) {
            return Err(Error::input(format!("expected areas of samples >= 0, found {area}")));
        }
        let space = ColumnSpace::tree(areas.len())?;
        let mut level = areas.clone();
        level.resize(space.columns(), 0.0);
        let mut turns = Vec::new();
        while level.len() > 1 {
            let pairs = level.chunks_exact(2);
            turns.push(pairs.clone().map(|pair| turn(pair[0], pair[1])).collect());
            level = pairs.map(|pair| pair[0] + pair[1]).collect();
        }
        if level[0] == 0.0 {
            return Err(Error::input("expected samples with an area, found none"));
        }
        turns.reverse();
        Ok(HaarTree { areas, turns })
    }

    /// What its columns are.
    pub fn space(&self) -> ColumnSpace {
        ColumnSpace::Tree { samples: self.areas.len() }
    }

    /// The areas of the samples in the order of the tree, without padding.
    pub fn areas(&self) -> &[f64] {
        &self.areas
    }

    /// The coefficients of the samples' values: one colour a sample in, one a column out.
    pub fn forward(&self, values: &[[f64; 3]]) -> Vec<[f64; 3]> {
        assert_eq!(values.len(), self.areas.len());
        let weigh = |(value, area): (&[f64; 3], &f64)| value.map(|x| x * area.sqrt());
        let mut scaling: Vec<[f64; 3]> = values.iter().zip(&self.areas).map(weigh).collect();
        scaling.resize(self.space().columns(), [0.0; 3]);
        let mut coefficients = scaling.clone();
        for (level, turns) in self.turns.iter().enumerate().rev() {
            // The wavelets of level l are columns 2^l to 2^(l + 1).
            let wavelets = &mut coefficients[1 << level..2 << level];
            for (k, ([p, q], wavelet)) in turns.iter().zip(wavelets).enumerate() {
                let [x0, x1] = [scaling[2 * k], scaling[2 * k + 1]];
                scaling[k] = std::array::from_fn(|c| p * x0[c] + q * x1[c]);
                *wavelet = std::array::from_fn(|c| q * x0[c] - p * x1[c]);
            }
        }
        coefficients[0] = scaling[0];
        coefficients
    }

    /// The transpose of `forward`: a number for each column in, one for each sample out.
    pub fn backward(&self, coefficients: &[[f64; 3]]) -> Vec<[f64; 3]> {
        assert_eq!(coefficients.len(), self.space().columns());
        let mut scaling = vec![coefficients[0]];
        for (level, turns) in self.turns.iter().enumerate() {
            let wavelets = &coefficients[1 << level..2 << level];
            // A turn is its own transpose.
            let pairs = turns.iter().zip(scaling.iter().zip(wavelets)).flat_map(|([p, q], (s, d))| {
                let part = |a: f64, b: f64| std::array::from_fn(|c| a * s[c] + b * d[c]);
                [part(*p, *q), part(*q, -*p)]
            });
            scaling = pairs.collect();
        }
        scaling.iter().zip(&self.areas).map(|(value, area)| value.map(|x| x * area.sqrt())).collect()
    }

    /// Of `N` rows at once, what they take of each sample: its coefficients, so that their product with those of values is the
    /// sum over samples. `rows` has a place for each sample, `out` one for each column.
    pub fn project<const N: usize>(&self, rows: &[[f32; N]], out: &mut [[f32; N]]) {
        assert!(rows.len() == self.areas.len() && out.len() == self.space().columns());
        for ((out, row), area) in out.iter_mut().zip(rows).zip(&self.areas) {
            let weight = if *area > 0.0 { (1.0 / area.sqrt()) as f32 } else { 0.0 };
            for lane in 0..N {
                out[lane] = row[lane] * weight;
            }
        }
        out[self.areas.len()..].fill([0.0; N]);
        let mut wavelets = vec![[0.0; N]; out.len() / 2];
        for (level, turns) in self.turns.iter().enumerate().rev() {
            let count = 1 << level;
            for (k, (turn, wavelet)) in turns.iter().zip(&mut wavelets).enumerate() {
                let (p, q) = (turn[0] as f32, turn[1] as f32);
                let (x0, x1) = (out[2 * k], out[2 * k + 1]);
                for lane in 0..N {
                    out[k][lane] = p * x0[lane] + q * x1[lane];
                    wavelet[lane] = q * x0[lane] - p * x1[lane];
                }
            }
            out[count..2 * count].copy_from_slice(&wavelets[..count]);
        }
    }
}

/// (p, q) of a pair; of two leaves without area the first passes through.
fn turn(a0: f64, a1: f64) -> [f64; 2] {
    let both = a0 + a1;
    if both > 0.0 { [(a0 / both).sqrt(), (a1 / both).sqrt()] } else { [1.0, 0.0] }
}
