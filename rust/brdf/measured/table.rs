//! What a measured table is asked, and what its numbers must be.

use crate::error::{Error, Result};

use super::super::direction::Direction;
use super::super::model::Brdf;

/// Numbers along each side of the square that an albedo is the mean over.
const ALBEDO_SIDE: usize = 256;

/// A table. As a `Brdf` it is its luminance.
pub trait Measured: Brdf {
    /// Reflected radiance over irradiance in linear RGB, 1 / sr.
    fn colour(&self, wi: Direction, wo: Direction) -> [f64; 3];

    /// The directional albedo in three colours: the mean weight of 256 x 256 samples, to about 1e-3 (tables have a kink or a
    /// step in every cell, on which finer quadrature is lost).
    fn albedos(&self, wo: Direction) -> [f64; 3] {
        let centre = |k: usize| (k as f64 + 0.5) / ALBEDO_SIDE as f64;
        let mut sum = [0.0; 3];
        for k in 0..ALBEDO_SIDE * ALBEDO_SIDE {
            if let Some((wi, pdf)) = self.sample(wo, [centre(k / ALBEDO_SIDE), centre(k % ALBEDO_SIDE)]) {
                let colour = self.colour(wi, wo);
                (0..3).for_each(|c| sum[c] += colour[c] * wi[2] / pdf);
            }
        }
        sum.map(|sum| sum / (ALBEDO_SIDE * ALBEDO_SIDE) as f64)
    }
}

/// Luminance of linear RGB with the primaries of Rec. 709.
pub(super) fn luminance([r, g, b]: [f64; 3]) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Refuses a table of another length, and numbers that are negative, NaN or infinite.
pub(super) fn checked(name: &str, values: &[f32], length: Option<usize>) -> Result<()> {
    if length != Some(values.len()) {
        let length = length.map_or("fewer".to_owned(), |length| length.to_string());
        return Err(Error::input(format!("expected {length} numbers of {name}, got {}", values.len())));
    }
    match values.iter().find(|value| !(value.is_finite() && **value >= 0.0)) {
        Some(value) => Err(Error::input(format!("expected {name} of 0 or more and finite, got {value}"))),
        None => Ok(()),
    }
}
