//! The share of unpolarised light that a smooth facet reflects.

use crate::error::{Error, Result};

use super::range::within;

/// How a facet reflects.
#[derive(Clone, Copy, Debug)]
pub enum Fresnel {
    /// All light: a colour of the highlight is a factor outside.
    None,
    /// F0 + (1 - F0) (1 - c)^5, by the reflectance at normal incidence (Schlick 1994, eq. 15).
    Schlick(f64),
    /// The Fresnel equations for an index of refraction n - ik against the medium that the light is in.
    Index {
        /// The real part; below 1 where the light is in the denser medium.
        n: f64,
        /// The extinction; 0 of a dielectric.
        k: f64,
    },
}

impl Fresnel {
    /// What at most one of two descriptions says.
    pub fn of(n: Option<f64>, k: Option<f64>, f0: Option<f64>) -> Result<Fresnel> {
        match (n, k, f0) {
            (None, None, None) => Ok(Fresnel::None),
            (None, None, Some(f0)) => Fresnel::schlick(f0),
            (Some(n), k, None) => Fresnel::index(n, k.unwrap_or(0.0)),
            (None, Some(_), _) => Err(Error::input("expected n beside k, got k alone")),
            (Some(_), _, Some(_)) => Err(Error::input("expected n or f0, got both")),
        }
    }

    /// By the reflectance at normal incidence.
    pub fn schlick(f0: f64) -> Result<Fresnel> {
        Ok(Fresnel::Schlick(within("f0", f0, 0.0, 1.0)?))
    }

    /// By the index of refraction.
    pub fn index(n: f64, k: f64) -> Result<Fresnel> {
        Ok(Fresnel::Index { n: within("n", n, 0.01, 100.0)?, k: within("k", k, 0.0, 100.0)? })
    }

    /// The reflectance at a cosine to the facet's normal, from 0 to 1.
    pub fn at(&self, cosine: f64) -> f64 {
        match *self {
            Fresnel::None => 1.0,
            Fresnel::Schlick(f0) => {
                let square = (1.0 - cosine) * (1.0 - cosine);
                f0 + (1.0 - f0) * (square * square * (1.0 - cosine))
            }
            Fresnel::Index { n, k } => index_of_refraction(n, k, cosine),
        }
    }
}

/// The mean of |r_s|² and |r_p|². With m = n - ik and q = sqrt(m² - sin²) = a - ib, the textbook's quotients are
///
/// ```text
///     r_s = (c - q) / (c + q) = (1 - m²) / (c + q)²        r_p = r_s (c q - sin²) / (c q + sin²)
/// ```
///
/// in which nothing cancels but at Brewster's angle, where it should.
fn index_of_refraction(n: f64, k: f64, c: f64) -> f64 {
    let sine2 = (1.0 - c) * (1.0 + c);
    let (real, imaginary) = ((n - 1.0) * (n + 1.0) - k * k + c * c, n * k);
    let modulus = length(real, 2.0 * imaginary);
    let larger = (0.5 * (modulus + real.abs())).sqrt();
    let smaller = if larger > 0.0 { imaginary / larger } else { 0.0 };
    let (a, b) = if real >= 0.0 { (larger, smaller) } else { (smaller, larger) };
    let s = length((n - 1.0) * (n + 1.0) - k * k, 2.0 * imaginary) / ((c + a) * (c + a) + b * b);
    let p = s * length(c * a - sine2, c * b) / length(c * a + sine2, c * b);
    (0.5 * (s * s + p * p)).min(1.0)
}

/// |x + iy|. Indices are bounded, so `hypot`, which is slow, has nothing to save here.
fn length(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}
