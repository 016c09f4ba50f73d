//! Between numpy and the core: arrays copied, checked and made.
//!
//! What computes without the interpreter's lock is never given memory of numpy: another thread may write there between a
//! check and what relies on it. The one copy is what is checked, and what is used.

use bytemuck::cast_slice;
use numpy::ndarray::Array2;
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray4,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::error::{Error, Result};

/// The refusal of an array that is not in C order.
pub(super) fn not_contiguous() -> PyErr {
    Error::input("expected a C-contiguous array").into()
}

/// Numbers as colours: the last axis has length 3.
pub(super) fn colours(values: &[f32]) -> Result<Vec<[f32; 3]>> {
    match values.as_chunks::<3>() {
        (colours, []) => Error::unless_room::<[f32; 3]>(colours.len()).map(|()| colours.to_vec()),
        _ => Err(Error::input("expected an array whose last axis has length 3")),
    }
}

/// The texels of a (6, size, size, 3) array in C order.
pub(super) fn cubemap_colours(array: &PyReadonlyArray4<f32>, size: usize) -> Result<Vec<[f32; 3]>> {
    match array.as_slice() {
        Ok(flat) if array.shape() == [6, size, size, 3] => colours(flat),
        _ => {
            let found = array.shape();
            Err(Error::input(format!(
                "expected a cubemap of shape (6, {size}, {size}, 3) in C order, got shape {found:?}"
            )))
        }
    }
}

/// A copy of the rows of a (columns, 3) array in C order.
pub(super) fn coefficients(array: &PyReadonlyArray2<f64>) -> Result<Vec<[f64; 3]>> {
    triples("coefficients", array)
}

/// A copy of the rows of an (n, 3) array in C order; `name` is what an error calls it.
pub(super) fn triples(name: &str, array: &PyReadonlyArray2<f64>) -> Result<Vec<[f64; 3]>> {
    match array.as_slice() {
        Ok(flat) if array.shape()[1] == 3 => {
            Error::unless_room::<f64>(flat.len())?;
            Ok(cast_slice(flat).to_vec())
        }
        _ => Err(Error::input(format!("expected {name} of shape (n, 3) in C order, got shape {:?}", array.shape()))),
    }
}

/// Rows of equal length, one after the other, as an array.
pub(super) fn rows<T: numpy::Element>(
    py: Python<'_>,
    shape: (usize, usize),
    values: Vec<T>,
) -> PyResult<Bound<'_, PyArray2<T>>> {
    let array = Array2::from_shape_vec(shape, values);
    Ok(array.map_err(|error| Error::input(error.to_string()))?.into_pyarray(py))
}

/// Coefficients as a (columns, 3) array, without a copy.
pub(super) fn table<'py>(py: Python<'py>, colours: Vec<[f64; 3]>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    rows(py, (colours.len(), 3), colours.into_flattened())
}

/// A copy of rows of N numbers as an (n, N) array.
pub(super) fn rows_of<T: numpy::Element + Copy, const N: usize>(
    py: Python<'_>,
    items: &[[T; N]],
) -> PyResult<Py<PyArray2<T>>> {
    Ok(PyArray1::from_slice(py, items.as_flattened()).reshape([items.len(), N])?.unbind())
}

/// A copy of an (n, N) array, in any order of memory; `name` is what an error calls it.
pub(super) fn vectors<T: numpy::Element + Copy, const N: usize>(
    name: &str,
    array: &PyReadonlyArray2<'_, T>,
) -> Result<Vec<[T; N]>> {
    let array = array.as_array();
    if array.ncols() != N {
        return Err(Error::input(format!("expected {name} of shape (n, {N}), got {:?}", array.shape())));
    }
    Error::unless_room::<[T; N]>(array.nrows())?;
    Ok(array.rows().into_iter().map(|row| std::array::from_fn(|k| row[k])).collect())
}

/// A copy of an array of one dimension.
pub(super) fn to_vec<T: numpy::Element + Copy>(array: &PyReadonlyArray1<'_, T>) -> Vec<T> {
    array.as_array().iter().copied().collect()
}

/// Weights of so many columns, how much there is expected to be in each: finite and above 0.
pub(super) fn column_weights(array: &PyReadonlyArray1<'_, f64>, columns: usize) -> Result<Vec<f64>> {
    let weights = to_vec(array);
    if weights.len() != columns || !weights.iter().all(|weight| weight.is_finite() && *weight > 0.0) {
        let found = weights.len();
        return Err(Error::input(format!("expected {columns} finite weights above 0, got {found}")));
    }
    Ok(weights)
}

/// A copy of a (rows, 3) array, row-major; `name` is what an error calls it.
pub(super) fn to_vec_of_rows(name: &str, array: &PyReadonlyArray2<'_, f32>, rows: usize) -> Result<Vec<f32>> {
    if array.shape() != [rows, 3] {
        return Err(Error::input(format!("expected {name} of shape ({rows}, 3), got {:?}", array.shape())));
    }
    Error::unless_room::<f32>(3 * rows)?;
    Ok(array.as_array().iter().copied().collect())
}
