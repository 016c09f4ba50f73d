//! The camera: where the primary rays start and lead.

use crate::error::{Error, Result};

/// A perspective camera, its frame already made orthonormal by the caller.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    /// The eye, in world coordinates.
    pub position: [f64; 3],
    /// Unit vector to the right of the picture.
    pub right: [f64; 3],
    /// Unit vector to its top.
    pub up: [f64; 3],
    /// Unit vector into the scene.
    pub forward: [f64; 3],
    /// Tangent of half the vertical field of view.
    pub half_height: f64,
    /// Pixels in a row.
    pub width: usize,
    /// Rows of pixels.
    pub height: usize,
}

impl Camera {
    /// The most pixels along a side.
    const MAX_SIDE: usize = 16384;

    /// Refuses pictures that are empty or too large, numbers that are not finite, and fields of view that are not above 0.
    pub fn check(&self) -> Result<()> {
        let sides = [self.width, self.height];
        if sides.iter().any(|&side| side == 0 || side > Self::MAX_SIDE) {
            return Err(Error::input(format!(
                "expected a picture of 1 to {} pixels a side, got {sides:?}",
                Self::MAX_SIDE
            )));
        }
        let frame = [self.position, self.right, self.up, self.forward];
        if !(self.half_height > 0.0 && self.half_height.is_finite() && frame.iter().flatten().all(|x| x.is_finite())) {
            return Err(Error::input("expected a camera with a finite position and frame and a field of view above 0"));
        }
        Ok(())
    }

    /// The unit direction through a point of the picture, in pixels from its top left corner.
    pub fn direction(&self, x: f64, y: f64) -> [f64; 3] {
        let scale = 2.0 * self.half_height / self.height as f64;
        let (s, t) = ((x - 0.5 * self.width as f64) * scale, (0.5 * self.height as f64 - y) * scale);
        let d: [f64; 3] = std::array::from_fn(|k| self.forward[k] + s * self.right[k] + t * self.up[k]);
        let length = d.iter().map(|c| c * c).sum::<f64>().sqrt();
        d.map(|c| c / length)
    }
}
