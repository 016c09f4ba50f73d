//! Glossy rows: what a receiver takes from each direction is the lobe of its material, as one eye sees it.
//!
//! ```text
//!     T_p = V_p / sqrt(dw_p) Int_p f(wi, wo) cos dw        of a diffuse row f cos is cos / pi, and nearly constant over a texel
//! ```
//!
//! The integral is a sum over k x k parts of the texel, finer than the lobe there: k follows its half width and how far off
//! its axis the texel lies. A lobe much narrower than a texel is sampled instead, each sample into the texel that it hits,
//! so that none of its energy falls between the parts.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

use crate::basis::cubemap::{direction_to_face_uv, face_point, texel_of};
use crate::brdf::{Brdf, Factor};
use crate::error::{Error, Result};
use crate::sampling::{frame, jitter, mixed};
use crate::scene::surface::dot;

use super::texels::Texels;

/// Parts of a half width, or of the share of the way to the axis that stands for it, that a texel is divided into.
const FINE: f64 = 3.0;
/// Off its axis a lobe is as smooth as if it were this share of the way there wide.
const OFF_AXIS: f64 = 0.25;
/// Most parts along a side.
const MOST_PARTS: usize = 32;
/// Lobes whose half width is below this share of a texel are sampled, by so many samples along a side.
const NARROW: f64 = 0.1;
const SAMPLES: usize = 32;

/// What rows take of the light.
#[derive(Clone, Debug)]
pub enum Shape {
    /// The lobe of a material, seen by one eye.
    Seen(Arc<dyn Brdf>),
    /// A factor of it, whoever sees it.
    Factor(Arc<Factor>),
}

/// The lobes of a list of rows.
#[derive(Clone, Debug, Default)]
pub struct Lobes {
    models: Vec<Shape>,
    /// Of each row the number of its model; `DIFFUSE` of those that take cosines. Empty where all do.
    of_row: Vec<u16>,
    /// Unit vectors to the eye.
    eyes: Vec<[f32; 3]>,
}

/// Of a row without a lobe.
pub const DIFFUSE: u16 = u16::MAX;

/// A lobe where it stands.
pub struct Lobe<'a> {
    shape: &'a Shape,
    /// Tangent, bitangent, normal.
    frame: [[f64; 3]; 3],
    /// To the eye, in that frame.
    wo: [f64; 3],
    /// Where it points to, in space; None where it is as fine everywhere.
    axis: Option<[f64; 3]>,
    half_width: f64,
}

impl Lobes {
    /// Refuses rows that name no model, and eyes that do not belong to them.
    pub fn new(models: Vec<Shape>, of_row: Vec<u16>, eyes: Vec<[f32; 3]>) -> Result<Self> {
        if of_row.len() != eyes.len() || of_row.iter().any(|&own| own != DIFFUSE && usize::from(own) >= models.len()) {
            let (rows, eyes, count) = (of_row.len(), eyes.len(), models.len());
            return Err(Error::input(format!("expected an eye and one of {count} models a row, got {rows}, {eyes}")));
        }
        Ok(Lobes { models, of_row, eyes })
    }

    /// Whether any row has one.
    pub fn any(&self) -> bool {
        self.of_row.iter().any(|&own| own != DIFFUSE)
    }

    /// Whether a row has one.
    pub fn has(&self, row: usize) -> bool {
        self.of_row.get(row).is_some_and(|&own| own != DIFFUSE)
    }

    /// The lobe of a row with this normal; None of a diffuse one.
    pub fn of(&self, row: usize, normal: [f32; 3]) -> Option<Lobe<'_>> {
        let own = *self.of_row.get(row).filter(|&&own| own != DIFFUSE)?;
        let normal = normal.map(f64::from);
        let [tangent, bitangent] = frame(normal);
        let frame = [tangent, bitangent, normal];
        let eye = self.eyes[row].map(f64::from);
        let wo = frame.map(|axis| dot(axis, eye));
        let shape = &self.models[usize::from(own)];
        let (axis, half_width) = match shape {
            Shape::Seen(model) => (Some(world(&frame, model.axis(wo))), model.half_width(wo)),
            Shape::Factor(factor) => (None, FINE * factor.width()),
        };
        Some(Lobe { shape, frame, wo, axis, half_width })
    }
}

/// A vector of a frame in space.
fn world(frame: &[[f64; 3]; 3], local: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| (0..3).map(|axis| local[axis] * frame[axis][k]).sum())
}

impl Lobe<'_> {
    /// f cos for a unit direction of space.
    pub(super) fn value(&self, direction: [f64; 3]) -> f64 {
        let wi = self.frame.map(|axis| dot(axis, direction));
        match self.shape {
            Shape::Seen(model) if wi[2] > 0.0 => model.evaluate(wi, self.wo) * wi[2],
            Shape::Seen(_) => 0.0,
            Shape::Factor(factor) => factor.value(wi),
        }
    }

    /// The density of `samples` at a unit direction of space; None of a factor.
    pub(super) fn pdf(&self, direction: [f64; 3]) -> Option<f64> {
        match self.shape {
            Shape::Seen(model) => Some(model.pdf(self.frame.map(|axis| dot(axis, direction)), self.wo)),
            Shape::Factor(_) => None,
        }
    }

    /// Whether it is a factor of a lobe that is seen from anywhere.
    pub fn is_factor(&self) -> bool {
        matches!(self.shape, Shape::Factor(_))
    }

    /// Radians from its axis to where it has fallen to a half.
    pub fn half_width(&self) -> f64 {
        self.half_width
    }

    /// `side` x `side` stratified directions of space and what each stands for, in whole lobes: f cos / pdf / `side`^2. None
    /// of a factor, which may be negative.
    pub fn samples(&self, side: usize, seed: u64) -> impl Iterator<Item = ([f64; 3], f64)> {
        let count = (side * side) as f64;
        let model = match self.shape {
            Shape::Seen(model) => Some(model),
            Shape::Factor(_) => None,
        };
        (0..side * side).filter_map(move |k| {
            let model = model?;
            let [x, y] = jitter(mixed(seed) ^ k as u64);
            let at = [((k % side) as f64 + x) / side as f64, ((k / side) as f64 + y) / side as f64];
            let (wi, pdf) = model.sample(self.wo, at)?;
            let weight = model.evaluate(wi, self.wo) * wi[2] / pdf / count;
            Some((world(&self.frame, wi), weight))
        })
    }

    /// Whether texels of faces of this size are too wide to be divided.
    pub(super) fn is_narrow(&self, size: usize) -> bool {
        self.axis.is_some() && self.half_width < NARROW * width(size)
    }

    /// pi times the mean of f cos over a texel, which a pass multiplies by sqrt(dw) / pi: as of a diffuse row cos.
    pub(super) fn mean(&self, texels: &Texels, texel: usize) -> f32 {
        let size = texels.size;
        let centre = texels.centre[texel].map(f64::from);
        let off = self.axis.map_or(0.0, |axis| dot(centre, axis).clamp(-1.0, 1.0).acos() - width(size));
        let fine = self.half_width.max(OFF_AXIS * off);
        let parts = (FINE * width(size) / fine).ceil().max(1.0);
        if parts <= 1.0 {
            return (PI * self.value(centre)) as f32;
        }
        let parts = (parts as usize).next_power_of_two().min(MOST_PARTS);
        let (face, row, column) = texels.place(texel);
        let coordinate =
            |whole: usize, part: usize| 2.0 * (whole as f64 + (part as f64 + 0.5) / parts as f64) / size as f64 - 1.0;
        let (mut sum, mut area) = (0.0, 0.0);
        for k in 0..parts * parts {
            let (s, t) = (coordinate(column, k % parts), coordinate(row, k / parts));
            let point = face_point(face, s, t);
            let square = dot(point, point);
            // As the solid angle of a part.
            let weight = 1.0 / (square * square.sqrt());
            let length = square.sqrt();
            sum += weight * self.value(point.map(|x| x / length));
            area += weight;
        }
        (PI * sum / area) as f32
    }

    /// The same of all texels that samples hit, ascending; `areas`: solid angles of the texels of a face. Nothing is seen of
    /// a texel whose centre is below the horizon: what falls into one goes to its highest neighbour.
    pub(super) fn sampled(&self, texels: &Texels, areas: &[f64], seed: u64) -> Vec<(u32, f32)> {
        let size = texels.size;
        let height = |texel: usize| dot(texels.centre[texel].map(f64::from), self.frame[2]);
        let mut hits: Vec<(u32, f64)> = self
            .samples(SAMPLES, seed)
            .map(|(direction, weight)| {
                let (face, s, t) = direction_to_face_uv(direction);
                let mut texel = face * size * size + texel_of(size, t) * size + texel_of(size, s);
                if height(texel) <= 0.0 {
                    let around = texels.neighbours[texel].iter().map(|&next| next as usize);
                    texel = around.max_by(|&a, &b| height(a).total_cmp(&height(b))).unwrap_or(texel);
                }
                (texel as u32, PI * weight / areas[texel % (size * size)])
            })
            .collect();
        hits.sort_by_key(|&(texel, _)| texel);
        let total = |same: &[(u32, f64)]| (same[0].0, same.iter().map(|&(_, value)| value).sum::<f64>() as f32);
        hits.chunk_by(|a, b| a.0 == b.0).map(total).collect()
    }
}

/// Radians that a texel is wide.
fn width(size: usize) -> f64 {
    FRAC_PI_2 / size as f64
}
