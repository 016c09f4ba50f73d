//! What the columns of M mean, how they group into bands, and the area of each one's support.
//!
//! Columns are numbered band by band, coarse to fine, so a band is always one contiguous range.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use crate::error::{Error, Result};

/// The basis that V and the columns of M are measured in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnSpace {
    /// 2D Haar wavelets on the six faces of a cubemap with `size` x `size` texels a face (`basis/haar.rs`).
    ///
    /// Band 0 holds the 6 scaling functions, then the 18 coarsest wavelets; band b > 0 the wavelets whose support is
    /// (size / 2^b)^2 texels. Inside a level: face by face, then block by block in rows, then the h, d, v wavelets.
    Haar { size: usize },
    /// Real spherical harmonics of the degrees below `order` (`basis/spherical_harmonics.rs`): order² columns.
    ///
    /// Band l holds the 2l + 1 functions of degree l, from m = -l to l.
    SphericalHarmonics { order: usize },
}

/// How columns group into bands: all that an update method knows of a basis.
#[derive(Clone, Debug, PartialEq)]
pub struct Bands {
    /// Band b is columns `starts[b]..starts[b + 1]`; the last entry is the number of columns.
    pub starts: Vec<usize>,
    /// Texels under the support of each column; 1 for functions that cover the whole sphere.
    pub areas: Vec<f64>,
}

impl Bands {
    pub fn count(&self) -> usize {
        self.starts.len() - 1
    }

    pub fn columns(&self) -> usize {
        *self.starts.last().expect("starts is never empty")
    }

    pub fn range(&self, band: usize) -> Range<usize> {
        self.starts[band]..self.starts[band + 1]
    }

    /// The band of a column.
    pub fn of(&self, column: usize) -> usize {
        self.starts.partition_point(|&start| start <= column) - 1
    }
}

impl ColumnSpace {
    /// The largest face that 32-bit column numbers and a sane amount of memory allow.
    pub const MAX_HAAR: usize = 512;

    pub fn haar(size: usize) -> Result<Self> {
        if size.is_power_of_two() && size <= Self::MAX_HAAR {
            Ok(ColumnSpace::Haar { size })
        } else {
            Err(Error::input(format!(
                "a Haar cubemap face must be a power of two from 1 to {} texels wide, got {size}",
                Self::MAX_HAAR
            )))
        }
    }

    /// The highest order of spherical harmonics.
    pub const MAX_ORDER: usize = 30;

    pub fn spherical_harmonics(order: usize) -> Result<Self> {
        if (1..=Self::MAX_ORDER).contains(&order) {
            Ok(ColumnSpace::SphericalHarmonics { order })
        } else {
            Err(Error::input(format!(
                "expected an order of spherical harmonics from 1 to {}, got {order}",
                Self::MAX_ORDER
            )))
        }
    }

    pub fn columns(self) -> usize {
        match self {
            ColumnSpace::Haar { size } => 6 * size * size,
            ColumnSpace::SphericalHarmonics { order } => order * order,
        }
    }

    pub fn bands(self) -> Bands {
        match self {
            ColumnSpace::Haar { size } => {
                let levels = size.trailing_zeros() as usize;
                let mut starts = vec![0];
                let mut areas = vec![(size * size) as f64; 6];
                for level in 0..levels {
                    let support = size >> level;
                    areas.resize(areas.len() + 18 * (1 << (2 * level)), (support * support) as f64);
                    starts.push(areas.len());
                }
                if levels == 0 {
                    starts.push(6);
                }
                Bands { starts, areas }
            }
            ColumnSpace::SphericalHarmonics { order } => {
                Bands { starts: (0..=order).map(|degree| degree * degree).collect(), areas: vec![1.0; order * order] }
            }
        }
    }
}

impl fmt::Display for ColumnSpace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ColumnSpace::Haar { size } => write!(f, "haar:{size}"),
            ColumnSpace::SphericalHarmonics { order } => write!(f, "sh:{order}"),
        }
    }
}

impl FromStr for ColumnSpace {
    type Err = Error;

    /// Reads what `Display` writes: `haar:64`, `sh:20`.
    fn from_str(text: &str) -> Result<Self> {
        let (kind, number) = text.split_once(':').unwrap_or((text, ""));
        match (kind, number.parse()) {
            ("haar", Ok(size)) => ColumnSpace::haar(size),
            ("sh", Ok(order)) => ColumnSpace::spherical_harmonics(order),
            _ => Err(Error::input(format!("expected columns like \"haar:64\" or \"sh:20\", got {text:?}"))),
        }
    }
}
