//! Choosing, from Python: methods and settings, and an `Approximation` that needs no matrix.

use std::sync::Mutex;

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::basis::{Bands, ColumnSpace};
use crate::error::Error;
use crate::update::{self, BandTest, Budget, Colours, Norm, Settings as Core};

use super::arrays::{coefficients, table, to_vec};
use super::{compute_on, look_at};

/// How the columns of a frame are chosen: what the dataclasses of `deltalux.update.methods` stand for.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct Method(update::Method);

#[pymethods]
impl Method {
    /// Every column that differs.
    #[staticmethod]
    fn full() -> Self {
        Method(update::Method::Full)
    }

    /// The largest terms of the light, from black.
    #[staticmethod]
    fn nonlinear() -> Self {
        Method(update::Method::Nonlinear)
    }

    /// The first columns of the light, from black.
    #[staticmethod]
    fn linear() -> Self {
        Method(update::Method::Linear)
    }

    /// The largest changes.
    #[staticmethod]
    fn incremental() -> Self {
        Method(update::Method::Incremental)
    }

    /// Each band reset or not, as a test decides: "simple", "dealer", "exhaustive", or "fixed" with so many coarse bands
    /// that never are; the norm is "l1" or "l2".
    #[staticmethod]
    #[pyo3(signature = (*, test, norm, fixed))]
    fn per_band(test: &str, norm: &str, fixed: Option<usize>) -> PyResult<Self> {
        let test = match (test, fixed) {
            ("simple", None) => BandTest::Simple,
            ("dealer", None) => BandTest::Dealer,
            ("exhaustive", None) => BandTest::Exhaustive,
            ("fixed", Some(incremental)) => BandTest::Fixed { incremental },
            _ => return Err(Error::input(format!("unknown band test {test:?} with fixed={fixed:?}")).into()),
        };
        let norm = match norm {
            "l1" => Norm::L1,
            "l2" => Norm::L2,
            other => return Err(Error::input(format!("unknown norm {other:?}")).into()),
        };
        Ok(Method(update::Method::PerBand { test, norm }))
    }

    /// Low bands first, each to a tolerance.
    #[staticmethod]
    #[pyo3(signature = (*, tolerance))]
    fn harmonic_order(tolerance: f64) -> Self {
        Method(update::Method::HarmonicOrder { tolerance })
    }
}

/// All that choosing is told of one stage.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct Settings(pub(super) Core);

#[pymethods]
impl Settings {
    /// Exactly one budget is given: `terms`, `cost` in the unit of `costs`, or `error` with one of `factors` a band.
    /// weights, costs (columns,), factors (bands,) float64. `separate`: a term changes one colour of a column.
    #[new]
    #[pyo3(signature = (method, *, weights, terms = None, cost = None, error = None, factors = None, costs = None, separate = false))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        method: &Method,
        weights: PyReadonlyArray1<'_, f64>,
        terms: Option<usize>,
        cost: Option<f64>,
        error: Option<f64>,
        factors: Option<PyReadonlyArray1<'_, f64>>,
        costs: Option<PyReadonlyArray1<'_, f64>>,
        separate: bool,
    ) -> PyResult<Self> {
        let list = |array: Option<&PyReadonlyArray1<'_, f64>>| array.map(to_vec).unwrap_or_default();
        let budget = match (terms, cost, error) {
            (Some(terms), None, None) => Budget::Terms(terms),
            (None, Some(cost), None) => Budget::Cost(cost),
            (None, None, Some(tolerance)) => Budget::Error { tolerance, factors: list(factors.as_ref()) },
            _ => return Err(Error::input("expected one budget: in terms, in cost or in error").into()),
        };
        Ok(Settings(Core {
            method: method.0,
            budget,
            weights: to_vec(&weights),
            costs: list(costs.as_ref()),
            colours: if separate { Colours::Separate } else { Colours::Joint },
        }))
    }
}

/// Columns, changes (m, 3) and resets of an update.
pub(super) type UpdateArrays<'py> = (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray2<f64>>, Vec<usize>);

/// An update as arrays for Python.
pub(super) fn update_arrays<'py>(py: Python<'py>, update: update::Update) -> PyResult<UpdateArrays<'py>> {
    let columns = PyArray1::from_iter(py, update.terms.iter().map(|term| term.column));
    let changes: Vec<f64> = update.terms.iter().flat_map(|term| term.change).collect();
    let changes = PyArray1::from_vec(py, changes).reshape([update.terms.len(), 3])?;
    Ok((columns, changes, update.resets))
}

/// Somebody else's choice: bands to reset, and columns in the order of their worth.
pub(super) type Given<'py> = (Vec<usize>, PyReadonlyArray1<'py, u32>);

/// A copy of V that follows it within a budget (`update/choosing/approximation.rs`).
#[pyclass(frozen, module = "deltalux._core")]
struct Approximation {
    /// The copy; one caller at a time.
    state: Mutex<update::Approximation>,
}

#[pymethods]
impl Approximation {
    /// `starts`: the first column of every band, then the number of columns; `areas`: one a column.
    #[new]
    fn new(starts: Vec<usize>, areas: Vec<f64>, settings: &Settings) -> PyResult<Self> {
        let bands = Bands { starts, areas, always: 0, texels: 0 };
        Ok(Approximation { state: Mutex::new(update::Approximation::new(bands, settings.0.clone())?) })
    }

    /// The number of columns.
    fn __len__(&self, py: Python<'_>) -> usize {
        look_at(py, &self.state, |state| state.bands().columns())
    }

    /// One step towards `target`; `given`: by a choice from outside, within the budget.
    #[pyo3(signature = (target, given = None))]
    fn step<'py>(
        &self,
        py: Python<'py>,
        target: PyReadonlyArray2<'py, f64>,
        given: Option<Given<'py>>,
    ) -> PyResult<UpdateArrays<'py>> {
        let target = coefficients(&target)?;
        let given = given.map(|(resets, columns)| (resets, to_vec(&columns)));
        let update = compute_on(py, &self.state, |state| match &given {
            None => state.step(&target),
            Some((resets, columns)) => state.step_given(&target, resets, columns),
        })?;
        update_arrays(py, update)
    }

    /// V~, what has been applied so far: (columns, 3) float64.
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        table(py, look_at(py, &self.state, |state| state.values().to_vec()))
    }

    /// Starts again from these values, (columns, 3) float64, bit for bit.
    fn set_values(&self, py: Python<'_>, values: PyReadonlyArray2<f64>) -> PyResult<()> {
        let values = coefficients(&values)?;
        compute_on(py, &self.state, |state| state.set_values(&values))
    }

    /// Whether the values are `target`, bit for bit.
    fn is_converged(&self, py: Python<'_>, target: PyReadonlyArray2<f64>) -> PyResult<bool> {
        let target = coefficients(&target)?;
        Ok(look_at(py, &self.state, |state| state.is_converged(&target)))
    }
}

/// First column of every band and the number of columns, and the area of every column, of columns like "haar:64".
#[pyfunction]
fn column_bands<'py>(py: Python<'py>, columns: &str) -> PyResult<(Vec<usize>, Bound<'py, PyArray1<f64>>)> {
    let bands = columns.parse::<ColumnSpace>()?.bands();
    Ok((bands.starts, PyArray1::from_vec(py, bands.areas)))
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Method>()?;
    module.add_class::<Settings>()?;
    module.add_class::<Approximation>()?;
    module.add_function(wrap_pyfunction!(column_bands, module)?)?;
    Ok(())
}
