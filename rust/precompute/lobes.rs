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

use rayon::prelude::*;

use crate::basis::cubemap::{direction_to_face_uv, face_point, texel_of};
use crate::brdf::{Brdf, Factor, Stored};
use crate::error::{Error, Result};
use crate::sampling::{frame, jitter, mixed};
use crate::scene::surface::dot;
use crate::transport::lobes::{self, DIFFUSE, LobeModels, PARAMETERS, RowLobe};
use crate::transport::sight::texel_columns;

use super::texels::{Texels, place};

/// Parts of a half width, or of the share of the way to the axis that stands for it, that a texel is divided into.
const FINE: f64 = 3.0;
/// Off its axis a lobe is as smooth as if it were this share of the way there wide.
const OFF_AXIS: f64 = 0.25;
/// No lobe is wider than the cosine that it is multiplied by, which halves at 60 degrees.
const COSINE: f64 = PI / 3.0;
/// Most parts along a side: more than 32 are for texel columns of lobes so narrow that wavelets sample them.
const MOST_PARTS: usize = 64;
/// Lobes whose half width is below this share of a texel are sampled, by so many samples along a side.
const NARROW: f64 = 0.1;
const SAMPLES: usize = 32;

/// What rows take of the light.
#[derive(Clone, Debug)]
pub enum Shape {
    /// The lobe of a material, seen by one eye.
    Model(Stored),
    /// A colour of a measured one.
    Measured(Arc<dyn Brdf>),
    /// A factor of a lobe, whoever sees it.
    Factor(Arc<Factor>),
}

impl Shape {
    /// What one eye sees; None of a factor.
    fn seen(&self) -> Option<&dyn Brdf> {
        match self {
            Shape::Model(stored) => Some(&*stored.model),
            Shape::Measured(model) => Some(&**model),
            Shape::Factor(_) => None,
        }
    }
}

/// The lobes of a list of rows.
#[derive(Clone, Debug, Default)]
pub struct Lobes {
    models: Vec<Shape>,
    /// Of each row the number of its model; `DIFFUSE` of those that take cosines. Empty where all do.
    of_row: Vec<u16>,
    /// Unit vectors to the eye.
    eyes: Vec<[f32; 3]>,
    half_widths: Vec<f32>,
    /// Of each row the cosine and sine by which its tangent is turned out of the frame of its normal; empty where none is.
    turns: Vec<[f32; 2]>,
}

/// A lobe where it stands.
pub struct Lobe<'a> {
    shape: &'a Shape,
    local: Local,
    /// To the eye, in that frame.
    wo: [f64; 3],
    /// Where it points to, in space; None where it is as fine everywhere.
    axis: Option<[f64; 3]>,
    half_width: f64,
}

impl Lobes {
    /// Of rows with these normals. Refuses rows that name no model, and eyes and normals that do not belong to them.
    pub fn new(models: Vec<Shape>, of_row: Vec<u16>, eyes: Vec<[f32; 3]>, normals: &[[f32; 3]]) -> Result<Self> {
        Self::turned(models, of_row, eyes, normals, Vec::new())
    }

    /// The same of rows with tangents of their own.
    pub fn turned(
        models: Vec<Shape>,
        of_row: Vec<u16>,
        eyes: Vec<[f32; 3]>,
        normals: &[[f32; 3]],
        turns: Vec<[f32; 2]>,
    ) -> Result<Self> {
        let known = |own: &u16| *own == DIFFUSE || usize::from(*own) < models.len();
        if of_row.len() != eyes.len() || of_row.len() != normals.len() || !of_row.iter().all(known) {
            let (rows, eyes, count) = (of_row.len(), eyes.len(), models.len());
            return Err(Error::input(format!("expected an eye and one of {count} models a row, got {rows}, {eyes}")));
        }
        if !turns.is_empty() && turns.len() != of_row.len() {
            return Err(Error::input(format!(
                "expected a turn for each of {} rows, got {}",
                of_row.len(),
                turns.len()
            )));
        }
        let half_width = |row: usize| match models.get(usize::from(of_row[row])) {
            Some(Shape::Factor(factor)) => (FINE * factor.width()) as f32,
            Some(shape) => {
                let wo = Local::new(normals[row], turns.get(row).copied()).of(eyes[row].map(f64::from));
                shape.seen().map_or(0.0, |model| model.half_width(wo) as f32)
            }
            None => 0.0,
        };
        let half_widths = (0..of_row.len()).into_par_iter().map(half_width).collect();
        Ok(Lobes { models, of_row, eyes, half_widths, turns })
    }

    /// By which a row's tangent is turned out of the frame of its normal, where it is.
    pub(super) fn turn(&self, row: usize) -> Option<[f32; 2]> {
        self.turns.get(row).copied()
    }

    /// What texel columns are made of: None where no row has a lobe, or one has a factor or a measured one, whose tables are
    /// not kept, or a tangent of its own.
    pub fn of_texels(&self) -> Option<lobes::Lobes> {
        if !self.any() || !self.turns.is_empty() {
            return None;
        }
        Some(lobes::Lobes {
            models: Arc::new(Models::of(&self.models)?),
            model: self.of_row.clone().into(),
            eye: self.eyes.as_flattened().to_vec().into(),
            half_width: self.half_widths.clone().into(),
        })
    }

    /// Whether any row has one.
    pub fn any(&self) -> bool {
        self.of_row.iter().any(|&own| own != DIFFUSE)
    }

    /// Whether a row has one.
    pub fn has(&self, row: usize) -> bool {
        self.of_row.get(row).is_some_and(|&own| own != DIFFUSE)
    }

    /// The factors among the models, each by its number.
    pub(super) fn factors(&self) -> impl Iterator<Item = Option<&Factor>> {
        self.models.iter().map(|shape| if let Shape::Factor(factor) = shape { Some(&**factor) } else { None })
    }

    /// The number of a row's model, where that is a factor.
    pub(super) fn factor_of(&self, row: usize) -> Option<usize> {
        let model = usize::from(*self.of_row.get(row)?);
        matches!(self.models.get(model)?, Shape::Factor(_)).then_some(model)
    }

    /// The lobe of a row with this normal; None of a diffuse one.
    pub fn of(&self, row: usize, normal: [f32; 3]) -> Option<Lobe<'_>> {
        let model = usize::from(*self.of_row.get(row).filter(|&&own| own != DIFFUSE)?);
        let own = RowLobe { model, normal, eye: self.eyes[row], half_width: self.half_widths[row] };
        Some(Lobe::new(&self.models[model], &own, self.turn(row)))
    }
}

/// The models of texel columns.
struct Models(Vec<Shape>);

impl Models {
    fn of(shapes: &[Shape]) -> Option<Self> {
        shapes.iter().all(|shape| matches!(shape, Shape::Model(_))).then(|| Models(shapes.to_vec()))
    }
}

/// Models from what a file holds of them: kinds, and parameters one model after the other.
pub fn models(kinds: &[u32], parameters: &[f64]) -> Result<Arc<dyn LobeModels>> {
    let stored = kinds.iter().zip(parameters.chunks(PARAMETERS));
    let models = stored.map(|(&kind, parameters)| Ok(Shape::Model(Stored::new(kind, parameters.to_vec())?)));
    Ok(Arc::new(Models(models.collect::<Result<_>>()?)))
}

impl LobeModels for Models {
    fn count(&self) -> usize {
        self.0.len()
    }

    fn means(&self, lobe: &RowLobe, size: usize, texels: &[usize], means: &mut [f32]) {
        let own = Lobe::new(&self.0[lobe.model], lobe, None);
        means.iter_mut().zip(texels).for_each(|(mean, &texel)| *mean = own.mean(size, texel));
    }

    fn stored(&self) -> (Vec<u32>, Vec<f64>) {
        let stored = self.0.iter().filter_map(|shape| if let Shape::Model(own) = shape { Some(own) } else { None });
        let parameters = stored.clone().flat_map(|own| {
            // What a model lacks is padded, as what it is not given.
            own.parameters.iter().copied().chain(std::iter::repeat(-1.0)).take(PARAMETERS)
        });
        (stored.clone().map(|own| own.kind).collect(), parameters.collect())
    }
}

/// The frame of a surface point: tangent, bitangent, normal.
#[derive(Clone, Copy)]
pub(super) struct Local([[f64; 3]; 3]);

impl Local {
    pub fn new(normal: [f32; 3], turn: Option<[f32; 2]>) -> Self {
        let normal = normal.map(f64::from);
        let [tangent, bitangent] = frame(normal);
        let Some([cos, sin]) = turn.map(|turn| turn.map(f64::from)) else {
            return Local([tangent, bitangent, normal]);
        };
        let of = |a: f64, b: f64| std::array::from_fn(|k| a * tangent[k] + b * bitangent[k]);
        Local([of(cos, sin), of(-sin, cos), normal])
    }

    /// The three, in this order.
    pub fn axes(self) -> [[f64; 3]; 3] {
        self.0
    }

    /// A direction of space in it.
    fn of(&self, direction: [f64; 3]) -> [f64; 3] {
        self.0.map(|axis| dot(axis, direction))
    }

    /// A direction of the frame in space.
    pub fn world(&self, local: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|k| (0..3).map(|axis| local[axis] * self.0[axis][k]).sum())
    }
}

impl<'a> Lobe<'a> {
    /// Where a row stands. It, and its means over texels, are made of sums, products, quotients and roots, and of the
    /// model's values: the same to the bit on every machine.
    fn new(shape: &'a Shape, own: &RowLobe, turn: Option<[f32; 2]>) -> Self {
        let local = Local::new(own.normal, turn);
        let wo = local.of(own.eye.map(f64::from));
        let axis = shape.seen().map(|model| local.world(model.axis(wo)));
        Lobe { shape, local, wo, axis, half_width: f64::from(own.half_width) }
    }
}

impl Lobe<'_> {
    /// f cos for a unit direction of space.
    pub(super) fn value(&self, direction: [f64; 3]) -> f64 {
        let wi = self.local.of(direction);
        match self.shape {
            Shape::Factor(factor) => factor.value(wi),
            Shape::Model(_) | Shape::Measured(_) if wi[2] <= 0.0 => 0.0,
            Shape::Model(Stored { model, .. }) | Shape::Measured(model) => model.evaluate(wi, self.wo) * wi[2],
        }
    }

    /// The density of `samples` at a unit direction of space; None of a factor.
    pub(super) fn pdf(&self, direction: [f64; 3]) -> Option<f64> {
        self.shape.seen().map(|model| model.pdf(self.local.of(direction), self.wo))
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
        let model = self.shape.seen();
        (0..side * side).filter_map(move |k| {
            let model = model?;
            let [x, y] = jitter(mixed(seed) ^ k as u64);
            let at = [((k % side) as f64 + x) / side as f64, ((k / side) as f64 + y) / side as f64];
            let (wi, pdf) = model.sample(self.wo, at)?;
            let weight = model.evaluate(wi, self.wo) * wi[2] / pdf / count;
            Some((self.local.world(wi), weight))
        })
    }

    /// Whether texels of faces of this size are too wide to be divided.
    pub(super) fn is_narrow(&self, size: usize) -> bool {
        self.axis.is_some() && self.half_width < NARROW * width(size)
    }

    /// pi times the mean of f cos over a texel, which a pass multiplies by sqrt(dw) / pi: as of a diffuse row cos.
    pub(super) fn mean(&self, size: usize, texel: usize) -> f32 {
        let centre = texel_columns(size)[texel].direction.map(f64::from);
        // The chord is no longer than the angle, and nearly as long where it matters.
        let chord = |axis: [f64; 3]| [0, 1, 2].map(|k| centre[k] - axis[k]);
        let off = self.axis.map_or(0.0, |axis| dot(chord(axis), chord(axis)).sqrt() - width(size));
        let fine = self.half_width.max(OFF_AXIS * off).min(COSINE);
        let parts = (FINE * width(size) / fine).ceil().max(1.0);
        if parts <= 1.0 {
            return (PI * self.value(centre)) as f32;
        }
        let parts = (parts as usize).next_power_of_two().min(MOST_PARTS);
        let (face, row, column) = place(size, texel);
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
        let height = |texel: usize| dot(texels.centre[texel].map(f64::from), self.local.0[2]);
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
