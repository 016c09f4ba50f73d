//! The frame's part of resampling: look up the base for every texel, spread the bright squares (see environment.rs).

use rayon::prelude::*;

use super::bright::{self, Square};
use super::cubemap::{face_basis, solid_angles};
use super::environment::{Layout, unrotate};
use super::lookup::{average, bordered};

/// Texels of a target row that are looked up together.
const CHUNK: usize = 32;

/// A map made ready for one target size.
pub struct Prepared {
    size: usize,
    /// The base on faces of 2n and of n texels.
    fine: Level,
    coarse: Level,
    /// For each texel of a face the shares of its quarters in its solid angle.
    quarters: Vec<[f32; 4]>,
    bright: Vec<Square>,
    /// 1 / dω of a face's texels.
    inverse_areas: Vec<f64>,
}

/// Six faces inside a border of their neighbours' texels, so that bilinear lookups meet no seam.
struct Level {
    /// Texels of a face's side, without the border.
    size: usize,
    /// Colour and a zero: one 16-byte load.
    texels: Vec<[f32; 4]>,
}

/// The rotated frame of a target face in the map's own axes: direction = s * right + t * down + out.
type Frame = [[f32; 3]; 3];

/// Where the quarters of a chunk look, as structures of arrays.
struct Points {
    fine: Places,
    coarse: Places,
    /// How much of the coarser level.
    blend: [f32; 2 * CHUNK],
}

/// Places in a level: the first of the 2x2 texels that enclose each, and how far it lies between them.
struct Places {
    first: [u32; 2 * CHUNK],
    x: [f32; 2 * CHUNK],
    y: [f32; 2 * CHUNK],
}

impl Prepared {
    pub fn new(layout: Layout, pixels: &[[f32; 3]], size: usize) -> Self {
        let (base, bright) = bright::split(layout, pixels, size);
        let fine = average(layout, base, 2 * size);
        let areas = solid_angles(size);
        let quarter_areas = solid_angles(2 * size);
        let parts = |k: usize| {
            let first = 4 * size * (k / size) + 2 * (k % size);
            [first, first + 1, first + 2 * size, first + 2 * size + 1]
        };
        let quarters: Vec<[f32; 4]> = (0..size * size)
            .map(|k| {
                let own = parts(k).map(|quarter| quarter_areas[quarter]);
                own.map(|area| (area / own.iter().sum::<f64>()) as f32)
            })
            .collect();
        let coarse: Vec<[f32; 3]> = (0..6 * size * size)
            .map(|k| {
                let (face, texel) = (k / (size * size), k % (size * size));
                let own = parts(texel).map(|quarter| fine[4 * face * size * size + quarter]);
                std::array::from_fn(|c| (0..4).map(|q| quarters[texel][q] * own[q][c]).sum())
            })
            .collect();
        Prepared {
            size,
            fine: Level::new(2 * size, &fine),
            coarse: Level::new(size, &coarse),
            quarters,
            bright,
            inverse_areas: areas.iter().map(|area| 1.0 / area).collect(),
        }
    }

    pub fn bytes(&self) -> usize {
        let items = self.fine.texels.len() + self.coarse.texels.len() + self.quarters.len();
        16 * items + 8 * self.inverse_areas.len() + std::mem::size_of_val(&self.bright[..])
    }

    /// Adds the rotated and scaled map to a cubemap.
    pub fn add(&self, rotation: &[[f64; 3]; 3], scale: f64, radiance: &mut [[f32; 3]]) {
        let frames: [Frame; 6] = std::array::from_fn(|face| {
            face_basis(face).map(|axis| unrotate(rotation, axis).map(|component| component as f32))
        });
        radiance.par_chunks_exact_mut(self.size).enumerate().for_each(|(line, texels)| {
            self.add_base(&frames[line / self.size], line % self.size, scale as f32, texels);
        });
        for square in &self.bright {
            square.spread(self.size, rotation, scale, &self.inverse_areas, radiance);
        }
    }

    fn add_base(&self, frame: &Frame, row: usize, scale: f32, texels: &mut [[f32; 3]]) {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has AVX2.
            return unsafe { self.add_base_avx2(frame, row, scale, texels) };
        }
        self.add_base_any(frame, row, scale, texels)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn add_base_avx2(&self, frame: &Frame, row: usize, scale: f32, texels: &mut [[f32; 3]]) {
        self.add_base_any(frame, row, scale, texels)
    }

    /// One row of target texels: each the mean of its quarters.
    #[inline(always)]
    fn add_base_any(&self, frame: &Frame, row: usize, scale: f32, texels: &mut [[f32; 3]]) {
        let mut points = Points::new();
        for (chunk, texels) in texels.chunks_mut(CHUNK).enumerate() {
            let shares = &self.quarters[row * self.size + chunk * CHUNK..][..texels.len()];
            let mut sums = [[0.0f32; 4]; CHUNK];
            for half in 0..2 {
                points.fill(frame, 2 * self.size as i32, (2 * row + half) as i32, (2 * CHUNK * chunk) as i32);
                for (k, (sum, shares)) in sums.iter_mut().zip(shares).enumerate() {
                    for side in 0..2 {
                        let value = self.look(&points, 2 * k + side);
                        (0..4).for_each(|c| sum[c] += shares[2 * half + side] * value[c]);
                    }
                }
            }
            for (texel, sum) in texels.iter_mut().zip(&sums) {
                (0..3).for_each(|c| texel[c] += scale * sum[c]);
            }
        }
    }

    #[inline(always)]
    fn look(&self, points: &Points, k: usize) -> [f32; 4] {
        let blend = points.blend[k];
        let fine = self.fine.look(&points.fine, k);
        if blend == 0.0 {
            return fine;
        }
        let coarse = self.coarse.look(&points.coarse, k);
        std::array::from_fn(|c| mix(fine[c], coarse[c], blend))
    }
}

impl Points {
    fn new() -> Self {
        let places = || Places { first: [0; 2 * CHUNK], x: [0.0; 2 * CHUNK], y: [0.0; 2 * CHUNK] };
        Points { fine: places(), coarse: places(), blend: [0.0; 2 * CHUNK] }
    }

    /// The points of row `row` of a face of `size` quarters, from column `first` on (some may lie beyond the face).
    #[inline(always)]
    fn fill(&mut self, frame: &Frame, size: i32, row: i32, first: i32) {
        let [right, down, out] = frame;
        let centre = |k: i32| (2 * k + 1 - size) as f32 / size as f32;
        let t = centre(row);
        let start: [f32; 3] = std::array::from_fn(|axis| t * down[axis] + out[axis]);
        for k in 0..2 * CHUNK {
            let s = centre(first + k as i32);
            let [x, y, z]: [f32; 3] = std::array::from_fn(|axis| start[axis] + s * right[axis]);

            // The face that is met, without branches: choose among three axes, then the sign.
            let (ax, ay, az) = (x.abs(), y.abs(), z.abs());
            let (is_x, is_y) = ((ax >= ay) & (ax >= az), ay >= az);
            let major = if is_x {
                x
            } else if is_y {
                y
            } else {
                z
            };
            let inverse = 1.0 / major.abs();
            let sign = 1.0f32.copysign(major);
            let s = if is_x {
                -z * sign
            } else if is_y {
                x
            } else {
                x * sign
            };
            let t = if is_x {
                -y
            } else if is_y {
                z * sign
            } else {
                -y
            };
            let face = (if is_x {
                0
            } else if is_y {
                2
            } else {
                4
            }) + i32::from(major < 0.0);
            let (u, v) = (s * inverse * 0.5 + 0.5, t * inverse * 0.5 + 0.5);
            self.fine.set(k, size, face, u, v);
            self.coarse.set(k, size / 2, face, u, v);

            // A texel at distance r from the centre of the cube has the solid angle (2/n)^2 / r^3. The target's r is
            // |d|, the source's |d| / major: its texels are 1 / major^3 as large, a third at most in mean length.
            self.blend[k] = (inverse * inverse - 1.25).clamp(0.0, 1.0);
        }
    }
}

impl Places {
    /// The point (u, v) in [0, 1] of a face in a level of `size` texels a side.
    #[inline(always)]
    fn set(&mut self, k: usize, size: i32, face: i32, u: f32, v: f32) {
        let side = size + 2;
        let (x, y) = (u * size as f32 + 0.5, v * size as f32 + 0.5);
        let (left, top) = (x.floor().clamp(0.0, size as f32), y.floor().clamp(0.0, size as f32));
        self.first[k] = ((face * side + integer(top)) * side + integer(left)) as u32;
        self.x[k] = x - left;
        self.y[k] = y - top;
    }
}

/// A whole number in 0..2^23 as an integer: beside 2^23 it stands in the low bits. (`as` saturates, which costs more.)
#[inline(always)]
fn integer(x: f32) -> i32 {
    (x + 8_388_608.0).to_bits() as i32 & 0x7f_ffff
}

/// `a` at f = 0, exactly; equal `a` and `b` exactly; never negative between numbers that are not.
#[inline(always)]
fn mix(a: f32, b: f32, f: f32) -> f32 {
    a + (b - a) * f
}

impl Level {
    fn new(size: usize, texels: &[[f32; 3]]) -> Self {
        let side = size + 2;
        let texel = |k: usize| {
            let (face, row, column) = (k / (side * side), k / side % side, k % side);
            let [r, g, b] = bordered(texels, size, face, row as isize - 1, column as isize - 1).map(|c| c as f32);
            [r, g, b, 0.0]
        };
        Level { size, texels: (0..6 * side * side).into_par_iter().map(texel).collect() }
    }

    /// Bilinear between the texels at place `k`.
    #[inline(always)]
    fn look(&self, places: &Places, k: usize) -> [f32; 4] {
        let (first, x, y) = (places.first[k] as usize, places.x[k], places.y[k]);
        let side = self.size + 2;
        let (upper, lower) = (&self.texels[first..first + 2], &self.texels[first + side..first + side + 2]);
        let mut value = [0.0; 4];
        for c in 0..4 {
            value[c] = mix(mix(upper[0][c], upper[1][c], x), mix(lower[0][c], lower[1][c], x), y);
        }
        value
    }
}
