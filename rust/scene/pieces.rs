//! The pieces of a mesh: what hangs together, whether it is closed, and what lies inside.

use std::collections::HashMap;

use rayon::prelude::*;

use super::mesh::Mesh;
use super::rays::tracer::LIFT;
use super::surface::{Point, Surfaces, dot};
use crate::error::Result;
use crate::sampling::{cosine_directions, mixed};

/// Rays along a side, by whose majority a point is inside: one may pass through an edge.
const ASKED: usize = 3;
/// A ray that crosses more surfaces than this is at an end.
const MOST_CROSSINGS: usize = 256;
/// Corners that f32 would hardly tell apart at the edge of the scene are one: the poles of a sphere are not always.
const PLACES: f32 = (1 << 22) as f32;
/// Triangles that are asked together.
const CHUNK: usize = 256;

/// The mesh with corners in one place as one vertex, and the pieces that hang together.
pub struct Pieces {
    /// Of each triangle.
    pub vertices: Vec<[u32; 3]>,
    /// The piece of each triangle.
    pub piece: Vec<u32>,
    /// Whether a piece has an inside: each of its edges is one of two triangles.
    closed: Vec<bool>,
    /// Whether all triangles of a piece are wound alike.
    wound: Vec<bool>,
}

impl Pieces {
    /// Finds them.
    pub fn new(mesh: &Mesh) -> Self {
        let mut numbers: HashMap<[i32; 3], u32> = HashMap::new();
        let mut number = |corner: &[f32; 3]| {
            let key = corner.map(|x| (x * PLACES).round() as i32);
            let next = numbers.len() as u32;
            *numbers.entry(key).or_insert(next)
        };
        let vertices: Vec<[u32; 3]> =
            mesh.corners.iter().map(|corners| [0, 1, 2].map(|k| number(&corners[k]))).collect();
        let mut parent: Vec<u32> = (0..numbers.len() as u32).collect();
        for &[a, b, c] in &vertices {
            let root = find(&mut parent, a);
            for other in [b, c] {
                let other = find(&mut parent, other);
                parent[other as usize] = root;
            }
        }
        let mut roots: HashMap<u32, u32> = HashMap::new();
        let mut of_triangle = |own: &[u32; 3]| {
            let (root, next) = (find(&mut parent, own[0]), roots.len() as u32);
            *roots.entry(root).or_insert(next)
        };
        let piece: Vec<u32> = vertices.iter().map(&mut of_triangle).collect();
        // Of each edge how often it is run through in each direction.
        let mut edges: HashMap<(u32, u32), ([u32; 2], u32)> = HashMap::new();
        for (own, &piece) in vertices.iter().zip(&piece) {
            for k in 0..3 {
                let (a, b) = (own[k], own[(k + 1) % 3]);
                let (count, _) = edges.entry((a.min(b), a.max(b))).or_insert(([0, 0], piece));
                count[usize::from(a > b)] += 1;
            }
        }
        let (mut closed, mut wound) = (vec![true; roots.len()], vec![true; roots.len()]);
        for (count, piece) in edges.values() {
            closed[*piece as usize] &= count[0] + count[1] == 2;
            wound[*piece as usize] &= *count == [1, 1];
        }
        Pieces { vertices, piece, closed, wound }
    }

    /// Whether the front and the back of each triangle lie open: of closed pieces only one of them.
    pub fn open_sides(&self, surfaces: Surfaces, advance: &(dyn Fn() -> Result<()> + Sync)) -> Result<Vec<[bool; 2]>> {
        let front_inside = |triangle: usize| {
            let piece = self.piece[triangle];
            let third = [1.0 / 3.0; 2];
            self.closed[piece as usize]
                && self.is_inside(surfaces, &surfaces.side(triangle, third, false), triangle, |other| other == piece)
        };
        let chunks = (0..self.piece.len().div_ceil(CHUNK)).into_par_iter().map(|chunk| {
            advance()?;
            let own = chunk * CHUNK..self.piece.len().min((chunk + 1) * CHUNK);
            Ok(own.map(front_inside).collect::<Vec<bool>>())
        });
        let inside = chunks.collect::<Result<Vec<_>>>()?.concat();
        // Where all are wound alike the majority knows.
        let mut votes = vec![0i64; self.closed.len()];
        for (&piece, &inside) in self.piece.iter().zip(&inside) {
            votes[piece as usize] += if inside { 1 } else { -1 };
        }
        let sides = self.piece.iter().zip(inside).map(|(&piece, inside)| {
            let piece = piece as usize;
            let inside = if self.wound[piece] { votes[piece] > 0 } else { inside };
            if self.closed[piece] { [!inside, inside] } else { [true, true] }
        });
        Ok(sides.collect())
    }

    /// Which points lie inside anything closed.
    pub fn inside(
        &self,
        surfaces: Surfaces,
        points: &[Point],
        advance: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<Vec<bool>> {
        if !self.closed.contains(&true) {
            return Ok(vec![false; points.len()]);
        }
        let chunks = points.par_chunks(CHUNK).enumerate().map(|(chunk, own)| {
            advance()?;
            let inside = |(k, at)| self.is_inside(surfaces, at, chunk * CHUNK + k, |_| true);
            Ok(own.iter().enumerate().map(inside).collect::<Vec<bool>>())
        });
        Ok(chunks.collect::<Result<Vec<_>>>()?.concat())
    }

    /// Whether most rays from a point cross some closed piece, of those that count, an odd number of times.
    fn is_inside(&self, surfaces: Surfaces, at: &Point, seed: usize, counts: impl Fn(u32) -> bool) -> bool {
        let mut crossed: Vec<u32> = Vec::new();
        let mut odd = |direction: [f64; 3]| {
            crossed.clear();
            let mut origin = at.origin;
            for _ in 0..MOST_CROSSINGS {
                let Some(hit) = surfaces.meet(origin.map(|x| x as f32), direction) else { break };
                let piece = self.piece[hit.triangle as usize];
                if self.closed[piece as usize] && counts(piece) {
                    crossed.push(piece);
                }
                // Through to the other side.
                let steep = dot(hit.normal, direction).abs().max(0.01);
                origin = std::array::from_fn(|k| hit.place[k] + LIFT / steep * direction[k]);
            }
            crossed.sort_unstable();
            crossed.chunk_by(|a, b| a == b).any(|same| same.len() % 2 == 1)
        };
        let rays = cosine_directions(at.normal, ASKED, mixed(seed as u64) ^ 3);
        2 * rays.filter(|&way| odd(way)).count() > ASKED * ASKED
    }
}

/// The root of a vertex in a forest of pieces.
fn find(parent: &mut [u32], mut at: u32) -> u32 {
    while parent[at as usize] != at {
        let above = parent[parent[at as usize] as usize];
        parent[at as usize] = above;
        at = above;
    }
    at
}
