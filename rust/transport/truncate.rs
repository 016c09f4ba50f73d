//! Truncation: which entries of M are kept, to how many bits, and exactly how much each row loses.
//!
//! The unit is the entry of a tile: one column in 16 neighbouring rows, T_0j .. T_15j. It costs 18 bytes whether one
//! lane matters or all do, so it is kept by what all lanes, in all channels, give together to the image under a prior of
//! V, one weight a column:
//!
//! ```text
//!     sum_l T_lj^2 * weight_j^2 >= threshold^2,    weight_j = sqrt(E[V_j^2]): for light the root of column j's area
//! ```
//!
//! The first columns are always kept (`Bands::always`). What is kept is rounded to integers times 2^(quantum + shift),
//! with the least shift that fits the width. What a row loses, by dropping and by rounding, is summed per band and stored
//! rounded up: the bound |B - M V| <= sum_b dropped_b ||V_b|| holds.
//!
//! Sums with light are exact while a row's norm is at most 2^27 of its unit (`MAX_SPAN`). Rows of a group share their
//! unit: where one of them is longer (a narrow lobe), all entries of the group take a shift at which it is not. So no row
//! is ever too long to be followed exactly, and none costs another group a bit.
//! (Tried first: one coarser quantum for the whole part, from the norms that a survey sees. The survey may miss the one
//! mirror in the scene, and finds out only when the part is done.)
//!
//! Tried and left: a threshold per single entry (the other lanes are paid for anyway), a threshold on the error of each
//! row (at equal bytes it doubles the error of the image).

use crate::basis::Bands;
use crate::error::{Error, Result};
use crate::twice::compiled_twice;

use super::entry::{GROUP, MAX_SPAN, Rows16, Width, bf16, bf16_up, check_quantum, power_of_two};
#[cfg(target_arch = "x86_64")]
use super::quantize::Avx2;
use super::quantize::{BLOCK, Kernel, Portable, Screened, round};
use super::tile::{CompressedGroup, Tile};

/// Covers the roundings of f32 energies summed in blocks of 64 (at most 66 * 2^-24), of the f64 sum and of the root.
const MARGIN: f64 = 1.0 + 1.0 / 65536.0;
/// Squares below f32's range may vanish: each by less than this.
const UNDERFLOW: f64 = 1.5e-45;

/// The rule by which entries are kept and rounded.
#[derive(Clone, Debug, PartialEq)]
pub struct Truncation {
    /// Entries with a weighted norm below this are dropped; 0 keeps all that does not round to zero.
    pub threshold: f64,
    /// Values are integers times 2^(quantum + shift), shift >= 0.
    pub quantum: i32,
    /// Of the stored integers: what does not fit takes a shift.
    pub width: Width,
    /// One a column: the root of the prior.
    weights: Vec<f64>,
    /// One a column: the least energy (unweighted) that keeps an entry; never zero, so that empty entries always go.
    limits: Vec<f32>,
}

impl Truncation {
    /// The rule for the error of the image under the light prior.
    pub fn new(bands: &Bands, threshold: f64, quantum: i32, width: Width) -> Result<Self> {
        Self::with_weights(area_weights(bands), bands.always, threshold, quantum, width)
    }

    /// The rule for another prior of V: one weight a column, of which the first `always` are never dropped.
    pub fn with_weights(weights: Vec<f64>, always: usize, threshold: f64, quantum: i32, width: Width) -> Result<Self> {
        if !(threshold >= 0.0 && threshold.is_finite()) {
            return Err(Error::input(format!("expected a finite truncation threshold >= 0, got {threshold}")));
        }
        check_quantum(quantum, width)?;
        let limit = |(column, &weight): (usize, &f64)| {
            let limit = if column < always { 0.0 } else { threshold / weight };
            ((limit * limit) as f32).max(f32::MIN_POSITIVE)
        };
        let limits = weights.iter().enumerate().map(limit).collect();
        Ok(Truncation { threshold, quantum, width, weights, limits })
    }

    /// The same with nothing dropped but what rounds to zero, and another width.
    pub fn lossless(&self, width: Width) -> Result<Self> {
        Self::with_weights(self.weights.clone(), 0, 0.0, self.quantum, width)
    }

    /// The root of the prior, one a column.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }
}

/// The light prior: the roots of the areas of the columns that have entries.
pub fn area_weights(bands: &Bands) -> Vec<f64> {
    bands.areas[..bands.stored()].iter().map(|area| area.sqrt()).collect()
}

compiled_twice! {
    /// Compresses 16 rows: `planes[c][j]` is column j of channel c; `beside` is the norm of the longest row in columns that have
    /// no entries, which share the unit. `out` is emptied first and keeps its memory.
    ///
    /// Fails where a coefficient is not finite or too large to be stored.
    pub fn compress_group(
        planes: &[&[Rows16]],
        bands: &Bands,
        rule: &Truncation,
        beside: f64,
        out: &mut CompressedGroup,
    ) -> Result<()> = compress_portable, compress_planes::<Avx2>;
}

/// The path of every other machine; public so that the suite can hold the two against each other.
pub fn compress_portable(
    planes: &[&[Rows16]],
    bands: &Bands,
    rule: &Truncation,
    beside: f64,
    out: &mut CompressedGroup,
) -> Result<()> {
    compress_planes::<Portable>(planes, bands, rule, beside, out)
}

#[inline(always)]
fn compress_planes<K: Kernel>(
    planes: &[&[Rows16]],
    bands: &Bands,
    rule: &Truncation,
    beside: f64,
    out: &mut CompressedGroup,
) -> Result<()> {
    match *planes {
        [one] => compress::<K, 1>([one], bands, rule, beside, out),
        [red, green, blue] => compress::<K, 3>([red, green, blue], bands, rule, beside, out),
        _ => Err(Error::input(format!("expected 1 or 3 channels, found {}", planes.len()))),
    }
}

/// One group; a second time, with a coarser unit, where its longest row spans too many bits.
#[inline(always)]
fn compress<K: Kernel, const C: usize>(
    planes: [&[Rows16]; C],
    bands: &Bands,
    rule: &Truncation,
    beside: f64,
    out: &mut CompressedGroup,
) -> Result<()> {
    let longest = compress_with::<K, C>(planes, bands, rule, 0, out)?;
    let least = least_shift((longest * longest + beside * beside).sqrt(), rule.quantum);
    if least > 0 {
        compress_with::<K, C>(planes, bands, rule, least, out)?;
    }
    out.least = least as u8;
    Ok(())
}

/// The shift from which on a row of this norm spans no more bits than `MAX_SPAN`, with room for what rounding adds to it.
fn least_shift(norm: f64, quantum: i32) -> i32 {
    let exponent = (norm * (1.0 + 1.0 / 64.0)).log2().ceil();
    if norm > 0.0 { (exponent as i32 - MAX_SPAN - quantum).max(0) } else { 0 }
}

/// Keeps what the rule keeps, with shifts from `least` on; returns the norm of the longest stored row.
#[inline(always)]
fn compress_with<K: Kernel, const C: usize>(
    planes: [&[Rows16]; C],
    bands: &Bands,
    rule: &Truncation,
    least: i32,
    out: &mut CompressedGroup,
) -> Result<f64> {
    // Texels have no entries, and their band's norms come with their bits (`sight.rs`).
    let stored = bands.stored();
    assert!(planes.iter().all(|plane| plane.len() == stored) && rule.limits.len() == stored);
    out.columns.clear();
    out.shifts.clear();
    out.values.clear();
    let count = bands.count();
    for norms in [&mut out.kept, &mut out.dropped] {
        norms.clear();
        norms.resize(GROUP * count * C, 0);
    }

    let mut squares = [[0.0; GROUP]; C];
    for band in 0..count {
        let mut norms = Norms::<C>::default();
        let range = bands.range(band);
        if range.start >= stored && bands.texels > 0 {
            continue;
        }
        // What is always kept is a block of its own.
        let head = bands.always.clamp(range.start, range.end);
        for part in [range.start..head, head..range.end] {
            for start in part.clone().step_by(BLOCK) {
                keep_block::<K, C>(planes, start..part.end.min(start + BLOCK), rule, least, &mut norms, out)?;
            }
        }
        for (channel, squares) in squares.iter_mut().enumerate() {
            for (lane, square) in squares.iter_mut().enumerate() {
                let dropped = norms.dropped(channel, lane);
                if !dropped.is_finite() {
                    return Err(Error::input("expected finite transport coefficients, found NaN or infinity"));
                }
                let (kept, place) = (norms.kept[channel][lane], (lane * count + band) * C + channel);
                out.kept[place] = bf16_up(kept.sqrt() * MARGIN);
                out.dropped[place] = bf16_up(dropped);
                *square += kept;
            }
        }
    }
    Ok(squares.as_flattened().iter().fold(0.0, |most: f64, &square| most.max(square)).sqrt())
}

/// Screens up to 64 columns and rounds those that stay.
#[inline(always)]
fn keep_block<K: Kernel, const C: usize>(
    planes: [&[Rows16]; C],
    range: std::ops::Range<usize>,
    rule: &Truncation,
    least: i32,
    norms: &mut Norms<C>,
    out: &mut CompressedGroup,
) -> Result<()> {
    let screened = K::screen(planes.map(|plane| &plane[range.clone()]), &rule.limits[range.clone()]);
    norms.lose_columns(&screened, range.len());
    let mut mask = screened.mask;
    while mask != 0 {
        let column = range.start + mask.trailing_zeros() as usize;
        mask &= mask - 1;
        let rounded = round::<K, C>(planes.map(|plane| &plane[column]), rule.quantum, least, rule.width)?;
        norms.lose_rounding(&rounded.residual);
        if rounded.integers == [[0; GROUP]; C] {
            continue;
        }
        out.columns.push(column as u32);
        out.shifts.push(rounded.shift);
        out.values.extend_from_slice(rounded.integers.as_flattened());
        norms.keep(&rounded.integers, power_of_two(rule.quantum + i32::from(rounded.shift)));
    }
    Ok(())
}

/// Squared norms of each channel and lane in one band.
struct Norms<const C: usize> {
    kept: [[f64; GROUP]; C],
    dropped: [[f64; GROUP]; C],
    /// How many columns were dropped or rounded: the number of squares that may have vanished below f32's range.
    columns: usize,
    /// Bits of everything a lane lost: zero only where it lost exactly nothing.
    bits: [[u32; GROUP]; C],
}

impl<const C: usize> Default for Norms<C> {
    fn default() -> Self {
        Norms { kept: [[0.0; GROUP]; C], dropped: [[0.0; GROUP]; C], columns: 0, bits: [[0; GROUP]; C] }
    }
}

impl<const C: usize> Norms<C> {
    #[inline(always)]
    fn keep(&mut self, integers: &[[i16; GROUP]; C], step: f32) {
        for (sums, integers) in self.kept.iter_mut().zip(integers) {
            for (sum, &integer) in sums.iter_mut().zip(integers) {
                let value = f64::from(f32::from(integer) * step);
                *sum += value * value;
            }
        }
    }

    #[inline(always)]
    fn lose_rounding(&mut self, residual: &[Rows16; C]) {
        self.columns += 1;
        for (channel, residual) in residual.iter().enumerate() {
            for (lane, &lost) in residual.iter().enumerate() {
                self.dropped[channel][lane] += f64::from(lost) * f64::from(lost);
                self.bits[channel][lane] |= lost.to_bits() & 0x7fff_ffff;
            }
        }
    }

    #[inline(always)]
    fn lose_columns(&mut self, screened: &Screened<C>, columns: usize) {
        self.columns += columns;
        for channel in 0..C {
            for lane in 0..GROUP {
                self.dropped[channel][lane] += f64::from(screened.energy[channel][lane]);
                self.bits[channel][lane] |= screened.bits[channel][lane];
            }
        }
    }

    /// Never below the true norm, and zero only where nothing was lost.
    fn dropped(&self, channel: usize, lane: usize) -> f64 {
        if self.bits[channel][lane] == 0 {
            return 0.0;
        }
        (self.dropped[channel][lane] + self.columns as f64 * UNDERFLOW).sqrt() * MARGIN
    }
}

impl Tile {
    /// This tile under a coarser rule. Its stated losses hold against the original rows: they add up by the triangle
    /// inequality, since an entry that is rounded twice need not lose at right angles.
    pub fn retruncate(&self, bands: &Bands, quantum: i32, rule: &Truncation) -> Result<Tile> {
        if self.sight.is_some() && rule.quantum != quantum {
            return Err(Error::input(format!(
                "expected the quantum {quantum} that the texel columns are rounded to, got {}",
                rule.quantum
            )));
        }
        let norms = GROUP * bands.count() * self.channels.count();
        let mut groups = Vec::with_capacity(self.groups());
        self.for_each_group(bands.stored(), quantum, |group, planes| {
            let mut out = CompressedGroup::default();
            compress_group(planes, bands, rule, self.longest_in_texels(group, bands), &mut out)?;
            let before = &self.dropped[group * norms..];
            for (now, &earlier) in out.dropped.iter_mut().zip(before) {
                *now = bf16_up(f64::from(bf16(*now)) + f64::from(bf16(earlier)));
            }
            if self.sight.is_some() {
                // What texels hold stays as it is.
                let place = |place: usize| place % bands.count() == bands.count() - 1;
                let before = self.kept[group * norms..].iter();
                let own = out.kept.iter_mut().zip(before).enumerate().filter(|(at, _)| place(*at));
                own.for_each(|(_, (now, &before))| *now = before);
            }
            groups.push(out);
            Ok(())
        })?;
        let tile = Tile::assemble(self.rows, bands.stored(), self.channels, (rule.width, rule.quantum), &groups);
        Ok(Tile { sight: self.sight.clone(), ..tile })
    }

    /// The norm of the longest of a group's rows in texel columns.
    fn longest_in_texels(&self, group: usize, bands: &Bands) -> f64 {
        if self.sight.is_none() {
            return 0.0;
        }
        let rows = self.kept.chunks_exact(bands.count()).skip(group * GROUP).take(GROUP);
        rows.map(|norms| f64::from(bf16(norms[bands.count() - 1]))).fold(0.0, f64::max)
    }
}
