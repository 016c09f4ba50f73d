//! What transports are made of, passed through Python unseen: tiles and links; and the numbers of the format.

use std::sync::Arc;

use numpy::{PyReadonlyArray1, PyReadonlyArray3};
use pyo3::prelude::*;

use crate::basis::HaarTree;
use crate::transport::entry::entry_bytes;
use crate::transport::file::manifest::TILES_PER_SHARD;
use crate::transport::{self as core, Channels, GROUP, RowNorms, Tile, bf16_up};

use super::arrays::to_vec;
use super::passing::weights_of;

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

/// What leads from the first stage of a product to the second, or to the receivers.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct Link(pub(super) core::Link);

#[pymethods]
impl Link {
    /// Receivers take from nodes: starts (rows + 1,) and nodes (n,) uint32, weights (n,) uint16 times 2^exponent. The
    /// highest bit of a node's number is the sign of its weight.
    #[staticmethod]
    #[pyo3(signature = (starts, nodes, weights, *, exponent, node_count))]
    fn weights(
        starts: PyReadonlyArray1<'_, u32>,
        nodes: PyReadonlyArray1<'_, u32>,
        weights: PyReadonlyArray1<'_, u16>,
        exponent: i32,
        node_count: usize,
    ) -> PyResult<Self> {
        Ok(Link(core::Link::Weights(weights_of(&starts, &nodes, &weights, exponent, node_count)?)))
    }

    /// Haar wavelets over a tree of samples with these areas, (samples,) float64.
    #[staticmethod]
    fn tree(areas: PyReadonlyArray1<'_, f64>) -> PyResult<Self> {
        Ok(Link(core::Link::Tree(Arc::new(HaarTree::new(to_vec(&areas))?))))
    }

    /// Rows of each first matrix are the columns of its second. Of each pair the norms of the rows that both stand for, and of
    /// what those are off: (rows, bands, channels) float64 each.
    #[staticmethod]
    fn representatives(norms: Vec<(PyReadonlyArray3<'_, f64>, PyReadonlyArray3<'_, f64>)>) -> PyResult<Self> {
        let bits = |norms: &PyReadonlyArray3<'_, f64>| -> Vec<u16> {
            norms.as_array().iter().map(|&norm| bf16_up(norm)).collect()
        };
        let pair = |(kept, dropped): &(PyReadonlyArray3<'_, f64>, PyReadonlyArray3<'_, f64>)| {
            let shape = kept.as_array().dim();
            RowNorms::new(shape.1, Channels::from_count(shape.2)?, bits(kept).into(), bits(dropped).into())
        };
        let norms = norms.iter().map(pair).collect::<crate::error::Result<Vec<_>>>()?;
        Ok(Link(core::Link::Representatives(norms.into())))
    }
}

/// Bytes of an entry with integers "i8" or "i16" in one or three channels.
#[pyfunction(name = "entry_bytes")]
fn entry_bytes_of(width: &str, channels: usize) -> PyResult<usize> {
    Ok(entry_bytes(width.parse()?, Channels::from_count(channels)?))
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<TileData>()?;
    module.add_class::<Link>()?;
    module.add_function(wrap_pyfunction!(entry_bytes_of, module)?)?;
    // Numbers of the format, for those who plan: rows of a group, and tiles of a file.
    module.add("GROUP", GROUP)?;
    module.add("TILES_PER_SHARD", TILES_PER_SHARD)?;
    Ok(())
}
