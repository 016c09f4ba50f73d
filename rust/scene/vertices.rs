//! Receivers at the vertices of a mesh: one for each side of the surface that lies open, for each way that it faces there,
//! and for each material.
//!
//! ```text
//!     smooth   the normals that the mesh brings; else the mean of the faces around, by area, as far as they are of one crease
//!     flat     the normals of the faces
//!     buried   inside something closed: rays cross it an odd number of times
//! ```
//!
//! Surfaces are two-sided, and the order of a triangle's corners only names its sides: the inside of what is closed has no
//! rows. They come in Morton order of their places, those that face along one axis together, so that groups of 16 are alike.

use std::collections::HashMap;
use std::sync::Arc;

use rayon::prelude::*;

use super::curve::{along_curve, facing};
use super::near::Near;
use super::pieces::Pieces;
use super::surface::{Point, Points, Surfaces, dot};
use crate::error::Result;

/// Faces around a vertex belong together while they are turned by less: cos 40 degrees.
const CREASE: f64 = 0.766;
/// Normals whose components differ by less than this are one.
const ONE_NORMAL: f64 = 1.0 / 4096.0;
/// Off the plane of a neighbouring surface that meets this one in the vertex, in lifts.
const INWARDS: f64 = 2.0;
/// What a unit of a normal counts for where a neighbour is looked for: the other side of a sheet is none, however near.
const ONE_SIDE: f64 = 4.0;
/// No row.
pub const NONE: u32 = u32::MAX;

/// What normals receivers at vertices have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shading {
    /// As the surface is meant to be.
    Smooth,
    /// As the triangles are.
    Flat,
}

/// What the user's triangles say beside their places.
#[derive(Clone, Copy)]
pub struct Faces<'a> {
    /// Numbers of vertices.
    pub triangles: &'a [[u32; 3]],
    /// Of each triangle.
    pub material: &'a [u32],
    /// Of each vertex, of any length; where it has none the faces speak.
    pub normals: Option<&'a [[f32; 3]]>,
}

/// The rows of M at vertices.
pub struct Vertices {
    /// Where the rows' rays start, and their normals; of buried ones the normal is 0, and they see nothing.
    pub points: Arc<Points>,
    /// The same points on their surfaces, with the normals of triangles.
    pub places: Vec<Point>,
    /// The user's number of each row's vertex.
    pub vertex: Vec<u32>,
    /// Whether it lies inside something.
    pub buried: Vec<bool>,
    /// The row whose light each row shows: its own, or of a buried one the nearest of its piece that is not.
    pub shown: Vec<u32>,
    /// Of each of the user's triangles the rows of its corners, in front and behind; `NONE` where a side has none.
    pub corners: Vec<[[u32; 3]; 2]>,
    /// Of each triangle of the mesh, whether its front and its back lie open.
    pub open: Vec<[bool; 2]>,
}

/// What is known of a row before it is one.
struct Row {
    /// A triangle of the mesh that has it, which of its corners it is, and the side.
    triangle: usize,
    corner: usize,
    side: usize,
    normal: [f64; 3],
    /// Of the triangles around it that face so, by area: their normal, and the way to their middle.
    face: [f64; 3],
    middle: [f64; 3],
}

/// Front and back.
const SIDES: [f64; 2] = [1.0, -1.0];

impl Vertices {
    /// Finds them. `advance` hears of work done, and may stop it.
    pub fn of_mesh(
        surfaces: Surfaces,
        faces: Faces,
        shading: Shading,
        advance: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<Vertices> {
        let pieces = Pieces::new(surfaces.mesh);
        let open = pieces.open_sides(surfaces, advance)?;
        let normals = corner_normals(surfaces, faces, &pieces, shading);
        advance()?;
        let (mut rows, mut of_corner) = rows(surfaces, faces, &pieces, &normals, &open);
        in_order(surfaces, &mut rows, &mut of_corner);

        let mut corners = vec![[[NONE; 3]; 2]; faces.triangles.len()];
        for (own, &source) in of_corner.iter().zip(&surfaces.mesh.source) {
            corners[source as usize] = *own;
        }
        let places: Vec<Point> = rows.iter().map(|row| row.point(surfaces)).collect();
        let buried = pieces.inside(surfaces, &places, advance)?;
        let shown = shown(&pieces, &rows, &places, &buried);
        let mut points = Points::default();
        for (row, (at, &buried)) in rows.iter().zip(places.iter().zip(&buried)) {
            points.push(&Point { normal: if buried { [0.0; 3] } else { row.normal }, ..*at });
        }
        let source = |row: &Row| faces.triangles[surfaces.mesh.source[row.triangle] as usize][row.corner];
        let vertex = rows.iter().map(source).collect();
        Ok(Vertices { points: Arc::new(points), places, vertex, buried, shown, corners, open })
    }

    /// The number of rows.
    pub fn len(&self) -> usize {
        self.vertex.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.vertex.is_empty()
    }
}

impl Row {
    /// Where its rays start: lifted along the faces around it, and moved towards their middle, off the planes of other
    /// surfaces that meet these in the vertex.
    fn point(&self, surfaces: Surfaces) -> Point {
        let barycentric = [0, 1, 2].map(|k| f32::from(u8::from(k == self.corner)));
        let at = surfaces.side(self.triangle, [barycentric[1], barycentric[2]], self.side == 1);
        let normal = unit(self.face).unwrap_or(at.normal);
        let up = dot(self.middle, normal);
        let along: [f64; 3] = std::array::from_fn(|k| self.middle[k] - up * normal[k]);
        // Around a whole vertex the ways cancel.
        let apart = dot(along, along) > 0.01 * dot(self.middle, self.middle);
        let inwards = if apart { unit(along).unwrap_or([0.0; 3]) } else { [0.0; 3] };
        let lift = surfaces.mesh.lift(self.triangle);
        let origin = std::array::from_fn(|k| at.place[k] + lift * (normal[k] + INWARDS * inwards[k]));
        Point { normal, origin, ..at }
    }
}

fn unit(vector: [f64; 3]) -> Option<[f64; 3]> {
    let length = dot(vector, vector).sqrt();
    (length > 0.0 && length.is_finite()).then(|| vector.map(|x| x / length))
}

/// The normal of every corner of every triangle, to its front.
fn corner_normals(surfaces: Surfaces, faces: Faces, pieces: &Pieces, shading: Shading) -> Vec<[[f64; 3]; 3]> {
    let mesh = surfaces.mesh;
    let own: Vec<[f64; 3]> = (0..mesh.corners.len()).map(|triangle| mesh.normal(triangle)).collect();
    if shading == Shading::Flat {
        return own.into_iter().map(|normal| [normal; 3]).collect();
    }
    let area: Vec<f64> = (0..own.len()).map(|triangle| mesh.area(triangle)).collect();
    let mut smooth = smooth_normals(pieces, &own, &area);
    let Some(brought) = faces.normals else { return smooth };
    for (triangle, normals) in smooth.iter_mut().enumerate() {
        let numbers = faces.triangles[mesh.source[triangle] as usize];
        for (normal, &number) in normals.iter_mut().zip(&numbers) {
            if let Some(brought) = unit(brought[number as usize].map(f64::from)) {
                // Whichever side they were meant for.
                let turn = dot(brought, own[triangle]).signum();
                *normal = brought.map(|x| turn * x);
            }
        }
    }
    smooth
}

/// Means of the faces around each vertex, by area: each face joins the first of the larger ones that it makes no crease with.
fn smooth_normals(pieces: &Pieces, own: &[[f64; 3]], area: &[f64]) -> Vec<[[f64; 3]; 3]> {
    let mut around: Vec<(u32, u32, u8)> = Vec::with_capacity(3 * own.len());
    for (triangle, vertices) in pieces.vertices.iter().enumerate() {
        around.extend(vertices.iter().enumerate().map(|(k, &vertex)| (vertex, triangle as u32, k as u8)));
    }
    around.par_sort_unstable_by(|a, b| {
        let size = |item: &(u32, u32, u8)| area[item.1 as usize];
        a.0.cmp(&b.0).then(size(b).total_cmp(&size(a))).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2))
    });
    let mut smooth: Vec<[[f64; 3]; 3]> = own.iter().map(|&normal| [normal; 3]).collect();
    for corners in around.chunk_by(|a, b| a.0 == b.0) {
        let mut creases: Vec<([f64; 3], [f64; 3])> = Vec::new();
        let mut join = |&(_, triangle, _): &(u32, u32, u8)| {
            let (normal, area) = (own[triangle as usize], area[triangle as usize]);
            let known = creases.iter().position(|(largest, _)| dot(*largest, normal) > CREASE);
            let number = known.unwrap_or(creases.len());
            if known.is_none() {
                creases.push((normal, [0.0; 3]));
            }
            (0..3).for_each(|k| creases[number].1[k] += area * normal[k]);
            number
        };
        let of_corner: Vec<usize> = corners.iter().map(&mut join).collect();
        for (&(_, triangle, k), number) in corners.iter().zip(of_corner) {
            if let Some(normal) = unit(creases[number].1) {
                smooth[triangle as usize][usize::from(k)] = normal;
            }
        }
    }
    smooth
}

/// One row for each vertex, side, normal and material; and the row of each corner of each triangle, in front and behind.
fn rows(
    surfaces: Surfaces,
    faces: Faces,
    pieces: &Pieces,
    normals: &[[[f64; 3]; 3]],
    open: &[[bool; 2]],
) -> (Vec<Row>, Vec<[[u32; 3]; 2]>) {
    let mesh = surfaces.mesh;
    let mut numbers: HashMap<(u32, [i32; 3], u32), u32> = HashMap::new();
    let mut rows: Vec<Row> = Vec::new();
    let mut of_corner = vec![[[NONE; 3]; 2]; mesh.corners.len()];
    for (triangle, vertices) in pieces.vertices.iter().enumerate() {
        let material = faces.material[mesh.source[triangle] as usize];
        let places = mesh.corners[triangle].map(|corner| corner.map(f64::from));
        let middle: [f64; 3] = std::array::from_fn(|k| (places[0][k] + places[1][k] + places[2][k]) / 3.0);
        let (face, area) = (mesh.normal(triangle), mesh.area(triangle));
        for (side, corner) in (0..6).map(|k| (k / 3, k % 3)).filter(|&(side, _)| open[triangle][side]) {
            let normal = normals[triangle][corner].map(|x| SIDES[side] * x);
            // The normal tells sides apart.
            let key = (vertices[corner], normal.map(|x| (x / ONE_NORMAL).round() as i32), material);
            let number = *numbers.entry(key).or_insert_with(|| {
                rows.push(Row { triangle, corner, side, normal, face: [0.0; 3], middle: [0.0; 3] });
                rows.len() as u32 - 1
            });
            of_corner[triangle][side][corner] = number;
            let row = &mut rows[number as usize];
            let way = unit(std::array::from_fn(|k| middle[k] - places[corner][k])).unwrap_or([0.0; 3]);
            for k in 0..3 {
                row.face[k] += SIDES[side] * area * face[k];
                row.middle[k] += way[k];
            }
        }
    }
    (rows, of_corner)
}

/// Sorts rows along a curve, and says so to the corners.
fn in_order(surfaces: Surfaces, rows: &mut [Row], of_corner: &mut [[[u32; 3]; 2]]) {
    let mut order: Vec<u32> = (0..rows.len() as u32).collect();
    let key = |row: &Row| {
        let place = surfaces.mesh.corners[row.triangle][row.corner].map(f64::from);
        (facing(row.normal), along_curve(place))
    };
    order.sort_by_cached_key(|&number| (key(&rows[number as usize]), number));
    let mut place = vec![0u32; rows.len()];
    order.iter().enumerate().for_each(|(to, &from)| place[from as usize] = to as u32);
    let named = of_corner.iter_mut().flatten().flatten().filter(|row| **row != NONE);
    named.for_each(|row| *row = place[*row as usize]);
    // Along the cycles of the permutation, in place.
    for start in 0..rows.len() {
        while place[start] as usize != start {
            let to = place[start] as usize;
            rows.swap(start, to);
            place.swap(start, to);
        }
    }
}

/// What each row shows.
fn shown(pieces: &Pieces, rows: &[Row], places: &[Point], buried: &[bool]) -> Vec<u32> {
    let mut shown: Vec<u32> = (0..rows.len() as u32).collect();
    let mut of_piece: HashMap<u32, [Vec<u32>; 2]> = HashMap::new();
    for (number, row) in rows.iter().enumerate() {
        let own = of_piece.entry(pieces.piece[row.triangle]).or_default();
        own[usize::from(buried[number])].push(number as u32);
    }
    let mut room = Vec::new();
    for [free, hidden] in of_piece.into_values().filter(|[free, hidden]| !free.is_empty() && !hidden.is_empty()) {
        let key = |number: u32| (places[number as usize].place, places[number as usize].normal);
        let near = Near::new(free.iter().map(|&number| key(number)), ONE_SIDE);
        for number in hidden {
            let (place, normal) = key(number);
            near.nearest(place, normal, 1, &mut room);
            if let Some(&(_, nearest)) = room.first() {
                shown[number as usize] = free[nearest as usize];
            }
        }
    }
    shown
}
