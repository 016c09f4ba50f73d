//! Bindings of `scene::lamps`: lamps that move, and the points that they shine on.

use std::sync::Arc;

use numpy::{PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray2};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::error::Error;
use crate::scene::{Beam, Lamp as Core, Points, Sights as Seen, Source};

use super::arrays::{not_contiguous, rows_of, table, to_vec, vectors};
use super::family::Family;
use super::gather::GatherSamples;
use super::rows::Receivers;
use super::scene::Scene;
use super::{compute, interruptible};

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

impl LitPoints {
    /// Any points.
    pub(super) fn of(scene: Py<Scene>, points: Arc<Points>) -> Self {
        LitPoints { scene, points }
    }

    /// The points themselves.
    pub(super) fn points(&self) -> Arc<Points> {
        Arc::clone(&self.points)
    }
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

    /// Irradiance over pi, in the mean of each `together` neighbours: (points / together, 3) float64.
    #[pyo3(signature = (lamp, sights, *, together = 1))]
    fn irradiance<'py>(
        &self,
        py: Python<'py>,
        lamp: &Lamp,
        sights: &Sights,
        together: usize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        if together == 0 || !self.points.len().is_multiple_of(together) {
            let count = self.points.len();
            return Err(Error::input(format!("expected a part of {count} points, got {together}")).into());
        }
        let mesh = self.scene.get().surfaces().mesh;
        table(py, interruptible(py, None, |_| Ok(lamp.0.irradiance(mesh, &self.points, &sights.0, together)))?)
    }

    /// What points (n,) uint32 send to eyes, unit vectors (n, 3) float32, through a family's model.
    fn glints(
        &self,
        py: Python<'_>,
        lamp: &Lamp,
        sights: &Sights,
        rows: PyReadonlyArray1<'_, u32>,
        eyes: PyReadonlyArray2<'_, f32>,
        family: &Family,
    ) -> PyResult<Glints> {
        let (rows, eyes) = (to_vec(&rows), vectors("eyes", &eyes)?);
        if rows.len() != eyes.len() || rows.iter().any(|&row| row as usize >= self.points.len()) {
            let count = self.points.len();
            return Err(Error::input(format!("expected numbers below {count}, and an eye for each")).into());
        }
        let (mesh, edited) = (self.scene.get().surfaces().mesh, family.0.edited());
        let at = (&*self.points, &sights.0);
        Ok(Glints(interruptible(py, None, |_| Ok(lamp.0.glints(mesh, at, &rows, &eyes, edited)))?))
    }
}

/// Light of lamps that leaves points through a model, ready for any parameter.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct Glints(crate::scene::Glints);

/// Points that one thread adds the lobes of at a time.
const TOGETHER: usize = 512;

/// Adds k_s times what leaves `rows` (n,) uint32 through a lobe to values, (rows, 3) float32: glints of lamps, each times its
/// weight, at a parameter; and `gathered` of surfaces, (n, 3) float32.
#[pyfunction]
fn add_lobe(
    py: Python<'_>,
    mut values: PyReadwriteArray2<'_, f32>,
    rows: PyReadonlyArray1<'_, u32>,
    glints: Vec<(f64, PyRef<'_, Glints>)>,
    gamma: f64,
    k_s: [f64; 3],
    gathered: Option<PyReadonlyArray2<'_, f32>>,
) -> PyResult<()> {
    let rows = rows.as_slice().map_err(|_| not_contiguous())?;
    let gathered = gathered.as_ref().map(|own| own.as_slice().map_err(|_| not_contiguous())).transpose()?;
    let glints: Vec<(f64, &crate::scene::Glints)> = glints.iter().map(|(weight, own)| (*weight, &own.0)).collect();
    let count = rows.len();
    if gathered.is_some_and(|own| own.len() != 3 * count) || glints.iter().any(|(_, own)| own.len() != count) {
        return Err(Error::input(format!("expected light of {count} rows")).into());
    }
    let (values, rest) = values.as_slice_mut().map_err(|_| not_contiguous())?.as_chunks_mut::<3>();
    if !rest.is_empty() || rows.iter().any(|&row| row as usize >= values.len()) {
        return Err(Error::input(format!("expected rows below {}", values.len())).into());
    }
    let added = compute(py, || {
        let curves: Vec<_> = glints.iter().map(|(_, own)| own.curve(gamma)).collect();
        let one = |n: usize| -> [f32; 3] {
            let mut lobe = gathered.map_or([0.0; 3], |own| std::array::from_fn(|c| f64::from(own[3 * n + c])));
            for ((weight, own), &curve) in glints.iter().zip(&curves) {
                let sent = own.reflected(n, curve);
                (0..3).for_each(|c| lobe[c] += weight * sent[c]);
            }
            std::array::from_fn(|c| (k_s[c] * lobe[c]) as f32)
        };
        Ok((0..count).into_par_iter().with_min_len(TOGETHER).map(one).collect::<Vec<_>>())
    })?;
    for (&row, added) in rows.iter().zip(added) {
        (0..3).for_each(|c| values[row as usize][c] += added[c]);
    }
    Ok(())
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Lamp>()?;
    module.add_class::<Sights>()?;
    module.add_class::<LitPoints>()?;
    module.add_class::<Glints>()?;
    module.add_function(wrap_pyfunction!(add_lobe, module)?)
}
