//! Relighting for Python: one follower of the light over one transport.

use std::sync::{Arc, Mutex, PoisonError};

use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::error::Result;
use crate::update::{Budget, Initial, Updater as Core};

use super::compute;
use super::transport::Transport;
use super::update::{SettingsItems, UpdateArrays, coefficients, update_arrays};

/// An approximation and the response to it; see `deltalux.Relighter`.
#[pyclass(frozen, module = "deltalux._core")]
pub(crate) struct Updater {
    state: Mutex<Core>,
    rows: usize,
}

/// B (rows, 3), the update, the bound in three colours, converged, seconds of choosing and of multiplying.
type Stepped<'py> = (Bound<'py, PyArray2<f32>>, UpdateArrays<'py>, [f64; 3], bool, f64, f64);

impl Updater {
    fn with<T>(&self, work: impl FnOnce(&mut Core) -> T) -> T {
        // A step that panicked is reported as such; the lock itself holds no half-made state worth refusing.
        work(&mut self.state.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

#[pymethods]
impl Updater {
    /// `full`: the first step applies the whole light.
    #[new]
    fn new(py: Python<'_>, transport: &Bound<'_, Transport>, settings: SettingsItems, full: bool) -> PyResult<Self> {
        let matrix = transport.get().matrix.clone();
        let settings = settings.settings()?;
        let initial = if full { Initial::Full } else { Initial::Black };
        let rows = matrix.rows;
        let state = compute(py, || Core::new(Arc::clone(&matrix), settings, initial))?;
        Ok(Updater { state: Mutex::new(state), rows })
    }

    /// One frame towards `light`, (columns, 3) float64.
    fn step<'py>(&self, py: Python<'py>, light: PyReadonlyArray2<'py, f64>) -> PyResult<Stepped<'py>> {
        let light = coefficients(&light)?;
        let rows = self.rows;
        let (out, step) = compute(py, || {
            let mut out = vec![0f32; 3 * rows];
            let step = self.with(|state| state.step(light, &mut out))?;
            Ok((out, step))
        })?;
        let values = out.into_pyarray(py).reshape([rows, 3])?;
        let update = update_arrays(py, step.update)?;
        Ok((values, update, step.bound, step.converged, step.choosing, step.multiplying))
    }

    /// The bound of every receiver for the picture of the last step: (rows, 3) float32.
    fn bounds<'py>(&self, py: Python<'py>, shown: PyReadonlyArray2<'py, f32>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let shown: Vec<f32> = shown.as_array().iter().copied().collect();
        let rows = self.rows;
        let out = compute(py, || -> Result<Vec<f32>> {
            if shown.len() != 3 * rows {
                let found = shown.len();
                return Err(crate::error::Error::input(format!("expected {rows} x 3 values, got {found}")));
            }
            let mut out = vec![0f32; 3 * rows];
            self.with(|state| state.bounds(&shown, &mut out))?;
            Ok(out)
        })?;
        out.into_pyarray(py).reshape([rows, 3])
    }

    /// V as applied so far: (columns, 3) float64.
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.with(|state| PyArray1::from_slice(py, state.values().as_flattened()).reshape([state.values().len(), 3]))
    }

    /// Sets the budget of later frames, in the unit of the columns' costs.
    fn set_cost(&self, cost: f64) -> PyResult<()> {
        Ok(self.with(|state| state.set_budget(Budget::Cost(cost)))?)
    }

    /// Bytes beyond M.
    #[getter]
    fn nbytes(&self) -> usize {
        self.with(|state| state.nbytes())
    }
}

pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Updater>()
}
