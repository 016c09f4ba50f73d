//! Receivers: the rows of M. What a pixel shows, one row for each surface in it.
//!
//! Five rays a pixel, its centre and its corners (which neighbours share), tell whether it shows one surface. Where they
//! differ, 16 stratified rays do; their hits are gathered into surfaces, and each surface becomes a receiver with the share
//! of the pixel that it covers. Edges are then smooth at the cost of a few rows, not of 16 times the rays, and albedos stay
//! outside M: a receiver lies on one material.

use std::sync::Arc;

use rayon::prelude::*;

use super::camera::Camera;
use super::curve::along_curve;
use super::rays::tracer::LIFT;
use super::surface::{Point, Points, Surfaces, dot};
use crate::error::Result;

/// Surfaces kept in one pixel; what is smaller joins the largest.
const MAX_SURFACES: usize = 4;
/// Rays along a side of a pixel that shows several surfaces.
const SIDE: usize = 4;
/// Cosine between normals of one surface.
const SAME_NORMAL: f64 = 0.9;
/// How far, relative to its distance, another point of one surface may lie off the tangent plane.
const SAME_PLANE: f64 = 0.3;
/// Inside blocks of this many pixels a side rows are ordered by where they lie in space: neighbouring rows are then near
/// each other, even among leaves, and groups of 16 rows stay coherent.
const BLOCK: usize = 32;

/// How closely a pixel is looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelSampling {
    /// One ray through the centre.
    Centre,
    /// Edges are resolved by 4 x 4 rays.
    Edges,
}

/// The rows of M, in Morton order of their pixels.
#[derive(Clone, Debug, Default)]
pub struct Receivers {
    /// The pixel that each row adds to, row-major.
    pub pixel: Vec<u32>,
    /// Share of the pixel.
    pub weight: Vec<f32>,
    /// Triangle of the mesh, and weights of its corners 1 and 2 at the point.
    pub triangle: Vec<u32>,
    /// Weights of the triangle's corners 1 and 2 at the point; corner 0 has the rest.
    pub barycentric: Vec<[f32; 2]>,
    /// Where the rows' rays start, and their normals, towards the camera.
    pub points: Arc<Points>,
    /// Share of each pixel in which nothing is seen.
    pub background: Vec<f32>,
    /// Primary rays shot.
    pub rays: u64,
}

/// A point that a primary ray has found.
#[derive(Clone, Copy)]
struct Seen {
    at: Point,
    material: u32,
}

impl Seen {
    fn same_surface(&self, other: &Seen) -> bool {
        let apart: [f64; 3] = std::array::from_fn(|k| other.at.place[k] - self.at.place[k]);
        self.material == other.material
            && dot(self.at.normal, other.at.normal) > SAME_NORMAL
            && dot(self.at.normal, apart).abs() <= SAME_PLANE * dot(apart, apart).sqrt() + LIFT
    }
}

/// What a primary ray finds.
#[derive(Clone, Copy)]
struct Look {
    seen: Option<Seen>,
    /// Whether anything on its way was thin: its neighbours may find something else in the same surfaces.
    thin: bool,
}

/// The primary rays of a camera into a scene.
struct Primary<'a> {
    surfaces: Surfaces<'a>,
    material: &'a [u32],
    camera: &'a Camera,
    eye: [f32; 3],
}

impl Primary<'_> {
    /// What a ray through a point of the picture finds.
    fn look(&self, x: f64, y: f64) -> Look {
        let (at, thin) = self.surfaces.look(self.eye, self.camera.direction(x, y));
        let of = |at: Point| self.material[self.surfaces.mesh.source[at.triangle as usize] as usize];
        Look { seen: at.map(|at| Seen { at, material: of(at) }), thin }
    }
}

/// A surface in a pixel: a member to stand for it, and how many samples it has.
struct Surface {
    members: Vec<(Seen, [f64; 2])>,
}

impl Surface {
    /// The member nearest to the middle of them all.
    fn representative(&self) -> Seen {
        let count = self.members.len() as f64;
        let middle: [f64; 2] = std::array::from_fn(|k| self.members.iter().map(|(_, at)| at[k]).sum::<f64>() / count);
        let off = |at: &[f64; 2]| (at[0] - middle[0]).powi(2) + (at[1] - middle[1]).powi(2);
        let nearest = self.members.iter().min_by(|a, b| off(&a.1).total_cmp(&off(&b.1)));
        nearest.expect("a surface has members").0
    }
}

/// Gathers a pixel's samples into at most `MAX_SURFACES` surfaces, the largest first.
fn surfaces(samples: &[(Seen, [f64; 2])]) -> Vec<Surface> {
    let mut found: Vec<Surface> = Vec::new();
    for sample in samples {
        match found.iter_mut().find(|surface| surface.members[0].0.same_surface(&sample.0)) {
            Some(surface) => surface.members.push(*sample),
            None => found.push(Surface { members: vec![*sample] }),
        }
    }
    found.sort_by_key(|surface| std::cmp::Reverse(surface.members.len()));
    let small = found.split_off(found.len().min(MAX_SURFACES));
    for sample in small.into_iter().flat_map(|surface| surface.members) {
        let alike = found.iter().position(|surface| surface.members[0].0.material == sample.0.material);
        found[alike.unwrap_or(0)].members.push(sample);
    }
    found
}

/// What one pixel shows.
struct Pixel {
    surfaces: Vec<(Seen, f32)>,
    background: f32,
    rays: u64,
}

fn resolve(primary: &Primary, column: usize, row: usize, centre: Look, corners: [Look; 4]) -> Pixel {
    let thin = centre.thin || corners.iter().any(|corner| corner.thin);
    let alike = corners.iter().all(|corner| match (&centre.seen, &corner.seen) {
        (Some(a), Some(b)) => a.same_surface(b),
        (None, None) => true,
        _ => false,
    });
    if alike && !thin {
        return one_look(centre.seen);
    }
    // What is thin shows by how many rays it stops: that takes more of them than an edge.
    let side = if thin { 2 * SIDE } else { SIDE };
    let count = side * side;
    let mut samples = Vec::with_capacity(count);
    for k in 0..count {
        let at = [k % side, k / side].map(|number| (number as f64 + 0.5) / side as f64);
        if let Some(seen) = primary.look(column as f64 + at[0], row as f64 + at[1]).seen {
            samples.push((seen, at));
        }
    }
    let share = |rays: usize| rays as f32 / count as f32;
    let background = 1.0 - share(samples.len());
    let shares = surfaces(&samples).into_iter().map(|s| (s.representative(), share(s.members.len())));
    Pixel { surfaces: shares.collect(), background, rays: count as u64 }
}

/// A pixel that one ray speaks for.
fn one_look(seen: Option<Seen>) -> Pixel {
    let background = seen.is_none() as u8 as f32;
    Pixel { surfaces: seen.map(|seen| (seen, 1.0)).into_iter().collect(), background, rays: 0 }
}

fn interleave(column: usize, row: usize) -> u64 {
    (0..16).fold(0, |code, bit| {
        code | ((column >> bit & 1) as u64) << (2 * bit) | ((row >> bit & 1) as u64) << (2 * bit + 1)
    })
}

impl Receivers {
    /// Finds the receivers of every pixel of a camera. `material` has one entry for each of the user's triangles. `row_done`
    /// hears of every row of pixels, and may stop the search.
    pub fn of_pixels(
        surfaces: Surfaces,
        material: &[u32],
        camera: &Camera,
        sampling: PixelSampling,
        row_done: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<Receivers> {
        let (width, height) = (camera.width, camera.height);
        let primary = Primary { surfaces, material, camera, eye: surfaces.mesh.normalised(camera.position) };
        let pixels: Vec<Vec<Pixel>> = (0..height)
            .into_par_iter()
            .map(|row| {
                row_done()?;
                Ok(match sampling {
                    PixelSampling::Centre => (0..width)
                        .map(|column| one_look(primary.look(column as f64 + 0.5, row as f64 + 0.5).seen))
                        .collect(),
                    PixelSampling::Edges => {
                        let line =
                            |y: usize| -> Vec<_> { (0..=width).map(|x| primary.look(x as f64, y as f64)).collect() };
                        let (above, below) = (line(row), line(row + 1));
                        (0..width)
                            .map(|column| {
                                let centre = primary.look(column as f64 + 0.5, row as f64 + 0.5);
                                let corners = [above[column], above[column + 1], below[column], below[column + 1]];
                                resolve(&primary, column, row, centre, corners)
                            })
                            .collect()
                    }
                })
            })
            .collect::<Result<_>>()?;
        Ok(Self::in_order(width, height, sampling, &pixels))
    }

    /// Lays the rows out: blocks of pixels in Morton order, and along a Morton curve in space inside a block.
    fn in_order(width: usize, height: usize, sampling: PixelSampling, pixels: &[Vec<Pixel>]) -> Receivers {
        let per_pixel = if sampling == PixelSampling::Edges { 3 } else { 1 };
        let mut receivers = Receivers {
            rays: (width * height * per_pixel) as u64,
            background: vec![0.0; width * height],
            ..Default::default()
        };
        let mut rows = Vec::new();
        for (row, line) in pixels.iter().enumerate() {
            for (column, pixel) in line.iter().enumerate() {
                receivers.background[row * width + column] = pixel.background;
                receivers.rays += pixel.rays;
                let block = interleave(column / BLOCK, row / BLOCK);
                for &(seen, weight) in &pixel.surfaces {
                    let key = (block, along_curve(seen.at.place), interleave(column, row));
                    rows.push((key, (row * width + column) as u32, seen, weight));
                }
            }
        }
        rows.sort_by_key(|&(key, ..)| key);
        let mut points = Points::default();
        for (_, pixel, seen, weight) in rows {
            receivers.pixel.push(pixel);
            receivers.weight.push(weight);
            receivers.triangle.push(seen.at.triangle);
            receivers.barycentric.push(seen.at.barycentric);
            points.push(&seen.at);
        }
        receivers.points = Arc::new(points);
        receivers
    }

    /// The number of rows.
    pub fn len(&self) -> usize {
        self.pixel.len()
    }

    /// Whether nothing was seen in any pixel.
    pub fn is_empty(&self) -> bool {
        self.pixel.is_empty()
    }
}
