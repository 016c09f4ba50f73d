//! Bindings of `brdf`: models by their names and measured tables, asked with rows of unit directions.

use std::sync::Arc;

use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::brdf::measured::{MERL, Measured as Colours, Merl, Rgl, RglTables};
use crate::brdf::{
    AshikhminShirley, Beckmann, BlinnPhong, Brdf as Model, CookTorrance, Direction, Fresnel, Ggx, Lafortune, Lambert,
    Ward, WardDuer, phong,
};
use crate::error::{Error, Result};

use super::arrays::{table, to_vec, triples, vectors};
use super::{compute, interruptible};

/// Directions that one thread takes at a time: less would cost more than they do.
const TOGETHER: usize = 256;

/// A model of reflectance; see `deltalux.brdf`.
#[pyclass(frozen, module = "deltalux._core")]
pub(crate) struct Brdf {
    /// The model, its parameters checked.
    pub(super) model: Arc<dyn Model>,
}

impl Brdf {
    /// What a constructor made.
    fn of(model: Result<impl Model + 'static>) -> PyResult<Brdf> {
        Ok(Brdf { model: Arc::new(model?) })
    }
}

/// Refuses arrays of different lengths.
fn pairs(wi: &PyReadonlyArray2<'_, f64>, wo: &PyReadonlyArray2<'_, f64>) -> Result<(Vec<Direction>, Vec<Direction>)> {
    let (wi, wo) = (triples("wi", wi)?, triples("wo", wo)?);
    // Numbers, or colours.
    Error::unless_room::<[f64; 3]>(wi.len())?;
    match wi.len() == wo.len() {
        true => Ok((wi, wo)),
        false => Err(Error::input(format!("expected as many wi as wo, got {} and {}", wi.len(), wo.len()))),
    }
}

/// One value for each pair of directions, by as many threads as there are.
fn each<T: Send>(
    wi: &[Direction],
    wo: &[Direction],
    value: impl Fn(Direction, Direction) -> T + Sync + Send,
) -> Vec<T> {
    wi.par_iter().zip(wo).with_min_len(TOGETHER).map(|(&wi, &wo)| value(wi, wo)).collect()
}

/// Directions and their densities.
type Samples<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>);

/// `Brdf.pdf`
fn densities<'py>(
    py: Python<'py>,
    model: &dyn Model,
    wi: &PyReadonlyArray2<'py, f64>,
    wo: &PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (wi, wo) = pairs(wi, wo)?;
    Ok(compute(py, || Ok(each(&wi, &wo, |wi, wo| model.pdf(wi, wo))))?.into_pyarray(py))
}

/// `Brdf.sample`
fn samples<'py>(
    py: Python<'py>,
    model: &dyn Model,
    wo: &PyReadonlyArray2<'py, f64>,
    u: &PyReadonlyArray2<'py, f64>,
) -> PyResult<Samples<'py>> {
    let wo = triples("wo", wo)?;
    Error::unless_room::<[f64; 6]>(wo.len())?;
    let numbers = match u.as_slice() {
        Ok(flat) if u.shape() == [wo.len(), 2] => flat.as_chunks::<2>().0.to_vec(),
        _ => {
            let message = format!("expected u of shape ({}, 2) in C order, got shape {:?}", wo.len(), u.shape());
            return Err(Error::input(message).into());
        }
    };
    let (wi, pdf): (Vec<_>, Vec<_>) = compute(py, || {
        let sampled = wo.par_iter().zip(&numbers).with_min_len(TOGETHER);
        Ok(sampled.map(|(&wo, &u)| model.sample(wo, u).unwrap_or_default()).unzip())
    })?;
    Ok((table(py, wi)?, pdf.into_pyarray(py)))
}

/// Long work on each of some directions.
fn of_all<T: Send>(py: Python<'_>, wo: &[Direction], value: impl Fn(Direction) -> T + Sync + Send) -> PyResult<Vec<T>> {
    interruptible(py, None, |watch| {
        wo.par_iter().map(|&wo| watch.advance(1).map(|()| value(wo))).collect::<Result<Vec<T>>>()
    })
}

#[pymethods]
impl Brdf {
    #[staticmethod]
    fn lambert() -> PyResult<Brdf> {
        Brdf::of(Ok(Lambert))
    }

    #[staticmethod]
    fn phong(exponent: f64) -> PyResult<Brdf> {
        Brdf::of(phong(exponent))
    }

    #[staticmethod]
    fn blinn_phong(exponent: f64) -> PyResult<Brdf> {
        Brdf::of(BlinnPhong::new(exponent))
    }

    #[staticmethod]
    fn ward(alpha: f64, alpha_v: f64) -> PyResult<Brdf> {
        Brdf::of(Ward::new([alpha, alpha_v]))
    }

    #[staticmethod]
    fn ward_duer(alpha: f64, alpha_v: f64) -> PyResult<Brdf> {
        Brdf::of(WardDuer::new([alpha, alpha_v]))
    }

    #[staticmethod]
    fn lafortune(exponent: f64, coefficients: [f64; 3]) -> PyResult<Brdf> {
        Brdf::of(Lafortune::new(exponent, coefficients))
    }

    #[staticmethod]
    #[pyo3(signature = (sigma, n, k))]
    fn cook_torrance(sigma: f64, n: Option<f64>, k: Option<f64>) -> PyResult<Brdf> {
        Brdf::of(CookTorrance::new(sigma, Fresnel::of(n, k, None)?))
    }

    #[staticmethod]
    #[pyo3(signature = (alpha, alpha_v, n, k))]
    fn beckmann(alpha: f64, alpha_v: f64, n: Option<f64>, k: Option<f64>) -> PyResult<Brdf> {
        Brdf::of(Beckmann::new([alpha, alpha_v], Fresnel::of(n, k, None)?))
    }

    #[staticmethod]
    #[pyo3(signature = (alpha, alpha_v, n, k))]
    fn ggx(alpha: f64, alpha_v: f64, n: Option<f64>, k: Option<f64>) -> PyResult<Brdf> {
        Brdf::of(Ggx::new([alpha, alpha_v], Fresnel::of(n, k, None)?))
    }

    #[staticmethod]
    #[pyo3(signature = (exponent, exponent_v, n, k, f0))]
    fn ashikhmin_shirley(
        exponent: f64,
        exponent_v: f64,
        n: Option<f64>,
        k: Option<f64>,
        f0: Option<f64>,
    ) -> PyResult<Brdf> {
        Brdf::of(AshikhminShirley::new([exponent, exponent_v], Fresnel::of(n, k, f0)?))
    }

    /// The lobe as a curve at abscissas (n,): (n,) float64; refuses models without one.
    fn curve<'py>(
        &self,
        py: Python<'py>,
        abscissas: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let curved = self.model.curved();
        let curved =
            curved.ok_or_else(|| Error::input(format!("expected a model with a lobe, got {:?}", self.model)))?;
        Ok(PyArray1::from_iter(py, abscissas.as_array().iter().map(|&u| curved.curve(u))))
    }

    /// f of wi (n, 3) and wo (n, 3): (n,) float64.
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        wi: PyReadonlyArray2<'py, f64>,
        wo: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (wi, wo) = pairs(&wi, &wo)?;
        Ok(compute(py, || Ok(each(&wi, &wo, |wi, wo| self.model.evaluate(wi, wo))))?.into_pyarray(py))
    }

    /// The density of wi (n, 3) for wo (n, 3): (n,) float64.
    fn pdf<'py>(
        &self,
        py: Python<'py>,
        wi: PyReadonlyArray2<'py, f64>,
        wo: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        densities(py, &*self.model, &wi, &wo)
    }

    /// Directions (n, 3) for wo (n, 3) from numbers (n, 2), and their densities (n,): 0 and 0 where there is none.
    fn sample<'py>(
        &self,
        py: Python<'py>,
        wo: PyReadonlyArray2<'py, f64>,
        u: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Samples<'py>> {
        samples(py, &*self.model, &wo, &u)
    }

    /// Directional albedos of wo (n, 3): (n,) float64.
    fn albedo<'py>(&self, py: Python<'py>, wo: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(of_all(py, &triples("wo", &wo)?, |wo| self.model.albedo(wo))?.into_pyarray(py))
    }
}

/// A measured material; see `deltalux.brdf.Measured`.
#[pyclass(frozen, module = "deltalux._core")]
pub(crate) struct Measured {
    /// Its table, checked.
    pub(super) table: Arc<dyn Colours>,
}

/// A table of a file with its last two lengths.
type Table<'py> = (PyReadonlyArray1<'py, f32>, [usize; 2]);

#[pymethods]
impl Measured {
    /// The colours of MERL's cells, (90 * 90 * 180, 3) float32.
    #[staticmethod]
    fn merl(cells: PyReadonlyArray2<'_, f32>) -> PyResult<Measured> {
        Ok(Measured { table: Arc::new(Merl::new(vectors("cells", &cells)?)?) })
    }

    /// The tables of a file of EPFL's, flat, by its own names.
    #[staticmethod]
    #[pyo3(signature = (*, phi_i, theta_i, ndf, sigma, vndf, luminance, rgb, jacobian))]
    #[allow(clippy::too_many_arguments, reason = "they are the fields of the file")]
    fn rgl(
        phi_i: PyReadonlyArray1<'_, f32>,
        theta_i: PyReadonlyArray1<'_, f32>,
        ndf: Table<'_>,
        sigma: Table<'_>,
        vndf: Table<'_>,
        luminance: Table<'_>,
        rgb: Table<'_>,
        jacobian: bool,
    ) -> PyResult<Measured> {
        let flat = |array: &PyReadonlyArray1<'_, f32>| to_vec(array);
        let [phi, theta] = [flat(&phi_i), flat(&theta_i)];
        let [n, s, v, l, r] = [&ndf, &sigma, &vndf, &luminance, &rgb].map(|table| (flat(&table.0), table.1));
        let table = Rgl::new(&RglTables {
            phi_i: &phi,
            theta_i: &theta,
            ndf: (&n.0, n.1),
            sigma: (&s.0, s.1),
            vndf: (&v.0, v.1),
            luminance: (&l.0, l.1),
            rgb: (&r.0, r.1),
            jacobian,
        })?;
        Ok(Measured { table: Arc::new(table) })
    }

    /// f of wi (n, 3) and wo (n, 3) in linear RGB: (n, 3) float64.
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        wi: PyReadonlyArray2<'py, f64>,
        wo: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (wi, wo) = pairs(&wi, &wo)?;
        table(py, compute(py, || Ok(each(&wi, &wo, |wi, wo| self.table.colour(wi, wo))))?)
    }

    /// The density of wi (n, 3) for wo (n, 3): (n,) float64.
    fn pdf<'py>(
        &self,
        py: Python<'py>,
        wi: PyReadonlyArray2<'py, f64>,
        wo: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        densities(py, &*self.table, &wi, &wo)
    }

    /// Directions (n, 3) for wo (n, 3) from numbers (n, 2), and their densities (n,): 0 and 0 where there is none.
    fn sample<'py>(
        &self,
        py: Python<'py>,
        wo: PyReadonlyArray2<'py, f64>,
        u: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Samples<'py>> {
        samples(py, &*self.table, &wo, &u)
    }

    /// Directional albedos of wo (n, 3) in linear RGB: (n, 3) float64.
    fn albedo<'py>(&self, py: Python<'py>, wo: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        table(py, of_all(py, &triples("wo", &wo)?, |wo| self.table.albedos(wo))?)
    }
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("MERL", MERL)?;
    module.add_class::<Measured>()?;
    module.add_class::<Brdf>()
}
