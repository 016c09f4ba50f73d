//! The transport floor for Python: an opened M, and tiles that are passed to a writer unseen.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyIndexError, PyValueError};
use pyo3::prelude::*;

use crate::error::{Error, Result};
use crate::relight::shade::{Rows, resolve};
use crate::transport::bf16;
use crate::transport::file::manifest::width_name;
use crate::transport::{Audit, Dense, ReceiverTable, Tile, TransportMatrix, Truncation, Values, Width};
use crate::transport::{Opened, open, rewrite, survey_stored};
use crate::update::{RowNorm, multiply};

use super::{compute, interruptible};

/// One tile of M: what a pass returns and `TransportWriter.write_shard` takes.
#[pyclass(frozen, module = "deltalux._core")]
pub(crate) struct TileData(pub(crate) Tile);

#[pymethods]
impl TileData {
    /// Rows of the tile.
    #[getter]
    fn rows(&self) -> usize {
        self.0.rows
    }

    /// Stored groups of 16 rows.
    #[getter]
    fn entries(&self) -> usize {
        self.0.words.len()
    }

    /// Bytes in memory, which are those on disk.
    #[getter]
    fn nbytes(&self) -> usize {
        self.0.nbytes()
    }
}

/// A light transport matrix M, opened from a directory or made in memory.
#[pyclass(frozen, module = "deltalux._core")]
pub(crate) struct Transport {
    pub(crate) matrix: Arc<TransportMatrix>,
    /// What the grid of a product follows.
    row_norm: RowNorm,
    /// What only a file has.
    file: Option<Opened>,
}

impl Transport {
    /// Looks once through the norms of all rows, in parallel: never later, inside a guard that other work may wait for.
    fn new(matrix: Arc<TransportMatrix>, file: Option<Opened>) -> Self {
        let row_norm = RowNorm::of(&matrix);
        Transport { matrix, row_norm, file }
    }

    fn file(&self) -> Result<&Opened> {
        self.file.as_ref().ok_or_else(|| Error::input("expected a transport that was opened from a file"))
    }

    fn per_row(&self, py: Python<'_>, of: fn(&ReceiverTable) -> &[f32]) -> PyResult<Py<PyArray2<f32>>> {
        Ok(PyArray1::from_slice(py, of(&self.file()?.receivers)).reshape([self.matrix.rows, 3])?.unbind())
    }

    fn norms(&self, py: Python<'_>, of: fn(&Tile) -> &[u16]) -> PyResult<Py<PyArray2<f32>>> {
        let norms: Vec<f32> = self.matrix.tiles.iter().flat_map(of).map(|&bits| bf16(bits)).collect();
        Ok(norms.into_pyarray(py).reshape([self.matrix.rows, self.matrix.bands.count()])?.unbind())
    }

    fn stored_width(&self) -> Width {
        match self.matrix.tiles.first().map(|tile| &tile.values) {
            Some(Values::I8(_)) => Width::I8,
            _ => Width::I16,
        }
    }

    /// The rule of a re-truncation: what is not given stays as it is.
    fn rule(&self, threshold: f64, width: Option<&str>, quantum: Option<i32>) -> Result<Truncation> {
        let width = width.map_or(Ok(self.stored_width()), parse_width)?;
        Truncation::new(&self.matrix.bands, threshold, quantum.unwrap_or(self.matrix.quantum), width)
    }
}

pub(super) fn parse_width(text: &str) -> Result<Width> {
    match text {
        "i8" => Ok(Width::I8),
        "i16" => Ok(Width::I16),
        other => Err(Error::input(format!("expected the width \"i8\" or \"i16\", got {other:?}"))),
    }
}

#[pymethods]
impl Transport {
    /// Opens a transport directory by memory map, after checking everything in it.
    ///
    /// Raises `FileError` (a `ValueError`) where a file is not what it claims to be, `OSError` where it cannot be read.
    #[staticmethod]
    fn open(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        compute(py, || {
            let opened = open(&path)?;
            Ok(Transport::new(Arc::clone(&opened.matrix), Some(opened)))
        })
    }

    /// Compresses a dense array (rows, columns) of float64 in memory.
    #[staticmethod]
    #[pyo3(signature = (array, *, columns, tile_rows = 16384, width = "i16", quantum = -24, threshold = 0.0))]
    fn from_dense(
        py: Python<'_>,
        array: PyReadonlyArray2<'_, f64>,
        columns: &str,
        tile_rows: usize,
        width: &str,
        quantum: i32,
        threshold: f64,
    ) -> PyResult<Self> {
        let [rows, width_of_array] = [array.shape()[0], array.shape()[1]];
        let dense = Dense::new(rows, width_of_array, array.as_array().iter().copied().collect());
        let space: crate::basis::ColumnSpace = columns.parse()?;
        let width = parse_width(width)?;
        compute(py, || {
            let rule = Truncation::new(&space.bands(), threshold, quantum, width)?;
            Ok(Transport::new(Arc::new(dense.compress(space, &rule, tile_rows)?), None))
        })
    }

    #[getter]
    fn rows(&self) -> usize {
        self.matrix.rows
    }

    /// What the columns mean, as text: "haar:64".
    #[getter]
    fn columns(&self) -> String {
        self.matrix.space.to_string()
    }

    #[getter]
    fn shape(&self) -> (usize, usize) {
        (self.matrix.rows, self.matrix.bands.columns())
    }

    #[getter]
    fn quantum(&self) -> i32 {
        self.matrix.quantum
    }

    #[getter]
    fn width(&self) -> &'static str {
        width_name(self.stored_width())
    }

    #[getter]
    fn tile_rows(&self) -> usize {
        self.matrix.tile_rows
    }

    /// Bytes of M, the norms of its rows included.
    #[getter]
    fn nbytes(&self) -> usize {
        self.matrix.nbytes()
    }

    /// Bytes of the receivers.
    #[getter]
    fn receiver_nbytes(&self) -> usize {
        self.file.as_ref().map_or(0, |file| file.receivers.nbytes())
    }

    /// Stored groups of 16 rows.
    #[getter]
    fn entries(&self) -> usize {
        self.matrix.entries()
    }

    /// (height, width) of the image that the receivers resolve into.
    #[getter]
    fn image_shape(&self) -> PyResult<(usize, usize)> {
        let [height, width] = self.file()?.manifest.image;
        Ok((height, width))
    }

    /// The camera, as JSON text.
    #[getter]
    fn camera(&self) -> PyResult<String> {
        Ok(self.file()?.manifest.camera.get().to_owned())
    }

    /// The plan by which M was computed, as JSON text.
    #[getter]
    fn plan(&self) -> PyResult<String> {
        Ok(self.file()?.manifest.plan.get().to_owned())
    }

    /// The hash of the scene.
    #[getter]
    fn scene(&self) -> PyResult<String> {
        Ok(self.file()?.manifest.scene.clone())
    }

    /// Bytes of all files, by name.
    #[getter]
    fn files(&self) -> PyResult<Vec<(String, u64)>> {
        Ok(self.file()?.manifest.files.iter().map(|entry| (entry.name.clone(), entry.bytes)).collect())
    }

    /// The pixel of each row, (rows,) uint32.
    #[getter]
    fn pixel(&self, py: Python<'_>) -> PyResult<Py<PyArray1<u32>>> {
        Ok(PyArray1::from_slice(py, &self.file()?.receivers.pixel).unbind())
    }

    /// The share of its pixel that each row is, (rows,) float32.
    #[getter]
    fn weight(&self, py: Python<'_>) -> PyResult<Py<PyArray1<f32>>> {
        Ok(PyArray1::from_slice(py, &self.file()?.receivers.weight).unbind())
    }

    /// Diffuse reflectance, (rows, 3) float32.
    #[getter]
    fn albedo(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f32>>> {
        self.per_row(py, |receivers| &receivers.albedo)
    }

    /// World coordinates, (rows, 3) float32.
    #[getter]
    fn position(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f32>>> {
        self.per_row(py, |receivers| &receivers.position)
    }

    /// Shading normals, (rows, 3) float32.
    #[getter]
    fn normal(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f32>>> {
        self.per_row(py, |receivers| &receivers.normal)
    }

    /// The material of each row, (rows,) uint16, or None.
    #[getter]
    fn material(&self, py: Python<'_>) -> PyResult<Option<Py<PyArray1<u16>>>> {
        let material = &self.file()?.receivers.material;
        Ok(material.as_ref().map(|items| PyArray1::from_slice(py, items).unbind()))
    }

    /// The share of each pixel that sees no surface, (height, width) float32.
    #[getter]
    fn background(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f32>>> {
        let file = self.file()?;
        Ok(PyArray1::from_slice(py, &file.receivers.background).reshape(file.manifest.image)?.unbind())
    }

    /// Norm of each stored row in each band, (rows, bands) float32, rounded up.
    fn kept(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f32>>> {
        self.norms(py, |tile| &tile.kept)
    }

    /// Norm of what each row lost in each band, (rows, bands) float32, never below the truth.
    fn dropped(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f32>>> {
        self.norms(py, |tile| &tile.dropped)
    }

    /// One transport vector, dense: (columns,) float32.
    fn row(&self, py: Python<'_>, row: usize) -> PyResult<Py<PyArray1<f32>>> {
        if row >= self.matrix.rows {
            return Err(PyIndexError::new_err(format!("expected a row below {}, got {row}", self.matrix.rows)));
        }
        Ok(self.matrix.row(row).into_pyarray(py).unbind())
    }

    /// (indptr int64, indices int32, data float32) of a copy by rows.
    #[allow(clippy::type_complexity)]
    fn to_csr(&self, py: Python<'_>) -> PyResult<(Py<PyArray1<i64>>, Py<PyArray1<i32>>, Py<PyArray1<f32>>)> {
        let csr = compute(py, || Ok(self.matrix.to_csr()))?;
        Ok((
            csr.indptr.into_pyarray(py).unbind(),
            csr.indices.into_pyarray(py).unbind(),
            csr.data.into_pyarray(py).unbind(),
        ))
    }

    /// M^T y for y of (rows, k) float64: (columns, k) float64.
    fn transpose_multiply(&self, py: Python<'_>, y: PyReadonlyArray2<'_, f64>) -> PyResult<Py<PyArray2<f64>>> {
        let (rows, k) = (y.shape()[0], y.shape()[1]);
        if rows != self.matrix.rows || k == 0 {
            let expected = self.matrix.rows;
            return Err(PyValueError::new_err(format!("expected an array ({expected}, k >= 1), got ({rows}, {k})")));
        }
        let y: Vec<f64> = y.as_array().iter().copied().collect();
        let product = compute(py, || Ok(self.matrix.transpose_multiply(&y, k)))?;
        Ok(product.into_pyarray(py).reshape([self.matrix.bands.columns(), k])?.unbind())
    }

    /// L2 norm of each column, (columns,) float64.
    fn column_norms(&self, py: Python<'_>) -> PyResult<Py<PyArray1<f64>>> {
        Ok(compute(py, || Ok(self.matrix.column_norms()))?.into_pyarray(py).unbind())
    }

    /// Groups stored for each column, (columns,) uint32: what it costs to stream it.
    fn column_entries(&self, py: Python<'_>) -> Py<PyArray1<u32>> {
        self.matrix.column_entries().into_pyarray(py).unbind()
    }

    /// The largest norm of a row, rounded up.
    fn row_norm_max(&self) -> f64 {
        self.matrix.row_norm_max()
    }

    /// The tiles, for a writer. Nothing is copied.
    fn tiles(&self) -> Vec<TileData> {
        self.matrix.tiles.iter().cloned().map(TileData).collect()
    }

    /// (groups (n,) uint32, an in-memory Transport of 16 n untruncated rows), or None where the file has no audit.
    fn audit(&self, py: Python<'_>) -> PyResult<Option<(Py<PyArray1<u32>>, Transport)>> {
        let Some(audit) = &self.file()?.audit else { return Ok(None) };
        let groups = PyArray1::from_slice(py, &audit.groups).unbind();
        let matrix = Arc::new(self.audit_matrix(audit));
        Ok(Some((groups, compute(py, || Ok(Transport::new(matrix, None)))?)))
    }

    /// B = M V for (k, columns, 3) float64: (k, rows, 3) float32.
    fn multiply<'py>(
        &self,
        py: Python<'py>,
        lights: PyReadonlyArray3<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let (count, rows) = (lights.shape()[0], self.matrix.rows);
        let per_light = 3 * self.matrix.bands.columns();
        let flat = lights.as_slice()?;
        let out = compute(py, || {
            let lights: Vec<&[[f64; 3]]> = flat.chunks_exact(per_light).map(|light| light.as_chunks().0).collect();
            let mut out = vec![0f32; count * rows * 3];
            multiply(&self.matrix, self.row_norm, &lights, &mut out)?;
            Ok(out)
        })?;
        out.into_pyarray(py).reshape([count, rows, 3])
    }

    /// The picture of a response (rows, 3): (height, width, 3) float32, black where no surface is seen.
    fn image<'py>(&self, py: Python<'py>, values: PyReadonlyArray2<'py, f32>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let file = self.file()?;
        let [height, width] = file.manifest.image;
        let values = values.as_slice()?;
        let mut picture = vec![0f32; 3 * height * width];
        let ReceiverTable { pixel, weight, albedo, .. } = &file.receivers;
        py.detach(|| resolve(&Rows { pixel, weight, albedo }, values, &mut picture));
        picture.into_pyarray(py).reshape([height, width, 3])
    }

    /// (threshold, expected relative L2 error, expected entries a group) for a tolerance, from the audit where there is
    /// one, else from all of M.
    #[pyo3(signature = (tolerance, *, width = None, quantum = None))]
    fn threshold_for(
        &self,
        py: Python<'_>,
        tolerance: f64,
        width: Option<&str>,
        quantum: Option<i32>,
    ) -> PyResult<(f64, f64, f64)> {
        let rule = self.rule(0.0, width, quantum)?;
        let audit = self.file.as_ref().and_then(|file| file.audit.as_ref());
        let choice = compute(py, || match audit {
            Some(audit) => survey_stored(&self.audit_matrix(audit), &rule)?.threshold_for(tolerance),
            None => survey_stored(&self.matrix, &rule)?.threshold_for(tolerance),
        })?;
        Ok((choice.value, choice.error, choice.entries_per_group))
    }

    /// M under a coarser rule, in memory. The stated losses include what had been lost before.
    #[pyo3(signature = (threshold, *, width = None, quantum = None))]
    fn truncated(
        &self,
        py: Python<'_>,
        threshold: f64,
        width: Option<&str>,
        quantum: Option<i32>,
    ) -> PyResult<Transport> {
        let rule = self.rule(threshold, width, quantum)?;
        compute(py, || Ok(Transport::new(Arc::new(self.matrix.truncated(&rule)?), None)))
    }

    /// Writes M under a coarser rule as a transport of its own, shard by shard, with the same receivers and audit.
    #[pyo3(signature = (path, threshold, *, plan, width = None, quantum = None, progress = None))]
    #[allow(clippy::too_many_arguments)]
    fn truncate_to(
        &self,
        py: Python<'_>,
        path: PathBuf,
        threshold: f64,
        plan: String,
        width: Option<&str>,
        quantum: Option<i32>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let rule = self.rule(threshold, width, quantum)?;
        let file = self.file()?;
        interruptible(py, progress, |watch| {
            let step = |tiles: usize| watch.advance(tiles as u64);
            rewrite(file, &path, &rule, plan, step)
        })
    }

    fn __repr__(&self) -> String {
        let (rows, columns) = self.shape();
        format!("Transport({rows} x {columns}, {}, {} bytes)", self.columns(), self.nbytes())
    }
}

impl Transport {
    fn audit_matrix(&self, audit: &Audit) -> TransportMatrix {
        TransportMatrix {
            space: self.matrix.space,
            bands: self.matrix.bands.clone(),
            rows: audit.tile.rows,
            quantum: self.matrix.quantum,
            tile_rows: audit.tile.rows,
            tiles: vec![audit.tile.clone()],
        }
    }
}

pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<TileData>()?;
    module.add_class::<Transport>()?;
    Ok(())
}
