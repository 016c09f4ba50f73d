//! The rooms scene and precompute for Python: a scene's rays, its receivers, and the pass that makes tiles of M.

use std::sync::Arc;

use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::error::Result;
use crate::precompute::{DirectPass as Direct, Pass, probe, survey, tile};
use crate::scene::rays::Tracer;
use crate::scene::{Camera, Mesh, PixelSampling, Points, Receivers as Rows, Surfaces};
use crate::transport::{Measure, ReceiverKind, ReceiverTable as Table, Truncation};

use super::arrays::{rows_of, to_vec, to_vec_of_rows, vectors};
use super::pieces::TileData;
use super::receivers::ReceiverTable;
use super::{abandonable, compute, interruptible};

/// A scene's triangles, ready for rays.
#[pyclass(frozen, module = "deltalux._core")]
pub(crate) struct Scene {
    /// Triangles in normalised coordinates.
    mesh: Mesh,
    /// The trees over them, which passes share.
    tracer: Arc<Tracer>,
    /// Of each of the user's triangles.
    material: Vec<u32>,
}

impl Scene {
    /// Its surfaces.
    pub(super) fn surfaces(&self) -> Surfaces<'_> {
        Surfaces { mesh: &self.mesh, tracer: &self.tracer }
    }

    /// The trees over them.
    pub(super) fn tracer(&self) -> Arc<Tracer> {
        Arc::clone(&self.tracer)
    }

    /// The user's number of a triangle.
    pub(super) fn source(&self, triangle: u32) -> u32 {
        self.mesh.source[triangle as usize]
    }

    /// A point of the normalised scene in the user's space.
    pub(super) fn world(&self, place: [f64; 3]) -> [f32; 3] {
        std::array::from_fn(|k| (place[k] / self.mesh.scale + self.mesh.centre[k]) as f32)
    }
}

#[pymethods]
impl Scene {
    /// vertices (v, 3) float64, triangles (t, 3) uint32, material (t,) uint32.
    #[new]
    fn new(
        py: Python<'_>,
        vertices: PyReadonlyArray2<'_, f64>,
        triangles: PyReadonlyArray2<'_, u32>,
        material: PyReadonlyArray1<'_, u32>,
    ) -> PyResult<Self> {
        let vertices = vectors("vertices", &vertices)?;
        let triangles = vectors("triangles", &triangles)?;
        let material: Vec<u32> = material.as_array().iter().copied().collect();
        if material.len() != triangles.len() {
            let (expected, found) = (triangles.len(), material.len());
            return Err(PyValueError::new_err(format!("expected {expected} materials, one a triangle, got {found}")));
        }
        abandonable(py, move || {
            let mesh = Mesh::new(&vertices, &triangles)?;
            let tracer = Arc::new(Tracer::new(&mesh));
            Ok(Scene { mesh, tracer, material })
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
    #[pyo3(signature = (*, position, right, up, forward, half_height, width, height, edges))]
    #[allow(clippy::too_many_arguments)]
    fn receivers(
        &self,
        py: Python<'_>,
        position: [f64; 3],
        right: [f64; 3],
        up: [f64; 3],
        forward: [f64; 3],
        half_height: f64,
        width: usize,
        height: usize,
        edges: bool,
    ) -> PyResult<Receivers> {
        let camera = Camera { position, right, up, forward, half_height, width, height };
        let sampling = if edges { PixelSampling::Edges } else { PixelSampling::Centre };
        let rows = interruptible(py, None, |watch| {
            camera.check()?;
            Rows::of_pixels(self.surfaces(), &self.material, &camera, sampling, &|| watch.advance(1))
        })?;
        let source = rows.triangle.iter().map(|&triangle| self.source(triangle)).collect();
        let position = rows.points.origin.iter().map(|origin| self.world(origin.map(f64::from)));
        Ok(Receivers { position: position.collect(), source, rows: Arc::new(rows) })
    }
}

/// Rows of M: pixel samples on surfaces.
#[pyclass(frozen, module = "deltalux._core")]
pub(crate) struct Receivers {
    /// What the pass goes by.
    rows: Arc<Rows>,
    /// The user's number of each row's triangle.
    source: Vec<u32>,
    /// In the user's space.
    position: Vec<[f32; 3]>,
}

impl Receivers {
    /// Where the rows' rays start.
    pub(super) fn points(&self) -> Arc<Points> {
        Arc::clone(&self.rows.points)
    }
}

#[pymethods]
impl Receivers {
    /// The number of rows.
    fn __len__(&self) -> usize {
        self.rows.len()
    }

    /// Primary rays shot to find them.
    #[getter]
    fn rays(&self) -> u64 {
        self.rows.rays
    }

    /// The pixel that each row adds to, row-major, (rows,) uint32.
    #[getter]
    fn pixel(&self, py: Python<'_>) -> Py<PyArray1<u32>> {
        PyArray1::from_slice(py, &self.rows.pixel).unbind()
    }

    /// The share of its pixel that each row is, (rows,) float32.
    #[getter]
    fn weight(&self, py: Python<'_>) -> Py<PyArray1<f32>> {
        PyArray1::from_slice(py, &self.rows.weight).unbind()
    }

    /// The user's number of each row's triangle, (rows,) uint32.
    #[getter]
    fn triangle(&self, py: Python<'_>) -> Py<PyArray1<u32>> {
        PyArray1::from_slice(py, &self.source).unbind()
    }

    /// Weights of the triangle's corners 1 and 2 at the point, (rows, 2) float32.
    #[getter]
    fn barycentric(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f32>>> {
        rows_of(py, &self.rows.barycentric)
    }

    /// The points in the user's space, lifted off their surface, (rows, 3) float32.
    #[getter]
    fn position(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f32>>> {
        rows_of(py, &self.position)
    }

    /// Unit geometric normals towards the camera, (rows, 3) float32.
    #[getter]
    fn normal(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f32>>> {
        rows_of(py, &self.rows.points.normal)
    }

    /// Share of each pixel in which nothing is seen, (height * width,).
    #[getter]
    fn background(&self, py: Python<'_>) -> Py<PyArray1<f32>> {
        PyArray1::from_slice(py, &self.rows.background).unbind()
    }

    /// The rows of a transport of an image (height, width): with what the materials say of each, albedo (rows, 3) float32
    /// and material (rows,) uint16.
    fn table(
        &self,
        image: (usize, usize),
        albedo: PyReadonlyArray2<'_, f32>,
        material: PyReadonlyArray1<'_, u16>,
    ) -> PyResult<ReceiverTable> {
        let rows = &self.rows;
        Ok(ReceiverTable::checked(Table {
            albedo: to_vec_of_rows("albedo", &albedo, rows.len())?.into(),
            position: self.position.as_flattened().to_vec().into(),
            normal: rows.points.normal.as_flattened().to_vec().into(),
            material: Some(to_vec(&material).into()),
            kind: ReceiverKind::Pixels {
                image: [image.0, image.1],
                pixel: rows.pixel.clone().into(),
                weight: rows.weight.clone().into(),
                background: rows.background.clone().into(),
            },
        })?)
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
        let (tracer, points) = (scene.get().tracer.clone(), receivers.get().rows.points.clone());
        let space = columns.parse()?;
        compute(py, || Ok(DirectPass(Direct::new(tracer, points, space, edge_side)?)))
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
        let (threshold, surveyed, rays) = interruptible(py, progress, |watch| {
            let (mut surveyed, rays) = survey(&self.0, bundles, &[rule], &lights, &|rows| watch.advance(rows))?;
            let surveyed = surveyed.swap_remove(0);
            Ok((surveyed.survey.threshold_for(tolerance)?, surveyed, rays))
        })?;
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
    module.add_class::<Receivers>()?;
    module.add_class::<DirectPass>()?;
    module.add_class::<Looked>()?;
    Ok(())
}
