//! Light between nodes at run time for Python: from one to the next by form factors, and to receivers by weights.

use std::sync::Arc;

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::error::{Error, Result};
use crate::precompute::links::Counts;
use crate::transport::Weights;

use super::arrays::{table, to_vec, triples};
use super::compute;

/// Starts of rows, and a node and a number each.
type Arrays = (Py<PyArray1<u32>>, Py<PyArray1<u32>>, Py<PyArray1<u16>>);

fn copied(py: Python<'_>, starts: &[u32], nodes: &[u32], numbers: &[u16]) -> Arrays {
    (
        PyArray1::from_slice(py, starts).unbind(),
        PyArray1::from_slice(py, nodes).unbind(),
        PyArray1::from_slice(py, numbers).unbind(),
    )
}

/// Weights by which receivers take from nodes, as their arrays have them.
pub(super) fn weights_of(
    starts: &PyReadonlyArray1<'_, u32>,
    nodes: &PyReadonlyArray1<'_, u32>,
    weights: &PyReadonlyArray1<'_, u16>,
    exponent: i32,
    node_count: usize,
) -> Result<Arc<Weights>> {
    let [starts, nodes] = [starts, nodes].map(|numbers| to_vec(numbers).into());
    Ok(Arc::new(Weights::new(starts, nodes, to_vec(weights).into(), exponent, node_count)?))
}

/// How light passes between nodes.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct NodeFactors(pub(super) Counts);

#[pymethods]
impl NodeFactors {
    /// From what `arrays` gave, and so many rays a node.
    #[new]
    fn of_arrays(
        starts: PyReadonlyArray1<'_, u32>,
        nodes: PyReadonlyArray1<'_, u32>,
        counts: PyReadonlyArray1<'_, u16>,
        rays: u32,
    ) -> PyResult<Self> {
        Ok(NodeFactors(Counts::new(to_vec(&starts), to_vec(&nodes), to_vec(&counts), rays)?))
    }

    /// starts (nodes + 1,) and nodes (n,) uint32, counts of rays (n,) uint16.
    fn arrays(&self, py: Python<'_>) -> Arrays {
        let Counts { starts, nodes, counts, .. } = &self.0;
        copied(py, starts, nodes, counts)
    }

    /// Rays of each node.
    #[getter]
    fn rays(&self) -> u32 {
        self.0.rays
    }

    /// How many nodes there are.
    fn __len__(&self) -> usize {
        self.0.rows()
    }

    /// What arrives at nodes of radiosity that leaves them, (nodes, 3) float64.
    fn passed<'py>(&self, py: Python<'py>, light: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let light = triples("light of nodes", &light)?;
        if light.len() != self.0.rows() {
            let (expected, got) = (self.0.rows(), light.len());
            return Err(Error::input(format!("expected the light of {expected} nodes, got that of {got}")).into());
        }
        table(py, compute(py, || Ok(self.0.passed(&light)))?)
    }
}

/// How receivers take from nodes: of irradiance at nodes below their number, and from it on of radiosity.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct NodeWeights(pub(super) Arc<Weights>);

#[pymethods]
impl NodeWeights {
    /// From what `arrays` gave, times 2^exponent.
    #[new]
    fn of_arrays(
        starts: PyReadonlyArray1<'_, u32>,
        nodes: PyReadonlyArray1<'_, u32>,
        weights: PyReadonlyArray1<'_, u16>,
        exponent: i32,
        node_count: usize,
    ) -> PyResult<Self> {
        Ok(NodeWeights(weights_of(&starts, &nodes, &weights, exponent, node_count)?))
    }

    /// starts (rows + 1,) and nodes (n,) uint32, weights (n,) uint16.
    fn arrays(&self, py: Python<'_>) -> Arrays {
        let (starts, nodes, weights) = self.0.arrays();
        copied(py, starts, nodes, weights)
    }

    /// What a unit of a weight is a power of two of.
    #[getter]
    fn exponent(&self) -> i32 {
        self.0.exponent()
    }

    /// How many rows there are.
    fn __len__(&self) -> usize {
        self.0.rows()
    }

    /// Bytes.
    #[getter]
    fn nbytes(&self) -> usize {
        self.0.nbytes()
    }

    /// What rows take of a light of nodes' rows, (2 nodes, 3) float64: (rows, 3).
    fn taken<'py>(&self, py: Python<'py>, light: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let light = triples("a light of nodes", &light)?;
        if self.0.node_count() > light.len() {
            return Err(Error::input(format!("expected a light for every node's rows, got {}", light.len())).into());
        }
        table(py, compute(py, || Ok(self.0.taken(&light)))?)
    }
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<NodeFactors>()?;
    module.add_class::<NodeWeights>()
}
