//! Facets whose slopes are normally distributed (Beckmann and Spizzichino 1963), elliptic along x and y.

use std::f64::consts::{PI, TAU};

use crate::error::Result;

use super::direction::{Direction, Half, unit};
use super::facets::Facets;
use super::range::roughness;

/// A roughness along the tangent x, and one along y.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slopes {
    alpha: [f64; 2],
}

impl Slopes {
    /// Checks both.
    pub fn new(names: [&str; 2], [x, y]: [f64; 2]) -> Result<Slopes> {
        Ok(Slopes { alpha: [roughness(names[0], x)?, roughness(names[1], y)?] })
    }

    /// (slope_x / alpha_x)² + (slope_y / alpha_y)²
    pub fn squared(&self, slope: [f64; 2]) -> f64 {
        let [x, y] = [slope[0] / self.alpha[0], slope[1] / self.alpha[1]];
        x * x + y * y
    }

    /// pi alpha_x alpha_y
    pub fn area(&self) -> f64 {
        PI * self.alpha[0] * self.alpha[1]
    }

    /// A direction in the frame whose x and y are measured in roughness.
    pub fn stretched(&self, [x, y, z]: Direction) -> Direction {
        [self.alpha[0] * x, self.alpha[1] * y, z]
    }

    /// Beckmann's distribution of normals: facets' area over that of the surface and solid angle, 1 / sr.
    pub fn normals(&self, half: &Half) -> f64 {
        self.density(half) / half.cos_h
    }
}

/// Density D cos theta_h (Walter 2005, eq. 6 and 7).
impl Facets for Slopes {
    fn sample(&self, u: [f64; 2]) -> Direction {
        let (radius, (sine, cosine)) = ((-(-u[0]).ln_1p()).sqrt(), (TAU * u[1]).sin_cos());
        unit([radius * self.alpha[0] * cosine, radius * self.alpha[1] * sine, 1.0])
    }

    fn density(&self, half: &Half) -> f64 {
        libm::exp(-self.squared(half.slope)) / (self.area() * (half.cos_h * half.cos_h * half.cos_h))
    }

    fn widths(&self) -> [f64; 2] {
        self.alpha
    }
}
