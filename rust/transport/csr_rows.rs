//! Rows of M as they count in the picture: each column by the root of its area.

use crate::basis::pca::SparseRows;

use super::matrix::{Csr, TransportMatrix};
use super::truncate::area_weights;

/// One channel of a matrix by rows, with the weights of its columns.
pub(super) struct CsrRows {
    csr: Csr,
    /// The root of the light prior, one a column.
    pub weights: Vec<f64>,
}

impl CsrRows {
    /// Of a matrix of one channel without texels.
    pub fn of(matrix: &TransportMatrix) -> CsrRows {
        CsrRows { csr: matrix.to_csr(0), weights: area_weights(&matrix.bands) }
    }

    /// How many.
    pub fn count(&self) -> usize {
        self.csr.indptr.len() - 1
    }

    /// Columns and stored numbers of a row.
    pub fn plain(&self, row: usize) -> impl Iterator<Item = (usize, f64)> {
        let own = self.csr.indptr[row] as usize..self.csr.indptr[row + 1] as usize;
        let numbers = self.csr.indices[own.clone()].iter().zip(&self.csr.data[own]);
        numbers.map(|(&column, &value)| (column as usize, f64::from(value)))
    }

    /// The same, weighted.
    pub fn weighted(&self, row: usize) -> impl Iterator<Item = (usize, f64)> {
        self.plain(row).map(|(column, value)| (column, value * self.weights[column]))
    }

    /// The square of a weighted row.
    pub fn square(&self, row: usize) -> f64 {
        self.weighted(row).map(|(_, value)| value * value).sum()
    }

    /// Some rows, weighted, and the columns that they touch: theirs are numbered as these stand.
    pub fn some(&self, rows: &[u32]) -> (SparseRows, Vec<u32>) {
        let mut place = vec![u32::MAX; self.weights.len()];
        rows.iter().for_each(|&row| self.plain(row as usize).for_each(|(column, _)| place[column] = 0));
        let support: Vec<u32> = (0..place.len() as u32).filter(|&column| place[column as usize] == 0).collect();
        support.iter().enumerate().for_each(|(at, &column)| place[column as usize] = at as u32);
        let mut some = SparseRows { starts: vec![0], width: support.len(), ..SparseRows::default() };
        for &row in rows {
            for (column, value) in self.weighted(row as usize) {
                some.columns.push(place[column]);
                some.values.push(value);
            }
            some.starts.push(some.values.len());
        }
        (some, support)
    }
}
