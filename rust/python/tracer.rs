//! Visibility for Python: the rays of the precomputation by themselves, for benchmarks and tests.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::scene::Mesh;
use crate::scene::rays::{BUNDLE, Bundle, LIFT, Tracer as Core, Walk};

use super::arrays::vectors;
use super::compute;

/// Directions that are traced together.
const BLOCK: usize = 64;

/// Triangles, ready for rays of shared directions.
#[pyclass(frozen, module = "deltalux._core")]
pub(crate) struct Tracer {
    /// Triangles in normalised coordinates.
    mesh: Mesh,
    /// The trees over them.
    tracer: Core,
}

impl Tracer {
    /// For each direction the receivers of a bundle that see it, one bit each.
    fn seen(&self, origins: &[[f64; 3]], normals: &[[f64; 3]], directions: &[[f32; 3]], room: &mut Walk) -> Vec<u64> {
        let narrow = |n: &[f64; 3]| n.map(|x| x as f32);
        let lifted = |(origin, normal): (&[f64; 3], &[f64; 3])| {
            let up = LIFT / self.mesh.scale;
            self.mesh.normalised(std::array::from_fn(|k| origin[k] + up * normal[k]))
        };
        let origins: Vec<[f32; 3]> = origins.iter().zip(normals).map(lifted).collect();
        let normals: Vec<[f32; 3]> = normals.iter().map(narrow).collect();
        let bundle = Bundle::new(&origins, &normals);
        room.begin();
        let above: Vec<u64> = directions.iter().map(|&direction| above(&normals, direction)).collect();
        let mut blocked = vec![0; directions.len()];
        for first in (0..directions.len()).step_by(BLOCK) {
            let block = first..(first + BLOCK).min(directions.len());
            let (part, active) = (&directions[block.clone()], &above[block.clone()]);
            self.tracer.blocked_each(&bundle, part, active, room, &mut blocked[block]);
        }
        above.iter().zip(&blocked).map(|(above, blocked)| above & !blocked).collect()
    }
}

/// Receivers that have a direction above their horizon.
fn above(normals: &[[f32; 3]], d: [f32; 3]) -> u64 {
    normals
        .iter()
        .enumerate()
        .fold(0, |bits, (ray, n)| bits | ((n[0] * d[0] + n[1] * d[1] + n[2] * d[2] > 0.0) as u64) << ray)
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
    /// rays below the horizon of their normal are false. Fast where 64 consecutive origins, and 64 consecutive
    /// directions, lie close together.
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
        let visible = compute(py, || {
            check(&origins, &normals, &directions)?;
            let directions: Vec<[f32; 3]> = directions.iter().map(|d| d.map(|x| x as f32)).collect();
            let bundles: Vec<Vec<u64>> = origins
                .par_chunks(BUNDLE)
                .zip(normals.par_chunks(BUNDLE))
                .map_init(Walk::default, |room, (origins, normals)| self.seen(origins, normals, &directions, room))
                .collect();
            let mut visible = vec![false; rays * count];
            visible.par_chunks_mut(rays.max(1)).enumerate().for_each(|(direction, row)| {
                for (bundle, part) in bundles.iter().zip(row.chunks_mut(BUNDLE)) {
                    part.iter_mut().enumerate().for_each(|(ray, see)| *see = bundle[direction] >> ray & 1 == 1);
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
