//! The tables of MERL (Matusik et al. 2003): isotropic, by the angles between the half vector and the normal, and between
//! the light and the half vector (Rusinkiewicz 1998).

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::error::{Error, Result};

use super::super::direction::{Direction, Half};
use super::super::facets::{Facets, HalfModel};
use super::table::{Measured, checked, luminance};

/// Cells of theta_h, whose root is even, of theta_d and of phi_d in half a turn: a table is its own mirror image.
pub const MERL: [usize; 3] = [90, 90, 180];

/// A table, looked up as MERL's own program does: the value of the cell, without interpolation. Sampled by rings of half
/// vectors, each as dense as the table is bright there on average.
#[derive(Debug)]
pub struct Merl {
    /// [theta_h][theta_d][phi_d], linear RGB.
    cells: Vec<[f32; 3]>,
    rings: Rings,
}

impl Merl {
    /// Takes the colours of all cells.
    pub fn new(cells: Vec<[f32; 3]>) -> Result<Merl> {
        checked("reflectance", cells.as_flattened(), Some(3 * MERL.iter().product::<usize>()))?;
        let of_ring = |ring: &[[f32; 3]]| ring.iter().map(|cell| luminance(cell.map(f64::from))).sum::<f64>();
        let rings = Rings::new(cells.chunks_exact(MERL[1] * MERL[2]).map(of_ring).collect())?;
        Ok(Merl { cells, rings })
    }

    fn cell(&self, half: &Half) -> [f64; 3] {
        let [x, y] = half.slope;
        let tangent = x.hypot(y);
        // A frame whose z is the half vector and whose x lies in the plane of it and the normal.
        let (cosine, sine) = if tangent > 0.0 { (x / tangent, y / tangent) } else { (1.0, 0.0) };
        let sine_h = half.cos_h * tangent;
        let across = half.wi[1] * cosine - half.wi[0] * sine;
        let down = (half.wi[0] * cosine + half.wi[1] * sine) * half.cos_h - half.wi[2] * sine_h;
        let theta_d = across.hypot(down).atan2(half.cos_d);
        let phi_d = across.atan2(down).rem_euclid(PI);
        let place = [(tangent.atan() / FRAC_PI_2).sqrt(), theta_d / FRAC_PI_2, phi_d / PI];
        let [h, d, phi] = std::array::from_fn(|k| ((place[k] * MERL[k] as f64) as usize).min(MERL[k] - 1));
        self.cells[(h * MERL[1] + d) * MERL[2] + phi].map(f64::from)
    }
}

impl Measured for Merl {
    fn colour(&self, wi: Direction, wo: Direction) -> [f64; 3] {
        Half::between(wi, wo).map_or([0.0; 3], |half| self.cell(&half))
    }
}

impl HalfModel for Merl {
    fn value(&self, half: &Half) -> f64 {
        luminance(self.cell(half))
    }

    fn facets(&self) -> &impl Facets {
        &self.rings
    }
}

/// Half vectors as dense in each ring of theta_h as the ring's mean, times the cosine; evenly inside it.
#[derive(Debug)]
struct Rings {
    /// Shares of all rings before each, and 1.
    before: Vec<f64>,
}

/// 1 - cos theta_h where a ring begins.
fn versine(ring: usize) -> f64 {
    let root = ring as f64 / MERL[0] as f64;
    let sine = (0.5 * FRAC_PI_2 * root * root).sin();
    2.0 * sine * sine
}

impl Rings {
    /// By sums of as many values each.
    fn new(sums: Vec<f64>) -> Result<Rings> {
        let mut before = vec![0.0];
        for (ring, sum) in sums.iter().enumerate() {
            let (low, high) = (versine(ring), versine(ring + 1));
            before.push(before[ring] + sum * (high - low) * (1.0 - 0.5 * (low + high)));
        }
        let total = before[sums.len()];
        if total <= 0.0 {
            return Err(Error::input("expected a table that reflects something, got zeros"));
        }
        before.iter_mut().for_each(|share| *share /= total);
        Ok(Rings { before })
    }

    /// The density over solid angle in a ring.
    fn in_ring(&self, ring: usize) -> f64 {
        (self.before[ring + 1] - self.before[ring]) / (TAU * (versine(ring + 1) - versine(ring)))
    }
}

impl Facets for Rings {
    fn sample(&self, u: [f64; 2]) -> Direction {
        let ring = self.before.partition_point(|share| *share <= u[0]).clamp(1, MERL[0]) - 1;
        let inside = (u[0] - self.before[ring]) / (self.before[ring + 1] - self.before[ring]);
        let versine = versine(ring) + inside * (versine(ring + 1) - versine(ring));
        let (sine, (y, x)) = ((versine * (2.0 - versine)).sqrt(), (TAU * u[1]).sin_cos());
        [sine * x, sine * y, 1.0 - versine]
    }

    fn density(&self, half: &Half) -> f64 {
        let root = (half.slope[0].hypot(half.slope[1]).atan() / FRAC_PI_2).sqrt();
        self.in_ring(((root * MERL[0] as f64) as usize).min(MERL[0] - 1))
    }

    fn widths(&self) -> [f64; 2] {
        [1.0; 2]
    }
}
