//! Bindings of `basis::spherical_harmonics` and of the projection on it.

use numpy::{PyArray2, PyReadonlyArray2, PyReadonlyArray4, PyUntypedArrayMethods};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::basis::spherical_harmonics::{Rotation, SphericalHarmonics, windowed};
use crate::basis::{ColumnSpace, HarmonicProjection};
use crate::error::{Error, Result};

use super::arrays::{coefficients, cubemap_colours, rows, table, triples};
use super::compute;
use super::light::Part;

/// The order whose coefficients these are.
fn order_of(coefficients: &[[f64; 3]]) -> Result<usize> {
    let order = coefficients.len().isqrt();
    if order * order != coefficients.len() {
        return Err(Error::input(format!("expected order² coefficients, got {}", coefficients.len())));
    }
    ColumnSpace::spherical_harmonics(order)?;
    Ok(order)
}

/// Coefficients of the sum of the parts: (order², 3) float64.
#[pyfunction]
fn harmonic_coefficients(py: Python<'_>, parts: Vec<Part>, order: usize) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let sum = compute(py, || {
        let mut sum = vec![[0.0; 3]; ColumnSpace::spherical_harmonics(order)?.columns()];
        for (weight, map, rotation) in &parts {
            map.get().map().project(order, rotation, *weight, &mut sum)?;
        }
        Ok(sum)
    })?;
    table(py, sum)
}

/// All functions of an order in unit directions (m, 3): (m, order²) float64.
#[pyfunction]
fn harmonic_values<'py>(
    py: Python<'py>,
    order: usize,
    directions: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let directions = triples("directions", &directions)?;
    let values = compute(py, || {
        let harmonics = SphericalHarmonics::new(order)?;
        Error::unless_room::<f64>(directions.len().saturating_mul(order * order))?;
        let mut values = vec![0.0; directions.len() * order * order];
        let each = values.par_chunks_exact_mut(order * order).zip(&directions);
        each.for_each(|(row, &direction)| harmonics.evaluate(direction, row));
        Ok(values)
    })?;
    rows(py, (directions.len(), order * order), values)
}

/// Coefficients of radiance (6, n, n, 3): (order², 3) float64.
#[pyfunction]
fn harmonic_projection<'py>(
    py: Python<'py>,
    order: usize,
    cubemap: PyReadonlyArray4<'py, f32>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let size = cubemap.shape()[1];
    let texels = cubemap_colours(&cubemap, size)?;
    table(py, compute(py, || Ok(HarmonicProjection::new(order, size)?.forward(&texels)))?)
}

/// Coefficients (order², 3) turned by an orthogonal matrix in rows.
#[pyfunction]
fn harmonic_rotation<'py>(
    py: Python<'py>,
    original: PyReadonlyArray2<'py, f64>,
    matrix: [[f64; 3]; 3],
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let original = coefficients(&original)?;
    table(py, compute(py, || Ok(Rotation::new(order_of(&original)?, &matrix)?.apply(&original)))?)
}

/// Coefficients (order², 3) under a Hanning window.
#[pyfunction]
fn harmonic_window<'py>(
    py: Python<'py>,
    original: PyReadonlyArray2<'py, f64>,
    width: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let original = coefficients(&original)?;
    table(py, compute(py, || windowed(&original, width))?)
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(harmonic_coefficients, module)?)?;
    module.add_function(wrap_pyfunction!(harmonic_values, module)?)?;
    module.add_function(wrap_pyfunction!(harmonic_projection, module)?)?;
    module.add_function(wrap_pyfunction!(harmonic_rotation, module)?)?;
    module.add_function(wrap_pyfunction!(harmonic_window, module)?)?;
    Ok(())
}
