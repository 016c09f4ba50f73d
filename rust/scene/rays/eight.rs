//! Eight f32 lanes: one set of operations, two machines. No fused multiply-add anywhere, so that AVX2 and the portable
//! path give the same bits.

/// Eight lanes of f32. Comparisons give one bit a lane.
pub(super) trait Eight: Copy {
    fn splat(value: f32) -> Self;
    fn load(from: &[f32; 8]) -> Self;
    fn store(self, to: &mut [f32; 8]);
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    fn min(self, other: Self) -> Self;
    fn max(self, other: Self) -> Self;
    fn abs(self) -> Self;
    fn neg(self) -> Self;
    /// Bit l is set where `self[l] <= other[l]`.
    fn le(self, other: Self) -> u32;
    /// Bit l is set where `self[l] < other[l]`.
    fn lt(self, other: Self) -> u32;
    /// Lane l of `yes` where bit l is set, else of `no`.
    fn select(bits: u32, yes: Self, no: Self) -> Self;
    /// Lane l of the result is the least lane of `of[l]`.
    fn least_each(of: &[Self; 8]) -> Self;

    /// Asks for memory that will be read soon.
    fn prefetch<T>(of: &T);

    #[inline(always)]
    fn dot(x: Self, y: Self, z: Self, axis: &[Self; 3]) -> Self {
        x.mul(axis[0]).add(y.mul(axis[1])).add(z.mul(axis[2]))
    }
}

/// The portable lanes: what the compiler makes of plain loops.
#[derive(Clone, Copy)]
pub(super) struct Portable([f32; 8]);

impl Portable {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Portable(std::array::from_fn(|lane| f(self.0[lane], other.0[lane])))
    }

    #[inline(always)]
    fn bits(self, other: Self, f: impl Fn(f32, f32) -> bool) -> u32 {
        (0..8).fold(0, |bits, lane| bits | (f(self.0[lane], other.0[lane]) as u32) << lane)
    }
}

impl Eight for Portable {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Portable([value; 8])
    }
    #[inline(always)]
    fn load(from: &[f32; 8]) -> Self {
        Portable(*from)
    }
    #[inline(always)]
    fn store(self, to: &mut [f32; 8]) {
        *to = self.0;
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Portable(self.0.map(f32::abs))
    }
    #[inline(always)]
    fn neg(self) -> Self {
        Portable(self.0.map(|a| -a))
    }
    #[inline(always)]
    fn le(self, other: Self) -> u32 {
        self.bits(other, |a, b| a <= b)
    }
    #[inline(always)]
    fn lt(self, other: Self) -> u32 {
        self.bits(other, |a, b| a < b)
    }
    #[inline(always)]
    fn select(bits: u32, yes: Self, no: Self) -> Self {
        Portable(std::array::from_fn(|lane| if bits >> lane & 1 == 1 { yes.0[lane] } else { no.0[lane] }))
    }
    #[inline(always)]
    fn prefetch<T>(_: &T) {}
    #[inline(always)]
    fn least_each(of: &[Self; 8]) -> Self {
        Portable(std::array::from_fn(|lane| of[lane].0.iter().fold(f32::INFINITY, |a, &b| if a < b { a } else { b })))
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) use avx2::Avx2;

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::*;

    use super::Eight;

    /// AVX2 lanes. Values of this type are made inside functions alone that are reached after
    /// `is_x86_feature_detected!("avx2")`: whoever has one, has AVX2.
    #[derive(Clone, Copy)]
    pub(in crate::scene) struct Avx2(__m256);

    impl Eight for Avx2 {
        #[inline(always)]
        fn splat(value: f32) -> Self {
            // SAFETY: values are made where AVX2 was found alone.
            unsafe { Avx2(_mm256_set1_ps(value)) }
        }
        #[inline(always)]
        fn load(from: &[f32; 8]) -> Self {
            // SAFETY: as above; eight floats are there, and loads need no alignment.
            unsafe { Avx2(_mm256_loadu_ps(from.as_ptr())) }
        }
        #[inline(always)]
        fn store(self, to: &mut [f32; 8]) {
            // SAFETY: a value is there, and so is AVX2; there is room for eight floats, and stores need no alignment.
            unsafe { _mm256_storeu_ps(to.as_mut_ptr(), self.0) }
        }
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            // SAFETY: a value is there, and so is AVX2.
            unsafe { Avx2(_mm256_add_ps(self.0, other.0)) }
        }
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            // SAFETY: a value is there, and so is AVX2.
            unsafe { Avx2(_mm256_sub_ps(self.0, other.0)) }
        }
        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            // SAFETY: a value is there, and so is AVX2.
            unsafe { Avx2(_mm256_mul_ps(self.0, other.0)) }
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            // SAFETY: a value is there, and so is AVX2.
            unsafe { Avx2(_mm256_min_ps(self.0, other.0)) }
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            // SAFETY: a value is there, and so is AVX2.
            unsafe { Avx2(_mm256_max_ps(self.0, other.0)) }
        }
        #[inline(always)]
        fn abs(self) -> Self {
            // SAFETY: a value is there, and so is AVX2.
            unsafe { Avx2(_mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0)) }
        }
        #[inline(always)]
        fn neg(self) -> Self {
            // SAFETY: a value is there, and so is AVX2.
            unsafe { Avx2(_mm256_xor_ps(_mm256_set1_ps(-0.0), self.0)) }
        }
        #[inline(always)]
        fn le(self, other: Self) -> u32 {
            // SAFETY: a value is there, and so is AVX2.
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0)) as u32 }
        }
        #[inline(always)]
        fn lt(self, other: Self) -> u32 {
            // SAFETY: a value is there, and so is AVX2.
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0)) as u32 }
        }
        #[inline(always)]
        fn select(bits: u32, yes: Self, no: Self) -> Self {
            // SAFETY: values are there, and so is AVX2.
            unsafe {
                let lane = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
                let set = _mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32(bits as i32), lane), lane);
                Avx2(_mm256_blendv_ps(no.0, yes.0, _mm256_castsi256_ps(set)))
            }
        }
        #[inline(always)]
        fn prefetch<T>(of: &T) {
            for line in (0..size_of::<T>()).step_by(64) {
                // SAFETY: every x86-64 has the instruction; the address lies in what is referred to, and may be any.
                unsafe { _mm_prefetch::<_MM_HINT_T0>((of as *const T).cast::<i8>().add(line)) }
            }
        }
        #[inline(always)]
        fn least_each(of: &[Self; 8]) -> Self {
            // Half a transposition at each step, the two halves folded at once: 8 x 8 -> 4 x 8 -> 2 x 8 -> 8.
            // SAFETY: values are there, and so is AVX2.
            unsafe {
                let pair = |a: __m256, b: __m256| _mm256_min_ps(_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
                let four = |a: __m256, b: __m256| {
                    _mm256_min_ps(_mm256_shuffle_ps::<0x44>(a, b), _mm256_shuffle_ps::<0xee>(a, b))
                };
                let low = four(pair(of[0].0, of[1].0), pair(of[2].0, of[3].0));
                let high = four(pair(of[4].0, of[5].0), pair(of[6].0, of[7].0));
                Avx2(_mm256_min_ps(
                    _mm256_permute2f128_ps::<0x20>(low, high),
                    _mm256_permute2f128_ps::<0x31>(low, high),
                ))
            }
        }
    }
}
