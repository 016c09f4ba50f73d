//! Curves of reflectance for Python: their wavelets, what a model is as a curve, and the pass that makes their rows.

use std::sync::Arc;

use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray4, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::basis::daubechies4::{CURVE, Daubechies4};
use crate::brdf::{Fresnel, Quotient};
use crate::error::{Error, Result};
use crate::precompute::curve::{CURVE_FACE, CurvePass as Core};
use crate::precompute::{Pass, respond, survey, tile};
use crate::transport::{Measure, Truncation};

use super::arrays::{coefficients, column_weights, cubemap_colours, rows_of, table, vectors};
use super::brdf::{Brdf, Measured};
use super::pieces::TileData;
use super::rows::Receivers;
use super::scene::{Looked, Scene};
use super::{compute, interruptible};

/// Curves, (256, k) float64, one below the other.
fn curves(array: &PyReadonlyArray2<'_, f64>) -> Result<Vec<[f64; CURVE]>> {
    let array = array.as_array();
    if array.nrows() != CURVE {
        return Err(Error::input(format!("expected curves of shape ({CURVE}, k), got {:?}", array.shape())));
    }
    Ok(array.columns().into_iter().map(|own| std::array::from_fn(|k| own[k])).collect())
}

fn transformed<'py>(
    py: Python<'py>,
    array: &PyReadonlyArray2<'py, f64>,
    transform: impl Fn(&Daubechies4, &[f64; CURVE]) -> [f64; CURVE],
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let d4 = Daubechies4::shared();
    let all: Vec<[f64; CURVE]> = curves(array)?.iter().map(|own| transform(d4, own)).collect();
    let by_sample: Vec<f64> = (0..CURVE).flat_map(|k| all.iter().map(move |own| own[k])).collect();
    super::arrays::rows(py, (CURVE, all.len()), by_sample)
}

/// Daubechies-4 coefficients of curves of 256 samples, (256, k) float64.
#[pyfunction]
fn daubechies4_forward<'py>(
    py: Python<'py>,
    curves: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    transformed(py, &curves, Daubechies4::forward)
}

/// Curves of 256 samples of their coefficients, (256, k) float64.
#[pyfunction]
fn daubechies4_inverse<'py>(
    py: Python<'py>,
    coefficients: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    transformed(py, &coefficients, Daubechies4::inverse)
}

/// What a smooth facet of the index n - ik reflects at cosines (m,): (m,) float64.
#[pyfunction]
fn fresnel<'py>(
    py: Python<'py>,
    n: f64,
    k: f64,
    cosines: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let index = Fresnel::index(n, k)?;
    Ok(PyArray1::from_iter(py, cosines.as_array().iter().map(|&cosine| index.at(cosine))))
}

/// What is kept of a material whose curve is edited.
#[pyclass(frozen, name = "Quotient", module = "deltalux._core")]
pub(super) struct PyQuotient(Quotient);

#[pymethods]
impl PyQuotient {
    /// Of a model with a lobe.
    #[staticmethod]
    fn of_model(model: &Bound<'_, Brdf>) -> PyResult<Self> {
        Ok(PyQuotient(Quotient::of_model(Arc::clone(&model.get().model))?))
    }

    /// Of a measured material and a curve of its own, (nodes, 3) float64 above 0.
    #[staticmethod]
    fn of_measured(table: &Bound<'_, Measured>, curve: PyReadonlyArray2<'_, f64>) -> PyResult<Self> {
        let curve = vectors("a curve", &curve)?;
        Ok(PyQuotient(Quotient::of_measured(Arc::clone(&table.get().table), curve)?))
    }

    /// For pairs of local directions (n, 3): the abscissa of the curve (n,), the cosine of the difference angle (n,), and
    /// f cos theta_i over the curve and Fresnel's reflectance (n, 3); all 0 below the horizon.
    #[allow(clippy::type_complexity)]
    fn shares<'py>(
        &self,
        py: Python<'py>,
        wi: PyReadonlyArray2<'py, f64>,
        wo: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>)> {
        let (wi, wo) = (vectors("wi", &wi)?, vectors("wo", &wo)?);
        let mut found = (Vec::new(), Vec::new(), Vec::new());
        for (&wi, &wo) in wi.iter().zip(&wo) {
            let share = self.0.share(wi, wo);
            found.0.push(share.map_or(0.0, |(share, _)| share.u));
            found.1.push(share.map_or(0.0, |(share, _)| share.cos_d));
            found.2.push(share.map_or([0.0; 3], |(_, colours)| colours));
        }
        Ok((found.0.into_pyarray(py), found.1.into_pyarray(py), table(py, found.2)?))
    }
}

/// The pass that makes rows of curves.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct CurvePass(Core);

impl CurvePass {
    fn rule(
        &self,
        weights: &PyReadonlyArray1<'_, f64>,
        threshold: f64,
        quantum: i32,
        width: &str,
    ) -> Result<Truncation> {
        let bands = &self.0.shape().bands;
        let weights = column_weights(weights, bands.columns())?;
        Truncation::with_weights(weights, bands.always, threshold, quantum, width.parse()?)
    }
}

#[pymethods]
impl CurvePass {
    /// receivers: of one material, looked at from `eye`; factors (r, nodes) float64: what Fresnel's reflectance is a sum of,
    /// at nodes evenly spaced over the cosine; light: cubemaps with 1, 2, 4 and 8 times `CURVE_FACE` texels along a face.
    #[new]
    #[pyo3(signature = (scene, receivers, quotient, *, eye, factors, light, edge_side))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        scene: &Bound<'_, Scene>,
        receivers: &Bound<'_, Receivers>,
        quotient: &Bound<'_, PyQuotient>,
        eye: [f64; 3],
        factors: PyReadonlyArray2<'_, f64>,
        light: Vec<PyReadonlyArray4<'_, f32>>,
        edge_side: usize,
    ) -> PyResult<Self> {
        let (tracer, rows) = (scene.get().tracer(), receivers.get());
        let factors = factors.as_array().rows().into_iter().map(|own| own.to_vec()).collect();
        let light = light.iter().map(|own| cubemap_colours(own, own.shape()[1])).collect::<Result<Vec<_>>>()?;
        let [whole, coarse, middle, fine] = &light[..] else {
            return Err(Error::input(format!("expected 4 cubemaps, got {}", light.len())).into());
        };
        let (eyes, points, lobes) = (rows.eyes(eye), rows.points(), rows.lobes());
        let quotient = quotient.get().0.clone();
        compute(py, || {
            let light = [whole, coarse, middle, fine].map(Vec::as_slice);
            Ok(CurvePass(Core::new(tracer, points, (eyes, lobes), quotient, factors, light, edge_side)?))
        })
    }

    /// As `DirectPass.survey`, with weights of its own, (columns,), and curves (columns, 3) in the place of lights.
    #[pyo3(signature = (bundles, *, tolerance, weights, quantum, width, curves, progress = None))]
    #[allow(clippy::too_many_arguments)]
    fn survey(
        &self,
        py: Python<'_>,
        bundles: usize,
        tolerance: f64,
        weights: PyReadonlyArray1<'_, f64>,
        quantum: i32,
        width: &str,
        curves: Vec<PyReadonlyArray2<'_, f64>>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Looked> {
        let rule = self.rule(&weights, 0.0, quantum, width)?;
        let measure = |curve: &PyReadonlyArray2<'_, f64>| {
            let whole = coefficients(curve)?;
            Ok(Measure { decides: true, truncated: whole.clone(), whole })
        };
        let curves = Arc::new(curves.iter().map(measure).collect::<Result<Vec<_>>>()?);
        let looked = interruptible(py, progress, |watch| {
            let (mut surveyed, rays) = survey(&self.0, bundles, &[rule], &curves, &|rows| watch.advance(rows))?;
            let surveyed = surveyed.swap_remove(0);
            Ok((surveyed.survey.threshold_for(tolerance)?, surveyed, rays))
        })?;
        Looked::new(py, looked)
    }

    /// As `DirectPass.tile`, with weights of its own.
    #[pyo3(signature = (first, rows, *, threshold, weights, quantum, width, progress = None))]
    #[allow(clippy::too_many_arguments)]
    fn tile(
        &self,
        py: Python<'_>,
        first: usize,
        rows: usize,
        threshold: f64,
        weights: PyReadonlyArray1<'_, f64>,
        quantum: i32,
        width: &str,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<(TileData, u64, u64)> {
        let rule = self.rule(&weights, threshold, quantum, width)?;
        let (mut tiles, rays) = interruptible(py, progress, |watch| {
            tile(&self.0, first..first.saturating_add(rows), &[rule], &|done| watch.advance(done))
        })?;
        Ok((TileData(tiles.swap_remove(0)), rays.first, rays.edge))
    }

    /// The response of rows as they are made to V, (columns, 3) float64: (rows, 3) float32.
    #[pyo3(signature = (v, *, progress = None))]
    fn respond(
        &self,
        py: Python<'_>,
        v: PyReadonlyArray2<'_, f64>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Py<PyArray2<f32>>> {
        let v = coefficients(&v)?;
        rows_of(py, &interruptible(py, progress, |watch| respond(&self.0, &v, &|rows| watch.advance(rows)))?)
    }
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("CURVE", CURVE)?;
    module.add("CURVE_FACE", CURVE_FACE)?;
    module.add_class::<PyQuotient>()?;
    module.add_class::<CurvePass>()?;
    module.add_function(wrap_pyfunction!(daubechies4_forward, module)?)?;
    module.add_function(wrap_pyfunction!(daubechies4_inverse, module)?)?;
    module.add_function(wrap_pyfunction!(fresnel, module)?)
}
