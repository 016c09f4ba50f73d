//! Triangles in normalised coordinates: what the tracer is built on.

use crate::error::{Error, Result};

/// Triangles of a scene, moved and scaled so that the largest extent of the box around them is between 1 and 2; or of the
/// box around what is near the eye, where the rest lies far beyond it (a sun disc, a dome, a stray triangle): that has
/// larger coordinates then, which are as precise for their size.
///
/// The scale is a power of two and the move is made in f64: rays then meet the same bits at 1e-5 and at 1e6, and no
/// tolerance of the tracer depends on the user's units.
pub struct Mesh {
    /// Three corners of each triangle that has an area.
    pub corners: Vec<[[f32; 3]; 3]>,
    /// The user's number of each of them.
    pub source: Vec<u32>,
    /// The point of the user's space that becomes the origin.
    pub centre: [f64; 3],
    /// Multiplies the user's lengths.
    pub scale: f64,
    /// Triangles without area, which nothing can hit.
    pub degenerate: usize,
}

fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

/// The vector product.
pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// How far receivers are lifted off their surface, in the normalised scene: above the rounding of any projected depth,
/// below anything that can be seen.
pub const LIFT: f64 = 4e-6;

/// What rounding is measured in at a triangle: 1 in the unit box, and farther off its largest coordinate.
pub(super) fn unit(corners: &[[f32; 3]; 3]) -> f32 {
    corners.as_flattened().iter().fold(1.0, |most, x| most.max(x.abs()))
}

/// What is far begins so many times as far from the eye as what is near ends.
const APART: f64 = 16.0;
/// And the box around all is so many times as large.
const FAR: f64 = 64.0;

/// A box that no point is in yet.
const NOTHING: [[f64; 3]; 2] = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];

/// A box with more points in it.
fn around(mut ends: [[f64; 3]; 2], points: [[f64; 3]; 3]) -> [[f64; 3]; 2] {
    for (point, axis) in points.iter().flat_map(|point| (0..3).map(move |axis| (point, axis))) {
        ends[0][axis] = ends[0][axis].min(point[axis]);
        ends[1][axis] = ends[1][axis].max(point[axis]);
    }
    ends
}

fn extent([low, high]: [[f64; 3]; 2]) -> f64 {
    (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max)
}

/// The box that coordinates are measured in: around all triangles, or around those near the eye.
fn focus(corners: impl Iterator<Item = [[f64; 3]; 3]> + Clone, eye: Option<[f64; 3]>) -> [[f64; 3]; 2] {
    let whole = corners.clone().fold(NOTHING, around);
    let Some(eye) = eye else { return whole };
    let off = |point: [f64; 3]| (0..3).map(|axis| (point[axis] - eye[axis]).abs()).fold(0.0, f64::max);
    // How far each triangle reaches, and where it begins.
    let mut all: Vec<(f64, f64, usize)> = corners
        .clone()
        .enumerate()
        .map(|(number, points)| {
            let [a, b, c] = points.map(off);
            (a.max(b).max(c), a.min(b).min(c), number)
        })
        .collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut begins = f64::INFINITY;
    for near in (1..all.len()).rev() {
        begins = begins.min(all[near].1);
        let reach = all[near - 1].0;
        if begins >= APART * reach && extent(whole) >= FAR * reach {
            let mut own = vec![false; all.len()];
            all[..near].iter().for_each(|&(_, _, number)| own[number] = true);
            return corners.zip(own).filter(|(_, own)| *own).fold(NOTHING, |ends, (points, _)| around(ends, points));
        }
    }
    whole
}

impl Mesh {
    /// Errors: no triangles, an index out of range, a vertex that is not finite.
    pub fn new(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<Self> {
        Self::seen(vertices, triangles, None)
    }

    /// As it is seen from an eye, near which coordinates are the most precise.
    pub fn seen(vertices: &[[f64; 3]], triangles: &[[u32; 3]], eye: Option<[f64; 3]>) -> Result<Self> {
        if triangles.is_empty() {
            return Err(Error::input("expected a scene with triangles, got none"));
        }
        if let Some(at) = vertices.iter().position(|vertex| vertex.iter().any(|x| !x.is_finite())) {
            return Err(Error::input(format!("expected finite vertices, got {:?} at vertex {at}", vertices[at])));
        }
        if let Some(at) = triangles.iter().position(|t| t.iter().any(|&v| v as usize >= vertices.len())) {
            return Err(Error::input(format!(
                "expected vertex numbers below {}, got {:?} in triangle {at}",
                vertices.len(),
                triangles[at]
            )));
        }

        // Only vertices that a triangle uses count: a stray one must not shrink the scene.
        let [low, high] = focus(triangles.iter().map(|t| t.map(|vertex| vertices[vertex as usize])), eye);
        let centre: [f64; 3] = std::array::from_fn(|axis| 0.5 * low[axis] + 0.5 * high[axis]);
        let extent = extent([low, high]);
        let scale = if extent > 0.0 { (-extent.log2().floor()).exp2() } else { 1.0 };
        if !extent.is_finite() || !scale.is_finite() {
            return Err(Error::input(format!("expected a scene of finite, normal size, got an extent of {extent:e}")));
        }

        let mut mesh = Mesh { corners: Vec::new(), source: Vec::new(), centre, scale, degenerate: 0 };
        for (number, triangle) in triangles.iter().enumerate() {
            let corners = triangle.map(|vertex| mesh.normalised(vertices[vertex as usize]));
            let wide = corners.map(|corner| corner.map(f64::from));
            if cross(sub(wide[1], wide[0]), sub(wide[2], wide[0])) == [0.0; 3] {
                mesh.degenerate += 1;
            } else {
                mesh.corners.push(corners);
                mesh.source.push(number as u32);
            }
        }
        Ok(mesh)
    }

    /// A point of the user's space in the normalised one.
    pub fn normalised(&self, point: [f64; 3]) -> [f32; 3] {
        std::array::from_fn(|axis| ((point[axis] - self.centre[axis]) * self.scale) as f32)
    }

    /// How far points of a triangle are lifted off it.
    pub fn lift(&self, triangle: usize) -> f64 {
        LIFT * f64::from(unit(&self.corners[triangle]))
    }

    /// The place of a point of a triangle, by the weights of its corners 1 and 2.
    pub fn place(&self, triangle: usize, barycentric: [f32; 2]) -> [f64; 3] {
        let [b1, b2] = barycentric.map(f64::from);
        let corners = self.corners[triangle].map(|corner| corner.map(f64::from));
        std::array::from_fn(|k| {
            corners[0][k] + b1 * (corners[1][k] - corners[0][k]) + b2 * (corners[2][k] - corners[0][k])
        })
    }

    /// The area of a triangle, in normalised units.
    pub fn area(&self, triangle: usize) -> f64 {
        let n = self.across(triangle);
        0.5 * (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt()
    }

    /// The vector product of two edges of a triangle: along its normal, and twice its area long.
    fn across(&self, triangle: usize) -> [f64; 3] {
        let corners = self.corners[triangle].map(|corner| corner.map(f64::from));
        cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]))
    }

    /// The weights of a triangle's corners 1 and 2 at a point of it.
    pub fn barycentric(&self, triangle: usize, place: [f64; 3]) -> [f32; 2] {
        let [a, b, c] = self.corners[triangle].map(|corner| corner.map(f64::from));
        let (u, v, w) = (sub(b, a), sub(c, a), sub(place, a));
        let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| a[k] * b[k]).sum::<f64>();
        let (uu, uv, vv) = (dot(u, u), dot(u, v), dot(v, v));
        let (wu, wv, area) = (dot(w, u), dot(w, v), uu * vv - uv * uv);
        [((vv * wu - uv * wv) / area) as f32, ((uu * wv - uv * wu) / area) as f32]
    }

    /// The largest extent of the box around them, in normalised units: from 1 to 2. What is far beyond does not count.
    pub fn extent(&self) -> f64 {
        let near = self.corners.iter().flatten().flatten().map(|&x| f64::from(x).abs()).filter(|&x| x <= 1.0);
        2.0 * near.fold(0.0f64, f64::max)
    }

    /// A point of the normalised scene in the user's space.
    pub fn world(&self, place: [f64; 3]) -> [f32; 3] {
        std::array::from_fn(|axis| (place[axis] / self.scale + self.centre[axis]) as f32)
    }

    /// Whether a normal is that of the back of a triangle.
    pub fn is_back(&self, triangle: u32, normal: [f32; 3]) -> bool {
        let front = self.normal(triangle as usize);
        (0..3).map(|axis| front[axis] * f64::from(normal[axis])).sum::<f64>() < 0.0
    }

    /// The unit geometric normal of a triangle, by the order of its corners.
    pub fn normal(&self, triangle: usize) -> [f64; 3] {
        let n = self.across(triangle);
        let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
        n.map(|component| component / length)
    }
}
