//! Points of surfaces, as rays find them.

use super::mesh::Mesh;
use super::rays::tracer::{Hit, Tracer};

/// The scalar product.
pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// A point of a surface, and the side of it that is meant.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// Of the mesh.
    pub triangle: u32,
    /// Weights of the triangle's corners 1 and 2; corner 0 has the rest.
    pub barycentric: [f32; 2],
    /// In the normalised scene, on the surface.
    pub place: [f64; 3],
    /// Unit geometric normal, to the side that the point was seen from.
    pub normal: [f64; 3],
    /// Where rays from the point start: off its surface.
    pub origin: [f64; 3],
    /// How far the ray that found it has come, in the normalised scene.
    pub distance: f64,
}

/// Points from which rays start, with the normals of their surfaces.
#[derive(Clone, Debug, Default)]
pub struct Points {
    /// In the normalised scene, lifted off their surfaces.
    pub origin: Vec<[f32; 3]>,
    /// Unit normals that cosines are taken to; 0 of a point that sees nothing.
    pub normal: Vec<[f32; 3]>,
    /// Those of the triangles, where others take their cosines: nothing below either horizon is seen. Empty where they
    /// are the same.
    pub horizon: Vec<[f32; 3]>,
}

impl Points {
    /// How many there are.
    pub fn len(&self) -> usize {
        self.origin.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.origin.is_empty()
    }

    /// Some of them, by number.
    pub fn some(&self, numbers: impl Iterator<Item = usize>) -> Points {
        let numbers: Vec<usize> = numbers.collect();
        let of = |items: &[[f32; 3]]| numbers.iter().filter_map(|&number| items.get(number).copied()).collect();
        Points { origin: of(&self.origin), normal: of(&self.normal), horizon: of(&self.horizon) }
    }

    /// The normal that all rays of a point rise along.
    pub fn rise(&self, number: usize) -> [f32; 3] {
        self.horizon.get(number).copied().unwrap_or(self.normal[number])
    }

    /// Whether a direction rises over the triangle of a point.
    pub fn rises(&self, number: usize, direction: [f64; 3]) -> bool {
        self.horizon.get(number).is_none_or(|normal| dot(normal.map(f64::from), direction) > 0.0)
    }

    /// Adds a point.
    pub fn push(&mut self, point: &Point) {
        self.origin.push(point.origin.map(|x| x as f32));
        self.normal.push(point.normal.map(|x| x as f32));
    }
}

/// All surfaces of a scene.
#[derive(Clone, Copy)]
pub struct Surfaces<'a> {
    /// Triangles in normalised coordinates.
    pub mesh: &'a Mesh,
    /// The trees over them.
    pub tracer: &'a Tracer,
}

impl Surfaces<'_> {
    /// The first point that a ray meets, seen from the ray's side. `direction` has length 1.
    pub fn meet(&self, origin: [f32; 3], direction: [f64; 3]) -> Option<Point> {
        self.look(origin, direction).0
    }

    /// The same, and whether anything on its way was thin: another ray there might have found otherwise.
    pub fn look(&self, origin: [f32; 3], direction: [f64; 3]) -> (Option<Point>, bool) {
        let (hit, thin) = self.tracer.look(origin, direction.map(|d| d as f32));
        (hit.map(|hit| self.point(hit, direction)), thin)
    }

    fn point(&self, hit: Hit, direction: [f64; 3]) -> Point {
        let place = self.mesh.place(hit.triangle, hit.barycentric);
        let normal = self.mesh.normal(hit.triangle);
        let normal = if dot(normal, direction) > 0.0 { normal.map(|n| -n) } else { normal };
        // Off the surface along its normal; and back along the ray, which has found the way free: a point in the seam of
        // two walls would otherwise stay in the plane of the other one.
        let lift = self.mesh.lift(hit.triangle);
        let origin = std::array::from_fn(|k| place[k] + lift * (normal[k] - 2.0 * direction[k]));
        let (triangle, distance) = (hit.triangle as u32, f64::from(hit.distance));
        Point { triangle, barycentric: hit.barycentric, place, normal, origin, distance }
    }

    /// A point of a triangle by the weights of its corners 1 and 2, on its front or on its back.
    pub fn side(&self, triangle: usize, barycentric: [f32; 2], back: bool) -> Point {
        let (place, front) = (self.mesh.place(triangle, barycentric), self.mesh.normal(triangle));
        let normal = if back { front.map(|n| -n) } else { front };
        let lift = self.mesh.lift(triangle);
        let origin = std::array::from_fn(|k| place[k] + lift * normal[k]);
        Point { triangle: triangle as u32, barycentric, place, normal, origin, distance: 0.0 }
    }

    /// Whether nothing lies between two points of the normalised scene.
    pub fn see(&self, from: [f64; 3], to: [f64; 3]) -> bool {
        let way: [f64; 3] = std::array::from_fn(|k| to[k] - from[k]);
        let length = dot(way, way).sqrt();
        if length == 0.0 {
            return true;
        }
        let hit = self.tracer.closest_hit(from.map(|x| x as f32), way.map(|x| (x / length) as f32));
        hit.is_none_or(|hit| f64::from(hit.distance) >= length)
    }
}
