//! From linear radiance to what a display shows, and to half floats.

use std::sync::OnceLock;

use rayon::prelude::*;

/// Numbers that a task turns.
const CHUNK: usize = 1 << 14;
/// Bits of a number that a first guess goes by: its exponent and seven bits more.
const GUESS: u32 = 16;

/// 8-bit sRGB of radiance times `scale`: clipped to [0, 1], the sRGB curve, the nearest integer. NaN is black.
pub fn to_display(radiance: &[f32], scale: f32, out: &mut [u8]) {
    let curve = Curve::shared();
    radiance.par_chunks(CHUNK).zip(out.par_chunks_mut(CHUNK)).for_each(|(radiance, out)| {
        for (value, out) in radiance.iter().zip(out) {
            *out = curve.nearest(value * scale);
        }
    });
}

/// 8-bit sRGB of colours times `scale` through AgX, which keeps suns and lamps from turning into flat patches of pure colour:
/// colours are drawn together, their logarithms between two exposures go through a sigmoid, and are drawn apart again. NaN
/// and what is negative is black.
///
/// Troy Sobotka's AgX (github.com/sobotka/AgX) in the polynomial fit of Benjamin Wrensch, "Minimal AgX implementation"
/// (iolite-engine.com/blog_posts/minimal_agx_implementation).
pub fn to_agx(radiance: &[[f32; 3]], scale: f32, out: &mut [[u8; 3]]) {
    radiance.par_chunks(CHUNK).zip(out.par_chunks_mut(CHUNK)).for_each(|(radiance, out)| {
        for (colour, out) in radiance.iter().zip(out) {
            let lit = colour.map(|value| f64::from((value * scale).max(0.0)).min(BRIGHTEST));
            let curved = turned(&INSET, lit).map(|value| {
                let stops = value.max(STOPS[0].exp2()).log2().clamp(STOPS[0], STOPS[1]);
                let x = (stops - STOPS[0]) / (STOPS[1] - STOPS[0]);
                SIGMOID.iter().fold(0.0, |sum, factor| sum * x + factor)
            });
            *out = turned(&OUTSET, curved).map(|value| (255.0 * value.clamp(0.0, 1.0)).round_ties_even() as u8);
        }
    });
}

fn turned(matrix: &[[f64; 3]; 3], colour: [f64; 3]) -> [f64; 3] {
    matrix.map(|row| row[0] * colour[0] + row[1] * colour[1] + row[2] * colour[2])
}

/// In stops: what is black and white.
const STOPS: [f64; 2] = [-12.47393, 4.026_069];
/// What is brighter, and infinite, is white as well.
const BRIGHTEST: f64 = 131_072.0;
const INSET: [[f64; 3]; 3] = [
    [0.842_479_062_253_094, 0.078_433_599_999_999_2, 0.079_223_745_147_764_3],
    [0.042_328_242_261_012_3, 0.878_468_636_469_772, 0.079_166_127_460_543_4],
    [0.042_375_654_905_705_1, 0.078_433_6, 0.879_142_973_793_104],
];
const OUTSET: [[f64; 3]; 3] = [
    [1.196_879_005_120_17, -0.098_020_881_140_136_8, -0.099_029_744_079_720_5],
    [-0.052_896_851_757_456_2, 1.151_903_129_904_17, -0.098_961_176_844_843_3],
    [-0.052_971_635_514_443_8, -0.098_043_450_117_124_1, 1.151_073_672_641_16],
];
const SIGMOID: [f64; 7] = [15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232];

/// Radiance in half floats, to the nearest, ties to even; what is brighter than they can hold is their largest, and NaN 0.
pub fn to_half(radiance: &[f32], out: &mut [u16]) {
    radiance.par_chunks(CHUNK).zip(out.par_chunks_mut(CHUNK)).for_each(|(radiance, out)| {
        for (&value, out) in radiance.iter().zip(out) {
            *out = half(value);
        }
    });
}

/// Without branches, so that many are turned at once.
#[inline(always)]
fn half(value: f32) -> u16 {
    const LARGEST: f32 = 65_504.0;
    /// 2^-14, the least that is normal; 0.5, whose last bit is worth 2^-24, the last bit of a half that is not.
    const NORMAL: u32 = 113 << 23;
    const DENORMAL: f32 = 0.5;
    let sign = (value.to_bits() >> 16) as u16 & 0x8000;
    let size = if value.is_nan() { 0.0 } else { value.abs().min(LARGEST) };
    let bits = size.to_bits();
    let normal = (bits.wrapping_sub(112 << 23) + 0xfff + (bits >> 13 & 1)) >> 13;
    let small = (size + DENORMAL).to_bits().wrapping_sub(DENORMAL.to_bits());
    sign | if bits < NORMAL { small } else { normal } as u16
}

/// Where the nearest integer steps up.
struct Curve {
    /// The least number that is shown as k or more.
    starts: [f32; 256],
    /// By the first bits of a number in [0, 1]: what the least such number is shown as.
    guesses: Vec<u8>,
}

impl Curve {
    fn shared() -> &'static Curve {
        static CURVE: OnceLock<Curve> = OnceLock::new();
        CURVE.get_or_init(|| {
            let starts: [f32; 256] = std::array::from_fn(|k| if k == 0 { 0.0 } else { start(k) });
            let last = 1f32.to_bits() >> GUESS;
            let shown = |bits: u32| {
                let least = f32::from_bits(bits << GUESS);
                (starts.partition_point(|&start| start <= least) - 1) as u8
            };
            Curve { starts, guesses: (0..=last).map(shown).collect() }
        })
    }

    #[inline(always)]
    fn nearest(&self, value: f32) -> u8 {
        if value.is_nan() {
            return 0;
        }
        let value = value.clamp(0.0, 1.0);
        let mut shown = self.guesses[(value.to_bits() >> GUESS) as usize];
        while shown < 255 && self.starts[shown as usize + 1] <= value {
            shown += 1;
        }
        shown
    }
}

/// The least f32 that sRGB's curve takes to k - 1/2 or more, of 255.
fn start(k: usize) -> f32 {
    let shown = (k as f64 - 0.5) / 255.0;
    let linear = if shown <= 0.040_45 { shown / 12.92 } else { ((shown + 0.055) / 1.055).powf(2.4) };
    let nearest = linear as f32;
    if f64::from(nearest) < linear { nearest.next_up() } else { nearest }
}
