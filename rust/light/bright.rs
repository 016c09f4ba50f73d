//! Bright pixels, taken out of a map as small squares of known flux, and spread over the texels that they cover.

use std::ops::Range;

use super::layout::Layout;
use super::lookup::{lat_long_area, lat_long_direction};
use crate::basis::cubemap::{direction_to_face_uv, face_point, rectangle_solid_angle};

/// Bright pixels are those above this multiple of the map's mean magnitude, and among the brightest of the map.
const BRIGHT: f64 = 4.0;
/// A pixel wider than this many target texels is an area that the base resolves by itself.
const MAX_WIDTH: f64 = 2.0;

/// A small bright square of the sky.
pub struct Square {
    /// Of any length.
    direction: [f64; 3],
    /// The root of its solid angle.
    width: f64,
    /// Its radiance times its solid angle.
    flux: [f64; 3],
}

/// A square on a face of the target, in texels.
pub struct Placed {
    /// The face that it lies on; a square never crosses an edge.
    pub face: usize,
    x: [f64; 2],
    y: [f64; 2],
    /// The texels that it touches.
    pub rows: Range<usize>,
    columns: Range<usize>,
}

/// Splits a map, for targets of `size`, into what lies below a cap, pixel by pixel, and the squares above it, of which
/// there are no more than `most`.
pub fn split(layout: Layout, pixels: &[[f32; 3]], size: usize, most: usize) -> (Vec<[f32; 3]>, Vec<Square>) {
    let width = layout.pitch() * size as f64 / 2.0;
    if width > MAX_WIDTH {
        return (pixels.to_vec(), Vec::new());
    }
    // Squares of at most half a texel each keep an even area even when they turn against the texels.
    let parts = (2.0 * width).ceil().max(1.0) as usize;
    let cap = cap(layout, pixels, most / (parts * parts));

    let mut base = pixels.to_vec();
    let mut squares = Vec::new();
    for (k, pixel) in base.iter_mut().enumerate() {
        let magnitude = magnitude(pixel);
        if magnitude > cap {
            let excess = pixel.map(|value| value as f64 * (1.0 - cap / magnitude));
            *pixel = pixel.map(|value| (value as f64 * (cap / magnitude)) as f32);
            squares.extend((0..parts * parts).map(|part| Square::new(layout, k, parts, part, excess)));
        }
    }
    (base, squares)
}

fn magnitude(pixel: &[f32; 3]) -> f64 {
    pixel.iter().fold(0.0, |most, value| value.abs().max(most)) as f64
}

/// The magnitudes of all pixels, each times its solid angle.
pub fn flux(layout: Layout, pixels: &[[f32; 3]]) -> f64 {
    4.0 * std::f64::consts::PI * mean(layout, &magnitudes(pixels))
}

fn magnitudes(pixels: &[[f32; 3]]) -> Vec<f64> {
    pixels.iter().map(magnitude).collect()
}

/// Over the sphere; the texels of a cubemap count alike.
fn mean(layout: Layout, magnitudes: &[f64]) -> f64 {
    let sum = |weigh: &dyn Fn(usize) -> f64| (0..magnitudes.len()).map(weigh).sum::<f64>();
    match layout {
        Layout::LatLong { width, height, rows } => {
            sum(&|k| magnitudes[k] * lat_long_area(width, height, rows, k / width, 0, 1)) / (4.0 * std::f64::consts::PI)
        }
        Layout::Cubemap { .. } => sum(&|k| magnitudes[k]) / magnitudes.len() as f64,
    }
}

/// The least magnitude that is not bright, such that at most `count` pixels are above it.
fn cap(layout: Layout, pixels: &[[f32; 3]], count: usize) -> f64 {
    let mut magnitudes = magnitudes(pixels);
    let mean = mean(layout, &magnitudes);
    if count >= magnitudes.len() {
        return BRIGHT * mean;
    }
    let (_, largest_below, _) = magnitudes.select_nth_unstable_by(count, |a, b| b.total_cmp(a));
    (BRIGHT * mean).max(*largest_below)
}

impl Square {
    /// One of `parts` x `parts` parts of pixel `k`.
    fn new(layout: Layout, k: usize, parts: usize, part: usize, radiance: [f64; 3]) -> Self {
        let (direction, width, area) = match layout {
            Layout::LatLong { width, height, rows } => {
                let (row, column) = (part / parts, k % width * parts + part % parts);
                let area = lat_long_area(width, height, rows, k / width, row, parts);
                let angle = rows.angle(height, k / width, row as f64 + 0.5, parts);
                let around = (column as f64 + 0.5) / (width * parts) as f64;
                (lat_long_direction(angle, around), area.sqrt(), area)
            }
            Layout::Cubemap { size } => {
                let fine = (size * parts) as f64;
                let (face, row, column) = (k / (size * size), k / size % size, k % size);
                let edge = |k: usize| (2.0 * k as f64 - fine) / fine;
                let (row, column) = (row * parts + part / parts, column * parts + part % parts);
                let (s, t) = ((edge(column) + edge(column + 1)) / 2.0, (edge(row) + edge(row + 1)) / 2.0);
                // `spread` undoes this stretch by the same formula: unturned, a part covers exactly its own place.
                let width = 2.0 / fine / stretch(s, t);
                let area = rectangle_solid_angle([edge(column), edge(column + 1)], [edge(row), edge(row + 1)]);
                (face_point(face, s, t), width, area)
            }
        };
        Square { direction, width, flux: radiance.map(|value| value * area) }
    }

    /// Its direction, of length 1.
    pub fn unit(&self) -> [f64; 3] {
        let length = self.direction.iter().map(|x| x * x).sum::<f64>().sqrt();
        self.direction.map(|x| x / length)
    }

    /// Radiance times solid angle.
    pub fn flux(&self) -> [f64; 3] {
        self.flux
    }

    /// The magnitude of its flux.
    pub fn amount(&self) -> f64 {
        self.flux.iter().fold(0.0, |most, value| value.abs().max(most))
    }

    /// The magnitude of its radiance.
    pub fn brightness(&self) -> f64 {
        self.amount() / (self.width * self.width)
    }

    /// Where the rotated square lies on a cubemap; one across an edge is moved inside.
    pub fn place(&self, size: usize, rotation: &[[f64; 3]; 3]) -> Placed {
        let d = self.direction;
        let (face, s, t) = direction_to_face_uv(rotation.map(|row| row[0] * d[0] + row[1] * d[1] + row[2] * d[2]));
        let half = (self.width * stretch(s, t) * size as f64 / 4.0).min(size as f64 / 2.0);
        let extent = |coordinate: f64| {
            let centre = ((coordinate + 1.0) * 0.5 * size as f64).clamp(half, size as f64 - half);
            [centre - half, centre + half]
        };
        let texels = |[lo, hi]: [f64; 2]| lo as usize..(hi.ceil() as usize).min(size);
        let (x, y) = (extent(s), extent(t));
        Placed { face, x, y, rows: texels(y), columns: texels(x) }
    }

    /// Adds the square, scaled, to the rows `own` of its face, `texels`. Over all rows its flux is kept.
    pub fn spread(
        &self,
        placed: &Placed,
        own: Range<usize>,
        scale: [f64; 3],
        inverse_areas: &[f64],
        texels: &mut [[f32; 3]],
    ) {
        let size = texels.len() / own.len();
        for row in placed.rows.start.max(own.start)..placed.rows.end.min(own.end) {
            let share = scale.map(|own| overlap(placed.y, row) * own);
            for column in placed.columns.clone() {
                let (across, inverse) = (overlap(placed.x, column), inverse_areas[row * size + column]);
                let target = &mut texels[(row - own.start) * size + column];
                (0..3).for_each(|c| target[c] += (self.flux[c] * (share[c] * across * inverse)) as f32);
            }
        }
    }
}

/// How much longer a short line is on a face at (s, t) than on the sphere, in the mean of all directions.
fn stretch(s: f64, t: f64) -> f64 {
    let square = 1.0 + s * s + t * t;
    (square * square.sqrt()).sqrt()
}

/// The share of the line [lo, hi] that lies in [k, k + 1].
fn overlap([lo, hi]: [f64; 2], k: usize) -> f64 {
    ((hi.min(k as f64 + 1.0) - lo.max(k as f64)) / (hi - lo)).max(0.0)
}
