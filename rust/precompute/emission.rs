//! Light that surfaces give off by themselves: what arrives of it at rows. It does not move, and is no column of M.
//!
//! ```text
//!     B_x = Int L_e(x, wi) f(wi, wo) cos dw        of a diffuse row f cos is cos / pi
//!         = mean over points y of emitters, and over directions of the lobe, of  L_e f cos / (p_y + p_f)
//! ```
//!
//! Both kinds of samples count by the balance heuristic (Veach and Guibas 1995): points of emitters where these are small or
//! the lobe is wide, directions of the lobe where they are near or it is narrow. As there are as many of each, a sample
//! needs the sum of the two densities only. Emitters shine on both sides, as all surfaces have two.

use std::f64::consts::PI;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::sampling::{chosen, cosine_directions, jitter, mixed};
use crate::scene::surface::dot;
use crate::scene::{CELL, Placed, Points, Surfaces};

use super::lobes::{Lobe, Lobes};

/// Triangles that give off light.
pub struct Emitters {
    /// Of the mesh, in its order.
    triangles: Vec<u32>,
    /// What each gives off, in red, green and blue.
    radiance: Vec<[f64; 3]>,
    /// Of each the share of all samples for a unit of its area, in the normalised scene.
    density: Vec<f64>,
    /// Sums of shares, up to and with each.
    sums: Vec<f64>,
    /// Of each triangle of the mesh its place here; `NONE` of one that gives off nothing.
    place: Vec<u32>,
}

const NONE: u32 = u32::MAX;

impl Emitters {
    /// `radiance`: of each of the user's triangles. Refuses what is negative or not finite.
    pub fn new(surfaces: Surfaces, radiance: &[[f32; 3]]) -> Result<Self> {
        let mesh = surfaces.mesh;
        if mesh.source.iter().any(|&source| source as usize >= radiance.len()) {
            return Err(Error::input(format!("expected a radiance for each triangle, got {}", radiance.len())));
        }
        if radiance.as_flattened().iter().any(|&l| !(l.is_finite() && l >= 0.0)) {
            return Err(Error::input("expected radiances that are finite and at least 0"));
        }
        let mut own = Emitters {
            triangles: vec![],
            radiance: vec![],
            density: vec![],
            sums: vec![],
            place: vec![NONE; mesh.source.len()],
        };
        let mut sum = 0.0;
        for (triangle, &source) in mesh.source.iter().enumerate() {
            let given = radiance[source as usize].map(f64::from);
            let strength = given.iter().sum::<f64>();
            if strength > 0.0 {
                own.place[triangle] = own.triangles.len() as u32;
                own.triangles.push(triangle as u32);
                own.radiance.push(given);
                own.density.push(strength);
                sum += strength * mesh.area(triangle);
                own.sums.push(sum);
            }
        }
        own.density.iter_mut().for_each(|density| *density /= sum);
        own.sums.iter_mut().for_each(|own| *own /= sum);
        Ok(own)
    }

    /// Whether nothing gives off light.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// What arrives at rows, by twice `side` x `side` rays each; nothing at those without a normal.
    pub fn arriving(
        &self,
        surfaces: Surfaces,
        (points, lobes): (&Points, &Lobes),
        side: usize,
        advance: &(dyn Fn(u64) -> Result<()> + Sync),
    ) -> Result<Vec<[f64; 3]>> {
        const CHUNK: usize = 64;
        let row = |row: usize| {
            let lobe = lobes.of(row, points.normal[row]);
            self.at(surfaces, (points, row), lobe.as_ref(), side, mixed(row as u64) ^ 5)
        };
        let chunks = (0..points.len().div_ceil(CHUNK)).into_par_iter().map(|chunk| {
            let rows = chunk * CHUNK..points.len().min((chunk + 1) * CHUNK);
            advance(rows.len() as u64)?;
            Ok(rows.map(row).collect::<Vec<_>>())
        });
        Ok(chunks.collect::<Result<Vec<_>>>()?.concat())
    }

    /// What arrives at nodes: the mean over the points of their cells.
    pub fn arriving_at_nodes(
        &self,
        surfaces: Surfaces,
        placed: &Placed,
        side: usize,
        advance: &(dyn Fn(u64) -> Result<()> + Sync),
    ) -> Result<Vec<[f64; 3]>> {
        let mut points = Points::default();
        placed.cells.iter().flatten().for_each(|point| points.push(point));
        let at = self.arriving(surfaces, (&points, &Lobes::default()), side, advance)?;
        let mean = |cell: &[[f64; 3]]| std::array::from_fn(|k| cell.iter().map(|l| l[k]).sum::<f64>() / CELL as f64);
        Ok(at.chunks_exact(CELL).map(mean).collect())
    }

    fn at(
        &self,
        surfaces: Surfaces,
        (points, row): (&Points, usize),
        lobe: Option<&Lobe>,
        side: usize,
        seed: u64,
    ) -> [f64; 3] {
        let (origin, normal) = (points.origin[row].map(f64::from), points.normal[row].map(f64::from));
        let mut sum = [0.0; 3];
        if normal == [0.0; 3] || self.is_empty() {
            return sum;
        }
        let count = (side * side) as f64;
        let cosine = |way: [f64; 3]| dot(normal, way).max(0.0) / PI;
        let value = |way: [f64; 3]| lobe.map_or_else(|| cosine(way), |lobe| lobe.value(way));
        let proposal = |way: [f64; 3]| lobe.and_then(|lobe| lobe.pdf(way)).unwrap_or_else(|| cosine(way));
        let mut add = |emitter: usize, way: [f64; 3], by_emitters: f64| {
            let weight = value(way) / (by_emitters + proposal(way)) / count;
            if weight.is_finite() && points.rises(row, way) {
                (0..3).for_each(|k| sum[k] += weight * self.radiance[emitter][k]);
            }
        };
        for k in 0..side * side {
            let (emitter, inside, along) = self.sample(k, side * side, mixed(seed) ^ k as u64);
            let triangle = self.triangles[emitter] as usize;
            let barycentric = [(inside * (1.0 - along)) as f32, (inside * along) as f32];
            let place = surfaces.mesh.place(triangle, barycentric);
            let apart: [f64; 3] = std::array::from_fn(|k| place[k] - origin[k]);
            let square = dot(apart, apart);
            let way = apart.map(|x| x / square.sqrt());
            let towards = dot(surfaces.mesh.normal(triangle), way);
            let seen = surfaces.side(triangle, barycentric, towards > 0.0);
            if square > 0.0 && value(way) != 0.0 && towards != 0.0 && surfaces.see(origin, seen.origin) {
                add(emitter, way, self.density[emitter] * square / towards.abs());
            }
        }
        let mut meet = |way: [f64; 3]| {
            let Some(hit) = surfaces.meet(origin.map(|x| x as f32), way) else { return };
            let emitter = self.place[hit.triangle as usize];
            if emitter != NONE {
                let towards = dot(hit.normal, way).abs();
                add(emitter as usize, way, self.density[emitter as usize] * hit.distance * hit.distance / towards);
            }
        };
        match lobe.filter(|lobe| !lobe.is_factor()) {
            Some(lobe) => lobe.samples(side, seed).for_each(|(way, _)| meet(way)),
            None => cosine_directions(normal, side, seed).for_each(&mut meet),
        }
        sum
    }

    /// The `k`-th of so many points: the number of its emitter, and two numbers that lie evenly in its triangle.
    fn sample(&self, k: usize, count: usize, seed: u64) -> (usize, f64, f64) {
        let [x, y] = jitter(seed);
        let (emitter, inside) = chosen(&self.sums, (k as f64 + x) / count as f64);
        (emitter, inside.sqrt(), y)
    }
}
