//! Families: a model over the range of its parameter, as few functions of the half vector that span all of it.
//!
//! ```text
//!     f(gamma, wi, wo) = f_E(gamma, delta) f_F(wi, wo),   f_E(gamma, .) ~ sum_k c_k(gamma) b_k      (Nguyen 2010, eq. 5 and 6)
//! ```
//!
//! ```text
//! edited.rs   f_E of six models, normalised; the printed forms beside them
//! axis.rs     the angles at which functions are kept
//! span.rs     b_k of a part of the range, and c_k of a parameter in it
//! lookup.rs   the same as a table for passes over many directions
//! ```
//!
//! The paper takes one basis for the whole range, from parameters spread evenly; no single linear basis serves both ends
//! of a wide range much better. So the range is cut into segments of equal logarithm, each with a basis of its own in which
//! both of its ends are exact: a parameter that crosses a border makes no jump. Only one segment's transport is live.

mod axis;
mod edited;
pub mod lookup;
mod span;

use std::sync::Arc;

use rayon::prelude::*;

use crate::brdf::Brdf;
use crate::error::{Error, Result};

use axis::Axis;
pub use edited::{Curve, Edited, MODELS, Model};
pub use lookup::Lookup;
use span::Span;

/// Segments that a family has at most: each is stored.
const SEGMENTS: usize = 3;
/// Functions that are live at most.
const LIVE: usize = 12;

/// How far a family is from f_E: the worst of some parameters.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    /// The largest difference, relative to the largest value of f_E.
    pub peak: f64,
    /// The integral of the difference's size times sin delta cos delta, relative to that of f_E.
    pub energy: f64,
    /// The root of the mean square over delta, 1 / sr: the paper's measure.
    pub rms: f64,
}

/// A basis of f_E over a range of its parameter.
#[derive(Clone, Debug)]
pub struct Family {
    edited: Edited,
    axis: Axis,
    /// One after the other, from the least parameter on.
    spans: Vec<Span>,
    /// Of each the models of its ends and of its middle.
    dense: Vec<Vec<Arc<dyn Brdf>>>,
}

/// Models of the ends of a range and of its middle.
fn dense(edited: Edited, [low, high]: [f64; 2]) -> Result<Vec<Arc<dyn Brdf>>> {
    [low, (low * high).sqrt(), high].into_iter().map(|gamma| edited.model(gamma)).collect()
}

impl Family {
    /// The fewest live functions that keep both relative errors of parameters held out within `error`, and of those the
    /// fewest segments.
    pub fn within(edited: Edited, range: [f64; 2], error: f64) -> Result<Family> {
        if !(error > 0.0 && error.is_finite()) {
            return Err(Error::input(format!("expected an error above 0, got {error}")));
        }
        let off = |family: &Family| {
            let Errors { peak, energy, .. } = family.errors();
            peak.max(energy)
        };
        let mut least = f64::INFINITY;
        for live in 2..=LIVE {
            let finest = Family::segmented(edited, range, live, SEGMENTS)?;
            least = off(&finest);
            if least > error {
                continue;
            }
            for segments in 1..SEGMENTS {
                let family = Family::segmented(edited, range, live, segments)?;
                if off(&family) <= error {
                    return Ok(family);
                }
            }
            return Ok(finest);
        }
        Err(Error::input(format!(
            "expected an error that {LIVE} live functions and {SEGMENTS} segments reach, {least:.2e} over this range, got {error}"
        )))
    }

    /// Segments of equal logarithm, whose ends are exact.
    pub fn segmented(edited: Edited, range: [f64; 2], live: usize, segments: usize) -> Result<Family> {
        edited.check(range)?;
        if !(2..=LIVE).contains(&live) || !(1..=SEGMENTS).contains(&segments) {
            return Err(Error::input(format!(
                "expected 2 to {LIVE} live functions and 1 to {SEGMENTS} segments, got {live} and {segments}"
            )));
        }
        let axis = Axis::logarithmic(edited.width(range));
        let border = |k: usize| match k {
            0 => range[0],
            k if k == segments => range[1],
            k => range[0] * (range[1] / range[0]).powf(k as f64 / segments as f64),
        };
        let spans = (0..segments).map(|k| Span::with_exact_ends(edited, &axis, [border(k), border(k + 1)], live));
        let dense = (0..segments).map(|k| dense(edited, [border(k), border(k + 1)])).collect::<Result<_>>()?;
        Ok(Family { edited, spans: spans.collect(), axis, dense })
    }

    /// The paper's: one basis of parameters and angles spread evenly, its mean apart. Of the `live` functions the mean is the
    /// first.
    pub fn even(edited: Edited, range: [f64; 2], live: usize) -> Result<Family> {
        edited.check(range)?;
        if !(2..=LIVE).contains(&live) {
            return Err(Error::input(format!("expected 2 to {LIVE} live functions, got {live}")));
        }
        let axis = Axis::even(edited.model == Model::Lafortune);
        let spans = vec![Span::about_mean(edited, &axis, range, live)];
        Ok(Family { edited, spans, axis, dense: vec![dense(edited, range)?] })
    }

    /// What is approximated.
    pub fn edited(&self) -> Edited {
        self.edited
    }

    /// Radians from the axis to where the narrowest lobe of a segment has fallen to 1 / e, seen along the normal.
    pub fn width(&self, segment: usize) -> f64 {
        let angle = (2.0 * self.edited.width(self.spans[segment].range)).sqrt();
        if self.edited.model == Model::Lafortune { angle } else { 2.0 * angle }
    }

    /// Models whose lobes together are as dense as any function of a segment is large: of its ends, and of its middle.
    pub fn dense(&self, segment: usize) -> &[Arc<dyn Brdf>] {
        &self.dense[segment]
    }

    /// Functions of a segment.
    pub fn live(&self) -> usize {
        self.spans[0].functions.len()
    }

    /// The parameters at which segments begin, and the last one's end.
    pub fn borders(&self) -> Vec<f64> {
        let first = self.spans[0].range[0];
        std::iter::once(first).chain(self.spans.iter().map(|span| span.range[1])).collect()
    }

    /// The segment of a parameter; a border belongs to the one below it.
    pub fn segment(&self, gamma: f64) -> Result<usize> {
        let [low, high] = [self.spans[0].range[0], self.spans[self.spans.len() - 1].range[1]];
        if !(low..=high).contains(&gamma) {
            return Err(Error::input(format!("expected gamma from {low} to {high}, got {gamma}")));
        }
        Ok(self.spans.partition_point(|span| span.range[1] < gamma))
    }

    /// c of a parameter, in the basis of its segment.
    pub fn coefficients(&self, gamma: f64) -> Result<Vec<f64>> {
        let segment = self.segment(gamma)?;
        Ok(self.spans[segment].coefficients(self.edited, &self.axis, gamma))
    }

    /// The functions of a segment at 1 - cos delta: linear between the angles of the axis.
    pub fn basis(&self, segment: usize, fall: f64) -> impl Iterator<Item = f64> {
        let (node, share) = self.axis.locate(fall);
        let between = move |values: &Vec<f64>| (1.0 - share) * values[node] + share * values[node + 1];
        self.spans[segment].functions.iter().map(between)
    }

    /// The functions of a segment as a table for passes over many pairs of directions.
    pub fn lookup(&self, segment: usize) -> Lookup {
        let width = self.edited.width(self.spans[segment].range);
        Lookup::new(self.edited, width, self.live(), |fall| self.basis(segment, fall).collect())
    }

    /// f_E as the basis gives it, at each 1 - cos delta.
    pub fn evaluate(&self, gamma: f64, falls: &[f64]) -> Result<Vec<f64>> {
        let (segment, c) = (self.segment(gamma)?, self.coefficients(gamma)?);
        let value = |&fall: &f64| self.basis(segment, fall).zip(&c).map(|(b, c)| b * c).sum();
        Ok(falls.iter().map(value).collect())
    }

    /// The errors of one parameter.
    pub fn errors_at(&self, gamma: f64) -> Result<Errors> {
        let probes = self.axis.probes();
        let falls: Vec<f64> = probes.iter().map(|probe| probe.fall).collect();
        let found = self.evaluate(gamma, &falls)?;
        let (mut largest, mut whole, mut errors, mut angles) = (0.0f64, 0.0, Errors::default(), 0.0);
        for (probe, found) in probes.iter().zip(found) {
            let exact = self.edited.value(gamma, probe.fall);
            let off = (found - exact).abs();
            largest = largest.max(exact);
            whole += probe.energy * exact;
            angles += probe.angle;
            errors.peak = errors.peak.max(off);
            errors.energy += probe.energy * off;
            errors.rms += probe.angle * off * off;
        }
        let Errors { peak, energy, rms } = errors;
        Ok(Errors { peak: peak / largest, energy: energy / whole, rms: (rms / angles).sqrt() })
    }

    /// The worst of all parameters that are held out: between those that the bases were made of.
    pub fn errors(&self) -> Errors {
        let held: Vec<f64> = self.spans.iter().flat_map(Span::held_out).collect();
        let worst = |a: Errors, b: Errors| Errors {
            peak: a.peak.max(b.peak),
            energy: a.energy.max(b.energy),
            rms: a.rms.max(b.rms),
        };
        // Parameters held out lie within the range.
        held.par_iter().filter_map(|&gamma| self.errors_at(gamma).ok()).reduce(Errors::default, worst)
    }
}
