//! Truncation: which entries of M are kept, to how many bits, and exactly how much each row loses.
//!
//! The unit is the entry of a tile: one column in 16 neighbouring rows, T_0j .. T_15j. It costs 18 bytes whether one lane
//! matters or all do, so it is kept by what all lanes give together to the image under the light prior E[V_j^2] ~ area_j:
//!
//!     sum_l T_lj^2 * weight_b^2 >= threshold^2,    weight_b = sqrt(area of band b's columns)
//!
//! The scaling columns are always kept: without them rows no longer sum to the light they receive (the white furnace).
//! What is kept is rounded to integers times 2^(quantum + shift), with the least shift that fits the width. What a row loses,
//! by dropping and by rounding, is summed per band and stored rounded up: the bound |B - M V| <= sum_b dropped_b ||V_b|| holds.
//!
//! Tried and left: a threshold per single entry (the other lanes are paid for anyway), a threshold on the error of each row
//! (at equal bytes it doubles the error of the image).

use rayon::prelude::*;

use crate::basis::Bands;
use crate::error::{Error, Result};

use super::tile::{CompressedGroup, GROUP, Tile, Values, Width};

/// One column of a group: its coefficient in each of the 16 rows.
pub type Lanes = [f32; GROUP];

/// The scaling functions of the six faces: the first columns of band 0.
const SCALING: usize = 6;
/// Columns screened between two flushes of the f32 sums into f64.
const BLOCK: usize = 64;
/// The largest shift that an entry's word can hold (6 bits).
const MAX_SHIFT: i32 = 63;
/// Stored values stay below 2^20, so that sums of them cannot overflow anything.
pub const MAX_EXPONENT: i32 = 20;
/// The least quantum, so that every intermediate value is an ordinary f32.
pub const MIN_QUANTUM: i32 = -64;
/// Covers the roundings of f32 energies summed in blocks of 64 (at most 66 * 2^-24), of the f64 sum and of the root.
const MARGIN: f64 = 1.0 + 1.0 / 65536.0;
/// Squares below f32's range may vanish: each by less than this.
const UNDERFLOW: f64 = 1.5e-45;

/// The rule by which entries are kept and rounded.
#[derive(Clone, Debug, PartialEq)]
pub struct Truncation {
    /// Entries with a weighted norm below this are dropped; 0 keeps all that does not round to zero.
    pub threshold: f64,
    /// One weight a band.
    pub weights: Vec<f64>,
    /// Values are integers times 2^(quantum + shift), shift >= 0.
    pub quantum: i32,
    pub width: Width,
}

impl Truncation {
    /// The rule for the image's error: weights are the roots of the areas.
    pub fn new(bands: &Bands, threshold: f64, quantum: i32, width: Width) -> Result<Self> {
        if !(threshold >= 0.0 && threshold.is_finite()) {
            return Err(Error::input(format!("expected a finite truncation threshold >= 0, got {threshold}")));
        }
        check_quantum(quantum, width)?;
        Ok(Truncation { threshold, weights: area_weights(bands), quantum, width })
    }

    /// The least energy (unweighted) that keeps an entry of a band; never zero, so that empty entries always go.
    fn limit(&self, band: usize) -> f32 {
        let limit = self.threshold / self.weights[band];
        ((limit * limit) as f32).max(f32::MIN_POSITIVE)
    }
}

/// The largest exponent that quantum + shift may have at a width.
pub fn max_step(width: Width) -> i32 {
    MAX_EXPONENT - integer_bits(width)
}

/// Refuses quanta with which no value could be stored, or not exactly.
pub fn check_quantum(quantum: i32, width: Width) -> Result<()> {
    if (MIN_QUANTUM..=max_step(width)).contains(&quantum) {
        return Ok(());
    }
    let most = max_step(width);
    Err(Error::input(format!("expected a quantum (exponent of two) from {MIN_QUANTUM} to {most}, got {quantum}")))
}

fn integer_bits(width: Width) -> i32 {
    match width {
        Width::I8 => 7,
        Width::I16 => 15,
    }
}

/// sqrt(area) of each band: the areas of a band's columns are equal.
fn area_weights(bands: &Bands) -> Vec<f64> {
    (0..bands.count()).map(|band| bands.areas[bands.range(band).start].sqrt()).collect()
}

/// The least bfloat16 that is not below a norm.
pub fn bf16_up(norm: f64) -> u16 {
    debug_assert!(norm >= 0.0);
    let mut single = norm as f32;
    if f64::from(single) < norm {
        single = single.next_up();
    }
    // The integer order of bit patterns is the order of positive floats: adding one steps to the next bfloat16.
    (single.to_bits().wrapping_add(0xffff) >> 16) as u16
}

/// What a stored norm says.
pub fn bf16(bits: u16) -> f32 {
    f32::from_bits(u32::from(bits) << 16)
}

/// Compresses 16 rows: `lanes[j]` is column j. `out` is emptied first and keeps its memory.
///
/// Fails where a coefficient is not finite or too large to be stored.
pub fn compress_group(lanes: &[Lanes], bands: &Bands, rule: &Truncation, out: &mut CompressedGroup) -> Result<()> {
    assert_eq!(lanes.len(), bands.columns());
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") {
        // SAFETY: the instruction set was found. PERF: 24,576 columns in 40 us instead of 150 (cargo test, release).
        return unsafe { compress_avx2(lanes, bands, rule, out) };
    }
    compress_portable(lanes, bands, rule, out)
}

/// The same source compiled for AVX2: without fused multiplication the results are the same bits.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn compress_avx2(lanes: &[Lanes], bands: &Bands, rule: &Truncation, out: &mut CompressedGroup) -> Result<()> {
    compress(lanes, bands, rule, out)
}

/// The path of every other machine; public so that the suite can hold the two against each other.
pub fn compress_portable(lanes: &[Lanes], bands: &Bands, rule: &Truncation, out: &mut CompressedGroup) -> Result<()> {
    compress(lanes, bands, rule, out)
}

#[inline(always)]
fn compress(lanes: &[Lanes], bands: &Bands, rule: &Truncation, out: &mut CompressedGroup) -> Result<()> {
    out.columns.clear();
    out.shifts.clear();
    out.values.clear();
    let count = bands.count();
    for norms in [&mut out.kept, &mut out.dropped] {
        norms.clear();
        norms.resize(GROUP * count, 0);
    }

    for band in 0..count {
        let limit = rule.limit(band);
        let mut kept = [0.0f64; GROUP];
        let mut dropped = Dropped::default();
        let range = bands.range(band);
        let scaling = if band == 0 { SCALING.min(range.len()) } else { 0 };

        // The scaling functions are a block of their own, which only an empty entry does not survive.
        let head = range.start + scaling;
        keep_block(lanes, range.start..head, f32::MIN_POSITIVE, rule, &mut kept, &mut dropped, out)?;
        for start in (head..range.end).step_by(BLOCK) {
            keep_block(lanes, start..range.end.min(start + BLOCK), limit, rule, &mut kept, &mut dropped, out)?;
        }

        for lane in 0..GROUP {
            let lost = dropped.norm(lane);
            if !lost.is_finite() {
                return Err(Error::input("expected finite transport coefficients, found NaN or infinity"));
            }
            out.kept[lane * count + band] = bf16_up(kept[lane].sqrt() * MARGIN);
            out.dropped[lane * count + band] = bf16_up(lost);
        }
    }
    Ok(())
}

/// Screens up to 64 columns and rounds those that stay.
#[inline(always)]
fn keep_block(
    lanes: &[Lanes],
    range: std::ops::Range<usize>,
    limit: f32,
    rule: &Truncation,
    kept: &mut [f64; GROUP],
    dropped: &mut Dropped,
    out: &mut CompressedGroup,
) -> Result<()> {
    let mut mask = screen(&lanes[range.clone()], limit, dropped);
    while mask != 0 {
        let column = range.start + mask.trailing_zeros() as usize;
        mask &= mask - 1;
        let rounded = round(&lanes[column], rule.quantum, rule.width)?;
        dropped.add(&rounded.residual);
        if rounded.integers == [0; GROUP] {
            continue;
        }
        out.columns.push(column as u32);
        out.shifts.push(rounded.shift);
        out.values.extend_from_slice(&rounded.integers);
        let step = power_of_two(rule.quantum + i32::from(rounded.shift));
        for lane in 0..GROUP {
            let value = f64::from(rounded.integers[lane]) * f64::from(step);
            kept[lane] += value * value;
        }
    }
    Ok(())
}

/// Energy lost by each lane in one band.
#[derive(Default)]
struct Dropped {
    energy: [f64; GROUP],
    /// How many columns lost something in some lane: what may have vanished below f32's range.
    columns: u32,
    /// Bits of everything a lane lost: zero only where it lost exactly nothing.
    bits: [u32; GROUP],
}

impl Dropped {
    #[inline(always)]
    fn add(&mut self, residual: &Lanes) {
        self.columns += 1;
        for lane in 0..GROUP {
            self.energy[lane] += f64::from(residual[lane]) * f64::from(residual[lane]);
            self.bits[lane] |= residual[lane].to_bits() & 0x7fff_ffff;
        }
    }

    /// Never below the true norm, and zero only where nothing was lost.
    fn norm(&self, lane: usize) -> f64 {
        if self.bits[lane] == 0 {
            return 0.0;
        }
        (self.energy[lane] + f64::from(self.columns) * UNDERFLOW).sqrt() * MARGIN
    }
}

/// Which of up to 64 columns have an energy of at least `limit`; the energy of the others goes to `dropped`.
#[inline(always)]
fn screen(lanes: &[Lanes], limit: f32, dropped: &mut Dropped) -> u64 {
    let mut mask = 0u64;
    let mut lost = [0.0f32; GROUP];
    let mut bits = [0u32; GROUP];
    for (k, lane) in lanes.iter().enumerate() {
        let squares = lane.map(|value| value * value);
        let keep = sum(&squares) >= limit;
        mask |= u64::from(keep) << k;
        // Branch-free: a kept column adds zero (its bits are masked away).
        let dropping = if keep { 0u32 } else { u32::MAX };
        for l in 0..GROUP {
            lost[l] += f32::from_bits(squares[l].to_bits() & dropping);
            bits[l] |= lane[l].to_bits() & dropping & 0x7fff_ffff;
        }
    }
    dropped.columns += lanes.len() as u32;
    for l in 0..GROUP {
        dropped.energy[l] += f64::from(lost[l]);
        dropped.bits[l] |= bits[l];
    }
    mask
}

/// The sum of 16 numbers as a tree of halves: one order on every machine.
#[inline(always)]
fn sum(x: &Lanes) -> f32 {
    let a: [f32; 8] = std::array::from_fn(|l| x[l] + x[l + 8]);
    let b: [f32; 4] = std::array::from_fn(|l| a[l] + a[l + 4]);
    (b[0] + b[2]) + (b[1] + b[3])
}

/// An entry as integers, and what rounding left over.
struct Rounded {
    shift: u8,
    integers: [i16; GROUP],
    residual: Lanes,
}

/// Rounds 16 values to nearest (ties to even) multiples of 2^(quantum + shift), with the least shift that fits.
#[inline(always)]
fn round(lanes: &Lanes, quantum: i32, width: Width) -> Result<Rounded> {
    let largest = lanes.iter().fold(0.0f32, |most, value| most.max(value.abs()));
    let shift = least_shift(largest * power_of_two(-quantum), width);
    if !largest.is_finite() || shift > MAX_SHIFT || quantum + shift > max_step(width) {
        return Err(Error::input(format!(
            "expected transport coefficients below 2^{}, found {largest}",
            MAX_EXPONENT.min(quantum + MAX_SHIFT + integer_bits(width))
        )));
    }
    // Both scales are powers of two: only the rounding to an integer is inexact, and the residual is exact in f32.
    let inverse = power_of_two(-(quantum + shift));
    let step = power_of_two(quantum + shift);
    let nearest = lanes.map(|value| (value * inverse).round_ties_even());
    Ok(Rounded {
        shift: shift as u8,
        integers: nearest.map(|value| value as i16),
        residual: std::array::from_fn(|l| lanes[l] - nearest[l] * step),
    })
}

/// The least s >= 0 with round(largest / 2^s) <= 2^bits - 1, for `largest` in units of the quantum.
#[inline(always)]
fn least_shift(largest: f32, width: Width) -> i32 {
    let bits = integer_bits(width);
    let exponent = (largest.to_bits() >> 23) as i32 - 127;
    let shift = (exponent - (bits - 1)).max(0);
    // Now largest / 2^shift < 2^bits; from 2^bits - 1/2 on it would round up to 2^bits.
    let top = power_of_two(bits) - 0.5;
    if shift <= MAX_SHIFT && largest * power_of_two(-shift) >= top { shift + 1 } else { shift }
}

#[inline(always)]
fn power_of_two(exponent: i32) -> f32 {
    debug_assert!((-126..=127).contains(&exponent));
    f32::from_bits(((exponent + 127) as u32) << 23)
}

impl Tile {
    /// Entries of each group in column order: `(starts, (column, entry))`, the transpose of the tile's own order.
    pub fn by_group(&self) -> (Vec<u32>, Vec<(u32, u32)>) {
        let mut starts = vec![0u32; self.groups() + 1];
        for &word in self.words.iter() {
            starts[group_of(word) + 1] += 1;
        }
        for group in 0..self.groups() {
            starts[group + 1] += starts[group];
        }
        let mut next = starts.clone();
        let mut entries = vec![(0, 0); self.words.len()];
        for (column, range) in self.starts.windows(2).enumerate() {
            for entry in range[0]..range[1] {
                let slot = &mut next[group_of(self.words[entry as usize])];
                entries[*slot as usize] = (column as u32, entry);
                *slot += 1;
            }
        }
        (starts, entries)
    }

    /// The 16 stored values of an entry.
    pub fn lanes(&self, entry: usize, quantum: i32) -> Lanes {
        let step = power_of_two(quantum + i32::from(self.words[entry] >> super::tile::GROUP_BITS));
        let range = entry * GROUP..(entry + 1) * GROUP;
        let mut lanes = [0.0; GROUP];
        match &self.values {
            Values::I8(values) => lanes.iter_mut().zip(&values[range]).for_each(|(x, &q)| *x = f32::from(q) * step),
            Values::I16(values) => lanes.iter_mut().zip(&values[range]).for_each(|(x, &q)| *x = f32::from(q) * step),
        }
        lanes
    }

    /// Calls `visit(group, columns x 16 rows)` with each group made dense, in order.
    pub fn for_each_group(
        &self,
        columns: usize,
        quantum: i32,
        mut visit: impl FnMut(usize, &[Lanes]) -> Result<()>,
    ) -> Result<()> {
        let (starts, entries) = self.by_group();
        let mut dense = vec![[0.0; GROUP]; columns];
        for (group, range) in starts.windows(2).enumerate() {
            let here = &entries[range[0] as usize..range[1] as usize];
            for &(column, entry) in here {
                dense[column as usize] = self.lanes(entry as usize, quantum);
            }
            visit(group, &dense)?;
            for &(column, _) in here {
                dense[column as usize] = [0.0; GROUP];
            }
        }
        Ok(())
    }

    /// This tile under a coarser rule. Its stated losses hold against the original rows: they add up by the triangle
    /// inequality, since an entry that is rounded twice need not lose at right angles.
    pub fn retruncate(&self, bands: &Bands, quantum: i32, rule: &Truncation) -> Result<Tile> {
        let mut groups = Vec::with_capacity(self.groups());
        self.for_each_group(bands.columns(), quantum, |group, lanes| {
            let mut out = CompressedGroup::default();
            compress_group(lanes, bands, rule, &mut out)?;
            let before = &self.dropped[group * GROUP * bands.count()..];
            for (now, &earlier) in out.dropped.iter_mut().zip(before) {
                *now = bf16_up(f64::from(bf16(*now)) + f64::from(bf16(earlier)));
            }
            groups.push(out);
            Ok(())
        })?;
        Ok(Tile::assemble(self.rows, bands.columns(), rule.width, &groups))
    }
}

/// The group's number in an entry's word.
pub fn group_of(word: u16) -> usize {
    usize::from(word & ((1 << super::tile::GROUP_BITS) - 1))
}

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
pub struct Choice {
    pub threshold: f64,
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
    pub fn add(&mut self, lanes: &[Lanes], bands: &Bands) -> Result<()> {
        assert_eq!(lanes.len(), bands.columns());
        self.groups += 1;
        for band in 0..bands.count() {
            let area = self.weights[band] * self.weights[band];
            for column in bands.range(band) {
                let energy = energy(&lanes[column]);
                if energy == 0.0 {
                    continue;
                }
                let rounded = round(&lanes[column], self.quantum, self.width)?;
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
    pub fn threshold_for(&self, tolerance: f64) -> Result<Choice> {
        if !(0.0..1.0).contains(&tolerance) {
            return Err(Error::input(format!("expected a truncation error from 0 to 1, got {tolerance}")));
        }
        let column = |k: usize| self.scaling[k] + self.bins.iter().map(|bin| bin[k]).sum::<f64>();
        let [mut entries, total, mut lost] = [column(0), column(1), column(2)];
        let per_group = |entries: f64| entries / self.groups.max(1) as f64;
        let error = |lost: f64| if total > 0.0 { (lost.max(0.0) / total).sqrt() } else { 0.0 };
        let mut choice = Choice { threshold: 0.0, error: error(lost), entries_per_group: per_group(entries) };

        // Drop bin after bin, the smallest energies first: a dropped entry loses its energy instead of its rounding.
        for (k, bin) in self.bins.iter().enumerate() {
            lost += bin[1] - bin[2];
            entries -= bin[0];
            if error(lost) > tolerance {
                break;
            }
            let upper = f64::from(OCTAVES.start) + (k + 1) as f64 / f64::from(BINS);
            choice =
                Choice { threshold: (upper / 2.0).exp2(), error: error(lost), entries_per_group: per_group(entries) };
        }
        Ok(choice)
    }
}

/// Surveys raw sample groups in parallel and chooses: see `Survey::threshold_for`.
pub fn threshold_for(
    samples: &[&[Lanes]],
    bands: &Bands,
    quantum: i32,
    width: Width,
    tolerance: f64,
) -> Result<Choice> {
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

fn energy(lanes: &Lanes) -> f64 {
    lanes.iter().map(|&value| f64::from(value) * f64::from(value)).sum()
}

/// The bin of a weighted energy; what lies outside the octaves goes to the ends.
fn bin(energy: f64) -> usize {
    let position = (energy.log2() - f64::from(OCTAVES.start)) * f64::from(BINS);
    (position.max(0.0) as usize).min((OCTAVES.len() as i32 * BINS) as usize - 1)
}
