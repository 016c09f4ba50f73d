//! Rows of what receivers take from gather samples: through a lobe, a family's functions of it, or cosines.
//!
//! ```text
//!     T_kg(x) = V_g(x) A_g / m sum over q of b_k f_F cos_x(q) cos_g(q) / |x - q|^2       (Nguyen 2010, eq. 4 with X16's density)
//! ```
//!
//! q are m points of what g stands for: g itself, a disc of its area around it (the paper's), or points of its cell. Neither
//! the light nor what is hidden changes over them. |x - q|² is not taken for less than A_g / m; then a row is scaled: the
//! same sum with cosines must be the share of even light that x receives from surfaces, which rays count. Of lobes it is
//! scaled where that is less only.

use std::f64::consts::{FRAC_1_PI, PI, TAU};

use rayon::prelude::*;

use crate::brdf::Brdf;
use crate::brdf::family::Family;
use crate::error::{Error, Result};
use crate::sampling::{cosine_directions, frame, jitter, mixed};
use crate::scene::rays::{Apex, FAN, LIFT, Segments, Tracer};
use crate::scene::surface::dot;
use crate::scene::{GatherSamples, Point, Surfaces};

/// Rays along a side that say how closed the surroundings of a receiver are.
const CLOSED: usize = 16;
/// From half of a lobe's height to 1 / e of it.
const TO_E: f64 = 1.2;
/// Turns between points of a disc: the golden angle.
const GOLDEN: f64 = 0.381_966_011_250_105_1;

/// What rows are taken through.
#[derive(Clone, Copy)]
pub enum Kernel<'a> {
    /// Cosines: rows of D.
    Diffuse,
    /// A lobe as it is.
    Lobe(&'a dyn Brdf),
    /// The functions of a segment of a family.
    Family(&'a Family, usize),
}

/// The points that stand for what a sample stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SubArea {
    /// The sample.
    Centre,
    /// So many of a disc of its area.
    Disc(usize),
    /// So many of its cell.
    Cell(usize),
    /// Of its cell, the more the wider it is seen beside the lobe: 1, 4, 16 or 64.
    ByAngle,
}

/// Where light is gathered.
#[derive(Clone, Copy, Debug)]
pub struct Receiver {
    /// Off its surface.
    pub origin: [f32; 3],
    /// Unit normal.
    pub normal: [f32; 3],
    /// Unit vector to the eye.
    pub eye: [f64; 3],
}

/// What is gathered, and how.
#[derive(Clone, Copy)]
pub struct Gather<'a> {
    /// The scene.
    pub surfaces: Surfaces<'a>,
    /// Its samples.
    pub samples: &'a GatherSamples,
    /// Through what.
    pub kernel: Kernel<'a>,
    /// By which points.
    pub sub_area: SubArea,
}

impl Kernel<'_> {
    /// Rows of each receiver.
    pub fn count(self) -> usize {
        match self {
            Kernel::Diffuse | Kernel::Lobe(_) => 1,
            Kernel::Family(family, _) => family.live(),
        }
    }

    /// Radians from the axis to where the narrowest lobe has fallen to 1 / e, seen along the normal.
    fn width(self) -> f64 {
        match self {
            Kernel::Diffuse => 1.0,
            Kernel::Lobe(lobe) => TO_E * lobe.half_width([0.0, 0.0, 1.0]),
            Kernel::Family(family, segment) => family.width(segment),
        }
    }

    /// Adds f cos of a direction, times a share, to the sum of each row.
    fn add(self, [wi, wo]: [[f64; 3]; 2], share: f64, sums: &mut [f64]) {
        match self {
            Kernel::Diffuse => sums[0] += share * wi[2] * FRAC_1_PI,
            Kernel::Lobe(lobe) => sums[0] += share * wi[2] * lobe.evaluate(wi, wo),
            Kernel::Family(family, segment) => {
                if let Some((fall, fixed)) = family.edited().fixed(wi, wo) {
                    let share = share * wi[2] * fixed;
                    sums.iter_mut().zip(family.basis(segment, fall)).for_each(|(sum, b)| *sum += share * b);
                }
            }
        }
    }
}

impl SubArea {
    /// Refuses no points, and more than cells have.
    pub fn check(self) -> Result<SubArea> {
        match self {
            SubArea::Disc(points) | SubArea::Cell(points) if !(1..=64).contains(&points) => {
                Err(Error::input(format!("expected 1 to 64 points, got {points}")))
            }
            _ => Ok(self),
        }
    }

    /// How many points of a sample of a radius, seen from a distance through a lobe of a width.
    fn count(self, radius: f64, distance: f64, width: f64) -> usize {
        match self {
            SubArea::Centre => 1,
            SubArea::Disc(points) | SubArea::Cell(points) => points,
            SubArea::ByAngle => match radius / (distance * width) {
                wide if wide < 0.1 => 1,
                wide if wide < 0.2 => 4,
                wide if wide < 0.4 => 16,
                _ => 64,
            },
        }
    }
}

/// A receiver's place, its frame (tangent, bitangent, normal), and the eye in it.
struct Standing {
    place: [f64; 3],
    frame: [[f64; 3]; 3],
    wo: [f64; 3],
}

impl Standing {
    fn of(receiver: &Receiver) -> Standing {
        let normal = receiver.normal.map(f64::from);
        let [tangent, bitangent] = frame(normal);
        let frame = [tangent, bitangent, normal];
        Standing { place: receiver.origin.map(f64::from), wo: frame.map(|axis| dot(axis, receiver.eye)), frame }
    }
}

impl Gather<'_> {
    /// The rows of up to 64 receivers: `[receiver][row][sample]`.
    pub fn rows(&self, receivers: &[Receiver], segments: &mut Segments) -> Vec<f32> {
        debug_assert!(receivers.len() <= FAN);
        let (count, rows) = (self.samples.len(), self.kernel.count());
        let width = self.kernel.width();
        let standing: Vec<Standing> = receivers.iter().map(Standing::of).collect();
        let ends: Vec<[f32; 3]> = receivers.iter().map(|receiver| receiver.origin).collect();
        let mut out = vec![0.0f32; receivers.len() * rows * count];
        let (mut even, mut sums, mut points) = (vec![0.0f64; receivers.len()], vec![0.0; rows], Vec::new());
        for (number, sample) in self.samples.points.iter().enumerate() {
            let mut seen = self.seen(sample, &standing, &ends, segments);
            let radius = (self.samples.areas[number] / PI).sqrt();
            while seen != 0 {
                let own = seen.trailing_zeros() as usize;
                seen &= seen - 1;
                let at = &standing[own];
                let away: [f64; 3] = std::array::from_fn(|k| sample.place[k] - at.place[k]);
                let m = self.sub_area.count(radius, dot(away, away).sqrt(), width);
                self.spread(number, m, &mut points);
                sums.fill(0.0);
                even[own] += self.gathered(number, at, &points, &mut sums);
                for (row, sum) in sums.iter().enumerate() {
                    out[(own * rows + row) * count + number] = *sum as f32;
                }
            }
        }
        for (own, (receiver, even)) in receivers.iter().zip(even).enumerate() {
            let scale = self.scale(receiver, even);
            out[own * rows * count..][..rows * count].iter_mut().for_each(|value| *value *= scale);
        }
        out
    }

    /// The rows of any number of receivers. `advance` hears of every 64 and may stop it.
    pub fn matrix(&self, receivers: &[Receiver], advance: &(dyn Fn(u64) -> Result<()> + Sync)) -> Result<Vec<f32>> {
        let of_bundle = |segments: &mut Segments, bundle: &[Receiver]| -> Result<Vec<f32>> {
            advance(bundle.len() as u64)?;
            Ok(self.rows(bundle, segments))
        };
        let found = receivers.par_chunks(FAN).map_init(Segments::default, of_bundle).collect::<Result<Vec<_>>>()?;
        Ok(found.into_iter().flatten().collect())
    }

    /// What all receivers gather of light at the samples, `[receiver][row]`. `advance` hears of every 64 and may stop it.
    pub fn light(
        &self,
        receivers: &[Receiver],
        light: &[[f64; 3]],
        advance: &(dyn Fn(u64) -> Result<()> + Sync),
    ) -> Result<Vec<[f64; 3]>> {
        let count = self.samples.len();
        if light.len() != count {
            return Err(Error::input(format!("expected the light of {count} samples, got that of {}", light.len())));
        }
        let times = |row: &[f32]| {
            row.iter()
                .zip(light)
                .filter(|(weight, _)| **weight != 0.0)
                .fold([0.0; 3], |sum, (&weight, light)| std::array::from_fn(|c| sum[c] + f64::from(weight) * light[c]))
        };
        let of_bundle = |segments: &mut Segments, bundle: &[Receiver]| -> Result<Vec<[f64; 3]>> {
            advance(bundle.len() as u64)?;
            Ok(self.rows(bundle, segments).chunks_exact(count).map(times).collect())
        };
        let found = receivers.par_chunks(FAN).map_init(Segments::default, of_bundle).collect::<Result<Vec<_>>>()?;
        Ok(found.into_iter().flatten().collect())
    }

    /// The receivers that see a sample, both facing each other.
    fn seen(&self, sample: &Point, standing: &[Standing], ends: &[[f32; 3]], segments: &mut Segments) -> u64 {
        let mut facing = 0;
        for (number, at) in standing.iter().enumerate() {
            let away: [f64; 3] = std::array::from_fn(|k| sample.place[k] - at.place[k]);
            let faces = dot(away, at.frame[2]) > 0.0 && dot(away, sample.normal) < 0.0;
            facing |= u64::from(faces) << number;
        }
        let apex = Apex { origin: sample.origin.map(|x| x as f32), normal: sample.normal.map(|x| x as f32) };
        segments.seen(self.surfaces.tracer, &apex, ends, facing)
    }

    /// The points of what a sample stands for.
    fn spread(&self, number: usize, m: usize, points: &mut Vec<[f64; 3]>) {
        points.clear();
        let sample = &self.samples.points[number];
        match self.sub_area {
            SubArea::Centre => points.push(sample.place),
            SubArea::Disc(_) => {
                let ([side, front], radius) = (frame(sample.normal), (self.samples.areas[number] / PI).sqrt());
                points.extend((0..m).map(|k| {
                    let (y, x) = (TAU * GOLDEN * k as f64).sin_cos();
                    let out = radius * ((k as f64 + 0.5) / m as f64).sqrt();
                    std::array::from_fn(|axis| sample.place[axis] + out * (x * side[axis] + y * front[axis]))
                }));
            }
            SubArea::Cell(_) | SubArea::ByAngle => {
                let cell = self.samples.cell(number);
                let m = m.min(cell.len());
                points.extend((0..m).map(|k| cell[(2 * k + 1) * cell.len() / (2 * m)]));
            }
        }
    }

    /// Adds what a receiver takes through all points of a sample to its rows, and returns what it takes with cosines.
    fn gathered(&self, number: usize, at: &Standing, points: &[[f64; 3]], sums: &mut [f64]) -> f64 {
        let normal = self.samples.points[number].normal;
        let part = self.samples.areas[number] / points.len() as f64;
        let mut even = 0.0;
        for q in points {
            let away: [f64; 3] = std::array::from_fn(|k| q[k] - at.place[k]);
            let square = dot(away, away);
            let distance = square.sqrt();
            let (wi, down) = (at.frame.map(|axis| dot(axis, away) / distance), -dot(normal, away) / distance);
            if wi[2] <= 0.0 || down <= 0.0 {
                continue;
            }
            let share = part * down / square.max(part);
            even += share * wi[2] * FRAC_1_PI;
            self.kernel.add([wi, at.wo], share, sums);
        }
        even
    }

    /// By how much the rows of a receiver are too low or too high.
    fn scale(&self, receiver: &Receiver, even: f64) -> f32 {
        if even <= 0.0 {
            return 0.0;
        }
        let scale = self.closed(receiver) / even;
        (if matches!(self.kernel, Kernel::Diffuse) { scale } else { scale.min(1.0) }) as f32
    }

    /// The share of even light that a receiver would take from surfaces.
    fn closed(&self, receiver: &Receiver) -> f64 {
        let seed = receiver.origin.iter().fold(0, |seed, x| mixed(seed ^ u64::from(x.to_bits())));
        let directions = cosine_directions(receiver.normal.map(f64::from), CLOSED, seed);
        let meets = |direction: &[f64; 3]| self.surfaces.tracer.occluded(receiver.origin, direction.map(|x| x as f32));
        directions.filter(meets).count() as f64 / (CLOSED * CLOSED) as f64
    }
}

/// What `side` x `side` rays of a lobe meet, and what each stands for: the reference of what is gathered.
pub fn lobe_hits(surfaces: Surfaces, receiver: &Receiver, lobe: &dyn Brdf, side: usize) -> Vec<(Option<Point>, f64)> {
    let Standing { frame, wo, .. } = Standing::of(receiver);
    let count = side * side;
    let hit = |k: usize| {
        let [x, y] = jitter(mixed(k as u64));
        let at = [((k % side) as f64 + x) / side as f64, ((k / side) as f64 + y) / side as f64];
        let Some((wi, pdf)) = lobe.sample(wo, at) else { return (None, 0.0) };
        let direction = std::array::from_fn(|k| (0..3).map(|axis| wi[axis] * frame[axis][k]).sum());
        let share = lobe.evaluate(wi, wo) * wi[2] / pdf / count as f64;
        (surfaces.meet(receiver.origin, direction), share)
    };
    (0..count).map(hit).collect()
}

/// Which of up to 64 points of surfaces, one bit each, a point in space sees: they face it, and nothing lies between.
pub fn seen_from(
    tracer: &Tracer,
    from: [f32; 3],
    places: &[[f32; 3]],
    normals: &[[f32; 3]],
    segments: &mut Segments,
) -> u64 {
    let (mut facing, mut ends) = (0, [[0.0f32; 3]; FAN]);
    for (number, (place, normal)) in places.iter().zip(normals).enumerate() {
        ends[number] = std::array::from_fn(|k| place[k] + LIFT as f32 * normal[k]);
        let up: f32 = (0..3).map(|k| (from[k] - place[k]) * normal[k]).sum();
        facing |= u64::from(up > 0.0) << number;
    }
    segments.seen(tracer, &Apex { origin: from, normal: [0.0; 3] }, &ends[..places.len()], facing)
}
