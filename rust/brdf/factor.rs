//! One factor of a lobe: a function of the direction to the light alone, as a table.
//!
//! ```text
//!     f(wi, wo) cos theta_i = sum_k g_k(wi) h_k(wo)        (Overbeck 2006, eq. 7.1)
//! ```

use std::f64::consts::{FRAC_PI_2, TAU};

use super::direction::{Direction, above};
use crate::error::{Error, Result};

/// g_k over the hemisphere, signed: rings of equal angles to the normal, columns of equal azimuths.
#[derive(Clone, Debug)]
pub struct Factor {
    rings: usize,
    columns: usize,
    /// At the middles of the cells, ring after ring from the normal down.
    values: Vec<f32>,
}

impl Factor {
    /// Refuses tables of another size, and numbers that are not finite.
    pub fn new(rings: usize, columns: usize, values: Vec<f32>) -> Result<Self> {
        if rings == 0 || columns == 0 || rings.checked_mul(columns) != Some(values.len()) {
            let found = values.len();
            return Err(Error::input(format!("expected {rings} x {columns} numbers of a factor, got {found}")));
        }
        match values.iter().find(|value| !value.is_finite()) {
            Some(value) => Err(Error::input(format!("expected finite numbers of a factor, got {value}"))),
            None => Ok(Factor { rings, columns, values }),
        }
    }

    /// g at a direction, linear between the middles of cells; 0 below the horizon.
    pub fn value(&self, wi: Direction) -> f64 {
        if !above(wi) {
            return 0.0;
        }
        let ring = (wi[2].min(1.0).acos() / FRAC_PI_2 * self.rings as f64 - 0.5).clamp(0.0, self.rings as f64 - 1.0);
        let turn = wi[1].atan2(wi[0]).rem_euclid(TAU) / TAU * self.columns as f64 - 0.5;
        let (low, left) = (ring.floor(), turn.floor());
        let (down, right) = (ring - low, turn - left);
        let row = |ring: usize| {
            let at = |column: f64| {
                let column = column.rem_euclid(self.columns as f64) as usize % self.columns;
                f64::from(self.values[ring * self.columns + column])
            };
            (1.0 - right) * at(left) + right * at(left + 1.0)
        };
        let low = low as usize;
        (1.0 - down) * row(low) + down * row((low + 1).min(self.rings - 1))
    }

    /// Radians that its cells are wide: it changes no faster.
    pub fn width(&self) -> f64 {
        FRAC_PI_2 / self.rings as f64
    }
}
