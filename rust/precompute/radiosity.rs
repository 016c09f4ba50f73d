//! The radiosity equation x = b + F rho x, for several columns at once, to a residual that is proved.
//!
//! ```text
//!     w = v - F rho v > 0,  r = b + F rho y - y,  q = r / w      =>      |x - y| <= v max |q|
//!     y + v (max q + min q) / 2 is off by no more than               v (max q - min q) / 2       (centring, after Neumann)
//! ```
//!
//! F's rows sum to 1 at most, so that (1 - F rho)^-1 is positive: whatever brings r below kappa w in every node brings x
//! to within kappa v. v is found once, by the furnace: nearly the answer to a scene that glows everywhere.
//!
//! A residual oscillates after BiCGStab, which would make its bound up to 300 times too large: a few plain steps
//! (y += r, r = F rho r), until the bound falls no faster than light does, leave what is smooth, for which it is tight.
//! Centring would take just that away again, and leave a bound that is lower but 160 times the error.

use std::ops::{Add, AddAssign, Mul};

use super::links::Counts;
use crate::error::{Error, Result};
use crate::twice::compiled_twice;

/// Most products with F for a column before it is given up.
const MOST: usize = 10_000;
/// Terms of the Neumann series that are preferred to BiCGStab.
const FEW: usize = 30;
/// Plain steps after BiCGStab, at most, whether or not the bound is low enough: it comes near the error with them.
const SMOOTHING: usize = 12;
/// BiCGStab ends where its bound is so many times what is wanted; again and again, where the plain steps after it do not do.
const NEAR: [f64; 4] = [1.0, 0.1, 0.01, 0.001];
/// A bound that falls no faster than this in a step has settled.
const SETTLED: f64 = 0.9;
/// What rounding may add to a residual, relative to the largest value.
const ROUNDING: f64 = 1e-13;

/// A number in either width.
pub trait Real: Copy + Default + Send + Sync + Add<Output = Self> + Mul<Output = Self> + AddAssign + From<f32> {}
impl Real for f32 {}
impl Real for f64 {}

/// F rho, row by row.
pub struct Operator<'a> {
    factors: &'a Counts,
    /// rho of each node.
    albedo: Vec<f32>,
    /// rho_h times the share of a ray, for each stored count.
    weights: Vec<f32>,
}

/// The answers for some columns.
pub struct Solved {
    /// Row by row.
    pub values: Vec<f64>,
    /// For each column: x is off by no more than this times `furnace` in every node.
    pub errors: Vec<f64>,
    /// v.
    pub furnace: Vec<f64>,
    /// Products with F that each column took.
    pub products: Vec<usize>,
    /// The largest error over all nodes, relative to the largest value of the column: the worst of the columns.
    pub residual: f64,
    /// Whether BiCGStab was needed.
    pub krylov: bool,
}

/// One row's sums in the columns from `first` on, and how many they are.
#[inline(always)]
fn spread<T: Real, const N: usize>(pairs: (&[u32], &[f32]), x: &[T], n: usize, first: usize, out: &mut [T]) -> usize {
    let mut sums = [T::default(); N];
    for (&node, &weight) in pairs.0.iter().zip(pairs.1) {
        let own = &x[node as usize * n + first..][..N];
        let weight = T::from(weight);
        (0..N).for_each(|k| sums[k] += own[k] * weight);
    }
    out[first..first + N].copy_from_slice(&sums);
    N
}

compiled_twice! {
    fn applied[T: Real](operator: &Operator<'_>, x: &[T], n: usize) -> Vec<T> = Operator::apply_any;
}

impl<'a> Operator<'a> {
    /// Of nodes with these albedos.
    pub fn new(factors: &'a Counts, albedo: Vec<f32>) -> Self {
        let unit = 1.0 / factors.rays as f32;
        let weight = |(&node, &count): (&u32, &u16)| f32::from(count) * unit * albedo[node as usize];
        let weights = factors.nodes.iter().zip(&factors.counts).map(weight).collect();
        Operator { factors, albedo, weights }
    }

    /// F rho X for X of nodes x n.
    pub fn apply<T: Real>(&self, x: &[T], n: usize) -> Vec<T> {
        applied(self, x, n)
    }

    #[inline(always)]
    fn apply_any<T: Real>(&self, x: &[T], n: usize) -> Vec<T> {
        let mut out = vec![T::default(); x.len()];
        for (row, out) in out.chunks_exact_mut(n).enumerate() {
            let range = self.factors.starts[row] as usize..self.factors.starts[row + 1] as usize;
            let pairs = (&self.factors.nodes[range.clone()], &self.weights[range]);
            let mut first = 0;
            while first < n {
                // PERF: as many sums as registers hold, their number known to the compiler.
                first += match n - first {
                    64.. => spread::<T, 64>(pairs, x, n, first, out),
                    16.. => spread::<T, 16>(pairs, x, n, first, out),
                    _ => spread::<T, 1>(pairs, x, n, first, out),
                };
            }
        }
        out
    }

    /// The largest share of light that a node passes on.
    fn largest(&self) -> f64 {
        let sum = |row: &[u32]| self.weights[row[0] as usize..row[1] as usize].iter().map(|&w| f64::from(w)).sum();
        self.factors.starts.windows(2).map(sum).fold(0.0, f64::max)
    }
}

/// Solves x = b + F rho x for b of nodes x n, each column to `residual` of its largest value.
pub fn solve(operator: &Operator, b: &[f64], n: usize, residual: f64) -> Result<Solved> {
    if !(residual > 0.0 && residual < 1.0) {
        return Err(Error::input(format!("expected a residual above 0 and below 1, got {residual}")));
    }
    if operator.albedo.iter().any(|&rho| !(0.0..1.0).contains(&rho)) {
        return Err(Error::input("expected albedos of at least 0 and below 1 where light bounces without end"));
    }
    let furnace = Furnace::new(operator)?;
    let mut columns = Columns::new(operator, &furnace, b, n, residual);
    let largest = operator.largest();
    let terms = (residual * (1.0 - largest)).ln() / largest.max(1e-12).ln();
    let krylov = terms > FEW as f64;
    if krylov {
        for near in NEAR {
            columns.bicgstab(near);
            columns.settle();
            if columns.done().iter().all(|&done| done) {
                break;
            }
        }
    }
    columns.smooth()?;
    Ok(columns.finish(krylov))
}

/// v and w = v - F rho v > 0.
struct Furnace {
    v: Vec<f64>,
    w: Vec<f64>,
    largest: f64,
}

impl Furnace {
    fn new(operator: &Operator) -> Result<Furnace> {
        let ones = vec![1.0; operator.albedo.len()];
        let mut v = ones.clone();
        // Any v with a positive w serves; one with w near 1 makes the bound tight.
        let (mut lower, mut upper) = (0.0, 0.0);
        if operator.largest() > 0.5 {
            let plain = Furnace { v: ones.clone(), w: ones.clone(), largest: 1.0 };
            let mut columns = Columns::new(operator, &plain, &ones, 1, 1e-2);
            columns.bicgstab(1.0);
            for _ in 0..SMOOTHING {
                columns.step();
            }
            v = columns.y;
        }
        let mut w = vec![0.0; v.len()];
        for _ in 0..MOST {
            let next = operator.apply(&v, 1);
            w.iter_mut().zip(&v).zip(&next).for_each(|((w, v), next)| *w = v - next);
            (lower, upper) = w.iter().fold((f64::MAX, f64::MIN), |(low, high), &w| (w.min(low), w.max(high)));
            if lower > 0.1 * upper && v.iter().all(|&v| v > 0.0) {
                break;
            }
            // One more bounce of the furnace: v = 1 + F rho v.
            v.iter_mut().zip(&next).for_each(|(v, next)| *v = 1.0 + next);
        }
        if v.is_empty() || lower > 0.0 {
            let largest = v.iter().fold(0.0, |most: f64, &v| most.max(v));
            return Ok(Furnace { v, w, largest });
        }
        Err(Error::input(format!(
            "expected light that fades as it bounces, but the furnace does not: {lower:.3e} to {upper:.3e}"
        )))
    }
}

/// Columns on their way to an answer, row by row.
struct Columns<'a> {
    operator: &'a Operator<'a>,
    furnace: &'a Furnace,
    n: usize,
    wanted: f64,
    b: Vec<f64>,
    y: Vec<f64>,
    /// b + F rho y - y.
    r: Vec<f64>,
    products: Vec<usize>,
    /// Whether the middle of q is taken out at the end.
    centred: bool,
}

impl<'a> Columns<'a> {
    fn new(operator: &'a Operator, furnace: &'a Furnace, b: &[f64], n: usize, wanted: f64) -> Self {
        let (y, products) = (vec![0.0; b.len()], vec![0; n]);
        Columns { operator, furnace, n, wanted, b: b.to_vec(), y, r: b.to_vec(), products, centred: true }
    }

    /// For each column the largest and the least of r / w, and the largest magnitude of y.
    fn extremes(&self) -> Vec<[f64; 3]> {
        let mut found = vec![[f64::MIN, f64::MAX, 0.0]; self.n];
        let rows = self.r.chunks_exact(self.n).zip(self.y.chunks_exact(self.n));
        for ((r, y), w) in rows.zip(&self.furnace.w) {
            for (found, (r, y)) in found.iter_mut().zip(r.iter().zip(y)) {
                let q = r / w;
                *found = [found[0].max(q), found[1].min(q), found[2].max(y.abs())];
            }
        }
        found
    }

    /// By how much of the furnace's v each column may be off, and what is allowed.
    fn errors(&self) -> Vec<(f64, f64)> {
        let extremes = self.extremes();
        let all = extremes.iter().fold(0.0, |most: f64, own| most.max(own[2]));
        // A column that brings next to nothing need not be better than the others.
        let allowed = |largest: f64| self.wanted * largest.max(1e-3 * all) / self.furnace.largest.max(1e-300);
        extremes.iter().map(|own| (self.off(own), allowed(own[2]))).collect()
    }

    /// By how much of v a column may be off.
    fn off(&self, &[high, low, _]: &[f64; 3]) -> f64 {
        if self.centred { 0.5 * (high - low).max(0.0) } else { high.abs().max(low.abs()) }
    }

    /// Steps until no column's bound falls faster than light does.
    fn settle(&mut self) {
        for _ in 0..SMOOTHING {
            let before = self.errors();
            self.step();
            let settled = self.errors().iter().zip(&before).all(|(now, before)| now.0 >= SETTLED * before.0);
            if settled {
                break;
            }
        }
    }

    fn done(&self) -> Vec<bool> {
        self.errors().iter().map(|(error, allowed)| error <= allowed).collect()
    }

    /// y += r, r = F rho r: a term of the Neumann series.
    fn step(&mut self) {
        self.y.iter_mut().zip(&self.r).for_each(|(y, r)| *y += r);
        self.r = self.operator.apply(&self.r, self.n);
        self.products.iter_mut().for_each(|products| *products += 1);
    }

    /// Steps until all columns are done: each takes at least 1 - min w / max v off the bound.
    fn smooth(&mut self) -> Result<()> {
        for _ in 0..MOST {
            if self.done().iter().all(|&done| done) {
                return Ok(());
            }
            self.step();
        }
        Err(Error::input(format!("expected light that settles within {MOST} bounces")))
    }

    /// BiCGStab on 1 - F rho (van der Vorst 1992), each column with its own scalars, until the bound is `near` times what is
    /// wanted.
    fn bicgstab(&mut self, near: f64) {
        self.centred = false;
        let n = self.n;
        let mut shadow = self.r.clone();
        let (mut p, mut rho) = (self.r.clone(), self.dots(&shadow, &self.r));
        let mut left = vec![true; n];
        let start = self.sizes();
        for _ in 0..MOST {
            let errors = self.errors();
            let sizes = self.sizes();
            for column in 0..n {
                // Smoothing does the rest: the bound of an oscillating residual is far above its error.
                let near = errors[column].0 <= near * errors[column].1 || sizes[column] <= 1e-14 * start[column];
                left[column] &= !near;
            }
            if !left.iter().any(|&left| left) {
                break;
            }
            let image = self.image(&p);
            let alpha: Vec<f64> = ratios(&rho, &self.dots(&shadow, &image), &left);
            let s = combined(&self.r, &[(&image, &alpha.iter().map(|a| -a).collect::<Vec<_>>())], n);
            let t = self.image(&s);
            let omega: Vec<f64> = ratios(&self.dots(&t, &s), &self.dots(&t, &t), &left);
            self.y = combined(&self.y, &[(&p, &alpha), (&s, &omega)], n);
            self.r = combined(&s, &[(&t, &omega.iter().map(|w| -w).collect::<Vec<_>>())], n);
            left.iter().zip(&mut self.products).for_each(|(&left, products)| *products += 2 * usize::from(left));
            let next = self.dots(&shadow, &self.r);
            // Where a column breaks down it starts again from where it is.
            let beta: Vec<f64> = (0..n)
                .map(|c| {
                    let beta = next[c] / rho[c] * (alpha[c] / omega[c]);
                    if beta.is_finite() { beta } else { 0.0 }
                })
                .collect();
            let back: Vec<f64> = beta.iter().zip(&omega).map(|(b, w)| -b * w).collect();
            p = combined(&self.r, &[(&p, &beta), (&image, &back)], n);
            rho = next;
            for column in (0..n).filter(|&column| left[column]) {
                let size = sizes[column].max(1e-300);
                if beta[column] == 0.0 || rho[column].abs() < 1e-30 * size * size {
                    for row in 0..self.r.len() / n {
                        shadow[row * n + column] = self.r[row * n + column];
                        p[row * n + column] = self.r[row * n + column];
                    }
                    rho = self.dots(&shadow, &self.r);
                }
            }
        }
        // The recursive residual drifts from the true one.
        let image = self.operator.apply(&self.y, n);
        self.r = self.b.iter().zip(&image).zip(&self.y).map(|((b, image), y)| b + image - y).collect();
        self.products.iter_mut().for_each(|products| *products += 1);
    }

    /// (1 - F rho) x.
    fn image(&self, x: &[f64]) -> Vec<f64> {
        let spread = self.operator.apply(x, self.n);
        x.iter().zip(spread).map(|(x, spread)| x - spread).collect()
    }

    fn dots(&self, a: &[f64], b: &[f64]) -> Vec<f64> {
        let mut sums = vec![0.0; self.n];
        for (a, b) in a.chunks_exact(self.n).zip(b.chunks_exact(self.n)) {
            sums.iter_mut().zip(a.iter().zip(b)).for_each(|(sum, (a, b))| *sum += a * b);
        }
        sums
    }

    fn sizes(&self) -> Vec<f64> {
        self.dots(&self.r, &self.r).into_iter().map(f64::sqrt).collect()
    }

    /// Centres columns that are to be, and says how far each may be off.
    fn finish(mut self, krylov: bool) -> Solved {
        let extremes = self.extremes();
        let middle = |[high, low, _]: &[f64; 3]| if self.centred { 0.5 * (high + low) } else { 0.0 };
        for (y, v) in self.y.chunks_exact_mut(self.n).zip(&self.furnace.v) {
            y.iter_mut().zip(&extremes).for_each(|(y, own)| *y += middle(own) * v);
        }
        let errors: Vec<f64> = extremes.iter().map(|own| self.off(own) + ROUNDING * own[2]).collect();
        let all = extremes.iter().fold(0.0, |most: f64, own| most.max(own[2]));
        let relative = |(error, [_, _, largest]): (&f64, &[f64; 3])| {
            if all > 0.0 { error * self.furnace.largest / largest.max(1e-3 * all) } else { 0.0 }
        };
        let residual = errors.iter().zip(&extremes).map(relative).fold(0.0, f64::max);
        Solved { values: self.y, errors, furnace: self.furnace.v.clone(), products: self.products, residual, krylov }
    }
}

/// a / b, and 0 where the column is done or b is 0.
fn ratios(a: &[f64], b: &[f64], left: &[bool]) -> Vec<f64> {
    let ratio = |((a, b), left): ((&f64, &f64), &bool)| {
        let ratio = a / b;
        if *left && ratio.is_finite() { ratio } else { 0.0 }
    };
    a.iter().zip(b).zip(left).map(ratio).collect()
}

/// x plus other columns, each by its own factor.
fn combined(x: &[f64], others: &[(&[f64], &[f64])], n: usize) -> Vec<f64> {
    let mut sum = x.to_vec();
    for (other, factors) in others {
        for (sum, other) in sum.chunks_exact_mut(n).zip(other.chunks_exact(n)) {
            sum.iter_mut().zip(other.iter().zip(*factors)).for_each(|(sum, (x, factor))| *sum += x * factor);
        }
    }
    sum
}
