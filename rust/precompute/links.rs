//! What nodes are to each other, and to receivers: form factors by counted rays, and the weights by which a receiver takes
//! from the nodes around it, or where those do not speak for it, gathers from what its own rays meet.
//!
//! ```text
//!     F_gh = rays of g that meet what h speaks for / N                 row sums at most 1, as integers
//!     W_x  = 1 / (|x - n| / r_n + 0.05)^2 of the 4 best of 32 nodes, in 4,096ths that sum to 4,096
//!     or     rays of x that meet what n speaks for / N                 where fewer than two speak for x, or the albedo that
//!                                                                      x sees differs from what they say (the audit)
//!     or     what a lobe, or a factor of one, takes by its rays        where x is glossy (`reflections.rs`)
//! ```

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::sampling::{cosine_directions, mixed};
use crate::scene::{CELL, Nodes, Placed, Points, Surfaces};
use crate::transport::{Slab, Weights};

use super::lobes::Lobes;
use super::reflections::{reflected, reflected_by_factors};
use super::shares::{EXPONENT, TAKEN, WHOLE, in_whole_numbers};

/// Nodes looked at for a receiver, and those of them that are asked.
const AROUND: usize = 32;
const ASKED: usize = 8;
/// How far the ray between them is lifted at both ends, in its length: the chord between two points of a round solid runs
/// inside it.
const LIFTED: f64 = 0.1;
/// Receivers that are looked at closely, and rays of each along a side.
const CHECKED: usize = 64;
const CLOSELY: usize = 64;
/// A receiver that gathers from so few nodes costs no more than one that interpolates.
const FEW: usize = 4;

/// Sparse counts of rays, row by row.
#[derive(Clone, Debug, Default)]
pub struct Counts {
    /// Those of row x are `starts[x]..starts[x + 1]`.
    pub starts: Vec<u32>,
    /// Ascending in each row.
    pub nodes: Vec<u32>,
    /// Rays of the row that met what the node speaks for.
    pub counts: Vec<u16>,
    /// Rays of each row.
    pub rays: u32,
}

impl Counts {
    /// Refuses starts that do not ascend to the number of counts, nodes that are none, and rows of more rays than there are.
    pub fn new(starts: Vec<u32>, nodes: Vec<u32>, counts: Vec<u16>, rays: u32) -> Result<Counts> {
        let ends = (starts.first().copied(), starts.last().map(|&last| last as usize));
        if ends != (Some(0), Some(counts.len())) || !starts.is_sorted() || nodes.len() != counts.len() {
            let (nodes, counts) = (nodes.len(), counts.len());
            return Err(Error::input(format!("expected rows of {counts} counts, got {ends:?} and {nodes} nodes")));
        }
        let found = Counts { starts, nodes, counts, rays };
        let sum =
            |row: &[u32]| found.counts[row[0] as usize..row[1] as usize].iter().map(|&n| u64::from(n)).sum::<u64>();
        let most = found.starts.windows(2).map(sum).max().unwrap_or(0);
        if most > u64::from(rays) || found.nodes.iter().any(|&node| node as usize >= found.rows()) {
            let rows = found.rows();
            return Err(Error::input(format!("expected nodes below {rows} and at most {rays} rays, got {most}")));
        }
        Ok(found)
    }

    /// What arrives at each node of radiosity that leaves all.
    pub fn passed(&self, light: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let unit = 1.0 / f64::from(self.rays);
        let one = |row: usize| {
            let own = self.starts[row] as usize..self.starts[row + 1] as usize;
            let mut sum = [0.0; 3];
            for (&node, &count) in self.nodes[own.clone()].iter().zip(&self.counts[own]) {
                let (from, count) = (light[node as usize], f64::from(count));
                (0..3).for_each(|c| sum[c] += count * from[c]);
            }
            sum.map(|x| unit * x)
        };
        (0..self.rows()).into_par_iter().with_min_len(64).map(one).collect()
    }

    /// The nodes of a row and the share of its rays that each has.
    pub fn row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> {
        let range = self.starts[row] as usize..self.starts[row + 1] as usize;
        let unit = 1.0 / f64::from(self.rays);
        let pairs = self.nodes[range.clone()].iter().zip(&self.counts[range]);
        pairs.map(move |(&node, &count)| (node as usize, f64::from(count) * unit))
    }

    /// How many rows there are.
    pub fn rows(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }
}

/// How light passes between nodes, whatever they are made of.
pub struct FormFactors {
    /// F, node by node.
    pub counts: Counts,
    /// Rays that met a surface for which no node speaks: what they would have brought is missing.
    pub lost: u64,
}

/// Numbers of the nodes that rays of one point meet, ascending, and how many of the rays were lost.
fn met(surfaces: Surfaces, nodes: &Nodes, rays: impl Iterator<Item = ([f64; 3], [f64; 3])>) -> (Vec<u32>, u64) {
    let (mut found, mut lost, mut room) = (Vec::new(), 0, Vec::new());
    for (origin, direction) in rays {
        let Some(hit) = surfaces.meet(origin.map(|x| x as f32), direction) else { continue };
        match nodes.nearest(&hit, &mut room) {
            Some(node) => found.push(node as u32),
            None => lost += 1,
        }
    }
    found.sort_unstable();
    (found, lost)
}

fn counted(found: &[u32]) -> impl Iterator<Item = (u32, u16)> {
    found.chunk_by(|a, b| a == b).map(|same| (same[0], same.len() as u16))
}

/// F by `side` x `side` cosine rays from each node, spread over the points of its cell.
pub fn form_factors(
    surfaces: Surfaces,
    placed: &Placed,
    side: usize,
    advance: &(dyn Fn(u64) -> Result<()> + Sync),
) -> Result<FormFactors> {
    let Placed { nodes, cells, .. } = placed;
    if !side.is_power_of_two() || side * side > usize::from(u16::MAX) {
        return Err(Error::input(format!("expected rays along a side that are a power of two up to 128, got {side}")));
    }
    let row = |number: usize| -> Result<(Vec<u32>, u64)> {
        advance(1)?;
        let own = &cells[number];
        let directions = cosine_directions(nodes.nodes[number].normal, side, mixed(number as u64));
        let from = |(k, direction): (usize, [f64; 3])| {
            // Neighbouring strata start from different points.
            let point = &own[(k % side + 2 * (k / side)) % CELL];
            (point.origin, direction)
        };
        Ok(met(surfaces, nodes, directions.enumerate().map(from)))
    };
    let rows = (0..nodes.len()).into_par_iter().map(row).collect::<Result<Vec<_>>>()?;
    let mut counts = Counts { starts: vec![0], rays: (side * side) as u32, ..Counts::default() };
    let mut lost = 0;
    for (found, own) in rows {
        lost += own;
        for (node, count) in counted(&found) {
            counts.nodes.push(node);
            counts.counts.push(count);
        }
        counts.starts.push(counts.nodes.len() as u32);
    }
    Ok(FormFactors { counts, lost })
}

/// How receivers take from nodes.
#[derive(Clone, Copy, Debug)]
pub struct Gathering {
    /// Rays of each receiver along a side: 8 or 16.
    pub side: usize,
    /// A receiver gathers where the mean albedo that its own rays meet is off by more than this from what its nodes say.
    pub audit: f64,
}

/// The weights of receivers, and what they are.
pub struct Links {
    /// Of receivers: of irradiance at nodes below the number of nodes, and from it on of the radiosity of nodes.
    pub weights: Weights,
    /// Rows that gather as too few nodes speak for them, as the audit found them wrong, and as they see few nodes.
    pub unspoken: usize,
    /// See `unspoken`.
    pub audited: usize,
    /// See `unspoken`.
    pub few: usize,
    /// Rows that gather as they are glossy.
    pub glossy: usize,
    /// Some receivers, evenly spread, and what thousands of rays say of them.
    pub checks: Vec<Check>,
    /// Rays shot.
    pub rays: u64,
}

/// A receiver that is looked at closely: the error of nodes is measured at it.
#[derive(Clone, Debug)]
pub struct Check {
    /// Its number.
    pub receiver: usize,
    /// Its weights of rows of nodes, as `Links::weights` has them.
    pub taken: Vec<(usize, f64)>,
    /// The nodes that its many rays meet, and the share of the rays that each has.
    pub gathered: Vec<(usize, f64)>,
}

/// A receiver's weights: of irradiance, or of radiosity.
enum Taken {
    Interpolated(Vec<(u32, u16)>),
    Gathered(Vec<(u32, u16)>, Why),
}

#[derive(Clone, Copy, PartialEq)]
enum Why {
    Unspoken,
    Audited,
    Few,
    Glossy,
}

/// Links receivers to nodes. `albedo`: of each node, the mean of its colours; `seen`: the mean albedo that each node's own
/// rays meet.
pub fn links(
    surfaces: Surfaces,
    nodes: &Nodes,
    (receivers, lobes): (&Points, &Lobes),
    gathering: Gathering,
    albedo: &[f64],
    seen: &[f64],
    advance: &(dyn Fn(u64) -> Result<()> + Sync),
) -> Result<Links> {
    let Gathering { side, audit } = gathering;
    if !side.is_power_of_two() || side * side > WHOLE as usize {
        return Err(Error::input(format!("expected rays along a side that are a power of two up to 16, got {side}")));
    }
    let (rays, share) = ((side * side) as f64, (WHOLE as usize / (side * side)) as u16);
    const CHUNK: usize = 256;
    let row = |row: usize, room: &mut Vec<(f32, u32)>| -> (Taken, u64) {
        let origin = receivers.origin[row].map(f64::from);
        let normal = receivers.normal[row].map(f64::from);
        // Factors of one point go together: see below.
        if normal == [0.0; 3] || lobes.factor_of(row).is_some() {
            return (Taken::Interpolated(Vec::new()), 0);
        }
        if let Some(lobe) = lobes.of(row, receivers.normal[row]) {
            let (taken, shot) = reflected(surfaces, nodes, (receivers, row), &lobe, room);
            return (Taken::Gathered(taken, Why::Glossy), shot);
        }
        let directions = cosine_directions(normal, side, mixed(row as u64) ^ 1);
        let risen = directions.filter(|&direction| receivers.rises(row, direction));
        let (found, _) = met(surfaces, nodes, risen.map(|direction| (origin, direction)));
        let (speaking, shot) = interpolation(surfaces, nodes, origin, normal, room);
        let gathered: Vec<(u32, u16)> = counted(&found).map(|(node, count)| (node, count * share)).collect();
        let own = found.iter().map(|&node| albedo[node as usize]).sum::<f64>() / rays;
        let said: f64 = speaking.iter().map(|&(node, w)| f64::from(w) * seen[node as usize] / f64::from(WHOLE)).sum();
        let taken = if gathered.len() <= FEW {
            Taken::Gathered(gathered, Why::Few)
        } else if speaking.is_empty() {
            Taken::Gathered(gathered, Why::Unspoken)
        } else if (own - said).abs() > audit {
            Taken::Gathered(gathered, Why::Audited)
        } else {
            Taken::Interpolated(speaking)
        };
        (taken, shot + rays as u64)
    };
    let chunks = receivers.len().div_ceil(CHUNK);
    let rows = (0..chunks)
        .into_par_iter()
        .map(|chunk| {
            let mut room = Vec::new();
            let own = chunk * CHUNK..receivers.len().min((chunk + 1) * CHUNK);
            advance(own.clone().filter(|&row| lobes.factor_of(row).is_none()).count() as u64)?;
            Ok(own.map(|number| row(number, &mut room)).collect())
        })
        .collect::<Result<Vec<Vec<(Taken, u64)>>>>()?;
    let mut rows: Vec<(Taken, u64)> = rows.into_iter().flatten().collect();
    for own in reflected_by_factors(surfaces, nodes, (receivers, lobes), advance)? {
        rows[own.row] = (Taken::Gathered(own.taken, Why::Glossy), own.rays);
    }

    let (mut starts, mut from, mut by) = (vec![0u32], Vec::new(), Vec::new());
    let (mut whys, mut shot) = ([0; 4], 0);
    for (taken, own) in rows {
        shot += own;
        let pairs = match taken {
            Taken::Interpolated(pairs) => pairs,
            Taken::Gathered(pairs, why) => {
                whys[why as usize] += 1;
                pairs.into_iter().map(|(node, count)| (nodes.len() as u32 + node, count)).collect()
            }
        };
        for (node, weight) in pairs {
            from.push(node);
            by.push(weight);
        }
        starts.push(from.len() as u32);
    }
    let weights = Weights::new(Slab::from(starts), Slab::from(from), Slab::from(by), EXPONENT, 2 * nodes.len())?;
    // Of rows that take cosines, and see something.
    let plain: Vec<usize> =
        (0..receivers.len()).filter(|&row| receivers.normal[row] != [0.0; 3] && !lobes.has(row)).collect();
    let count = CHECKED.min(plain.len());
    let check = |k: usize| -> Result<Check> {
        advance(0)?;
        let row = plain[(2 * k + 1) * plain.len() / (2 * count)];
        let (origin, normal) = (receivers.origin[row].map(f64::from), receivers.normal[row].map(f64::from));
        let directions = cosine_directions(normal, CLOSELY, mixed(row as u64) ^ 2);
        let risen = directions.filter(|&direction| receivers.rises(row, direction));
        let (found, _) = met(surfaces, nodes, risen.map(|direction| (origin, direction)));
        let share = 1.0 / (CLOSELY * CLOSELY) as f64;
        let gathered = counted(&found).map(|(node, count)| (node as usize, f64::from(count) * share));
        Ok(Check { receiver: row, taken: weights.row(row).collect(), gathered: gathered.collect() })
    };
    let checks = (0..count).into_par_iter().map(check).collect::<Result<Vec<_>>>()?;
    let rays = shot + (count * CLOSELY * CLOSELY) as u64;
    Ok(Links { weights, unspoken: whys[0], audited: whys[1], few: whys[2], glossy: whys[3], checks, rays })
}

/// The nodes that speak for a receiver, and the rays it took to find them: integers that sum to `WHOLE`, or nothing where
/// fewer than two do.
fn interpolation(
    surfaces: Surfaces,
    nodes: &Nodes,
    origin: [f64; 3],
    normal: [f64; 3],
    room: &mut Vec<(f32, u32)>,
) -> (Vec<(u32, u16)>, u64) {
    let (mut speaking, mut shot) = (Vec::with_capacity(ASKED), 0);
    let mut asked = 0;
    for number in nodes.several(origin, normal, AROUND, room) {
        let node = &nodes.nodes[number];
        let Some(distance) = nodes.distance_spoken(number, origin, normal) else { continue };
        asked += 1;
        let lift = LIFTED * distance;
        let from = std::array::from_fn(|k| origin[k] + lift * normal[k]);
        let to = std::array::from_fn(|k| node.origin[k] + lift * node.normal[k]);
        shot += 1;
        if surfaces.see(from, to) {
            speaking.push(((distance / node.spacing + 0.05).powi(-2), number as u32));
        }
        if asked == ASKED {
            break;
        }
    }
    if speaking.len() < 2 {
        return (Vec::new(), shot);
    }
    speaking.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    speaking.truncate(TAKEN);
    (in_whole_numbers(&speaking, WHOLE), shot)
}
