//! The two inner loops of truncation: screening columns by energy, and rounding 16 lanes to integers.
//!
//! Each is written twice, in plain Rust and for AVX2. Sums run in the same order and without fused multiplication, so
//! that the bits agree.

use crate::error::{Error, Result};

use super::entry::{GROUP, MAX_EXPONENT, Rows16, Width, integer_bits, max_step, power_of_two};

/// Columns screened at a time: one bit each, and as many f32 sums between two flushes into f64.
pub const BLOCK: usize = 64;
/// The largest shift that an entry's word can hold (6 bits).
const MAX_SHIFT: i32 = 63;

/// What screening drops, channel by channel and lane by lane.
pub struct Screened<const C: usize> {
    /// Bit k is set where column k stays.
    pub mask: u64,
    /// Squares of the others.
    pub energy: [Rows16; C],
    /// Bits of the others, signs aside: zero only where a lane loses exactly nothing.
    pub bits: [[u32; GROUP]; C],
}

/// An entry as integers, and what rounding left over.
pub struct Rounded<const C: usize> {
    /// Of the entry: its values are integers times 2^(quantum + shift).
    pub shift: u8,
    /// Channel by channel and lane by lane.
    pub integers: [[i16; GROUP]; C],
    /// What was, less what is stored.
    pub residual: [Rows16; C],
}

/// An instruction set.
pub trait Kernel {
    /// Which of up to 64 columns have an energy, over all channels, of at least their limit; and what the others hold.
    fn screen<const C: usize>(planes: [&[Rows16]; C], limits: &[f32]) -> Screened<C>;
    /// The largest magnitude of 16 lanes.
    fn largest(lanes: &Rows16) -> f32;
    /// Rounds 16 values to nearest (ties to even) multiples of 2^exponent. They must fit into 16 bits.
    fn nearest(lanes: &Rows16, exponent: i32) -> ([i16; GROUP], Rows16);
}

/// Rounds an entry to multiples of 2^(quantum + shift), with the least shift from `least` on at which all numbers fit the
/// width. The channels share it.
#[inline(always)]
pub fn round<K: Kernel, const C: usize>(
    entry: [&Rows16; C],
    quantum: i32,
    least: i32,
    width: Width,
) -> Result<Rounded<C>> {
    let mut largest = K::largest(entry[0]);
    for plane in &entry[1..] {
        largest = largest.max(K::largest(plane));
    }
    let shift = least_shift(largest * power_of_two(-quantum), width).max(least);
    if !largest.is_finite() || shift > MAX_SHIFT || quantum + shift > max_step(width) {
        return Err(too_large(largest, quantum, width));
    }
    let mut rounded = Rounded { shift: shift as u8, integers: [[0; GROUP]; C], residual: [[0.0; GROUP]; C] };
    for (channel, plane) in entry.into_iter().enumerate() {
        (rounded.integers[channel], rounded.residual[channel]) = K::nearest(plane, quantum + shift);
    }
    Ok(rounded)
}

#[cold]
fn too_large(largest: f32, quantum: i32, width: Width) -> Error {
    let most = MAX_EXPONENT.min(quantum + MAX_SHIFT + integer_bits(width));
    Error::input(format!("expected transport coefficients below 2^{most}, found {largest}"))
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

/// Plain Rust, for any machine.
pub struct Portable;

impl Kernel for Portable {
    #[inline(always)]
    fn screen<const C: usize>(planes: [&[Rows16]; C], limits: &[f32]) -> Screened<C> {
        let mut screened = Screened { mask: 0, energy: [[0.0; GROUP]; C], bits: [[0; GROUP]; C] };
        for (k, &limit) in limits.iter().enumerate() {
            let squares = planes.map(|plane| plane[k].map(|value| value * value));
            // A number that is not one compares false: it is dropped, and found in the norms.
            if sum(&squares) >= limit {
                screened.mask |= 1 << k;
                continue;
            }
            for channel in 0..C {
                for l in 0..GROUP {
                    screened.energy[channel][l] += squares[channel][l];
                    screened.bits[channel][l] |= planes[channel][k][l].to_bits() & 0x7fff_ffff;
                }
            }
        }
        screened
    }

    #[inline(always)]
    fn largest(lanes: &Rows16) -> f32 {
        lanes.iter().fold(0.0f32, |most, value| most.max(value.abs()))
    }

    #[inline(always)]
    fn nearest(lanes: &Rows16, exponent: i32) -> ([i16; GROUP], Rows16) {
        // Scales are powers of two: only the rounding to an integer is inexact, and the residual is exact in f32.
        let nearest = lanes.map(|value| (value * power_of_two(-exponent)).round_ties_even());
        let step = power_of_two(exponent);
        (nearest.map(|value| value as i16), std::array::from_fn(|l| lanes[l] - nearest[l] * step))
    }
}

/// The sum of 16 numbers, over all channels, as a tree of halves: one order on every machine.
#[inline(always)]
fn sum<const C: usize>(x: &[Rows16; C]) -> f32 {
    let mut a: [f32; 8] = std::array::from_fn(|l| x[0][l] + x[0][l + 8]);
    for x in &x[1..] {
        (0..8).for_each(|l| a[l] += x[l] + x[l + 8]);
    }
    let b: [f32; 4] = std::array::from_fn(|l| a[l] + a[l + 4]);
    (b[0] + b[2]) + (b[1] + b[3])
}

/// AVX2. PERF: 24,576 columns are screened in a third of the time of plain Rust.
#[cfg(target_arch = "x86_64")]
pub struct Avx2;

#[cfg(target_arch = "x86_64")]
impl Kernel for Avx2 {
    #[inline(always)]
    fn screen<const C: usize>(planes: [&[Rows16]; C], limits: &[f32]) -> Screened<C> {
        // SAFETY: `compress_group` picks this kernel only where AVX2 was found.
        unsafe { avx2::screen(planes, limits) }
    }

    #[inline(always)]
    fn largest(lanes: &Rows16) -> f32 {
        // SAFETY: as above.
        unsafe { avx2::largest(lanes) }
    }

    #[inline(always)]
    fn nearest(lanes: &Rows16, exponent: i32) -> ([i16; GROUP], Rows16) {
        // SAFETY: as above.
        unsafe { avx2::nearest(lanes, exponent) }
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::*;

    use super::{GROUP, Rows16, Screened, power_of_two};

    const NEAREST: i32 = _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC;

    #[inline]
    #[target_feature(enable = "avx2")]
    fn load(lanes: &Rows16) -> (__m256, __m256) {
        // SAFETY: 16 floats are there; loads need no alignment.
        unsafe { (_mm256_loadu_ps(lanes.as_ptr()), _mm256_loadu_ps(lanes.as_ptr().add(8))) }
    }

    #[inline]
    #[target_feature(enable = "avx2")]
    fn store(low: __m256, high: __m256) -> Rows16 {
        let mut lanes = [0.0; GROUP];
        // SAFETY: there is room for 16 floats; stores need no alignment.
        unsafe {
            _mm256_storeu_ps(lanes.as_mut_ptr(), low);
            _mm256_storeu_ps(lanes.as_mut_ptr().add(8), high);
        }
        lanes
    }

    /// Squares and bits of what is dropped: lanes 0 to 7, lanes 8 to 15.
    #[derive(Clone, Copy)]
    struct Lost {
        energy: (__m256, __m256),
        bits: (__m256, __m256),
    }

    impl Lost {
        /// Adds a column and returns the sums of its squares in lanes l and l + 8: `a` of the tree in `sum`.
        #[inline]
        #[target_feature(enable = "avx2")]
        fn add(&mut self, lanes: &Rows16) -> __m256 {
            let (low, high) = load(lanes);
            let squares = (_mm256_mul_ps(low, low), _mm256_mul_ps(high, high));
            self.energy = (_mm256_add_ps(self.energy.0, squares.0), _mm256_add_ps(self.energy.1, squares.1));
            self.bits = (_mm256_or_ps(self.bits.0, low), _mm256_or_ps(self.bits.1, high));
            _mm256_add_ps(squares.0, squares.1)
        }
    }

    /// Adds those of eight columns that go; returns a bit for each that stays.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn screen_eight<const C: usize>(lost: &mut [Lost; C], columns: [&[Rows16; 8]; C], limits: __m256) -> u64 {
        // Most columns go: drop all eight, and look afterwards whether one should have stayed.
        let before = *lost;
        let mut sums: [__m256; 8] = std::array::from_fn(|k| lost[0].add(&columns[0][k]));
        for channel in 1..C {
            for k in 0..8 {
                sums[k] = _mm256_add_ps(sums[k], lost[channel].add(&columns[channel][k]));
            }
        }
        let keep = _mm256_cmp_ps::<_CMP_GE_OQ>(energies(sums), limits);
        let keep = _mm256_movemask_ps(keep) as u64;
        if keep != 0 {
            *lost = before;
            for k in (0..8).filter(|k| keep & 1 << k == 0) {
                for channel in 0..C {
                    lost[channel].add(&columns[channel][k]);
                }
            }
        }
        keep
    }

    /// The energies of eight columns: the tree of `sum`, transposed as it goes.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn energies(a: [__m256; 8]) -> __m256 {
        // b: halves of 8; columns k and k + 4 share a register.
        let [b0, b1, b2, b3] = std::array::from_fn(|k| {
            let (x, y) = (a[k], a[k + 4]);
            _mm256_add_ps(_mm256_permute2f128_ps::<0x20>(x, y), _mm256_permute2f128_ps::<0x31>(x, y))
        });
        // Halves of 4, two columns a half register; then of 2, four.
        let c01 = _mm256_add_ps(_mm256_shuffle_ps::<0x44>(b0, b1), _mm256_shuffle_ps::<0xee>(b0, b1));
        let c23 = _mm256_add_ps(_mm256_shuffle_ps::<0x44>(b2, b3), _mm256_shuffle_ps::<0xee>(b2, b3));
        _mm256_add_ps(_mm256_shuffle_ps::<0x88>(c01, c23), _mm256_shuffle_ps::<0xdd>(c01, c23))
    }

    /// `Kernel::screen`, eight columns at a time.
    #[inline]
    #[target_feature(enable = "avx2")]
    pub fn screen<const C: usize>(planes: [&[Rows16]; C], limits: &[f32]) -> Screened<C> {
        let zero = _mm256_setzero_ps();
        let mut lost = [Lost { energy: (zero, zero), bits: (zero, zero) }; C];
        let (eights, rest) = limits.as_chunks::<8>();
        let of = planes.map(|plane| plane.as_chunks::<8>());
        let mut mask = 0;
        for (number, limits) in eights.iter().enumerate() {
            // SAFETY: eight floats are there; loads need no alignment.
            let limits = unsafe { _mm256_loadu_ps(limits.as_ptr()) };
            mask |= screen_eight(&mut lost, of.map(|(eights, _)| &eights[number]), limits) << (8 * number);
        }
        if !rest.is_empty() {
            // Empty columns add nothing and are dropped.
            let mut columns = [[[0.0; GROUP]; 8]; C];
            for (columns, (_, rest)) in columns.iter_mut().zip(of) {
                columns[..rest.len()].copy_from_slice(rest);
            }
            let mut few = [f32::INFINITY; 8];
            few[..rest.len()].copy_from_slice(rest);
            // SAFETY: as above.
            let few = unsafe { _mm256_loadu_ps(few.as_ptr()) };
            mask |= screen_eight(&mut lost, columns.each_ref(), few) << (8 * eights.len());
        }
        let mut screened = Screened { mask, energy: [[0.0; GROUP]; C], bits: [[0; GROUP]; C] };
        for (channel, lost) in lost.into_iter().enumerate() {
            screened.energy[channel] = store(lost.energy.0, lost.energy.1);
            screened.bits[channel] = store(lost.bits.0, lost.bits.1).map(|value| value.to_bits() & 0x7fff_ffff);
        }
        screened
    }

    /// `Kernel::largest`, sixteen lanes at a time.
    #[inline]
    #[target_feature(enable = "avx2")]
    pub fn largest(lanes: &Rows16) -> f32 {
        let (low, high) = load(lanes);
        let sign = _mm256_set1_ps(-0.0);
        let a = _mm256_max_ps(_mm256_andnot_ps(sign, low), _mm256_andnot_ps(sign, high));
        let b = _mm256_max_ps(a, _mm256_permute2f128_ps::<1>(a, a));
        let c = _mm256_max_ps(b, _mm256_permute_ps::<0b01_00_11_10>(b));
        _mm256_cvtss_f32(_mm256_max_ps(c, _mm256_permute_ps::<0b10_11_00_01>(c)))
    }

    /// `Kernel::nearest`, sixteen lanes at a time.
    #[inline]
    #[target_feature(enable = "avx2")]
    pub fn nearest(lanes: &Rows16, exponent: i32) -> ([i16; GROUP], Rows16) {
        let (low, high) = load(lanes);
        let (inverse, step) = (_mm256_set1_ps(power_of_two(-exponent)), _mm256_set1_ps(power_of_two(exponent)));
        let a = _mm256_round_ps::<NEAREST>(_mm256_mul_ps(low, inverse));
        let b = _mm256_round_ps::<NEAREST>(_mm256_mul_ps(high, inverse));

        // Packing works in halves of 128 bits: put the quarters back in order.
        let packed = _mm256_packs_epi32(_mm256_cvttps_epi32(a), _mm256_cvttps_epi32(b));
        let ordered = _mm256_permute4x64_epi64::<0b11_01_10_00>(packed);
        let mut integers = [0; GROUP];
        // SAFETY: 32 bytes have room for 16 integers.
        unsafe { _mm256_storeu_si256(integers.as_mut_ptr().cast(), ordered) };
        let residual = store(_mm256_sub_ps(low, _mm256_mul_ps(a, step)), _mm256_sub_ps(high, _mm256_mul_ps(b, step)));
        (integers, residual)
    }
}
