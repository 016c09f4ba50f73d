//! Gather samples for Python, and what receivers take from them.

use std::sync::Arc;

use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::basis::HaarTree;
use crate::error::{Error, Result};
use crate::precompute::{Gather, Kernel, Receiver, SubArea, lobe_hits, seen_from};
use crate::scene::rays::{LIFT, Segments};
use crate::scene::surface::dot;
use crate::scene::{GatherSamples as Samples, Mesh, Points, Surfaces};

use super::arrays::{rows_of, table, to_vec, triples, vectors};
use super::brdf::Brdf;
use super::family::Family;
use super::rows::{Camera, Receivers};
use super::scene::Scene;
use super::{compute, interruptible};

/// Points of surfaces whose light is carried to others, with the cells that they stand for.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct GatherSamples {
    scene: Py<Scene>,
    pub(super) samples: Arc<Samples>,
}

/// Places, unit normals and triangles of points.
type OnSurfaces = (Py<PyArray2<f32>>, Py<PyArray2<f32>>, Py<PyArray1<u32>>);

/// What rows are taken through: a lobe, or the functions of a family at a parameter; None: cosines.
#[derive(FromPyObject)]
pub(super) enum Through<'py> {
    Lobe(Bound<'py, Brdf>),
    Family(Bound<'py, Family>, f64),
}

/// The kernels of what rows are taken through.
pub(super) fn kernel(through: &Option<Through<'_>>) -> Result<Kernel> {
    Ok(match through {
        None => Kernel::Diffuse,
        Some(Through::Lobe(lobe)) => Kernel::Lobe(Arc::clone(&lobe.get().model)),
        Some(Through::Family(family, gamma)) => {
            let family = &family.get().0;
            Kernel::Family(Arc::clone(family), family.segment(*gamma)?)
        }
    })
}

/// By its name, and for discs and cells a number of points.
fn sub_area(name: &str, points: usize) -> Result<SubArea> {
    match name {
        "centre" => Ok(SubArea::Centre),
        "disc" => SubArea::Disc(points).check(),
        "cell" => SubArea::Cell(points).check(),
        "angle" => Ok(SubArea::ByAngle),
        other => Err(Error::input(format!("expected centre, disc, cell or angle, got {other:?}"))),
    }
}

/// Some rows as receivers, seen by an eye of the user's space.
pub(super) fn receivers(mesh: &Mesh, rows: &Receivers, numbers: &[u32], eye: [f64; 3]) -> Result<Vec<Receiver>> {
    let (points, eye) = (rows.points(), mesh.normalised(eye).map(f64::from));
    let receiver = |&number: &u32| {
        let number = number as usize;
        let (Some(&origin), Some(&normal)) = (points.origin.get(number), points.normal.get(number)) else {
            return Err(Error::input(format!("expected numbers of rows below {}, got {number}", points.len())));
        };
        let away: [f64; 3] = std::array::from_fn(|k| eye[k] - f64::from(origin[k]));
        let length = dot(away, away).sqrt().max(f64::MIN_POSITIVE);
        Ok(Receiver { origin, normal, rise: points.rise(number), eye: away.map(|x| x / length) })
    };
    numbers.iter().map(receiver).collect()
}

impl GatherSamples {
    /// The scene that they are of.
    pub(super) fn scene(&self) -> &Scene {
        self.scene.get()
    }

    /// `each` points of every cell, evenly over those that it has, off their surfaces.
    pub(super) fn of_cells(&self, each: usize) -> Points {
        let (samples, normals) = (&self.samples, self.normals(self.scene.get().surfaces().mesh));
        let place = |(number, k): (usize, usize)| {
            let first = samples.cell_starts[number] as usize;
            first + (2 * k + 1) * samples.cell(number).len() / (2 * each)
        };
        let places = (0..samples.len()).flat_map(|number| (0..each).map(move |k| (number, k))).map(place);
        let lifted = |place: usize| {
            let (at, normal) = (samples.cell_points[place], normals[place]);
            (std::array::from_fn(|k| (at[k] + LIFT * f64::from(normal[k])) as f32), normal)
        };
        let (origin, normal) = places.map(lifted).unzip();
        Points { origin, normal, horizon: Vec::new() }
    }

    /// The unit normals of all points of cells, to the sides that their samples are on.
    fn normals(&self, mesh: &Mesh) -> Vec<[f32; 3]> {
        let samples = &self.samples;
        let own = |number: usize| {
            let at = samples.cell_starts[number] as usize..samples.cell_starts[number + 1] as usize;
            samples.cell_triangles[at].iter().map(move |&triangle| {
                let normal = mesh.normal(triangle as usize);
                let side = if dot(normal, samples.points[number].normal) < 0.0 { -1.0 } else { 1.0 };
                normal.map(|n| (side * n) as f32)
            })
        };
        (0..samples.len()).flat_map(own).collect()
    }
}

#[pymethods]
impl GatherSamples {
    /// Where `count` paths from a camera end; `glossy` (t,): which of the user's triangles shine.
    #[staticmethod]
    fn place(
        py: Python<'_>,
        scene: Bound<'_, Scene>,
        camera: &Camera,
        glossy: PyReadonlyArray1<'_, bool>,
        count: usize,
    ) -> PyResult<GatherSamples> {
        let shines: Vec<bool> = glossy.as_array().iter().copied().collect();
        let surfaces = scene.get().surfaces();
        let samples = interruptible(py, None, |watch| {
            Samples::from_eye_paths(surfaces, &camera.0, &shines, count, &|| watch.advance(1))
        })?;
        Ok(GatherSamples { scene: scene.unbind(), samples: Arc::new(samples) })
    }

    /// How many there are.
    fn __len__(&self) -> usize {
        self.samples.len()
    }

    /// Areas in the normalised scene, (samples,) float64: those of `SampleTree`.
    #[getter]
    fn tree_areas(&self, py: Python<'_>) -> Py<PyArray1<f64>> {
        PyArray1::from_slice(py, &self.samples.areas).unbind()
    }

    /// In the user's space, (samples, 3) float32.
    #[getter]
    fn position(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f32>>> {
        let mesh = self.scene.get().surfaces().mesh;
        rows_of(py, &self.samples.points.iter().map(|point| mesh.world(point.place)).collect::<Vec<_>>())
    }

    /// Unit normals, (samples, 3) float32.
    #[getter]
    fn normal(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f32>>> {
        rows_of(py, &self.samples.points.iter().map(|point| point.normal.map(|n| n as f32)).collect::<Vec<_>>())
    }

    /// Whether the path of each left what shines into its lobe, (samples,) bool.
    #[getter]
    fn glossy(&self, py: Python<'_>) -> Py<PyArray1<bool>> {
        PyArray1::from_slice(py, &self.samples.glossy).unbind()
    }

    /// Areas that they stand for, in the user's unit squared, (samples,) float64.
    #[getter]
    fn area(&self, py: Python<'_>) -> Py<PyArray1<f64>> {
        let unit = self.scene.get().surfaces().mesh.scale.powi(2);
        PyArray1::from_vec(py, self.samples.areas.iter().map(|area| area / unit).collect()).unbind()
    }

    /// Where the points of each cell begin, (samples + 1,) uint32.
    #[getter]
    fn cell_starts(&self, py: Python<'_>) -> Py<PyArray1<u32>> {
        PyArray1::from_slice(py, &self.samples.cell_starts).unbind()
    }

    /// Points of all cells in the user's space, their unit normals, (points, 3) float32, and the user's numbers of their
    /// triangles, (points,) uint32.
    fn cell_points(&self, py: Python<'_>) -> PyResult<OnSurfaces> {
        let mesh = self.scene.get().surfaces().mesh;
        let places: Vec<_> = self.samples.cell_points.iter().map(|&place| mesh.world(place)).collect();
        let triangles = self.samples.cell_triangles.iter().map(|&triangle| mesh.source[triangle as usize]);
        let triangles = PyArray1::from_vec(py, triangles.collect()).unbind();
        Ok((rows_of(py, &places)?, rows_of(py, &self.normals(mesh))?, triangles))
    }

    /// Of all points of cells the user's numbers of their triangles, (points,) uint32, and the weights of corners 1 and 2 there,
    /// (points, 2) float32.
    #[allow(clippy::type_complexity)]
    fn cell_places(&self, py: Python<'_>) -> PyResult<(Py<PyArray1<u32>>, Py<PyArray2<f32>>)> {
        let (mesh, samples) = (self.scene.get().surfaces().mesh, &self.samples);
        let at = samples.cell_points.iter().zip(&samples.cell_triangles);
        let weights: Vec<_> = at.map(|(&place, &triangle)| mesh.barycentric(triangle as usize, place)).collect();
        let triangles = samples.cell_triangles.iter().map(|&triangle| mesh.source[triangle as usize]);
        Ok((PyArray1::from_iter(py, triangles).unbind(), rows_of(py, &weights)?))
    }

    /// What some rows, seen from an eye, take from each sample: (rows, functions, samples) float32.
    #[pyo3(signature = (rows, numbers, eye, through, *, sub_area = "angle", points = 16))]
    #[allow(clippy::too_many_arguments, reason = "who gathers, through what, and by which points")]
    fn rows<'py>(
        &self,
        py: Python<'py>,
        rows: &Receivers,
        numbers: Vec<u32>,
        eye: [f64; 3],
        through: Option<Through<'py>>,
        sub_area: &str,
        points: usize,
    ) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let (surfaces, sub_area) = (self.scene.get().surfaces(), self::sub_area(sub_area, points)?);
        let receivers = receivers(surfaces.mesh, rows, &numbers, eye)?;
        let kernels = [kernel(&through)?];
        let gather = Gather { surfaces, samples: &self.samples, kernels: &kernels, sub_area };
        let shape = [receivers.len(), gather.count(), self.samples.len()];
        let values = interruptible(py, None, |watch| gather.matrix(&receivers, &|rows| watch.advance(rows)))?;
        PyArray1::from_vec(py, values).reshape(shape)
    }

    /// What they gather of light at the samples (samples, 3): (rows * functions, 3) float64.
    #[pyo3(signature = (rows, numbers, eye, through, light, *, sub_area = "angle", points = 16, progress = None))]
    #[allow(clippy::too_many_arguments, reason = "who gathers what, through what, and by which points")]
    fn light<'py>(
        &self,
        py: Python<'py>,
        rows: &Receivers,
        numbers: Vec<u32>,
        eye: [f64; 3],
        through: Option<Through<'py>>,
        light: PyReadonlyArray2<'py, f64>,
        sub_area: &str,
        points: usize,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (surfaces, sub_area) = (self.scene.get().surfaces(), self::sub_area(sub_area, points)?);
        let receivers = receivers(surfaces.mesh, rows, &numbers, eye)?;
        let (kernels, light) = ([kernel(&through)?], triples("light", &light)?);
        let gather = Gather { surfaces, samples: &self.samples, kernels: &kernels, sub_area };
        table(py, interruptible(py, progress, |watch| gather.light(&receivers, &light, &|rows| watch.advance(rows)))?)
    }
}

/// Haar wavelets over the tree of samples with these areas.
#[pyclass(frozen, module = "deltalux._core")]
struct SampleTree(HaarTree);

#[pymethods]
impl SampleTree {
    /// areas: (samples,) float64, in the order of the tree.
    #[new]
    fn new(areas: PyReadonlyArray1<'_, f64>) -> PyResult<Self> {
        Ok(SampleTree(HaarTree::new(to_vec(&areas))?))
    }

    /// Its columns, as text: "tree:4096".
    #[getter]
    fn columns(&self) -> String {
        self.0.space().to_string()
    }

    /// Coefficients (columns, 3) float64 of light at the samples (samples, 3).
    fn forward<'py>(&self, py: Python<'py>, light: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (light, count) = (triples("light", &light)?, self.0.areas().len());
        if light.len() != count {
            let found = light.len();
            return Err(Error::input(format!("expected the light of {count} samples, got that of {found}")).into());
        }
        table(py, self.0.forward(&light))
    }
}

/// What rays of a lobe meet from some rows, `side` x `side` a row: their places and normals (rays, 3) float32, the user's
/// triangles (rays,) uint32, and what each stands for (rays,) float64; 0 of those that meet nothing.
type Hits = (Py<PyArray2<f32>>, Py<PyArray2<f32>>, Py<PyArray1<u32>>, Py<PyArray1<f64>>);

/// See `Hits`.
#[pyfunction]
fn gather_lobe_hits(
    py: Python<'_>,
    scene: &Bound<'_, Scene>,
    rows: &Receivers,
    numbers: Vec<u32>,
    eye: [f64; 3],
    lobe: &Bound<'_, Brdf>,
    side: usize,
) -> PyResult<Hits> {
    let surfaces = scene.get().surfaces();
    let (receivers, model) = (receivers(surfaces.mesh, rows, &numbers, eye)?, Arc::clone(&lobe.get().model));
    let hits = interruptible(py, None, |watch| {
        let one = |receiver: &Receiver| watch.advance(1).map(|()| lobe_hits(surfaces, receiver, &*model, side));
        receivers.par_iter().map(one).collect::<Result<Vec<_>>>()
    })?;
    let (mut places, mut normals, mut triangles, mut shares) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (hit, share) in hits.into_iter().flatten() {
        places.push(hit.map_or([0.0; 3], |hit| surfaces.mesh.world(hit.place)));
        normals.push(hit.map_or([0.0; 3], |hit| hit.normal.map(|n| n as f32)));
        triangles.push(hit.map_or(0, |hit| surfaces.mesh.source[hit.triangle as usize]));
        shares.push(if hit.is_some() { share } else { 0.0 });
    }
    let (triangles, shares) = (PyArray1::from_vec(py, triangles), PyArray1::from_vec(py, shares));
    Ok((rows_of(py, &places)?, rows_of(py, &normals)?, triangles.unbind(), shares.unbind()))
}

/// Which points of surfaces (n, 3), with unit normals (n, 3), a point of the user's space sees: (n,) bool.
#[pyfunction]
fn points_seen_from(
    py: Python<'_>,
    scene: &Bound<'_, Scene>,
    point: [f64; 3],
    places: PyReadonlyArray2<'_, f32>,
    normals: PyReadonlyArray2<'_, f32>,
) -> PyResult<Py<PyArray1<bool>>> {
    let (places, normals) = (vectors("places", &places)?, vectors("normals", &normals)?);
    if places.len() != normals.len() {
        let (expected, got) = (places.len(), normals.len());
        return Err(Error::input(format!("expected {expected} normals, one a place, got {got}")).into());
    }
    let Surfaces { mesh, tracer } = scene.get().surfaces();
    let from = mesh.normalised(point);
    let seen = compute(py, || {
        let places: Vec<_> = places.iter().map(|place| mesh.normalised(place.map(f64::from))).collect();
        let both = places.par_chunks(64).zip(normals.par_chunks(64));
        let seen = both.map_init(Segments::default, |room, (places, normals)| {
            let seen = seen_from(tracer, from, places, normals, room);
            (0..places.len()).map(move |k| seen >> k & 1 == 1).collect::<Vec<_>>()
        });
        Ok(seen.flatten_iter().collect::<Vec<bool>>())
    })?;
    Ok(PyArray1::from_vec(py, seen).unbind())
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<GatherSamples>()?;
    module.add_class::<SampleTree>()?;
    module.add_function(wrap_pyfunction!(gather_lobe_hits, module)?)?;
    module.add_function(wrap_pyfunction!(points_seen_from, module)?)
}
