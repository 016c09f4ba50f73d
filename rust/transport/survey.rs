//! Choosing a threshold for a stated error of the image, from sample groups of untruncated rows.
//!
//! Under the light prior E[V_j^2] ~ area_j the expected squared error of the image is the sum over what rows lose of
//! area_j * loss^2. Energies are counted by size, so that a survey takes 60 KB whatever the sample.

use std::sync::Arc;

use crate::basis::Bands;
use crate::error::{Error, Result};

use super::entry::{GROUP, Rows16};
use super::quantize::{Portable, round};
use super::truncate::Truncation;

/// Bins of an octave of weighted energy, and the octaves covered.
const BINS: i32 = 16;
const OCTAVES: std::ops::Range<i32> = -120..40;

/// A survey of sample groups, from which a threshold is chosen: energies by size, in 60 KB whatever the sample.
#[derive(Clone, Debug)]
pub struct Survey {
    /// The rule whose threshold is sought.
    rule: Arc<Truncation>,
    always: usize,
    groups: usize,
    /// For the entries of each bin of weighted energy: number, energy under the prior, and what of it rounding takes.
    bins: Vec<[f64; 3]>,
    /// The same of the columns that stay whatever the threshold.
    always_kept: [f64; 3],
}

/// A threshold, and what to expect of it on groups like the samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Threshold {
    /// Entries with a weighted norm below this are dropped.
    pub value: f64,
    /// Relative L2 error of the image under the light prior E[V_j^2] ~ area_j, rounding included.
    pub error: f64,
    /// Entries that a group of 16 rows keeps, in the mean.
    pub entries_per_group: f64,
}

impl Survey {
    /// Of a rule's weights, quantum and width; its own threshold plays no part.
    pub fn new(bands: &Bands, rule: &Truncation) -> Self {
        let bins = vec![[0.0; 3]; (OCTAVES.len() as i32 * BINS) as usize];
        Survey { rule: Arc::new(rule.clone()), always: bands.always, groups: 0, bins, always_kept: [0.0; 3] }
    }

    /// Counts the entries of 16 raw rows, channel by channel in `planes`.
    pub fn add(&mut self, planes: &[&[Rows16]]) -> Result<()> {
        self.groups += 1;
        match *planes {
            [one] => self.add_entries([one]),
            [red, green, blue] => self.add_entries([red, green, blue]),
            _ => Err(Error::input(format!("expected 1 or 3 channels, found {}", planes.len()))),
        }
    }

    fn add_entries<const C: usize>(&mut self, planes: [&[Rows16]; C]) -> Result<()> {
        let rule = Arc::clone(&self.rule);
        assert!(planes.iter().all(|plane| plane.len() == rule.weights().len()));
        for (column, weight) in rule.weights().iter().enumerate() {
            let entry = planes.map(|plane| &plane[column]);
            let (energy, prior) = (energy(entry), weight * weight);
            if energy == 0.0 {
                continue;
            }
            let rounded = round::<Portable, C>(entry, rule.quantum, 0, rule.width)?;
            let stored = f64::from(u8::from(rounded.integers != [[0; GROUP]; C]));
            let kept = column < self.always;
            let slot = if kept { &mut self.always_kept } else { &mut self.bins[bin(energy * prior)] };
            slot[0] += stored;
            slot[1] += energy * prior;
            slot[2] += self::energy(rounded.residual.each_ref()) * prior;
        }
        Ok(())
    }

    /// Adds what another survey counted. Merge in a fixed order: sums are in floating point.
    pub fn merge(&mut self, other: &Survey) {
        self.groups += other.groups;
        let pairs = self.bins.iter_mut().zip(&other.bins).chain([(&mut self.always_kept, &other.always_kept)]);
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
        let column = |k: usize| self.always_kept[k] + self.bins.iter().map(|bin| bin[k]).sum::<f64>();
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

fn energy<const C: usize>(entry: [&Rows16; C]) -> f64 {
    let of = |lanes: &Rows16| lanes.iter().map(|&value| f64::from(value) * f64::from(value)).sum::<f64>();
    entry[1..].iter().fold(of(entry[0]), |sum, lanes| sum + of(lanes))
}

/// The bin of a weighted energy; what lies outside the octaves goes to the ends.
fn bin(energy: f64) -> usize {
    let position = (energy.log2() - f64::from(OCTAVES.start)) * f64::from(BINS);
    (position.max(0.0) as usize).min((OCTAVES.len() as i32 * BINS) as usize - 1)
}
