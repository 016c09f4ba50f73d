//! Facets whose slopes are normally distributed (Beckmann and Spizzichino 1963), elliptic along x and y.

use std::f64::consts::{PI, TAU};

use crate::error::Result;

use super::curve::{abscissa_of_slope, slope_at};
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
    #[inline]
    pub fn squared(&self, slope: [f64; 2]) -> f64 {
        let [x, y] = [slope[0] / self.alpha[0], slope[1] / self.alpha[1]];
        x * x + y * y
    }

    /// pi alpha_x alpha_y
    pub fn area(&self) -> f64 {
        PI * self.alpha[0] * self.alpha[1]
    }

    /// The narrower roughness, by which curves are measured.
    #[inline]
    fn narrow(&self) -> f64 {
        self.alpha[0].min(self.alpha[1])
    }

    /// The abscissa of a curve at which two directions look it up: that of a slope whose ellipse has been made a circle of the
    /// narrower roughness. And cos⁴ of its angle over cos⁴ theta_h, which a curve of angles cannot hold.
    #[inline]
    pub fn abscissa(&self, half: &Half) -> (f64, f64) {
        let square = self.squared(half.slope) * self.narrow() * self.narrow();
        let plain = half.slope[0] * half.slope[0] + half.slope[1] * half.slope[1];
        let ratio = (1.0 + plain) / (1.0 + square);
        (abscissa_of_slope(square), ratio * ratio)
    }

    /// exp(-tan²) of the slope at an abscissa over the roughness, and that angle's cos⁴.
    pub fn at(&self, u: f64) -> (f64, f64) {
        let [square, cosine] = slope_at(u);
        ((-square / (self.narrow() * self.narrow())).exp(), cosine.powi(4))
    }

    /// cos⁴ (1 + tan² over the roughness)² at an abscissa, in which the tangent is no infinity at the horizon.
    pub fn ellipsoid(&self, u: f64) -> f64 {
        let versine = u.powi(4);
        let (cosine, sine) = (1.0 - versine, versine * (2.0 - versine));
        (cosine * cosine + sine / (self.narrow() * self.narrow())).powi(2)
    }

    /// Beckmann's distribution at an abscissa.
    pub fn normals_at(&self, u: f64) -> f64 {
        let (exponential, cosine4) = self.at(u);
        // Where the exponential has vanished its quotient has as well.
        if exponential > 0.0 { exponential / (self.area() * cosine4) } else { 0.0 }
    }

    /// A direction in the frame whose x and y are measured in roughness.
    #[inline]
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
