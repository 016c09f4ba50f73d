//! What glossy rows take of other surfaces: from the nodes that stand for what their rays meet.
//!
//! ```text
//!     of a lobe as one eye sees it     rays by its own samples, f cos / pdf / N each
//!     of a factor g of a lobe          a ray into each of N parts of the hemisphere, Int g dw over the part: of either sign
//! ```
//!
//! A lobe takes from the nodes around each hit. Factors take from the nearest alone: interpolating there is no nearer to brute
//! force, and doubles the weights.

use std::f64::consts::TAU;

use rayon::prelude::*;

use crate::brdf::Factor;
use crate::error::Result;
use crate::sampling::{in_part, jitter, mixed};
use crate::scene::surface::Point;
use crate::scene::{Nodes, Points, Surfaces};
use crate::transport::weights::NEGATIVE;

use super::lobes::{Lobe, Lobes, Local};
use super::shares::{TAKEN, WHOLE, in_whole_numbers};

/// Rays of a lobe along a side, twice as many where it is wider than 15 degrees.
const LOBE_SIDE: usize = 8;
const WIDE: f64 = 0.26;
/// Parts of the hemisphere, from the horizon up and around, and all of them.
const PARTS: [usize; 2] = [8, 32];
const COUNT: usize = PARTS[0] * PARTS[1];
/// Points of a part along a side, at which a factor is summed.
const FINE: usize = 8;
/// Weights of factors are multiples of so much: what is smaller is less than their rays are off, and takes as many bytes.
const COARSE: u16 = 8;

/// Nodes, and what a row takes from each.
type Shares = Vec<(u32, f64)>;
/// The same as a link stores it: of a negative weight the node has its sign.
type Stored = Vec<(u32, u16)>;

/// What a row with a lobe takes, and its rays.
pub(super) fn reflected(
    surfaces: Surfaces,
    nodes: &Nodes,
    (points, row): (&Points, usize),
    lobe: &Lobe,
    room: &mut Vec<(f32, u32)>,
) -> (Stored, u64) {
    let side = if lobe.half_width() > WIDE { 2 * LOBE_SIDE } else { LOBE_SIDE };
    let mut shares = Shares::new();
    for (direction, weight) in lobe.samples(side, mixed(row as u64) ^ 4) {
        let hit = surfaces.meet(points.origin[row], direction).filter(|_| points.rises(row, direction));
        let Some(hit) = hit else { continue };
        shares.extend(around(nodes, &hit, room).into_iter().map(|(node, share)| (node, weight * share)));
    }
    (stored(shares, 1), (side * side) as u64)
}

/// The nodes around a point that a ray has met, and the share of each; none where no node speaks for it.
fn around(nodes: &Nodes, hit: &Point, room: &mut Vec<(f32, u32)>) -> Shares {
    let Some(nearest) = nodes.nearest(hit, room) else { return Shares::new() };
    let mut around = Shares::with_capacity(TAKEN);
    for number in nodes.several(hit.place, hit.normal, TAKEN, room) {
        if let Some(distance) = nodes.distance_spoken(number, hit.place, hit.normal) {
            around.push((number as u32, (distance / nodes.nodes[number].spacing + 0.05).powi(-2)));
        }
    }
    if around.is_empty() {
        around.push((nearest as u32, 1.0));
    }
    let sum: f64 = around.iter().map(|&(_, share)| share).sum();
    around.iter_mut().for_each(|(_, share)| *share /= sum);
    around
}

/// What a row with a factor takes from nodes.
pub(super) struct ByFactor {
    /// Its number.
    pub row: usize,
    /// Its weights.
    pub taken: Stored,
    /// Shot for it: the first row of a point has those of all.
    pub rays: u64,
}

/// What rows with factors take: those of one point by the same rays, so that their sum is what the lobe takes by them.
pub(super) fn reflected_by_factors(
    surfaces: Surfaces,
    nodes: &Nodes,
    (points, lobes): (&Points, &Lobes),
    advance: &(dyn Fn(u64) -> Result<()> + Sync),
) -> Result<Vec<ByFactor>> {
    let integrals: Vec<Vec<f64>> = lobes.factors().map(|factor| factor.map_or_else(Vec::new, over_parts)).collect();
    let sees = |row: &usize| lobes.factor_of(*row).is_some() && points.normal[*row] != [0.0; 3];
    let at = |row: usize| (points.origin[row].map(f32::to_bits), points.normal[row].map(f32::to_bits));
    let mut rows: Vec<usize> = (0..points.len()).filter(sees).collect();
    rows.sort_by_key(|&row| (at(row), row));

    let of_point = |rows: &[usize]| {
        advance(rows.len() as u64)?;
        let (first, mut room) = (rows[0], Vec::new());
        let local = Local::new(points.normal[first], lobes.turn(first));
        let mut meet = |part: usize| {
            let inside = jitter(mixed(first as u64) ^ part as u64);
            let direction = local.world(in_part(part, PARTS, inside));
            let hit = surfaces.meet(points.origin[first], direction).filter(|_| points.rises(first, direction))?;
            Some((part, nodes.nearest(&hit, &mut room)? as u32))
        };
        let met: Vec<(usize, u32)> = (0..COUNT).filter_map(&mut meet).collect();
        let of_row = |row: usize| {
            let own = &integrals[lobes.factor_of(row)?];
            let shares = met.iter().map(|&(part, node)| (node, own[part])).collect();
            Some(ByFactor { row, taken: stored(shares, COARSE), rays: if row == first { COUNT as u64 } else { 0 } })
        };
        Ok(rows.iter().filter_map(|&row| of_row(row)).collect())
    };
    let points: Vec<&[usize]> = rows.chunk_by(|&a, &b| at(a) == at(b)).collect();
    let taken = points.into_par_iter().map(of_point).collect::<Result<Vec<Vec<ByFactor>>>>()?;
    Ok(taken.into_iter().flatten().collect())
}

/// The integral of a factor over each of the parts.
fn over_parts(factor: &Factor) -> Vec<f64> {
    let inside = |k: usize| [(k % FINE) as f64 + 0.5, (k / FINE) as f64 + 0.5].map(|x| x / FINE as f64);
    let sum = |part: usize| (0..FINE * FINE).map(|k| factor.value(in_part(part, PARTS, inside(k)))).sum::<f64>();
    (0..COUNT).map(|part| TAU / (COUNT * FINE * FINE) as f64 * sum(part)).collect()
}

/// The shares of each node put together, those of each sign as multiples of `unit` that keep their sum.
fn stored(mut shares: Shares, unit: u16) -> Stored {
    shares.sort_by_key(|&(node, _)| node);
    let total = |same: &[(u32, f64)]| (same.iter().map(|&(_, share)| share).sum::<f64>(), same[0].0);
    let merged: Vec<(f64, u32)> = shares.chunk_by(|a, b| a.0 == b.0).map(total).collect();
    let of_sign = |sign: f64| {
        let own = merged.iter().map(|&(share, node)| (sign * share, node)).filter(|&(share, _)| share > 0.0);
        let own: Vec<(f64, u32)> = own.collect();
        let sum: f64 = own.iter().map(|&(share, _)| share).sum();
        let whole = in_whole_numbers(&own, (sum * f64::from(WHOLE) / f64::from(unit)).round() as u32);
        whole.into_iter().map(move |(node, weight)| (node, weight.saturating_mul(unit)))
    };
    of_sign(1.0).chain(of_sign(-1.0).map(|(node, weight)| (node | NEGATIVE, weight))).collect()
}
