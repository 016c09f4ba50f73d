//! Visibility for Python: the rays of the precomputation by themselves, for benchmarks and tests.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::scene::Mesh;
use crate::scene::rays::{Apex, Fan, LIFT, Tracer as Core, Walk, fans};

use super::arrays::vectors;
use super::compute;

/// Triangles, ready for rays from shared points.
#[pyclass(frozen, module = "deltalux._core")]
pub(crate) struct Tracer {
    /// Triangles in normalised coordinates.
    mesh: Mesh,
    /// The trees over them.
    tracer: Core,
}

impl Tracer {
    /// For each direction which of some points on surfaces, at most `TOGETHER`, see it: one bit each.
    fn seen(&self, origins: &[[f64; 3]], normals: &[[f64; 3]], ways: &Ways, room: &mut Walk) -> Vec<u64> {
        let up = LIFT / self.mesh.scale;
        let mut seen = vec![0; ways.directions.len()];
        for (number, (origin, normal)) in origins.iter().zip(normals).enumerate() {
            let lifted = std::array::from_fn(|k| origin[k] + up * normal[k]);
            let apex = Apex { origin: self.mesh.normalised(lifted), normal: normal.map(|x| x as f32) };
            for (fan, places) in &ways.fans {
                let mut above = 0;
                for (ray, &place) in places.iter().enumerate() {
                    let (n, d) = (apex.normal, ways.directions[place]);
                    above |= u64::from(n[0] * d[0] + n[1] * d[1] + n[2] * d[2] > 0.0) << ray;
                }
                let mut open = above & !self.tracer.blocked(&apex, fan, above, room);
                while open != 0 {
                    seen[places[open.trailing_zeros() as usize]] |= 1 << number;
                    open &= open - 1;
                }
            }
        }
        seen
    }
}

/// Points whose answers are one word.
const TOGETHER: usize = 64;

/// Directions, and the fans that they make.
struct Ways {
    directions: Vec<[f32; 3]>,
    fans: Vec<(Fan, Vec<usize>)>,
}

/// Refuses origins that are not finite, and vectors that are not of length 1.
fn check(origins: &[[f64; 3]], normals: &[[f64; 3]], directions: &[[f64; 3]]) -> Result<()> {
    if origins.len() != normals.len() {
        return Err(Error::input(format!("expected {} normals, one an origin, got {}", origins.len(), normals.len())));
    }
    let finite = |points: &[[f64; 3]]| points.iter().all(|p| p.iter().all(|x| x.is_finite()));
    let unit = |points: &[[f64; 3]]| points.iter().all(|p| (p.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-4);
    if !finite(origins) {
        return Err(Error::input("expected finite origins, got NaN or infinity"));
    }
    for (name, vectors) in [("normals", normals), ("directions", directions)] {
        if !unit(vectors) {
            return Err(Error::input(format!("expected {name} of length 1, got others")));
        }
    }
    Ok(())
}

#[pymethods]
impl Tracer {
    /// vertices (v, 3) float64, triangles (t, 3) uint32.
    #[new]
    fn new(
        py: Python<'_>,
        vertices: PyReadonlyArray2<'_, f64>,
        triangles: PyReadonlyArray2<'_, u32>,
    ) -> PyResult<Self> {
        let (vertices, triangles) = (vectors("vertices", &vertices)?, vectors("triangles", &triangles)?);
        compute(py, || {
            let mesh = Mesh::new(&vertices, &triangles)?;
            let tracer = Core::new(&mesh);
            Ok(Tracer { mesh, tracer })
        })
    }

    /// What points on surfaces see: (d, r) bool, true where nothing blocks the ray from an origin in a direction.
    ///
    /// origins (r, 3), unit normals (r, 3) and unit directions (d, 3) are float64. Origins are lifted off their surface;
    /// rays below the horizon of their normal are false. Fast where neighbours among the directions lie close together.
    fn visibility(
        &self,
        py: Python<'_>,
        origins: PyReadonlyArray2<'_, f64>,
        normals: PyReadonlyArray2<'_, f64>,
        directions: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Py<PyArray2<bool>>> {
        let (origins, normals) = (vectors("origins", &origins)?, vectors("normals", &normals)?);
        let directions = vectors("directions", &directions)?;
        let (rays, count) = (origins.len(), directions.len());
        // An answer is a byte, and a bit on the way.
        Error::unless_room::<[u8; 2]>(rays.saturating_mul(count))?;
        let visible = compute(py, || {
            check(&origins, &normals, &directions)?;
            let directions: Vec<[f32; 3]> = directions.iter().map(|d| d.map(|x| x as f32)).collect();
            let ways = Ways { fans: fans(&directions), directions };
            let seen: Vec<Vec<u64>> = origins
                .par_chunks(TOGETHER)
                .zip(normals.par_chunks(TOGETHER))
                .map_init(Walk::default, |room, (origins, normals)| self.seen(origins, normals, &ways, room))
                .collect();
            let mut visible = vec![false; rays * count];
            visible.par_chunks_mut(rays.max(1)).enumerate().for_each(|(direction, row)| {
                for (seen, part) in seen.iter().zip(row.chunks_mut(TOGETHER)) {
                    part.iter_mut().enumerate().for_each(|(ray, see)| *see = seen[direction] >> ray & 1 == 1);
                }
            });
            Ok(visible)
        })?;
        Ok(PyArray1::from_vec(py, visible).reshape([count, rays])?.unbind())
    }
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Tracer>()
}
