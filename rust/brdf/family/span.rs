//! A basis of one part of a family's range.

use crate::basis::pca::{SparseRows, Subspace};

use super::axis::Axis;
use super::edited::Edited;

/// Parameters that the basis of a segment is made of.
const SNAPSHOTS: usize = 48;
/// Parameters that the paper's is made of, which it does not say.
const EVEN_SNAPSHOTS: usize = 100;
/// Rounds of power iteration: singular values fall by a factor of three and more from one to the next.
const ROUNDS: usize = 6;
/// Differences are weighed by this power of sin delta cos delta: 0 minds the peak most, 1 the energy. Six functions and three
/// segments keep both errors of all six models within 0.4 % from 0.27 to 0.49.
const POWER: f64 = 0.375;

/// Functions at the angles of an axis that span f_E over `range`.
#[derive(Clone, Debug)]
pub(super) struct Span {
    pub range: [f64; 2],
    /// b_k at each angle.
    pub functions: Vec<Vec<f64>>,
    /// What c_k are inner products with, plain ones.
    duals: Vec<Vec<f64>>,
    /// Whether the first function is the mean, whose coefficient is 1: it is taken off before the others are measured.
    mean: bool,
    /// How far the parameters that it was made of are apart: all logarithms by as much, or all parameters.
    evenly: bool,
}

/// f_E at the angles of an axis.
fn values(edited: Edited, axis: &Axis, gamma: f64) -> impl Iterator<Item = f64> {
    let curve = edited.at(gamma);
    axis.falls().iter().map(move |&fall| curve.value(edited.abscissa(fall)))
}

/// The same, each times a factor of its own.
fn sampled(edited: Edited, axis: &Axis, gamma: f64, factors: &[f64]) -> Vec<f64> {
    values(edited, axis, gamma).zip(factors).map(|(value, factor)| factor * value).collect()
}

impl Span {
    /// Both ends of the range, and then the principal axes of what they leave of all others.
    pub fn with_exact_ends(edited: Edited, axis: &Axis, range: [f64; 2], live: usize) -> Span {
        let factors: Vec<f64> = axis.weights(POWER).into_iter().map(f64::sqrt).collect();
        let mut span = Span { range, functions: Vec::new(), duals: Vec::new(), mean: false, evenly: false };
        let mut ends: Vec<Vec<f64>> = Vec::new();
        for gamma in range {
            let mut end = sampled(edited, axis, gamma, &factors);
            leave(&mut end, &ends);
            let length = dot(&end, &end).sqrt();
            end.iter_mut().for_each(|x| *x /= length);
            ends.push(end);
        }
        let left = span.parameters(SNAPSHOTS, 0.0).map(|gamma| {
            let mut row = sampled(edited, axis, gamma, &factors);
            leave(&mut row, &ends);
            row
        });
        let rows = dense(left);
        let axes = Subspace::about(&rows, vec![0.0; factors.len()], live - 2, ROUNDS).axes;
        let columns = (0..axes.width).map(|k| axes.rows().map(|row| row[k]).collect());
        for own in ends.into_iter().chain(columns) {
            span.functions.push(own.iter().zip(&factors).map(|(x, factor)| x / factor).collect());
            span.duals.push(own.iter().zip(&factors).map(|(x, factor)| x * factor).collect());
        }
        span
    }

    /// The mean of parameters spread evenly, and the principal axes of all differences from it (eq. 10 to 15).
    pub fn about_mean(edited: Edited, axis: &Axis, range: [f64; 2], live: usize) -> Span {
        let mut span = Span { range, functions: Vec::new(), duals: Vec::new(), mean: true, evenly: true };
        let ones = vec![1.0; axis.falls().len()];
        let rows = dense(span.parameters(EVEN_SNAPSHOTS, 0.0).map(|gamma| sampled(edited, axis, gamma, &ones)));
        let Subspace { mean, axes, .. } = Subspace::fit(&rows, live - 1, ROUNDS);
        span.functions.push(mean);
        for k in 0..axes.width {
            let own: Vec<f64> = axes.rows().map(|row| row[k]).collect();
            span.functions.push(own.clone());
            span.duals.push(own);
        }
        span
    }

    /// c of a parameter: K inner products.
    pub fn coefficients(&self, edited: Edited, axis: &Axis, gamma: f64) -> Vec<f64> {
        let mut values: Vec<f64> = values(edited, axis, gamma).collect();
        if self.mean {
            values.iter_mut().zip(&self.functions[0]).for_each(|(value, mean)| *value -= mean);
        }
        let first = self.mean.then_some(1.0);
        first.into_iter().chain(self.duals.iter().map(|dual| dot(dual, &values))).collect()
    }

    /// `count` parameters over the range, moved on by a share of the way to the next.
    fn parameters(&self, count: usize, moved: f64) -> impl Iterator<Item = f64> + use<> {
        let ([low, high], evenly) = (self.range, self.evenly);
        (0..count).map(move |k| {
            let share = (k as f64 + moved) / (count - 1) as f64;
            let gamma = if evenly { low + share * (high - low) } else { low * (high / low).powf(share) };
            gamma.clamp(low, high)
        })
    }

    /// Parameters halfway between those that the basis was made of.
    pub fn held_out(&self) -> impl Iterator<Item = f64> + use<> {
        let count = if self.evenly { EVEN_SNAPSHOTS } else { SNAPSHOTS };
        self.parameters(count, 0.5).take(count - 1)
    }
}

/// Rows of equal length.
fn dense(rows: impl Iterator<Item = Vec<f64>>) -> SparseRows {
    let mut all = SparseRows { starts: vec![0], ..Default::default() };
    for row in rows {
        all.width = row.len();
        all.columns.extend(0..row.len() as u32);
        all.values.extend(row);
        all.starts.push(all.values.len());
    }
    all
}

/// Takes off what lies along orthonormal vectors; twice is enough.
fn leave(row: &mut [f64], along: &[Vec<f64>]) {
    for own in along.iter().chain(along) {
        let share = dot(row, own);
        row.iter_mut().zip(own).for_each(|(x, own)| *x -= share * own);
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
