//! Choosing, from Python: `Approximation`, and the settings that every follower of V takes.

use std::sync::Mutex;

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::basis::{Bands, ColumnSpace};
use crate::error::{Error, Result};
use crate::update::{self, BandTest, Budget, Colours, Method, Norm, Settings};

use super::light::table;
use super::{compute_on, look_at};

/// The dictionary that `approximation.settings` makes; the dataclasses of `methods.py` have checked its words.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(super) struct SettingsItems<'py> {
    method: String,
    terms: Option<usize>,
    cost: Option<f64>,
    error: Option<f64>,
    factors: Vec<f64>,
    weights: PyReadonlyArray1<'py, f64>,
    costs: Option<PyReadonlyArray1<'py, f64>>,
    test: String,
    norm: String,
    fixed: usize,
    tolerance: f64,
    separate: bool,
}

impl SettingsItems<'_> {
    pub(super) fn settings(&self) -> Result<Settings> {
        let list = |array: &PyReadonlyArray1<f64>| array.as_array().to_vec();
        Ok(Settings {
            method: self.method()?,
            budget: match (self.terms, self.cost, self.error) {
                (Some(terms), None, None) => Budget::Terms(terms),
                (None, Some(cost), None) => Budget::Cost(cost),
                (None, None, Some(tolerance)) => Budget::Error { tolerance, factors: self.factors.clone() },
                _ => return Err(Error::input("expected one budget: in terms, in cost or in error")),
            },
            weights: list(&self.weights),
            costs: self.costs.as_ref().map(list).unwrap_or_default(),
            channels: if self.separate { Colours::Separate } else { Colours::Joint },
        })
    }

    fn method(&self) -> Result<Method> {
        Ok(match self.method.as_str() {
            "full" => Method::Full,
            "nonlinear" => Method::Nonlinear,
            "linear" => Method::Linear,
            "incremental" => Method::Incremental,
            "per-band" => Method::PerBand { test: self.test()?, norm: self.norm()? },
            "harmonic-order" => Method::HarmonicOrder { tolerance: self.tolerance },
            other => return Err(Error::input(format!("unknown update method {other:?}"))),
        })
    }

    fn test(&self) -> Result<BandTest> {
        match self.test.as_str() {
            "simple" => Ok(BandTest::Simple),
            "dealer" => Ok(BandTest::Dealer),
            "exhaustive" => Ok(BandTest::Exhaustive),
            "fixed" => Ok(BandTest::Fixed { incremental: self.fixed }),
            other => Err(Error::input(format!("unknown band test {other:?}"))),
        }
    }

    fn norm(&self) -> Result<Norm> {
        match self.norm.as_str() {
            "l1" => Ok(Norm::L1),
            "l2" => Ok(Norm::L2),
            other => Err(Error::input(format!("unknown norm {other:?}"))),
        }
    }
}

/// The rows of a (columns, 3) array in C order.
pub(super) fn coefficients<'a>(array: &'a PyReadonlyArray2<f64>) -> Result<&'a [[f64; 3]]> {
    match array.as_slice() {
        Ok(flat) if array.shape()[1] == 3 => Ok(bytemuck::cast_slice(flat)),
        _ => Err(Error::input(format!(
            "expected coefficients of shape (columns, 3) in C order, got shape {:?}",
            array.shape()
        ))),
    }
}

/// Columns, changes (m, 3) and resets of an update.
pub(super) type UpdateArrays<'py> = (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray2<f64>>, Vec<usize>);

pub(super) fn update_arrays<'py>(py: Python<'py>, update: update::Update) -> PyResult<UpdateArrays<'py>> {
    let columns = PyArray1::from_iter(py, update.terms.iter().map(|term| term.column));
    let changes: Vec<f64> = update.terms.iter().flat_map(|term| term.change).collect();
    let changes = PyArray1::from_vec(py, changes).reshape([update.terms.len(), 3])?;
    Ok((columns, changes, update.resets))
}

/// A copy of V that follows it within a budget (`update/approximation.rs`).
#[pyclass(frozen, module = "deltalux._core")]
struct Approximation {
    state: Mutex<update::Approximation>,
}

#[pymethods]
impl Approximation {
    /// `starts`: the first column of every band, then the number of columns; `areas`: one a column.
    #[new]
    fn new(starts: Vec<usize>, areas: Vec<f64>, settings: SettingsItems) -> PyResult<Self> {
        let state = update::Approximation::new(Bands { starts, areas }, settings.settings()?)?;
        Ok(Approximation { state: Mutex::new(state) })
    }

    /// The number of columns.
    fn __len__(&self, py: Python<'_>) -> usize {
        look_at(py, &self.state, |state| state.bands().columns())
    }

    fn step<'py>(&self, py: Python<'py>, target: PyReadonlyArray2<'py, f64>) -> PyResult<UpdateArrays<'py>> {
        let target = coefficients(&target)?;
        let update = compute_on(py, &self.state, |state| state.step(target))?;
        update_arrays(py, update)
    }

    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        table(py, look_at(py, &self.state, |state| state.values().to_vec()))
    }

    fn set_values(&self, py: Python<'_>, values: PyReadonlyArray2<f64>) -> PyResult<()> {
        let values = coefficients(&values)?;
        compute_on(py, &self.state, |state| state.set_values(values))
    }

    fn is_converged(&self, py: Python<'_>, target: PyReadonlyArray2<f64>) -> PyResult<bool> {
        let target = coefficients(&target)?;
        Ok(look_at(py, &self.state, |state| state.is_converged(target)))
    }
}

/// First column of every band and the number of columns, and the area of every column, of columns like "haar:64".
#[pyfunction]
fn column_bands<'py>(py: Python<'py>, columns: &str) -> PyResult<(Vec<usize>, Bound<'py, PyArray1<f64>>)> {
    let bands = columns.parse::<ColumnSpace>()?.bands();
    Ok((bands.starts, PyArray1::from_vec(py, bands.areas)))
}

pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Approximation>()?;
    module.add_function(wrap_pyfunction!(column_bands, module)?)?;
    Ok(())
}
