//! Peaks: suns and lamps, each a direction and a flux, taken out of a map once.
//!
//! A map's bright squares (`bright.rs`) that lie within a texel's width of the brightest become one peak: its flux is
//! their sum, its direction their middle. The next brightest that is left follows, and so on. The peaks turn with the map;
//! nothing is found anew in a frame. In texels a peak is spread over the centres around its direction (`cubemap::around`),
//! so that its shadow moves as it moves, and lies where it lies.

use super::bright::Square;
use crate::basis::cubemap::around;

/// The most peaks of a map.
pub const MOST: usize = 256;
/// Squares within so much of a target texel's width, seen from the first of them, are one peak.
const RADIUS: f64 = 0.75;
/// A peak below this share of the map's flux is left where it is.
const LEAST: f64 = 2e-4;

/// A small bright light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peak {
    /// Towards it, of length 1.
    pub direction: [f64; 3],
    /// Radiance times solid angle, in red, green and blue.
    pub flux: [f64; 3],
}

/// The peaks among the squares of a map of so much flux, the largest first, and for each square the number of its peak.
pub fn find(squares: &[Square], total: f64, size: usize) -> (Vec<Peak>, Vec<u32>) {
    let near = (RADIUS * 2.0 / size as f64).cos();
    let mut of = vec![u32::MAX; squares.len()];
    let mut brightest: Vec<usize> = (0..squares.len()).collect();
    brightest.sort_by(|&a, &b| squares[b].brightness().total_cmp(&squares[a].brightness()));
    let mut found: Vec<(f64, Peak, Vec<usize>)> = Vec::new();
    let mut taken = vec![false; squares.len()];
    for &first in &brightest {
        if taken[first] || found.len() == MOST {
            continue;
        }
        let middle = squares[first].unit();
        let close = |&k: &usize| !taken[k] && dot(squares[k].unit(), middle) >= near;
        let members: Vec<usize> = (0..squares.len()).filter(close).collect();
        members.iter().for_each(|&k| taken[k] = true);
        let (mut direction, mut flux, mut amount) = ([0.0; 3], [0.0; 3], 0.0);
        for square in members.iter().map(|&k| &squares[k]) {
            let weight = square.amount();
            amount += weight;
            (0..3).for_each(|k| direction[k] += weight * square.unit()[k]);
            (0..3).for_each(|c| flux[c] += square.flux()[c]);
        }
        let length = dot(direction, direction).sqrt();
        if amount >= LEAST * total && length > 0.0 {
            found.push((amount, Peak { direction: direction.map(|x| x / length), flux }, members));
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    for (number, (_, _, members)) in found.iter().enumerate() {
        members.iter().for_each(|&k| of[k] = number as u32);
    }
    (found.into_iter().map(|(_, peak, _)| peak).collect(), of)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Peak {
    /// The same turned by an orthogonal matrix in rows.
    pub fn turned(&self, rotation: &[[f64; 3]; 3]) -> Peak {
        Peak { direction: rotation.map(|row| dot(row, self.direction)), ..*self }
    }

    /// Adds it, scaled, to coefficients of texels: radiance times the root of the solid angle.
    pub fn add(&self, size: usize, scale: [f64; 3], inverse_areas: &[f64], texels: &mut [[f64; 3]]) {
        for (texel, share) in around(size, self.direction) {
            let root = inverse_areas[texel % (size * size)].sqrt();
            (0..3).for_each(|c| texels[texel][c] += share * scale[c] * root * self.flux[c]);
        }
    }
}
