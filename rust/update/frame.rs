//! What choosing looks at in one frame: where the light is, where our copy of it is, and the key of every candidate.

use std::ops::Range;

use crate::basis::Bands;

use super::approximation::{Channels, Norm};

/// One frame's light against the values applied so far.
pub(super) struct Frame<'a> {
    pub bands: &'a Bands,
    pub channels: Channels,
    pub weights: &'a [f64],
    /// One a column, or empty: then a column costs nothing.
    pub costs: &'a [f64],
    /// L^new and L~ of Overbeck 2006, Fig. 6.1.
    pub target: &'a [[f64; 3]],
    pub values: &'a [[f64; 3]],
    pub scratch: &'a Keys,
}

/// The keys of all candidates, for both ways a band may be updated. Kept between frames to spare the allocation.
#[derive(Clone, Default)]
pub(super) struct Keys {
    /// weight * |L^new - L~|
    incremental: Vec<f64>,
    /// weight * |L^new|
    anew: Vec<f64>,
}

/// weight * magnitude, but never zero where there is a change: a column of weight zero is sent last, not never.
#[inline(always)]
fn key(weight: f64, magnitude: f64) -> f64 {
    let least = if magnitude < f64::MIN_POSITIVE { magnitude } else { f64::MIN_POSITIVE };
    let key = weight * magnitude;
    if key > least { key } else { least }
}

impl Keys {
    /// Computes all keys in one pass over both vectors.
    pub fn measure(&mut self, channels: Channels, weights: &[f64], target: &[[f64; 3]], values: &[[f64; 3]]) {
        let count = target.len() * channels.lanes();
        self.incremental.resize(count, 0.0);
        self.anew.resize(count, 0.0);
        let light = weights.iter().zip(target.iter().zip(values));
        match channels {
            Channels::Joint => {
                let keys = self.incremental.iter_mut().zip(&mut self.anew);
                for ((incremental, anew), (&weight, (new, old))) in keys.zip(light) {
                    let change = (new[0] - old[0]).abs() + (new[1] - old[1]).abs() + (new[2] - old[2]).abs();
                    *incremental = key(weight, change);
                    *anew = key(weight, new[0].abs() + new[1].abs() + new[2].abs());
                }
            }
            Channels::Separate => {
                let keys = self.incremental.chunks_exact_mut(3).zip(self.anew.chunks_exact_mut(3));
                for ((incremental, anew), (&weight, (new, old))) in keys.zip(light) {
                    for colour in 0..3 {
                        incremental[colour] = key(weight, (new[colour] - old[colour]).abs());
                        anew[colour] = key(weight, new[colour].abs());
                    }
                }
            }
        }
    }
}

impl Frame<'_> {
    pub fn candidates(&self) -> usize {
        self.target.len() * self.channels.lanes()
    }

    /// The candidates of a band.
    pub fn range(&self, band: usize) -> Range<usize> {
        let columns = self.bands.range(band);
        columns.start * self.channels.lanes()..columns.end * self.channels.lanes()
    }

    pub fn band(&self, candidate: u32) -> usize {
        self.bands.of(candidate as usize / self.channels.lanes())
    }

    /// The keys of a band's candidates if it is reset (`anew`) or not.
    pub fn keys(&self, band: usize, anew: bool) -> &[f64] {
        &self.all_keys(anew)[self.range(band)]
    }

    fn all_keys(&self, anew: bool) -> &[f64] {
        if anew { &self.scratch.anew } else { &self.scratch.incremental }
    }

    /// What sending a candidate adds to the values, after the reset of its band where there is one.
    pub fn change(&self, candidate: u32, anew: bool) -> [f64; 3] {
        let column = candidate as usize / self.channels.lanes();
        let mut change = [0.0; 3];
        for colour in self.channels.colours(candidate) {
            let old = if anew { 0.0 } else { self.values[column][colour] };
            change[colour] = self.target[column][colour] - old;
        }
        change
    }

    /// A candidate's share of its column's cost.
    pub fn cost(&self, candidate: u32) -> f64 {
        let lanes = self.channels.lanes();
        self.costs.get(candidate as usize / lanes).map_or(0.0, |cost| cost / lanes as f64)
    }

    /// What a candidate adds to the error for as long as it is not sent, in the weights of the keys: additive.
    pub fn error(&self, candidate: u32, anew: bool, norm: Norm) -> f64 {
        match norm {
            Norm::L1 => self.all_keys(anew)[candidate as usize],
            Norm::L2 => {
                let weight = self.weights[candidate as usize / self.channels.lanes()];
                self.change(candidate, anew).iter().map(|change| (weight * change) * (weight * change)).sum()
            }
        }
    }

    /// |L^new| (`anew`) or |L^new - L~| of a band, in the weights of the keys; the square of it for L2.
    ///
    /// Area is constant in a band of wavelets, so that area weights change nothing in the comparison of the two.
    pub fn norm(&self, band: usize, anew: bool, norm: Norm) -> f64 {
        match norm {
            Norm::L1 => sum(self.keys(band, anew)),
            Norm::L2 => {
                let columns = self.bands.range(band);
                let light = self.target[columns.clone()].iter().zip(&self.values[columns.clone()]);
                squares(if anew { 0.0 } else { 1.0 }, self.weights[columns].iter().zip(light))
            }
        }
    }
}

/// The sum in eight interleaved parts: a fixed order that vectorises.
fn sum(numbers: &[f64]) -> f64 {
    let blocks = numbers.chunks_exact(8);
    let mut parts = [0.0; 8];
    for (part, &number) in parts.iter_mut().zip(blocks.remainder()) {
        *part += number;
    }
    for block in blocks {
        for (part, number) in parts.iter_mut().zip(block) {
            *part += number;
        }
    }
    parts.iter().sum()
}

/// The sum of (weight * (new - keep * old))^2, colour by colour, even and odd columns apart: six chains of additions.
fn squares<'a>(keep: f64, light: impl Iterator<Item = (&'a f64, (&'a [f64; 3], &'a [f64; 3]))>) -> f64 {
    let mut parts = [[0.0; 3]; 2];
    for (column, (weight, (new, old))) in light.enumerate() {
        for colour in 0..3 {
            let error = weight * (new[colour] - keep * old[colour]);
            parts[column % 2][colour] += error * error;
        }
    }
    parts.as_flattened().iter().sum()
}
