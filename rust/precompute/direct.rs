//! The direct diffuse pass: T_p = V_p cos(theta_p) / pi * sqrt(dw_p) for every texel p, turned into Haar coefficients (or
//! into those of spherical harmonics: `projection.rs`).
//!
//! ```text
//!     B(x) = 1/pi Int L V cos dw = sum_p L_p sqrt(dw_p) * T_p        (Overbeck 2006, eq. 3.1; the albedo stays outside)
//! ```
//!
//! One ray to the centre of every texel above the horizon; where a texel and its neighbour differ, an edge of what the
//! receiver sees runs through one of them, and stratified rays measure how much of each is open. 64 neighbouring receivers
//! go together: every direction is one beam for all of them, and what they see is one bit each.

use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use crate::basis::{Bands, ColumnSpace};
use crate::error::{Error, Result};
use crate::scene::Receivers;
use crate::scene::rays::{BUNDLE, Bundle, Tracer, Walk};
use crate::transport::truncate::compress_group;
use crate::transport::{CompressedGroup, GROUP, Survey, Tile, Truncation, Width};

use super::projection::{Projection, Scratch};
use super::texels::Texels;

/// Rays that a pass has shot: what its time is measured against.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rays {
    /// To texel centres.
    pub first: u64,
    /// Into texels that an edge runs through.
    pub edge: u64,
}

impl Rays {
    fn plus(self, other: Rays) -> Rays {
        Rays { first: self.first + other.first, edge: self.edge + other.edge }
    }
}

/// The direct pass over some receivers of a scene.
pub struct DirectPass {
    tracer: Arc<Tracer>,
    receivers: Arc<Receivers>,
    texels: Texels,
    projection: Projection,
    bands: Bands,
    /// Edge texels are sampled `edge_side` x `edge_side` times; 0 takes the centre for the whole texel.
    edge_side: usize,
}

/// A texel that an edge runs through: for the receivers in `rows`, the mean of V cos over its samples.
struct EdgeTexel {
    texel: u32,
    rows: u64,
    mean: [f32; BUNDLE],
}

/// What a bundle of 64 receivers sees.
struct View {
    /// For each texel the receivers from which its centre is open, one bit each.
    open: Vec<u64>,
    edges: Vec<EdgeTexel>,
    rays: Rays,
}

/// Normals of a bundle, one component a list, so that a cosine is taken for all receivers at once.
struct Normals([[f32; BUNDLE]; 3]);

impl Normals {
    fn new(normals: &[[f32; 3]]) -> Self {
        // Places left over look away from everything: their cosine is never above zero.
        Normals(std::array::from_fn(|axis| std::array::from_fn(|ray| normals.get(ray).map_or(0.0, |n| n[axis]))))
    }

    fn cosines(&self, direction: [f32; 3], first: usize, cosines: &mut [f32]) {
        for (k, cosine) in cosines.iter_mut().enumerate() {
            let ray = first + k;
            *cosine = self.0[0][ray] * direction[0] + self.0[1][ray] * direction[1] + self.0[2][ray] * direction[2];
        }
    }

    /// Receivers that have a direction above their horizon.
    fn above(&self, direction: [f32; 3]) -> u64 {
        let mut cosines = [0.0; BUNDLE];
        self.cosines(direction, 0, &mut cosines);
        cosines.iter().enumerate().fold(0, |bits, (ray, &cosine)| bits | ((cosine > 0.0) as u64) << ray)
    }
}

/// Neighbouring directions that are traced together, and the answers.
#[derive(Default)]
struct Beams {
    directions: Vec<[f32; 3]>,
    active: Vec<u64>,
    blocked: Vec<u64>,
}

impl Beams {
    fn clear(&mut self) {
        self.directions.clear();
        self.active.clear();
    }

    fn push(&mut self, direction: [f32; 3], active: u64) {
        self.directions.push(direction);
        self.active.push(active);
    }

    /// Returns how many rays that were.
    fn trace(&mut self, tracer: &Tracer, bundle: &Bundle, walk: &mut Walk) -> u64 {
        self.blocked.clear();
        self.blocked.resize(self.directions.len(), 0);
        tracer.blocked_each(bundle, &self.directions, &self.active, walk, &mut self.blocked);
        self.active.iter().map(|active| u64::from(active.count_ones())).sum()
    }
}

/// Room for one bundle and one group of 16 rows, kept by each thread.
struct Room {
    walk: Walk,
    beams: Beams,
    texels: Scratch,
    coefficients: Vec<[f32; GROUP]>,
}

impl DirectPass {
    /// Refuses edge sampling that no texel needs.
    pub fn new(tracer: Arc<Tracer>, receivers: Arc<Receivers>, space: ColumnSpace, edge_side: usize) -> Result<Self> {
        if edge_side > MAX_EDGE_SIDE {
            return Err(Error::input(format!(
                "expected at most {MAX_EDGE_SIDE} x {MAX_EDGE_SIDE} rays for an edge texel, got {edge_side}"
            )));
        }
        let projection = Projection::new(space)?;
        let texels = Texels::new(projection.size());
        Ok(DirectPass { tracer, receivers, texels, projection, bands: space.bands(), edge_side })
    }

    pub fn bands(&self) -> &Bands {
        &self.bands
    }

    /// The tile of rows `first..first + rows`, truncated by a rule. `advance` hears of every bundle's rows and may stop
    /// the pass.
    pub fn tile(
        &self,
        first: usize,
        rows: usize,
        rule: &Truncation,
        advance: &(dyn Fn(u64) -> Result<()> + Sync),
    ) -> Result<(Tile, Rays)> {
        if rows == 0 || first + rows > self.receivers.len() {
            let count = self.receivers.len();
            return Err(Error::input(format!("expected a tile inside {count} rows, got {rows} rows from {first}")));
        }
        let bundles: Vec<(Vec<CompressedGroup>, Rays)> = (first..first + rows)
            .into_par_iter()
            .step_by(BUNDLE)
            .map_init(
                || self.room(),
                |room, start| {
                    let end = (start + BUNDLE).min(first + rows);
                    let view = self.view(start..end, room);
                    let groups = (0..(end - start).div_ceil(GROUP)).map(|group| {
                        self.transform(start..end, group, &view, room);
                        let mut out = CompressedGroup::default();
                        compress_group(&room.coefficients, &self.bands, rule, &mut out)?;
                        Ok(out)
                    });
                    let groups = groups.collect::<Result<Vec<_>>>()?;
                    advance((end - start) as u64)?;
                    Ok((groups, view.rays))
                },
            )
            .collect::<Result<_>>()?;
        let rays = bundles.iter().fold(Rays::default(), |sum, (_, rays)| sum.plus(*rays));
        let groups: Vec<CompressedGroup> = bundles.into_iter().flat_map(|(groups, _)| groups).collect();
        Ok((Tile::assemble(rows, self.bands.columns(), rule.width, &groups), rays))
    }

    /// Looks at evenly spread bundles before the pass: how large entries are, from which a threshold follows, and some of
    /// their groups untruncated (numbers of groups over all rows, and a tile of them) to measure truncation against.
    pub fn survey(
        &self,
        bundles: usize,
        quantum: i32,
        width: Width,
        advance: &(dyn Fn(u64) -> Result<()> + Sync),
    ) -> Result<(Survey, Vec<u32>, Tile)> {
        let total = self.receivers.len();
        let all = total.div_ceil(BUNDLE);
        let lossless = Truncation::new(&self.bands, 0.0, quantum, Width::I16)?;
        let looked: Vec<(Survey, u32, CompressedGroup)> = (0..bundles.min(all))
            .into_par_iter()
            .map_init(
                || self.room(),
                |room, k| {
                    let start = (2 * k + 1) * all / (2 * bundles.min(all)) * BUNDLE;
                    let rows = start..(start + BUNDLE).min(total);
                    let view = self.view(rows.clone(), room);
                    let mut survey = Survey::new(&self.bands, quantum, width)?;
                    let mut audit = CompressedGroup::default();
                    for group in 0..rows.len().div_ceil(GROUP) {
                        self.transform(rows.clone(), group, &view, room);
                        survey.add(&room.coefficients, &self.bands)?;
                        if group == 0 {
                            compress_group(&room.coefficients, &self.bands, &lossless, &mut audit)?;
                        }
                    }
                    advance(rows.len() as u64)?;
                    Ok((survey, (start / GROUP) as u32, audit))
                },
            )
            .collect::<Result<_>>()?;
        let mut survey = Survey::new(&self.bands, quantum, width)?;
        let (mut numbers, mut groups) = (Vec::new(), Vec::new());
        let (count, wanted) = (looked.len(), AUDIT_GROUPS.min(total / (GROUP * AUDIT_SHARE)));
        for (k, (part, number, group)) in looked.into_iter().enumerate() {
            survey.merge(&part);
            // A last group that is not full cannot stand among whole ones.
            if (k + 1) * wanted / count > k * wanted / count && (number as usize + 1) * GROUP <= total {
                numbers.push(number);
                groups.push(group);
            }
        }
        let tile = Tile::assemble(groups.len() * GROUP, self.bands.columns(), Width::I16, &groups);
        Ok((survey, numbers, tile))
    }

    fn room(&self) -> Room {
        Room {
            walk: Walk::default(),
            beams: Beams::default(),
            texels: self.projection.scratch(),
            coefficients: vec![[0.0; GROUP]; self.bands.columns()],
        }
    }

    /// Shoots the rays of one bundle.
    fn view(&self, rows: Range<usize>, room: &mut Room) -> View {
        let normals = Normals::new(&self.receivers.normal[rows.clone()]);
        let bundle = Bundle::new(&self.receivers.origin[rows.clone()], &self.receivers.normal[rows]);
        let count = self.texels.len();
        let mut view = View { open: vec![0; count], edges: Vec::new(), rays: Rays::default() };
        let above: Vec<u64> = self.texels.centre.iter().map(|&direction| normals.above(direction)).collect();
        room.walk.begin(&bundle);
        for block in &self.texels.blocks {
            room.beams.clear();
            for &texel in block {
                room.beams.push(self.texels.centre[texel as usize], above[texel as usize]);
            }
            view.rays.first += room.beams.trace(&self.tracer, &bundle, &mut room.walk);
            for (&texel, &blocked) in block.iter().zip(&room.beams.blocked) {
                view.open[texel as usize] = above[texel as usize] & !blocked;
            }
        }
        if self.edge_side > 0 {
            for block in &self.texels.blocks {
                self.edges(block, &above, &bundle, &normals, room, &mut view);
            }
        }
        view.edges.sort_unstable_by_key(|edge| edge.texel);
        view
    }

    /// Receivers that see this texel and a neighbour above the horizon differently.
    fn unlike_a_neighbour(&self, texel: usize, above: &[u64], open: &[u64]) -> u64 {
        self.texels.neighbours[texel].iter().fold(0, |unlike, &next| {
            let next = next as usize;
            unlike | (open[texel] ^ open[next]) & above[texel] & above[next]
        })
    }

    /// Measures the texels of a block that an edge runs through, all their samples in one go.
    fn edges(
        &self,
        block: &[u32],
        above: &[u64],
        bundle: &Bundle,
        normals: &Normals,
        room: &mut Room,
        view: &mut View,
    ) {
        let samples = self.edge_side * self.edge_side;
        let first = view.edges.len();
        room.beams.clear();
        for &texel in block {
            let rows = self.unlike_a_neighbour(texel as usize, above, &view.open);
            if rows != 0 {
                view.edges.push(EdgeTexel { texel, rows, mean: [0.0; BUNDLE] });
                for k in 0..samples {
                    let direction = self.texels.sample(texel as usize, self.edge_side, k);
                    room.beams.push(direction, rows & normals.above(direction));
                }
            }
        }
        view.rays.edge += room.beams.trace(&self.tracer, bundle, &mut room.walk);
        let mut cosines = [0.0f32; BUNDLE];
        for (beam, &direction) in room.beams.directions.iter().enumerate() {
            let open = room.beams.active[beam] & !room.beams.blocked[beam];
            normals.cosines(direction, 0, &mut cosines);
            for (ray, sum) in view.edges[first + beam / samples].mean.iter_mut().enumerate() {
                *sum += if open >> ray & 1 == 1 { cosines[ray] / samples as f32 } else { 0.0 };
            }
        }
    }

    /// The transport rows of 16 receivers of a bundle, as coefficients in `room.coefficients`.
    fn transform(&self, rows: Range<usize>, group: usize, view: &View, room: &mut Room) {
        let normals = Normals::new(&self.receivers.normal[rows]);
        let lanes = group * GROUP;
        let per_face = self.texels.len() / 6;
        let mut edges = view.edges.iter().peekable();
        for face in 0..6 {
            for (k, row) in self.projection.face(face, &mut room.texels).iter_mut().enumerate() {
                let texel = face * per_face + k;
                let open = view.open[texel] >> lanes;
                normals.cosines(self.texels.centre[texel], lanes, row);
                for (lane, value) in row.iter_mut().enumerate() {
                    *value = if open >> lane & 1 == 1 { *value } else { 0.0 };
                }
                if let Some(edge) = edges.next_if(|edge| edge.texel as usize == texel) {
                    for (lane, value) in row.iter_mut().enumerate() {
                        if edge.rows >> (lanes + lane) & 1 == 1 {
                            *value = edge.mean[lanes + lane];
                        }
                    }
                }
                let factor = self.projection.factor(k);
                for value in row.iter_mut() {
                    *value *= factor;
                }
            }
            self.projection.face_done(face, &mut room.texels, &mut room.coefficients);
        }
    }
}

/// Groups of 16 rows that a transport keeps untruncated: 512 rows, more than the 299 that bound the 99th percentile of the
/// error with 95 % confidence (0.99^299 = 0.0495).
const AUDIT_GROUPS: usize = 32;

/// At most one group in this many is kept: untruncated rows are some twenty times as long as the others.
const AUDIT_SHARE: usize = 64;

/// Most samples along a side of an edge texel.
const MAX_EDGE_SIDE: usize = 16;
