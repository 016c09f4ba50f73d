//! Triangles in normalised coordinates: what the tracer is built on.

use crate::error::{Error, Result};

/// Triangles of a scene, moved and scaled so that the largest extent of the box around them is between 1 and 2.
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

impl Mesh {
    /// Errors: no triangles, an index out of range, a vertex that is not finite.
    pub fn new(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<Self> {
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
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for &vertex in triangles.iter().flatten() {
            for axis in 0..3 {
                low[axis] = low[axis].min(vertices[vertex as usize][axis]);
                high[axis] = high[axis].max(vertices[vertex as usize][axis]);
            }
        }
        let centre: [f64; 3] = std::array::from_fn(|axis| 0.5 * low[axis] + 0.5 * high[axis]);
        let extent = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
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

    /// The largest extent of the box around them, in normalised units: from 1 to 2.
    pub fn extent(&self) -> f64 {
        2.0 * self.corners.iter().flatten().flatten().fold(0.0f64, |most, &x| most.max(f64::from(x).abs()))
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
