//! Light that surfaces give off by themselves, for Python.

use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::precompute::Emitters as Core;

use super::arrays::{table, vectors};
use super::interruptible;
use super::rows::Receivers;
use super::scene::Scene;

/// Triangles that give off light.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct Emitters(pub(super) Core);

#[pymethods]
impl Emitters {
    /// radiance: of each of the user's triangles, (t, 3) float32.
    #[new]
    fn new(scene: &Bound<'_, Scene>, radiance: PyReadonlyArray2<'_, f32>) -> PyResult<Self> {
        Ok(Emitters(Core::new(scene.get().surfaces(), &vectors("radiances", &radiance)?)?))
    }

    /// What arrives of their light at rows, by twice `side` x `side` rays each: (rows, 3) float64.
    #[pyo3(signature = (scene, receivers, *, side, progress = None))]
    fn arriving<'py>(
        &self,
        py: Python<'py>,
        scene: &Bound<'py, Scene>,
        receivers: &Bound<'py, Receivers>,
        side: usize,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (scene, points, lobes) = (scene.get(), receivers.get().points(), receivers.get().lobes());
        let light = interruptible(py, progress, |watch| {
            self.0.arriving(scene.surfaces(), (&points, &lobes), side, &|done| watch.advance(done))
        })?;
        table(py, light)
    }
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Emitters>()
}
