//! Norms of the rows that two stages stand for together: what no stage knows by itself.
//!
//! A row of clustered transport is w R, weights times representatives. What it holds in each band of the light, and how far it
//! is there from the row that was traced, says more of the error under a light than norms of w and of R can.

use rayon::prelude::*;

use crate::error::{Error, Result};

use super::entry::{Channels, bf16};
use super::matrix::TransportMatrix;
use super::slab::Slab;

/// For each receiver, in each band of the first stage and each channel, two norms as bfloat16 rounded up.
#[derive(Clone)]
pub struct RowNorms {
    bands: usize,
    channels: Channels,
    kept: Slab<u16>,
    dropped: Slab<u16>,
}

impl RowNorms {
    /// `[row][band][channel]`: of what both stages stand for, and of what that is off. Refuses arrays of other sizes, and
    /// norms that are negative or not finite.
    pub fn new(bands: usize, channels: Channels, kept: Slab<u16>, dropped: Slab<u16>) -> Result<Self> {
        let a_row = bands * channels.count();
        if a_row == 0 || kept.len() != dropped.len() || !kept.len().is_multiple_of(a_row) {
            let (kept, dropped) = (kept.len(), dropped.len());
            return Err(Error::input(format!("expected {a_row} norms a row, twice, got {kept} and {dropped}")));
        }
        // A bfloat16 with all exponent bits is infinite or no number; one with the sign bit is negative.
        if let Some(bits) = kept.iter().chain(dropped.iter()).find(|&&bits| bits >= 0x7f80) {
            return Err(Error::input(format!("expected finite norms >= 0, found the bits {bits:#06x}")));
        }
        Ok(RowNorms { bands, channels, kept, dropped })
    }

    /// Receivers.
    pub fn rows(&self) -> usize {
        self.kept.len() / (self.bands * self.channels.count())
    }

    /// (bands, channels)
    pub fn shape(&self) -> (usize, Channels) {
        (self.bands, self.channels)
    }

    /// The arrays, as they are stored: kept and dropped.
    pub fn arrays(&self) -> (&[u16], &[u16]) {
        (&self.kept, &self.dropped)
    }

    /// What is kept and what is off of one row, `[band][channel]`.
    pub fn row(&self, row: usize) -> (&[u16], &[u16]) {
        let a_row = self.bands * self.channels.count();
        let own = row * a_row..(row + 1) * a_row;
        (&self.kept[own.clone()], &self.dropped[own])
    }

    /// Where a row w R is longer in a band than is said: the row, its norm there, and what is said. Norms are rounded up when
    /// they are made: those made again may only round otherwise, by the factor `under`.
    pub fn broken(&self, first: &TransportMatrix, then: &TransportMatrix, under: f64) -> Option<(usize, f64, f64)> {
        let count = self.channels.count();
        (0..count).find_map(|channel| {
            let of = |matrix: &TransportMatrix| matrix.to_csr(channel.min(matrix.channels.count() - 1));
            let (representatives, weights) = (of(first), of(then));
            let row = |sums: &mut Vec<f64>, row: usize| {
                sums.fill(0.0);
                let own = weights.indptr[row] as usize..weights.indptr[row + 1] as usize;
                for (&k, &weight) in weights.indices[own.clone()].iter().zip(&weights.data[own]) {
                    let from =
                        representatives.indptr[k as usize] as usize..representatives.indptr[k as usize + 1] as usize;
                    let values = representatives.indices[from.clone()].iter().zip(&representatives.data[from]);
                    values.for_each(|(&column, &value)| sums[column as usize] += f64::from(weight) * f64::from(value));
                }
                (0..self.bands).find_map(|band| {
                    let norm = sums[first.bands.range(band)].iter().map(|x| x * x).sum::<f64>().sqrt();
                    let said = f64::from(bf16(self.row(row).0[band * count + channel]));
                    (norm > said * under).then_some((row, norm, said))
                })
            };
            let room = || vec![0.0; first.bands.columns()];
            (0..self.rows()).into_par_iter().map_init(room, row).find_map_first(|found| found)
        })
    }

    /// Bytes of both arrays.
    pub fn nbytes(&self) -> usize {
        4 * self.kept.len()
    }
}
