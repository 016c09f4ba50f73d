//! Bindings of `basis::haar` and `light`. Shapes, dtypes and values are checked by `deltalux.light.environment` beforehand.

use numpy::ndarray::{Array3, Array4};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArray4, PyArrayDyn, PyArrayMethods, PyReadonlyArray2,
    PyReadonlyArray3, PyReadonlyArray4, PyReadwriteArray3, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::basis::haar::Haar;
use crate::error::{Error, Result};
use crate::light::{Behind, EnvironmentMap, Layout, Rows, radiance};

use super::arrays::{colours, cubemap_colours, not_contiguous, rows, table, triples};
use super::compute;

/// The largest cubemap face that is resampled to: 150 MB of radiance.
const MAX_SIZE: usize = 2048;

/// One map of an environment: its weight in each colour, the map, and the rotation of its light as an orthogonal matrix in rows.
pub(super) type Part = ([f64; 3], Py<PyEnvironmentMap>, [[f64; 3]; 3]);

/// A map of distant radiance; see `deltalux.Environment`.
#[pyclass(frozen, name = "EnvironmentMap", module = "deltalux._core")]
pub(super) struct PyEnvironmentMap(EnvironmentMap);

impl PyEnvironmentMap {
    /// The map itself.
    pub(super) fn map(&self) -> &EnvironmentMap {
        &self.0
    }
}

#[pymethods]
impl PyEnvironmentMap {
    /// A lat-long image, (h, w, 3) float32; with `edge` its outermost rows are the poles.
    #[staticmethod]
    fn from_latlong(py: Python<'_>, pixels: PyReadonlyArray3<'_, f32>, edge: bool) -> PyResult<Self> {
        let shape = pixels.as_array().shape().to_vec();
        let rows = if edge { Rows::Edge } else { Rows::Centre };
        let layout = Layout::LatLong { height: shape[0], width: shape[1], rows };
        let colours = colours(pixels.as_slice().map_err(|_| not_contiguous())?)?;
        compute(py, || EnvironmentMap::new(layout, colours)).map(PyEnvironmentMap)
    }

    /// Six faces, (6, n, n, 3) float32.
    #[staticmethod]
    fn from_cubemap(py: Python<'_>, pixels: PyReadonlyArray4<'_, f32>) -> PyResult<Self> {
        let layout = Layout::Cubemap { size: pixels.as_array().shape()[1] };
        let colours = colours(pixels.as_slice().map_err(|_| not_contiguous())?)?;
        compute(py, || EnvironmentMap::new(layout, colours)).map(PyEnvironmentMap)
    }

    /// The pixels as they were given, and whether the outermost rows are the poles: what `from_latlong` and `from_cubemap`
    /// made it of.
    fn pixels<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyArrayDyn<f32>>, bool)> {
        let (layout, pixels) = self.0.source();
        let (shape, edge) = match layout {
            Layout::LatLong { width, height, rows } => (vec![height, width, 3], rows == Rows::Edge),
            Layout::Cubemap { size } => (vec![6, size, size, 3], false),
        };
        Ok((PyArray1::from_slice(py, pixels.as_flattened()).reshape(shape)?, edge))
    }

    /// Bytes held, with what was prepared for the sizes asked for so far.
    #[getter]
    fn nbytes(&self) -> usize {
        self.0.bytes()
    }
}

/// Bytes that a texel takes while a map is prepared for a size: measured are 134.
const TEXEL: usize = 144;

/// The sum of the parts on a cubemap.
fn resampled(parts: &[Part], size: usize) -> Result<Vec<[f32; 3]>> {
    if !(1..=MAX_SIZE).contains(&size) {
        return Err(Error::input(format!("expected a cubemap face of 1 to {MAX_SIZE} texels, got {size}")));
    }
    Error::unless_room::<[u8; TEXEL]>(6 * size * size)?;
    let mut radiance = vec![[0.0; 3]; 6 * size * size];
    for (weight, map, rotation) in parts {
        map.get().0.resample(size, rotation, *weight, &mut radiance);
    }
    Ok(radiance)
}

/// Texels as an array (6, size, size, 3).
fn cubemap<'py, T: numpy::Element>(py: Python<'py>, size: usize, texels: Vec<T>) -> PyResult<Bound<'py, PyArray4<T>>> {
    let array = Array4::from_shape_vec((6, size, size, 3), texels);
    Ok(array.map_err(|error| Error::input(error.to_string()))?.into_pyarray(py))
}

/// Radiance of the sum of the parts: (6, size, size, 3) float32.
#[pyfunction]
fn environment_cubemap(py: Python<'_>, parts: Vec<Part>, size: usize) -> PyResult<Bound<'_, PyArray4<f32>>> {
    let radiance = compute(py, || resampled(&parts, size))?;
    cubemap(py, size, radiance.into_flattened())
}

/// Haar coefficients of the sum of the parts: (6 size^2, 3) float64. The part of a frame that chooses starts here.
///
/// With `peaks` the largest peaks of each part, so many at most, are left out of the wavelets, and coefficients of texels
/// hold them: (12 size^2, 3).
#[pyfunction]
#[pyo3(signature = (parts, size, peaks = None))]
fn environment_coefficients(
    py: Python<'_>,
    parts: Vec<Part>,
    size: usize,
    peaks: Option<usize>,
) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let coefficients = compute(py, || {
        let haar = Haar::shared(size)?;
        let Some(peaks) = peaks else { return Ok(haar.forward(&resampled(&parts, size)?)) };
        let mut radiance = vec![[0.0; 3]; 6 * size * size];
        let mut texels = vec![[0.0; 3]; 6 * size * size];
        for (weight, map, rotation) in &parts {
            map.get().0.split(size, rotation, *weight, peaks, &mut radiance, &mut texels);
        }
        let mut coefficients = haar.forward(&radiance);
        coefficients.append(&mut texels);
        Ok(coefficients)
    })?;
    table(py, coefficients)
}

/// The largest peaks of all parts, so many of each at most, for cubemaps of a size: directions and fluxes, (n, 3) float64.
#[pyfunction]
#[allow(clippy::type_complexity)]
fn environment_peaks<'py>(
    py: Python<'py>,
    parts: Vec<Part>,
    size: usize,
    count: usize,
) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>)> {
    let (directions, fluxes) = compute(py, || {
        Haar::shared(size)?;
        let (mut directions, mut fluxes) = (Vec::new(), Vec::new());
        for (weight, map, rotation) in &parts {
            for peak in map.get().0.peaks(size, rotation, count) {
                directions.push(peak.direction);
                fluxes.push(std::array::from_fn::<f64, 3, _>(|c| peak.flux[c] * weight[c]));
            }
        }
        Ok((directions, fluxes))
    })?;
    Ok((table(py, directions)?, table(py, fluxes)?))
}

/// Radiance from unit directions (m, 3): (m, 3) float32, bilinear between the maps' own pixels.
#[pyfunction]
fn environment_radiance<'py>(
    py: Python<'py>,
    parts: Vec<Part>,
    directions: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let directions = triples("directions", &directions)?;
    let radiance = compute(py, || {
        Error::unless_room::<[f32; 6]>(directions.len())?;
        let mut sum = vec![[0.0f32; 3]; directions.len()];
        for (weight, map, rotation) in &parts {
            for (total, own) in sum.iter_mut().zip(map.get().0.sample(&directions, rotation, *weight)) {
                (0..3).for_each(|c| total[c] += own[c]);
            }
        }
        Ok(sum)
    })?;
    rows(py, (radiance.len(), 3), radiance.into_flattened())
}

/// Pixels of a picture behind which light is seen; made once for a camera.
#[pyclass(frozen, name = "Behind", module = "deltalux._core")]
pub(super) struct PyBehind(Behind);

#[pymethods]
impl PyBehind {
    /// shares (h, w) float32: what of each pixel shows no surface; directions (h, w, 3) float64, of length 1.
    #[new]
    fn new(shares: PyReadonlyArray2<'_, f32>, directions: PyReadonlyArray3<'_, f64>) -> PyResult<Self> {
        let ([height, width], found) = ([shares.shape()[0], shares.shape()[1]], directions.shape());
        if found != [height, width, 3] {
            let what = format!("expected directions of shape ({height}, {width}, 3), got {found:?}");
            return Err(Error::input(what).into());
        }
        let (shares, directions) = (shares.as_array(), directions.as_array());
        let mut behind = Behind { pixels: Vec::new(), shares: Vec::new(), directions: Vec::new() };
        for ((row, column), &share) in shares.indexed_iter().filter(|(_, share)| **share > 0.0) {
            behind.pixels.push((row * width + column) as u32);
            behind.shares.push(share);
            behind.directions.push(std::array::from_fn(|k| directions[[row, column, k]] as f32));
        }
        Ok(PyBehind(behind))
    }

    /// Adds what is seen of the sum of the parts to a picture (h, w, 3), in place.
    fn add<'py>(&self, py: Python<'py>, parts: Vec<Part>, mut picture: PyReadwriteArray3<'py, f32>) -> PyResult<()> {
        let pixels: &mut [[f32; 3]] = match picture.as_slice_mut()?.as_chunks_mut::<3>() {
            (pixels, []) => pixels,
            _ => return Err(Error::input("expected a picture whose last axis has length 3").into()),
        };
        if self.0.pixels.last().is_some_and(|&last| last as usize >= pixels.len()) {
            return Err(Error::input(format!("expected another picture than one of {} pixels", pixels.len())).into());
        }
        compute(py, || {
            for (weight, map, rotation) in &parts {
                map.get().0.add_behind(&self.0, rotation, *weight, pixels);
            }
            Ok(())
        })
    }
}

/// The scanlines of a Radiance picture behind its header: (lines, length, 4) uint8, three mantissas and an exponent.
#[pyfunction]
fn radiance_scanlines<'py>(
    py: Python<'py>,
    body: &[u8],
    lines: usize,
    length: usize,
) -> PyResult<Bound<'py, PyArray3<u8>>> {
    let pixels = radiance::decode(body, lines, length)?;
    let array = Array3::from_shape_vec((lines, length, 4), pixels.into_flattened());
    Ok(array.map_err(|error| Error::input(error.to_string()))?.into_pyarray(py))
}

/// Haar coefficients of radiance (6, size, size, 3): (6 size^2, 3) float64.
#[pyfunction]
fn haar_coefficients<'py>(
    py: Python<'py>,
    size: usize,
    cubemap: PyReadonlyArray4<'py, f32>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let texels = cubemap_colours(&cubemap, size)?;
    let coefficients = compute(py, || Ok(Haar::shared(size)?.forward(&texels)))?;
    table(py, coefficients)
}

/// What goes through texels put back into the wavelets: (12 size^2, 3) to (6 size^2, 3) float64.
#[pyfunction]
fn haar_without_texels<'py>(
    py: Python<'py>,
    size: usize,
    coefficients: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let coefficients = triples("coefficients", &coefficients)?;
    let merged = compute(py, || {
        let haar = Haar::shared(size)?;
        checked(2 * haar.columns(), coefficients.len())?;
        Ok(haar.without_texels(&coefficients))
    })?;
    table(py, merged)
}

/// The radiance (6, size, size, 3) float64 that has these coefficients (6 size^2, 3).
#[pyfunction]
fn haar_inverse<'py>(
    py: Python<'py>,
    size: usize,
    coefficients: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray4<f64>>> {
    let coefficients = triples("coefficients", &coefficients)?;
    let radiance = compute(py, || {
        let haar = Haar::shared(size)?;
        checked(haar.columns(), coefficients.len())?;
        Ok(haar.inverse(&coefficients))
    })?;
    cubemap(py, size, radiance.into_flattened())
}

/// Refuses a number of colours that does not go with the face size.
fn checked(expected: usize, found: usize) -> Result<()> {
    if expected == found {
        Ok(())
    } else {
        Err(Error::input(format!("expected {expected} colours for this face size, got {found}")))
    }
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyEnvironmentMap>()?;
    module.add_class::<PyBehind>()?;
    module.add_function(wrap_pyfunction!(environment_cubemap, module)?)?;
    module.add_function(wrap_pyfunction!(environment_coefficients, module)?)?;
    module.add_function(wrap_pyfunction!(environment_peaks, module)?)?;
    module.add_function(wrap_pyfunction!(environment_radiance, module)?)?;
    module.add_function(wrap_pyfunction!(radiance_scanlines, module)?)?;
    module.add_function(wrap_pyfunction!(haar_coefficients, module)?)?;
    module.add_function(wrap_pyfunction!(haar_without_texels, module)?)?;
    module.add_function(wrap_pyfunction!(haar_inverse, module)?)?;
    Ok(())
}
