//! Choosing a threshold for a stated error of the image, from sample groups of untruncated rows.
//!
//! Under the light prior E[V_j^2] ~ area_j the expected squared error of the image is the sum over what rows lose of
//! area_j * loss^2. Energies are counted by size, so that a survey takes 60 KB whatever the sample.

use rayon::prelude::*;

use crate::basis::Bands;
use crate::error::{Error, Result};

use super::entry::{GROUP, Rows16, Width, check_quantum};
use super::quantize::{Portable, round};
use super::truncate::{SCALING, area_weights};

/// Bins of an octave of weighted energy, and the octaves covered.
const BINS: i32 = 16;
const OCTAVES: std::ops::Range<i32> = -120..40;

/// A survey of sample groups, from which a threshold is chosen: energies by size, in 60 KB whatever the sample.
#[derive(Clone, Debug)]
pub struct Survey {
    weights: Vec<f64>,
    quantum: i32,
    width: Width,
    groups: usize,
    /// For the entries of each bin of weighted energy: number, energy under the prior, and what of it rounding takes.
    bins: Vec<[f64; 3]>,
    /// The same of the scaling columns, which stay whatever the threshold.
    scaling: [f64; 3],
}

/// A threshold, and what to expect of it on groups like the samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Threshold {
    pub value: f64,
    /// Relative L2 error of the image under the light prior E[V_j^2] ~ area_j, rounding included.
    pub error: f64,
    pub entries_per_group: f64,
}

impl Survey {
    pub fn new(bands: &Bands, quantum: i32, width: Width) -> Result<Self> {
        check_quantum(quantum, width)?;
        let bins = vec![[0.0; 3]; (OCTAVES.len() as i32 * BINS) as usize];
        Ok(Survey { weights: area_weights(bands), quantum, width, groups: 0, bins, scaling: [0.0; 3] })
    }

    /// Counts the entries of 16 raw rows.
    pub fn add(&mut self, lanes: &[Rows16], bands: &Bands) -> Result<()> {
        assert_eq!(lanes.len(), bands.columns());
        self.groups += 1;
        for band in 0..bands.count() {
            let area = self.weights[band] * self.weights[band];
            for column in bands.range(band) {
                let energy = energy(&lanes[column]);
                if energy == 0.0 {
                    continue;
                }
                let rounded = round::<Portable>(&lanes[column], self.quantum, self.width)?;
                let stored = f64::from(u8::from(rounded.integers != [0; GROUP]));
                let scaling = band == 0 && column < SCALING;
                let slot = if scaling { &mut self.scaling } else { &mut self.bins[bin(energy * area)] };
                slot[0] += stored;
                slot[1] += energy * area;
                slot[2] += self::energy(&rounded.residual) * area;
            }
        }
        Ok(())
    }

    /// Adds what another survey counted. Merge in a fixed order: sums are in floating point.
    pub fn merge(&mut self, other: &Survey) {
        self.groups += other.groups;
        let pairs = self.bins.iter_mut().zip(&other.bins).chain([(&mut self.scaling, &other.scaling)]);
        for (mine, theirs) in pairs {
            for k in 0..3 {
                mine[k] += theirs[k];
            }
        }
    }

    /// The largest threshold whose expected error does not exceed `tolerance`; 0, with the error that rounding alone
    /// makes, where none does.
    pub fn threshold_for(&self, tolerance: f64) -> Result<Threshold> {
        if !(0.0..1.0).contains(&tolerance) {
            return Err(Error::input(format!("expected a truncation error from 0 to 1, got {tolerance}")));
        }
        let column = |k: usize| self.scaling[k] + self.bins.iter().map(|bin| bin[k]).sum::<f64>();
        let [mut entries, total, mut lost] = [column(0), column(1), column(2)];
        let per_group = |entries: f64| entries / self.groups.max(1) as f64;
        let error = |lost: f64| if total > 0.0 { (lost.max(0.0) / total).sqrt() } else { 0.0 };
        let mut choice = Threshold { value: 0.0, error: error(lost), entries_per_group: per_group(entries) };

        // Drop bin after bin, the smallest energies first: a dropped entry loses its energy instead of its rounding.
        for (k, bin) in self.bins.iter().enumerate() {
            lost += bin[1] - bin[2];
            entries -= bin[0];
            if error(lost) > tolerance {
                break;
            }
            let upper = f64::from(OCTAVES.start) + (k + 1) as f64 / f64::from(BINS);
            choice =
                Threshold { value: (upper / 2.0).exp2(), error: error(lost), entries_per_group: per_group(entries) };
        }
        Ok(choice)
    }
}

/// Surveys raw sample groups in parallel and chooses: see `Survey::threshold_for`.
pub fn threshold_for(
    samples: &[&[Rows16]],
    bands: &Bands,
    quantum: i32,
    width: Width,
    tolerance: f64,
) -> Result<Threshold> {
    let empty = Survey::new(bands, quantum, width)?;
    let surveys: Vec<Survey> = samples
        .par_iter()
        .map(|lanes| {
            let mut survey = empty.clone();
            survey.add(lanes, bands).map(|()| survey)
        })
        .collect::<Result<_>>()?;
    let mut all = empty;
    surveys.iter().for_each(|survey| all.merge(survey));
    all.threshold_for(tolerance)
}

fn energy(lanes: &Rows16) -> f64 {
    lanes.iter().map(|&value| f64::from(value) * f64::from(value)).sum()
}

/// The bin of a weighted energy; what lies outside the octaves goes to the ends.
fn bin(energy: f64) -> usize {
    let position = (energy.log2() - f64::from(OCTAVES.start)) * f64::from(BINS);
    (position.max(0.0) as usize).min((OCTAVES.len() as i32 * BINS) as usize - 1)
}
