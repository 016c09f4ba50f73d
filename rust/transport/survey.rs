//! Choosing a threshold for a stated error of the image, from sample groups of untruncated rows.
//!
//! Under the light prior E[V_j^2] ~ area_j the expected squared error of the image is the sum over what rows lose of
//! area_j * loss^2. Energies are counted by size, so that a survey takes 60 KB whatever the sample.
//!
//! Where lights decide the error is not expected but measured: for each of them the sample rows are multiplied by what
//! every threshold would drop, and the worst of them decides. A sun's error is coherent over a floor, which no prior knows.

use std::sync::Arc;

use crate::basis::Bands;
use crate::error::{Error, Result};

use super::entry::{GROUP, Rows16};
use super::quantize::{Portable, round};
use super::truncate::Truncation;

/// Bins of an octave of weighted energy, and the octaves covered.
const BINS: i32 = 16;
const OCTAVES: std::ops::Range<i32> = -120..40;

/// A light that brings the rows less than this share of its energy does not reach them: what is left is rounding.
const FAINT: f64 = 1e-10;

/// Thresholds are not sought further than where the error is so many times what is tolerated.
const BEYOND: f64 = 2.0;

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
    /// What errors are measured under.
    lights: Arc<Vec<Measure>>,
    /// The squared norm of each light.
    squares: Vec<f64>,
    /// For each light the squared sum of all rows' responses.
    whole: Vec<f64>,
    /// For each bin and light the squared error of all rows if what lies in this bin and below is dropped; the first is
    /// that of rounding alone.
    lost: Vec<f64>,
}

/// A light that the error of truncation is measured under.
#[derive(Clone, Debug)]
pub struct Measure {
    /// What goes through the columns that are truncated.
    pub truncated: Vec<[f64; 3]>,
    /// All of the light in the same columns: what the error is relative to.
    pub whole: Vec<[f64; 3]>,
    /// Whether a threshold is chosen by it, or its error is only told.
    pub decides: bool,
}

/// A threshold, and what to expect of it on groups like the samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Threshold {
    /// Entries with a weighted norm below this are dropped.
    pub value: f64,
    /// Relative L2 error of the image, rounding included: the worst under the lights that decide, or where none does that
    /// expected under the light prior E[V_j^2] ~ area_j.
    pub error: f64,
    /// Under each light.
    pub errors: Vec<f64>,
    /// Entries that a group of 16 rows keeps, in the mean.
    pub entries_per_group: f64,
}

impl Survey {
    /// Of a rule's weights, quantum and width; its own threshold plays no part. The lights have a coefficient for each
    /// column that has entries.
    pub fn new(bands: &Bands, rule: &Truncation, lights: Arc<Vec<Measure>>) -> Result<Self> {
        let columns = bands.stored();
        if let Some(light) = lights.iter().flat_map(|m| [&m.truncated, &m.whole]).find(|light| light.len() != columns) {
            return Err(Error::input(format!("expected lights of {columns} coefficients, got {}", light.len())));
        }
        let count = (OCTAVES.len() as i32 * BINS) as usize;
        Ok(Survey {
            rule: Arc::new(rule.clone()),
            always: bands.always,
            groups: 0,
            bins: vec![[0.0; 3]; count],
            always_kept: [0.0; 3],
            squares: lights.iter().map(|light| light.whole.as_flattened().iter().map(|x| x * x).sum()).collect(),
            whole: vec![0.0; lights.len()],
            lost: vec![0.0; (count + 1) * lights.len()],
            lights,
        })
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
        let (rule, lights) = (Arc::clone(&self.rule), Arc::clone(&self.lights));
        assert!(planes.iter().all(|plane| plane.len() == rule.weights().len()));
        let mut entries = Vec::new();
        for (column, weight) in rule.weights().iter().enumerate() {
            let entry = planes.map(|plane| &plane[column]);
            let (energy, prior) = (energy(entry), weight * weight);
            if energy == 0.0 {
                continue;
            }
            let rounded = round::<Portable, C>(entry, rule.quantum, 0, rule.width)?;
            let stored = f64::from(u8::from(rounded.integers != [[0; GROUP]; C]));
            let kept = column < self.always;
            let at = bin(energy * prior);
            if !lights.is_empty() {
                entries.push((if kept { None } else { Some(at) }, column, rounded.residual));
            }
            let slot = if kept { &mut self.always_kept } else { &mut self.bins[at] };
            slot[0] += stored;
            slot[1] += energy * prior;
            slot[2] += self::energy(rounded.residual.each_ref()) * prior;
        }
        // What stays whatever the threshold first, then the smallest: so they are dropped.
        entries.sort_by_key(|entry| entry.0);
        for (number, light) in lights.iter().enumerate() {
            self.measure(number, light, planes, &entries);
        }
        Ok(())
    }

    /// The error of a group's rows under a light, threshold by threshold.
    fn measure<const C: usize>(
        &mut self,
        number: usize,
        light: &Measure,
        planes: [&[Rows16]; C],
        entries: &[(Option<usize>, usize, [Rows16; C])],
    ) {
        let mut sums = Response::default();
        entries.iter().for_each(|&(_, column, _)| sums.add(planes.map(|plane| &plane[column]), light.whole[column]));
        self.whole[number] += sums.square();

        // Rounding alone; then entry after entry loses all of itself instead.
        let mut lost = Response::default();
        entries.iter().for_each(|(_, column, rest)| lost.add(rest.each_ref(), light.truncated[*column]));
        let (mut next, count) = (entries.partition_point(|entry| entry.0.is_none()), self.lights.len());
        let mut square = lost.square();
        self.lost[number] += square;
        for bin in 0..self.bins.len() {
            let before = next;
            while let Some((Some(at), column, rest)) = entries.get(next)
                && *at == bin
            {
                lost.add(planes.map(|plane| &plane[*column]), light.truncated[*column]);
                lost.add(rest.each_ref(), light.truncated[*column].map(|x| -x));
                next += 1;
            }
            if next > before {
                square = lost.square();
            }
            self.lost[(bin + 1) * count + number] += square;
        }
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
        let pairs = self.whole.iter_mut().zip(&other.whole).chain(self.lost.iter_mut().zip(&other.lost));
        pairs.for_each(|(mine, theirs)| *mine += theirs);
    }

    /// The relative error under each light if the first `bins` bins are dropped.
    fn errors(&self, bins: usize) -> Vec<f64> {
        let own = &self.lost[bins * self.lights.len()..][..self.lights.len()];
        let rows = (GROUP * self.groups) as f64;
        let relative = |((lost, whole), square): ((&f64, &f64), &f64)| {
            if *whole > FAINT * square * rows { (lost / whole).sqrt() } else { 0.0 }
        };
        own.iter().zip(&self.whole).zip(&self.squares).map(relative).collect()
    }

    /// The largest threshold at which the error does not exceed `tolerance`; 0, with the error that rounding alone
    /// makes, where none does.
    pub fn threshold_for(&self, tolerance: f64) -> Result<Threshold> {
        if !(0.0..1.0).contains(&tolerance) {
            return Err(Error::input(format!("expected a truncation error from 0 to 1, got {tolerance}")));
        }
        let column = |k: usize| self.always_kept[k] + self.bins.iter().map(|bin| bin[k]).sum::<f64>();
        let [mut entries, total, mut lost] = [column(0), column(1), column(2)];
        let per_group = |entries: f64| entries / self.groups.max(1) as f64;
        let expected = |lost: f64| if total > 0.0 { (lost.max(0.0) / total).sqrt() } else { 0.0 };
        let threshold = |bins: usize, value: f64, lost: f64, entries: f64| {
            let errors = self.errors(bins);
            let deciding = errors.iter().zip(self.lights.iter()).filter(|(_, light)| light.decides);
            let error = deciding.map(|(&error, _)| error).reduce(f64::max).unwrap_or(expected(lost));
            Threshold { value, error, errors, entries_per_group: per_group(entries) }
        };
        let mut choice = threshold(0, 0.0, lost, entries);

        // Drop bin after bin, the smallest energies first: a dropped entry loses its energy instead of its rounding.
        for (k, bin) in self.bins.iter().enumerate() {
            lost += bin[1] - bin[2];
            entries -= bin[0];
            let upper = f64::from(OCTAVES.start) + (k + 1) as f64 / f64::from(BINS);
            let next = threshold(k + 1, (upper / 2.0).exp2(), lost, entries);
            // What is measured does not grow steadily: coherent losses come and cancel.
            if next.error > BEYOND * tolerance {
                break;
            }
            if next.error <= tolerance {
                choice = next;
            }
        }
        Ok(choice)
    }
}

fn energy<const C: usize>(entry: [&Rows16; C]) -> f64 {
    let of = |lanes: &Rows16| lanes.iter().map(|&value| f64::from(value) * f64::from(value)).sum::<f64>();
    entry[1..].iter().fold(of(entry[0]), |sum, lanes| sum + of(lanes))
}

/// The response of 16 rows to a light.
#[derive(Default)]
struct Response([[f64; GROUP]; 3]);

impl Response {
    #[inline(always)]
    fn add<const C: usize>(&mut self, entry: [&Rows16; C], light: [f64; 3]) {
        // What a factor that is not seen through would add: most of a family's columns.
        if light == [0.0; 3] {
            return;
        }
        for (colour, (sums, light)) in self.0.iter_mut().zip(light).enumerate() {
            for (sum, &value) in sums.iter_mut().zip(entry[colour % C]) {
                *sum += f64::from(value) * light;
            }
        }
    }

    fn square(&self) -> f64 {
        self.0.as_flattened().iter().map(|sum| sum * sum).sum()
    }
}

/// The bin of a weighted energy; what lies outside the octaves goes to the ends.
fn bin(energy: f64) -> usize {
    let position = (energy.log2() - f64::from(OCTAVES.start)) * f64::from(BINS);
    (position.max(0.0) as usize).min((OCTAVES.len() as i32 * BINS) as usize - 1)
}
