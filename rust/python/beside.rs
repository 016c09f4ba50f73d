//! Arrays beside a transport, to and from numpy.

use numpy::{Element, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::Error;
use crate::transport::file::beside::{EMISSION, FILES, LAMPS, NODES, SCENE};
use crate::transport::{Array, Beside, Numbers, Slab};

/// The file that goes by a name.
fn file_of(name: &str) -> PyResult<&'static str> {
    let known = [("scene", SCENE), ("nodes", NODES), ("emission", EMISSION), ("lamps", LAMPS)];
    let found = known.into_iter().find(|(known, _)| *known == name);
    let refusal = || Error::input(format!("expected a name of what lies in {FILES:?}, got {name:?}"));
    Ok(found.ok_or_else(refusal)?.1)
}

/// Arrays by their names.
pub(super) type Named<'py> = Vec<(String, Bound<'py, PyAny>)>;

/// Arrays of float64, float32 or uint32, in the order of their names.
pub(super) fn beside_of(name: &str, arrays: Named<'_>) -> PyResult<Beside> {
    let array = |(name, array): (String, Bound<'_, PyAny>)| {
        let shape = array.getattr("shape")?.extract()?;
        let numbers = if let Some(items) = slab_of::<f64>(&array)? {
            Numbers::F64(items)
        } else if let Some(items) = slab_of::<f32>(&array)? {
            Numbers::F32(items)
        } else if let Some(items) = slab_of::<u32>(&array)? {
            Numbers::U32(items)
        } else {
            return Err(Error::input(format!("expected float64, float32 or uint32 for {name:?}")).into());
        };
        Ok(Array { name, shape, numbers })
    };
    let mut arrays = arrays.into_iter().map(array).collect::<PyResult<Vec<_>>>()?;
    arrays.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(Beside { file: file_of(name)?, arrays })
}

/// The items of an array in C order, if it is of this type.
fn slab_of<T: Element + Copy>(array: &Bound<'_, PyAny>) -> PyResult<Option<Slab<T>>> {
    let Ok(array) = array.extract::<PyReadonlyArrayDyn<'_, T>>() else { return Ok(None) };
    Ok(Some(array.as_array().iter().copied().collect::<Vec<T>>().into()))
}

/// The arrays of a file, copied, by their names.
pub(super) fn arrays_beside<'py>(py: Python<'py>, all: &[Beside], name: &str) -> PyResult<Option<Bound<'py, PyDict>>> {
    let file = file_of(name)?;
    let Some(found) = all.iter().find(|beside| beside.file == file) else { return Ok(None) };
    let arrays = PyDict::new(py);
    for Array { name, shape, numbers } in &found.arrays {
        match numbers {
            Numbers::F64(items) => arrays.set_item(name, shaped(py, items, shape)?)?,
            Numbers::F32(items) => arrays.set_item(name, shaped(py, items, shape)?)?,
            Numbers::U32(items) => arrays.set_item(name, shaped(py, items, shape)?)?,
        }
    }
    Ok(Some(arrays))
}

fn shaped<'py, T: Element + Copy>(
    py: Python<'py>,
    items: &[T],
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    PyArray1::from_slice(py, items).reshape(shape.to_vec())
}
