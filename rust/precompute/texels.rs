//! The directions of a cubemap that a pass shoots: texel centres, neighbours, and samples inside a texel.

use crate::basis::cubemap::{direction_to_face_uv, face_point, texel_centre, texel_of};

/// Every texel of the six faces, row-major, face after face.
pub(super) struct Texels {
    /// Texels along a face.
    pub size: usize,
    /// Unit direction of the centre.
    pub centre: Vec<[f32; 3]>,
    /// Texels by blocks of at most 8 x 8 neighbours: directions that are traced together.
    pub blocks: Vec<Vec<u32>>,
    /// The eight texels around, over the borders of faces too. Four would miss what is thin and slanted: leaves and the
    /// gaps between them (0.4 % of a plant's light, against a path tracer).
    pub neighbours: Vec<[u32; 8]>,
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
            blocks: blocks(size),
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
        texels
    }

    /// Texels, over all six faces.
    pub fn len(&self) -> usize {
        self.centre.len()
    }

    fn place(&self, texel: usize) -> (usize, usize, usize) {
        let in_face = texel % (self.size * self.size);
        (texel / (self.size * self.size), in_face / self.size, in_face % self.size)
    }

    /// Direction `k` of `side` x `side` stratified samples of a texel, jittered by a hash of its number: all receivers
    /// share it, so that rays stay parallel.
    pub fn sample(&self, texel: usize, side: usize, k: usize) -> [f32; 3] {
        let (face, row, column) = self.place(texel);
        let [x, y] = jitter((texel * side * side + k) as u64);
        let (sub_column, sub_row) = ((k % side) as f64 + x, (k / side) as f64 + y);
        let coordinate = |whole: usize, part: f64| (2.0 * (whole as f64 + part / side as f64)) / self.size as f64 - 1.0;
        unit(face_point(face, coordinate(column, sub_column), coordinate(row, sub_row)))
    }
}

fn blocks(size: usize) -> Vec<Vec<u32>> {
    let side = size.min(8);
    let per_face = size / side;
    let block = |number: usize| {
        let (face, row, column) =
            (number / (per_face * per_face), number / per_face % per_face * side, number % per_face * side);
        let texel = |k: usize| face * size * size + (row + k / side) * size + column + k % side;
        (0..side * side).map(|k| texel(k) as u32).collect()
    };
    (0..6 * per_face * per_face).map(block).collect()
}

/// Two numbers in [0, 1) that depend on nothing but the index (SplitMix64).
fn jitter(index: u64) -> [f64; 2] {
    let mut z = index.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^= z >> 31;
    [(z >> 32) as f64, (z & 0xffff_ffff) as f64].map(|half| half / 4_294_967_296.0)
}
