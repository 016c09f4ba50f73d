//! Light between surfaces for Python: nodes, what is between them, their links to receivers, and their rows.

use std::sync::Arc;

use numpy::{PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::error::Error;
use crate::precompute::{self as core, FormFactors, Gathering, Interreflection, NodePass, Pass, form_factors, tile};
use crate::scene::{CELL, Camera, Nodes as Placed, Spacing};
use crate::transport::entry::Channels;
use crate::transport::{MAX_TILE_ROWS, Tile, Truncation};

use super::arrays::{rows_of, to_vec_of_rows};
use super::interruptible;
use super::pieces::{Link, TileData};
use super::scene::{Receivers, Scene};

/// Nodes of a scene.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct Nodes {
    placed: Arc<Placed>,
    /// The user's numbers of the triangles of all cells' points.
    source: Vec<u32>,
    /// Their weights of corners 1 and 2.
    barycentric: Vec<[f32; 2]>,
}

#[pymethods]
impl Nodes {
    /// Places nodes where a camera sees surfaces and where those see others: at `share` of the distance to other surfaces,
    /// at most `cap` of them.
    #[staticmethod]
    #[pyo3(signature = (scene, *, position, right, up, forward, half_height, width, height, share, cap))]
    #[allow(clippy::too_many_arguments)]
    fn place(
        py: Python<'_>,
        scene: &Bound<'_, Scene>,
        position: [f64; 3],
        right: [f64; 3],
        up: [f64; 3],
        forward: [f64; 3],
        half_height: f64,
        width: usize,
        height: usize,
        share: f64,
        cap: usize,
    ) -> PyResult<Nodes> {
        let camera = Camera { position, right, up, forward, half_height, width, height };
        let scene = scene.get();
        let placed = interruptible(py, None, |watch| {
            camera.check()?;
            Placed::place(scene.surfaces(), &camera, Spacing { share, cap }, &|| watch.advance(1))
        })?;
        let points = || placed.cells.iter().flatten();
        let source = points().map(|point| scene.source(point.triangle)).collect();
        let barycentric = points().map(|point| point.barycentric).collect();
        Ok(Nodes { source, barycentric, placed: Arc::new(placed) })
    }

    /// How many there are.
    fn __len__(&self) -> usize {
        self.placed.len()
    }

    /// Points of each node's cell.
    #[classattr]
    const CELL: usize = CELL;

    /// Rays shot to place them.
    #[getter]
    fn rays(&self) -> u64 {
        self.placed.rays
    }

    /// The user's number of the triangle of each point of each cell, (4 nodes,) uint32.
    #[getter]
    fn triangle(&self, py: Python<'_>) -> Py<PyArray1<u32>> {
        PyArray1::from_slice(py, &self.source).unbind()
    }

    /// Weights of the triangle's corners 1 and 2 at each point, (4 nodes, 2) float32.
    #[getter]
    fn barycentric(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f32>>> {
        rows_of(py, &self.barycentric)
    }
}

/// What is between nodes of known albedo, and between them and receivers.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct Bounces {
    placed: Arc<Placed>,
    albedo: Vec<[f32; 3]>,
    factors: FormFactors,
    channels: Channels,
}

impl Bounces {
    /// The mean of a node's colours.
    fn mean(&self, node: usize) -> f64 {
        self.albedo[node].iter().map(|&x| f64::from(x)).sum::<f64>() / 3.0
    }

    fn interreflection<'a>(&'a self, links: &'a core::Links) -> Interreflection<'a> {
        let core::Links { radiant, checks, .. } = links;
        Interreflection {
            factors: &self.factors.counts,
            albedo: &self.albedo,
            radiant,
            checks,
            channels: self.channels,
        }
    }
}

/// The thresholds of the nodes' rows, and of the direct rows that bounce, in those of the receivers: nodes are few, and what
/// they lose is seen by many. With equal ones Cornell's indirect light loses 1.1 % under the hall.
const INDIRECT: f64 = 0.3;
const DIRECT: f64 = 0.1;
/// Colours that differ by less are one.
const GREY: f32 = 1.0 / 1024.0;

/// One where all albedos are grey.
fn channels_of(albedo: &[[f32; 3]]) -> Channels {
    let grey = |rho: &[f32; 3]| {
        let (low, high) = rho.iter().fold((f32::MAX, f32::MIN), |(low, high), &x| (low.min(x), high.max(x)));
        high - low <= GREY
    };
    if albedo.iter().all(grey) { Channels::One } else { Channels::Three }
}

#[pymethods]
impl Bounces {
    /// Form factors by `side` x `side` rays a node; albedo: (nodes, 3) float32.
    #[new]
    #[pyo3(signature = (scene, nodes, albedo, *, side, progress = None))]
    fn new(
        py: Python<'_>,
        scene: &Bound<'_, Scene>,
        nodes: &Bound<'_, Nodes>,
        albedo: PyReadonlyArray2<'_, f32>,
        side: usize,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let (scene, placed) = (scene.get(), Arc::clone(&nodes.get().placed));
        let albedo = to_vec_of_rows("albedo", &albedo, placed.len())?;
        let albedo = albedo.as_chunks::<3>().0.to_vec();
        if albedo.as_flattened().iter().any(|rho| !(rho.is_finite() && *rho >= 0.0)) {
            return Err(Error::input("expected finite albedos of at least 0").into());
        }
        let channels = channels_of(&albedo);
        let factors = interruptible(py, progress, |watch| {
            form_factors(scene.surfaces(), &placed, side, &|done| watch.advance(done))
        })?;
        Ok(Bounces { placed, albedo, factors, channels })
    }

    /// How many channels bounces take between nodes of these albedos, (nodes, 3) float32: 3 where any is coloured, else 1.
    #[staticmethod]
    fn channels_of(albedo: PyReadonlyArray2<'_, f32>) -> PyResult<usize> {
        let rows = albedo.as_array().nrows();
        let albedo = to_vec_of_rows("albedo", &albedo, rows)?;
        Ok(channels_of(albedo.as_chunks().0).count())
    }

    /// The same of its own nodes.
    #[getter]
    fn channels(&self) -> usize {
        self.channels.count()
    }

    /// Rays shot, and those that met a surface for which no node speaks.
    #[getter]
    fn rays(&self) -> (u64, u64) {
        (u64::from(self.factors.counts.rays) * self.placed.len() as u64, self.factors.lost)
    }

    /// Links receivers to the nodes by `side` x `side` rays each; `audit`: the error of the albedo seen that makes a row
    /// gather.
    #[pyo3(signature = (scene, receivers, *, side, audit, progress = None))]
    fn links(
        &self,
        py: Python<'_>,
        scene: &Bound<'_, Scene>,
        receivers: &Bound<'_, Receivers>,
        side: usize,
        audit: f64,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Links> {
        let (scene, points) = (scene.get(), receivers.get().points());
        let albedo: Vec<f64> = (0..self.albedo.len()).map(|node| self.mean(node)).collect();
        let counts = &self.factors.counts;
        let seen: Vec<f64> =
            (0..counts.rows()).map(|row| counts.row(row).map(|(node, share)| share * albedo[node]).sum()).collect();
        let links = interruptible(py, progress, |watch| {
            let gathering = Gathering { side, audit };
            core::links(scene.surfaces(), &self.placed, &points, gathering, &albedo, &seen, &|done| watch.advance(done))
        })?;
        Ok(Links { links })
    }

    /// The nodes' rows: tiles, their rows, their quantum, and what solving took.
    ///
    /// `bounces`: how many, or None for all, to `residual`. `threshold`: of the receivers; nodes have finer ones.
    #[pyo3(signature = (
        scene, links, *, columns, edge_side, bounces, residual, threshold, quantum, width, progress = None
    ))]
    #[allow(clippy::too_many_arguments)]
    fn rows(
        &self,
        py: Python<'_>,
        scene: &Bound<'_, Scene>,
        links: &Links,
        columns: &str,
        edge_side: usize,
        bounces: Option<usize>,
        residual: f64,
        threshold: f64,
        quantum: i32,
        width: &str,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<NodeRows> {
        let space = columns.parse()?;
        let width = width.parse()?;
        let bounces = bounces.map_or(core::Bounces::All(residual), core::Bounces::Count);
        let tracer = scene.get().tracer();
        let (tiles, share, quantum, rays) = interruptible(py, progress, |watch| {
            let pass = NodePass::new(tracer, &self.placed, space, edge_side)?;
            let bands = pass.shape().bands.clone();
            let fine = Truncation::new(&bands, DIRECT * threshold, quantum, crate::transport::Width::I16)?;
            let (mut direct, mut rays): (Vec<Tile>, _) = (Vec::new(), core::Rays::default());
            for first in (0..self.placed.len()).step_by(MAX_TILE_ROWS) {
                let rows = first..self.placed.len().min(first + MAX_TILE_ROWS);
                let (made, shot) = tile(&pass, rows, std::slice::from_ref(&fine), &|rows| watch.advance(rows))?;
                direct.extend(made);
                rays = rays.plus(shot);
            }
            let between = self.interreflection(&links.links);
            let own = between.quantum(&direct, &bands, bounces, quantum)?;
            let rule = Truncation::new(&bands, INDIRECT * threshold, own, width)?;
            let (tiles, share) =
                between.solve(&direct, &bands, quantum, bounces, &rule, &|columns| watch.advance(columns))?;
            Ok((tiles, share, own, rays))
        })?;
        let rows = self.interreflection(&links.links).rows();
        Ok(NodeRows {
            tiles: tiles.into_iter().map(TileData).map(|tile| Py::new(py, tile)).collect::<PyResult<_>>()?,
            rows,
            tile_rows: core::bounces::TILE_ROWS,
            quantum,
            rays: rays.first + rays.edge,
            shares: share.bounces,
            products: share.products.into(),
            residual: share.residual,
            krylov: share.krylov,
            discretisation: share.discretisation,
        })
    }
}

/// The nodes' part of a transport.
#[pyclass(frozen, get_all, module = "deltalux._core")]
pub(super) struct NodeRows {
    /// One above the other.
    tiles: Vec<Py<TileData>>,
    /// Of all tiles.
    rows: usize,
    /// Of every tile but the last.
    tile_rows: usize,
    /// Of their values.
    quantum: i32,
    /// Shot for light that arrives directly at the nodes.
    rays: u64,
    /// Of each bounce, of the norm of all indirect light.
    shares: Vec<f64>,
    /// With F: the fewest, the median and the most of any column.
    products: (usize, usize, usize),
    /// That is proved; 0 where so many bounces were asked.
    residual: f64,
    /// Whether BiCGStab was needed.
    krylov: bool,
    /// Estimated at some receivers: the error of the indirect light that they take.
    discretisation: Vec<f64>,
}

/// How receivers take from nodes.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct Links {
    links: core::Links,
}

#[pymethods]
impl Links {
    /// As a product takes it.
    #[getter]
    fn link(&self) -> Link {
        Link(crate::transport::Link::Weights(Arc::new(self.links.weights.clone())))
    }

    /// Rows that gather: as too few nodes speak for them, as the audit found them wrong, and as they see few nodes.
    #[getter]
    fn gathering(&self) -> (usize, usize, usize) {
        (self.links.unspoken, self.links.audited, self.links.few)
    }

    /// Bytes.
    #[getter]
    fn nbytes(&self) -> usize {
        self.links.weights.nbytes()
    }

    /// Rays shot.
    #[getter]
    fn rays(&self) -> u64 {
        self.links.rays
    }
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Nodes>()?;
    module.add_class::<Bounces>()?;
    module.add_class::<NodeRows>()?;
    module.add_class::<Links>()
}
