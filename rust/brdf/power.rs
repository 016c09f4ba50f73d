//! Facets whose normals are distributed as a power of the cosine, elliptic along x and y (Ashikhmin and Shirley 2000).

use std::f64::consts::TAU;

use crate::error::Result;

use super::curve::{abscissa_of_slope, abscissa_of_versine};
use super::direction::{Direction, Half};
use super::facets::Facets;
use super::range::exponent;

/// The exponent that is as narrow as a roughness of 0.002: 2 / 0.002².
const NARROWEST: f64 = 5e5;

/// An exponent along the tangent x, and one along y.
#[derive(Clone, Copy, Debug)]
pub(super) struct Power {
    exponent: [f64; 2],
}

impl Power {
    /// Checks both.
    pub fn new([x, y]: [f64; 2]) -> Result<Power> {
        Ok(Power { exponent: [exponent("exponent", x, NARROWEST)?, exponent("exponent_v", y, NARROWEST)?] })
    }

    /// (n . h) to the power e_x cos²phi_h + e_y sin²phi_h. The logarithm is that of 1 + tan²: a cosine near 1 has lost
    /// what a high power needs.
    pub fn of(&self, half: &Half) -> f64 {
        let [x, y] = half.slope.map(|s| s * s);
        let square = x + y;
        if square == 0.0 {
            return 1.0;
        }
        let exponent = (self.exponent[0] * x + self.exponent[1] * y) / square;
        libm::exp(-0.5 * exponent * libm::log1p(square))
    }

    /// The larger exponent, by which curves are measured.
    fn narrow(&self) -> f64 {
        self.exponent[0].max(self.exponent[1])
    }

    /// The abscissa of a curve at which two directions look it up: that of a cosine, which to the larger exponent is the power.
    #[inline]
    pub fn abscissa(&self, half: &Half) -> f64 {
        let narrow = self.narrow();
        let [x, y] = half.slope.map(|s| s * s);
        let square = x + y;
        if self.exponent[0] == self.exponent[1] {
            return abscissa_of_slope(square);
        }
        let share = if narrow > 0.0 && square > 0.0 {
            (self.exponent[0] * x + self.exponent[1] * y) / (square * narrow)
        } else {
            1.0
        };
        abscissa_of_versine(-(-0.5 * share * square.ln_1p()).exp_m1())
    }

    /// The power at an abscissa.
    pub fn at(&self, u: f64) -> f64 {
        (1.0 - u.powi(4)).powf(self.narrow())
    }

    /// sqrt((e_x + 1) (e_y + 1))
    pub fn root(&self) -> f64 {
        ((self.exponent[0] + 1.0) * (self.exponent[1] + 1.0)).sqrt()
    }
}

/// Eq. 6, 9 and 10.
impl Facets for Power {
    fn sample(&self, u: [f64; 2]) -> Direction {
        let (turned, straight) = (TAU * u[1]).sin_cos();
        let (y, x) = ((self.exponent[0] + 1.0).sqrt() * turned, (self.exponent[1] + 1.0).sqrt() * straight);
        let across = x.hypot(y);
        let (x, y) = (x / across, y / across);
        let logarithm = (-u[0]).ln_1p() / (self.exponent[0] * x * x + self.exponent[1] * y * y + 1.0);
        let sine = (-(2.0 * logarithm).exp_m1()).sqrt();
        [sine * x, sine * y, logarithm.exp()]
    }

    fn density(&self, half: &Half) -> f64 {
        self.root() / TAU * self.of(half)
    }

    fn widths(&self) -> [f64; 2] {
        self.exponent.map(|exponent| (2.0 / (exponent + 1.0)).sqrt())
    }
}
