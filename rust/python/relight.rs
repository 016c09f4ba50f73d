//! Relighting for Python: one follower of the light over one transport.

use std::sync::{Arc, Mutex, PoisonError};

use numpy::ndarray::ArrayView2;
use numpy::{IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::error::Error;
use crate::update::{Initial, Updater as Core};

use super::light::table;
use super::transport::Transport;
use super::update::{SettingsItems, UpdateArrays, coefficients, update_arrays};
use super::{compute, compute_on, look_at};

/// An approximation and the response to it; see `deltalux.Relighter`.
#[pyclass(frozen, module = "deltalux._core")]
pub(crate) struct Updater {
    state: Mutex<Core>,
    rows: usize,
    spare: Spare,
}

/// Pictures that nobody looks at any more, for the next frames to write: no page of them is new.
#[derive(Clone, Default)]
struct Spare(Arc<Mutex<Vec<Vec<f32>>>>);

impl Spare {
    /// One is drawn while the next is made.
    const MOST: usize = 2;

    fn take(&self, length: usize) -> Vec<f32> {
        let spare = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        spare.unwrap_or_else(|| vec![0.0; length])
    }

    fn nbytes(&self) -> usize {
        let spare = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        spare.iter().map(|picture| size_of_val(&picture[..])).sum()
    }

    fn put(&self, picture: Vec<f32>) {
        let mut spare = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if spare.len() < Self::MOST {
            spare.push(picture);
        }
    }
}

/// The owner of a frame's array: once the array is gone, its memory is spare.
#[pyclass(frozen, module = "deltalux._core")]
struct Picture {
    values: Vec<f32>,
    spare: Spare,
}

impl Drop for Picture {
    fn drop(&mut self) {
        self.spare.put(std::mem::take(&mut self.values));
    }
}

impl Picture {
    /// The picture as an array of its own, (rows, 3).
    fn array<'py>(self, py: Python<'py>, rows: usize) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let owner = Bound::new(py, self)?;
        let view = ArrayView2::from_shape((rows, 3), &owner.get().values);
        let view = view.map_err(|error| Error::input(error.to_string()))?;
        // SAFETY: the owner lives as long as the array, and until then nothing else touches its values.
        Ok(unsafe { PyArray2::borrow_from_array(&view, owner.clone().into_any()) })
    }
}

/// B (rows, 3), the update, the bound in three colours, converged, seconds of choosing and of multiplying.
type Stepped<'py> = (Bound<'py, PyArray2<f32>>, UpdateArrays<'py>, [f64; 3], bool, f64, f64);

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
        Ok(Updater { state: Mutex::new(state), rows, spare: Spare::default() })
    }

    /// One frame towards `light`, (columns, 3) float64; `seconds`: the time for it, where that is the budget.
    fn step<'py>(
        &self,
        py: Python<'py>,
        light: PyReadonlyArray2<'py, f64>,
        seconds: Option<f64>,
    ) -> PyResult<Stepped<'py>> {
        let light = coefficients(&light)?;
        let mut picture = Picture { values: self.spare.take(3 * self.rows), spare: self.spare.clone() };
        let out = &mut picture.values;
        let step = compute_on(py, &self.state, |state| match seconds {
            Some(seconds) => state.step_within(light, out, seconds),
            None => state.step(light, out),
        })?;
        let values = picture.array(py, self.rows)?;
        let update = update_arrays(py, step.update)?;
        Ok((values, update, step.bound, step.converged, step.choosing, step.multiplying))
    }

    /// The bound of every receiver for the picture of the last step: (rows, 3) float32.
    fn bounds<'py>(&self, py: Python<'py>, shown: PyReadonlyArray2<'py, f32>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let shown: Vec<f32> = shown.as_array().iter().copied().collect();
        let rows = self.rows;
        let out = compute_on(py, &self.state, |state| {
            if shown.len() != 3 * rows {
                let found = shown.len();
                return Err(Error::input(format!("expected {rows} x 3 values, got {found}")));
            }
            let mut out = vec![0f32; 3 * rows];
            state.bounds(&shown, &mut out)?;
            Ok(out)
        })?;
        out.into_pyarray(py).reshape([rows, 3])
    }

    /// V as applied so far: (columns, 3) float64.
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let values = look_at(py, &self.state, |state| state.values().to_vec());
        table(py, values)
    }

    /// Bytes beyond M, with those of pictures that wait to be written again.
    #[getter]
    fn nbytes(&self, py: Python<'_>) -> usize {
        look_at(py, &self.state, |state| state.nbytes()) + self.spare.nbytes()
    }
}

pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Updater>()
}
