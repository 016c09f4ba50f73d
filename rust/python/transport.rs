//! M for Python: an opened transport, or one made in memory.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyReadonlyArrayDyn, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;

use crate::basis::ColumnSpace;
use crate::brdf::Stored;
use crate::error::{Error, Result};
use crate::precompute::{LobeShape, Lobes, models};
use crate::transport::clustering::labels;
use crate::transport::entry::entry_bytes;
use crate::transport::{
    self as core, Audit, Channels, Dense, Factors, Opened, Product, Sight, Tile, TransportMatrix, Truncation, Values,
    Width, bf16, open, rewrite, survey_stored,
};
use crate::update::{Chain, Mix};

use super::arrays::{column_weights, to_vec, vectors};
use super::beside::arrays_beside;
use super::pieces::{Link, TileData};
use super::receivers::ReceiverTable;
use super::{compute, interruptible};

/// A light transport matrix M, opened from a directory or made in memory.
#[pyclass(frozen, module = "deltalux._core")]
pub(crate) struct Transport {
    /// The product and what exact sums need; relighters share it.
    pub(crate) chain: Arc<Chain>,
    /// What only a file has.
    file: Option<Opened>,
}

impl Transport {
    /// Looks once through the norms of all rows, in parallel: never later, inside a guard that other work may wait for.
    fn new(product: Product, file: Option<Opened>) -> Self {
        Transport { chain: Arc::new(Chain::new(product)), file }
    }

    /// One matrix in memory.
    pub(super) fn of(py: Python<'_>, matrix: Arc<TransportMatrix>) -> PyResult<Self> {
        compute(py, || Ok(Transport::new(Product::one(matrix), None)))
    }

    /// The matrices, and what links them.
    fn product(&self) -> &Product {
        &self.chain.product
    }

    /// The matrix whose rows are the receivers; of several factors the first.
    fn matrix(&self) -> &TransportMatrix {
        self.product().outputs().first()
    }

    /// The one matrix, for what only makes sense of one.
    pub(super) fn alone(&self) -> Result<&Arc<TransportMatrix>> {
        let several = || Error::input("expected a transport of one matrix, but this one has several parts");
        self.product().alone().ok_or_else(several)
    }

    /// What only a file has; refuses a transport that was made in memory.
    fn file(&self) -> Result<&Opened> {
        self.file.as_ref().ok_or_else(|| Error::input("expected a transport that was opened from a file"))
    }

    /// Stored norms of all rows, (rows, bands * channels).
    fn norms(&self, py: Python<'_>, of: fn(&Tile) -> &[u16]) -> PyResult<Py<PyArray2<f32>>> {
        norms_of(py, self.alone()?, of)
    }

    /// The rule of a re-truncation.
    fn rule(&self, threshold: f64, width: Option<&str>) -> Result<Truncation> {
        let matrix = self.alone()?;
        let width = width.map_or(Ok(width_of(matrix)), str::parse)?;
        Truncation::new(&matrix.bands, threshold, matrix.quantum, width)
    }
}

/// Models, of each row which, and its eye.
type LobeArrays<'py> = (Vec<(u32, Vec<f64>)>, PyReadonlyArray1<'py, u16>, PyReadonlyArray2<'py, f32>);

/// How wide the integers of a matrix are.
fn width_of(matrix: &TransportMatrix) -> Width {
    match matrix.tiles.first().map(|tile| &tile.values) {
        Some(Values::I8(_)) => Width::I8,
        _ => Width::I16,
    }
}

/// Norms of each row in each band (and channel), (rows, bands * channels).
fn norms_of(py: Python<'_>, matrix: &TransportMatrix, of: fn(&Tile) -> &[u16]) -> PyResult<Py<PyArray2<f32>>> {
    let norms: Vec<f32> = matrix.tiles.iter().flat_map(of).map(|&bits| bf16(bits)).collect();
    let a_row = matrix.bands.count() * matrix.channels.count();
    Ok(norms.into_pyarray(py).reshape([matrix.rows, a_row])?.unbind())
}

#[pymethods]
impl Transport {
    /// Opens a transport directory by memory map, after checking everything in it.
    ///
    /// Raises `FileError` (a `ValueError`) where a file is not what it claims to be, `OSError` where it cannot be read.
    #[staticmethod]
    fn open(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        compute(py, || {
            let opened = open(&path, &models)?;
            Ok(Transport::new(opened.product.clone(), Some(opened)))
        })
    }

    /// Compresses a dense array, (rows, columns) or (rows, columns, 3) of float64, in memory. Where some columns are texels
    /// the array lacks them: `texels` is (unit normals (rows, 3) float32, whether open (rows, texels) bool). Of glossy rows
    /// those are made of `lobes`: models (number, parameters), of each row which (rows,) uint16, 65535 of diffuse ones, and
    /// unit vectors to the eye (rows, 3) float32.
    #[staticmethod]
    #[pyo3(signature = (array, *, columns, tile_rows = 16384, width = "i16", quantum = -24, threshold = 0.0, texels = None, lobes = None))]
    #[allow(clippy::too_many_arguments)]
    fn from_dense(
        py: Python<'_>,
        array: PyReadonlyArrayDyn<'_, f64>,
        columns: &str,
        tile_rows: usize,
        width: &str,
        quantum: i32,
        threshold: f64,
        texels: Option<(PyReadonlyArray2<'_, f32>, PyReadonlyArray2<'_, bool>)>,
        lobes: Option<LobeArrays<'_>>,
    ) -> PyResult<Self> {
        let (rows, width_of_array, channels) = match *array.shape() {
            [rows, columns] => (rows, columns, Channels::One),
            [rows, columns, channels] => (rows, columns, Channels::from_count(channels)?),
            ref shape => {
                let what = format!("expected an array (rows, columns) or (rows, columns, 3), got {shape:?}");
                return Err(Error::input(what).into());
            }
        };
        // The copy, and what becomes of it: all entries at worst, in 16 bits and as they are compressed.
        Error::unless_room::<[f64; 2]>(array.len())?;
        let dense = Dense::with_channels(rows, width_of_array, channels, array.as_array().iter().copied().collect());
        let space: ColumnSpace = columns.parse()?;
        let width = width.parse()?;
        let texels = texels.map(|(normals, open)| (vectors("normals", &normals), open.as_array().to_owned()));
        let right = match &texels {
            Some((normals, open)) => {
                normals.as_ref().is_ok_and(|normals| normals.len() == rows)
                    && open.dim() == (rows, space.bands().texels)
            }
            None => space.texels().is_none(),
        };
        if !right {
            return Err(Error::input(format!(
                "expected normals ({rows}, 3) and open ({rows}, {}) for {space}",
                space.bands().texels
            ))
            .into());
        }
        let lobes = match (lobes, &texels) {
            (Some((models, of_row, eyes)), Some((Ok(normals), _))) => {
                let model = |(kind, parameters)| Ok(LobeShape::Model(Stored::new(kind, parameters)?));
                let models = models.into_iter().map(model).collect::<Result<_>>()?;
                let (of_row, eyes) = (to_vec(&of_row), vectors("eyes", &eyes)?);
                compute(py, || Lobes::new(models, of_row, eyes, normals))?.of_texels()
            }
            _ => None,
        };
        compute(py, || {
            let rule = Truncation::new(&space.bands(), threshold, quantum, width)?;
            let mut matrix = dense.compress(space, &rule, tile_rows)?;
            if let Some((normals, open)) = texels {
                matrix = matrix.with_sight(&normals?, lobes.as_ref(), |row, texel| open[(row, texel)]);
            }
            Ok(Transport::new(Product::one(Arc::new(matrix)), None))
        })
    }

    /// One product of transports of one matrix each, in memory.
    #[staticmethod]
    #[pyo3(signature = (first, link = None, then = Vec::new()))]
    fn join(
        py: Python<'_>,
        first: Vec<Bound<'_, Transport>>,
        link: Option<&Link>,
        then: Vec<Bound<'_, Transport>>,
    ) -> PyResult<Self> {
        let matrices = |parts: &[Bound<'_, Transport>]| -> Result<Vec<Arc<TransportMatrix>>> {
            let one = |part: &Bound<'_, Transport>| {
                let transport = part.get();
                transport.alone()?;
                Ok(Arc::clone(transport.product().first.first()))
            };
            parts.iter().map(one).collect()
        };
        let first = Factors::new(matrices(&first)?)?;
        let then = if then.is_empty() { None } else { Some(Factors::new(matrices(&then)?)?) };
        let product = Product::new(first, link.map_or(core::Link::None, |link| link.0.clone()), then)?;
        compute(py, || Ok(Transport::new(product, None)))
    }

    /// Receivers: rows of B.
    #[getter]
    fn rows(&self) -> usize {
        self.product().rows()
    }

    /// What the columns of V mean, as text: "haar:64".
    #[getter]
    fn columns(&self) -> String {
        self.product().first.space().to_string()
    }

    /// What the columns of the second stage's V mean; None where there is one stage.
    #[getter]
    fn second_columns(&self) -> Option<String> {
        self.product().then.as_ref().map(|then| then.space().to_string())
    }

    /// (receivers, columns of the first stage).
    #[getter]
    fn shape(&self) -> (usize, usize) {
        (self.product().rows(), self.product().first.space().columns())
    }

    /// Whether there is one matrix and nothing else.
    #[getter]
    fn is_single(&self) -> bool {
        self.product().alone().is_some()
    }

    /// How many numbers an entry holds for a row, in the matrix where they are more: 1 or 3.
    #[getter]
    fn channels(&self) -> usize {
        let stages = self.product().first.iter().chain(self.product().then.iter().flat_map(Factors::iter));
        stages.map(|matrix| matrix.channels.count()).max().unwrap_or(1)
    }

    /// How many responses a mix adds for each receiver.
    #[getter]
    fn factors(&self) -> usize {
        self.product().factors()
    }

    /// The exponent of two that all values of the receivers' matrix are multiples of.
    #[getter]
    fn quantum(&self) -> i32 {
        self.matrix().quantum
    }

    /// How wide its integers are: "i8" or "i16".
    #[getter]
    fn width(&self) -> &'static str {
        width_of(self.matrix()).name()
    }

    /// Rows of every tile of it but the last.
    #[getter]
    fn tile_rows(&self) -> usize {
        self.matrix().tile_rows
    }

    /// Bytes of M, the norms of its rows included.
    #[getter]
    fn nbytes(&self) -> usize {
        self.product().nbytes()
    }

    /// Stored groups of 16 rows, in all parts.
    #[getter]
    fn entries(&self) -> usize {
        let stages = self.product().first.iter().chain(self.product().then.iter().flat_map(Factors::iter));
        stages.map(|matrix| matrix.entries()).sum()
    }

    /// What the rows are.
    #[getter]
    fn receivers(&self) -> PyResult<ReceiverTable> {
        Ok(ReceiverTable(self.file()?.receivers.clone()))
    }

    /// The camera, as JSON text; None where the receivers are not its pixels.
    #[getter]
    fn camera(&self) -> PyResult<Option<String>> {
        Ok(self.file()?.manifest.receivers.camera.as_ref().map(|camera| camera.get().to_owned()))
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

    /// [major, minor] of the format that the file is written in.
    #[getter]
    fn version(&self) -> PyResult<[u32; 2]> {
        Ok(self.file()?.manifest.version)
    }

    /// Bytes of all files, by name.
    #[getter]
    fn files(&self) -> PyResult<Vec<(String, u64)>> {
        Ok(self.file()?.manifest.files.iter().map(|entry| (entry.name.clone(), entry.bytes)).collect())
    }

    /// What lies beside the product under a name, "scene", "nodes", "emission" or "lamps": arrays by their names; None where nothing does.
    fn beside<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Option<Bound<'py, PyDict>>> {
        arrays_beside(py, &self.file()?.beside, name)
    }

    /// Norm of each stored row in each band (and channel), (rows, bands * channels) float32, rounded up.
    fn kept(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f32>>> {
        self.norms(py, |tile| &tile.kept)
    }

    /// Norm of what each row lost in each band, likewise, never below the truth.
    fn dropped(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f32>>> {
        self.norms(py, |tile| &tile.dropped)
    }

    /// The norm of each row of the receivers' matrix over its texel columns, made anew from what they are made of, (rows,)
    /// float64; None where it has none.
    fn texel_norms(&self, py: Python<'_>) -> PyResult<Option<Py<PyArray1<f64>>>> {
        let matrix = self.matrix();
        if matrix.bands.texels == 0 {
            return Ok(None);
        }
        let norms = compute(py, || {
            let of_tile = |tile: &Tile| tile.sight.as_ref().map_or(Vec::new(), Sight::row_norms);
            Ok(matrix.tiles.par_iter().map(of_tile).collect::<Vec<_>>().concat())
        })?;
        Ok(Some(norms.into_pyarray(py).unbind()))
    }

    /// Of a clustered transport how many pairs of stages there are, and the first row that is longer in a band than its link
    /// says (its number, its norm, and what is said), norms made again being off by the factor `under` at most; None of others.
    #[allow(clippy::type_complexity)]
    fn represented(&self, py: Python<'_>, under: f64) -> PyResult<Option<(usize, Option<(usize, f64, f64)>)>> {
        let product = self.product();
        let (core::Link::Representatives(norms), Some(then)) = (&product.link, &product.then) else {
            return Ok(None);
        };
        let broken = compute(py, || {
            let pairs = norms.iter().zip(product.first.iter().zip(then.iter()));
            Ok(pairs.into_iter().find_map(|(norms, (first, then))| norms.broken(first, then, under)))
        })?;
        Ok(Some((norms.len(), broken)))
    }

    /// The norms that the file states of the stored rows of the receivers' matrix, and of what they lost, in each band and channel,
    /// (rows, bands * channels) float32 each.
    #[allow(clippy::type_complexity)]
    fn stated_norms(&self, py: Python<'_>) -> PyResult<(Py<PyArray2<f32>>, Py<PyArray2<f32>>)> {
        let matrix = self.matrix();
        Ok((norms_of(py, matrix, |tile| &tile.kept)?, norms_of(py, matrix, |tile| &tile.dropped)?))
    }

    /// One transport vector, dense: (columns, channels) float32.
    fn row(&self, py: Python<'_>, row: usize) -> PyResult<Py<PyArray2<f32>>> {
        let matrix = self.alone()?;
        if row >= matrix.rows {
            return Err(PyIndexError::new_err(format!("expected a row below {}, got {row}", matrix.rows)));
        }
        let shape = [matrix.bands.columns(), matrix.channels.count()];
        Ok(matrix.row(row).into_pyarray(py).reshape(shape)?.unbind())
    }

    /// (indptr int64, indices int32, data float32) of a copy of one channel by rows.
    #[allow(clippy::type_complexity)]
    fn to_csr(
        &self,
        py: Python<'_>,
        channel: usize,
    ) -> PyResult<(Py<PyArray1<i64>>, Py<PyArray1<i32>>, Py<PyArray1<f32>>)> {
        let matrix = self.alone()?;
        if channel >= matrix.channels.count() {
            let count = matrix.channels.count();
            return Err(PyIndexError::new_err(format!("expected a channel below {count}, got {channel}")));
        }
        // Parts, and then all of them; of the texels above a row's horizon nearly all are open.
        let entries = 2 * 16 * matrix.entries() + matrix.rows * matrix.bands.texels / 2;
        Error::unless_room::<[u32; 2]>(entries)?;
        let csr = compute(py, || Ok(matrix.to_csr(channel)))?;
        Ok((
            csr.indptr.into_pyarray(py).unbind(),
            csr.indices.into_pyarray(py).unbind(),
            csr.data.into_pyarray(py).unbind(),
        ))
    }

    /// M^T R for (k, rows, 3) float64: (k, columns, 3) float64. `mix`: (rows, factors) float32, where there are several. Of
    /// texel columns only where `texels` asks for them, else 0.
    #[pyo3(signature = (numbers, mix = None, texels = true))]
    fn adjoint<'py>(
        &self,
        py: Python<'py>,
        numbers: PyReadonlyArray3<'py, f64>,
        mix: Option<PyReadonlyArray2<'py, f32>>,
        texels: bool,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (rows, columns) = self.shape();
        let (count, flat) = several(&numbers, rows)?;
        let mix = mix.map(|mix| mix_of(&mix)).transpose()?;
        let out = compute(py, || {
            let each = flat.chunks(rows.max(1)).map(|r| self.chain.adjoint(r, mix.as_ref(), texels));
            Ok(each.collect::<Result<Vec<_>>>()?.concat().into_flattened())
        })?;
        out.into_pyarray(py).reshape([count, columns, 3])
    }

    /// L2 norm of each column of the first stage, over all of its matrices, (columns,) float64.
    fn column_norms(&self, py: Python<'_>) -> PyResult<Py<PyArray1<f64>>> {
        let norms = compute(py, || {
            let mut squares = vec![0.0; self.product().first.space().columns()];
            for matrix in self.product().first.iter() {
                let norms = matrix.column_norms();
                squares.iter_mut().zip(norms).for_each(|(sum, norm): (&mut f64, f64)| *sum += norm * norm);
            }
            Ok(squares.into_iter().map(f64::sqrt).collect::<Vec<_>>())
        })?;
        Ok(norms.into_pyarray(py).unbind())
    }

    /// Bytes of the bits of texel columns, in all parts.
    #[getter]
    fn texel_bytes(&self) -> usize {
        let tiles = self.product().first.iter().flat_map(|matrix| &matrix.tiles);
        tiles.flat_map(|tile| &tile.sight).map(Sight::nbytes).sum()
    }

    /// Bytes that a frame streams for each column of the first stage, (columns,) float64. A texel's, whose bits are few,
    /// counts as an entry for each group of rows that it is made anew for.
    fn column_bytes(&self, py: Python<'_>) -> PyResult<Py<PyArray1<f64>>> {
        let bytes = compute(py, || {
            let mut bytes = vec![0.0; self.product().first.space().columns()];
            for matrix in self.product().first.iter() {
                let entry = entry_bytes(width_of(matrix), matrix.channels) as f64;
                let entries = matrix.column_entries();
                bytes
                    .iter_mut()
                    .zip(entries)
                    .for_each(|(sum, count): (&mut f64, u32)| *sum += entry * f64::from(count));
            }
            Ok(bytes)
        })?;
        Ok(bytes.into_pyarray(py).unbind())
    }

    /// L2 norm of each column of the second stage, (columns,) float64; None where there is one stage.
    fn second_column_norms(&self, py: Python<'_>) -> PyResult<Option<Py<PyArray1<f64>>>> {
        let Some(then) = &self.product().then else { return Ok(None) };
        let norms = compute(py, || Ok(then.first().column_norms()))?;
        Ok(Some(norms.into_pyarray(py).unbind()))
    }

    /// The cluster of each row of a clustered transport, (rows,) uint32: the one whose mean it takes most of.
    fn labels(&self, py: Python<'_>) -> PyResult<Py<PyArray1<u32>>> {
        let labels = compute(py, || labels(self.matrix()))?;
        Ok(labels.into_pyarray(py).unbind())
    }

    /// For each band of the first stage a factor: B is off by no more than the sum over bands of factor x |what is unsent in
    /// the band| on its account. `mix`: (rows, factors) float32, where there are several.
    #[pyo3(signature = (mix = None))]
    fn error_factors(&self, py: Python<'_>, mix: Option<PyReadonlyArray2<'_, f32>>) -> PyResult<Py<PyArray1<f64>>> {
        let mix = mix.map(|mix| mix_of(&mix)).transpose()?;
        Ok(compute(py, || Ok(self.chain.error_factors(mix.as_ref())))?.into_pyarray(py).unbind())
    }

    /// The nodes' part where there are nodes: columns, rows, channels, quantum, width, tile_rows and tiles, for a writer.
    /// Nothing is copied.
    #[allow(clippy::type_complexity)]
    fn nodes(&self) -> Option<(String, usize, usize, i32, &'static str, usize, Vec<TileData>)> {
        let (core::Link::Weights(_), [_, nodes]) = (&self.product().link, self.product().first.as_slice()) else {
            return None;
        };
        let tiles = nodes.tiles.iter().cloned().map(TileData).collect();
        let TransportMatrix { space, rows, channels, quantum, tile_rows, .. } = **nodes;
        Some((space.to_string(), rows, channels.count(), quantum, width_of(nodes).name(), tile_rows, tiles))
    }

    /// The tiles of the receivers' matrix, for a writer. Nothing is copied.
    fn tiles(&self) -> Vec<TileData> {
        self.matrix().tiles.iter().cloned().map(TileData).collect()
    }

    /// (groups (n,) uint32, an in-memory Transport of 16 n untruncated rows), or None where the file has no audit.
    fn audit(&self, py: Python<'_>) -> PyResult<Option<(Py<PyArray1<u32>>, Transport)>> {
        let Some(audit) = &self.file()?.audit else { return Ok(None) };
        let groups = PyArray1::from_slice(py, &audit.groups).unbind();
        let matrix = audit_matrix(self.product().first.first(), audit);
        Ok(Some((groups, compute(py, || Ok(Transport::new(Product::one(Arc::new(matrix)), None)))?)))
    }

    /// B = M V for (k, columns, 3) float64: (k, rows, 3) float32. `mix`: (rows, factors) float32, where there are several.
    #[pyo3(signature = (lights, mix = None))]
    fn multiply<'py>(
        &self,
        py: Python<'py>,
        lights: PyReadonlyArray3<'py, f64>,
        mix: Option<PyReadonlyArray2<'py, f32>>,
    ) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let (rows, columns) = self.shape();
        let (count, flat) = several(&lights, columns)?;
        // For each row and light the product, and exact sums on the way to it.
        Error::unless_room::<[f32; 9]>(count.saturating_mul(rows))?;
        let mix = mix.map(|mix| mix_of(&mix)).transpose()?;
        let out = compute(py, || {
            let lights: Vec<&[[f64; 3]]> = flat.chunks(columns).collect();
            let mut out = vec![0f32; count * rows * 3];
            self.chain.multiply(&lights, mix.as_ref(), &mut out)?;
            Ok(out)
        })?;
        out.into_pyarray(py).reshape([count, rows, 3])
    }

    /// The same in 64 bits: of one matrix the exact sums themselves.
    #[pyo3(signature = (lights, mix = None))]
    fn multiply_double<'py>(
        &self,
        py: Python<'py>,
        lights: PyReadonlyArray3<'py, f64>,
        mix: Option<PyReadonlyArray2<'py, f32>>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (rows, columns) = self.shape();
        let (count, flat) = several(&lights, columns)?;
        let mix = mix.map(|mix| mix_of(&mix)).transpose()?;
        let out = compute(py, || {
            let lights: Vec<&[[f64; 3]]> = flat.chunks(columns).collect();
            let mut out = vec![0f64; count * rows * 3];
            self.chain.multiply_double(&lights, mix.as_ref(), &mut out)?;
            Ok(out)
        })?;
        out.into_pyarray(py).reshape([count, rows, 3])
    }

    /// For (k, columns, 3) float64 what no colour of a receiver in the whole product of each is off by: (k,) float64.
    fn bounds(&self, py: Python<'_>, lights: PyReadonlyArray3<'_, f64>) -> PyResult<Py<PyArray1<f64>>> {
        let columns = self.shape().1;
        if lights.shape()[1..] != [columns, 3] {
            let found = lights.shape();
            return Err(Error::input(format!("expected lights of shape (k, {columns}, 3), got {found:?}")).into());
        }
        let flat = lights.as_slice()?.to_vec();
        let bounds = compute(py, || {
            let lights: Vec<&[[f64; 3]]> = flat.chunks_exact(3 * columns).map(|light| light.as_chunks().0).collect();
            self.chain.bounds(&lights)
        })?;
        let largest = bounds.into_iter().map(|bound| bound.into_iter().fold(0.0, f64::max));
        Ok(largest.collect::<Vec<_>>().into_pyarray(py).unbind())
    }

    /// The receivers' own matrix without what nodes add to it, in memory: light that has not bounced.
    fn direct(&self, py: Python<'_>) -> PyResult<Self> {
        if self.product().then.is_some() || self.product().factors() != 1 {
            return Err(Error::input("expected a transport of one stage, whose rows take direct light").into());
        }
        let matrix = Arc::clone(self.product().first.first());
        Transport::of(py, matrix)
    }

    /// (threshold, expected relative L2 error, expected entries a group) for a tolerance, from the audit where there is
    /// one, else from all of M.
    #[pyo3(signature = (tolerance, *, width = None))]
    fn threshold_for(&self, py: Python<'_>, tolerance: f64, width: Option<&str>) -> PyResult<(f64, f64, f64)> {
        let rule = self.rule(0.0, width)?;
        let matrix = self.alone()?;
        let audit = self.file.as_ref().and_then(|file| file.audit.as_ref());
        let threshold = compute(py, || match audit {
            Some(audit) => survey_stored(&audit_matrix(matrix, audit), &rule)?.threshold_for(tolerance),
            None => survey_stored(matrix, &rule)?.threshold_for(tolerance),
        })?;
        Ok((threshold.value, threshold.error, threshold.entries_per_group))
    }

    /// M under a coarser rule, in memory. The stated losses include what had been lost before.
    #[pyo3(signature = (threshold, *, width = None))]
    fn truncated(&self, py: Python<'_>, threshold: f64, width: Option<&str>) -> PyResult<Transport> {
        let rule = self.rule(threshold, width)?;
        let matrix = self.alone()?;
        compute(py, || Ok(Transport::new(Product::one(Arc::new(matrix.truncated(&rule)?)), None)))
    }

    /// One matrix in memory that stands for all factors, each times its number, truncated by weights of its columns.
    #[pyo3(signature = (numbers, *, threshold, weights, width = None))]
    fn frozen(
        &self,
        py: Python<'_>,
        numbers: Vec<f64>,
        threshold: f64,
        weights: PyReadonlyArray1<'_, f64>,
        width: Option<&str>,
    ) -> PyResult<Transport> {
        let matrix = self.matrix();
        let weights = column_weights(&weights, matrix.bands.columns())?;
        let width = width.map_or(Ok(width_of(matrix)), str::parse)?;
        let rule = Truncation::with_weights(weights, matrix.bands.always, threshold, matrix.quantum, width)?;
        compute(py, || {
            let matrix = core::freeze(&self.product().first, &numbers, &rule)?;
            Ok(Transport::new(Product::one(Arc::new(matrix)), None))
        })
    }

    /// Writes M under a coarser rule as a transport of its own, shard by shard, with the same receivers and audit.
    #[pyo3(signature = (path, threshold, *, plan, progress = None))]
    fn truncate_to(
        &self,
        py: Python<'_>,
        path: PathBuf,
        threshold: f64,
        plan: String,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let rule = self.rule(threshold, None)?;
        let file = self.file()?;
        interruptible(py, progress, |watch| {
            let step = |tiles: usize| watch.advance(tiles as u64);
            rewrite(file, &path, &rule, plan, step)
        })
    }

    /// Its size, columns and bytes.
    fn __repr__(&self) -> String {
        let (rows, columns) = self.shape();
        format!("Transport({rows} x {columns}, {}, {} bytes)", self.columns(), self.nbytes())
    }
}

/// How many arrays (length, 3) there are in one, and their rows one after the other.
fn several(arrays: &PyReadonlyArray3<'_, f64>, length: usize) -> PyResult<(usize, Vec<[f64; 3]>)> {
    let found = arrays.shape();
    if found[1..] != [length, 3] {
        return Err(Error::input(format!("expected an array of shape (k, {length}, 3), got {found:?}")).into());
    }
    Error::unless_room::<f64>(arrays.len())?;
    Ok((found[0], arrays.as_slice()?.as_chunks().0.to_vec()))
}

/// A mix from an array (rows, factors).
///
/// Where an array repeats one row by a stride of 0, so does the mix.
pub(super) fn mix_of(weights: &PyReadonlyArray2<'_, f32>) -> Result<Mix> {
    if weights.strides()[0] == 0 && weights.shape()[0] > 1 {
        return Mix::alike(weights.as_array().row(0).to_vec(), weights.shape()[0]);
    }
    Mix::new(weights.as_array().iter().copied().collect(), weights.shape()[1])
}

/// The untruncated sample groups as a matrix of one tile.
fn audit_matrix(matrix: &TransportMatrix, audit: &Audit) -> TransportMatrix {
    TransportMatrix {
        space: matrix.space,
        bands: matrix.bands.clone(),
        rows: audit.tile.rows,
        channels: matrix.channels,
        quantum: matrix.quantum,
        tile_rows: audit.tile.rows,
        tiles: vec![audit.tile.clone()],
    }
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Transport>()?;
    Ok(())
}
