//! Light between surfaces: bounces at the nodes, column by column of their direct rows.
//!
//! ```text
//!     I = sum over k = 1..n of (F rho)^k T             n bounces: n products, exact by definition
//!     I = F rho (1 - F rho)^-1 T                       all: Neumann where few terms do, else BiCGStab, to a proved residual
//! ```
//!
//! Rows of what is made: I of every node, and then of every node rho (T + I'), its radiosity, from which receivers gather,
//! with I' of one bounce less, as gathering is the last one itself. They are truncated like any other transport, block after block of
//! columns; what T's rows had lost goes through the same sums, which only bring norms together (they are convex), and is added
//! to what the rows lose.

use rayon::prelude::*;

use crate::basis::Bands;
use crate::error::{Error, Result};
use crate::transport::entry::{Channels, MAX_SPAN, bf16, bf16_up, group_of};
use crate::transport::{CompressedGroup, GROUP, Rows16, Tile, Truncation, compress_group};

use super::links::{Check, Counts};
use super::radiosity::{Operator, Real, Solved, solve};

/// Columns of a block: what its rows hold fits a few cache lines.
const BLOCK: usize = 64;
/// The same where sums are in f64.
const WIDE_BLOCK: usize = 16;
/// Rows of a finished tile: few, as nodes are, so that all threads have some.
pub const TILE_ROWS: usize = 1024;
/// Covers that norms are rounded to f64 while they are summed.
const MARGIN: f64 = 1.0 + 1e-9;
/// What sums of up to 1,024 products in f32 may be off by, relative to the norms that are summed.
const NARROW: f64 = 1.0 / 16384.0;

/// How often light passes between surfaces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bounces {
    /// So often.
    Count(usize),
    /// Until no row can be further off than this share of the largest.
    All(f64),
}

/// The nodes of a scene and what is between them.
pub struct Interreflection<'a> {
    /// F.
    pub factors: &'a Counts,
    /// rho: of each node, in red, green and blue.
    pub albedo: &'a [[f32; 3]],
    /// Receivers at which the error of nodes is measured.
    pub checks: &'a [Check],
    /// Light that arrives at those directly: a row each, at the direct rows' quantum.
    pub arriving: &'a [Tile],
    /// 3 where the albedos are coloured.
    pub channels: Channels,
}

/// What solving took, and what came of it.
#[derive(Clone, Debug, Default)]
pub struct Share {
    /// Of each bounce in the energy of all indirect light at the nodes, under the light prior; of all but the first in one
    /// number where they were not told apart.
    pub bounces: Vec<f64>,
    /// Products with F: the fewest, the median and the most of any column.
    pub products: [usize; 3],
    /// No value is further off than this share of the largest of its column; 0 where so many bounces were asked.
    pub residual: f64,
    /// Whether BiCGStab was needed.
    pub krylov: bool,
    /// For each check how far the indirect light that a receiver takes is from what its many rays gather, relative to
    /// the light of all checks (root mean square), under the light prior. An estimate: it is no part of any bound.
    pub discretisation: Vec<f64>,
}

impl Interreflection<'_> {
    /// Rows of what is made.
    pub fn rows(&self) -> usize {
        2 * self.factors.rows()
    }

    fn operators(&self) -> Vec<Operator<'_>> {
        let of =
            |channel: usize| Operator::new(self.factors, self.albedo.iter().map(move |rho| rho[channel]).collect());
        (0..self.channels.count()).map(of).collect()
    }

    /// The quantum at which no row is too long to be followed exactly: `quantum`, or a coarser one.
    pub fn quantum(&self, direct: &[Tile], bands: &Bands, bounces: Bounces, quantum: i32) -> Result<i32> {
        let mut longest = 0.0f64;
        for operator in self.operators() {
            let total = self.convex(&operator, direct, bands, bounces, |tile| &tile.kept)?;
            for (row, norms) in total.indirect.chunks_exact(bands.count()).enumerate() {
                let direct = &total.direct[row * bands.count()..][..bands.count()];
                let square: f64 = norms.iter().zip(direct).map(|(a, b)| (a + b) * (a + b)).sum();
                longest = longest.max(square);
            }
        }
        let exponent = if longest > 0.0 { (longest.sqrt() * (1.0 + 1.0 / 32.0)).log2().ceil() as i32 } else { quantum };
        Ok(quantum.max(exponent - MAX_SPAN))
    }

    /// The bounces of norms: nodes x bands. No row of the indirect light is longer in a band.
    fn convex(
        &self,
        operator: &Operator,
        direct: &[Tile],
        bands: &Bands,
        bounces: Bounces,
        of: impl Fn(&Tile) -> &[u16],
    ) -> Result<Norms> {
        let count = bands.count();
        let t: Vec<f64> = direct.iter().flat_map(|tile| of(tile).iter().map(|&norm| f64::from(bf16(norm)))).collect();
        let indirect = match bounces {
            Bounces::Count(bounces) => {
                let [sum, _] = neumann(operator, &t, count, bounces, |_, _| {});
                sum
            }
            Bounces::All(_) => {
                let first = operator.apply(&t, count);
                let Solved { mut values, errors, furnace, .. } = solve(operator, &first, count, 1e-3)?;
                for (row, v) in values.chunks_exact_mut(count).zip(&furnace) {
                    row.iter_mut().zip(&errors).for_each(|(value, error)| *value += v * error);
                }
                values
            }
        };
        Ok(Norms { direct: t, indirect })
    }

    /// The bounces of one light that does not move: what arrives of it at nodes directly, in three colours, becomes the
    /// light of the rows that are made.
    pub fn still(&self, direct: &[[f64; 3]], bounces: Bounces) -> Result<Vec<[f64; 3]>> {
        let mut made = vec![[0.0; 3]; self.rows()];
        let operators = self.operators();
        for colour in 0..3 {
            let channel = colour.min(operators.len() - 1);
            let t: Vec<f64> = direct.iter().map(|light| light[colour]).collect();
            let [all, before] = match bounces {
                Bounces::Count(bounces) => neumann(&operators[channel], &t, 1, bounces, |_, _| {}),
                Bounces::All(residual) => {
                    let first = operators[channel].apply(&t, 1);
                    let Solved { values, .. } = solve(&operators[channel], &first, 1, residual)?;
                    [values.clone(), values]
                }
            };
            for (row, made) in made.iter_mut().enumerate() {
                let (node, factor) = self.made(row, channel);
                let radiant = row >= self.factors.rows();
                made[colour] = if radiant { factor * (t[node] + before[node]) } else { all[node] };
            }
        }
        Ok(made)
    }

    /// Solves all columns of the nodes' direct rows, and truncates what comes of it.
    pub fn solve(
        &self,
        direct: &[Tile],
        bands: &Bands,
        direct_quantum: i32,
        bounces: Bounces,
        rule: &Truncation,
        advance: &(dyn Fn(u64) -> Result<()> + Sync),
    ) -> Result<(Vec<Tile>, Share)> {
        let nodes = self.factors.rows();
        if self.albedo.len() != nodes || direct.iter().map(|tile| tile.rows).sum::<usize>() != nodes {
            return Err(Error::input(format!("expected rows and an albedo for each of {nodes} nodes")));
        }
        if self.arriving.iter().map(|tile| tile.rows).sum::<usize>() != self.checks.len() {
            return Err(Error::input(format!("expected a row for each of {} checks", self.checks.len())));
        }
        if bands.texels > 0 || direct.iter().any(|tile| tile.channels != Channels::One) {
            return Err(Error::input("expected direct rows of one channel without texels"));
        }
        let operators = self.operators();
        let width = if matches!(bounces, Bounces::Count(_)) { BLOCK } else { WIDE_BLOCK };
        let blocks: Vec<(usize, std::ops::Range<usize>)> = (0..bands.count())
            .flat_map(|band| {
                let range = bands.range(band);
                range.clone().step_by(width).map(move |start| (band, start..range.end.min(start + width)))
            })
            .collect();
        let solved: Vec<(Vec<CompressedGroup>, Told)> = blocks
            .par_iter()
            .map(|(_, columns)| {
                advance(columns.len() as u64)?;
                self.block(&operators, direct, bands, direct_quantum, columns.clone(), bounces, rule)
            })
            .collect::<Result<_>>()?;

        // What the direct rows had lost, bounced, and what sums in f32 may have.
        let lost = operators
            .iter()
            .map(|operator| {
                let mut lost = self.convex(operator, direct, bands, bounces, |tile| &tile.dropped)?;
                let kept = self.convex(operator, direct, bands, bounces, |tile| &tile.kept)?;
                lost.indirect.iter_mut().zip(&kept.indirect).for_each(|(lost, kept)| *lost += NARROW * kept);
                Ok(lost)
            })
            .collect::<Result<Vec<_>>>()?;
        let groups: Vec<CompressedGroup> = (0..self.rows().div_ceil(GROUP))
            .into_par_iter()
            .map(|group| self.join(group, &blocks, &solved, bands, &lost))
            .collect();
        let tiles = groups.chunks(TILE_ROWS / GROUP).enumerate().map(|(number, groups)| {
            let rows = (self.rows() - number * TILE_ROWS).min(TILE_ROWS);
            Tile::assemble(rows, bands.stored(), self.channels, (rule.width, rule.quantum), groups)
        });
        Ok((tiles.collect(), Told::all(solved.iter().map(|(_, told)| told))))
    }

    /// A block of columns: solved in all channels, and truncated by itself.
    #[allow(clippy::too_many_arguments)]
    fn block(
        &self,
        operators: &[Operator],
        direct: &[Tile],
        bands: &Bands,
        quantum: i32,
        columns: std::ops::Range<usize>,
        bounces: Bounces,
        rule: &Truncation,
    ) -> Result<(Vec<CompressedGroup>, Told)> {
        let (n, areas) = (columns.len(), &bands.areas[columns.clone()]);
        let t = dense(direct, columns.clone(), quantum);
        let mut told = Told::default();
        let mut indirect = Vec::with_capacity(operators.len());
        let mut unproved = Vec::with_capacity(operators.len());
        for operator in operators {
            let (values, before, errors) = match bounces {
                Bounces::Count(bounces) => {
                    let [values, before] = neumann(operator, &t, n, bounces, |bounce, term| {
                        told.bounce(bounce, term.iter().map(|&x| f64::from(x)), n, areas);
                    });
                    told.products.resize(told.products.len() + n, bounces);
                    (values, before, None)
                }
                Bounces::All(residual) => {
                    let wide: Vec<f64> = t.iter().map(|&x| f64::from(x)).collect();
                    let first = operator.apply(&wide, n);
                    let solved = solve(operator, &first, n, residual)?;
                    told.solved(&first, &solved, n, areas);
                    let values: Vec<f32> = solved.values.iter().map(|&x| x as f32).collect();
                    (values.clone(), values, Some((solved.errors, solved.furnace)))
                }
            };
            indirect.push([values, before]);
            unproved.push(errors);
        }

        let arriving = dense(self.arriving, columns.clone(), quantum);
        let own = self.checks.iter().zip(arriving.chunks_exact(n));
        for ((check, arriving), sums) in own.zip(told.checks(self.checks.len())) {
            for (channel, indirect) in indirect.iter().enumerate() {
                self.check(check, arriving, channel, &t, indirect, areas, sums);
            }
        }
        let local = Bands {
            starts: vec![0, n],
            areas: areas.to_vec(),
            always: bands.always.saturating_sub(columns.start).min(n),
            texels: 0,
        };
        let weights = rule.weights()[columns.clone()].to_vec();
        let own = Truncation::with_weights(weights, local.always, rule.threshold, rule.quantum, rule.width)?;
        let mut planes = vec![vec![[0.0; GROUP]; n]; operators.len()];
        let mut groups = Vec::with_capacity(self.rows().div_ceil(GROUP));
        for group in 0..self.rows().div_ceil(GROUP) {
            for (channel, plane) in planes.iter_mut().enumerate() {
                self.fill(group, channel, &t, &indirect[channel], n, plane);
            }
            let slices: Vec<&[Rows16]> = planes.iter().map(Vec::as_slice).collect();
            let mut out = CompressedGroup::default();
            compress_group(&slices, &local, &own, 0.0, &mut out)?;
            for (channel, errors) in unproved.iter().enumerate() {
                let Some((errors, furnace)) = errors else { continue };
                let norm = errors.iter().map(|error| error * error).sum::<f64>().sqrt();
                for lane in 0..GROUP.min(self.rows() - group * GROUP) {
                    let (node, factor) = self.made(group * GROUP + lane, channel);
                    let at = lane * operators.len() + channel;
                    let more = norm * furnace[node] * factor;
                    out.dropped[at] = bf16_up(f64::from(bf16(out.dropped[at])) + more);
                }
            }
            groups.push(out);
        }
        Ok((groups, told))
    }

    /// Adds a block's part to the error of a receiver: squares of what it takes less what it gathers, and of all its light.
    #[allow(clippy::too_many_arguments)]
    fn check(
        &self,
        check: &Check,
        arriving: &[f32],
        channel: usize,
        t: &[f32],
        indirect: &[Vec<f32>; 2],
        areas: &[f64],
        sums: &mut [f64; 2],
    ) {
        let n = areas.len();
        let radiosity = |node: usize, column: usize| {
            let at = node * n + column;
            f64::from(self.albedo[node][channel]) * f64::from(t[at] + indirect[1][at])
        };
        for (column, area) in areas.iter().enumerate() {
            let taken = check.taken.iter().map(|&(row, weight)| {
                let node = self.made(row, channel).0;
                let radiant = row >= self.factors.rows();
                weight * if radiant { radiosity(node, column) } else { f64::from(indirect[0][node * n + column]) }
            });
            let gathered: f64 = check.gathered.iter().map(|&(node, share)| share * radiosity(node, column)).sum();
            let off = taken.sum::<f64>() - gathered;
            sums[0] += off * off * area;
            sums[1] += (f64::from(arriving[column]) + gathered).powi(2) * area;
        }
    }

    /// The node that a row is made of, and what its indirect light is multiplied by there.
    fn made(&self, row: usize, channel: usize) -> (usize, f64) {
        match row.checked_sub(self.factors.rows()) {
            None => (row, 1.0),
            Some(node) => (node, f64::from(self.albedo[node][channel])),
        }
    }

    /// 16 rows of a block in one channel: irradiance, or radiosity.
    fn fill(&self, group: usize, channel: usize, t: &[f32], indirect: &[Vec<f32>; 2], n: usize, plane: &mut [Rows16]) {
        for lane in 0..GROUP {
            let row = group * GROUP + lane;
            if row >= self.rows() {
                plane.iter_mut().for_each(|lanes| lanes[lane] = 0.0);
                continue;
            }
            let (node, factor) = self.made(row, channel);
            let radiant = row >= self.factors.rows();
            for (column, lanes) in plane.iter_mut().enumerate() {
                let at = node * n + column;
                lanes[lane] = if radiant { factor as f32 * (t[at] + indirect[1][at]) } else { indirect[0][at] };
            }
        }
    }

    /// The blocks of a group one behind the other, their norms put together band by band.
    fn join(
        &self,
        group: usize,
        blocks: &[(usize, std::ops::Range<usize>)],
        solved: &[(Vec<CompressedGroup>, Told)],
        bands: &Bands,
        lost: &[Norms],
    ) -> CompressedGroup {
        let (count, channels) = (bands.count(), self.channels.count());
        let mut all = CompressedGroup::default();
        let mut squares = [vec![0.0; GROUP * count * channels], vec![0.0; GROUP * count * channels]];
        for ((band, columns), (groups, _)) in blocks.iter().zip(solved) {
            let own = &groups[group];
            all.columns.extend(own.columns.iter().map(|column| column + columns.start as u32));
            all.shifts.extend(&own.shifts);
            all.values.extend(&own.values);
            for (squares, norms) in squares.iter_mut().zip([&own.kept, &own.dropped]) {
                for (k, &norm) in norms.iter().enumerate() {
                    let (lane, channel) = (k / channels, k % channels);
                    squares[(lane * count + band) * channels + channel] += f64::from(bf16(norm)).powi(2);
                }
            }
        }
        let norms = squares.map(|squares| squares.into_iter().map(|square: f64| square.sqrt() * MARGIN));
        let [kept, dropped] = norms;
        all.kept = kept.map(bf16_up).collect();
        let mut dropped: Vec<f64> = dropped.collect();
        for lane in 0..GROUP.min(self.rows() - group * GROUP) {
            for (channel, lost) in lost.iter().enumerate() {
                let (node, factor) = self.made(group * GROUP + lane, channel);
                let radiant = group * GROUP + lane >= self.factors.rows();
                for band in 0..count {
                    let (direct, indirect) = (lost.direct[node * count + band], lost.indirect[node * count + band]);
                    let more = if radiant { factor * (direct + indirect) } else { indirect };
                    dropped[(lane * count + band) * channels + channel] += more * MARGIN;
                }
            }
        }
        all.dropped = dropped.into_iter().map(bf16_up).collect();
        all
    }
}

/// Norms of rows, nodes x bands: of T, and no less than those of I.
struct Norms {
    direct: Vec<f64>,
    indirect: Vec<f64>,
}

/// Some columns of a transport of one channel, row by row.
fn dense(tiles: &[Tile], columns: std::ops::Range<usize>, quantum: i32) -> Vec<f32> {
    let n = columns.len();
    let rows: usize = tiles.iter().map(|tile| tile.rows).sum();
    let mut dense = vec![0.0; rows * n];
    let mut first = 0;
    for tile in tiles {
        for (place, column) in columns.clone().enumerate() {
            for entry in tile.entries(column) {
                let row = first + group_of(tile.words[entry]) * GROUP;
                for (lane, &value) in tile.lanes(entry, 0, quantum).iter().enumerate().take(rows - row) {
                    dense[(row + lane) * n + place] = value;
                }
            }
        }
        first += tile.rows;
    }
    dense
}

/// The sum of the first bounces, and of one less; `each` sees every bounce.
fn neumann<T: Real>(
    operator: &Operator,
    t: &[T],
    n: usize,
    bounces: usize,
    mut each: impl FnMut(usize, &[T]),
) -> [Vec<T>; 2] {
    let (mut term, mut sum, mut before) = (t.to_vec(), vec![T::default(); t.len()], vec![T::default(); t.len()]);
    for bounce in 0..bounces {
        before.copy_from_slice(&sum);
        term = operator.apply(&term, n);
        sum.iter_mut().zip(&term).for_each(|(sum, &term)| *sum += term);
        each(bounce, &term);
    }
    [sum, before]
}

/// What one block has to say of its solution.
#[derive(Default)]
struct Told {
    energies: Vec<f64>,
    products: Vec<usize>,
    residual: f64,
    krylov: bool,
    checks: Vec<[f64; 2]>,
}

impl Told {
    /// Sums of so many checks.
    fn checks(&mut self, count: usize) -> &mut [[f64; 2]] {
        self.checks.resize(count, [0.0; 2]);
        &mut self.checks
    }

    /// Adds the energy of a bounce.
    fn bounce(&mut self, bounce: usize, values: impl Iterator<Item = f64>, n: usize, areas: &[f64]) {
        self.energies.resize(self.energies.len().max(bounce + 1), 0.0);
        self.energies[bounce] += values.enumerate().map(|(k, x)| x * x * areas[k % n]).sum::<f64>();
    }

    fn solved(&mut self, first: &[f64], solved: &Solved, n: usize, areas: &[f64]) {
        self.bounce(0, first.iter().copied(), n, areas);
        self.bounce(1, solved.values.iter().zip(first).map(|(all, first)| all - first), n, areas);
        self.products.extend(&solved.products);
        self.residual = self.residual.max(solved.residual);
        self.krylov |= solved.krylov;
    }

    /// All blocks together.
    fn all<'a>(blocks: impl Iterator<Item = &'a Told>) -> Share {
        let mut all = Told::default();
        for told in blocks {
            all.energies.resize(all.energies.len().max(told.energies.len()), 0.0);
            all.energies.iter_mut().zip(&told.energies).for_each(|(sum, own)| *sum += own);
            all.products.extend(&told.products);
            all.residual = all.residual.max(told.residual);
            all.krylov |= told.krylov;
            let sums = all.checks(told.checks.len()).iter_mut().zip(&told.checks);
            sums.for_each(|(sums, own)| (0..2).for_each(|k| sums[k] += own[k]));
        }
        all.products.sort_unstable();
        let light = all.checks.iter().map(|sums| sums[1]).sum::<f64>() / all.checks.len().max(1) as f64;
        let at = |k: usize| all.products.get(k).copied().unwrap_or(0);
        let count = all.products.len();
        // Norms, not energies: what a bounce is in the light that is seen.
        let roots: Vec<f64> = all.energies.iter().map(|energy| energy.sqrt()).collect();
        let sum: f64 = roots.iter().sum();
        Share {
            bounces: roots.iter().map(|root| if sum > 0.0 { root / sum } else { 0.0 }).collect(),
            products: [at(0), at(count / 2), at(count.saturating_sub(1))],
            residual: all.residual,
            krylov: all.krylov,
            // In the light of all: a corner that next to none reaches has no error to speak of.
            discretisation: all
                .checks
                .iter()
                .map(|sums| if light > 0.0 { (sums[0] / light).sqrt() } else { 0.0 })
                .collect(),
        }
    }
}
