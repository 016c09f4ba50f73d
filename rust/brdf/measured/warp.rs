//! Densities over the unit square, bilinear between points, and the way from even numbers to them and back (Dupuy and Jakob
//! 2018, section 4.1): rows first, by what each holds, then along the row.

use crate::error::{Error, Result};

use super::patches::{Axes, Mix, Patches, mixed};

/// One density for each table, whose integral is 1.
#[derive(Debug)]
pub(super) struct Warp {
    patches: Patches,
    /// Scale of each table's points, by which its integral in units of patches is 1.
    scales: Vec<f64>,
    /// For each point what its row holds to its left, and for each row what rows before it hold, scaled.
    left: Vec<f64>,
    below: Vec<f64>,
}

impl Warp {
    /// Refuses what `Patches` does, and a table without anything.
    pub fn new(name: &str, points: &[f32], size: [usize; 2], axes: &Axes) -> Result<Warp> {
        let patches = Patches::new(name, points, size, axes.tables())?;
        let [width, height] = size;
        let (mut scales, mut left, mut below) = (Vec::new(), Vec::new(), Vec::new());
        for table in patches.points.chunks_exact(width * height) {
            let rows: Vec<Vec<f64>> = table.chunks_exact(width).map(|row| running(row.iter().copied())).collect();
            let held = running(rows.iter().map(|row| row[width - 1]));
            let total = held[height - 1];
            if total <= 0.0 {
                return Err(Error::input(format!("expected something in every table of {name}, got zeros")));
            }
            scales.push(1.0 / total);
            left.extend(rows.iter().flatten().map(|sum| sum / total));
            below.extend(held.iter().map(|sum| sum / total));
        }
        Ok(Warp { patches, scales, left, below })
    }

    /// The mixed density's point.
    fn point(&self, mix: &Mix, at: [usize; 2]) -> f64 {
        let scaled = mix.map(|(table, share)| (table, share * self.scales[table]));
        self.patches.point(&scaled, at)
    }

    fn left(&self, mix: &Mix, [x, y]: [usize; 2]) -> f64 {
        let [width, height] = self.patches.size;
        mixed(&self.left, width * height, mix, y * width + x)
    }

    fn below(&self, mix: &Mix, y: usize) -> f64 {
        mixed(&self.below, self.patches.size[1], mix, y)
    }

    /// What a row holds, and the next.
    fn rows(&self, mix: &Mix, y: usize) -> [f64; 2] {
        [y, y + 1].map(|y| self.left(mix, [self.patches.size[0] - 1, y]))
    }

    /// The density at the left of a patch, and at its right, at a height in it.
    fn sides(&self, mix: &Mix, [x, y]: [usize; 2], up: f64) -> [f64; 2] {
        [x, x + 1].map(|x| (1.0 - up) * self.point(mix, [x, y]) + up * self.point(mix, [x, y + 1]))
    }

    /// The density at a place, over the area of the unit square.
    pub fn density(&self, mix: &Mix, place: [f64; 2]) -> f64 {
        let (patch, [right, up]) = self.patches.patch(place);
        let [a, b] = self.sides(mix, patch, up);
        let patches = self.patches.size.map(|points| (points - 1) as f64);
        ((1.0 - right) * a + right * b) * patches[0] * patches[1]
    }

    /// The place of two even numbers.
    pub fn place(&self, mix: &Mix, u: [f64; 2]) -> [f64; 2] {
        let [width, height] = self.patches.size;
        let y = last(height - 1, |y| self.below(mix, y) <= u[1]);
        let rows = self.rows(mix, y);
        let up = along(rows, u[1] - self.below(mix, y));
        let held = |x: usize| (1.0 - up) * self.left(mix, [x, y]) + up * self.left(mix, [x, y + 1]);
        let wanted = u[0] * held(width - 1);
        let x = last(width - 1, |x| held(x) <= wanted);
        let right = along(self.sides(mix, [x, y], up), wanted - held(x));
        [(x as f64 + right) / (width - 1) as f64, (y as f64 + up) / (height - 1) as f64]
    }

    /// The even numbers of a place: what `place` takes. Where a row holds nothing, the left of it.
    pub fn numbers(&self, mix: &Mix, place: [f64; 2]) -> [f64; 2] {
        let ([x, y], [right, up]) = self.patches.patch(place);
        let between = |from: [f64; 2], share: f64| share * (from[0] + 0.5 * share * (from[1] - from[0]));
        let held = |x: usize| (1.0 - up) * self.left(mix, [x, y]) + up * self.left(mix, [x, y + 1]);
        let (row, rows) = (held(self.patches.size[0] - 1), self.rows(mix, y));
        let along_row = held(x) + between(self.sides(mix, [x, y], up), right);
        [if row > 0.0 { along_row / row } else { 0.0 }, self.below(mix, y) + between(rows, up)]
    }
}

/// Integrals up to each of some values that are linear in between.
fn running(values: impl Iterator<Item = impl Into<f64>>) -> Vec<f64> {
    let (mut sum, mut before) = (0.0, None);
    let add = |value: f64| {
        sum += before.replace(value).map_or(0.0, |before| 0.5 * (before + value));
        sum
    };
    values.map(Into::into).map(add).collect()
}

/// The last of some numbers, from 0, of which the first ones fulfil something; 0 if none does.
fn last(count: usize, fulfils: impl Fn(usize) -> bool) -> usize {
    let (mut low, mut high) = (0, count);
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        *(if fulfils(middle) { &mut low } else { &mut high }) = middle;
    }
    low
}

/// Where in [0, 1] the integral of what is linear from one value to another has reached so much.
fn along([from, to]: [f64; 2], wanted: f64) -> f64 {
    let root = (from * from + 2.0 * wanted * (to - from)).max(0.0).sqrt();
    if from + root > 0.0 { (2.0 * wanted / (from + root)).clamp(0.0, 1.0) } else { 0.0 }
}
