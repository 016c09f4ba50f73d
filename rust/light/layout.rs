//! How a map's pixels lie on the sphere, and how it is turned.

use std::f64::consts::PI;

/// How a map's pixels lie on the sphere.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// `height` rows from the +Y pole, u = atan2(x, -z) / 2π along them.
    LatLong {
        /// Pixels in a row: 2π of longitude.
        width: usize,
        /// Rows, from pole to pole.
        height: usize,
    },
    /// Six faces of `size` x `size` texels.
    Cubemap {
        /// Texels along a face.
        size: usize,
    },
}

impl Layout {
    /// The number of pixels of the whole map.
    pub fn pixels(self) -> usize {
        match self {
            Layout::LatLong { width, height } => width * height,
            Layout::Cubemap { size } => 6 * size * size,
        }
    }

    /// The width of a pixel, in radians, where it is widest.
    pub(super) fn pitch(self) -> f64 {
        match self {
            Layout::LatLong { width, height } => (2.0 * PI / width as f64).max(PI / height as f64),
            Layout::Cubemap { size } => 2.0 / size as f64,
        }
    }
}

/// R^-1 d for an orthogonal R.
pub(super) fn unrotate(rotation: &[[f64; 3]; 3], d: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| rotation[0][k] * d[0] + rotation[1][k] * d[1] + rotation[2][k] * d[2])
}
