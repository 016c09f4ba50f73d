//! Bindings of `brdf::family`: a model over the range of its parameter.

use std::sync::Arc;

use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::brdf::family::{Edited, Errors, Family as Core, MODELS};
use crate::error::{Error, Result};

use super::arrays::rows;
use super::compute;

/// A family; see `deltalux.Family`.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct Family(pub(super) Arc<Core>);

/// Peak, energy and root of the mean square.
type Three = (f64, f64, f64);

fn three(errors: Errors) -> Three {
    (errors.peak, errors.energy, errors.rms)
}

/// 1 - cos delta of angles in radians, from 0 to pi / 2.
fn falls(delta: &PyReadonlyArray1<'_, f64>) -> Result<Vec<f64>> {
    let fall = |&delta: &f64| match (0.0..=std::f64::consts::FRAC_PI_2).contains(&delta) {
        true => Ok(2.0 * (0.5 * delta).sin().powi(2)),
        false => Err(Error::input(format!("expected delta from 0 to pi / 2, got {delta}"))),
    };
    delta.as_array().iter().map(fall).collect()
}

#[pymethods]
impl Family {
    /// The fewest live functions, and then the fewest segments, that reach an error; `f0`: of facets.
    #[staticmethod]
    fn within(py: Python<'_>, model: &str, range: [f64; 2], error: f64, f0: f64) -> PyResult<Family> {
        let edited = Edited::named(model, false)?.with_facets(f0)?;
        compute(py, || Core::within(edited, range, error)).map(|family| Family(Arc::new(family)))
    }

    /// As many of both as are asked for.
    #[staticmethod]
    fn segmented(
        py: Python<'_>,
        model: &str,
        range: [f64; 2],
        live: usize,
        segments: usize,
        f0: f64,
    ) -> PyResult<Family> {
        let edited = Edited::named(model, false)?.with_facets(f0)?;
        compute(py, || Core::segmented(edited, range, live, segments)).map(|family| Family(Arc::new(family)))
    }

    /// The paper's single basis.
    #[staticmethod]
    fn even(py: Python<'_>, model: &str, range: [f64; 2], live: usize, printed: bool) -> PyResult<Family> {
        let edited = Edited::named(model, printed)?;
        compute(py, || Core::even(edited, range, live)).map(|family| Family(Arc::new(family)))
    }

    /// Functions of a segment.
    #[getter]
    fn live(&self) -> usize {
        self.0.live()
    }

    /// The parameters between segments, with both ends of the range.
    #[getter]
    fn borders(&self) -> Vec<f64> {
        self.0.borders()
    }

    /// The worst errors of parameters held out.
    fn errors(&self, py: Python<'_>) -> PyResult<Three> {
        compute(py, || Ok(three(self.0.errors())))
    }

    /// The errors of each parameter.
    fn errors_at(&self, py: Python<'_>, gammas: Vec<f64>) -> PyResult<Vec<Three>> {
        compute(py, || gammas.par_iter().map(|&gamma| self.0.errors_at(gamma).map(three)).collect())
    }

    /// The segment of a parameter.
    fn segment(&self, gamma: f64) -> PyResult<usize> {
        Ok(self.0.segment(gamma)?)
    }

    /// c of a parameter: (live,) float64.
    fn coefficients<'py>(&self, py: Python<'py>, gamma: f64) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(compute(py, || self.0.coefficients(gamma))?.into_pyarray(py))
    }

    /// The functions of a parameter's segment at angles (n,): (n, live) float64.
    fn basis<'py>(
        &self,
        py: Python<'py>,
        gamma: f64,
        delta: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (segment, falls) = (self.0.segment(gamma)?, falls(&delta)?);
        let values = compute(py, || Ok(falls.iter().flat_map(|&fall| self.0.basis(segment, fall)).collect()))?;
        rows(py, (falls.len(), self.0.live()), values)
    }

    /// f_E as the basis gives it at angles (n,): (n,) float64.
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        gamma: f64,
        delta: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let falls = falls(&delta)?;
        Ok(compute(py, || self.0.evaluate(gamma, &falls))?.into_pyarray(py))
    }

    /// f_E itself at angles (n,): (n,) float64.
    fn exact<'py>(
        &self,
        py: Python<'py>,
        gamma: f64,
        delta: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let falls = falls(&delta)?;
        let values = compute(py, || {
            self.0.segment(gamma)?;
            Ok(falls.iter().map(|&fall| self.0.edited().value(gamma, fall)).collect::<Vec<_>>())
        })?;
        Ok(values.into_pyarray(py))
    }
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("FAMILIES", MODELS.map(|(name, _)| name))?;
    module.add_class::<Family>()
}
