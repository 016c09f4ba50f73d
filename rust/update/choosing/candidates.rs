//! What choosing looks at in one frame: where the light is, where our copy of it is, and the key of every candidate.

use std::ops::Range;

use crate::basis::Bands;
use crate::twice::compiled_twice;

use super::largest::{Keyed, by_key};
use super::method::{Colours, Norm};

/// One frame's light against the values applied so far.
pub(super) struct Candidates<'a> {
    /// How the columns group into bands.
    pub bands: &'a Bands,
    /// Whether a candidate is a column or one colour of it.
    pub colours: Colours,
    /// What a unit of change is worth, one a column.
    pub weights: &'a [f64],
    /// One a column, or empty: then a column costs nothing.
    pub costs: &'a [f64],
    /// L^new and L~ of Overbeck 2006, Fig. 6.1.
    pub target: &'a [[f64; 3]],
    /// V~, the other of the two.
    pub values: &'a [[f64; 3]],
    /// All keys, measured for this frame.
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

/// Above any sum of least keys, and below any other that matters.
const NOTHING: f64 = 1e-300;

/// weight * magnitude, but never zero where there is a change: a column of weight zero is sent last, not never.
#[inline(always)]
fn key(weight: f64, magnitude: f64) -> f64 {
    let least = if magnitude < f64::MIN_POSITIVE { magnitude } else { f64::MIN_POSITIVE };
    let key = weight * magnitude;
    if key > least { key } else { least }
}

compiled_twice! {
    fn measure(keys: &mut Keys, colours: Colours, weights: &[f64], target: &[[f64; 3]], values: &[[f64; 3]])
        = Keys::measure_any;

    /// The sum of the numbers below a limit, in eight interleaved parts: a fixed order that vectorises.
    fn sum_below(numbers: &[f64], limit: f64) -> f64 = sum_below_any;
}

impl Keys {
    /// Computes all keys in one pass over both vectors.
    pub fn measure(&mut self, colours: Colours, weights: &[f64], target: &[[f64; 3]], values: &[[f64; 3]]) {
        measure(self, colours, weights, target, values);
    }

    #[inline(always)]
    fn measure_any(&mut self, colours: Colours, weights: &[f64], target: &[[f64; 3]], values: &[[f64; 3]]) {
        let count = target.len() * colours.per_column();
        self.incremental.resize(count, 0.0);
        self.anew.resize(count, 0.0);
        let light = weights.iter().zip(target.iter().zip(values));
        match colours {
            Colours::Joint => {
                let keys = self.incremental.iter_mut().zip(&mut self.anew);
                for ((incremental, anew), (&weight, (new, old))) in keys.zip(light) {
                    let change = (new[0] - old[0]).abs() + (new[1] - old[1]).abs() + (new[2] - old[2]).abs();
                    *incremental = key(weight, change);
                    *anew = key(weight, new[0].abs() + new[1].abs() + new[2].abs());
                }
            }
            Colours::Separate => {
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

impl Candidates<'_> {
    /// How many there are: one a column, or three.
    pub fn candidates(&self) -> usize {
        self.target.len() * self.colours.per_column()
    }

    /// The candidates of a band.
    pub fn range(&self, band: usize) -> Range<usize> {
        let columns = self.bands.range(band);
        columns.start * self.colours.per_column()..columns.end * self.colours.per_column()
    }

    /// The band that a candidate's column is in.
    pub fn band(&self, candidate: u32) -> usize {
        self.bands.of(candidate as usize / self.colours.per_column())
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
        let column = candidate as usize / self.colours.per_column();
        let mut change = [0.0; 3];
        for colour in self.colours.of(candidate) {
            let old = if anew { 0.0 } else { self.values[column][colour] };
            change[colour] = self.target[column][colour] - old;
        }
        change
    }

    /// A candidate's share of its column's cost.
    pub fn cost(&self, candidate: u32) -> f64 {
        let lanes = self.colours.per_column();
        self.costs.get(candidate as usize / lanes).map_or(0.0, |cost| cost / lanes as f64)
    }

    /// Whether a candidate's column holds anything: a reset of its band has to take it out, and so to stream it.
    pub fn held(&self, candidate: u32) -> bool {
        self.values[candidate as usize / self.colours.per_column()] != [0.0; 3]
    }

    /// Whether a band holds anything.
    pub fn band_held(&self, band: usize) -> bool {
        self.values[self.bands.range(band)].iter().any(|value| *value != [0.0; 3])
    }

    /// The cost of all columns that a band holds.
    pub fn held_cost(&self, band: usize) -> f64 {
        self.range(band).map(|candidate| candidate as u32).filter(|&c| self.held(c)).map(|c| self.cost(c)).sum()
    }

    /// The candidates whose columns the reset of a band streams anyway, as far as there is light in them.
    pub fn paid(&self, band: usize) -> impl Iterator<Item = u32> {
        let lit = self.range(band).zip(self.keys(band, true)).filter(|(_, key)| **key > 0.0);
        lit.map(|(candidate, _)| candidate as u32).filter(|&candidate| self.held(candidate))
    }

    /// What a candidate adds to the error for as long as it is not sent, in the weights of the keys: additive.
    pub fn error(&self, candidate: u32, anew: bool, norm: Norm) -> f64 {
        match norm {
            Norm::L1 => self.all_keys(anew)[candidate as usize],
            Norm::L2 => {
                let weight = self.weights[candidate as usize / self.colours.per_column()];
                self.change(candidate, anew).iter().map(|change| (weight * change) * (weight * change)).sum()
            }
        }
    }

    /// The error of a band of which, of the candidates whose `keys` are not zero, only `cards`, the largest, are sent.
    ///
    /// It is summed up, never taken from the whole band's: that would cancel where the largest are very large.
    pub fn error_beyond(&self, band: usize, anew: bool, norm: Norm, keys: &[f64], cards: &[Keyed]) -> f64 {
        let range = self.range(band);
        let Some(least) = cards.last() else { return 0.0 };
        if cards.len() == range.len() {
            return 0.0;
        }
        match norm {
            // Of the keys that equal the least card's, some are cards.
            Norm::L1 => {
                let equal = keys.iter().map(|&key| (key == least.key) as usize).sum::<usize>();
                let listed = cards.iter().rev().take_while(|card| card.key == least.key).count();
                sum_below(keys, least.key) + (equal - listed) as f64 * least.key
            }
            Norm::L2 => {
                let all = range.zip(keys).map(|(candidate, &key)| Keyed { key, candidate: candidate as u32 });
                let unlisted = all.filter(|card| card.key > 0.0 && by_key(least, card).is_lt());
                unlisted.map(|card| self.error(card.candidate, anew, norm)).sum()
            }
        }
    }

    /// |L^new| (`anew`) or |L^new - L~| of a band, in the weights of the keys; the square of it for L2.
    ///
    /// Zero for a band whose columns are all worth nothing: the least keys, which only put them last, are no error.
    /// Area is constant in a band of wavelets, so that area weights change nothing in the comparison of the two.
    pub fn norm(&self, band: usize, anew: bool, norm: Norm) -> f64 {
        match norm {
            Norm::L1 => {
                Some(sum_below(self.keys(band, anew), f64::INFINITY)).filter(|sum| *sum > NOTHING).unwrap_or(0.0)
            }
            Norm::L2 => {
                let columns = self.bands.range(band);
                let light = self.target[columns.clone()].iter().zip(&self.values[columns.clone()]);
                squares(if anew { 0.0 } else { 1.0 }, self.weights[columns].iter().zip(light))
            }
        }
    }
}

#[inline(always)]
fn sum_below_any(numbers: &[f64], limit: f64) -> f64 {
    let below = |number: f64| if number < limit { number } else { 0.0 };
    let blocks = numbers.chunks_exact(8);
    let mut parts = [0.0; 8];
    for (part, &number) in parts.iter_mut().zip(blocks.remainder()) {
        *part += below(number);
    }
    for block in blocks {
        for (part, &number) in parts.iter_mut().zip(block) {
            *part += below(number);
        }
    }
    parts.iter().sum()
}

/// The sum of (weight * (new - keep * old))^2: a chain of additions for each colour.
fn squares<'a>(keep: f64, light: impl Iterator<Item = (&'a f64, (&'a [f64; 3], &'a [f64; 3]))>) -> f64 {
    let [red, green, blue] = light.fold([0.0; 3], |sums: [f64; 3], (weight, (new, old))| {
        let square = |c: usize| {
            let error = weight * (new[c] - keep * old[c]);
            sums[c] + error * error
        };
        [square(0), square(1), square(2)]
    });
    red + green + blue
}
