//! Nodes: points of surfaces at which light between surfaces is solved, as dense as it varies.
//!
//! ```text
//!     candidates   what the camera sees, and what a ray each from there meets
//!                  (or all vertices, and samples of all surfaces)
//!     R            harmonic mean distance of what a candidate sees around it (Ward, Rubinstein and Clear 1988)
//!     r            a R, between 3 and 37 pixels of a picture of 512 lines
//!     nodes        candidates in the order of a hash, each unless one of its side lies within r of it
//! ```
//!
//! Pixels are the unit, not the scene: a plant on a wide ground needs nodes of its leaves' size. Each node stands for a
//! cell: a few points around it, at which light that arrives directly is taken.

use std::sync::Arc;

use rayon::prelude::*;

use super::camera::Camera;
use super::curve::{along_curve, facing};
use super::near::Near;
use super::rays::tracer::LIFT;
use super::surface::{Point, Points, Surfaces, dot};
use super::vertices::Vertices;
use crate::error::{Error, Result};
use crate::sampling::{chosen, cosine_directions, frame, jitter, mixed};

/// Points of a cell.
pub const CELL: usize = 4;
/// Lines of the picture whose pixels are meant, whatever the camera's own.
const LINES: f64 = 512.0;
/// Pixels of it between candidates.
const BETWEEN: usize = 2;
/// The least and the largest spacing, in pixels.
const LEAST: f64 = 3.0;
const MOST: f64 = 37.0;
/// Rays by which a candidate learns how far surfaces are, along each side of the stratification.
const AROUND: usize = 6;
/// So much wider is the spacing of what the camera does not see itself.
const SECOND_HAND: f64 = 2.0;
/// Cosine between normals of one side: 25 degrees.
const ONE_SIDE: f64 = 0.906;
/// What a unit of a normal counts for beside places, in median spacings.
const NORMAL: f64 = 40.0;
/// Least cosine between the normals of a node and of what it speaks for.
const FACING: f64 = 0.8;
/// Spacings that a node speaks for, along its surface and off it.
const ALONG: f64 = 3.0;
/// See `ALONG`.
const OFF: f64 = 2.0;
/// Of the way to a parallel surface behind, a spacing is at most this share: else the nodes of that one, a ceiling, would be
/// taken for those of this one, a lamp under it.
const HALFWAY: f64 = 0.5;
/// A node lies across a surface where so much of the way to it leads off the surface; of so many nodes one may lie in it.
const ACROSS: f64 = 0.7;
const BEHIND: usize = 16;
/// A hit further from the nearest node than so many times the largest spacing there is nobody's.
const BEYOND: f64 = 4.0;
/// How far from a node points of its cell are looked for, in spacings, and how often.
const FURTHEST: f64 = 1.5;
const TRIES: usize = 96;

/// How densely nodes are placed.
#[derive(Clone, Copy, Debug)]
pub struct Spacing {
    /// The share of the distance to other surfaces: 0.12 for publication, 0.2 for a preview.
    pub share: f64,
    /// At most so many nodes: the share grows until they are no more.
    pub cap: usize,
}

/// A node.
#[derive(Clone, Copy, Debug)]
pub struct Node {
    /// In the normalised scene, on a surface.
    pub place: [f64; 3],
    /// Unit geometric normal of the side that is meant.
    pub normal: [f64; 3],
    /// Where rays from it start: off the surface.
    pub origin: [f64; 3],
    /// As far as it stands for its surroundings.
    pub spacing: f64,
    /// The largest spacing that there could be here.
    pub reach: f64,
}

/// The nodes of a scene, along a curve: neighbours in the list are near each other and face alike.
pub struct Nodes {
    /// One after the other.
    pub nodes: Vec<Node>,
    near: Near,
}

/// Nodes as they were placed.
pub struct Placed {
    /// The nodes.
    pub nodes: Nodes,
    /// `CELL` points of each, over which light that arrives directly is averaged.
    pub cells: Vec<[Point; CELL]>,
    /// Rays shot to place them.
    pub rays: u64,
}

/// Where light between surfaces is wanted, and how finely.
#[derive(Clone, Copy)]
pub enum Wanted<'a> {
    /// Where a camera sees surfaces: in its pixels.
    Seen(&'a Camera),
    /// On all surfaces that lie open: in the size of their triangles, and at these vertices anyway.
    Everywhere(&'a Vertices),
}

/// Samples of all surfaces, evenly spread, where no camera says what matters.
const SAMPLES: usize = 1 << 16;

/// A point that may become a node.
struct Candidate {
    at: Point,
    spacing: f64,
    reach: f64,
    order: u64,
}

/// Who says where candidates are.
struct Looking<'a> {
    surfaces: Surfaces<'a>,
    wanted: Wanted<'a>,
    /// Of pictures: the eye and the size of a pixel at distance 1. Of all surfaces: the sums of areas up to each triangle.
    eye: [f64; 3],
    pixel: f64,
    columns: usize,
    areas: Vec<f64>,
}

impl<'a> Looking<'a> {
    fn new(surfaces: Surfaces<'a>, wanted: Wanted<'a>) -> Self {
        let mut own = Looking { surfaces, wanted, eye: [0.0; 3], pixel: 0.0, columns: 0, areas: Vec::new() };
        match wanted {
            Wanted::Seen(camera) => {
                own.eye = surfaces.mesh.normalised(camera.position).map(f64::from);
                own.pixel = 2.0 * camera.half_height / LINES;
                own.columns = (Self::ROWS * camera.width).div_ceil(camera.height);
            }
            Wanted::Everywhere(_) => {
                own.pixel = surfaces.mesh.extent() / LINES;
                own.areas = (0..surfaces.mesh.corners.len())
                    .scan(0.0, |sum, triangle| {
                        *sum += surfaces.mesh.area(triangle);
                        Some(*sum)
                    })
                    .collect();
            }
        }
        own
    }

    /// Rows of candidates in a picture.
    const ROWS: usize = (LINES as usize).div_ceil(BETWEEN);

    /// How many places are looked at.
    fn count(&self) -> usize {
        match self.wanted {
            Wanted::Seen(_) => Self::ROWS * self.columns,
            Wanted::Everywhere(vertices) => vertices.places.len() + SAMPLES,
        }
    }

    /// The `number`-th place.
    fn first(&self, number: usize) -> Option<Point> {
        match self.wanted {
            Wanted::Seen(camera) => {
                let [x, y] = jitter(number as u64);
                let x = ((number % self.columns) as f64 + x) / self.columns as f64 * camera.width as f64;
                let y = ((number / self.columns) as f64 + y) / Self::ROWS as f64 * camera.height as f64;
                self.surfaces.meet(self.eye.map(|x| x as f32), camera.direction(x, y))
            }
            Wanted::Everywhere(vertices) => match number.checked_sub(vertices.places.len()) {
                None => Some(vertices.places[number]),
                Some(sample) => {
                    let [x, y] = jitter(number as u64);
                    let at = (sample as f64 + x) / SAMPLES as f64 * self.areas.last()?;
                    let (triangle, inside) = chosen(&self.areas, at);
                    let inside = inside.sqrt();
                    let back = match vertices.open[triangle] {
                        [true, true] => mixed(number as u64) & 1 == 1,
                        [front, _] => !front,
                    };
                    Some(self.surfaces.side(triangle, [(inside * (1.0 - y)) as f32, (inside * y) as f32], back))
                }
            },
        }
    }

    /// The length that is resolved at a point.
    fn unit(&self, at: &Point) -> f64 {
        match self.wanted {
            Wanted::Seen(_) => {
                let away: [f64; 3] = std::array::from_fn(|k| at.place[k] - self.eye[k]);
                self.pixel * dot(away, away).sqrt()
            }
            // A triangle is as a pixel of a picture, as far as a picture of the scene would resolve less.
            Wanted::Everywhere(_) => {
                self.surfaces.mesh.area(at.triangle as usize).sqrt().clamp(self.pixel / 8.0, self.pixel)
            }
        }
    }
}

impl Placed {
    /// Places nodes where light is wanted, and where what is there sees others. `advance` hears of work done, and may stop
    /// it.
    pub fn place(
        surfaces: Surfaces,
        wanted: Wanted,
        spacing: Spacing,
        advance: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<Placed> {
        if !(spacing.share > 0.0 && spacing.share.is_finite()) || spacing.cap == 0 {
            let Spacing { share, cap } = spacing;
            return Err(Error::input(format!(
                "expected nodes at a share above 0 and at least one, got {share}, {cap}"
            )));
        }
        const CHUNK: usize = 256;
        let looking = Looking::new(surfaces, wanted);
        let look = |chunk: usize| -> Result<(Vec<Candidate>, u64)> {
            advance()?;
            let own = chunk * CHUNK..looking.count().min((chunk + 1) * CHUNK);
            let (mut found, mut rays) = (Vec::new(), own.len() as u64);
            for number in own {
                let Some(first) = looking.first(number) else { continue };
                let number = number as u64;
                let onwards = cosine_directions(first.normal, 1, number).next();
                let second = onwards.and_then(|way| surfaces.meet(first.origin.map(|x| x as f32), way));
                rays += 1;
                for (k, at) in [Some(first), second].into_iter().enumerate() {
                    let Some(at) = at else { continue };
                    let unit = looking.unit(&at);
                    let share = spacing.share * if k == 0 { 1.0 } else { SECOND_HAND };
                    let (around, order) = (clearance(surfaces, &at, number), mixed(2 * number + k as u64));
                    rays += (AROUND * AROUND) as u64 + 1;
                    found.push(Candidate {
                        at,
                        spacing: (share * around).min(HALFWAY * behind(surfaces, &at)).clamp(LEAST * unit, MOST * unit),
                        reach: MOST * unit,
                        order,
                    });
                }
            }
            Ok((found, rays))
        };
        let chunks = (0..looking.count().div_ceil(CHUNK)).into_par_iter().map(look).collect::<Result<Vec<_>>>()?;
        let rays = chunks.iter().map(|(_, rays)| rays).sum();
        let mut candidates: Vec<Candidate> = chunks.into_iter().flat_map(|(found, _)| found).collect();
        candidates.sort_by_key(|candidate| candidate.order);

        let mut wider = 1.0;
        let mut chosen = throw(&candidates, wider);
        while chosen.len() > spacing.cap {
            advance()?;
            wider *= 1.05 * (chosen.len() as f64 / spacing.cap as f64).sqrt();
            chosen = throw(&candidates, wider);
        }
        // The way a surface faces first, then where it lies.
        chosen.sort_by_cached_key(|at| (facing(at.at.normal), along_curve(at.at.place)));
        let node = |own: &Candidate| {
            let Point { place, normal, origin, .. } = own.at;
            Node { place, normal, origin, spacing: own.spacing, reach: own.reach }
        };
        let nodes = Nodes::new(chosen.iter().map(node).collect());
        let cells = chosen.par_iter().enumerate().map(|(k, own)| cell(surfaces, &nodes.near, k, own)).collect();
        Ok(Placed { nodes, cells, rays })
    }

    /// The points of all cells as a pass takes them: the first of `group` nodes, then the second of each, and so on. The last
    /// node stands in where the last group is not full.
    pub fn cell_points(&self, group: usize) -> Arc<Points> {
        let mut points = Points::default();
        for cells in self.cells.chunks(group) {
            let point = |k: usize| &cells[(k % group).min(cells.len() - 1)][k / group];
            (0..group * CELL).for_each(|k| points.push(point(k)));
        }
        Arc::new(points)
    }
}

impl Nodes {
    /// Makes them ready to be asked.
    pub fn new(nodes: Vec<Node>) -> Nodes {
        let mut spacings: Vec<f64> = nodes.iter().map(|node| node.spacing).collect();
        spacings.sort_by(f64::total_cmp);
        let scale = NORMAL * spacings.get(spacings.len() / 2).copied().unwrap_or(1.0);
        let near = Near::new(nodes.iter().map(|node| (node.place, node.normal)), scale);
        Nodes { nodes, near }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// The node that stands for a point that a ray has met: the nearest, but where that lies on another surface before or
    /// behind it, the nearest that speaks for it, if any does; `room` is scratch.
    pub fn nearest(&self, at: &Point, room: &mut Vec<(f32, u32)>) -> Option<usize> {
        self.near.nearest(at.place, at.normal, 1, room);
        let number = room.first()?.1 as usize;
        let node = &self.nodes[number];
        let apart: [f64; 3] = std::array::from_fn(|k| node.place[k] - at.place[k]);
        let (distance, off) = (dot(apart, apart).sqrt(), dot(apart, at.normal).abs());
        if off > OFF * node.spacing && off > ACROSS * distance {
            self.near.nearest(at.place, at.normal, BEHIND, room);
            let mut around = room.iter().map(|&(_, number)| number as usize);
            if let Some(own) = around.find(|&own| self.distance_spoken(own, at.place, at.normal).is_some()) {
                return Some(own);
            }
        }
        (distance <= BEYOND * node.reach && dot(node.normal, at.normal) > 0.0).then_some(number)
    }

    /// How far a node is from a surface that it speaks for; None where it does not.
    pub fn distance_spoken(&self, number: usize, place: [f64; 3], normal: [f64; 3]) -> Option<f64> {
        let node = &self.nodes[number];
        let apart: [f64; 3] = std::array::from_fn(|k| node.place[k] - place[k]);
        let distance = dot(apart, apart).sqrt();
        let speaks = dot(node.normal, normal) > FACING
            && distance < ALONG * node.spacing
            && dot(apart, node.normal).abs() < OFF * node.spacing;
        speaks.then_some(distance)
    }

    /// The numbers of the `count` nearest nodes, the nearest first; `room` is scratch.
    pub fn several<'a>(
        &self,
        place: [f64; 3],
        normal: [f64; 3],
        count: usize,
        room: &'a mut Vec<(f32, u32)>,
    ) -> impl Iterator<Item = usize> + use<'a> {
        self.near.nearest(place, normal, count, room);
        room.iter().map(|&(_, number)| number as usize)
    }
}

/// How far other surfaces are from a point, by the harmonic mean; infinite where it sees none.
fn clearance(surfaces: Surfaces, at: &Point, seed: u64) -> f64 {
    let origin = at.origin.map(|x| x as f32);
    let inverse = |direction| surfaces.meet(origin, direction).map_or(0.0, |hit| 1.0 / hit.distance.max(1e-12));
    let sum: f64 = cosine_directions(at.normal, AROUND, seed).map(inverse).sum();
    if sum > 0.0 { (AROUND * AROUND) as f64 / sum } else { f64::INFINITY }
}

/// How far the next surface behind a point is that faces the same way; infinitely far where there is none.
fn behind(surfaces: Surfaces, at: &Point) -> f64 {
    let away = at.normal.map(|n| -n);
    let origin: [f64; 3] = std::array::from_fn(|k| at.place[k] + LIFT * away[k]);
    let hit = surfaces.meet(origin.map(|x| x as f32), away).filter(|hit| dot(hit.normal, at.normal) > ONE_SIDE);
    hit.map_or(f64::INFINITY, |hit| hit.distance)
}

/// The nodes among candidates, at `wider` times their spacings.
fn throw(candidates: &[Candidate], wider: f64) -> Vec<Candidate> {
    let mut grid = Grid::default();
    let mut nodes: Vec<Candidate> = Vec::new();
    for candidate in candidates {
        let spacing = wider * candidate.spacing;
        let at = &candidate.at;
        let taken = grid.any_within(at.place, spacing, |number| {
            let other = &nodes[number as usize].at;
            let apart: [f64; 3] = std::array::from_fn(|k| other.place[k] - at.place[k]);
            dot(apart, apart) < spacing * spacing && dot(other.normal, at.normal) > ONE_SIDE
        });
        if !taken {
            grid.insert(at.place, nodes.len() as u32);
            nodes.push(Candidate { at: *at, spacing, reach: wider * candidate.reach, order: candidate.order });
        }
    }
    nodes
}

/// Cubes of several sizes that list the nodes in them, so that any radius asks few cubes.
#[derive(Default)]
struct Grid {
    cubes: std::collections::HashMap<(u8, [i32; 3]), Vec<u32>>,
}

impl Grid {
    /// From the whole scene down to a 65,536th of it.
    const LEVELS: u8 = 17;

    fn cube(place: [f64; 3], level: u8) -> [i32; 3] {
        place.map(|x| (x * f64::from(1u32 << level)).floor() as i32)
    }

    fn insert(&mut self, place: [f64; 3], number: u32) {
        for level in 0..Self::LEVELS {
            self.cubes.entry((level, Self::cube(place, level))).or_default().push(number);
        }
    }

    /// Whether any node in the cubes around a place, which all lie within `radius` of it, is one.
    fn any_within(&self, place: [f64; 3], radius: f64, mut is: impl FnMut(u32) -> bool) -> bool {
        // The finest cubes that are not smaller than the radius.
        let level = (-radius.log2()).floor().clamp(0.0, f64::from(Self::LEVELS - 1)) as u8;
        let [x, y, z] = Self::cube(place, level);
        (0..27).any(|k| {
            let at = [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1];
            self.cubes.get(&(level, at)).is_some_and(|cube| cube.iter().any(|&number| is(number)))
        })
    }
}

/// Points of a node's cell, spread evenly over what is nearer to it than to any other node; the node itself where too few
/// are found.
///
/// Only so the light that leaves a cell is neither more nor less than that of its points: with points on a disc around the
/// node itself about a percent of the indirect light was missing in the Cornell box, as cells reach further where light
/// varies less.
fn cell(surfaces: Surfaces, near: &Near, number: usize, node: &Candidate) -> [Point; CELL] {
    let Candidate { at, spacing, .. } = node;
    let [tangent, bitangent] = frame(at.normal);
    let (mut points, mut found, mut room) = ([*at; CELL], 0, Vec::new());
    let height = 0.5 * spacing;
    for k in 0..TRIES {
        let [x, y] = jitter(mixed(number as u64) ^ k as u64);
        let (radius, angle) = (FURTHEST * spacing * x.sqrt(), std::f64::consts::TAU * y);
        let (s, t) = (radius * angle.cos(), radius * angle.sin());
        let above = std::array::from_fn(|k| at.place[k] + s * tangent[k] + t * bitangent[k] + height * at.normal[k]);
        let Some(below) = surfaces.meet(above.map(|x| x as f32), at.normal.map(|n| -n)) else { continue };
        if (below.distance - height).abs() >= height || dot(below.normal, at.normal) <= ONE_SIDE {
            continue;
        }
        near.nearest(below.place, below.normal, 1, &mut room);
        if room.first().is_some_and(|nearest| nearest.1 as usize == number) && surfaces.see(at.origin, above) {
            points[found] = below;
            found += 1;
            if found == CELL {
                break;
            }
        }
    }
    points
}
