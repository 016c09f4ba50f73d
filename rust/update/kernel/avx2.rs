//! The walk with AVX2: twelve registers hold a group's sums.

use std::arch::x86_64::*;

use super::{Columns, Integer, Marks, Move, POWERS, Spread, Sums, Target, WORD, portable};
use crate::transport::tile::{GROUP, GROUP_BITS};

/// A group's sums in registers: `[colour][quarter]`.
type Registers = [[__m256d; 4]; 3];

/// How many entries ahead a column is fetched: more streams than the hardware's own prefetcher follows.
const AHEAD: usize = 32;

/// # Safety
/// The processor must have AVX2, FMA and BMI1.
#[target_feature(enable = "avx2,fma,bmi1")]
pub(super) unsafe fn walk<T: Integer, const WORDS: usize>(
    columns: &Columns<'_, T>,
    moves: &[Move],
    marks: &mut Marks<WORDS>,
    mut target: Target<'_>,
) {
    marks.set(columns.starts, columns.words, moves, |entry| {
        fetch(columns.words.as_ptr().wrapping_add(entry));
        fetch(columns.lanes.as_ptr().wrapping_add(entry));
    });
    // One length for both, so that one check serves both.
    let words = columns.words;
    let lanes = &columns.lanes[..words.len()];
    for (group, sums) in target.sums.iter_mut().enumerate() {
        let marked = std::mem::replace(&mut marks.groups[group], [0; WORDS]);
        if target.afresh {
            *sums = Sums::ZERO;
        }
        for (word, &bits) in marked.iter().enumerate().filter(|(_, bits)| **bits != 0) {
            add(sums, words, lanes, &marks.changes[word], &mut marks.cursors[word], bits);
        }
        if let Some(out) = &mut target.out {
            let first = group * 3 * GROUP;
            match out.get_mut(first..first + 3 * GROUP) {
                Some(rows) => publish(sums, rows),
                None => portable::publish(sums, &mut out[first..]),
            }
        }
    }
}

/// A hint that the cache line at `place` will be read; `place` need not be valid.
#[inline(always)]
fn fetch<T>(place: *const T) {
    // SAFETY: a prefetch never faults, and SSE is part of x86-64.
    unsafe { _mm_prefetch::<_MM_HINT_T0>(place.cast()) }
}

#[inline]
#[target_feature(enable = "avx2,fma,bmi1")]
fn load(sums: &Sums) -> Registers {
    // SAFETY: a quarter is four neighbouring lanes of sixteen.
    let quarter = |colour: usize, k: usize| unsafe { _mm256_load_pd(sums.0[colour].as_ptr().add(4 * k)) };
    std::array::from_fn(|colour| std::array::from_fn(|k| quarter(colour, k)))
}

#[inline]
#[target_feature(enable = "avx2,fma,bmi1")]
fn store(sums: &mut Sums, registers: &Registers) {
    for (lanes, quarters) in sums.0.iter_mut().zip(registers) {
        for (k, &quarter) in quarters.iter().enumerate() {
            // SAFETY: as in `load`.
            unsafe { _mm256_store_pd(lanes.as_mut_ptr().add(4 * k), quarter) };
        }
    }
}

/// Adds the moves in `bits` that touch the group the cursors stand at.
///
/// PERF: kept out of line, where its sixteen registers are its own; inlined, five of them were spilled.
#[inline(never)]
#[target_feature(enable = "avx2,fma,bmi1")]
fn add<T: Integer>(
    sums: &mut Sums,
    words: &[u16],
    lanes: &[[T; GROUP]],
    changes: &[Spread; WORD],
    cursors: &mut [u32; WORD],
    mut bits: u64,
) {
    let [mut red, mut green, mut blue] = load(sums);
    while bits != 0 {
        let bit = bits.trailing_zeros() as usize;
        bits &= bits - 1;
        let entry = cursors[bit] as usize;
        cursors[bit] += 1;
        let power = _mm256_set1_pd(POWERS[(words[entry] >> GROUP_BITS) as usize]);
        // SAFETY: a change is spread over four lanes.
        let [r, g, b] =
            [0, 1, 2].map(|k: usize| unsafe { _mm256_mul_pd(_mm256_loadu_pd(changes[bit][k].as_ptr()), power) });
        let lanes = &lanes[entry];
        fetch((lanes as *const [T; GROUP]).wrapping_add(AHEAD));
        for k in 0..4 {
            // SAFETY: the features are those of this function.
            let values = unsafe { T::four(lanes, 4 * k) };
            red[k] = _mm256_fmadd_pd(values, r, red[k]);
            green[k] = _mm256_fmadd_pd(values, g, green[k]);
            blue[k] = _mm256_fmadd_pd(values, b, blue[k]);
        }
    }
    store(sums, &[red, green, blue]);
}

/// Rounds a group's sums, once, into 16 rows of red, green, blue.
#[inline]
#[target_feature(enable = "avx2,fma,bmi1")]
fn publish(sums: &Sums, rows: &mut [f32]) {
    let sums = load(sums);
    for (k, rows) in rows.chunks_exact_mut(12).enumerate() {
        let [r, g, b] = [0, 1, 2].map(|colour: usize| _mm256_cvtpd_ps(sums[colour][k]));
        // r0 g0 r1 g1 and r2 g2 r3 g3, then b in between.
        let (low, high) = (_mm_unpacklo_ps(r, g), _mm_unpackhi_ps(r, g));
        let first = _mm_shuffle_ps::<0b10_00_01_00>(low, _mm_shuffle_ps::<0b10_10_00_00>(b, low));
        let second = _mm_shuffle_ps::<0b01_00_10_00>(_mm_shuffle_ps::<0b01_01_11_11>(low, b), high);
        let third = _mm_shuffle_ps::<0b10_00_10_00>(
            _mm_shuffle_ps::<0b10_10_10_10>(b, high),
            _mm_shuffle_ps::<0b11_11_11_11>(high, b),
        );
        // SAFETY: twelve floats, three times four.
        unsafe {
            _mm_storeu_ps(rows.as_mut_ptr(), first);
            _mm_storeu_ps(rows.as_mut_ptr().add(4), second);
            _mm_storeu_ps(rows.as_mut_ptr().add(8), third);
        }
    }
}

impl Integer for i8 {
    #[inline]
    #[target_feature(enable = "avx2,fma,bmi1")]
    unsafe fn four(lanes: &[i8; GROUP], first: usize) -> __m256d {
        // SAFETY: `first` is 0, 4, 8 or 12.
        let bytes = unsafe { _mm_loadu_si32(lanes.as_ptr().add(first).cast()) };
        _mm256_cvtepi32_pd(_mm_cvtepi8_epi32(bytes))
    }
}

impl Integer for i16 {
    #[inline]
    #[target_feature(enable = "avx2,fma,bmi1")]
    unsafe fn four(lanes: &[i16; GROUP], first: usize) -> __m256d {
        // SAFETY: as for eight bits.
        let words = unsafe { _mm_loadu_si64(lanes.as_ptr().add(first).cast()) };
        _mm256_cvtepi32_pd(_mm_cvtepi16_epi32(words))
    }
}
