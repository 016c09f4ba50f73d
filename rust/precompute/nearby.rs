//! What a receiver takes through a lobe of samples near by: by rays of the lobe.
//!
//! ```text
//!     T_kg(x) = 1 / n sum over rays that end in the cell of g of b_k f_F cos_x / p
//! ```
//!
//! Where a sample is not small beside the lobe, a few points of its cell do not say what of it the lobe meets, nor whether
//! just that is hidden; rays do, since the lobe ends in a few cells there. Samples further off are taken by their points:
//! a lobe meets hundreds of those, and rays would be noise.
//!
//! Cornell's floor, 16,384 samples, error of what it reflects at gamma 300 and 30: points alone 3.4 and 1.9 %, rays up to
//! here 1.5 and 1.8 %, in the same time. Twice as far 1.75 and 1.7 %; a third of the rays 2.1 and 1.75 %.

use std::sync::Arc;

use crate::brdf::{Brdf, Direction};
use crate::sampling::{frame, jitter, mixed};
use crate::scene::surface::dot;
use crate::scene::{GatherSamples, Surfaces};

use super::standing::{Receiver, square};

/// How wide a sample is seen (the radius of the disc of its area over its distance), in widths of the lobe, where rays take
/// the place of points.
const WIDE: f64 = 0.15;
/// Rays of a receiver, at most.
const RAYS: usize = 1024;

/// Which samples are near by, and the lobes whose rays meet them.
pub struct Nearby<'a> {
    lobes: &'a [Arc<dyn Brdf>],
    /// Rays along a side, of each lobe.
    side: usize,
    /// What the square of a distance is multiplied by.
    scale: f32,
}

impl<'a> Nearby<'a> {
    /// Of a lobe of a width; the lobes together are as dense as what is taken is large.
    pub fn new(lobes: &'a [Arc<dyn Brdf>], width: f64) -> Nearby<'a> {
        Nearby { lobes, side: (RAYS / lobes.len().max(1)).isqrt(), scale: ((WIDE * width) * (WIDE * width)) as f32 }
    }

    /// Whether a sample is, by the squares of its disc's radius and of its distance.
    #[inline(always)]
    pub fn has(&self, radius2: f32, distance2: f32) -> bool {
        self.scale * distance2 < radius2
    }

    /// Calls `add` for each ray that ends in the cell of a sample near by: with the sample, the directions of the ray and to the
    /// eye along the receiver's axes, and the cosine over density that the ray stands for.
    pub fn each(
        &self,
        surfaces: Surfaces,
        samples: &GatherSamples,
        receiver: &Receiver,
        mut add: impl FnMut(usize, [Direction; 2], f64),
    ) {
        let normal = receiver.normal.map(f64::from);
        let [tangent, bitangent] = frame(normal);
        let axes = [tangent, bitangent, normal];
        let (wo, rise) = (axes.map(|axis| dot(axis, receiver.eye)), receiver.rise.map(f64::from));
        // Other strata at every receiver: what rays are off by is noise, and no pattern.
        let seed = receiver.origin.iter().fold(1, |seed, x| mixed(seed ^ u64::from(x.to_bits())));
        let (count, mut room) = (self.side * self.side, Vec::new());
        for (number, k) in (0..self.lobes.len()).flat_map(|number| (0..count).map(move |k| (number, k))) {
            let [x, y] = jitter(mixed(seed.wrapping_add((number * count + k) as u64)));
            let at = [((k % self.side) as f64 + x), ((k / self.side) as f64 + y)].map(|at| at / self.side as f64);
            let Some((wi, _)) = self.lobes[number].sample(wo, at) else { continue };
            let way = std::array::from_fn(|k| (0..3).map(|axis| wi[axis] * axes[axis][k]).sum());
            if wi[2] <= 0.0 || dot(rise, way) <= 0.0 {
                continue;
            }
            let Some(hit) = surfaces.meet(receiver.origin, way) else { continue };
            let Some(sample) = samples.whose(hit.place, hit.normal, &mut room) else { continue };
            let place = samples.points[sample].place.map(|x| x as f32);
            if self.has(samples.radius2(sample), square(place, receiver.origin)) {
                // All lobes have as many rays: a ray of one counts as one of their mixture.
                let density: f64 = self.lobes.iter().map(|lobe| lobe.pdf(wi, wo)).sum();
                add(sample, [wi, wo], wi[2] / (density * count as f64));
            }
        }
    }
}
