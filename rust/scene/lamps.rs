//! Lamps that move at run time: which points of surfaces they see, and what they send them.
//!
//! ```text
//!     E = sum over sources s of  V_s I_s cos(theta) / |x - s|^2            near ones: radiant intensity, W / sr
//!     E = sum over sources s of  V_s E_s cos(theta)                        far ones: irradiance of what faces them
//! ```
//!
//! A point lamp and a spot are one source, an area lamp some of its surface, an environment some directions. What they see is
//! kept as bits, as a reflectance may change while they stand still.

use rayon::prelude::*;

use super::mesh::Mesh;
use super::rays::{Apex, FAN, Segments, Tracer, Walk, fans};
use super::surface::{Points, dot};
use crate::brdf::family::{Curve, Edited};
use crate::error::{Error, Result};
use crate::sampling::frame;

/// Nearer than this, in the normalised scene, a source is as bright as here.
const NEAREST: f64 = 1e-4;

/// Points whose glints one thread finds at a time.
const GLINTS: usize = 512;

/// How a source shines by direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Beam {
    /// Everywhere alike.
    Even,
    /// Into a cone: in full up to the first cosine to the axis, nothing beyond the second.
    Cone([f64; 3], [f64; 2]),
    /// As a surface that faces along a normal: by the cosine.
    Facing([f64; 3]),
}

/// One place, or one direction, that light comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Source {
    /// In the user's space; of a far one the unit vector towards it.
    pub at: [f64; 3],
    /// In red, green and blue.
    pub colour: [f64; 3],
    /// Of near ones.
    pub beam: Beam,
}

/// Sources that are moved together.
#[derive(Clone, Debug)]
pub struct Lamp {
    /// All near, or all far.
    pub sources: Vec<Source>,
    /// Whether they are directions.
    pub far: bool,
}

/// Which points each source of a lamp sees: for each point a bit a source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sights {
    words: usize,
    bits: Vec<u64>,
}

impl Beam {
    /// What of its brightest is sent along a unit vector.
    fn along(self, way: [f64; 3]) -> f64 {
        match self {
            Beam::Even => 1.0,
            Beam::Facing(normal) => dot(normal, way).max(0.0),
            Beam::Cone(axis, [full, none]) => {
                let cosine = dot(axis, way);
                let share = if full > none {
                    ((cosine - none) / (full - none)).clamp(0.0, 1.0)
                } else {
                    f64::from(u8::from(cosine >= full))
                };
                share * share * (3.0 - 2.0 * share)
            }
        }
    }
}

impl Lamp {
    /// Refuses what is not finite, and directions and axes that are not unit vectors.
    pub fn check(&self) -> Result<()> {
        let unit = |v: [f64; 3]| (dot(v, v) - 1.0).abs() < 1e-6;
        for Source { at, colour, beam } in &self.sources {
            if !at.iter().chain(colour).all(|x| x.is_finite()) || colour.iter().any(|&x| x < 0.0) {
                return Err(Error::input(format!("expected a finite lamp of light >= 0, got {at:?} {colour:?}")));
            }
            let axis = match beam {
                Beam::Even => None,
                Beam::Cone(axis, _) | Beam::Facing(axis) => Some(*axis),
            };
            if self.far && !unit(*at) || axis.is_some_and(|axis| !unit(axis)) {
                return Err(Error::input(format!("expected unit vectors of a lamp, got {at:?} and {axis:?}")));
            }
        }
        Ok(())
    }

    /// What its sources see of some points.
    pub fn sights(
        &self,
        mesh: &Mesh,
        tracer: &Tracer,
        points: &Points,
        advance: &(dyn Fn(u64) -> Result<()> + Sync),
    ) -> Result<Sights> {
        let words = self.sources.len().div_ceil(64);
        let mut bits = vec![0u64; words * points.len()];
        let seen = if self.far { Lamp::far_sights } else { Lamp::near_sights };
        bits.par_chunks_mut((words * FAN).max(1)).enumerate().try_for_each_init(
            || (Segments::default(), Walk::default()),
            |room, (bundle, bits)| {
                let rows = bundle * FAN..(bundle * FAN + bits.len() / words);
                seen(self, mesh, tracer, (points, rows.clone()), room, bits);
                advance(rows.len() as u64)
            },
        )?;
        Ok(Sights { words, bits })
    }

    /// From each source to 64 points at a time.
    fn near_sights(
        &self,
        mesh: &Mesh,
        tracer: &Tracer,
        (points, rows): (&Points, std::ops::Range<usize>),
        (segments, _): &mut (Segments, Walk),
        bits: &mut [u64],
    ) {
        let words = bits.len() / rows.len();
        let ends = &points.origin[rows.clone()];
        for (number, source) in self.sources.iter().enumerate() {
            let from = mesh.normalised(source.at);
            let rises = |end: &[f32; 3], normal: &[f32; 3]| (0..3).map(|k| (from[k] - end[k]) * normal[k]).sum::<f32>();
            let above = |row: usize| {
                let end = &points.origin[row];
                rises(end, &points.normal[row]) > 0.0 && rises(end, &points.rise(row)) > 0.0
            };
            let facing =
                rows.clone().enumerate().fold(0u64, |mask, (place, row)| mask | u64::from(above(row)) << place);
            let mut seen = segments.seen(tracer, &Apex { origin: from, normal: [0.0; 3] }, ends, facing);
            while seen != 0 {
                bits[seen.trailing_zeros() as usize * words + number / 64] |= 1 << (number % 64);
                seen &= seen - 1;
            }
        }
    }

    /// From each point to 64 directions at a time.
    fn far_sights(
        &self,
        _: &Mesh,
        tracer: &Tracer,
        (points, rows): (&Points, std::ops::Range<usize>),
        (_, walk): &mut (Segments, Walk),
        bits: &mut [u64],
    ) {
        let words = bits.len() / rows.len();
        let directions: Vec<[f32; 3]> = self.sources.iter().map(|source| source.at.map(|x| x as f32)).collect();
        let fans = fans(&directions);
        for (row, bits) in rows.zip(bits.chunks_exact_mut(words)) {
            let (origin, normal) = (points.origin[row], points.rise(row));
            for (fan, places) in &fans {
                let over =
                    |place: usize, normal: [f32; 3]| (0..3).map(|k| directions[place][k] * normal[k]).sum::<f32>();
                let rises = |&place: &usize| over(place, normal) > 0.0 && over(place, points.normal[row]) > 0.0;
                let facing =
                    places.iter().enumerate().fold(0u64, |mask, (ray, place)| mask | u64::from(rises(place)) << ray);
                let blocked = if facing == 0 { 0 } else { tracer.blocked(&Apex { origin, normal }, fan, facing, walk) };
                let mut seen = facing & !blocked;
                while seen != 0 {
                    let place = places[seen.trailing_zeros() as usize];
                    bits[place / 64] |= 1 << (place % 64);
                    seen &= seen - 1;
                }
            }
        }
    }

    /// Ready for many points.
    fn shining(&self, mesh: &Mesh) -> Shining<'_> {
        let from = |source: &Source| if self.far { source.at } else { mesh.normalised(source.at).map(f64::from) };
        Shining { lamp: self, from: self.sources.iter().map(from).collect(), unit: mesh.scale * mesh.scale }
    }

    /// The irradiance of points over pi, what a white surface sends on: in the mean of each `together` neighbours.
    pub fn irradiance(&self, mesh: &Mesh, points: &Points, sights: &Sights, together: usize) -> Vec<[f64; 3]> {
        let shining = self.shining(mesh);
        let share = 1.0 / (std::f64::consts::PI * together as f64);
        let one = |number: usize| {
            let mut sum = [0.0; 3];
            for row in number * together..(number + 1) * together {
                let normal = points.normal[row].map(f64::from);
                shining.arriving(points.origin[row], sights.row(row), |source, towards, facing| {
                    let cosine = dot(towards, normal).max(0.0) * facing;
                    (0..3).for_each(|c| sum[c] += cosine * self.sources[source].colour[c]);
                });
            }
            sum.map(|x| share * x)
        };
        (0..points.len() / together).into_par_iter().with_min_len(FAN).map(one).collect()
    }

    /// What reaches some points and leaves them to eyes, unit vectors, by a model: ready for any parameter of it.
    pub fn glints(
        &self,
        mesh: &Mesh,
        (points, sights): (&Points, &Sights),
        rows: &[u32],
        eyes: &[[f32; 3]],
        edited: Edited,
    ) -> Glints {
        let shining = self.shining(mesh);
        let of_rows = |(rows, eyes): (&[u32], &[[f32; 3]])| {
            let (mut counts, mut each) = (Vec::with_capacity(rows.len()), Vec::with_capacity(rows.len()));
            for (&row, eye) in rows.iter().zip(eyes) {
                let (row, before) = (row as usize, each.len());
                let normal = points.normal[row].map(f64::from);
                let [tangent, bitangent] = frame(normal);
                let axes = [tangent, bitangent, normal];
                let wo = axes.map(|axis| dot(axis, eye.map(f64::from)));
                shining.arriving(points.origin[row], sights.row(row), |source, towards, facing| {
                    let wi = axes.map(|axis| dot(axis, towards));
                    if wi[2] <= 0.0 || wo[2] <= 0.0 {
                        return;
                    }
                    if let Some((fall, fixed)) = edited.fixed(wi, wo) {
                        let (at, share) = (edited.abscissa(fall) as f32, (fixed * wi[2] * facing) as f32);
                        each.push(Glint { at, share, source: source as u32 });
                    }
                });
                counts.push((each.len() - before) as u32);
            }
            (counts, each)
        };
        let parts: Vec<_> = rows.par_chunks(GLINTS).zip(eyes.par_chunks(GLINTS)).map(of_rows).collect();
        let colours = self.sources.iter().map(|source| source.colour).collect();
        let mut all = Glints { edited, colours, starts: vec![0], each: Vec::new() };
        for (counts, each) in parts {
            for count in counts {
                all.starts.push(all.starts[all.starts.len() - 1] + count);
            }
            all.each.extend(each);
        }
        all
    }
}

/// A lamp in the normalised scene.
struct Shining<'a> {
    lamp: &'a Lamp,
    /// Places, or of far ones directions.
    from: Vec<[f64; 3]>,
    /// What an area of the user's is there.
    unit: f64,
}

impl Shining<'_> {
    /// What arrives at a point: `take(source, towards it, what of its colour a facing surface receives)`, source after source.
    #[inline(always)]
    fn arriving(&self, place: [f32; 3], bits: &[u64], mut take: impl FnMut(usize, [f64; 3], f64)) {
        let at = place.map(f64::from);
        for (word, &bits) in bits.iter().enumerate() {
            let mut left = bits;
            while left != 0 {
                let source = 64 * word + left.trailing_zeros() as usize;
                left &= left - 1;
                let from = self.from[source];
                if self.lamp.far {
                    take(source, from, 1.0);
                    continue;
                }
                let way: [f64; 3] = std::array::from_fn(|k| from[k] - at[k]);
                let square = dot(way, way);
                let over = 1.0 / square.sqrt().max(f64::MIN_POSITIVE);
                let towards = way.map(|x| x * over);
                let beam = self.lamp.sources[source].beam.along(towards.map(|x| -x));
                // Lengths of the user's unit.
                take(source, towards, beam * self.unit / square.max(NEAREST * NEAREST));
            }
        }
    }
}

/// Light of one source that leaves a point to an eye through a lobe.
#[derive(Clone, Copy, Debug)]
struct Glint {
    /// The abscissa of f_E.
    at: f32,
    /// All that does not depend on the parameter, of the source's colour.
    share: f32,
    source: u32,
}

/// What of a lamp leaves some points through a model, whatever its parameter: f_E is all that is left to be taken.
#[derive(Clone, Debug)]
pub struct Glints {
    edited: Edited,
    colours: Vec<[f64; 3]>,
    /// Those of point n are `each[starts[n]..starts[n + 1]]`.
    starts: Vec<u32>,
    each: Vec<Glint>,
}

impl Glints {
    /// Points.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// f_E of a parameter, for `reflected`.
    pub fn curve(&self, gamma: f64) -> Curve {
        self.edited.at(gamma)
    }

    /// What a point sends to its eye.
    pub fn reflected(&self, point: usize, curve: Curve) -> [f64; 3] {
        let own = &self.each[self.starts[point] as usize..self.starts[point + 1] as usize];
        own.iter().fold([0.0; 3], |sum, glint| {
            let share = f64::from(glint.share) * curve.value(f64::from(glint.at));
            let colour = self.colours[glint.source as usize];
            std::array::from_fn(|c| sum[c] + share * colour[c])
        })
    }
}

impl Sights {
    fn row(&self, row: usize) -> &[u64] {
        &self.bits[row * self.words..(row + 1) * self.words]
    }
}
