//! Clustered transport for Python: made from a stored transport, and looked at.

use std::sync::Arc;

use numpy::PyArray1;
use pyo3::prelude::*;

use crate::transport::clustering::STEPS;
use crate::transport::{self as core, Clustering, TransportMatrix};

use super::interruptible;
use super::pieces::Link;
use super::transport::Transport;

/// Two stages that stand for the rows of a transport.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct Clusters {
    order: Vec<u32>,
    labels: Vec<u32>,
    first: Arc<TransportMatrix>,
    then: Arc<TransportMatrix>,
    link: core::Link,
    error: [f64; 2],
}

#[pymethods]
impl Clusters {
    /// Clusters the rows of a transport of one matrix: at most `clusters`, each with a mean and so many representatives, which
    /// are truncated to `tolerance`.
    #[new]
    #[pyo3(signature = (transport, *, clusters, representatives, tolerance, progress = None))]
    fn new(
        py: Python<'_>,
        transport: &Bound<'_, Transport>,
        clusters: usize,
        representatives: usize,
        tolerance: f64,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let matrix = Arc::clone(transport.get().alone()?);
        let asked = Clustering { clusters, representatives, tolerance };
        let made = interruptible(py, progress, |watch| core::cluster(&matrix, asked, &|rows| watch.advance(rows)))?;
        Ok(Clusters {
            order: made.order,
            labels: made.labels,
            first: made.first.into(),
            then: made.then.into(),
            link: core::Link::Representatives([made.norms].into()),
            error: made.error,
        })
    }

    /// How often progress counts each row.
    #[classattr]
    const STEPS: usize = STEPS;

    /// The number of the source's row that each row is, (rows,) uint32.
    #[getter]
    fn order(&self, py: Python<'_>) -> Py<PyArray1<u32>> {
        PyArray1::from_slice(py, &self.order).unbind()
    }

    /// The cluster of each row, (rows,) uint32, ascending.
    #[getter]
    fn labels(&self, py: Python<'_>) -> Py<PyArray1<u32>> {
        PyArray1::from_slice(py, &self.labels).unbind()
    }

    /// The first stage: means and representatives.
    #[getter]
    fn representatives(&self, py: Python<'_>) -> PyResult<Transport> {
        Transport::of(py, Arc::clone(&self.first))
    }

    /// The second stage.
    #[getter]
    fn weights(&self, py: Python<'_>) -> PyResult<Transport> {
        Transport::of(py, Arc::clone(&self.then))
    }

    /// What links them.
    #[getter]
    fn link(&self) -> Link {
        Link(self.link.clone())
    }

    /// Relative L2 error of the picture expected under the light prior: of the subspaces alone, and of all, against the source.
    #[getter]
    fn error(&self) -> (f64, f64) {
        self.error.into()
    }
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Clusters>()
}
