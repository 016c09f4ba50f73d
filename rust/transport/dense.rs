//! The dense reference form of M: the oracle of every test, and the way to build a small M from numbers.

use crate::basis::ColumnSpace;
use crate::error::{Error, Result};

use super::entry::{Channels, GROUP, MAX_TILE_ROWS, Rows16};
use super::lobes::Lobes;
use super::matrix::TransportMatrix;
use super::sight::{BUNDLE, Encoded, Seen, Sight};
use super::tile::{CompressedGroup, Tile};
use super::truncate::{Truncation, compress_group};

/// `rows` x `columns` x `channels` numbers, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Dense {
    /// Receivers.
    pub rows: usize,
    /// Coefficients of V.
    pub columns: usize,
    /// One number for all colours, or one each.
    pub channels: Channels,
    /// `[row][column][channel]`.
    pub values: Vec<f64>,
}

impl Dense {
    /// One channel.
    pub fn new(rows: usize, columns: usize, values: Vec<f64>) -> Self {
        Self::with_channels(rows, columns, Channels::One, values)
    }

    /// With one channel or three; panics unless there is a value for each row, column and channel.
    pub fn with_channels(rows: usize, columns: usize, channels: Channels, values: Vec<f64>) -> Self {
        assert_eq!(values.len(), rows * columns * channels.count());
        Dense { rows, columns, channels, values }
    }

    /// Columns x channels.
    pub fn row(&self, row: usize) -> &[f64] {
        let length = self.columns * self.channels.count();
        &self.values[row * length..(row + 1) * length]
    }

    /// M V for `v` of `columns` x `k`, as `rows` x `k`: plain sums from the first column to the last. With three channels
    /// k is 3, and each colour has its own.
    pub fn multiply(&self, v: &[f64], k: usize) -> Vec<f64> {
        assert_eq!(v.len(), self.columns * k);
        assert!(self.channels == Channels::One || k == 3);
        let mut product = vec![0.0; self.rows * k];
        for (row, out) in product.chunks_mut(k).enumerate() {
            for (values, v) in self.row(row).chunks(self.channels.count()).zip(v.chunks(k)) {
                for (colour, (sum, v)) in out.iter_mut().zip(v).enumerate() {
                    *sum += values[self.channels.of(colour)] * v;
                }
            }
        }
        product
    }

    /// All rows of a compressed matrix.
    pub fn of(matrix: &TransportMatrix) -> Dense {
        let rows = (0..matrix.rows).flat_map(|row| matrix.row(row)).map(f64::from);
        Dense::with_channels(matrix.rows, matrix.bands.columns(), matrix.channels, rows.collect())
    }

    /// Compresses by a rule, in memory. Values are taken as 32-bit floats, as a pass delivers them.
    pub fn compress(&self, space: ColumnSpace, rule: &Truncation, tile_rows: usize) -> Result<TransportMatrix> {
        let bands = space.bands();
        if self.columns != bands.stored() {
            let expected = bands.stored();
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
                let planes = self.planes(row);
                let planes: Vec<&[Rows16]> = planes.iter().map(Vec::as_slice).collect();
                compress_group(&planes, &bands, rule, 0.0, &mut group).map(|()| group)
            });
            Ok(Tile::assemble(
                rows,
                bands.stored(),
                self.channels,
                (rule.width, rule.quantum),
                &groups.collect::<Result<Vec<_>>>()?,
            ))
        });
        let tiles = tiles.collect::<Result<_>>()?;
        let (rows, channels) = (self.rows, self.channels);
        Ok(TransportMatrix { space, bands, rows, channels, quantum: rule.quantum, tile_rows, tiles })
    }

    /// 16 rows as a pass hands them over, channel by channel; rows after the last are zero.
    pub fn planes(&self, first: usize) -> Vec<Vec<Rows16>> {
        let channels = self.channels.count();
        let mut planes = vec![vec![[0.0; GROUP]; self.columns]; channels];
        for row in first..self.rows.min(first + GROUP) {
            for (column, values) in self.row(row).chunks(channels).enumerate() {
                for (plane, &value) in planes.iter_mut().zip(values) {
                    plane[column][row - first] = value as f32;
                }
            }
        }
        planes
    }
}

impl TransportMatrix {
    /// Gives a matrix made from numbers its texel columns: `normals` of its rows, lobes where any is glossy, and whether (row,
    /// texel) is open. Their units are the matrix's: rows longer than those can hold are not followed exactly.
    pub fn with_sight(
        mut self,
        normals: &[[f32; 3]],
        lobes: Option<&Lobes>,
        open: impl Fn(usize, usize) -> bool,
    ) -> TransportMatrix {
        let (bands, quantum, tile_rows) = (&self.bands, self.quantum, self.tile_rows);
        let texels: Vec<usize> = (0..bands.texels).collect();
        let size = self.space.texels().expect("a space with texels");
        for (number, tile) in self.tiles.iter_mut().enumerate() {
            let rows = number * tile_rows..number * tile_rows + tile.rows;
            let bundle = |first: usize| {
                let own = first..rows.end.min(first + BUNDLE);
                let bits = |texel| own.clone().fold(0, |bits, row| bits | u64::from(open(row, texel)) << (row - first));
                let means = |row: usize| {
                    let lobe = lobes?.of(row, normals[row])?;
                    let mut means = vec![0.0; texels.len()];
                    lobes?.models.means(&lobe, size, &texels, &mut means);
                    Some((row - first, means))
                };
                let seen = Seen {
                    normals: normals[own.clone()].to_vec(),
                    open: texels.iter().map(|&texel| bits(texel)).collect(),
                    means: own.clone().filter_map(means).collect(),
                };
                Encoded::new(&seen, size, quantum, vec![0; own.len().div_ceil(GROUP)])
            };
            let parts: Vec<Encoded> = rows.clone().step_by(BUNDLE).map(bundle).collect();
            let (mut kept, mut dropped) = (tile.kept.to_vec(), tile.dropped.to_vec());
            for (row, norms) in parts.iter().flat_map(Encoded::norms).enumerate() {
                let place = (row + 1) * bands.count() - 1;
                (kept[place], dropped[place]) = (norms[0], norms[1]);
            }
            (tile.kept, tile.dropped) = (kept.into(), dropped.into());
            let lobes = lobes.map(|lobes| lobes.part(rows.clone()));
            tile.sight = Some(Sight::join(size, quantum, lobes, &parts));
        }
        self
    }
}
