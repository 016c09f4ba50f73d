//! Writing transports from Python, shard by shard.

use std::path::PathBuf;
use std::sync::Mutex;

use numpy::PyReadonlyArray1;
use pyo3::prelude::*;

use crate::error::{Error, Result};
use crate::transport::{self as core, Audit, Channels, Description, Part, Tile, Writer};

use super::arrays::to_vec;
use super::beside::{Named, beside_of};
use super::pieces::{Link, TileData};
use super::receivers::ReceiverTable;
use super::{compute, compute_on, look_at};

/// Name, columns, rows, channels, quantum, width and rows of a tile of a part.
type PartTuple = (String, String, usize, usize, i32, String, usize);

/// Writes a transport shard by shard; the target is only touched when all is whole.
#[pyclass(frozen, module = "deltalux._core")]
struct TransportWriter(Mutex<Option<Writer>>);

/// The refusal of a writer that has published its transport or failed to.
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

    /// Refuses a path that no transport can be written to; writes nothing.
    #[staticmethod]
    fn check(py: Python<'_>, path: PathBuf) -> PyResult<()> {
        compute(py, || Writer::check(&path).map(drop))
    }

    /// Numbers of the shards of a part that need not be computed again, ascending.
    fn finished(&self, py: Python<'_>, part: &str) -> PyResult<Vec<usize>> {
        Ok(look_at(py, &self.0, |writer| writer.as_ref().map(|writer| writer.finished(part)))
            .ok_or_else(finished_error)?)
    }

    /// Writes the tiles of a shard of a part (tiles 4 number, 4 number + 1, ...); returns the bytes written.
    fn write_shard(&self, py: Python<'_>, part: &str, number: usize, tiles: Vec<Py<TileData>>) -> PyResult<u64> {
        let tiles: Vec<Tile> = tiles.iter().map(|tile| tile.get().0.clone()).collect();
        compute_on(py, &self.0, |writer| writer.as_mut().ok_or_else(finished_error)?.write_shard(part, number, &tiles))
    }

    /// Writes a shard of a run that another process has begun with this `job` text at this path; returns the bytes written.
    #[staticmethod]
    fn deliver(
        py: Python<'_>,
        path: PathBuf,
        job: String,
        part: String,
        number: usize,
        tiles: Vec<Py<TileData>>,
    ) -> PyResult<u64> {
        let tiles: Vec<Tile> = tiles.iter().map(|tile| tile.get().0.clone()).collect();
        compute(py, || Writer::deliver(&path, &job, &part, number, &tiles))
    }

    /// Takes in a shard that was delivered, after checking it.
    fn adopt(&self, py: Python<'_>, part: &str, number: usize) -> PyResult<()> {
        compute_on(py, &self.0, |writer| writer.as_mut().ok_or_else(finished_error)?.adopt(part, number))
    }

    /// Writes the receivers, the audit and the manifest, checks everything, and puts the result in its place.
    ///
    /// parts: (name, columns, rows, channels, quantum, width, tile_rows) in the order of the chain, of which `first` are the
    /// first stage; link: what leads on from it; audit: (groups (n,) uint32, one tile of 16 n rows in 16 bits); beside:
    /// for "scene", "nodes", "emission" and "lamps" arrays of float64, float32 or uint32 by their names.
    #[pyo3(signature = (*, parts, receivers, plan, scene, camera = None, first = 1, link = None, audit = None, beside = Vec::new()))]
    #[allow(clippy::too_many_arguments)]
    fn finish(
        &self,
        py: Python<'_>,
        parts: Vec<PartTuple>,
        receivers: &Bound<'_, ReceiverTable>,
        plan: String,
        scene: String,
        camera: Option<String>,
        first: usize,
        link: Option<&Link>,
        audit: Option<(PyReadonlyArray1<'_, u32>, Py<TileData>)>,
        beside: Vec<(String, Named<'_>)>,
    ) -> PyResult<()> {
        let part = |(name, columns, rows, channels, quantum, width, tile_rows): PartTuple| {
            Ok(Part {
                name,
                space: columns.parse()?,
                rows,
                channels: Channels::from_count(channels)?,
                quantum,
                width: width.parse()?,
                tile_rows,
            })
        };
        let beside = beside.into_iter().map(|(name, arrays)| beside_of(&name, arrays)).collect::<PyResult<Vec<_>>>()?;
        let about = Description {
            parts: parts.into_iter().map(part).collect::<Result<_>>()?,
            first,
            link: link.map_or(core::Link::None, |link| link.0.clone()),
            camera,
            plan,
            scene,
            beside,
        };
        let table = &receivers.get().0;
        let audit = audit.map(|(groups, tile)| Audit { groups: to_vec(&groups).into(), tile: tile.get().0.clone() });
        compute_on(py, &self.0, |writer| {
            // What cannot be right is refused before anything of the run is given up.
            table.check(about.receiving_rows()?).map_err(Error::Input)?;
            writer.take().ok_or_else(finished_error)?.finish(&about, table, audit.as_ref())
        })
    }
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<TransportWriter>()
}
