//! Bindings of `scene::lamps`: lamps that move, and the points that they shine on.

use std::sync::Arc;

use numpy::{PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::brdf::Direction;
use crate::error::{Error, Result};
use crate::scene::{Beam, Lamp as Core, Points, Sights as Seen, Source};

use super::arrays::{rows_of, table, to_vec, vectors};
use super::gather::{GatherSamples, Through};
use super::interruptible;
use super::rows::Receivers;
use super::scene::Scene;

/// Sources that move together.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct Lamp(Core);

#[pymethods]
impl Lamp {
    /// at, colour (s, 3) float64: places and radiant intensities, or directions and irradiances of `far` ones. beam: "even",
    /// "cone" with its axis and the cosines at which it begins to fall and has ended, or "facing" along a normal.
    #[new]
    #[pyo3(signature = (at, colour, *, far = false, beam = "even", axis = [0.0, 0.0, 1.0], cosines = [1.0, 1.0]))]
    fn new(
        at: PyReadonlyArray2<'_, f64>,
        colour: PyReadonlyArray2<'_, f64>,
        far: bool,
        beam: &str,
        axis: [f64; 3],
        cosines: [f64; 2],
    ) -> PyResult<Self> {
        let (at, colour) = (vectors("at", &at)?, vectors("colour", &colour)?);
        if at.len() != colour.len() || at.is_empty() {
            let (places, colours) = (at.len(), colour.len());
            return Err(Error::input(format!("expected a colour for each place, got {colours} for {places}")).into());
        }
        let beam = match beam {
            "even" => Beam::Even,
            "cone" => Beam::Cone(axis, cosines),
            "facing" => Beam::Facing(axis),
            other => return Err(Error::input(format!("expected even, cone or facing, got {other:?}")).into()),
        };
        let sources = at.into_iter().zip(colour).map(|(at, colour)| Source { at, colour, beam }).collect();
        let lamp = Core { sources, far };
        lamp.check()?;
        Ok(Lamp(lamp))
    }
}

/// What a lamp's sources see of some points.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct Sights(Seen);

/// Points of surfaces that lamps shine on.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct LitPoints {
    scene: Py<Scene>,
    points: Arc<Points>,
}

#[pymethods]
impl LitPoints {
    /// Those of rows.
    #[staticmethod]
    fn of_rows(scene: Py<Scene>, rows: &Receivers) -> Self {
        LitPoints { scene, points: rows.points() }
    }

    /// `each` of the cell of every gather sample, one after the other.
    #[staticmethod]
    fn of_cells(scene: Py<Scene>, samples: &GatherSamples, each: usize) -> Self {
        LitPoints { scene, points: Arc::new(samples.of_cells(each)) }
    }

    /// Those of `arrays`.
    #[staticmethod]
    fn of_arrays(
        scene: Py<Scene>,
        origin: PyReadonlyArray2<'_, f32>,
        normal: PyReadonlyArray2<'_, f32>,
        horizon: PyReadonlyArray2<'_, f32>,
    ) -> PyResult<Self> {
        let origin = vectors("origin", &origin)?;
        let (normal, horizon) = (vectors("normal", &normal)?, vectors("horizon", &horizon)?);
        if [normal.len(), horizon.len()] != [origin.len(); 2] {
            let (expected, found) = (origin.len(), normal.len());
            return Err(Error::input(format!("expected {expected} normals, one a point, got {found}")).into());
        }
        Ok(LitPoints { scene, points: Arc::new(Points { origin, normal, horizon }) })
    }

    /// Places off their surfaces, in the normalised scene, unit normals, and those of the triangles: (points, 3) float32 each.
    #[allow(clippy::type_complexity)]
    fn arrays(&self, py: Python<'_>) -> PyResult<(Py<PyArray2<f32>>, Py<PyArray2<f32>>, Py<PyArray2<f32>>)> {
        let rises: Vec<_> = (0..self.points.len()).map(|number| self.points.rise(number)).collect();
        Ok((rows_of(py, &self.points.origin)?, rows_of(py, &self.points.normal)?, rows_of(py, &rises)?))
    }

    /// How many there are.
    fn __len__(&self) -> usize {
        self.points.len()
    }

    /// Traces what a lamp sees of them.
    #[pyo3(signature = (lamp, *, progress = None))]
    fn sights(&self, py: Python<'_>, lamp: &Lamp, progress: Option<&Bound<'_, PyAny>>) -> PyResult<Sights> {
        let surfaces = self.scene.get().surfaces();
        let seen = interruptible(py, progress, |watch| {
            lamp.0.sights(surfaces.mesh, surfaces.tracer, &self.points, &|rows| watch.advance(rows))
        })?;
        Ok(Sights(seen))
    }

    /// Irradiance over pi: (points, 3) float64.
    fn irradiance<'py>(&self, py: Python<'py>, lamp: &Lamp, sights: &Sights) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let mesh = self.scene.get().surfaces().mesh;
        table(py, interruptible(py, None, |_| Ok(lamp.0.irradiance(mesh, &self.points, &sights.0)))?)
    }

    /// What points (n,) uint32 send to eyes, unit vectors (n, 3) float32, through a lobe: (n, 3) float64.
    fn reflected<'py>(
        &self,
        py: Python<'py>,
        lamp: &Lamp,
        sights: &Sights,
        rows: PyReadonlyArray1<'py, u32>,
        eyes: PyReadonlyArray2<'py, f32>,
        lobe: Through<'py>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (rows, eyes) = (to_vec(&rows), vectors("eyes", &eyes)?);
        if rows.len() != eyes.len() || rows.iter().any(|&row| row as usize >= self.points.len()) {
            let count = self.points.len();
            return Err(Error::input(format!("expected numbers below {count}, and an eye for each")).into());
        }
        let mesh = self.scene.get().surfaces().mesh;
        let at = (&*self.points, &sights.0);
        let reflected = |lobe: &(dyn Fn(Direction, Direction) -> f64 + Sync)| -> PyResult<Vec<[f64; 3]>> {
            interruptible(py, None, |_| -> Result<_> { Ok(lamp.0.reflected(mesh, at, &rows, &eyes, lobe)) })
        };
        let found = match &lobe {
            Through::Lobe(lobe) => {
                let model = Arc::clone(&lobe.get().model);
                reflected(&|wi, wo| model.evaluate(wi, wo))?
            }
            Through::Family(family, gamma) => {
                let (edited, gamma) = (family.get().0.edited(), *gamma);
                reflected(&|wi, wo| {
                    edited.fixed(wi, wo).map_or(0.0, |(fall, fixed)| fixed * edited.value(gamma, fall))
                })?
            }
        };
        table(py, found)
    }
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Lamp>()?;
    module.add_class::<Sights>()?;
    module.add_class::<LitPoints>()
}
