//! Which rows are together: k-means of a random projection to begin with, then each row goes where a subspace leaves least
//! of it, and subspaces are found anew.

use rayon::prelude::*;

use crate::basis::k_means::{DIMENSIONS, Point, k_means, means, nearest};
use crate::basis::pca::Subspace;
use crate::error::Result;
use crate::sampling::mixed;
use crate::transport::csr_rows::CsrRows;

/// How often subspaces are found. (On 8,736 vertices of the street, what they leave falls by 1.4 and 0.9 % in the second
/// and third.)
pub const ROUNDS: usize = 3;
/// Of k-means before them.
const MEANS: usize = 3;
/// Clusters with the nearest means, among which a row looks for the subspace that leaves least of it.
const NEAREST: usize = 8;
/// Rounds of power iteration: while rows still move, and for good.
const COARSE: usize = 2;
const FINE: usize = 4;

/// What is asked for.
#[derive(Clone, Copy, Debug)]
pub struct Clustering {
    /// At most: rows that are alike make fewer.
    pub clusters: usize,
    /// Of each cluster, besides its mean.
    pub representatives: usize,
    /// Relative L2 error of the picture that truncating the representatives may cause.
    pub tolerance: f64,
}

/// Hears of rows that are done, each of them `STEPS` times, and may stop the work.
pub type Advance<'a> = dyn Fn(u64) -> Result<()> + Sync + 'a;

/// A cluster: its rows in their order, and the subspace that stands for them.
pub(super) struct Cluster {
    pub rows: Vec<u32>,
    /// The columns that its rows touch, which the subspace numbers from 0 on.
    pub support: Vec<u32>,
    pub subspace: Subspace,
}

/// All rows in clusters that are not empty, by the mean number of their rows: neighbours see alike.
pub(super) fn assign(rows: &CsrRows, asked: Clustering, advance: &Advance) -> Result<Vec<Cluster>> {
    let points: Vec<Point> = (0..rows.count()).into_par_iter().map(|row| project(rows.weighted(row))).collect();
    let mut labels = k_means(&points, asked.clusters, MEANS);
    for _ in 1..ROUNDS {
        let clusters = fit(rows, &labels, asked.representatives, COARSE, advance)?;
        labels = reassign(rows, &points, &clusters, advance)?;
    }
    fit(rows, &labels, asked.representatives, FINE, advance)
}

/// Sums of a row's numbers with signs that look random.
fn project(row: impl Iterator<Item = (usize, f64)>) -> Point {
    let mut sums = [0.0; DIMENSIONS];
    for (column, value) in row {
        let signs = mixed(column as u64);
        sums.iter_mut().enumerate().for_each(|(k, sum)| *sum += if signs >> k & 1 == 1 { value } else { -value });
    }
    sums.map(|sum: f64| sum as f32)
}

fn fit(rows: &CsrRows, labels: &[u32], each: usize, rounds: usize, advance: &Advance) -> Result<Vec<Cluster>> {
    let count = labels.iter().max().map_or(0, |&most| most as usize + 1);
    let mut members = vec![Vec::new(); count];
    labels.iter().enumerate().for_each(|(row, &label)| members[label as usize].push(row as u32));
    members.retain(|own| !own.is_empty());
    let mean = |own: &[u32]| own.iter().map(|&row| u64::from(row)).sum::<u64>() / own.len() as u64;
    members.sort_by_key(|own| (mean(own), own[0]));
    let one = |own: Vec<u32>| {
        let (some, support) = rows.some(&own);
        let subspace = Subspace::fit(&some, each, rounds);
        advance(own.len() as u64)?;
        Ok(Cluster { rows: own, support, subspace })
    };
    members.into_par_iter().map(one).collect()
}

/// The cluster, among those with the nearest means, whose subspace leaves least of each row; its own where others do not
/// leave less.
fn reassign(rows: &CsrRows, points: &[Point], clusters: &[Cluster], advance: &Advance) -> Result<Vec<u32>> {
    let mut labels = vec![0; points.len()];
    for (number, cluster) in clusters.iter().enumerate() {
        cluster.rows.iter().for_each(|&row| labels[row as usize] = number as u32);
    }
    let centres = means(points, &labels, clusters.len());
    let mut tried = vec![Vec::new(); clusters.len()];
    let candidates: Vec<[u32; NEAREST]> = points.par_iter().map(|point| nearest(point, &centres)).collect();
    for (row, (nearest, &own)) in candidates.iter().zip(&labels).enumerate() {
        let mut all = [&[own], &nearest[..]].concat();
        all.sort_unstable();
        all.dedup();
        all.iter().for_each(|&cluster| tried[cluster as usize].push(row as u32));
    }

    // Cluster after cluster: its axes are looked up by column.
    let left: Vec<Vec<f64>> = clusters
        .par_iter()
        .zip(&tried)
        .map_init(
            || vec![u32::MAX; rows.weights.len()],
            |place, (cluster, tried)| {
                cluster.support.iter().enumerate().for_each(|(at, &column)| place[column as usize] = at as u32);
                let left = tried.iter().map(|&row| residual(rows.weighted(row as usize), cluster, place)).collect();
                cluster.support.iter().for_each(|&column| place[column as usize] = u32::MAX);
                advance(cluster.rows.len() as u64)?;
                Ok(left)
            },
        )
        .collect::<Result<_>>()?;
    let mut least = vec![f64::INFINITY; points.len()];
    for (number, cluster) in clusters.iter().enumerate() {
        for (&row, &left) in tried[number].iter().zip(&left[number]) {
            if cluster.rows.binary_search(&row).is_ok() {
                least[row as usize] = left;
            }
        }
    }
    for (number, (tried, left)) in tried.iter().zip(&left).enumerate() {
        for (&row, &left) in tried.iter().zip(left) {
            if left < least[row as usize] {
                (least[row as usize], labels[row as usize]) = (left, number as u32);
            }
        }
    }
    Ok(labels)
}

/// The square of what a cluster's subspace leaves of a row; `place`: where its columns stand in the subspace.
fn residual(row: impl Iterator<Item = (usize, f64)>, cluster: &Cluster, place: &[u32]) -> f64 {
    let mut outside = 0.0;
    let inside = row.filter_map(|(column, value)| match place[column] {
        u32::MAX => {
            outside += value * value;
            None
        }
        at => Some((at as usize, value)),
    });
    cluster.subspace.coordinates(inside).1 + outside
}
