//! Gather samples: points of surfaces whose light is carried to others, and the cells that they stand for.
//!
//! ```text
//!     samples   where paths from the eye end after two rays; one in seven leaves what shines into its lobe, cos^200 about the
//!               mirror direction, the others leave any surface into an even hemisphere     (Nguyen 2010, section 5.1)
//!     cells     64 times as many points spread evenly over all surfaces, each given to the sample that is nearest in place and
//!               in the way it faces: they are the parts of the surface that the sample stands for, and sum to its area
//! ```
//!
//! The paper takes a disc of that area around the sample instead. Discs hang over edges and overlap; the points that were
//! counted anyway partition the surfaces, and error falls to a fourth where the lobe is narrow.
//! Samples lie in the order of a balanced tree over place and normal, that of `HaarTree`.

use std::f64::consts::PI;

use rayon::prelude::*;

use super::camera::Camera;
use super::near::Near;
use super::surface::{Point, Surfaces, dot};
use crate::error::{Error, Result};
use crate::sampling::{frame, jitter, mixed};

/// Points of a cell in the mean.
const EACH: usize = 64;
/// One sample in so many leaves what shines.
const GLOSSY: u64 = 7;
/// The exponent of its lobe.
const EXPONENT: f64 = 200.0;
/// Paths that are tried for a sample; half of those of a glossy one leave what shines, where anything does.
const TRIES: u64 = 64;
/// What a unit of a normal counts for beside places, in extents of the scene: cells do not wrap round edges.
const NORMAL: f64 = 0.3;
/// How far off the plane of a sample its points may lie, in their distance: what faces as it does further off, such as the
/// other side of a box seen from inside, is not its own.
const OFF_PLANE: f64 = 0.5;
/// Points of a triangle that one thread takes at a time.
const CHUNK: u64 = 1024;
/// The fewest and the most samples.
const FEWEST: usize = 64;
const MOST: usize = 1 << 20;

/// Samples and their cells, in the normalised scene.
pub struct GatherSamples {
    /// In the order of the tree.
    pub points: Vec<Point>,
    /// Whether each is the end of a glossy path.
    pub glossy: Vec<bool>,
    /// What each stands for; the sum is the area of all sides of surfaces that samples were found on.
    pub areas: Vec<f64>,
    /// The points of cell g are `cell_starts[g]..cell_starts[g + 1]`; none is empty.
    pub cell_starts: Vec<u32>,
    /// Places on the surface, spread evenly over the cell.
    pub cell_points: Vec<[f64; 3]>,
    /// The triangles that they lie on.
    pub cell_triangles: Vec<u32>,
    /// The samples, by place and normal.
    near: Near,
}

/// A point that was spread over the surfaces.
struct Spread {
    cell: u32,
    place: [f64; 3],
    triangle: u32,
    area: f64,
}

impl GatherSamples {
    /// By `count` paths of a camera. `glossy`: of each of the user's triangles, whether it shines. Samples that no point of a
    /// surface is nearest to stand for nothing, and are dropped.
    pub fn from_eye_paths(
        surfaces: Surfaces,
        camera: &Camera,
        glossy: &[bool],
        count: usize,
        advance: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<GatherSamples> {
        if !(FEWEST..=MOST).contains(&count) {
            return Err(Error::input(format!("expected {FEWEST} to {MOST} gather samples, got {count}")));
        }
        let triangles = surfaces.mesh.source.iter().map(|&source| source as usize + 1).max().unwrap_or(0);
        if glossy.len() < triangles {
            let got = glossy.len();
            return Err(Error::input(format!(
                "expected {triangles} numbers, one a triangle, of what shines, got {got}"
            )));
        }
        let path = |number: usize| -> Result<Option<(Point, bool)>> {
            advance()?;
            Ok(end_of_path(surfaces, camera, glossy, number as u64))
        };
        let found = (0..count).into_par_iter().with_min_len(EACH).map(path).collect::<Result<Vec<_>>>()?;
        let found: Vec<(Point, bool)> = found.into_iter().flatten().collect();
        if found.is_empty() {
            return Err(Error::input("expected surfaces that see each other, but no path from the camera meets two"));
        }
        let scale = NORMAL * surfaces.mesh.extent();
        let spread = assigned(surfaces, &found, scale, EACH * count, advance)?;
        Ok(GatherSamples::in_order(&found, spread, scale))
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// The square of the radius of the disc that is as large as the cell of a sample.
    #[inline(always)]
    pub fn radius2(&self, number: usize) -> f32 {
        (self.areas[number] / PI) as f32
    }

    /// The sample in whose cell a point of a surface lies; None on what no sample stands for.
    pub fn whose(&self, place: [f64; 3], normal: [f64; 3], room: &mut Vec<(f32, u32)>) -> Option<usize> {
        self.near.nearest(place, normal, 1, room);
        let number = room.first()?.1 as usize;
        is_own(&self.points[number], place, normal).then_some(number)
    }

    /// The points of a cell.
    pub fn cell(&self, number: usize) -> &[[f64; 3]] {
        &self.cell_points[self.cell_starts[number] as usize..self.cell_starts[number + 1] as usize]
    }

    fn in_order(found: &[(Point, bool)], spread: Vec<Spread>, scale: f64) -> GatherSamples {
        let mut areas = vec![0.0; found.len()];
        spread.iter().for_each(|own| areas[own.cell as usize] += own.area);
        let key = |point: &Point| -> [f64; 6] {
            std::array::from_fn(|k| if k < 3 { point.place[k] } else { scale * point.normal[k - 3] })
        };
        let mut order: Vec<([f64; 6], u32)> =
            (0..found.len()).filter(|&k| areas[k] > 0.0).map(|k| (key(&found[k].0), k as u32)).collect();
        let padded = order.len().next_power_of_two();
        divide(&mut order, padded);

        let mut place = vec![u32::MAX; found.len()];
        order.iter().enumerate().for_each(|(rank, &(_, number))| place[number as usize] = rank as u32);
        let mut spread = spread;
        // Stable: inside a cell points stay in the order in which they were spread.
        spread.sort_by_key(|own| place[own.cell as usize]);
        let mut cell_starts = vec![0u32; order.len() + 1];
        spread.iter().for_each(|own| cell_starts[place[own.cell as usize] as usize + 1] += 1);
        (0..order.len()).for_each(|k| cell_starts[k + 1] += cell_starts[k]);
        let points: Vec<Point> = order.iter().map(|&(_, number)| found[number as usize].0).collect();
        GatherSamples {
            near: Near::new(points.iter().map(|at| (at.place, at.normal)), scale),
            points,
            glossy: order.iter().map(|&(_, number)| found[number as usize].1).collect(),
            areas: order.iter().map(|&(_, number)| areas[number as usize]).collect(),
            cell_starts,
            cell_points: spread.iter().map(|own| own.place).collect(),
            cell_triangles: spread.iter().map(|own| own.triangle).collect(),
        }
    }
}

/// Puts the left half of a tree of `padded` leaves before the middle of the widest axis, and likewise on both sides.
fn divide(points: &mut [([f64; 6], u32)], padded: usize) {
    let half = padded / 2;
    if points.len() <= 1 {
        return;
    }
    if points.len() <= half {
        return divide(points, half);
    }
    let extent = |axis: usize| {
        let ends = (f64::INFINITY, f64::NEG_INFINITY);
        let (low, high) = points.iter().fold(ends, |(low, high), (key, _)| (low.min(key[axis]), high.max(key[axis])));
        high - low
    };
    let extents: [f64; 6] = std::array::from_fn(extent);
    let axis = (0..6).fold(0, |best, axis| if extents[axis] > extents[best] { axis } else { best });
    points.select_nth_unstable_by(half, |a, b| a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1)));
    let (left, right) = points.split_at_mut(half);
    divide(left, half);
    divide(right, half);
}

/// Where the `number`-th path ends, and whether it left a surface that shines into its lobe.
fn end_of_path(surfaces: Surfaces, camera: &Camera, glossy: &[bool], number: u64) -> Option<(Point, bool)> {
    let eye = surfaces.mesh.normalised(camera.position);
    (0..TRIES).find_map(|attempt| {
        let pair = |k: u64| jitter(mixed(number) ^ (2 * attempt + k));
        let [x, y] = pair(0);
        let first = surfaces.meet(eye, camera.direction(x * camera.width as f64, y * camera.height as f64))?;
        let into_lobe = number.is_multiple_of(GLOSSY) && attempt < TRIES / 2;
        if into_lobe && !glossy[surfaces.mesh.source[first.triangle as usize] as usize] {
            return None;
        }
        let towards = |k: usize| f64::from(eye[k]) - first.place[k];
        let direction = if into_lobe {
            let to_eye: [f64; 3] = std::array::from_fn(towards);
            let length = dot(to_eye, to_eye).sqrt();
            let up = 2.0 * dot(to_eye, first.normal) / length;
            let mirror: [f64; 3] = std::array::from_fn(|k| up * first.normal[k] - to_eye[k] / length);
            about(mirror, pair(1), |u| u.powf(1.0 / (EXPONENT + 1.0)))
        } else {
            about(first.normal, pair(1), |u| u)
        };
        if dot(direction, first.normal) <= 0.0 {
            return None;
        }
        Some((surfaces.meet(first.origin.map(|x| x as f32), direction)?, into_lobe))
    })
}

/// A direction at a cosine to an axis that one number says, turned by the other.
fn about(axis: [f64; 3], [u, turn]: [f64; 2], cosine: impl Fn(f64) -> f64) -> [f64; 3] {
    let [side, front] = frame(axis);
    let up = cosine(1.0 - u);
    let (across, (y, x)) = ((1.0 - up * up).max(0.0).sqrt(), (std::f64::consts::TAU * turn).sin_cos());
    std::array::from_fn(|k| up * axis[k] + across * (x * side[k] + y * front[k]))
}

/// About `count` points spread evenly over all surfaces, at least one a triangle, each given to the nearest sample of its
/// own side, or of both.
fn assigned(
    surfaces: Surfaces,
    samples: &[(Point, bool)],
    scale: f64,
    count: usize,
    advance: &(dyn Fn() -> Result<()> + Sync),
) -> Result<Vec<Spread>> {
    let near = Near::new(samples.iter().map(|(at, _)| (at.place, at.normal)), scale);
    let mesh = surfaces.mesh;
    let total: f64 = (0..mesh.corners.len()).map(|triangle| mesh.area(triangle)).sum();
    // The sides of triangles that paths end on. Where they do on one side only, the other is none that is seen; a small
    // triangle may have no sample, and its sides belong to those around it.
    let mut ends = vec![[false; 2]; mesh.corners.len()];
    for (at, _) in samples {
        ends[at.triangle as usize][usize::from(mesh.is_back(at.triangle, at.normal.map(|n| n as f32)))] = true;
    }
    let on_triangle = |triangle: usize| -> Result<Vec<Spread>> {
        let own = (mesh.area(triangle) / total * count as f64).round().max(1.0) as u64;
        let (area, front) = (mesh.area(triangle) / own as f64, mesh.normal(triangle));
        let sides = [(front, ends[triangle][0]), (front.map(|n| -n), ends[triangle][1])];
        let neither = ends[triangle] == [false; 2];
        let of_chunk = |first: u64| -> Result<Vec<Spread>> {
            advance()?;
            let (mut found, mut room) = (Vec::new(), Vec::new());
            for number in first..own.min(first + CHUNK) {
                let place = mesh.place(triangle, evenly(number, triangle as u64));
                for (normal, _) in sides.into_iter().filter(|&(_, ended)| ended || neither) {
                    near.nearest(place, normal, 1, &mut room);
                    let Some(&(_, cell)) = room.first() else { continue };
                    if is_own(&samples[cell as usize].0, place, normal) {
                        found.push(Spread { cell, place, triangle: triangle as u32, area });
                    }
                }
            }
            Ok(found)
        };
        let chunks = (0..own.div_ceil(CHUNK)).into_par_iter().map(|chunk| of_chunk(chunk * CHUNK));
        Ok(chunks.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect())
    };
    let found = (0..mesh.corners.len()).into_par_iter().map(on_triangle).collect::<Result<Vec<_>>>()?;
    Ok(found.into_iter().flatten().collect())
}

/// Whether a point that faces along `normal` lies on the surface that a sample lies on.
fn is_own(sample: &Point, place: [f64; 3], normal: [f64; 3]) -> bool {
    let apart: [f64; 3] = std::array::from_fn(|k| place[k] - sample.place[k]);
    let off = dot(apart, sample.normal);
    dot(sample.normal, normal) > 0.0 && off * off <= OFF_PLANE * OFF_PLANE * dot(apart, apart)
}

/// The `number`-th point of a triangle, spread evenly whatever their count (the R2 sequence of Roberts 2018), as weights of
/// corners 1 and 2.
fn evenly(number: u64, seed: u64) -> [f32; 2] {
    const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];
    let moved = jitter(mixed(seed));
    let [x, y]: [f64; 2] = std::array::from_fn(|k| (moved[k] + number as f64 * STEPS[k]).fract());
    // The square's upper half is folded onto the triangle.
    if x + y > 1.0 { [(1.0 - x) as f32, (1.0 - y) as f32] } else { [x as f32, y as f32] }
}
