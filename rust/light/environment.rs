//! Environment maps, rotated and resampled to cubemaps every frame: L'(d) = L(R^-1 d).
//!
//! A map is kept whole. For each cubemap size that is asked for it is prepared once, in two parts that add up to it:
//!
//! - the *base*, radiance clipped at a cap, as its means by solid angle over squares of one texel of the target, half a
//!   texel apart, and over squares of two texels, one apart. A target texel is one bilinear look-up at its centre; where
//!   the source's texels are smaller on the sphere than the target's (up to 5 times: corners that turn to a face's
//!   centre) the wide squares are blended in. Unrotated, a centre meets a square, which is the texel, and its mean is
//!   the exact box average; nothing jumps when a rotation sets in.
//! - the *bright* rest above the cap, a few thousand pixels at most, each spread as a small square over the texels it
//!   covers with weights that sum to 1. Their flux, Σ L dω, is therefore kept under every rotation, and a sun that is
//!   smaller than a texel neither flickers nor dims.
//!
//! All weights are positive, so nothing rings; negative pixels pass linearly.
//!
//! Dropped: the mean of four look-ups, one in each quarter of a target texel. Where the axes of source and target agree
//! it is the same filter; elsewhere its square turns with the target, which keeps the base's flux within 0.07 % under
//! rotation, not 0.16 % (built-in lights at 6 x 64 x 64), at more than twice the time.
//! A lat-long image means its bilinear interpolation, a cubemap its piecewise-constant texels.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use crate::basis::spherical_harmonics::Rotation;
use crate::basis::{HARMONIC_FACE, HarmonicProjection};
use crate::error::{Error, Result};

use super::layout::{Layout, unrotate};
use super::lookup::{lat_long, lat_long_all, seamless};
use super::peaks::Peak;
use super::resample::Prepared;

/// Directions that one task looks in.
const PIECE: usize = 4096;

/// The pixels of a picture behind which light is seen.
pub struct Behind {
    /// Their numbers, row-major.
    pub pixels: Vec<u32>,
    /// What share of each shows no surface.
    pub shares: Vec<f32>,
    /// Unit directions of their centres.
    pub directions: Vec<[f32; 3]>,
}

/// A map of distant radiance.
pub struct EnvironmentMap {
    layout: Layout,
    pixels: Vec<[f32; 3]>,
    /// What `resample` and `split` (true) need for each size, made on first use.
    prepared: Mutex<HashMap<(usize, bool), Arc<Prepared>>>,
    /// Its coefficients in the spherical harmonics of each order (`basis/harmonic_projection.rs`), made on first use.
    harmonics: Mutex<HashMap<usize, Arc<Vec<[f64; 3]>>>>,
}

impl EnvironmentMap {
    /// From `layout.pixels()` finite pixels in rows (and face after face).
    pub fn new(layout: Layout, pixels: Vec<[f32; 3]>) -> Result<Self> {
        if pixels.is_empty() || pixels.len() != layout.pixels() {
            return Err(Error::input(format!(
                "expected {} pixels, at least one, got {}",
                layout.pixels(),
                pixels.len()
            )));
        }
        if let Some(bad) = pixels.iter().position(|pixel| pixel.iter().any(|value| !value.is_finite())) {
            return Err(Error::input(format!("expected finite radiance, got {:?} in pixel {bad}", pixels[bad])));
        }
        Ok(EnvironmentMap { layout, pixels, prepared: Mutex::default(), harmonics: Mutex::default() })
    }

    /// Adds to `radiance`, a cubemap of `size` x `size` texels a face, this map rotated by `rotation` times the colour `scale`.
    ///
    /// `rotation` is an orthogonal matrix in rows, possibly with a mirror.
    pub fn resample(&self, size: usize, rotation: &[[f64; 3]; 3], scale: [f64; 3], radiance: &mut [[f32; 3]]) {
        self.prepare(size, false).add(rotation, scale, 0, radiance);
    }

    /// The same without the map's `peaks` largest peaks, which are added to `texels` instead, each in the texels around
    /// its direction: coefficients of orthonormal texels.
    pub fn split(
        &self,
        size: usize,
        rotation: &[[f64; 3]; 3],
        scale: [f64; 3],
        peaks: usize,
        radiance: &mut [[f32; 3]],
        texels: &mut [[f64; 3]],
    ) {
        let prepared = self.prepare(size, true);
        prepared.add(rotation, scale, peaks, radiance);
        prepared.add_peaks(rotation, scale, peaks, texels);
    }

    /// The map's largest peaks for cubemaps of a size, turned.
    pub fn peaks(&self, size: usize, rotation: &[[f64; 3]; 3], count: usize) -> Vec<Peak> {
        self.prepare(size, true).peaks().iter().take(count).map(|peak| peak.turned(rotation)).collect()
    }

    /// Adds to `coefficients` this map's, turned by `rotation` and times `scale`.
    ///
    /// The map is projected once; every frame turns those coefficients. Nothing is resampled then, so that neither
    /// interpolation nor a rotation of a rotation adds an error.
    pub fn project(&self, order: usize, rotation: &[[f64; 3]; 3], scale: [f64; 3], sum: &mut [[f64; 3]]) -> Result<()> {
        let original = self.harmonics(order, || {
            let mut radiance = vec![[0.0; 3]; 6 * HARMONIC_FACE * HARMONIC_FACE];
            self.resample(HARMONIC_FACE, &[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [1.0; 3], &mut radiance);
            Ok(HarmonicProjection::shared(order)?.forward(&radiance))
        })?;
        for (total, own) in sum.iter_mut().zip(Rotation::new(order, rotation)?.apply(&original)) {
            (0..3).for_each(|channel| total[channel] += scale[channel] * own[channel]);
        }
        Ok(())
    }

    /// Radiance from unit directions, bilinear between the map's own pixels.
    pub fn sample(&self, directions: &[[f64; 3]], rotation: &[[f64; 3]; 3], scale: [f64; 3]) -> Vec<[f32; 3]> {
        let look = |&direction: &[f64; 3]| {
            let colour = self.lookup(unrotate(rotation, direction));
            std::array::from_fn(|c| (colour[c] * scale[c]) as f32)
        };
        directions.par_iter().map(look).collect()
    }

    /// Adds to some pixels of a picture this map, turned and scaled, as it is seen in their directions (of length 1), times
    /// the share of each that shows it.
    pub fn add_behind(&self, behind: &Behind, rotation: &[[f64; 3]; 3], scale: [f64; 3], picture: &mut [[f32; 3]]) {
        let seen: Vec<Vec<[f32; 3]>> = behind
            .directions
            .par_chunks(PIECE)
            .map(|directions| {
                let turned: Vec<[f32; 3]> =
                    directions.iter().map(|&d| unrotate(rotation, d.map(f64::from)).map(|x| x as f32)).collect();
                match self.layout {
                    Layout::LatLong { width, height, rows } => {
                        let mut seen = vec![[0.0; 3]; turned.len()];
                        lat_long_all(&self.pixels, width, height, rows, &turned, &mut seen);
                        seen
                    }
                    Layout::Cubemap { size } => turned
                        .iter()
                        .map(|&d| seamless(&self.pixels, size, d.map(f64::from)).map(|x| x as f32))
                        .collect(),
                }
            })
            .collect();
        let seen = seen.iter().flatten();
        for ((colour, &pixel), share) in seen.zip(&behind.pixels).zip(&behind.shares) {
            (0..3).for_each(|c| picture[pixel as usize][c] += share * scale[c] as f32 * colour[c]);
        }
    }

    /// What the map was made of.
    pub fn source(&self) -> (Layout, &[[f32; 3]]) {
        (self.layout, &self.pixels)
    }

    /// Bytes held, prepared sizes included.
    pub fn bytes(&self) -> usize {
        let prepared = self.prepared.lock().unwrap_or_else(PoisonError::into_inner);
        std::mem::size_of_val(&self.pixels[..]) + prepared.values().map(|ready| ready.bytes()).sum::<usize>()
    }

    /// Makes the map ready for a size, once. The lock is not held meanwhile: a rayon thread that waits inside would steal
    /// work that may ask for the same lock. At worst two threads do the same work.
    fn prepare(&self, size: usize, peaks: bool) -> Arc<Prepared> {
        let known = self.prepared.lock().unwrap_or_else(PoisonError::into_inner).get(&(size, peaks)).cloned();
        known.unwrap_or_else(|| {
            let fresh = Arc::new(Prepared::new(self.layout, &self.pixels, size, peaks));
            self.prepared.lock().unwrap_or_else(PoisonError::into_inner).entry((size, peaks)).or_insert(fresh).clone()
        })
    }

    /// The coefficients of an order, once; the lock is not held while they are made (see `prepare`).
    fn harmonics(&self, order: usize, make: impl FnOnce() -> Result<Vec<[f64; 3]>>) -> Result<Arc<Vec<[f64; 3]>>> {
        let known = self.harmonics.lock().unwrap_or_else(PoisonError::into_inner).get(&order).cloned();
        match known {
            Some(made) => Ok(made),
            None => {
                let fresh = Arc::new(make()?);
                Ok(self.harmonics.lock().unwrap_or_else(PoisonError::into_inner).entry(order).or_insert(fresh).clone())
            }
        }
    }

    fn lookup(&self, direction: [f64; 3]) -> [f64; 3] {
        match self.layout {
            Layout::LatLong { width, height, rows } => lat_long(&self.pixels, width, height, rows, direction),
            Layout::Cubemap { size } => seamless(&self.pixels, size, direction),
        }
    }
}
