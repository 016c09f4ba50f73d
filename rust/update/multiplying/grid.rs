//! The dyadic grid on which coefficients lie, so that every sum of B = M V is exact in f64.
//!
//! Values of M are integers times 2^quantum. Where all coefficients are integers times 2^exponent, every product, and
//! so every partial sum over any subset of terms, is an integer times 2^(quantum + exponent). By Cauchy-Schwarz no such
//! sum exceeds the norm of the row times the norm of the coefficients in it. While that stays within 2^53 units, f64
//! holds every sum exactly: no order, no thread and no history can leave a trace.
//!
//! An update passes through mixtures of the coefficients applied and the new ones; their norm, and that of the change,
//! is at most the sum of both norms. That sum is what `holds` is asked about.

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::transport::entry::{GROUP, MAX_SPAN, group_of, nearest_integer, shift_of};
use crate::transport::{Tile, TransportMatrix};
use crate::twice::compiled_twice;

/// Bits of an f64's significand.
const SIGNIFICAND: i32 = 53;
/// The finest and the coarsest spacing, far from where f64 itself ends.
pub(super) const SPACINGS: std::ops::RangeInclusive<i32> = -800..=800;
/// Bits by which a follower's light may grow before its grid must be changed, which costs a whole product.
pub(in crate::update) const HEADROOM: i32 = 6;
/// A second stage's grid changes with the light's norm in steps of 2^4, and has room for what was and what is to be.
const STEP_BITS: i32 = 2;
const SECOND_HEADROOM: i32 = 3;
/// What light put together of two parts may be longer than their norm, with a little for rounding.
const MERGED: f64 = 1.5;
/// Below so many bits of the light's norm the grid would be an approximation of its own.
const FEWEST_BITS: i32 = 20;

// What truncation stores is what a follower can multiply exactly.
const _: () = assert!(SIGNIFICAND - HEADROOM - FEWEST_BITS == MAX_SPAN);

/// Multiples of 2^exponent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Of the spacing: a coefficient on the grid is an integer times 2^exponent.
    pub exponent: i32,
    /// Sums are exact while the norms of the coefficients applied and of the new ones add up to no more than this.
    pub limit: f64,
}

impl Grid {
    /// The finest grid on which light may grow to 2^headroom times `norm` (applied and new together).
    ///
    /// `norm` is the largest norm of a colour. The grid follows its exponent, so a light times a power of two lies on
    /// the grid times that power. An update needs one bit of headroom beyond growth; a single product needs one.
    pub fn for_light(norm: f64, span: Span, headroom: i32) -> Result<Grid> {
        if !(norm.is_finite() && norm < power_of_two(*SPACINGS.end())) {
            return Err(Error::input(format!("light must be finite and of sane size, but its norm is {norm:e}")));
        }
        let Span(span) = span;
        if SIGNIFICAND - headroom - span < FEWEST_BITS {
            return Err(Error::input(format!(
                "exact sums need a transport whose rows span at most {} bits, but these span {span}",
                SIGNIFICAND - headroom - FEWEST_BITS
            )));
        }
        let limit = exponent_above(norm) + headroom;
        let exponent = (limit + span - SIGNIFICAND).clamp(*SPACINGS.start(), *SPACINGS.end());
        Ok(Grid { exponent, limit: power_of_two(exponent - span + SIGNIFICAND) })
    }

    /// The grid of a second stage, whose light is the response of the first to a light of this norm: at most `gain` times
    /// it. It depends on nothing but that norm, in steps of 2^4, so that a follower with any history and a fresh product
    /// round alike.
    pub fn for_second(norm: f64, gain: f64, span: Span) -> Result<Grid> {
        let step = exponent_above(norm).div_euclid(1 << STEP_BITS) + 1;
        let most = power_of_two((step << STEP_BITS).clamp(*SPACINGS.start(), *SPACINGS.end()));
        Grid::for_light(gain * most, span, SECOND_HEADROOM)
    }

    /// The grid of light that is put together in wavelets, of what was applied in wavelets and texels with this norm: it
    /// depends on nothing else. Both parts together are no longer than sqrt(2) times that.
    pub fn for_merged(norm: f64, span: Span) -> Result<Grid> {
        Grid::for_second(norm, MERGED, span)
    }

    /// Whether sums stay exact for coefficients whose norms, applied and new, add up to `norms`.
    pub fn holds(&self, norms: f64) -> bool {
        norms <= self.limit
    }

    /// The nearest multiple of the spacing, ties to even. What lies on a coarser grid is left as it is; so is zero, and
    /// `quantise(-x) == -quantise(x)`.
    pub fn quantise(&self, x: f64) -> f64 {
        round(x * power_of_two(-self.exponent)) * power_of_two(self.exponent)
    }

    /// `quantise` for coefficients in three colours.
    pub fn quantise_all(&self, coefficients: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let mut quantised = Vec::new();
        self.quantise_into(coefficients, &mut quantised);
        quantised
    }

    /// `quantise_all` into a vector that is used again.
    pub fn quantise_into(&self, coefficients: &[[f64; 3]], quantised: &mut Vec<[f64; 3]>) {
        quantised.resize(coefficients.len(), [0.0; 3]);
        let (units, spacing) = (power_of_two(-self.exponent), power_of_two(self.exponent));
        let (numbers, rounded) = (coefficients.as_flattened(), quantised.as_flattened_mut());
        round_all(numbers, units, spacing, rounded);
    }
}

compiled_twice! {
    fn round_all(numbers: &[f64], units: f64, spacing: f64, rounded: &mut [f64]) = round_any;

    /// Sums of squares, in each colour, of `light - values`, of `light` and of `values`.
    pub(super) fn squares(light: &[[f64; 3]], values: &[[f64; 3]]) -> [[f64; 3]; 3] = squares_any;
}

#[inline(always)]
fn round_any(numbers: &[f64], units: f64, spacing: f64, rounded: &mut [f64]) {
    for (rounded, x) in rounded.iter_mut().zip(numbers) {
        *rounded = round(x * units) * spacing;
    }
}

/// How many bits the rows of M span, from their unit to their norm: what the grid of the light follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Span(pub i32);

impl Span {
    /// Of a whole matrix. Where its longest row spans no more than `MAX_SPAN` from the quantum, all rows are taken to span
    /// as much; else their groups have units of their own (`transport/truncate.rs`), which are looked up.
    pub fn of(matrix: &TransportMatrix) -> Span {
        let longest = matrix.tiles.par_iter().map(|tile| matrix.row_squares(tile).fold(0.0, f64::max));
        let span = exponent_of_row(longest.reduce(|| 0.0, f64::max), matrix.quantum) - matrix.quantum;
        if span <= MAX_SPAN {
            return Span(span);
        }
        let spans = matrix.tiles.par_iter().map(|tile| span_of_groups(matrix, tile));
        Span(spans.reduce(|| MAX_SPAN, i32::max))
    }
}

/// The least e with norm <= 2^e; a row that is not empty is no smaller than one unit.
fn exponent_of_row(square: f64, quantum: i32) -> i32 {
    exponent_above(above(square.sqrt()).max(power_of_two(quantum)))
}

/// The most bits that a group's longest row spans from the unit that the group's entries share.
fn span_of_groups(matrix: &TransportMatrix, tile: &Tile) -> i32 {
    // Texel columns take part, whatever entries there are.
    let of_texels = |group| tile.sight.as_ref().map_or(i32::MAX, |sight| sight.shift(group));
    let mut least: Vec<i32> = (0..tile.groups()).map(of_texels).collect();
    for &word in tile.words.iter() {
        let least = &mut least[group_of(word)];
        *least = shift_of(word).min(*least);
    }
    let squares: Vec<f64> = matrix.row_squares(tile).collect();
    let groups = squares.chunks(GROUP * matrix.channels.count()).zip(least).filter(|(_, least)| *least < i32::MAX);
    let span = |(squares, least): (&[f64], i32)| {
        let unit = matrix.quantum + least;
        exponent_of_row(squares.iter().fold(0.0, |most, &square| most.max(square)), unit) - unit
    };
    groups.map(span).max().unwrap_or(0)
}

/// The largest norm of a colour, never below the true value; not finite where a coefficient is not.
pub fn light_norm(coefficients: &[[f64; 3]]) -> f64 {
    norm_of_squares([squares(coefficients, coefficients)[1]])
}

/// The largest norm of a colour, from parts of its sum of squares.
pub(super) fn norm_of_squares(parts: impl IntoIterator<Item = [f64; 3]>) -> f64 {
    let squares = parts.into_iter().fold([0.0; 3], |sums, part| std::array::from_fn(|c| sums[c] + part[c]));
    // `max` would pass over a NaN.
    if squares.iter().all(|square: &f64| square.is_finite()) {
        above(squares.into_iter().fold(0.0, f64::max).sqrt())
    } else {
        f64::INFINITY
    }
}

/// Four columns of three colours are added at a time.
const LANES: usize = 12;

/// Sums of their own for each lane: a fixed order that vectorises.
#[inline(always)]
fn squares_any(light: &[[f64; 3]], values: &[[f64; 3]]) -> [[f64; 3]; 3] {
    let mut sums = [[0.0; LANES]; 3];
    let (light, last_light) = light.as_flattened().as_chunks::<LANES>();
    let (values, last_values) = values.as_flattened().as_chunks::<LANES>();
    // What does not fill the lanes is padded with zeros, which add nothing.
    let (mut padded_light, mut padded_values) = ([0.0; LANES], [0.0; LANES]);
    padded_light[..last_light.len()].copy_from_slice(last_light);
    padded_values[..last_values.len()].copy_from_slice(last_values);
    for (light, values) in light.iter().zip(values) {
        add_squares(&mut sums, light, values);
    }
    add_squares(&mut sums, &padded_light, &padded_values);
    sums.map(|lanes| std::array::from_fn(|c| (lanes[c] + lanes[c + 3]) + (lanes[c + 6] + lanes[c + 9])))
}

#[inline(always)]
fn add_squares(sums: &mut [[f64; LANES]; 3], light: &[f64; LANES], values: &[f64; LANES]) {
    for lane in 0..LANES {
        let (new, old) = (light[lane], values[lane]);
        sums[0][lane] += (new - old) * (new - old);
        sums[1][lane] += new * new;
        sums[2][lane] += old * old;
    }
}

/// Moves the result of a sum of up to 2^20 squares, and of a few steps more, above its true value.
pub(in crate::update) fn above(x: f64) -> f64 {
    x * (1.0 + power_of_two(-30))
}

/// The nearest integer, ties to even, of any number.
#[inline(always)]
pub(super) fn round(x: f64) -> f64 {
    if x.abs() < (1u64 << 51) as f64 { nearest_integer(x) } else { x.round_ties_even() }
}

/// The least e with x <= 2^e, for finite x >= 0; the finest spacing for zero.
pub(super) fn exponent_above(x: f64) -> i32 {
    let bits = x.to_bits();
    let exponent = ((bits >> 52) & 0x7ff) as i32 - 1023;
    let rounded_up = exponent + (bits & ((1 << 52) - 1) != 0) as i32;
    rounded_up.max(*SPACINGS.start())
}

/// 2^exponent, for exponents of normal numbers.
pub(in crate::update) fn power_of_two(exponent: i32) -> f64 {
    debug_assert!((-1022..=1023).contains(&exponent));
    f64::from_bits(((exponent + 1023) as u64) << 52)
}
