//! The rooms scene and precompute for Python: a scene's rays, its receivers, and the pass that makes tiles of M.

use std::sync::Arc;

use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::error::{Error, Result};
use crate::precompute::{DirectPass as Direct, Pass, Rays, Surveyed, contrast, probe, respond, survey, tile};
use crate::scene::rays::{Holes, Opacity, Picture, Tracer, Wrap};
use crate::scene::{Faces, Mesh, PixelSampling, Receivers as Rows, Shading, Surfaces, Vertices};
use crate::transport::{Measure, Threshold, Truncation};

use super::arrays::{coefficients, rows_of, to_vec, vectors};
use super::pieces::TileData;
use super::rows::{Camera, Receivers};
use super::{abandonable, compute, interruptible};

/// A scene's triangles, ready for rays.
#[pyclass(frozen, module = "deltalux._core")]
pub(crate) struct Scene {
    /// Triangles in normalised coordinates.
    mesh: Arc<Mesh>,
    /// The trees over them, which passes share.
    tracer: Arc<Tracer>,
    /// Of each of the user's triangles.
    material: Vec<u32>,
}

/// Bytes that a triangle takes while the tree is built, and a pixel while its rows are found; `deltalux.precomputation.room`
/// has them as well, to refuse in better words.
const TREE: usize = 400;
const PIXEL: usize = 400;

impl Scene {
    /// Its surfaces.
    pub(super) fn surfaces(&self) -> Surfaces<'_> {
        Surfaces { mesh: &self.mesh, tracer: &self.tracer }
    }

    /// Those triangles, for passes.
    pub(super) fn mesh(&self) -> Arc<Mesh> {
        Arc::clone(&self.mesh)
    }

    /// The trees over them.
    pub(super) fn tracer(&self) -> Arc<Tracer> {
        Arc::clone(&self.tracer)
    }
}

/// How much of a material is there, as Python says it.
type OneOpacity<'py> = (f32, Option<f32>, Option<PyReadonlyArray2<'py, f32>>, [String; 2], bool);

/// That of all materials, with places of vertices in pictures and opacities of their own.
type AllOpacities<'py> = (Vec<Option<OneOpacity<'py>>>, PyReadonlyArray2<'py, f32>, PyReadonlyArray1<'py, f32>);

fn opacity((factor, cutoff, picture, wrap, nearest): OneOpacity<'_>) -> PyResult<Opacity> {
    let [u, v] = wrap.map(|word| match word.as_str() {
        "repeat" => Ok(Wrap::Repeat),
        "clamp" => Ok(Wrap::Clamp),
        "mirror" => Ok(Wrap::Mirror),
        other => Err(Error::input(format!("expected \"repeat\", \"clamp\" or \"mirror\", got {other:?}"))),
    });
    let wrap = [u?, v?];
    let picture = picture.map(|picture| {
        let width = picture.shape()[1];
        Picture::new(picture.as_array().iter().copied().collect(), width, wrap, nearest)
    });
    Ok(Opacity { factor, cutoff, picture: picture.transpose()? })
}

#[pymethods]
impl Scene {
    /// vertices (v, 3) float64, triangles (t, 3) uint32, material (t,) uint32. `eye`: near it coordinates are the most
    /// precise. `holes`: opacities of materials, (factor, cutoff or None, picture (h, w) float32 or None, how it goes on
    /// along u and v, whether its nearest texel speaks) or None, with places of vertices in pictures (v, 2) and
    /// opacities of their own (v,), both float32.
    #[new]
    #[pyo3(signature = (vertices, triangles, material, *, eye = None, holes = None))]
    fn new(
        py: Python<'_>,
        vertices: PyReadonlyArray2<'_, f64>,
        triangles: PyReadonlyArray2<'_, u32>,
        material: PyReadonlyArray1<'_, u32>,
        eye: Option<[f64; 3]>,
        holes: Option<AllOpacities<'_>>,
    ) -> PyResult<Self> {
        Error::unless_room::<[u8; TREE]>(triangles.shape()[0])?;
        let vertices = vectors("vertices", &vertices)?;
        let triangles = vectors("triangles", &triangles)?;
        let material: Vec<u32> = material.as_array().iter().copied().collect();
        if material.len() != triangles.len() {
            let (expected, found) = (triangles.len(), material.len());
            return Err(PyValueError::new_err(format!("expected {expected} materials, one a triangle, got {found}")));
        }
        let holes = match holes {
            None => None,
            Some((opacities, uv, own)) => {
                let opacities = opacities.into_iter().map(|own| own.map(opacity).transpose());
                Some((opacities.collect::<PyResult<Vec<_>>>()?, vectors("uv", &uv)?, to_vec(&own)))
            }
        };
        abandonable(py, move || {
            let mesh = Mesh::seen(&vertices, &triangles, eye)?;
            let holes = match holes {
                None => Holes::default(),
                Some((opacities, uv, own)) => Holes::new(&mesh, &triangles, &material, opacities, &uv, &own)?,
            };
            let tracer = Arc::new(Tracer::with_holes(&mesh, holes));
            Ok(Scene { mesh: Arc::new(mesh), tracer, material })
        })
    }

    /// Bytes of the tree and its triangles.
    #[getter]
    fn nbytes(&self) -> usize {
        self.tracer.nbytes()
    }

    /// Triangles without area, which nothing can hit.
    #[getter]
    fn degenerate(&self) -> usize {
        self.mesh.degenerate
    }

    /// The rows of M for a camera: what each pixel shows. `edges` resolves pixels that show several surfaces.
    #[pyo3(signature = (camera, *, edges))]
    fn receivers(&self, py: Python<'_>, camera: &Camera, edges: bool) -> PyResult<Receivers> {
        Error::unless_room::<[u8; PIXEL]>(camera.0.width.saturating_mul(camera.0.height))?;
        let sampling = if edges { PixelSampling::Edges } else { PixelSampling::Centre };
        let rows = interruptible(py, None, |watch| {
            Rows::of_pixels(self.surfaces(), &self.material, &camera.0, sampling, &|| watch.advance(1))
        })?;
        Ok(Receivers::of_pixels(&self.mesh, &camera.0, rows))
    }

    /// The rows of M at the vertices of the user's triangles (t, 3): with normals that are "smooth", those of vertices
    /// (v, 3) float32 where they are given, or "flat".
    #[pyo3(signature = (triangles, *, shading, normals = None))]
    fn vertices(
        &self,
        py: Python<'_>,
        triangles: PyReadonlyArray2<'_, u32>,
        shading: &str,
        normals: Option<PyReadonlyArray2<'_, f32>>,
    ) -> PyResult<Receivers> {
        let shading = match shading {
            "smooth" => Shading::Smooth,
            "flat" => Shading::Flat,
            other => return Err(Error::input(format!("expected normals \"smooth\" or \"flat\", got {other:?}")).into()),
        };
        let triangles = vectors("triangles", &triangles)?;
        let normals = normals.map(|normals| vectors("normals", &normals)).transpose()?;
        let count = normals.as_ref().map_or(u32::MAX, |normals| normals.len() as u32);
        if triangles.len() != self.material.len() || triangles.as_flattened().iter().any(|&vertex| vertex >= count) {
            let expected = self.material.len();
            return Err(Error::input(format!("expected {expected} triangles and a normal for each vertex")).into());
        }
        let rows = interruptible(py, None, |watch| {
            let faces = Faces { triangles: &triangles, material: &self.material, normals: normals.as_deref() };
            Vertices::of_mesh(self.surfaces(), faces, shading, &|| watch.advance(1))
        })?;
        Ok(Receivers::of_vertices(&self.mesh, rows))
    }
}

/// What a survey has seen.
#[pyclass(frozen, get_all, module = "deltalux._core")]
pub(crate) struct Looked {
    /// Entries with a weighted norm below this are dropped.
    threshold: f64,
    /// The error that it gives, and that under each light.
    error: f64,
    errors: Vec<f64>,
    /// That a group of 16 rows keeps.
    entries_per_group: f64,
    /// Of the texel columns of 64 rows.
    texel_bytes: f64,
    /// Numbers of groups that are kept untruncated, and a tile of them.
    groups: Py<PyArray1<u32>>,
    audit: Py<TileData>,
    /// Rays to texel centres, into edge texels; and those of the first that met nothing.
    first_rays: u64,
    edge_rays: u64,
    open_rays: u64,
}

impl Looked {
    /// Of the threshold that was chosen, and what it was chosen by.
    pub(super) fn new(py: Python<'_>, (threshold, surveyed, rays): (Threshold, Surveyed, Rays)) -> PyResult<Self> {
        Ok(Looked {
            threshold: threshold.value,
            error: threshold.error,
            errors: threshold.errors,
            entries_per_group: threshold.entries_per_group,
            texel_bytes: surveyed.texel_bytes,
            groups: surveyed.groups.into_pyarray(py).unbind(),
            audit: Py::new(py, TileData(surveyed.audit))?,
            first_rays: rays.first,
            edge_rays: rays.edge,
            open_rays: rays.open,
        })
    }
}

/// The direct diffuse pass over the receivers of a scene.
#[pyclass(frozen, module = "deltalux._core")]
pub(crate) struct DirectPass(Direct);

#[pymethods]
impl DirectPass {
    /// `edge_side` x `edge_side` rays measure a texel that an edge runs through; 0 lets its centre speak for it.
    #[new]
    #[pyo3(signature = (scene, receivers, *, columns, edge_side))]
    fn new(
        py: Python<'_>,
        scene: &Bound<'_, Scene>,
        receivers: &Bound<'_, Receivers>,
        columns: &str,
        edge_side: usize,
    ) -> PyResult<Self> {
        let (tracer, points) = (scene.get().tracer(), receivers.get().points());
        let space = columns.parse()?;
        let lobes = receivers.get().lobes();
        compute(py, || Ok(DirectPass(Direct::new(tracer, points, lobes, space, edge_side)?)))
    }

    /// Looks at some bundles of 64 rows, and chooses the threshold for a relative image error.
    ///
    /// A light is whether it decides, and two arrays (columns with entries, 3): what of it goes through these columns, and
    /// all of it in them. The worst of those that decide does; where none does the error is expected of natural light.
    #[pyo3(signature = (bundles, *, tolerance, quantum, width, lights = Vec::new(), progress = None))]
    #[allow(clippy::too_many_arguments)]
    fn survey(
        &self,
        py: Python<'_>,
        bundles: usize,
        tolerance: f64,
        quantum: i32,
        width: &str,
        lights: Vec<(bool, PyReadonlyArray2<'_, f64>, PyReadonlyArray2<'_, f64>)>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Looked> {
        let rule = Truncation::new(&self.0.shape().bands, 0.0, quantum, width.parse()?)?;
        let measure = |(decides, truncated, whole): (bool, PyReadonlyArray2<'_, f64>, PyReadonlyArray2<'_, f64>)| {
            Ok(Measure { decides, truncated: vectors("a light", &truncated)?, whole: vectors("a light", &whole)? })
        };
        let lights = Arc::new(lights.into_iter().map(measure).collect::<Result<Vec<_>>>()?);
        let looked = interruptible(py, progress, |watch| {
            let (mut surveyed, rays) = survey(&self.0, bundles, &[rule], &lights, &|rows| watch.advance(rows))?;
            let surveyed = surveyed.swap_remove(0);
            Ok((surveyed.survey.threshold_for(tolerance)?, surveyed, rays))
        })?;
        Looked::new(py, looked)
    }

    /// The response of rows as they are made to V, (columns, 3) float64: (rows, 3) float32.
    #[pyo3(signature = (v, *, progress = None))]
    fn respond(
        &self,
        py: Python<'_>,
        v: PyReadonlyArray2<'_, f64>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Py<PyArray2<f32>>> {
        let v = coefficients(&v)?;
        rows_of(py, &interruptible(py, progress, |watch| respond(&self.0, &v, &|rows| watch.advance(rows)))?)
    }

    /// How much the rows of pairs (n, 2) uint32 differ, relative to the norm of rows in the mean: (n,) float32.
    #[pyo3(signature = (pairs, *, progress = None))]
    fn contrast(
        &self,
        py: Python<'_>,
        pairs: PyReadonlyArray2<'_, u32>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Py<PyArray1<f32>>> {
        let shape = pairs.shape();
        if shape[1] != 2 {
            return Err(Error::input(format!("expected pairs of shape (n, 2), got {shape:?}")).into());
        }
        let pairs: Vec<[u32; 2]> = pairs.as_array().rows().into_iter().map(|row| [row[0], row[1]]).collect();
        let apart = interruptible(py, progress, |watch| contrast(&self.0, &pairs, &|rows| watch.advance(rows)))?;
        Ok(apart.into_pyarray(py).unbind())
    }

    /// Numbers for each row and column that the pass makes.
    #[getter]
    fn channels(&self) -> usize {
        self.0.shape().channels.count()
    }

    /// Matrices that the pass makes.
    #[getter]
    fn factors(&self) -> usize {
        self.0.shape().factors
    }

    /// Traces evenly spread bundles of 64 rows, as the pass itself would, for about so many seconds: (bundles, seconds, rays
    /// to texel centres, rays into edge texels).
    #[pyo3(signature = (seconds, *, threshold, quantum, width))]
    fn probe(
        &self,
        py: Python<'_>,
        seconds: f64,
        threshold: f64,
        quantum: i32,
        width: &str,
    ) -> PyResult<(usize, f64, u64, u64)> {
        let rule = Truncation::new(&self.0.shape().bands, threshold, quantum, width.parse()?)?;
        let probed = interruptible(py, None, |watch| probe(&self.0, seconds, &[rule], &|rows| watch.advance(rows)))?;
        Ok((probed.bundles, probed.seconds, probed.rays.first, probed.rays.edge))
    }

    /// The tile of rows `first` to `first + rows`, and the rays it took: to texel centres, and into edge texels.
    #[pyo3(signature = (first, rows, *, threshold, quantum, width, progress = None))]
    #[allow(clippy::too_many_arguments)]
    fn tile(
        &self,
        py: Python<'_>,
        first: usize,
        rows: usize,
        threshold: f64,
        quantum: i32,
        width: &str,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<(TileData, u64, u64)> {
        let rule = Truncation::new(&self.0.shape().bands, threshold, quantum, width.parse()?)?;
        let (mut tiles, rays) = interruptible(py, progress, |watch| {
            tile(&self.0, first..first.saturating_add(rows), &[rule], &|done| watch.advance(done))
        })?;
        Ok((TileData(tiles.swap_remove(0)), rays.first, rays.edge))
    }
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Scene>()?;
    module.add_class::<DirectPass>()?;
    module.add_class::<Looked>()?;
    Ok(())
}
