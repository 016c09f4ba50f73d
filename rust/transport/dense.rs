//! The dense reference form of M: the oracle of every test, and the way to build a small M from numbers.

use crate::basis::ColumnSpace;
use crate::error::{Error, Result};

use super::entry::{GROUP, MAX_TILE_ROWS, Rows16};
use super::matrix::TransportMatrix;
use super::tile::{CompressedGroup, Tile};
use super::truncate::{Truncation, compress_group};

/// `rows` x `columns` numbers, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Dense {
    pub rows: usize,
    pub columns: usize,
    pub values: Vec<f64>,
}

impl Dense {
    pub fn new(rows: usize, columns: usize, values: Vec<f64>) -> Self {
        assert_eq!(values.len(), rows * columns);
        Dense { rows, columns, values }
    }

    pub fn row(&self, row: usize) -> &[f64] {
        &self.values[row * self.columns..(row + 1) * self.columns]
    }

    /// M V for `v` of `columns` x `k`, as `rows` x `k`: plain sums from the first column to the last.
    pub fn multiply(&self, v: &[f64], k: usize) -> Vec<f64> {
        assert_eq!(v.len(), self.columns * k);
        let mut product = vec![0.0; self.rows * k];
        for (row, out) in product.chunks_mut(k).enumerate() {
            for (value, v) in self.row(row).iter().zip(v.chunks(k)) {
                out.iter_mut().zip(v).for_each(|(sum, v)| *sum += value * v);
            }
        }
        product
    }

    /// All rows of a compressed matrix.
    pub fn of(matrix: &TransportMatrix) -> Dense {
        let rows = (0..matrix.rows).flat_map(|row| matrix.row(row)).map(f64::from);
        Dense::new(matrix.rows, matrix.bands.columns(), rows.collect())
    }

    /// Compresses by a rule, in memory. Values are taken as 32-bit floats, as a pass delivers them.
    pub fn compress(&self, space: ColumnSpace, rule: &Truncation, tile_rows: usize) -> Result<TransportMatrix> {
        let bands = space.bands();
        if self.columns != bands.columns() {
            let expected = bands.columns();
            return Err(Error::input(format!("expected {expected} columns for {space}, got {}", self.columns)));
        }
        if tile_rows == 0 || tile_rows > MAX_TILE_ROWS || !tile_rows.is_multiple_of(GROUP) {
            return Err(Error::input(format!(
                "expected tiles of 16 to {MAX_TILE_ROWS} rows, a multiple of 16, got {tile_rows}"
            )));
        }
        let tiles = (0..self.rows).step_by(tile_rows).map(|first| {
            let rows = tile_rows.min(self.rows - first);
            let groups = (first..first + rows).step_by(GROUP).map(|row| {
                let mut group = CompressedGroup::default();
                compress_group(&self.lanes(row), &bands, rule, &mut group).map(|()| group)
            });
            Ok(Tile::assemble(rows, self.columns, rule.width, &groups.collect::<Result<Vec<_>>>()?))
        });
        let tiles = tiles.collect::<Result<_>>()?;
        Ok(TransportMatrix { space, bands, rows: self.rows, quantum: rule.quantum, tile_rows, tiles })
    }

    /// 16 rows as a pass hands them over; rows after the last are zero.
    pub fn lanes(&self, first: usize) -> Vec<Rows16> {
        let mut lanes = vec![[0.0; GROUP]; self.columns];
        for row in first..self.rows.min(first + GROUP) {
            for (lane, &value) in lanes.iter_mut().zip(self.row(row)) {
                lane[row - first] = value as f32;
            }
        }
        lanes
    }
}
