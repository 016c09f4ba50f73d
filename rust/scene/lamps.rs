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
use crate::brdf::Direction;
use crate::error::{Error, Result};
use crate::sampling::frame;

/// Nearer than this, in the normalised scene, a source is as bright as here.
const NEAREST: f64 = 1e-4;

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

/// Light that arrives: from where, and how much a facing surface receives, in three colours.
struct Arriving {
    towards: [f64; 3],
    colour: [f64; 3],
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

    /// What arrives at a point, source after source.
    fn arriving<'a>(&'a self, mesh: &'a Mesh, place: [f32; 3], bits: &'a [u64]) -> impl Iterator<Item = Arriving> + 'a {
        let at = place.map(f64::from);
        self.sources.iter().enumerate().filter(|(number, _)| bits[number / 64] >> (number % 64) & 1 == 1).map(
            move |(_, source)| {
                if self.far {
                    return Arriving { towards: source.at, colour: source.colour };
                }
                let from = mesh.normalised(source.at);
                let way: [f64; 3] = std::array::from_fn(|k| f64::from(from[k]) - at[k]);
                let square = dot(way, way);
                let length = square.sqrt().max(f64::MIN_POSITIVE);
                let towards = way.map(|x| x / length);
                // Lengths of the user's unit.
                let share =
                    source.beam.along(towards.map(|x| -x)) * mesh.scale * mesh.scale / square.max(NEAREST * NEAREST);
                Arriving { towards, colour: source.colour.map(|x| x * share) }
            },
        )
    }

    /// The irradiance of all points, over pi: what a white surface sends on.
    pub fn irradiance(&self, mesh: &Mesh, points: &Points, sights: &Sights) -> Vec<[f64; 3]> {
        let one = |row: usize| {
            let normal = points.normal[row].map(f64::from);
            self.arriving(mesh, points.origin[row], sights.row(row)).fold([0.0; 3], |sum, light| {
                let cosine = dot(light.towards, normal).max(0.0) / std::f64::consts::PI;
                std::array::from_fn(|c| sum[c] + cosine * light.colour[c])
            })
        };
        (0..points.len()).into_par_iter().with_min_len(FAN).map(one).collect()
    }

    /// What some points reflect to eyes, unit vectors, by a lobe: f of the directions to the light and to the eye.
    pub fn reflected(
        &self,
        mesh: &Mesh,
        (points, sights): (&Points, &Sights),
        rows: &[u32],
        eyes: &[[f32; 3]],
        lobe: &(dyn Fn(Direction, Direction) -> f64 + Sync),
    ) -> Vec<[f64; 3]> {
        let one = |(&row, eye): (&u32, &[f32; 3])| {
            let row = row as usize;
            let normal = points.normal[row].map(f64::from);
            let [tangent, bitangent] = frame(normal);
            let axes = [tangent, bitangent, normal];
            let wo = axes.map(|axis| dot(axis, eye.map(f64::from)));
            self.arriving(mesh, points.origin[row], sights.row(row)).fold([0.0; 3], |sum, light| {
                let wi = axes.map(|axis| dot(axis, light.towards));
                let share = if wi[2] > 0.0 && wo[2] > 0.0 { lobe(wi, wo) * wi[2] } else { 0.0 };
                std::array::from_fn(|c| sum[c] + share * light.colour[c])
            })
        };
        rows.par_iter().zip(eyes).with_min_len(FAN).map(one).collect()
    }
}

impl Sights {
    fn row(&self, row: usize) -> &[u64] {
        &self.bits[row * self.words..(row + 1) * self.words]
    }
}
