//! A surface that looks the same from everywhere.

use std::f64::consts::{FRAC_1_PI, TAU};

use super::direction::{Direction, above};
use super::model::{Brdf, dense};

/// f = 1 / pi. Sampled as the cosine.
#[derive(Clone, Copy, Debug)]
pub struct Lambert;

impl Brdf for Lambert {
    fn evaluate(&self, wi: Direction, wo: Direction) -> f64 {
        if above(wi) && above(wo) { FRAC_1_PI } else { 0.0 }
    }

    fn sample(&self, wo: Direction, u: [f64; 2]) -> Option<(Direction, f64)> {
        let (radius, (sine, cosine)) = (u[0].sqrt(), (TAU * u[1]).sin_cos());
        let wi = [radius * cosine, radius * sine, (1.0 - u[0]).sqrt()];
        dense(self, wi, wo)
    }

    fn pdf(&self, wi: Direction, wo: Direction) -> f64 {
        wi[2] * self.evaluate(wi, wo)
    }
}
