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
