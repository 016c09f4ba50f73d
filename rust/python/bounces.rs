//! Light between surfaces for Python: nodes, what is between them, their links to receivers, and their rows.

use std::sync::Arc;

use numpy::{PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::error::Error;
use crate::precompute::links::Check;
use crate::precompute::{
    self as core, DirectPass, FormFactors, Gathering, Interreflection, Lobes, NodePass, Pass, form_factors, tile,
};
use crate::scene::{self as core_scene, CELL, Node, Placed, Points, Spacing, Wanted};
use crate::transport::entry::Channels;
use crate::transport::{MAX_TILE_ROWS, Tile, Truncation};

use super::arrays::{rows_of, table, to_vec_of_rows};
use super::emission::Emitters;
use super::lamps::LitPoints;
use super::passing::{NodeFactors, NodeWeights};
use super::pieces::{Link, TileData};
use super::rows::{Camera, Receivers};
use super::scene::Scene;
use super::{compute, interruptible};

/// So many bounces, or all to a residual.
fn asked(bounces: Option<usize>, residual: f64) -> core::Bounces {
    bounces.map_or(core::Bounces::All(residual), core::Bounces::Count)
}

/// Nodes of a scene, just placed.
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
    /// Places nodes where a camera sees surfaces, or where there is none around the vertices that rows are; and where
    /// those see others: at `share` of the distance to other surfaces, at most `cap` of them.
    #[staticmethod]
    #[pyo3(signature = (scene, rows, camera, *, share, cap))]
    fn place(
        py: Python<'_>,
        scene: &Bound<'_, Scene>,
        rows: &Bound<'_, Receivers>,
        camera: &Bound<'_, Camera>,
        share: f64,
        cap: usize,
    ) -> PyResult<Nodes> {
        let (scene, rows, camera) = (scene.get(), rows.get(), camera.get());
        let wanted = rows.vertices().map_or(Wanted::Seen(&camera.0), Wanted::Everywhere);
        let placed = interruptible(py, None, |watch| {
            Placed::place(scene.surfaces(), wanted, Spacing { share, cap }, &|| watch.advance(1))
        })?;
        let points = || placed.cells.iter().flatten();
        let source = points().map(|point| scene.surfaces().mesh.source[point.triangle as usize]).collect();
        let barycentric = points().map(|point| point.barycentric).collect();
        Ok(Nodes { source, barycentric, placed: Arc::new(placed) })
    }

    /// How many there are.
    fn __len__(&self) -> usize {
        self.placed.nodes.len()
    }

    /// The points of all cells, one cell after the other.
    fn points(&self, scene: Py<Scene>) -> LitPoints {
        // Of one node at a time, so that its cell stays together.
        LitPoints::of(scene, self.placed.cell_points(1))
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

/// Nodes as receivers take from them: what is kept beside a transport, so that other views can.
#[pyclass(frozen, module = "deltalux._core")]
pub(super) struct Sources {
    nodes: core_scene::Nodes,
    /// The mean colour of each, and the mean albedo that its own rays meet.
    albedo: Vec<f64>,
    seen: Vec<f64>,
}

/// Who takes from nodes.
#[derive(FromPyObject)]
enum Taking<'py> {
    Rows(Bound<'py, Receivers>),
    Points(Bound<'py, LitPoints>),
}

impl Taking<'_> {
    /// Points, and the lobes that some take through.
    fn of(&self) -> (Arc<Points>, Arc<Lobes>) {
        match self {
            Taking::Rows(rows) => (rows.get().points(), rows.get().lobes()),
            Taking::Points(points) => (points.get().points(), Arc::default()),
        }
    }
}

/// Numbers of a node as they are kept: place, normal, origin, spacing, reach, albedo and what it sees.
const KEPT: usize = 13;

impl Sources {
    /// Of nodes that were placed, with the form factors between them.
    fn new(placed: &Placed, albedo: Vec<f64>, factors: &FormFactors) -> Self {
        let counts = &factors.counts;
        let of = |row: usize| counts.row(row).map(|(node, share)| share * albedo[node]).sum();
        let seen = (0..counts.rows()).map(of).collect();
        Sources { nodes: core_scene::Nodes::new(placed.nodes.nodes.clone()), albedo, seen }
    }
}

#[pymethods]
impl Sources {
    /// From what `kept` gave: (nodes, 13) float64.
    #[new]
    fn kept_before(py: Python<'_>, kept: PyReadonlyArray2<'_, f64>) -> PyResult<Self> {
        let kept = kept.as_array();
        if kept.ncols() != KEPT || kept.iter().any(|x| !x.is_finite()) {
            return Err(Error::input(format!("expected {KEPT} finite numbers a node, got {:?}", kept.shape())).into());
        }
        let rows: Vec<[f64; KEPT]> = kept.rows().into_iter().map(|row| std::array::from_fn(|k| row[k])).collect();
        compute(py, || {
            let three = |row: &[f64; KEPT], at: usize| [row[at], row[at + 1], row[at + 2]];
            let node = |row: &[f64; KEPT]| Node {
                place: three(row, 0),
                normal: three(row, 3),
                origin: three(row, 6),
                spacing: row[9],
                reach: row[10],
            };
            let nodes = core_scene::Nodes::new(rows.iter().map(node).collect());
            let of = |at: usize| rows.iter().map(|row| row[at]).collect();
            Ok(Sources { nodes, albedo: of(11), seen: of(12) })
        })
    }

    /// All that is known of them, (nodes, 13) float64, in the normalised scene.
    fn kept(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        let row = |(number, node): (usize, &Node)| {
            let Node { place, normal, origin, spacing, reach } = node;
            let mut row = [0.0; KEPT];
            row[..3].copy_from_slice(place);
            row[3..6].copy_from_slice(normal);
            row[6..9].copy_from_slice(origin);
            row[9..].copy_from_slice(&[*spacing, *reach, self.albedo[number], self.seen[number]]);
            row
        };
        let rows: Vec<[f64; KEPT]> = self.nodes.nodes.iter().enumerate().map(row).collect();
        rows_of(py, &rows)
    }

    /// How many there are.
    fn __len__(&self) -> usize {
        self.nodes.len()
    }

    /// Links receivers, or points by cosines, to the nodes by `side` x `side` rays each; `audit`: the error of the albedo seen that makes a row
    /// gather.
    #[pyo3(signature = (scene, receivers, *, side, audit, progress = None))]
    fn links(
        &self,
        py: Python<'_>,
        scene: &Bound<'_, Scene>,
        receivers: Taking<'_>,
        side: usize,
        audit: f64,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Links> {
        let (scene, (points, lobes)) = (scene.get(), receivers.of());
        let links = interruptible(py, progress, |watch| {
            let (gathering, advance) = (Gathering { side, audit }, |done| watch.advance(done));
            core::links(scene.surfaces(), &self.nodes, (&points, &lobes), gathering, &self.albedo, &self.seen, &advance)
        })?;
        Ok(Links { links })
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

    fn interreflection<'a>(&'a self, checks: &'a [Check], arriving: &'a [Tile]) -> Interreflection<'a> {
        Interreflection {
            factors: &self.factors.counts,
            albedo: &self.albedo,
            checks,
            arriving,
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
        let albedo = to_vec_of_rows("albedo", &albedo, placed.nodes.len())?;
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
        (u64::from(self.factors.counts.rays) * self.placed.nodes.len() as u64, self.factors.lost)
    }

    /// The nodes as receivers take from them.
    fn sources(&self) -> Sources {
        let albedo = (0..self.albedo.len()).map(|node| self.mean(node)).collect();
        Sources::new(&self.placed, albedo, &self.factors)
    }

    /// How light passes between them.
    fn factors(&self) -> NodeFactors {
        NodeFactors(self.factors.counts.clone())
    }

    /// What the nodes' rows are under the light of emitters, which does not move: (2 nodes, 3) float64, by twice `side` x
    /// `side` rays from each point of their cells; `bounces`, `residual`: as of `rows`.
    #[pyo3(signature = (scene, emitters, *, side, bounces, residual, progress = None))]
    #[allow(clippy::too_many_arguments)]
    fn emitted<'py>(
        &self,
        py: Python<'py>,
        scene: &Bound<'py, Scene>,
        emitters: &Bound<'py, Emitters>,
        side: usize,
        bounces: Option<usize>,
        residual: f64,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (scene, emitters) = (scene.get(), &emitters.get().0);
        let light = interruptible(py, progress, |watch| {
            let advance = |done| watch.advance(done);
            let direct = emitters.arriving_at_nodes(scene.surfaces(), &self.placed, side, &advance)?;
            self.interreflection(&[], &[]).still(&direct, asked(bounces, residual))
        })?;
        table(py, light)
    }

    /// The nodes' rows: tiles, their rows, their quantum, and what solving took.
    ///
    /// `bounces`: how many, or None for all, to `residual`. `threshold`: of the receivers; nodes have finer ones.
    #[pyo3(signature = (
        scene, receivers, links, *, columns, edge_side, bounces, residual, threshold, quantum, width, progress = None
    ))]
    #[allow(clippy::too_many_arguments)]
    fn rows(
        &self,
        py: Python<'_>,
        scene: &Bound<'_, Scene>,
        receivers: &Bound<'_, Receivers>,
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
        let bounces = asked(bounces, residual);
        let (tracer, receivers) = (scene.get().tracer(), receivers.get().points());
        let (rows, tiles, share, quantum, rays) = interruptible(py, progress, |watch| {
            let pass = NodePass::new(Arc::clone(&tracer), &self.placed, space, edge_side)?;
            let bands = pass.shape().bands.clone();
            let fine = Truncation::new(&bands, DIRECT * threshold, quantum, crate::transport::Width::I16)?;
            let (mut direct, mut rays): (Vec<Tile>, _) = (Vec::new(), core::Rays::default());
            for first in (0..self.placed.nodes.len()).step_by(MAX_TILE_ROWS) {
                let rows = first..self.placed.nodes.len().min(first + MAX_TILE_ROWS);
                let (made, shot) = tile(&pass, rows, std::slice::from_ref(&fine), &|rows| watch.advance(rows))?;
                direct.extend(made);
                rays = rays.plus(shot);
            }
            let checked = Arc::new(receivers.some(links.links.checks.iter().map(|check| check.receiver)));
            let looked = DirectPass::new(tracer, checked, Arc::default(), space, edge_side)?;
            let (arriving, shot) = tile(&looked, 0..looked.shape().rows, std::slice::from_ref(&fine), &|_| Ok(()))?;
            let rays = rays.plus(shot);
            let between = self.interreflection(&links.links.checks, &arriving);
            let own = between.quantum(&direct, &bands, bounces, quantum)?;
            let rule = Truncation::new(&bands, INDIRECT * threshold, own, width)?;
            let (tiles, share) =
                between.solve(&direct, &bands, quantum, bounces, &rule, &|columns| watch.advance(columns))?;
            Ok((between.rows(), tiles, share, own, rays))
        })?;
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

    /// Rows that gather: as too few nodes speak for them, as the audit found them wrong, as they see few nodes, and
    /// as they are glossy.
    #[getter]
    fn gathering(&self) -> (usize, usize, usize, usize) {
        (self.links.unspoken, self.links.audited, self.links.few, self.links.glossy)
    }

    /// What receivers take of a light of nodes' rows.
    #[getter]
    fn weights(&self) -> NodeWeights {
        NodeWeights(Arc::new(self.links.weights.clone()))
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
    module.add_class::<Sources>()?;
    module.add_class::<Bounces>()?;
    module.add_class::<NodeRows>()?;
    module.add_class::<Links>()
}
