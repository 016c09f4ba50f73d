//! Bilinear lookups in lat-long images and cubemaps, and their exact averages over coarser texels.

use std::f64::consts::PI;

use rayon::prelude::*;

use super::layout::{Layout, Rows};
use crate::basis::cubemap::{direction_to_face_uv, face_point, rectangle_solid_angle, solid_angles, texel_centre};
use crate::twice::compiled_twice;

/// The weighted mean of `a` and `b`, at `f` of the way.
fn mix(a: [f64; 3], b: [f64; 3], f: f64) -> [f64; 3] {
    std::array::from_fn(|c| a[c] * (1.0 - f) + b[c] * f)
}

/// A lat-long image between the centres of its pixels; columns wrap, and beyond a pole lies the row on its other side.
pub fn lat_long(pixels: &[[f32; 3]], width: usize, height: usize, rows: Rows, direction: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = direction;
    let (down, first) = rows.span(height);
    let length = (x * x + y * y + z * z).sqrt();
    let u = (x.atan2(-z) / (2.0 * PI)).rem_euclid(1.0) * width as f64 - 0.5;
    let v = (y / length).clamp(-1.0, 1.0).acos() / PI * down - first;
    let (left, top) = (u.floor(), v.floor());
    let pixel = |r: usize, c: usize| {
        let (row, column) = (top as isize + r as isize, left as isize + c as isize);
        let inside = row.clamp(0, height as isize - 1);
        let column = if row == inside { column } else { column + width as isize / 2 };
        pixels[inside as usize * width + column.rem_euclid(width as isize) as usize].map(f64::from)
    };
    let line = |r: usize| mix(pixel(r, 0), pixel(r, 1), u - left);
    mix(line(0), line(1), v - top)
}

compiled_twice! {
    /// `lat_long` for many directions of length 1, in f32: angles to a few millionths, far less than a pixel of any map.
    pub fn lat_long_all(
        pixels: &[[f32; 3]],
        width: usize,
        height: usize,
        rows: Rows,
        directions: &[[f32; 3]],
        out: &mut [[f32; 3]],
    ) = lat_long_any;
}

/// Directions that are turned into angles together.
const CHUNK: usize = 64;

#[inline(always)]
fn lat_long_any(
    pixels: &[[f32; 3]],
    width: usize,
    height: usize,
    rows: Rows,
    directions: &[[f32; 3]],
    out: &mut [[f32; 3]],
) {
    let (span, first) = rows.span(height);
    let (across, down) = (width as f32 / (2.0 * std::f32::consts::PI), span as f32 / std::f32::consts::PI);
    let first = first as f32;
    let (mut u, mut v) = ([0f32; CHUNK], [0f32; CHUNK]);
    for (directions, out) in directions.chunks(CHUNK).zip(out.chunks_mut(CHUNK)) {
        for (k, &[x, y, z]) in directions.iter().enumerate() {
            u[k] = angle(x, -z) * across - 0.5;
            v[k] = angle((x * x + z * z).sqrt(), y) * down - first;
        }
        for (k, out) in out.iter_mut().enumerate() {
            let (left, top) = (u[k].floor(), v[k].floor());
            let line = |row: isize| {
                let inside = row.clamp(0, height as isize - 1);
                let over = if row == inside { 0 } else { width as isize / 2 };
                let first = (left as isize + over).rem_euclid(width as isize) as usize;
                let pixels = &pixels[inside as usize * width..][..width];
                let (a, b) = (pixels[first], pixels[if first + 1 == width { 0 } else { first + 1 }]);
                let f = u[k] - left;
                [0, 1, 2].map(|c: usize| a[c] + (b[c] - a[c]) * f)
            };
            let (a, b) = (line(top as isize), line(top as isize + 1));
            let f = v[k] - top;
            *out = [0, 1, 2].map(|c: usize| a[c] + (b[c] - a[c]) * f);
        }
    }
}

/// The angle of the point (along, up) from the axis of `along`'s zero: atan2(across, ahead), to 2e-6.
#[inline(always)]
fn angle(across: f32, ahead: f32) -> f32 {
    let (a, b) = (across.abs(), ahead.abs());
    let (small, large) = (a.min(b), a.max(b));
    let t = if large > 0.0 { small / large } else { 0.0 };
    let s = t * t;
    // Odd polynomial on [0, 1], minimax (Hastings 1955, sheet 13, one term more).
    let p = -0.004_054_058;
    let p = p * s + 0.021_861_28;
    let p = p * s - 0.055_909_887;
    let p = p * s + 0.096_420_05;
    let p = p * s - 0.139_085_35;
    let p = p * s + 0.199_465_56;
    let p = p * s - 0.333_298_56;
    let atan = p * s * t + t;
    let first = if a > b { std::f32::consts::FRAC_PI_2 - atan } else { atan };
    let half = if ahead < 0.0 { std::f32::consts::PI - first } else { first };
    if across < 0.0 { -half } else { half }
}

/// A cubemap between the centres of its texels, without seams at the edges of faces.
pub fn seamless(texels: &[[f32; 3]], size: usize, direction: [f64; 3]) -> [f64; 3] {
    let (face, s, t) = direction_to_face_uv(direction);
    let (x, y) = (((s + 1.0) * size as f64 - 1.0) * 0.5, ((t + 1.0) * size as f64 - 1.0) * 0.5);
    let (left, top) = (x.floor(), y.floor());
    let texel = |r: isize, c: isize| bordered(texels, size, face, top as isize + r, left as isize + c);
    let line = |r: isize| mix(texel(r, 0), texel(r, 1), x - left);
    mix(line(0), line(1), y - top)
}

/// The texel at (row, column) of a face, either of which may lie one beyond its edge: there the neighbouring face is
/// looked up at the same point, along the edge between its outermost texels.
pub fn bordered(texels: &[[f32; 3]], size: usize, face: usize, row: isize, column: isize) -> [f64; 3] {
    let inside = 0..size as isize;
    if inside.contains(&row) && inside.contains(&column) {
        return texels[(face * size + row as usize) * size + column as usize].map(f64::from);
    }
    let coordinate = |k: isize| (2.0 * k as f64 + 1.0 - size as f64) / size as f64;
    let (face, s, t) = direction_to_face_uv(face_point(face, coordinate(column), coordinate(row)));
    let place = |coordinate: f64| (((coordinate + 1.0) * size as f64 - 1.0) * 0.5).clamp(0.0, size as f64 - 1.0);
    let (x, y) = (place(s), place(t));
    let texel = |r: usize, c: usize| texels[(face * size + r) * size + c].map(f64::from);
    let (left, top) = (x as usize, y as usize);
    let (right, bottom) = ((left + 1).min(size - 1), (top + 1).min(size - 1));
    let line = |r: usize| mix(texel(r, left), texel(r, right), x - left as f64);
    mix(line(top), line(bottom), y - top as f64)
}

/// The map averaged over the texels of a cubemap with `size` x `size` a face, by solid angle.
pub fn average(layout: Layout, pixels: Vec<[f32; 3]>, size: usize) -> Vec<[f32; 3]> {
    match layout {
        Layout::LatLong { width, height, rows } => average_lat_long(pixels, width, height, rows, size),
        Layout::Cubemap { size: source } => average_cubemap(&pixels, source, size),
    }
}

/// Exact: two grids on the same face overlap in rectangles, and the solid angle of each is known.
fn average_cubemap(pixels: &[[f32; 3]], source: usize, size: usize) -> Vec<[f32; 3]> {
    // The pieces that both grids cut a line into, for each target texel: source texel and extent.
    let pieces: Vec<Vec<(usize, [f64; 2])>> = (0..size)
        .map(|k| {
            let edge = |k: usize, n: usize| (2.0 * k as f64 - n as f64) / n as f64;
            let (first, last) = (k * source / size, ((k + 1) * source).div_ceil(size));
            let cut = |j: usize| [edge(j, source).max(edge(k, size)), edge(j + 1, source).min(edge(k + 1, size))];
            (first..last).map(|j| (j, cut(j))).collect()
        })
        .collect();

    // The faces are alike: each rectangle's solid angle serves all six.
    let texel = |row: usize, column: usize| {
        let (mut sums, mut area) = ([[0.0; 3]; 6], 0.0);
        for &(j, y) in &pieces[row] {
            for &(i, x) in &pieces[column] {
                let piece = rectangle_solid_angle(x, y);
                area += piece;
                for (face, sum) in sums.iter_mut().enumerate() {
                    let pixel = &pixels[(face * source + j) * source + i];
                    (0..3).for_each(|c| sum[c] += piece * pixel[c] as f64);
                }
            }
        }
        sums.map(|sum| sum.map(|value| (value / area) as f32))
    };
    let columns: Vec<[[f32; 3]; 6]> = (0..size * size).into_par_iter().map(|k| texel(k / size, k % size)).collect();
    (0..6).flat_map(|face| columns.iter().map(move |faces| faces[face])).collect()
}

/// By quadrature of the bilinear image, one and a half points a pixel or more each way, after averaging pixels that are
/// far too fine.
fn average_lat_long(
    mut pixels: Vec<[f32; 3]>,
    mut width: usize,
    mut height: usize,
    mut rows: Rows,
    size: usize,
) -> Vec<[f32; 3]> {
    let texel = 2.0 / size as f64;
    let pitch = |width: usize, height: usize| Layout::LatLong { width, height, rows: Rows::Centre }.pitch();
    let fine = |width: usize, height: usize| {
        width.is_multiple_of(2) && height.is_multiple_of(2) && pitch(width, height) < texel / 4.0
    };
    if rows == Rows::Edge && fine(width, height) {
        (pixels, rows) = (centred(&pixels, width, height), Rows::Centre);
    }
    while fine(width, height) {
        pixels = halve(&pixels, width, height);
        (width, height) = (width / 2, height / 2);
    }

    let points = ((1.5 * texel / pitch(width, height)).ceil() as usize).clamp(2, 32);
    let areas = solid_angles(size * points);
    let grid = size * points;
    (0..6 * size * size)
        .into_par_iter()
        .map(|k| {
            let (face, row, column) = (k / (size * size), k / size % size, k % size);
            let (mut sum, mut area) = ([0.0; 3], 0.0);
            for point in 0..points * points {
                let (j, i) = (row * points + point / points, column * points + point % points);
                let direction = face_point(face, texel_centre(grid, i), texel_centre(grid, j));
                let value = lat_long(&pixels, width, height, rows, direction);
                let weight = areas[j * grid + i];
                area += weight;
                (0..3).for_each(|c| sum[c] += weight * value[c]);
            }
            sum.map(|value| (value / area) as f32)
        })
        .collect()
}

/// An image whose outermost rows are the poles, between its rows at the places of as many rows of equal height.
fn centred(pixels: &[[f32; 3]], width: usize, height: usize) -> Vec<[f32; 3]> {
    let row = |k: usize| (k as f64 + 0.5) * (height as f64 - 1.0) / height as f64;
    (0..width * height)
        .into_par_iter()
        .map(|k| {
            let (row, column) = (row(k / width), k % width);
            let at = |r: usize| pixels[r * width + column].map(f64::from);
            mix(at(row as usize), at(row as usize + 1), row.fract()).map(|value| value as f32)
        })
        .collect()
}

/// The mean of 2x2 pixels, rows weighted by their solid angle.
fn halve(pixels: &[[f32; 3]], width: usize, height: usize) -> Vec<[f32; 3]> {
    let area = |row: usize| lat_long_area(width, height, Rows::Centre, row, 0, 1);
    (0..width * height / 4)
        .into_par_iter()
        .map(|k| {
            let (row, column) = (2 * (k / (width / 2)), 2 * (k % (width / 2)));
            let (upper, lower) = (area(row), area(row + 1));
            let at = |r: usize, c: usize| pixels[(row + r) * width + column + c].map(f64::from);
            let line = |r: usize| mix(at(r, 0), at(r, 1), 0.5);
            mix(line(0), line(1), lower / (upper + lower)).map(|value| value as f32)
        })
        .collect()
}

/// The solid angle of one of `parts` x `parts` parts of a pixel in row k of a lat-long image.
pub fn lat_long_area(width: usize, height: usize, rows: Rows, k: usize, part: usize, parts: usize) -> f64 {
    let edge = |part: usize| rows.angle(height, k, part as f64, parts).cos();
    2.0 * PI / (width * parts) as f64 * (edge(part) - edge(part + 1))
}

/// The direction at an angle from +Y and a share of the way around it.
pub fn lat_long_direction(angle: f64, around: f64) -> [f64; 3] {
    let ((sin_v, cos_v), (sin_u, cos_u)) = (angle.sin_cos(), (2.0 * PI * around).sin_cos());
    [sin_v * sin_u, cos_v, -sin_v * cos_u]
}
