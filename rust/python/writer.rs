//! Writing transports from Python, shard by shard.

use std::path::PathBuf;
use std::sync::Mutex;

use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::error::{Error, Result};
use crate::transport::file::manifest::TILES_PER_SHARD;
use crate::transport::{Audit, Description, ReceiverTable, Tile, Writer};

use super::transport::{TileData, parse_width};
use super::{compute, compute_on, look_at};

/// Writes a transport shard by shard; the target is only touched when all is whole.
#[pyclass(frozen, module = "deltalux._core")]
struct TransportWriter(Mutex<Option<Writer>>);

fn finished_error() -> Error {
    Error::input("this writer has finished: open another one")
}

#[pymethods]
impl TransportWriter {
    /// Begins a run, or resumes the one that left `path`.partial with the same `job` text.
    #[new]
    fn new(py: Python<'_>, path: PathBuf, job: String) -> PyResult<Self> {
        let writer = compute(py, || Writer::open(&path, &job))?;
        Ok(TransportWriter(Mutex::new(Some(writer))))
    }

    /// Tiles in a shard.
    #[classattr]
    const TILES_PER_SHARD: usize = TILES_PER_SHARD;

    /// Numbers of the shards that need not be computed again, ascending.
    fn finished(&self, py: Python<'_>) -> PyResult<Vec<usize>> {
        Ok(look_at(py, &self.0, |writer| writer.as_ref().map(Writer::finished)).ok_or_else(finished_error)?)
    }

    /// Writes the tiles of a shard (tiles 4 number, 4 number + 1, ...); returns the bytes written.
    fn write_shard(&self, py: Python<'_>, number: usize, tiles: Vec<Py<TileData>>) -> PyResult<u64> {
        let tiles: Vec<Tile> = tiles.iter().map(|tile| tile.get().0.clone()).collect();
        compute_on(py, &self.0, |writer| writer.as_mut().ok_or_else(finished_error)?.write_shard(number, &tiles))
    }

    /// Writes the receivers, the audit and the manifest, checks everything, and puts the result in its place.
    ///
    /// pixel (rows,) uint32; weight (rows,), albedo, position, normal (rows, 3), background (height * width,) float32;
    /// material (rows,) uint16; audit: (groups (n,) uint32, one tile of 16 n rows in 16 bits).
    #[pyo3(signature = (
        *, columns, rows, quantum, width, tile_rows, image, camera, plan, scene,
        pixel, weight, albedo, position, normal, background, material = None, audit = None
    ))]
    #[allow(clippy::too_many_arguments)]
    fn finish(
        &self,
        py: Python<'_>,
        columns: &str,
        rows: usize,
        quantum: i32,
        width: &str,
        tile_rows: usize,
        image: (usize, usize),
        camera: String,
        plan: String,
        scene: String,
        pixel: PyReadonlyArray1<'_, u32>,
        weight: PyReadonlyArray1<'_, f32>,
        albedo: PyReadonlyArray2<'_, f32>,
        position: PyReadonlyArray2<'_, f32>,
        normal: PyReadonlyArray2<'_, f32>,
        background: PyReadonlyArray1<'_, f32>,
        material: Option<PyReadonlyArray1<'_, u16>>,
        audit: Option<(PyReadonlyArray1<'_, u32>, Py<TileData>)>,
    ) -> PyResult<()> {
        let about = Description {
            space: columns.parse()?,
            rows,
            quantum,
            width: parse_width(width)?,
            tile_rows,
            image: [image.0, image.1],
            camera,
            plan,
            scene,
        };
        let receivers = ReceiverTable {
            pixel: to_vec(&pixel).into(),
            weight: to_vec(&weight).into(),
            albedo: to_vec_of_rows("albedo", &albedo, rows)?.into(),
            position: to_vec_of_rows("position", &position, rows)?.into(),
            normal: to_vec_of_rows("normal", &normal, rows)?.into(),
            material: material.as_ref().map(|material| to_vec(material).into()),
            background: to_vec(&background).into(),
        };
        let audit = audit.map(|(groups, tile)| Audit { groups: to_vec(&groups).into(), tile: tile.get().0.clone() });
        compute_on(py, &self.0, |writer| {
            receivers.check(rows, about.image).map_err(Error::Input)?;
            writer.take().ok_or_else(finished_error)?.finish(&about, &receivers, audit.as_ref())
        })
    }
}

fn to_vec<T: numpy::Element + Copy>(array: &PyReadonlyArray1<'_, T>) -> Vec<T> {
    array.as_array().iter().copied().collect()
}

fn to_vec_of_rows(name: &str, array: &PyReadonlyArray2<'_, f32>, rows: usize) -> Result<Vec<f32>> {
    if array.shape() != [rows, 3] {
        return Err(Error::input(format!("expected {name} of shape ({rows}, 3), got {:?}", array.shape())));
    }
    Ok(array.as_array().iter().copied().collect())
}

pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<TransportWriter>()
}
