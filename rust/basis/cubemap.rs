//! Cubemaps: directions, texels and their solid angles.
//!
//! Faces are ordered +X, -X, +Y, -Y, +Z, -Z; texels run in rows from the top, in the orientation of OpenGL's cube maps.
//! With s, t in [-1, 1] growing to the right and *down*, a face at distance 1 is spanned by `face_basis`:
//! direction = s * right + t * down + out (not normalised).

/// (right, down, out) of each face.
const FACES: [[[f64; 3]; 3]; 6] = [
    [[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]],
    [[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]],
    [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]],
    [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]],
    [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]],
    [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
];

/// The vectors (right, down, out) of a face: the images of s, t and the distance 1.
pub fn face_basis(face: usize) -> [[f64; 3]; 3] {
    FACES[face]
}

/// The direction of the point (s, t) of a face, not normalised: its largest component is 1.
pub fn face_point(face: usize, s: f64, t: f64) -> [f64; 3] {
    let [right, down, out] = FACES[face];
    std::array::from_fn(|axis| s * right[axis] + t * down[axis] + out[axis])
}

/// The coordinate in [-1, 1] of the centre of texel `k` of `size`.
pub fn texel_centre(size: usize, k: usize) -> f64 {
    (2.0 * k as f64 + 1.0 - size as f64) / size as f64
}

/// The unit direction of a texel's centre.
pub fn texel_direction(size: usize, face: usize, row: usize, column: usize) -> [f64; 3] {
    let point = face_point(face, texel_centre(size, column), texel_centre(size, row));
    let length = point.iter().map(|x| x * x).sum::<f64>().sqrt();
    point.map(|x| x / length)
}

/// The face that a direction (of any length but zero) meets, and where: (face, s, t).
pub fn direction_to_face_uv(direction: [f64; 3]) -> (usize, f64, f64) {
    let [x, y, z] = direction;
    let (ax, ay, az) = (x.abs(), y.abs(), z.abs());
    if ax >= ay && ax >= az {
        (usize::from(x < 0.0), if x < 0.0 { z } else { -z } / ax, -y / ax)
    } else if ay >= az {
        (2 + usize::from(y < 0.0), x / ay, if y < 0.0 { -z } else { z } / ay)
    } else {
        (4 + usize::from(z < 0.0), if z < 0.0 { -x } else { x } / az, -y / az)
    }
}

/// The texel of a face that holds coordinate s or t.
pub fn texel_of(size: usize, coordinate: f64) -> usize {
    (((coordinate + 1.0) * 0.5 * size as f64) as usize).min(size - 1)
}

/// The column and row of the k-th point of a Morton curve over 8 x 8 texels: any run of them lies close together.
pub fn curve_point(k: usize) -> [usize; 2] {
    [0, 1].map(|axis| (0..3).fold(0, |at, bit| at | (k >> (2 * bit + axis) & 1) << bit))
}

/// The place along the same curve of a column and a row below 8.
pub fn curve_place(column: usize, row: usize) -> usize {
    let spread = |k: usize| (k & 1) | (k & 2) << 1 | (k & 4) << 2;
    spread(column) | spread(row) << 1
}

/// The texels around a direction, at most four, and how a point of light is shared among them: the shares sum to 1, their
/// centres' mean points where the direction does, and both change without a jump, over the edges and corners of faces too.
pub fn around(size: usize, direction: [f64; 3]) -> Vec<(usize, f64)> {
    let (face, s, t) = direction_to_face_uv(direction);
    let last = texel_centre(size, size - 1);
    let mut shares = Vec::with_capacity(4);
    if s.abs() <= last && t.abs() <= last {
        for (row, y) in between(size, t) {
            for (column, x) in between(size, s) {
                let [s, t] = [texel_centre(size, column), texel_centre(size, row)];
                // Shares are of unit vectors, not of points on the face.
                shares.push(((face * size + row) * size + column, x * y * (1.0 + s * s + t * t).sqrt()));
            }
        }
    } else if !(over_edge(size, face, [s, t], false, &mut shares) || over_edge(size, face, [t, s], true, &mut shares)) {
        over_corner(size, face, s, t, &mut shares);
    }
    let sum: f64 = shares.iter().map(|(_, share)| share).sum();
    shares.retain(|&(_, share)| share > 0.0);
    shares.iter_mut().for_each(|(_, share)| *share /= sum);
    shares
}

/// The two texels along a line whose centres lie about a coordinate, and the share of each.
fn between(size: usize, coordinate: f64) -> [(usize, f64); 2] {
    let at = ((coordinate + 1.0) * size as f64 - 1.0) * 0.5;
    let first = (at.max(0.0) as usize).min(size.saturating_sub(2));
    let along = (at - first as f64).clamp(0.0, 1.0);
    [(first, 1.0 - along), ((first + 1).min(size - 1), if size > 1 { along } else { 0.0 })]
}

/// Between the outermost texels of two faces. Across the edge their centres are (l, y, 1) and (1, y, l), with l that of the
/// last texel: both as far off, so that a share w of the far one gives (l + w / n, y, 1 - w / n). `swapped`: the edge lies
/// in the direction of t. False where the place lies beyond the last texels along the edge, or not over the edge at all.
fn over_edge(size: usize, face: usize, [a, b]: [f64; 2], swapped: bool, shares: &mut Vec<(usize, f64)>) -> bool {
    let last = texel_centre(size, size - 1);
    if a.abs() <= last {
        return false;
    }
    let n = size as f64;
    let far = n * (a.abs() - last) / (1.0 + a.abs());
    let along = b * (1.0 - far / n);
    if along.abs() > last {
        return false;
    }
    for (k, share) in between(size, along) {
        let y = texel_centre(size, k);
        let share = share * (1.0 + last * last + y * y).sqrt();
        let sign = 1f64.copysign(a);
        for (x, z, share) in [(last, 1.0, share * (1.0 - far)), (1.0, last, share * far)] {
            let [s, t] = if swapped { [y, sign * x] } else { [sign * x, y] };
            shares.push((texel_towards(size, face, [s, t, z]), share));
        }
    }
    true
}

/// Between the three texels at a corner of the cube, (l, l, 1), (1, l, l) and (l, 1, l).
fn over_corner(size: usize, face: usize, s: f64, t: f64, shares: &mut Vec<(usize, f64)>) {
    let last = texel_centre(size, size - 1);
    let sum = (s.abs() + t.abs() + 1.0) / (1.0 + 2.0 * last);
    let (x, y) = (1f64.copysign(s), 1f64.copysign(t));
    for (corner, along) in [([last, last, 1.0], 1.0), ([1.0, last, last], s.abs()), ([last, 1.0, last], t.abs())] {
        let share = ((along - last * sum) / (1.0 - last)).max(0.0);
        shares.push((texel_towards(size, face, [x * corner[0], y * corner[1], corner[2]]), share));
    }
}

/// The texel in a direction that is given in the axes of a face: (right, down, out).
fn texel_towards(size: usize, face: usize, [s, t, z]: [f64; 3]) -> usize {
    let [right, down, out] = face_basis(face);
    let (face, s, t) =
        direction_to_face_uv(std::array::from_fn(|axis| s * right[axis] + t * down[axis] + z * out[axis]));
    (face * size + texel_of(size, t)) * size + texel_of(size, s)
}

/// The solid angle of the part [x0, x1] x [y0, y1] of a cube's face at distance 1, from the antiderivative at its corners.
pub fn rectangle_solid_angle([x0, x1]: [f64; 2], [y0, y1]: [f64; 2]) -> f64 {
    let corner = |x: f64, y: f64| (x * y).atan2((x * x + y * y + 1.0).sqrt());
    (corner(x1, y1) + corner(x0, y0)) - (corner(x0, y1) + corner(x1, y0))
}

/// The solid angles of one face's `size` x `size` texels, row by row; the six faces are alike.
pub fn solid_angles(size: usize) -> Vec<f64> {
    // (2k - n) / n keeps the edges odd-symmetric to the last bit, so mirrored texels get equal areas.
    let edge = |k: usize| (2.0 * k as f64 - size as f64) / size as f64;
    let span = |k: usize| [edge(k), edge(k + 1)];
    (0..size * size).map(|texel| rectangle_solid_angle(span(texel % size), span(texel / size))).collect()
}
