//! Relighting for Python: one follower of the light over one transport.

use std::sync::{Arc, Mutex, PoisonError};

use numpy::ndarray::ArrayView2;
use numpy::{IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::error::Error;
use crate::update::{Chosen, Initial, Step, Updater as Core};

use super::arrays::{coefficients, table, to_vec};
use super::transport::{Transport, mix_of};
use super::update::{Given, Settings, UpdateArrays, update_arrays};
use super::{compute, compute_on, look_at};

/// An approximation and the response to it; see `deltalux.Relighter`.
#[pyclass(frozen, module = "deltalux._core")]
pub(crate) struct Updater {
    /// The follower; one caller at a time.
    state: Mutex<Core>,
    /// Receivers.
    rows: usize,
    /// Pictures to write into.
    spare: Spare,
}

/// Pictures that nobody looks at any more, for the next frames to write: no page of them is new.
#[derive(Clone, Default)]
struct Spare(Arc<Mutex<Vec<Vec<f32>>>>);

impl Spare {
    /// One is drawn while the next is made.
    const MOST: usize = 2;

    /// A picture of so many numbers, whose content is to be written over.
    fn take(&self, length: usize) -> Vec<f32> {
        let spare = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        spare.unwrap_or_else(|| vec![0.0; length])
    }

    /// Bytes that wait.
    fn nbytes(&self) -> usize {
        let spare = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        spare.iter().map(|picture| size_of_val(&picture[..])).sum()
    }

    /// Takes a picture back, unless enough wait already.
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
    /// B, rows x 3.
    values: Vec<f32>,
    /// Where it goes afterwards.
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

/// B (rows, 3), the update, the frame's number; the bound in three colours, what of it is truncation, and what remains of
/// the light in each band; converged, seconds of choosing and of multiplying.
type Stepped<'py> =
    (Bound<'py, PyArray2<f32>>, UpdateArrays<'py>, u64, ([f64; 3], [f64; 3], Vec<[f64; 3]>), bool, f64, f64);

impl Updater {
    /// A picture to be written, with its way back.
    fn picture(&self) -> Picture {
        Picture { values: self.spare.take(3 * self.rows), spare: self.spare.clone() }
    }

    /// A frame as Python takes it.
    fn stepped<'py>(&self, py: Python<'py>, picture: Picture, step: Step) -> PyResult<Stepped<'py>> {
        let values = picture.array(py, self.rows)?;
        let update = update_arrays(py, step.update)?;
        let bound = (step.bound, step.truncation, step.remaining);
        Ok((values, update, step.number, bound, step.converged, step.choosing, step.multiplying))
    }
}

#[pymethods]
impl Updater {
    /// `second`: how the second stage is followed, where there is one. `initial`: what the first step applies, "full",
    /// "nonlinear" or None; `mix`: how several factors are mixed, (rows, factors) float32; `steady`: whether no light that came
    /// before leaves a trace.
    #[new]
    #[pyo3(signature = (transport, first, second, *, mix, initial, steady))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        transport: &Bound<'_, Transport>,
        first: &Settings,
        second: Option<&Settings>,
        mix: Option<PyReadonlyArray2<'_, f32>>,
        initial: Option<&str>,
        steady: bool,
    ) -> PyResult<Self> {
        let chain = Arc::clone(&transport.get().chain);
        let rows = chain.product.rows();
        let (first, second) = (first.0.clone(), second.map(|settings| settings.0.clone()));
        let initial = match initial {
            Some("full") => Initial::Full,
            Some("nonlinear") => Initial::Nonlinear,
            None => Initial::Black,
            Some(other) => return Err(Error::input(format!("unknown start {other:?}")).into()),
        };
        let mix = mix.map(|mix| mix_of(&mix)).transpose()?;
        // Exact sums of all parts, a picture, and as much again for a second stage and the grids.
        let all: usize = chain.product.first.iter().map(|part| part.rows).sum();
        Error::unless_room::<[f64; 6]>(all + rows)?;
        let state = compute(py, || {
            let state = Core::new(chain, first, second, mix, initial)?;
            Ok(if steady { state.steady() } else { state })
        })?;
        Ok(Updater { state: Mutex::new(state), rows, spare: Spare::default() })
    }

    /// V~, (columns, 3) float64, from which somebody else may choose what is sent towards `light`; None where it is settled
    /// what the first frame takes.
    fn prepare<'py>(
        &self,
        py: Python<'py>,
        light: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let light = coefficients(&light)?;
        let values = compute_on(py, &self.state, |state| Ok(state.prepare(&light)?.map(<[_]>::to_vec)))?;
        values.map(|values| table(py, values)).transpose()
    }

    /// One frame towards `light`, (columns, 3) float64; `seconds`: the time for it, where that is the budget; `given`: by a
    /// choice from outside, within the budget.
    #[pyo3(signature = (light, seconds, given = None))]
    fn step<'py>(
        &self,
        py: Python<'py>,
        light: PyReadonlyArray2<'py, f64>,
        seconds: Option<f64>,
        given: Option<Given<'py>>,
    ) -> PyResult<Stepped<'py>> {
        let light = coefficients(&light)?;
        let given = given.map(|(resets, columns)| (resets, to_vec(&columns)));
        let chosen = match &given {
            None => Chosen::Own,
            Some((resets, columns)) => Chosen::Given { resets, columns },
        };
        let mut picture = self.picture();
        let out = &mut picture.values;
        let step = compute_on(py, &self.state, |state| state.frame(&light, out, seconds, &chosen))?;
        self.stepped(py, picture, step)
    }

    /// The last frame with several factors mixed by other weights, (rows, factors) float32, as they are from now on.
    fn remix<'py>(&self, py: Python<'py>, weights: PyReadonlyArray2<'_, f32>) -> PyResult<Stepped<'py>> {
        let mix = mix_of(&weights)?;
        let mut picture = self.picture();
        let out = &mut picture.values;
        let step = compute_on(py, &self.state, |state| state.remix(mix, out))?;
        self.stepped(py, picture, step)
    }

    /// The bound of every receiver for `shown`, the picture of the last frame, whose number this is: (rows, 3) float32.
    fn bounds<'py>(
        &self,
        py: Python<'py>,
        number: u64,
        shown: PyReadonlyArray2<'py, f32>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let shown: Vec<f32> = shown.as_array().iter().copied().collect();
        let rows = self.rows;
        let out = compute_on(py, &self.state, |state| {
            let mut out = vec![0f32; 3 * rows];
            state.bounds(number, &shown, &mut out)?;
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

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Updater>()
}
