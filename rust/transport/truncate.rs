//! Truncation: which entries of M are kept, to how many bits, and exactly how much each row loses.
//!
//! The unit is the entry of a tile: one column in 16 neighbouring rows, T_0j .. T_15j. It costs 18 bytes whether one
//! lane matters or all do, so it is kept by what all lanes give together to the image under the light prior E[V_j^2] ~
//! area_j:
//!
//! ```text
//!     sum_l T_lj^2 * weight_b^2 >= threshold^2,    weight_b = sqrt(area of band b's columns)
//! ```
//!
//! The scaling columns are always kept: without them rows no longer sum to the light they receive (the white furnace).
//! What is kept is rounded to integers times 2^(quantum + shift), with the least shift that fits the width. What a row
//! loses, by dropping and by rounding, is summed per band and stored rounded up: the bound |B - M V| <= sum_b dropped_b
//! ||V_b|| holds.
//!
//! Tried and left: a threshold per single entry (the other lanes are paid for anyway), a threshold on the error of each
//! row (at equal bytes it doubles the error of the image).

use crate::basis::Bands;
use crate::error::{Error, Result};

use super::entry::{GROUP, Rows16, Width, bf16, bf16_up, check_quantum, power_of_two};
#[cfg(target_arch = "x86_64")]
use super::quantize::Avx2;
use super::quantize::{BLOCK, Kernel, Portable, Screened, round};
use super::tile::{CompressedGroup, Tile};

/// The scaling functions of the six faces: the first columns of band 0.
pub const SCALING: usize = 6;
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

/// sqrt(area) of each band: the areas of a band's columns are equal.
pub fn area_weights(bands: &Bands) -> Vec<f64> {
    (0..bands.count()).map(|band| bands.areas[bands.range(band).start].sqrt()).collect()
}

/// Compresses 16 rows: `lanes[j]` is column j. `out` is emptied first and keeps its memory.
///
/// Fails where a coefficient is not finite or too large to be stored.
pub fn compress_group(lanes: &[Rows16], bands: &Bands, rule: &Truncation, out: &mut CompressedGroup) -> Result<()> {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") {
        // SAFETY: the instruction set was found.
        return unsafe { compress_avx2(lanes, bands, rule, out) };
    }
    compress_portable(lanes, bands, rule, out)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn compress_avx2(lanes: &[Rows16], bands: &Bands, rule: &Truncation, out: &mut CompressedGroup) -> Result<()> {
    compress::<Avx2>(lanes, bands, rule, out)
}

/// The path of every other machine; public so that the suite can hold the two against each other.
pub fn compress_portable(lanes: &[Rows16], bands: &Bands, rule: &Truncation, out: &mut CompressedGroup) -> Result<()> {
    compress::<Portable>(lanes, bands, rule, out)
}

#[inline(always)]
fn compress<K: Kernel>(lanes: &[Rows16], bands: &Bands, rule: &Truncation, out: &mut CompressedGroup) -> Result<()> {
    assert_eq!(lanes.len(), bands.columns());
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
        let mut norms = Norms::default();
        let range = bands.range(band);
        let head = if band == 0 { SCALING.min(range.end) } else { range.start };

        // The scaling functions are a block of their own, in which only an empty entry is dropped.
        keep_block::<K>(lanes, range.start..head, f32::MIN_POSITIVE, rule, &mut norms, out)?;
        for start in (head..range.end).step_by(BLOCK) {
            keep_block::<K>(lanes, start..range.end.min(start + BLOCK), limit, rule, &mut norms, out)?;
        }
        for lane in 0..GROUP {
            let dropped = norms.dropped(lane);
            if !dropped.is_finite() {
                return Err(Error::input("expected finite transport coefficients, found NaN or infinity"));
            }
            out.kept[lane * count + band] = bf16_up(norms.kept[lane].sqrt() * MARGIN);
            out.dropped[lane * count + band] = bf16_up(dropped);
        }
    }
    Ok(())
}

/// Screens up to 64 columns and rounds those that stay.
#[inline(always)]
fn keep_block<K: Kernel>(
    lanes: &[Rows16],
    range: std::ops::Range<usize>,
    limit: f32,
    rule: &Truncation,
    norms: &mut Norms,
    out: &mut CompressedGroup,
) -> Result<()> {
    let screened = K::screen(&lanes[range.clone()], limit);
    norms.lose_columns(&screened, range.len());
    let mut mask = screened.mask;
    while mask != 0 {
        let column = range.start + mask.trailing_zeros() as usize;
        mask &= mask - 1;
        let rounded = round::<K>(&lanes[column], rule.quantum, rule.width)?;
        norms.lose_rounding(&rounded.residual);
        if rounded.integers == [0; GROUP] {
            continue;
        }
        out.columns.push(column as u32);
        out.shifts.push(rounded.shift);
        out.values.extend_from_slice(&rounded.integers);
        norms.keep(&rounded.integers, power_of_two(rule.quantum + i32::from(rounded.shift)));
    }
    Ok(())
}

/// Squared norms of each lane in one band.
#[derive(Default)]
struct Norms {
    kept: [f64; GROUP],
    dropped: [f64; GROUP],
    /// How many columns were dropped or rounded: the number of squares that may have vanished below f32's range.
    columns: usize,
    /// Bits of everything a lane lost: zero only where it lost exactly nothing.
    bits: [u32; GROUP],
}

impl Norms {
    #[inline(always)]
    fn keep(&mut self, integers: &[i16; GROUP], step: f32) {
        for (sum, &integer) in self.kept.iter_mut().zip(integers) {
            let value = f64::from(f32::from(integer) * step);
            *sum += value * value;
        }
    }

    #[inline(always)]
    fn lose_rounding(&mut self, residual: &Rows16) {
        self.columns += 1;
        for (lane, &lost) in residual.iter().enumerate() {
            self.dropped[lane] += f64::from(lost) * f64::from(lost);
            self.bits[lane] |= lost.to_bits() & 0x7fff_ffff;
        }
    }

    #[inline(always)]
    fn lose_columns(&mut self, screened: &Screened, columns: usize) {
        self.columns += columns;
        for lane in 0..GROUP {
            self.dropped[lane] += f64::from(screened.energy[lane]);
            self.bits[lane] |= screened.bits[lane];
        }
    }

    /// Never below the true norm, and zero only where nothing was lost.
    fn dropped(&self, lane: usize) -> f64 {
        if self.bits[lane] == 0 {
            return 0.0;
        }
        (self.dropped[lane] + self.columns as f64 * UNDERFLOW).sqrt() * MARGIN
    }
}

impl Tile {
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
