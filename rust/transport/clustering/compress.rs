//! From subspaces to two stored matrices: representatives truncated by one threshold, weights in eight bits, and what both
//! together are off from the rows, measured on what is stored.

use std::sync::Arc;

use rayon::prelude::*;

use crate::basis::{Bands, ColumnSpace};
use crate::error::Result;
use crate::transport::csr_rows::CsrRows;
use crate::transport::entry::{Channels, GROUP, Rows16, Width, bf16, bf16_up};
use crate::transport::matrix::TransportMatrix;
use crate::transport::row_norms::RowNorms;
use crate::transport::survey::Survey;
use crate::transport::tile::{CompressedGroup, Tile, Values};
use crate::transport::truncate::{Truncation, compress_group};

use super::assign::{Advance, Cluster, Clustering};

/// Weights are about 1, and integers times so much times the shift of their group.
const WEIGHT_QUANTUM: i32 = -12;
/// Rows of a tile: a stage of few rows is still work for several threads.
const FIRST_ROWS: usize = 2048;
const THEN_ROWS: usize = 8192;
/// Of norms, so that they stay above what was summed in f64.
const MARGIN: f64 = 1.0 + 1e-9;
/// What sums of up to 256 products lose at most, in the size of their terms.
const ROUNDING: f64 = 1.0 / (1u64 << 44) as f64;

/// The two stages, and what they stand for.
pub struct Clusters {
    /// The number of the source's row that each row is.
    pub order: Vec<u32>,
    /// The cluster of each row, ascending.
    pub labels: Vec<u32>,
    /// Means and representatives.
    pub first: TransportMatrix,
    /// Weights.
    pub then: TransportMatrix,
    /// Of the rows that both stand for.
    pub norms: RowNorms,
    /// Relative L2 error of the picture under the light prior, against the source: of the subspaces alone, and of all.
    pub error: [f64; 2],
}

/// A cluster's share of both matrices.
struct Scaled<'a> {
    cluster: &'a Cluster,
    /// What its mean and its representatives are multiplied by, and their weights divided.
    scales: Vec<f64>,
}

pub(super) fn compress(
    source: &TransportMatrix,
    rows: &CsrRows,
    clusters: Vec<Cluster>,
    asked: Clustering,
    advance: &Advance,
) -> Result<Clusters> {
    let each = asked.representatives;
    let space = ColumnSpace::representatives(clusters.len(), each)?;
    let share = rows.count() as f64 / clusters.len() as f64;
    let scaled: Vec<Scaled> = clusters.iter().map(|cluster| Scaled::new(cluster, share)).collect();
    let first = representatives(source, &scaled, &rows.weights, each, asked.tolerance)?;
    let order: Vec<u32> = clusters.iter().flat_map(|cluster| cluster.rows.iter().copied()).collect();
    let labels: Vec<u32> =
        clusters.iter().enumerate().flat_map(|(c, cluster)| vec![c as u32; cluster.rows.len()]).collect();
    let (then, left) = weights(rows, &scaled, &order, &labels, space)?;
    let (norms, lost) = row_norms(source, rows, &order, &first, &then, advance)?;
    let whole: f64 = (0..rows.count()).map(|row| rows.square(row)).sum();
    let error = [left, lost].map(|lost| if whole > 0.0 { (lost / whole).sqrt() } else { 0.0 });
    Ok(Clusters { order, labels, first, then, norms, error })
}

impl Scaled<'_> {
    /// `share`: rows of a cluster in the mean. What a column of W has for its norm is then the root of it, whichever it is.
    fn new(cluster: &Cluster, share: f64) -> Scaled<'_> {
        // A power of two: the weight of the mean is stored exactly.
        let of_mean = (cluster.rows.len() as f64 / share).sqrt().log2().round().exp2();
        let of_axes = cluster.subspace.held.iter().map(|held| (held / share).sqrt());
        Scaled { cluster, scales: [of_mean].into_iter().chain(of_axes).collect() }
    }

    /// Adds the mean (0) or a representative (from 1 on) to a lane; a cluster may have fewer than were asked.
    fn fill(&self, number: usize, lane: usize, weights: &[f64], plane: &mut [Rows16]) {
        let Some(&scale) = self.scales.get(number) else { return };
        let subspace = &self.cluster.subspace;
        for (at, &column) in self.cluster.support.iter().enumerate() {
            let value = if number == 0 { subspace.mean[at] } else { subspace.axes.row(at)[number - 1] };
            plane[column as usize][lane] = (value * scale / weights[column as usize]) as f32;
        }
    }
}

/// The first stage: as coarse as the tolerance allows.
fn representatives(
    source: &TransportMatrix,
    scaled: &[Scaled],
    weights: &[f64],
    each: usize,
    tolerance: f64,
) -> Result<TransportMatrix> {
    let width =
        if source.tiles.iter().any(|tile| matches!(tile.values, Values::I16(_))) { Width::I16 } else { Width::I8 };
    let count = scaled.len() * (1 + each);
    let fill = |group: usize, plane: &mut [Rows16]| {
        plane.fill([0.0; GROUP]);
        for row in group * GROUP..count.min((group + 1) * GROUP) {
            let (cluster, number) = match row.checked_sub(scaled.len()) {
                None => (row, 0),
                Some(axis) => (axis / each, 1 + axis % each),
            };
            scaled[cluster].fill(number, row % GROUP, weights, plane);
        }
    };
    let plane = || vec![[0.0; GROUP]; source.bands.stored()];
    let lossless = Truncation::new(&source.bands, 0.0, source.quantum, width)?;

    // The threshold from all groups, added up in their order.
    let mut survey = Survey::new(&source.bands, &lossless, Arc::default())?;
    let groups = (0..count.div_ceil(GROUP)).into_par_iter();
    let parts = groups.clone().map_init(plane, |plane, group| {
        fill(group, plane);
        let mut part = Survey::new(&source.bands, &lossless, Arc::default())?;
        part.add(&[plane]).map(|()| part)
    });
    parts.collect::<Result<Vec<_>>>()?.iter().for_each(|part| survey.merge(part));
    let threshold = survey.threshold_for(tolerance)?.value;

    let rule = Truncation::new(&source.bands, threshold, source.quantum, width)?;
    let groups = groups.map_init(plane, |plane, group| {
        fill(group, plane);
        compressed(plane, &source.bands, &rule)
    });
    Ok(matrix(source.space, count, FIRST_ROWS, &rule, &groups.collect::<Result<Vec<_>>>()?))
}

/// The second stage, and what the subspaces alone leave of all rows.
fn weights(
    rows: &CsrRows,
    scaled: &[Scaled],
    order: &[u32],
    labels: &[u32],
    space: ColumnSpace,
) -> Result<(TransportMatrix, f64)> {
    let (bands, columns, clusters) = (space.bands(), space.columns(), scaled.len());
    let each = columns / clusters - 1;
    let rule = Truncation::with_weights(vec![1.0; columns], 0, 0.0, WEIGHT_QUANTUM, Width::I8)?;
    let group = |plane: &mut Vec<Rows16>, (order, labels): (&[u32], &[u32])| {
        let (mut touched, mut left) = (Vec::new(), 0.0);
        for (lane, (&row, &label)) in order.iter().zip(labels).enumerate() {
            let (Scaled { cluster, scales }, number) = (&scaled[label as usize], label as usize);
            // Its own columns alone: those of the cluster's support.
            let own = rows.weighted(row as usize).map(|(column, value)| {
                let at = cluster.support.binary_search(&(column as u32)).expect("a cluster's support has its rows");
                (at, value)
            });
            let (along, rest) = cluster.subspace.coordinates(own);
            left += rest;
            plane[number][lane] = (1.0 / scales[0]) as f32;
            touched.push(number);
            for (k, (along, scale)) in along.iter().zip(&scales[1..]).enumerate() {
                let column = clusters + number * each + k;
                plane[column][lane] = (along / scale) as f32;
                touched.push(column);
            }
        }
        let group = compressed(plane, &bands, &rule);
        touched.into_iter().for_each(|column| plane[column] = [0.0; GROUP]);
        Ok((group?, left))
    };
    let pairs = order.par_chunks(GROUP).zip(labels.par_chunks(GROUP));
    let made: Vec<(CompressedGroup, f64)> =
        pairs.map_init(|| vec![[0.0; GROUP]; columns], group).collect::<Result<_>>()?;
    let left = made.iter().map(|(_, left)| left).sum();
    let groups: Vec<CompressedGroup> = made.into_iter().map(|(group, _)| group).collect();
    Ok((matrix(space, order.len(), THEN_ROWS, &rule, &groups), left))
}

fn compressed(plane: &[Rows16], bands: &Bands, rule: &Truncation) -> Result<CompressedGroup> {
    let mut group = CompressedGroup::default();
    compress_group(&[plane], bands, rule, 0.0, &mut group).map(|()| group)
}

fn matrix(
    space: ColumnSpace,
    rows: usize,
    tile_rows: usize,
    rule: &Truncation,
    groups: &[CompressedGroup],
) -> TransportMatrix {
    let (bands, channels) = (space.bands(), Channels::One);
    let tiles = groups.chunks(tile_rows / GROUP).enumerate().map(|(number, groups)| {
        let rows = tile_rows.min(rows - number * tile_rows);
        Tile::assemble(rows, bands.stored(), channels, (rule.width, rule.quantum), groups)
    });
    TransportMatrix { tiles: tiles.collect(), space, rows, channels, quantum: rule.quantum, tile_rows, bands }
}

/// Norms of the rows that both stages stand for and of what they are off, with what the source had lost before; and the
/// weighted square of all that is off the source.
fn row_norms(
    source: &TransportMatrix,
    rows: &CsrRows,
    order: &[u32],
    first: &TransportMatrix,
    then: &TransportMatrix,
    advance: &Advance,
) -> Result<(RowNorms, f64)> {
    let (representatives, bands) = (CsrRows::of(first), &source.bands);
    let count = bands.count();
    let sizes: Vec<f64> = first.tiles.iter().flat_map(|tile| first.row_squares(tile)).map(f64::sqrt).collect();
    let (mut kept, mut dropped, mut lost) = (Vec::new(), Vec::new(), 0.0);
    for (number, tile) in then.tiles.iter().enumerate() {
        let (starts, entries) = tile.by_group();
        let group = |both: &mut [Vec<f64>; 2], group: usize| {
            let own = &entries[starts[group] as usize..starts[group + 1] as usize];
            let lanes: Vec<_> =
                own.iter().map(|&(k, entry)| (k, tile.lanes(entry as usize, 0, then.quantum))).collect();
            let (mut norms, mut lost) = (Vec::new(), 0.0);
            for lane in 0..GROUP.min(tile.rows - group * GROUP) {
                let row = order[number * then.tile_rows + group * GROUP + lane] as usize;
                let [stored, off] = both;
                stored.fill(0.0);
                let mut rounding = 0.0;
                for (k, weights) in lanes.iter().filter(|(_, weights)| weights[lane] != 0.0) {
                    let weight = f64::from(weights[lane]);
                    rounding += ROUNDING * weight.abs() * sizes[*k as usize];
                    representatives.plain(*k as usize).for_each(|(column, value)| stored[column] += weight * value);
                }
                off.copy_from_slice(stored);
                rows.plain(row).for_each(|(column, value)| off[column] -= value);
                lost += off.iter().zip(&rows.weights).map(|(off, weight)| (off * weight).powi(2)).sum::<f64>();
                let before = &source.tiles[row / source.tile_rows].dropped[row % source.tile_rows * count..];
                for band in 0..count {
                    let square = |row: &[f64]| row[bands.range(band)].iter().map(|x| x * x).sum::<f64>();
                    let norm = |row: &[f64]| MARGIN * square(row).sqrt() + rounding;
                    norms.push((bf16_up(norm(stored)), bf16_up(norm(off) + f64::from(bf16(before[band])))));
                }
            }
            advance(GROUP.min(tile.rows - group * GROUP) as u64)?;
            Ok((norms, lost))
        };
        let room = || [vec![0.0; bands.stored()], vec![0.0; bands.stored()]];
        let made: Vec<(Vec<(u16, u16)>, f64)> =
            (0..tile.groups()).into_par_iter().map_init(room, group).collect::<Result<_>>()?;
        for (norms, own) in made {
            kept.extend(norms.iter().map(|norms| norms.0));
            dropped.extend(norms.iter().map(|norms| norms.1));
            lost += own;
        }
    }
    Ok((RowNorms::new(count, Channels::One, kept.into(), dropped.into())?, lost))
}
