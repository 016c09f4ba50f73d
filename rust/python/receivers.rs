//! What the rows of a transport are, for Python: made from a scene or from arrays, and read back.

use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::error::{Error, Result};
use crate::relight::display::{to_agx, to_display, to_half};
use crate::relight::shade::{Rows, resolve};
use crate::transport::{ReceiverKind, ReceiverTable as Table};

use super::arrays::{to_vec, to_vec_of_rows};
use super::compute;

/// The rows of a transport: surface points, and the pixels, vertices or samples that they stand for.
#[pyclass(frozen, module = "deltalux._core")]
pub(crate) struct ReceiverTable(pub(crate) Table);

impl ReceiverTable {
    /// Checks what was put together.
    pub(crate) fn checked(table: Table) -> Result<Self> {
        let rows = table.albedo.len() / 3;
        table.check(rows).map_err(Error::Input)?;
        Ok(ReceiverTable(table))
    }

    /// What all kinds share, checked together with what one kind adds.
    fn points(
        rows: usize,
        albedo: &PyReadonlyArray2<'_, f32>,
        position: &PyReadonlyArray2<'_, f32>,
        normal: &PyReadonlyArray2<'_, f32>,
        material: Option<&PyReadonlyArray1<'_, u16>>,
        kind: ReceiverKind,
    ) -> Result<Self> {
        Self::checked(Table {
            albedo: to_vec_of_rows("albedo", albedo, rows)?.into(),
            position: to_vec_of_rows("position", position, rows)?.into(),
            normal: to_vec_of_rows("normal", normal, rows)?.into(),
            material: material.map(|material| to_vec(material).into()),
            lobes: None,
            kind,
        })
    }

    /// The number of rows.
    fn rows(&self) -> usize {
        self.0.albedo.len() / 3
    }

    /// A copy of three numbers a row, (rows, 3).
    fn triples(&self, py: Python<'_>, items: &[f32]) -> PyResult<Py<PyArray2<f32>>> {
        Ok(PyArray1::from_slice(py, items).reshape([self.rows(), 3])?.unbind())
    }

    /// The refusal of a question that only makes sense of another kind.
    fn not_of_kind(&self, wanted: &str) -> PyErr {
        Error::input(format!("expected receivers of the kind {wanted:?}, but these are {:?}", self.0.kind.name()))
            .into()
    }
}

#[pymethods]
impl ReceiverTable {
    /// Samples of the pixels of an image (height, width): pixel (rows,) uint32, weight (rows,), albedo, position and
    /// normal (rows, 3), background (height * width,) float32, material (rows,) uint16.
    #[staticmethod]
    #[pyo3(signature = (*, image, pixel, weight, background, albedo, position, normal, material = None))]
    #[allow(clippy::too_many_arguments)]
    fn pixels(
        image: (usize, usize),
        pixel: PyReadonlyArray1<'_, u32>,
        weight: PyReadonlyArray1<'_, f32>,
        background: PyReadonlyArray1<'_, f32>,
        albedo: PyReadonlyArray2<'_, f32>,
        position: PyReadonlyArray2<'_, f32>,
        normal: PyReadonlyArray2<'_, f32>,
        material: Option<PyReadonlyArray1<'_, u16>>,
    ) -> PyResult<Self> {
        let (pixel, weight, background) = (to_vec(&pixel), to_vec(&weight), to_vec(&background));
        let rows = pixel.len();
        let kind = ReceiverKind::Pixels {
            image: [image.0, image.1],
            pixel: pixel.into(),
            weight: weight.into(),
            background: background.into(),
        };
        Ok(Self::points(rows, &albedo, &position, &normal, material.as_ref(), kind)?)
    }

    /// Vertices of a mesh: vertex (rows,) uint32, the number of each row's; buried (rows,) uint8, 1 where it sees nothing.
    #[staticmethod]
    #[pyo3(signature = (*, vertex, buried, albedo, position, normal, material = None))]
    fn vertices(
        vertex: PyReadonlyArray1<'_, u32>,
        buried: PyReadonlyArray1<'_, u8>,
        albedo: PyReadonlyArray2<'_, f32>,
        position: PyReadonlyArray2<'_, f32>,
        normal: PyReadonlyArray2<'_, f32>,
        material: Option<PyReadonlyArray1<'_, u16>>,
    ) -> PyResult<Self> {
        let (vertex, buried) = (to_vec(&vertex), to_vec(&buried));
        let rows = vertex.len();
        let kind = ReceiverKind::Vertices { vertex: vertex.into(), buried: buried.into() };
        Ok(Self::points(rows, &albedo, &position, &normal, material.as_ref(), kind)?)
    }

    /// Samples of surfaces in the order of their tree: area (rows,) float32.
    #[staticmethod]
    #[pyo3(signature = (*, area, albedo, position, normal, material = None))]
    fn gather(
        area: PyReadonlyArray1<'_, f32>,
        albedo: PyReadonlyArray2<'_, f32>,
        position: PyReadonlyArray2<'_, f32>,
        normal: PyReadonlyArray2<'_, f32>,
        material: Option<PyReadonlyArray1<'_, u16>>,
    ) -> PyResult<Self> {
        let area = to_vec(&area);
        let rows = area.len();
        let kind = ReceiverKind::Gather { area: area.into() };
        Ok(Self::points(rows, &albedo, &position, &normal, material.as_ref(), kind)?)
    }

    /// The same in another order: row k is what row `order[k]` was; order: (rows,) uint32.
    fn permuted(&self, order: PyReadonlyArray1<'_, u32>) -> PyResult<Self> {
        let (order, rows) = (to_vec(&order), self.rows());
        if order.iter().any(|&row| row as usize >= rows) {
            return Err(Error::input(format!("expected an order of rows below {rows}")).into());
        }
        Ok(Self::checked(self.0.permuted(&order))?)
    }

    /// The number of rows.
    fn __len__(&self) -> usize {
        self.rows()
    }

    /// "pixels", "vertices" or "gather".
    #[getter]
    fn kind(&self) -> &'static str {
        self.0.kind.name()
    }

    /// Bytes held.
    #[getter]
    fn nbytes(&self) -> usize {
        self.0.nbytes()
    }

    /// Diffuse reflectance, (rows, 3) float32.
    #[getter]
    fn albedo(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f32>>> {
        self.triples(py, &self.0.albedo)
    }

    /// World coordinates, (rows, 3) float32.
    #[getter]
    fn position(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f32>>> {
        self.triples(py, &self.0.position)
    }

    /// Normals, (rows, 3) float32.
    #[getter]
    fn normal(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f32>>> {
        self.triples(py, &self.0.normal)
    }

    /// The material of each row, (rows,) uint16, or None.
    #[getter]
    fn material(&self, py: Python<'_>) -> Option<Py<PyArray1<u16>>> {
        self.0.material.as_ref().map(|items| PyArray1::from_slice(py, items).unbind())
    }

    /// (height, width) of the image that pixels resolve into.
    #[getter]
    fn image_shape(&self) -> PyResult<(usize, usize)> {
        match self.0.kind {
            ReceiverKind::Pixels { image: [height, width], .. } => Ok((height, width)),
            _ => Err(self.not_of_kind("pixels")),
        }
    }

    /// The pixel of each row, (rows,) uint32.
    #[getter]
    fn pixel(&self, py: Python<'_>) -> PyResult<Py<PyArray1<u32>>> {
        match &self.0.kind {
            ReceiverKind::Pixels { pixel, .. } => Ok(PyArray1::from_slice(py, pixel).unbind()),
            _ => Err(self.not_of_kind("pixels")),
        }
    }

    /// The share of its pixel that each row is, (rows,) float32.
    #[getter]
    fn weight(&self, py: Python<'_>) -> PyResult<Py<PyArray1<f32>>> {
        match &self.0.kind {
            ReceiverKind::Pixels { weight, .. } => Ok(PyArray1::from_slice(py, weight).unbind()),
            _ => Err(self.not_of_kind("pixels")),
        }
    }

    /// The share of each pixel that sees no surface, (height, width) float32.
    #[getter]
    fn background(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f32>>> {
        match &self.0.kind {
            ReceiverKind::Pixels { image, background, .. } => {
                Ok(PyArray1::from_slice(py, background).reshape(*image)?.unbind())
            }
            _ => Err(self.not_of_kind("pixels")),
        }
    }

    /// The number of each row's vertex, (rows,) uint32.
    #[getter]
    fn vertex(&self, py: Python<'_>) -> PyResult<Py<PyArray1<u32>>> {
        match &self.0.kind {
            ReceiverKind::Vertices { vertex, .. } => Ok(PyArray1::from_slice(py, vertex).unbind()),
            _ => Err(self.not_of_kind("vertices")),
        }
    }

    /// 1 where a vertex sees nothing, (rows,) uint8.
    #[getter]
    fn buried(&self, py: Python<'_>) -> PyResult<Py<PyArray1<u8>>> {
        match &self.0.kind {
            ReceiverKind::Vertices { buried, .. } => Ok(PyArray1::from_slice(py, buried).unbind()),
            _ => Err(self.not_of_kind("vertices")),
        }
    }

    /// The area that each sample stands for, (rows,) float32.
    #[getter]
    fn area(&self, py: Python<'_>) -> PyResult<Py<PyArray1<f32>>> {
        match &self.0.kind {
            ReceiverKind::Gather { area } => Ok(PyArray1::from_slice(py, area).unbind()),
            _ => Err(self.not_of_kind("gather")),
        }
    }

    /// The picture of a response (rows, 3): (height, width, 3) float32, black where no surface is seen.
    fn resolve<'py>(&self, py: Python<'py>, values: PyReadonlyArray2<'py, f32>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let ReceiverKind::Pixels { image: [height, width], pixel, weight, .. } = &self.0.kind else {
            return Err(self.not_of_kind("pixels"));
        };
        let rows = self.0.albedo.len() / 3;
        if values.shape() != [rows, 3] {
            let found = values.shape();
            return Err(Error::input(format!("expected a response of shape ({rows}, 3), got {found:?}")).into());
        }
        let values = values.as_slice()?.to_vec();
        let mut picture = vec![0f32; 3 * height * width];
        py.detach(|| resolve(&Rows { pixel, weight, albedo: &self.0.albedo }, &values, &mut picture));
        picture.into_pyarray(py).reshape([*height, *width, 3])
    }
}

/// 8-bit sRGB of radiance times a scale, of any shape in C order.
#[pyfunction]
fn display<'py>(
    py: Python<'py>,
    radiance: PyReadonlyArray1<'py, f32>,
    scale: f32,
) -> PyResult<Bound<'py, PyArray1<u8>>> {
    let radiance = to_vec(&radiance);
    let shown = compute(py, || {
        let mut shown = vec![0; radiance.len()];
        to_display(&radiance, scale, &mut shown);
        Ok(shown)
    })?;
    Ok(shown.into_pyarray(py))
}

/// 8-bit sRGB of colours times a scale through AgX, of any shape in C order whose last axis has length 3.
#[pyfunction]
fn agx<'py>(py: Python<'py>, radiance: PyReadonlyArray1<'py, f32>, scale: f32) -> PyResult<Bound<'py, PyArray1<u8>>> {
    let (colours, []) = radiance.as_slice()?.as_chunks::<3>() else {
        return Err(Error::input("expected three numbers for each colour").into());
    };
    let shown = compute(py, || {
        let mut shown = vec![[0; 3]; colours.len()];
        to_agx(colours, scale, &mut shown);
        Ok(shown)
    })?;
    Ok(shown.into_flattened().into_pyarray(py))
}

/// Radiance in half floats as their bits, of any shape in C order; what is brighter than they can hold is their largest.
#[pyfunction]
fn half_floats<'py>(py: Python<'py>, radiance: PyReadonlyArray1<'py, f32>) -> PyResult<Bound<'py, PyArray1<u16>>> {
    let radiance = radiance.as_slice()?;
    let halves = compute(py, || {
        let mut halves = vec![0; radiance.len()];
        to_half(radiance, &mut halves);
        Ok(halves)
    })?;
    Ok(halves.into_pyarray(py))
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<ReceiverTable>()?;
    module.add_function(wrap_pyfunction!(display, module)?)?;
    module.add_function(wrap_pyfunction!(half_floats, module)?)?;
    module.add_function(wrap_pyfunction!(agx, module)?)
}
