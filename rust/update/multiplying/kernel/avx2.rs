//! The walk with AVX2: twelve registers hold a group's sums.

use std::arch::x86_64::*;
use std::ops::Range;

use super::columns::{Columns, Integer, Item, MARKED, Marks, Move, POWERS, Sorted, Spread, Sums, Target};
use super::portable;
use super::together::{self, Lights};
use crate::transport::entry::{GROUP, GROUP_BITS};

/// A group's sums in registers: `[colour][quarter]`.
type Registers = [[__m256d; 4]; 3];

/// How many entries ahead a column is fetched: more streams than the hardware's own prefetcher follows.
const AHEAD: usize = 32;

/// Whether this processor has what the code below needs.
pub(super) fn available() -> bool {
    is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") && is_x86_feature_detected!("bmi1")
}

/// # Safety
/// `available()`.
#[target_feature(enable = "avx2,fma,bmi1")]
pub(super) unsafe fn walk_marked<T: Integer, const C: usize>(
    columns: &Columns<'_, T, C>,
    moves: &[Move],
    marks: &mut Marks,
    mut target: Target<'_>,
) {
    marks.set(columns, moves, |entry| {
        fetch(columns.words.as_ptr().wrapping_add(entry));
        fetch(columns.entries.as_ptr().wrapping_add(entry));
    });
    for (group, sums) in target.sums.iter_mut().enumerate() {
        if target.afresh {
            *sums = Sums::ZERO;
        }
        let bits = std::mem::take(&mut marks.groups[group]);
        if bits != 0 {
            add_marked(sums, columns.words, columns.entries, &marks.changes, &mut marks.cursors, bits);
        }
        publish_to(&mut target.out, group, sums);
    }
}

/// # Safety
/// `available()`.
#[target_feature(enable = "avx2,fma,bmi1")]
pub(super) unsafe fn walk_sorted<T: Integer, const C: usize>(
    columns: &Columns<'_, T, C>,
    moves: &[Move],
    sorted: &mut Sorted,
    mut target: Target<'_>,
) {
    sorted.set(columns, moves);
    let mut from = 0;
    for (group, sums) in target.sums.iter_mut().enumerate() {
        if target.afresh {
            *sums = Sums::ZERO;
        }
        let items = sorted.group(group, &mut from);
        if !items.is_empty() {
            add_sorted(sums, columns.words, columns.entries, moves, &sorted.items, items);
        }
        publish_to(&mut target.out, group, sums);
    }
}

/// # Safety
/// `available()`.
#[target_feature(enable = "avx2,fma,bmi1")]
pub(super) unsafe fn walk_together<T: Integer, const C: usize>(
    columns: &Columns<'_, T, C>,
    sorted: &mut Sorted,
    lights: Lights<'_>,
) {
    let fill = |items: &[Item], from: usize, block: &mut [[[f64; GROUP]; C]]| fill_block(columns, items, from, block);
    let add = |sums: &mut Sums, block: &[[[f64; GROUP]; C]], items: &[Item], changes: &[[f64; 3]], lights: usize| {
        add_block(sums, block, items, changes, lights)
    };
    together::walk(columns, sorted, lights, fill, add);
}

/// The numbers of the entries from a place of a list on; those that follow belong to the next blocks, and are fetched.
#[inline(never)]
#[target_feature(enable = "avx2,fma,bmi1")]
fn fill_block<T: Integer, const C: usize>(
    columns: &Columns<'_, T, C>,
    items: &[Item],
    from: usize,
    block: &mut [[[f64; GROUP]; C]],
) {
    for (k, values) in block.iter_mut().enumerate() {
        let entry = items[from + k].entry as usize;
        if let Some(later) = items.get(from + k + AHEAD) {
            fetch(columns.entries.as_ptr().wrapping_add(later.entry as usize));
            fetch(columns.words.as_ptr().wrapping_add(later.entry as usize));
        }
        let power = _mm256_set1_pd(POWERS[(columns.words[entry] >> GROUP_BITS) as usize]);
        for (values, lanes) in values.iter_mut().zip(&columns.entries[entry]) {
            for quarter in 0..4 {
                // SAFETY: the features are those of this function, and a quarter is four of sixteen lanes.
                unsafe {
                    let four = _mm256_mul_pd(T::four(lanes, 4 * quarter), power);
                    _mm256_storeu_pd(values.as_mut_ptr().add(4 * quarter), four);
                }
            }
        }
    }
}

/// Adds numbers that are worked out, times the change of each: every `lights`-th of `changes`.
#[inline(never)]
#[target_feature(enable = "avx2,fma,bmi1")]
fn add_block<const C: usize>(
    sums: &mut Sums,
    block: &[[[f64; GROUP]; C]],
    items: &[Item],
    changes: &[[f64; 3]],
    lights: usize,
) {
    let mut registers = load(sums);
    for (values, item) in block.iter().zip(items) {
        let change = changes[item.moved as usize * lights].map(|x| _mm256_set1_pd(x));
        let [red, green, blue] = &mut registers;
        for (k, ((red, green), blue)) in red.iter_mut().zip(green).zip(blue).enumerate() {
            // SAFETY: a quarter is four neighbouring lanes of sixteen.
            let four = |channel: usize| unsafe { _mm256_loadu_pd(values[channel % C].as_ptr().add(4 * k)) };
            *red = _mm256_fmadd_pd(four(0), change[0], *red);
            *green = _mm256_fmadd_pd(four(1), change[1], *green);
            *blue = _mm256_fmadd_pd(four(2), change[2], *blue);
        }
    }
    store(sums, &registers);
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

/// Adds the moves in `bits`, each with the entry its cursor stands at.
///
/// PERF: kept out of line, where its sixteen registers are its own; inlined, five of them were spilled.
#[inline(never)]
#[target_feature(enable = "avx2,fma,bmi1")]
fn add_marked<T: Integer, const C: usize>(
    sums: &mut Sums,
    words: &[u16],
    entries: &[[[T; GROUP]; C]],
    changes: &[Spread; MARKED],
    cursors: &mut [u32; MARKED],
    mut bits: u64,
) {
    let mut registers = load(sums);
    while bits != 0 {
        let bit = bits.trailing_zeros() as usize;
        bits &= bits - 1;
        let entry = cursors[bit] as usize;
        cursors[bit] += 1;
        let power = _mm256_set1_pd(POWERS[(words[entry] >> GROUP_BITS) as usize]);
        // SAFETY: a change is spread over four lanes.
        let change = [0, 1, 2].map(|k: usize| unsafe { _mm256_loadu_pd(changes[bit][k].as_ptr()) });
        let lanes = &entries[entry];
        fetch((lanes as *const [[T; GROUP]; C]).wrapping_add(AHEAD));
        add_entry(&mut registers, lanes, change.map(|change| _mm256_mul_pd(change, power)));
    }
    store(sums, &registers);
}

/// Adds the entries `items[which]`; those that follow belong to the next groups, and are fetched.
#[inline(never)]
#[target_feature(enable = "avx2,fma,bmi1")]
fn add_sorted<T: Integer, const C: usize>(
    sums: &mut Sums,
    words: &[u16],
    entries: &[[[T; GROUP]; C]],
    moves: &[Move],
    items: &[Item],
    which: Range<usize>,
) {
    let mut registers = load(sums);
    for k in which {
        let Item { entry, moved } = items[k];
        if let Some(later) = items.get(k + AHEAD) {
            fetch(entries.as_ptr().wrapping_add(later.entry as usize));
        }
        let power = POWERS[(words[entry as usize] >> GROUP_BITS) as usize];
        let change = moves[moved as usize].change.map(|x| _mm256_set1_pd(x * power));
        add_entry(&mut registers, &entries[entry as usize], change);
    }
    store(sums, &registers);
}

/// Sixteen values, of one channel or of three, times a change in three colours.
#[inline]
#[target_feature(enable = "avx2,fma,bmi1")]
fn add_entry<T: Integer, const C: usize>(registers: &mut Registers, lanes: &[[T; GROUP]; C], change: [__m256d; 3]) {
    let [red, green, blue] = registers;
    for (k, ((red, green), blue)) in red.iter_mut().zip(green).zip(blue).enumerate() {
        // SAFETY: the features are those of this function.
        let values = unsafe { T::four(&lanes[0], 4 * k) };
        // One channel is loaded once and serves all colours.
        let (second, third) = if C == 1 {
            (values, values)
        } else {
            // SAFETY: as above.
            unsafe { (T::four(&lanes[1 % C], 4 * k), T::four(&lanes[2 % C], 4 * k)) }
        };
        *red = _mm256_fmadd_pd(values, change[0], *red);
        *green = _mm256_fmadd_pd(second, change[1], *green);
        *blue = _mm256_fmadd_pd(third, change[2], *blue);
    }
}

/// Writes a group's rows, where the walk is the frame's last.
#[inline]
#[target_feature(enable = "avx2,fma,bmi1")]
fn publish_to(out: &mut Option<&mut [f32]>, group: usize, sums: &Sums) {
    if let Some(out) = out {
        let first = group * 3 * GROUP;
        match out.get_mut(first..first + 3 * GROUP) {
            Some(rows) => publish(sums, rows),
            None => portable::publish(sums, &mut out[first..]),
        }
    }
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
