//! Receivers: what the rows of M are.

use super::tile::Slab;

/// What turns rows into an image: one item a row, and the light that passes by the scene.
#[derive(Clone)]
pub struct ReceiverTable {
    /// The pixel that a row adds to, row-major.
    pub pixel: Slab<u32>,
    /// What share of the pixel the row is.
    pub weight: Slab<f32>,
    /// Diffuse reflectance, `[row][rgb]`.
    pub albedo: Slab<f32>,
    /// World coordinates, `[row][xyz]`.
    pub position: Slab<f32>,
    pub normal: Slab<f32>,
    pub material: Option<Slab<u16>>,
    /// What share of each pixel sees no surface.
    pub background: Slab<f32>,
}

impl ReceiverTable {
    /// Whether there is one item a row and a pixel, pixels exist, and all numbers are finite, shares not negative.
    pub fn check(&self, rows: usize, image: [usize; 2]) -> std::result::Result<(), String> {
        let pixels = image[0].checked_mul(image[1]).ok_or("expected an image of at most 2^28 pixels")?;
        let lengths = [
            ("pixel", self.pixel.len(), rows),
            ("weight", self.weight.len(), rows),
            ("albedo", self.albedo.len(), 3 * rows),
            ("position", self.position.len(), 3 * rows),
            ("normal", self.normal.len(), 3 * rows),
            ("material", self.material.as_ref().map_or(rows, |items| items.len()), rows),
            ("background", self.background.len(), pixels),
        ];
        if let Some((what, found, expected)) = lengths.into_iter().find(|(_, found, expected)| found != expected) {
            return Err(format!("expected {expected} numbers of {what}, found {found}"));
        }
        if let Some(pixel) = self.pixel.iter().find(|&&pixel| pixel as usize >= pixels) {
            return Err(format!("expected pixels below {pixels}, found {pixel}"));
        }
        let shares = [("weight", &self.weight), ("albedo", &self.albedo), ("background", &self.background)];
        for (what, items) in shares {
            if let Some(item) = items.iter().find(|item| !(item.is_finite() && **item >= 0.0)) {
                return Err(format!("expected finite {what} values >= 0, found {item}"));
            }
        }
        for (what, items) in [("position", &self.position), ("normal", &self.normal)] {
            if let Some(item) = items.iter().find(|item| !item.is_finite()) {
                return Err(format!("expected finite {what} values, found {item}"));
            }
        }
        Ok(())
    }

    pub fn nbytes(&self) -> usize {
        let floats = self.weight.len() + self.albedo.len() + self.position.len() + self.normal.len();
        let material = self.material.as_ref().map_or(0, |material| material.len());
        4 * (self.pixel.len() + floats + self.background.len()) + 2 * material
    }
}
