//! The ranges of parameters.

use crate::error::{Error, Result};

/// Refuses a number outside a range.
pub(super) fn within(name: &str, value: f64, low: f64, high: f64) -> Result<f64> {
    if (low..=high).contains(&value) {
        return Ok(value);
    }
    Err(Error::input(format!("expected {name} from {low} to {high}, got {value}")))
}

/// A roughness: the root mean square slope of facets along one axis times the root of 2, or what stands for it.
pub(super) fn roughness(name: &str, value: f64) -> Result<f64> {
    const NARROWEST: f64 = 0.002;
    if value < NARROWEST {
        let message = format!("expected {name} of {NARROWEST} or more, got {value}: mirrors are not supported");
        return Err(Error::input(message));
    }
    within(name, value, NARROWEST, 10.0)
}

/// The power of a cosine, up to the one that is as narrow as a roughness of 0.002.
pub(super) fn exponent(name: &str, value: f64, narrowest: f64) -> Result<f64> {
    if value > narrowest && value.is_finite() {
        let message = format!("expected {name} of {narrowest} or less, got {value}: mirrors are not supported");
        return Err(Error::input(message));
    }
    within(name, value, 0.0, narrowest)
}
