//! The directions of a cubemap that a pass shoots: texel centres, neighbours, and samples inside a texel.

use crate::basis::cubemap::{curve_point, direction_to_face_uv, face_point, texel_centre, texel_of};
use crate::sampling::jitter;
use crate::scene::rays::{Fan, Octant};

/// Every texel of the six faces, row-major, face after face.
pub(super) struct Texels {
    /// Texels along a face.
    pub size: usize,
    /// Unit direction of the centre.
    pub centre: Vec<[f32; 3]>,
    /// Texels by blocks of at most 8 x 8 neighbours: directions that are traced together.
    pub blocks: Vec<Block>,
    /// The eight texels around, over the borders of faces too. Four would miss what is thin and slanted: leaves and the
    /// gaps between them (0.4 % of a plant's light, against a path tracer).
    pub neighbours: Vec<[u32; 8]>,
}

/// Neighbouring texels whose centres, and whatever else lies in them, make narrow fans.
pub(super) struct Block {
    /// Their numbers, along a Morton curve: any run of them lies close together.
    pub texels: Vec<u32>,
    /// Where all their directions lie.
    pub octant: Octant,
    /// The rays to their centres, in the same order.
    pub centres: Fan,
}

/// A direction inside a texel.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sample {
    /// Of length 1.
    pub direction: [f32; 3],
    /// As its block's fans take it.
    pub slopes: [f32; 2],
}

/// Face, row and column of a texel.
pub(super) fn place(size: usize, texel: usize) -> (usize, usize, usize) {
    let in_face = texel % (size * size);
    (texel / (size * size), in_face / size, in_face % size)
}

fn unit(point: [f64; 3]) -> [f32; 3] {
    let length = point.iter().map(|x| x * x).sum::<f64>().sqrt();
    point.map(|x| (x / length) as f32)
}

impl Texels {
    /// All tables for faces of `size` x `size` texels.
    pub fn new(size: usize) -> Self {
        let count = 6 * size * size;
        let mut texels = Texels {
            size,
            centre: Vec::with_capacity(count),
            blocks: Vec::new(),
            neighbours: Vec::with_capacity(count),
        };
        for texel in 0..count {
            let (face, row, column) = texels.place(texel);
            let (s, t) = (texel_centre(size, column), texel_centre(size, row));
            texels.centre.push(unit(face_point(face, s, t)));
            let step = 2.0 / size as f64;
            let around = [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];
            texels.neighbours.push(around.map(|(ds, dt)| {
                let (ds, dt) = (f64::from(ds) * step, f64::from(dt) * step);
                // A step over the border lands on the next face, where it is looked up again.
                let (face, s, t) = direction_to_face_uv(face_point(face, s + ds, t + dt));
                (face * size * size + texel_of(size, t) * size + texel_of(size, s)) as u32
            }));
        }
        texels.blocks = blocks(size).into_iter().map(|block| texels.block(block)).collect();
        texels
    }

    fn block(&self, texels: Vec<u32>) -> Block {
        let octant = Octant::of(self.centre[texels[0] as usize]);
        let mut centres = Fan::new(octant);
        for &texel in &texels {
            let (face, row, column) = self.place(texel as usize);
            let point = face_point(face, texel_centre(self.size, column), texel_centre(self.size, row));
            centres.push(octant.slopes(point.map(|x| x as f32)));
        }
        Block { texels, octant, centres }
    }

    /// Texels, over all six faces.
    pub fn len(&self) -> usize {
        self.centre.len()
    }

    /// Face, row and column of a texel.
    pub fn place(&self, texel: usize) -> (usize, usize, usize) {
        place(self.size, texel)
    }

    /// Sample `k` of `side` x `side` stratified ones of a texel, jittered by a hash of its number: all receivers share it.
    /// `octant` is that of the texel's block.
    pub fn sample(&self, texel: usize, octant: &Octant, side: usize, k: usize) -> Sample {
        let (face, row, column) = self.place(texel);
        let [x, y] = jitter((texel * side * side + k) as u64);
        let (sub_column, sub_row) = ((k % side) as f64 + x, (k / side) as f64 + y);
        let coordinate = |whole: usize, part: f64| (2.0 * (whole as f64 + part / side as f64)) / self.size as f64 - 1.0;
        let point = face_point(face, coordinate(column, sub_column), coordinate(row, sub_row));
        Sample { direction: unit(point), slopes: octant.slopes(point.map(|x| x as f32)) }
    }
}

/// Blocks of at most 8 x 8 texels, none of them over the middle of a face, where slopes change their sign.
fn blocks(size: usize) -> Vec<Vec<u32>> {
    let side = (size / 2).clamp(1, 8);
    let per_face = size / side;
    let block = |number: usize| {
        let (face, row, column) =
            (number / (per_face * per_face), number / per_face % per_face * side, number % per_face * side);
        let texel = |k: usize| {
            let [x, y] = curve_point(k);
            (face * size * size + (row + y) * size + column + x) as u32
        };
        (0..side * side).map(texel).collect()
    };
    (0..6 * per_face * per_face).map(block).collect()
}
