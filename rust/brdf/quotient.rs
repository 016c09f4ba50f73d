//! What is kept of a material when its curve is edited: a model's quotient, or all that a measured one is besides.

use std::sync::Arc;

use crate::error::{Error, Result};

use super::curve::{Share, abscissa_of_slope};
use super::direction::{Direction, Half};
use super::measured::Measured;
use super::model::Brdf;

/// What is kept of a material when its curve is edited.
#[derive(Clone, Debug)]
pub enum Quotient {
    /// Of a model, for all colours alike.
    Model(Arc<dyn Brdf>),
    /// All that a curve of a measured material does not say, so that with this curve it is the material: its colours over
    /// the curve's, which are above 0, at nodes evenly spaced over u.
    Measured(Arc<dyn Measured>, Vec<[f64; 3]>),
}

/// What many directions to the light take of a curve; all lists are as long.
#[derive(Clone, Debug, Default)]
pub struct Shares {
    /// Where the curve is looked up, from 0 to 1.
    pub u: Vec<f64>,
    /// h . wi
    pub cos_d: Vec<f64>,
    /// f cos theta_i over the curve and F.
    pub colours: [Vec<f64>; 3],
}

/// Places of a function that is linear between nodes evenly spaced from 0 to 1: a node, and the share of the next.
#[inline]
pub fn between(x: f64, nodes: usize) -> (usize, f64) {
    let place = x * (nodes - 1) as f64;
    let node = (place as usize).min(nodes.saturating_sub(2));
    (node, place - node as f64)
}

impl Quotient {
    /// Refuses models without a curve.
    pub fn of_model(model: Arc<dyn Brdf>) -> Result<Self> {
        match model.curved() {
            Some(_) => Ok(Quotient::Model(model)),
            None => Err(Error::input(format!("expected a model with a lobe whose curve can be edited, got {model:?}"))),
        }
    }

    /// Refuses curves that are not above 0 everywhere.
    pub fn of_measured(table: Arc<dyn Measured>, curve: Vec<[f64; 3]>) -> Result<Self> {
        if curve.len() < 2 || !curve.as_flattened().iter().all(|value| value.is_finite() && *value > 0.0) {
            return Err(Error::input("expected a curve of finite colours above 0 at two nodes or more"));
        }
        Ok(Quotient::Measured(table, curve))
    }

    /// What a pair of directions takes of the curve, in red, green and blue; None below the horizon.
    pub fn share(&self, wi: Direction, wo: Direction) -> Option<(Share, [f64; 3])> {
        let half = Half::between(wi, wo)?;
        match self {
            Quotient::Model(model) => {
                let share = model.curved()?.share(&half);
                Some((share, [share.quotient; 3]))
            }
            Quotient::Measured(table, curve) => {
                let slope = half.slope[0] * half.slope[0] + half.slope[1] * half.slope[1];
                let share = Share { u: abscissa_of_slope(slope), cos_d: half.cos_d, quotient: half.cos_i };
                let (node, rest) = between(share.u, curve.len());
                let colour = table.colour(wi, wo);
                let divided = |k: usize| {
                    let own = (1.0 - rest) * curve[node][k] + rest * curve[node + 1][k];
                    colour[k] * half.cos_i / own
                };
                Some((share, std::array::from_fn(divided)))
            }
        }
    }

    /// `share` of many directions to the light, one coordinate a list, and one to the eye; all 0 below the horizon.
    pub fn shares(&self, wi: [&[f64]; 3], wo: Direction, out: &mut Shares) {
        let count = wi[0].len();
        let Shares { u, cos_d, colours: [red, green, blue] } = out;
        [&mut *u, cos_d, red, green, blue].into_iter().for_each(|own| own.resize(count, 0.0));
        match self {
            Quotient::Model(model) => {
                let Some(curved) = model.curved() else { return };
                curved.shares(wi, wo, [u, cos_d, red]);
                green.copy_from_slice(red);
                blue.copy_from_slice(red);
            }
            Quotient::Measured(..) => {
                for k in 0..count {
                    let own = self.share(wi.map(|axis| axis[k]), wo);
                    (u[k], cos_d[k]) = own.map_or((0.0, 0.0), |(share, _)| (share.u, share.cos_d));
                    [red[k], green[k], blue[k]] = own.map_or([0.0; 3], |(_, colours)| colours);
                }
            }
        }
    }

    /// Radians of the half vector that an abscissa is off the highlight.
    pub fn off_highlight(&self, u: f64) -> f64 {
        let angle = std::f64::consts::SQRT_2 * u * u;
        let mirror = matches!(self, Quotient::Model(model) if model.curved().is_some_and(|own| own.about_mirror()));
        if mirror { 0.5 * angle } else { angle }
    }
}
