//! Tables over the unit square that are bilinear between their points, for several pairs of parameters.

use crate::error::{Error, Result};

use super::table::checked;

/// The parameters at which tables are known: azimuths, and angles to the normal, of the eye.
#[derive(Clone, Debug)]
pub(super) struct Axes([Vec<f64>; 2]);

/// A table's number and its share, of up to four between which parameters lie.
pub(super) type Mix = [(usize, f64); 4];

impl Axes {
    /// Refuses axes that do not ascend.
    pub fn new(axes: [&[f32]; 2]) -> Result<Axes> {
        for (name, axis) in ["phi_i", "theta_i"].into_iter().zip(axes) {
            let ascends = axis.windows(2).all(|pair| pair[0] < pair[1]);
            if axis.is_empty() || !ascends || !axis.iter().all(|x| x.abs() < 10.0) {
                return Err(Error::input(format!("expected {name} in radians that ascend, got {axis:?}")));
            }
        }
        Ok(Axes(axes.map(|axis| axis.iter().map(|x| f64::from(*x)).collect())))
    }

    /// How many tables there are.
    pub fn tables(&self) -> usize {
        self.0[0].len() * self.0[1].len()
    }

    /// The angles along an axis.
    pub fn axis(&self, number: usize) -> &[f64] {
        &self.0[number]
    }

    /// Linear between parameters, the nearest table beyond them.
    pub fn mix(&self, parameters: [f64; 2]) -> Mix {
        let [(phi, turned), (theta, raised)] = std::array::from_fn(|k| {
            let axis = &self.0[k];
            let low = axis.partition_point(|x| *x <= parameters[k]).clamp(1, (axis.len() - 1).max(1)) - 1;
            let share = axis.get(low + 1).map_or(0.0, |next| (parameters[k] - axis[low]) / (next - axis[low]));
            (low, share.clamp(0.0, 1.0))
        });
        let row = self.0[1].len();
        // The table behind the last has no share, and need not be there.
        let (next_phi, next_theta) = ((phi + 1).min(self.0[0].len() - 1), (theta + 1).min(row - 1));
        [
            (phi * row + theta, (1.0 - turned) * (1.0 - raised)),
            (phi * row + next_theta, (1.0 - turned) * raised),
            (next_phi * row + theta, turned * (1.0 - raised)),
            (next_phi * row + next_theta, turned * raised),
        ]
    }
}

/// The only table of what has no parameters.
pub(super) const ONLY: Mix = [(0, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)];

/// Tables [table][y][x], whose first and last points lie on the edges of the square.
#[derive(Debug)]
pub(super) struct Patches {
    /// Values at the points.
    pub points: Vec<f32>,
    /// Points along x, and along y: two or more.
    pub size: [usize; 2],
}

impl Patches {
    /// Refuses other lengths, and numbers that are negative or not finite.
    pub fn new(name: &str, points: &[f32], [width, height]: [usize; 2], tables: usize) -> Result<Patches> {
        if width < 2 || height < 2 {
            return Err(Error::input(format!("expected {name} of 2 x 2 points or more, got {width} x {height}")));
        }
        let length = width.checked_mul(height).and_then(|points| points.checked_mul(tables));
        checked(name, points, length)?;
        Ok(Patches { points: points.to_vec(), size: [width, height] })
    }

    /// The patch that a place in [0, 1]² is in, and where in it.
    pub fn patch(&self, place: [f64; 2]) -> ([usize; 2], [f64; 2]) {
        let scaled: [f64; 2] = std::array::from_fn(|k| place[k].clamp(0.0, 1.0) * (self.size[k] - 1) as f64);
        let patch = std::array::from_fn(|k| (scaled[k] as usize).min(self.size[k] - 2));
        (patch, std::array::from_fn(|k| scaled[k] - patch[k] as f64))
    }

    /// A point of the mixed table.
    pub fn point(&self, mix: &Mix, [x, y]: [usize; 2]) -> f64 {
        mixed(&self.points, self.size[0] * self.size[1], mix, y * self.size[0] + x)
    }

    /// The value at a place.
    pub fn at(&self, mix: &Mix, place: [f64; 2]) -> f64 {
        let ([x, y], [right, up]) = self.patch(place);
        let row = |y| (1.0 - right) * self.point(mix, [x, y]) + right * self.point(mix, [x + 1, y]);
        (1.0 - up) * row(y) + up * row(y + 1)
    }
}

/// An entry of tables of so many, mixed.
pub(super) fn mixed<T: Copy + Into<f64>>(tables: &[T], each: usize, mix: &Mix, entry: usize) -> f64 {
    mix.iter().map(|(table, share)| share * tables[table * each + entry].into()).sum()
}
