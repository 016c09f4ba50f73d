//! Functions of a segment as a table for millions of pairs of directions: no logarithm, no square root beyond the half
//! vector's, the same bits on every machine.
//!
//! Nodes lie where 1 + (1 - cos delta) / width, as a 32-bit float, has round bits: as far apart as the logarithm moves, and
//! found by a shift. Between them functions are linear.

use super::edited::{Edited, Model};

/// Nodes of an octave, as a power of two: the axis of families has as many for lobes of a hundredth.
const BITS: u32 = 7;
const SHIFT: u32 = f32::MANTISSA_DIGITS - 1 - BITS;
/// Functions that are read together.
pub const WIDE: usize = 8;

/// The functions of one segment.
pub struct Lookup {
    edited: Edited,
    /// One over the width of the segment.
    scale: f32,
    /// Groups of `WIDE` functions of a node.
    groups: usize,
    values: Vec<[f32; WIDE]>,
}

/// Cosines to the normal, of the half vector to it and to the eye; and how far the light is from the mirror direction, as
/// 1 - cos.
#[derive(Clone, Copy, Debug)]
pub struct Angles {
    /// Of the light to the normal.
    pub cos_i: f32,
    /// Of the eye to the normal.
    pub cos_o: f32,
    /// Of the half vector to the normal, squared.
    pub cos_h2: f32,
    /// sin² / cos² of the same.
    pub tan_h2: f32,
    /// Of the half vector to the eye.
    pub cos_d: f32,
    /// 1 - cos of the light to the mirror direction.
    pub off_mirror: f32,
}

impl Lookup {
    /// Of a segment with lobes of a width: `basis` gives its functions at 1 - cos delta, so many each time.
    pub(super) fn new(edited: Edited, width: f64, live: usize, basis: impl Fn(f64) -> Vec<f64>) -> Lookup {
        let scale = (1.0 / width) as f32;
        let (groups, first) = (live.div_ceil(WIDE), 1.0f32.to_bits() >> SHIFT);
        let last = ((1.0 + scale).to_bits() >> SHIFT) + 1;
        let node = |bits: u32| {
            let fall = f64::from((f32::from_bits(bits << SHIFT) - 1.0) / scale).min(1.0);
            let mut all = vec![[0.0; WIDE]; groups];
            for (k, b) in basis(fall).into_iter().enumerate() {
                all[k / WIDE][k % WIDE] = b as f32;
            }
            all
        };
        Lookup { edited, scale, groups, values: (first..=last).flat_map(node).collect() }
    }

    /// Where f_E is asked, as 1 - cos delta, and f_F there, as `Edited::fixed` has them; f_F is 0 where the model is.
    #[inline(always)]
    pub fn fixed(&self, at: &Angles) -> (f32, f32) {
        let &Angles { cos_i, cos_o, cos_h2, tan_h2, cos_d, off_mirror } = at;
        if self.edited.model == Model::Lafortune {
            return (off_mirror.min(1.0), if off_mirror < 1.0 { 1.0 } else { 0.0 });
        }
        let cos_h = cos_h2.sqrt();
        let fall = (tan_h2 * cos_h2 / (1.0 + cos_h)).min(1.0);
        let (both, most) = (cos_i * cos_o, cos_i.max(cos_o));
        let fixed = match self.edited.model {
            Model::BlinnPhong | Model::Lafortune => 1.0,
            Model::Ward => 1.0 / both.sqrt(),
            Model::WardDuer => 1.0 / both,
            Model::AshikhminShirley => 1.0 / (cos_d * most),
            Model::CookTorrance => {
                let seen = (2.0 * cos_h / (cos_d * most)).min(1.0 / both);
                if self.edited.printed { seen / (cos_h2 * cos_h2) } else { 0.25 * seen }
            }
        };
        let (grazing, f0) = (1.0 - cos_d, self.edited.f0 as f32);
        let squared = grazing * grazing;
        (fall, (f0 + (1.0 - f0) * (squared * squared * grazing)) * fixed)
    }

    /// Adds a group of functions at 1 - cos delta, times a share.
    #[inline(always)]
    pub fn add(&self, group: usize, fall: f32, share: f32, sums: &mut [f32; WIDE]) {
        let bits = (1.0 + fall * self.scale).to_bits();
        let node = ((bits >> SHIFT) - (1.0f32.to_bits() >> SHIFT)) as usize;
        let part = (bits & ((1 << SHIFT) - 1)) as f32 * (1.0 / (1u32 << SHIFT) as f32);
        let (low, high) = (&self.values[node * self.groups + group], &self.values[(node + 1) * self.groups + group]);
        for k in 0..WIDE {
            sums[k] += share * (low[k] + part * (high[k] - low[k]));
        }
    }
}
