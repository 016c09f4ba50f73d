//! How a map's pixels lie on the sphere, and how it is turned.

use std::f64::consts::PI;

/// Where the rows of a lat-long image lie between the poles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rows {
    /// Row i of h at (i + 1/2) / h: pixels are areas (Blender, and panoramas as cameras and stitchers write them).
    Centre,
    /// Row i of h at i / (h - 1): the first and the last are the poles (Mitsuba and OpenEXR).
    Edge,
}

impl Rows {
    /// How many rows there are from pole to pole, and how far row 0 lies from its pole.
    pub(super) fn span(self, height: usize) -> (f64, f64) {
        match self {
            Rows::Centre => (height as f64, 0.5),
            Rows::Edge => (height as f64 - 1.0, 0.0),
        }
    }

    /// The angle from +Y of a line within row k: part 0 of `parts` is its upper edge, the last its lower one.
    pub(super) fn angle(self, height: usize, k: usize, part: f64, parts: usize) -> f64 {
        match self {
            Rows::Centre => PI * ((k * parts) as f64 + part) / (height * parts) as f64,
            Rows::Edge => {
                // Rows at the poles are half as high as others.
                let line = |k: usize| ((k as f64 - 0.5) / (height as f64 - 1.0)).clamp(0.0, 1.0);
                PI * (line(k) + (line(k + 1) - line(k)) * part / parts as f64)
            }
        }
    }
}

/// How a map's pixels lie on the sphere.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// `height` rows from the +Y pole, u = atan2(x, -z) / 2π along them.
    LatLong {
        /// Pixels in a row: 2π of longitude.
        width: usize,
        /// Rows, from pole to pole.
        height: usize,
        /// Where they lie.
        rows: Rows,
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
            Layout::LatLong { width, height, .. } => width * height,
            Layout::Cubemap { size } => 6 * size * size,
        }
    }

    /// The width of a pixel, in radians, where it is widest.
    pub(super) fn pitch(self) -> f64 {
        match self {
            Layout::LatLong { width, height, rows } => (2.0 * PI / width as f64).max(PI / rows.span(height).0.max(1.0)),
            Layout::Cubemap { size } => 2.0 / size as f64,
        }
    }
}

/// R^-1 d for an orthogonal R.
pub(super) fn unrotate(rotation: &[[f64; 3]; 3], d: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| rotation[0][k] * d[0] + rotation[1][k] * d[1] + rotation[2][k] * d[2])
}
