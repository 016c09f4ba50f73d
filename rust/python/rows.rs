//! Rows of M as a scene has them: what a camera's pixels show, or vertices.

use std::sync::Arc;

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::brdf::measured::Colour;
use crate::brdf::{Factor, Stored};
use crate::error::{Error, Result};
use crate::precompute::pass::BUNDLE_ROWS;
use crate::precompute::{LobeShape, Lobes};
use crate::scene::{self as core, Mesh, Points, Vertices};
use crate::transport::lobes::DIFFUSE;
use crate::transport::{ReceiverKind, ReceiverTable as Table};

use super::arrays::{rows, rows_of, to_vec, to_vec_of_rows, vectors};
use super::brdf::Measured;
use super::compute;
use super::receivers::ReceiverTable;

/// A perspective camera, its frame made orthonormal by the caller.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct Camera(pub(super) core::Camera);

#[pymethods]
impl Camera {
    /// position, right, up, forward: world coordinates; half_height: tangent of half the vertical field of view.
    #[new]
    #[pyo3(signature = (*, position, right, up, forward, half_height, width, height))]
    fn new(
        position: [f64; 3],
        right: [f64; 3],
        up: [f64; 3],
        forward: [f64; 3],
        half_height: f64,
        width: usize,
        height: usize,
    ) -> PyResult<Self> {
        let camera = core::Camera { position, right, up, forward, half_height, width, height };
        camera.check()?;
        Ok(Camera(camera))
    }
}

/// Rows of M.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct Receivers {
    points: Arc<Points>,
    /// In the user's space.
    position: Vec<[f32; 3]>,
    /// The user's number of each row's triangle, and the place in it.
    triangle: Vec<u32>,
    barycentric: Vec<[f32; 2]>,
    /// Whether it is the back of the triangle.
    back: Vec<bool>,
    lobes: Arc<Lobes>,
    /// Of each row the place of its lobe in its material's list; -1 of diffuse ones.
    lobe: Vec<i32>,
    /// Of each row the diffuse row of the same vertex, or itself.
    base: Vec<u32>,
    /// What tangents of rows are turned by, out of the frames of their normals; empty where they have none.
    turns: Vec<[f32; 2]>,
    rays: u64,
    kind: Kind,
}

/// A lobe of a material: a model by its number and parameters, or one colour of a measured table.
#[derive(FromPyObject)]
enum OneLobe<'py> {
    Model(u32, Vec<f64>),
    Measured(Bound<'py, Measured>, usize),
}

/// The number of the last of so many lobes; refuses more than rows can name.
fn numbered(count: usize) -> Result<u16> {
    let number = u16::try_from(count - 1).ok().filter(|&number| number != DIFFUSE);
    number.ok_or_else(|| Error::input(format!("expected at most {DIFFUSE} lobes and factors in all, got {count}")))
}

/// What rows stand for.
enum Kind {
    Pixels { image: [usize; 2], pixel: Vec<u32>, weight: Vec<f32>, background: Vec<f32> },
    Vertices(Vertices),
}

impl Receivers {
    /// What a camera's pixels show.
    pub(super) fn of_pixels(mesh: &Mesh, camera: &core::Camera, rows: core::Receivers) -> Self {
        let core::Receivers { pixel, weight, triangle, barycentric, points, background, rays } = rows;
        let image = [camera.height, camera.width];
        let back = triangle.iter().zip(&points.normal).map(|(&triangle, normal)| mesh.is_back(triangle, *normal));
        Receivers {
            back: back.collect(),
            lobes: Arc::default(),
            lobe: vec![-1; triangle.len()],
            base: (0..triangle.len() as u32).collect(),
            turns: Vec::new(),
            position: points.origin.iter().map(|origin| mesh.world(origin.map(f64::from))).collect(),
            triangle: triangle.into_iter().map(|triangle| mesh.source[triangle as usize]).collect(),
            barycentric,
            points,
            rays,
            kind: Kind::Pixels { image, pixel, weight, background },
        }
    }

    /// The vertices of a scene.
    pub(super) fn of_vertices(mesh: &Mesh, rows: Vertices) -> Self {
        Receivers {
            position: rows.places.iter().map(|at| mesh.world(at.place)).collect(),
            triangle: rows.places.iter().map(|at| mesh.source[at.triangle as usize]).collect(),
            barycentric: rows.places.iter().map(|at| at.barycentric).collect(),
            points: Arc::clone(&rows.points),
            back: rows.places.iter().map(|at| mesh.is_back(at.triangle, at.normal.map(|n| n as f32))).collect(),
            lobes: Arc::default(),
            lobe: vec![-1; rows.len()],
            base: (0..rows.len() as u32).collect(),
            turns: Vec::new(),
            rays: 0,
            kind: Kind::Vertices(rows),
        }
    }

    /// Where the rows' rays start.
    pub(super) fn points(&self) -> Arc<Points> {
        Arc::clone(&self.points)
    }

    /// What the rows take by other lobes than cosines.
    pub(super) fn lobes(&self) -> Arc<Lobes> {
        Arc::clone(&self.lobes)
    }

    /// Unit vectors from the rows to an eye.
    pub(super) fn eyes(&self, eye: [f64; 3]) -> Vec<[f32; 3]> {
        let to_eye = |position: &[f32; 3]| {
            let way: [f64; 3] = std::array::from_fn(|k| eye[k] - f64::from(position[k]));
            let length = way.iter().map(|x| x * x).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
            way.map(|x| (x / length) as f32)
        };
        self.position.iter().map(to_eye).collect()
    }

    /// What is known of vertices; refuses pixels.
    pub(super) fn vertices(&self) -> Result<&Vertices> {
        match &self.kind {
            Kind::Pixels { .. } => Err(Error::input("expected vertices, but these rows are pixels")),
            Kind::Vertices(rows) => Ok(rows),
        }
    }
}

#[pymethods]
impl Receivers {
    /// The number of rows.
    fn __len__(&self) -> usize {
        self.points.len()
    }

    /// Rays shot to find them.
    #[getter]
    fn rays(&self) -> u64 {
        self.rays
    }

    /// Of each row the place of its lobe in the list of its material, (rows,) int32; -1 of diffuse rows.
    #[getter]
    fn lobe(&self, py: Python<'_>) -> Py<PyArray1<i32>> {
        PyArray1::from_slice(py, &self.lobe).unbind()
    }

    /// The same rows of pixels with cosines to these normals, (rows, 3) float32, or to those of triangles: nothing below the
    /// horizon of either the normal or the triangle is seen. `turns`, (rows, 2) float32: cosine and sine of what tangents are turned by, out of
    /// the frame of the normal.
    fn shaded(
        &self,
        normals: Option<PyReadonlyArray2<'_, f32>>,
        turns: Option<PyReadonlyArray2<'_, f32>>,
    ) -> PyResult<Receivers> {
        let Kind::Pixels { image, pixel, weight, background } = &self.kind else {
            return Err(Error::input("expected pixels, but these rows are vertices").into());
        };
        let normals: Option<Vec<[f32; 3]>> = normals.map(|normals| vectors("normals", &normals)).transpose()?;
        let (normal, horizon) = match normals {
            Some(normal) => (normal, self.points.normal.clone()),
            None => (self.points.normal.clone(), Vec::new()),
        };
        let unit = |n: &[f32; 3]| (n.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 1e-4;
        if normal.len() != self.points.len() || !normal.iter().all(unit) {
            return Err(
                Error::input(format!("expected a normal of length 1 for each of {} rows", self.points.len())).into()
            );
        }
        let turns = turns.map(|turns| vectors("turns", &turns)).transpose()?.unwrap_or_default();
        let origin = self.points.origin.clone();
        Ok(Receivers {
            points: Arc::new(Points { origin, normal, horizon }),
            position: self.position.clone(),
            triangle: self.triangle.clone(),
            barycentric: self.barycentric.clone(),
            back: self.back.clone(),
            lobes: Arc::clone(&self.lobes),
            lobe: self.lobe.clone(),
            base: self.base.clone(),
            turns,
            rays: self.rays,
            kind: Kind::Pixels {
                image: *image,
                pixel: pixel.clone(),
                weight: weight.clone(),
                background: background.clone(),
            },
        })
    }

    /// Unit normals of the rows, (rows, 3) float32.
    #[getter]
    fn normal(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f32>>> {
        rows_of(py, &self.points.normal)
    }

    /// The rows of pixels as their materials ask for them: one where a material is `diffuse`, and one for each of its lobes,
    /// seen from `eye`; the lobes come last. material: (rows,) uint32. A lobe of a measured material is one of its colours.
    fn glossy(
        &self,
        py: Python<'_>,
        material: PyReadonlyArray1<'_, u32>,
        diffuse: Vec<bool>,
        lobes: Vec<Vec<OneLobe<'_>>>,
        eye: [f64; 3],
    ) -> PyResult<Receivers> {
        let Kind::Pixels { image, pixel, weight, background } = &self.kind else {
            return Err(Error::input("expected pixels for lobes that one eye sees, but these rows are vertices").into());
        };
        let material = to_vec(&material);
        let known = diffuse.len().min(lobes.len());
        if material.len() != self.points.len() || material.iter().any(|&own| own as usize >= known) {
            let rows = self.points.len();
            return Err(Error::input(format!("expected a material below {known} for each of {rows} rows")).into());
        }
        let mut models: Vec<LobeShape> = Vec::new();
        let mut number = |lobe: &OneLobe<'_>| {
            models.push(match lobe {
                OneLobe::Model(kind, parameters) => LobeShape::Model(Stored::new(*kind, parameters.clone())?),
                OneLobe::Measured(table, channel) => {
                    LobeShape::Measured(Arc::new(Colour::new(Arc::clone(&table.get().table), *channel)?))
                }
            });
            numbered(models.len())
        };
        let of_material = lobes.iter().map(|own| own.iter().map(&mut number).collect::<Result<Vec<u16>>>());
        let of_material = of_material.collect::<Result<Vec<_>>>()?;
        // Which row each new one comes of, and its lobe: first all without, then all with.
        let plain = (0..material.len()).filter(|&row| diffuse[material[row] as usize]).map(|row| (row, None));
        let shiny = (0..material.len()).flat_map(|row| {
            let own = &of_material[material[row] as usize];
            own.iter().enumerate().map(move |(place, &model)| (row, Some((place, model))))
        });
        let all: Vec<(usize, Option<(usize, u16)>)> = plain.chain(shiny).collect();
        let points = self.points.some(all.iter().map(|&(row, _)| row));
        let to_eye = self.eyes(eye);
        let of_row = all.iter().map(|(_, lobe)| lobe.map_or(DIFFUSE, |(_, model)| model)).collect();
        let eyes = all.iter().map(|&(row, _)| to_eye[row]).collect();
        let turns: Vec<[f32; 2]> = all.iter().filter_map(|&(row, _)| self.turns.get(row).copied()).collect();
        let lobes = Arc::new(compute(py, || Lobes::turned(models, of_row, eyes, &points.normal, turns))?);
        let picked = |items: &[u32]| all.iter().map(|&(row, _)| items[row]).collect::<Vec<u32>>();
        Ok(Receivers {
            position: all.iter().map(|&(row, _)| self.position[row]).collect(),
            triangle: picked(&self.triangle),
            barycentric: all.iter().map(|&(row, _)| self.barycentric[row]).collect(),
            back: all.iter().map(|&(row, _)| self.back[row]).collect(),
            lobes,
            lobe: all.iter().map(|(_, lobe)| lobe.map_or(-1, |(place, _)| place as i32)).collect(),
            base: (0..all.len() as u32).collect(),
            turns: Vec::new(),
            points: Arc::new(points),
            rays: self.rays,
            kind: Kind::Pixels {
                image: *image,
                pixel: picked(pixel),
                weight: all.iter().map(|&(row, _)| weight[row]).collect(),
                background: background.clone(),
            },
        })
    }

    /// Of each row the row of the same vertex that is diffuse, or itself, (rows,) uint32.
    #[getter]
    fn base(&self, py: Python<'_>) -> Py<PyArray1<u32>> {
        PyArray1::from_slice(py, &self.base).unbind()
    }

    /// The rows of vertices with the factors of their materials behind them: material after material, in bundles of its
    /// vertices factor after factor. material: (rows,) uint32; factors: for each material tables of float32, (factors, rings, columns);
    /// turns: as of `shaded`, of the rows of vertices.
    #[pyo3(signature = (material, factors, turns = None))]
    fn factored(
        &self,
        py: Python<'_>,
        material: PyReadonlyArray1<'_, u32>,
        factors: Vec<PyReadonlyArray3<'_, f32>>,
        turns: Option<PyReadonlyArray2<'_, f32>>,
    ) -> PyResult<Receivers> {
        let rows = self.vertices()?;
        let own: Vec<[f32; 2]> = turns.map(|turns| vectors("turns", &turns)).transpose()?.unwrap_or_default();
        let material = to_vec(&material);
        if material.len() != rows.len() || material.iter().any(|&own| own as usize >= factors.len()) {
            let (known, rows) = (factors.len(), rows.len());
            return Err(Error::input(format!("expected a material below {known} for each of {rows} rows")).into());
        }
        let mut models: Vec<LobeShape> = Vec::new();
        let mut all: Vec<(usize, i32, u16)> = (0..rows.len()).map(|row| (row, -1, DIFFUSE)).collect();
        for (number, tables) in factors.iter().enumerate() {
            let [count, rings, columns] = tables.as_array().shape().try_into().unwrap_or([0; 3]);
            let first = models.len();
            for table in tables.as_array().outer_iter().take(count) {
                let table = Factor::new(rings, columns, table.iter().copied().collect())?;
                models.push(LobeShape::Factor(Arc::new(table)));
                numbered(models.len())?;
            }
            let own: Vec<usize> = (0..rows.len()).filter(|&row| material[row] as usize == number).collect();
            // All factors of a bundle's vertices one after the other: what they see is traced once.
            for bundle in own.chunks(BUNDLE_ROWS) {
                let of = |place: usize| bundle.iter().map(move |&row| (row, place as i32, (first + place) as u16));
                all.extend((0..count).flat_map(of));
            }
        }
        let points = Arc::new(self.points.some(all.iter().map(|&(row, ..)| row)));
        let of_row = all.iter().map(|&(_, _, model)| model).collect();
        let eyes = vec![[0.0, 0.0, 1.0]; all.len()];
        let turns: Vec<[f32; 2]> = all.iter().filter_map(|&(row, ..)| own.get(row).copied()).collect();
        fn picked<T: Copy>(all: &[(usize, i32, u16)], items: &[T]) -> Vec<T> {
            all.iter().map(|&(row, ..)| items[row]).collect()
        }
        Ok(Receivers {
            position: picked(&all, &self.position),
            triangle: picked(&all, &self.triangle),
            barycentric: picked(&all, &self.barycentric),
            back: picked(&all, &self.back),
            lobes: Arc::new(compute(py, || Lobes::turned(models, of_row, eyes, &points.normal, turns))?),
            lobe: all.iter().map(|&(_, place, _)| place).collect(),
            turns: Vec::new(),
            base: all.iter().map(|&(row, ..)| row as u32).collect(),
            rays: self.rays,
            kind: Kind::Vertices(Vertices {
                points: Arc::clone(&points),
                // Nodes lie around vertices, however many factors those have.
                places: rows.places.clone(),
                vertex: picked(&all, &rows.vertex),
                buried: picked(&all, &rows.buried),
                shown: rows.shown.clone(),
                corners: rows.corners.clone(),
                open: rows.open.clone(),
            }),
            points,
        })
    }

    /// Pixels in which nothing is seen; 0 of vertices.
    #[getter]
    fn unseen(&self) -> usize {
        match &self.kind {
            Kind::Pixels { background, .. } => background.iter().filter(|&&share| share == 1.0).count(),
            Kind::Vertices(_) => 0,
        }
    }

    /// The user's number of each row's triangle, (rows,) uint32.
    #[getter]
    fn triangle(&self, py: Python<'_>) -> Py<PyArray1<u32>> {
        PyArray1::from_slice(py, &self.triangle).unbind()
    }

    /// Weights of the triangle's corners 1 and 2 at the point, (rows, 2) float32.
    #[getter]
    fn barycentric(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f32>>> {
        rows_of(py, &self.barycentric)
    }

    /// Whether each row is on the back of its triangle, (rows,) bool.
    #[getter]
    fn back(&self, py: Python<'_>) -> Py<PyArray1<bool>> {
        PyArray1::from_slice(py, &self.back).unbind()
    }

    /// Of vertices: the rows of each of the user's triangles, in front and then behind, (t, 6) uint32; the largest number
    /// where there is none.
    #[getter]
    fn corners(&self, py: Python<'_>) -> PyResult<Py<PyArray2<u32>>> {
        let corners: Vec<[u32; 6]> =
            self.vertices()?.corners.iter().map(|[a, b]| [a[0], a[1], a[2], b[0], b[1], b[2]]).collect();
        rows_of(py, &corners)
    }

    /// Of vertices: the row whose light each row shows, (rows,) uint32; of what lies inside something another one.
    #[getter]
    fn shown(&self, py: Python<'_>) -> PyResult<Py<PyArray1<u32>>> {
        Ok(PyArray1::from_slice(py, &self.vertices()?.shown).unbind())
    }

    /// What a response at vertices, (vertices, 3) float32, is at these rows: (rows, 3). `corners`: the rows of that response
    /// that each of the user's triangles takes in front and behind, (t, 6) uint32.
    fn interpolated<'py>(
        &self,
        py: Python<'py>,
        corners: PyReadonlyArray2<'py, u32>,
        response: PyReadonlyArray2<'py, f32>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let response = vectors::<_, 3>("a response", &response)?;
        let corners = corners.as_slice()?.to_vec();
        let out = compute(py, || {
            let mut out = vec![[0f32; 3]; self.triangle.len()];
            out.par_iter_mut().enumerate().try_for_each(|(k, out)| {
                let (triangle, [b1, b2]) = (self.triangle[k], self.barycentric[k]);
                let refusal = || Error::input(format!("expected rows for the corners of triangle {triangle}"));
                let first = 6 * triangle as usize + if self.back[k] { 3 } else { 0 };
                let own = corners.get(first..first + 3).ok_or_else(refusal)?;
                for (&row, weight) in own.iter().zip([1.0 - b1 - b2, b1, b2]) {
                    let value = response.get(row as usize).ok_or_else(refusal)?;
                    (0..3).for_each(|k| out[k] += weight * value[k]);
                }
                Ok::<_, Error>(())
            })?;
            Ok(out)
        })?;
        rows(py, (out.len(), 3), out.into_flattened())
    }

    /// Rows that lie inside something and see nothing.
    #[getter]
    fn buried(&self) -> usize {
        self.vertices().map_or(0, |rows| {
            let own = rows.buried.iter().zip(&self.lobe).filter(|(buried, lobe)| **buried && **lobe < 0);
            own.count()
        })
    }

    /// The rows of a transport: with what the materials say of each, albedo (rows, 3) float32 and material (rows,) uint16,
    /// and with their lobes, where `texels` are columns that may be made of them.
    #[pyo3(signature = (albedo, material, texels = false))]
    fn table(
        &self,
        albedo: PyReadonlyArray2<'_, f32>,
        material: PyReadonlyArray1<'_, u16>,
        texels: bool,
    ) -> PyResult<ReceiverTable> {
        let kind = match &self.kind {
            Kind::Pixels { image, pixel, weight, background } => ReceiverKind::Pixels {
                image: *image,
                pixel: pixel.clone().into(),
                weight: weight.clone().into(),
                background: background.clone().into(),
            },
            Kind::Vertices(rows) => ReceiverKind::Vertices {
                vertex: rows.vertex.clone().into(),
                buried: rows.buried.iter().map(|&buried| u8::from(buried)).collect::<Vec<_>>().into(),
            },
        };
        Ok(ReceiverTable::checked(Table {
            albedo: to_vec_of_rows("albedo", &albedo, self.points.len())?.into(),
            position: self.position.as_flattened().to_vec().into(),
            normal: self.points.normal.as_flattened().to_vec().into(),
            material: Some(to_vec(&material).into()),
            lobes: self.lobes.of_texels().filter(|_| texels),
            kind,
        })?)
    }
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Camera>()?;
    module.add_class::<Receivers>()
}
