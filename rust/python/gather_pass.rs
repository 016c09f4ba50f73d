//! Bindings of the pass that makes rows over gather samples.

use std::sync::Arc;

use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::error::Result;
use crate::precompute::{GatherPass as Core, Pass, Receiver, tile};
use crate::transport::Truncation;

use super::arrays::{coefficients, column_weights, to_vec};
use super::gather::{GatherSamples, Through, kernel, receivers};
use super::interruptible;
use super::pieces::TileData;
use super::rows::Receivers;

/// The pass that makes rows of what receivers take from gather samples.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct GatherPass(Core);

/// What a picture is measured under: what each factor is seen through, and light of the samples (columns, 3).
type Measured<'py> = (Vec<f64>, PyReadonlyArray2<'py, f64>);

impl GatherPass {
    /// A rule for each factor: the weights of columns times its scale.
    fn rules(
        &self,
        threshold: f64,
        weights: &PyReadonlyArray1<'_, f64>,
        scales: &[f64],
        (quantum, width): (i32, &str),
    ) -> Result<Vec<Truncation>> {
        let (bands, width) = (&self.0.shape().bands, width.parse()?);
        let (weights, always) = (column_weights(weights, bands.columns())?, bands.always);
        let rule = |scale: &f64| {
            let weights = weights.iter().map(|weight| weight * scale).collect();
            Truncation::with_weights(weights, always, threshold, quantum, width)
        };
        scales.iter().map(rule).collect()
    }
}

#[pymethods]
impl GatherPass {
    /// rows: what gathers, and the eye that sees it; None: the samples themselves. through: a lobe, or a family and a parameter
    /// of one of its segments; None: cosines. All of them are made together.
    #[new]
    fn new(
        samples: &GatherSamples,
        rows: Option<(Bound<'_, Receivers>, [f64; 3])>,
        through: Vec<Option<Through<'_>>>,
    ) -> PyResult<Self> {
        let scene = samples.scene();
        let receivers: Vec<Receiver> = match rows {
            Some((rows, eye)) => {
                let numbers: Vec<u32> = (0..rows.get().points().len() as u32).collect();
                receivers(scene.surfaces().mesh, rows.get(), &numbers, eye)?
            }
            None => {
                let one = |at: &crate::scene::Point| {
                    let normal = at.normal.map(|n| n as f32);
                    Receiver { origin: at.origin.map(|x| x as f32), normal, rise: normal, eye: at.normal }
                };
                samples.samples.points.iter().map(one).collect()
            }
        };
        let kernels = through.iter().map(kernel).collect::<Result<Vec<_>>>()?;
        Ok(GatherPass(Core::new(scene.mesh(), scene.tracer(), Arc::clone(&samples.samples), receivers, kernels)?))
    }

    /// (threshold, the worst error that it gives, entries that 16 rows keep) of a relative error of pictures: `weights` how much
    /// light there is in each column, `scales` in each factor.
    #[pyo3(signature = (bundles, *, tolerance, weights, scales, quantum, width, measures, progress = None))]
    #[allow(clippy::too_many_arguments)]
    fn threshold_for(
        &self,
        py: Python<'_>,
        bundles: usize,
        tolerance: f64,
        weights: PyReadonlyArray1<'_, f64>,
        scales: PyReadonlyArray1<'_, f64>,
        quantum: i32,
        width: &str,
        measures: Vec<Measured<'_>>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<(f64, f64, f64)> {
        let weights = column_weights(&weights, self.0.shape().bands.columns())?;
        let (scales, width) = (to_vec(&scales), width.parse()?);
        let measure = |(through, light): &Measured<'_>| Ok((through.clone(), coefficients(light)?));
        let measures = measures.iter().map(measure).collect::<Result<Vec<_>>>()?;
        let found = interruptible(py, progress, |watch| {
            let told = |rows| watch.advance(rows);
            self.0.threshold_for(bundles, tolerance, (&weights, &scales), (quantum, width), &measures, &told)
        })?;
        Ok((found.value, found.error, found.entries_per_group))
    }

    /// The tiles of rows `first` to `first + rows`, one a factor.
    #[pyo3(signature = (first, rows, *, threshold, weights, scales, quantum, width, progress = None))]
    #[allow(clippy::too_many_arguments)]
    fn tiles(
        &self,
        py: Python<'_>,
        first: usize,
        rows: usize,
        threshold: f64,
        weights: PyReadonlyArray1<'_, f64>,
        scales: PyReadonlyArray1<'_, f64>,
        quantum: i32,
        width: &str,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Vec<TileData>> {
        let rules = self.rules(threshold, &weights, &to_vec(&scales), (quantum, width))?;
        let (tiles, _) = interruptible(py, progress, |watch| {
            tile(&self.0, first..first.saturating_add(rows), &rules, &|done| watch.advance(done))
        })?;
        Ok(tiles.into_iter().map(TileData).collect())
    }
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<GatherPass>()
}
