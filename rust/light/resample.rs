//! The frame's part of resampling: look up the base for every texel, spread the bright squares (see environment.rs).

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};

use rayon::prelude::*;

use super::bright::{self, Placed, Square};
use super::layout::{Layout, unrotate};
use super::lookup::{average, bordered};
use super::peaks::{self, Peak};
use crate::basis::cubemap::{face_basis, solid_angles, texel_centre};

/// Target texels that are looked up together.
const CHUNK: usize = 64;
/// The most bright squares of a map, which are spread in every frame.
const SQUARES: usize = 2048;
/// The same where peaks are taken out of them.
const SQUARES_OF_PEAKS: usize = 8192;
/// Rows of a target face that one task makes.
const STRIP: usize = 8;

/// A map made ready for one target size.
pub struct Prepared {
    size: usize,
    /// Means over squares of one target texel, and of two.
    narrow: Level,
    wide: Level,
    bright: Vec<Square>,
    /// Suns and lamps, the largest first; for each square the number of the one that it is part of.
    peaks: Vec<Peak>,
    peak_of: Vec<u32>,
    /// 1 / dω of a face's texels.
    inverse_areas: Vec<f64>,
}

/// Six faces of points, the outermost on the edges; a point holds the mean over the square about it that reaches as far
/// as the next points.
struct Level {
    /// Points along a side.
    side: usize,
    /// Colour and a zero: a point and the next are one 32-byte load.
    points: Vec<[f32; 4]>,
}

/// The rotated frame of a target face in the map's own axes: direction = s * right + t * down + out.
type Axes = [[f32; 3]; 3];

/// A few rows of a target face.
struct Strip<'a> {
    face: usize,
    first_row: usize,
    texels: &'a mut [[f32; 3]],
}

/// Where the texels of a chunk look, as structures of arrays.
struct Points {
    narrow: Places,
    wide: Places,
    /// How much of the wide level.
    blend: [f32; CHUNK],
}

/// Places in a level: the first of the 2x2 points that enclose each, and how far it lies between them.
struct Places {
    first: [u32; CHUNK],
    x: [f32; CHUNK],
    y: [f32; CHUNK],
}

impl Prepared {
    /// From the whole map, once a size: averages of the base, and the bright squares.
    ///
    /// Where peaks are to be taken out, most of the squares are theirs and none of a frame's work: there may be more.
    pub fn new(layout: Layout, pixels: &[[f32; 3]], size: usize, peaks: bool) -> Self {
        let most = if peaks { SQUARES_OF_PEAKS } else { SQUARES };
        let (base, bright) = bright::split(layout, pixels, size, most);
        let fine = average(layout, base, 2 * size);
        let (peaks, peak_of) = if peaks {
            peaks::find(&bright, bright::flux(layout, pixels), size)
        } else {
            (Vec::new(), vec![u32::MAX; bright.len()])
        };
        Prepared {
            size,
            narrow: Level::new(2 * size, &fine, 1),
            wide: Level::new(2 * size, &fine, 2),
            bright,
            peaks,
            peak_of,
            inverse_areas: solid_angles(size).iter().map(|area| 1.0 / area).collect(),
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let points = self.narrow.points.len() + self.wide.points.len();
        16 * points + 8 * self.inverse_areas.len() + std::mem::size_of_val(&self.bright[..]) + 4 * self.peak_of.len()
    }

    /// The map's peaks, the largest first.
    pub fn peaks(&self) -> &[Peak] {
        &self.peaks
    }

    /// Adds the `count` largest peaks, turned and scaled, to coefficients of texels.
    pub fn add_peaks(&self, rotation: &[[f64; 3]; 3], scale: [f64; 3], count: usize, texels: &mut [[f64; 3]]) {
        for peak in self.peaks.iter().take(count) {
            peak.turned(rotation).add(self.size, scale, &self.inverse_areas, texels);
        }
    }

    /// Adds the rotated and scaled map to a cubemap, without its `peaks` largest peaks.
    pub fn add(&self, rotation: &[[f64; 3]; 3], scale: [f64; 3], peaks: usize, radiance: &mut [[f32; 3]]) {
        let frames: [Axes; 6] = std::array::from_fn(|face| {
            face_basis(face).map(|axis| unrotate(rotation, axis).map(|component| component as f32))
        });
        let own: Vec<usize> = (0..self.bright.len()).filter(|&k| self.peak_of[k] as usize >= peaks).collect();
        let placed: Vec<Placed> = own.par_iter().map(|&k| self.bright[k].place(self.size, rotation)).collect();
        let strips = self.strips(radiance);

        // Each strip adds its own squares in their order: so threads never change a bit.
        let mut squares = vec![Vec::new(); strips.len()];
        let strips_a_face = self.size.div_ceil(STRIP);
        for (k, place) in placed.iter().enumerate() {
            for strip in place.rows.start / STRIP..=(place.rows.end - 1) / STRIP {
                squares[place.face * strips_a_face + strip].push(k);
            }
        }
        strips.into_par_iter().zip(squares).for_each(|(strip, squares)| {
            for (row, texels) in strip.texels.chunks_exact_mut(self.size).enumerate() {
                self.add_base(&frames[strip.face], strip.first_row + row, scale.map(|own| own as f32), texels);
            }
            for k in squares {
                let rows = strip.first_row..strip.first_row + strip.texels.len() / self.size;
                self.bright[own[k]].spread(&placed[k], rows, scale, &self.inverse_areas, strip.texels);
            }
        });
    }

    fn strips<'a>(&self, radiance: &'a mut [[f32; 3]]) -> Vec<Strip<'a>> {
        let faces = radiance.chunks_exact_mut(self.size * self.size).enumerate();
        let of_face = |(face, texels): (usize, &'a mut [[f32; 3]])| {
            let strips = texels.chunks_mut(STRIP * self.size).enumerate();
            strips.map(move |(strip, texels)| Strip { face, first_row: STRIP * strip, texels })
        };
        faces.flat_map(of_face).collect()
    }

    fn add_base(&self, frame: &Axes, row: usize, scale: [f32; 3], texels: &mut [[f32; 3]]) {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has AVX2.
            return unsafe { self.add_base_avx2(frame, row, scale, texels) };
        }
        self.add_base_any(frame, row, scale, texels)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn add_base_avx2(&self, frame: &Axes, row: usize, scale: [f32; 3], texels: &mut [[f32; 3]]) {
        self.add_base_any(frame, row, scale, texels)
    }

    /// One row of target texels.
    #[inline(always)]
    fn add_base_any(&self, frame: &Axes, row: usize, scale: [f32; 3], texels: &mut [[f32; 3]]) {
        let mut points = Points::new();
        // Four lanes, of which three are wanted: whole vectors.
        let mut values = [[0.0f32; 4]; CHUNK];
        for (chunk, texels) in texels.chunks_mut(CHUNK).enumerate() {
            points.fill(frame, self.size, row, CHUNK * chunk);
            self.narrow.fetch(&points.narrow, texels.len());
            for (k, value) in values.iter_mut().enumerate().take(texels.len()) {
                *value = self.look(&points, k);
            }
            for (texel, value) in texels.iter_mut().zip(&values) {
                (0..3).for_each(|c| texel[c] += scale[c] * value[c]);
            }
        }
    }

    #[inline(always)]
    fn look(&self, points: &Points, k: usize) -> [f32; 4] {
        let blend = points.blend[k];
        let narrow = self.narrow.look(&points.narrow, k);
        if blend == 0.0 {
            return narrow;
        }
        let wide = self.wide.look(&points.wide, k);
        std::array::from_fn(|c| mix(narrow[c], wide[c], blend))
    }
}

impl Points {
    fn new() -> Self {
        let places = || Places { first: [0; CHUNK], x: [0.0; CHUNK], y: [0.0; CHUNK] };
        Points { narrow: places(), wide: places(), blend: [0.0; CHUNK] }
    }

    /// The centres of row `row` of a face of `size` texels, from column `first` on (some may lie beyond the face).
    #[inline(always)]
    fn fill(&mut self, frame: &Axes, size: usize, row: usize, first: usize) {
        let [right, down, out] = frame;
        let t = texel_centre(size, row) as f32;
        let start: [f32; 3] = std::array::from_fn(|axis| t * down[axis] + out[axis]);
        for k in 0..CHUNK {
            let s = (2 * (first + k) as i32 + 1 - size as i32) as f32 / size as f32;
            let [x, y, z]: [f32; 3] = std::array::from_fn(|axis| start[axis] + s * right[axis]);

            // The face that is met: choose among three axes, then the sign.
            let (ax, ay, az) = (x.abs(), y.abs(), z.abs());
            let (is_x, is_y) = (mask((ax >= ay) & (ax >= az)), mask(ay >= az));
            let choose = |along_x, along_y, along_z| select(is_x, along_x, select(is_y, along_y, along_z));
            let major = choose(x, y, z);
            let (inverse, sign) = (1.0 / major.abs(), 1.0f32.copysign(major));
            let (s, t) = (choose(-z * sign, x, x * sign), choose(-y, z * sign, -y));
            let face = (!is_x & (2 + (!is_y & 2))) as i32 + i32::from(major < 0.0);
            let (u, v) = (s * inverse * 0.5 + 0.5, t * inverse * 0.5 + 0.5);
            self.narrow.set(k, 2 * size as i32, face, u, v);
            self.wide.set(k, size as i32, face, u, v);

            // A texel at distance r from the centre of the cube has the solid angle (2/n)^2 / r^3. The target's r is
            // |d|, the source's |d| / major: the target's texels are 1 / major^3 times as large. The variance of a
            // square grows with its area: so much of the wide one, four times as large, gives the target's.
            self.blend[k] = ((inverse * inverse * inverse - 1.0) * (1.0 / 3.0)).clamp(0.0, 1.0);
        }
    }
}

impl Places {
    /// The point (u, v) in [0, 1] of a face in a level of `size` squares of points a side.
    #[inline(always)]
    fn set(&mut self, k: usize, size: i32, face: i32, u: f32, v: f32) {
        let side = size + 1;
        let (x, y) = (u * size as f32, v * size as f32);
        let last = (size - 1) as f32;
        // Not `clamp`, which panics where the limits are crossed: that keeps loops out of vectors.
        let (left, top) = (x.floor().max(0.0).min(last), y.floor().max(0.0).min(last));
        self.first[k] = ((face * side + integer(top)) * side + integer(left)) as u32;
        self.x[k] = x - left;
        self.y[k] = y - top;
    }
}

/// All bits where a condition holds. With it, choices are arithmetic that the compiler keeps in vectors, not branches.
#[inline(always)]
fn mask(condition: bool) -> u32 {
    0u32.wrapping_sub(u32::from(condition))
}

#[inline(always)]
fn select(mask: u32, yes: f32, no: f32) -> f32 {
    f32::from_bits(yes.to_bits() & mask | no.to_bits() & !mask)
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
    /// Means over squares of 2 `reach` x 2 `reach` texels of a cubemap, by solid angle.
    fn new(size: usize, texels: &[[f32; 3]], reach: usize) -> Self {
        let side = size / reach + 1;
        let areas = solid_angles(size);
        let size = size as isize;
        // Across an edge areas are mirrored.
        let inside = |k: isize| if k < 0 { -1 - k } else { k.min(2 * size - 1 - k) };
        let square = |k: usize| (reach * k) as isize - reach as isize..(reach * k + reach) as isize;
        let point = |k: usize| {
            let (face, row, column) = (k / (side * side), k / side % side, k % side);
            let (mut sum, mut whole) = ([0.0; 3], 0.0);
            for (j, i) in square(row).flat_map(|j| square(column).map(move |i| (j, i))) {
                let area = areas[(inside(j) * size + inside(i)) as usize];
                let colour = bordered(texels, size as usize, face, j, i);
                whole += area;
                (0..3).for_each(|c| sum[c] += area * colour[c]);
            }
            let [r, g, b] = sum.map(|value| (value / whole) as f32);
            [r, g, b, 0.0]
        };
        Level { side, points: (0..6 * side * side).into_par_iter().map(point).collect() }
    }

    /// A hint that the points of the first places will be read. They lie across the map's rows, more of them than the
    /// processor looks ahead.
    #[inline(always)]
    fn fetch(&self, places: &Places, count: usize) {
        #[cfg(target_arch = "x86_64")]
        for &first in &places.first[..count] {
            let point = self.points.as_ptr().wrapping_add(first as usize);
            // SAFETY: a prefetch never faults, and SSE is part of x86-64.
            unsafe {
                _mm_prefetch::<_MM_HINT_T0>(point.cast());
                _mm_prefetch::<_MM_HINT_T0>(point.wrapping_add(self.side).cast());
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        let _ = (places, count);
    }

    /// Bilinear between the points at place `k`: down both columns at once, then across.
    #[inline(always)]
    fn look(&self, places: &Places, k: usize) -> [f32; 4] {
        let (first, x, y) = (places.first[k] as usize, places.x[k], places.y[k]);
        let upper = self.points[first..first + 2].as_flattened();
        let lower = self.points[first + self.side..first + self.side + 2].as_flattened();
        let columns: [f32; 8] = std::array::from_fn(|c| mix(upper[c], lower[c], y));
        std::array::from_fn(|c| mix(columns[c], columns[4 + c], x))
    }
}
