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
