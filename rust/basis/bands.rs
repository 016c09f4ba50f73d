//! What the columns of M mean, how they group into bands, and the area of each one's support.
//!
//! Columns are numbered band by band, coarse to fine, so a band is always one contiguous range.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use crate::error::{Error, Result};

use super::daubechies4::{COARSEST, CURVE};

/// Levels of curves whose wavelets cover no more samples than this are bands by their places as well.
const FINE: f64 = 8.0;

/// The basis that V and the columns of M are measured in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnSpace {
    /// 2D Haar wavelets on the six faces of a cubemap with `size` x `size` texels a face (`basis/haar.rs`).
    ///
    /// Band 0 holds the 6 scaling functions, then the 18 coarsest wavelets; band b > 0 the wavelets whose support is
    /// (size / 2^b)^2 texels. Inside a level: face by face, then block by block in rows, then the h, d, v wavelets.
    Haar {
        /// Texels along a face: a power of two.
        size: usize,
    },
    /// `Haar`, and then the texels themselves in one band more: light as a union of both bases (`transport/sight.rs`).
    ///
    /// Texel p is the function 1 / sqrt(dω_p) on the texel; they are numbered row-major, face after face.
    HaarTexels {
        /// Texels along a face: a power of two.
        size: usize,
    },
    /// Real spherical harmonics of the degrees below `order` (`basis/spherical_harmonics.rs`): order² columns.
    ///
    /// Band l holds the 2l + 1 functions of degree l, from m = -l to l.
    SphericalHarmonics {
        /// Degrees, from 0 on.
        order: usize,
    },
    /// Haar wavelets over a tree of so many surface samples, padded to a power of two (`basis/haar_tree.rs`).
    ///
    /// Band 0 holds the scaling function and the wavelets of the three coarsest levels; each further level is a band.
    Tree {
        /// Leaves of the tree, without padding.
        samples: usize,
    },
    /// What clustered transport stands on: the means of all clusters, which are band 0, then the representatives of the first
    /// cluster, of the second, and so on: band 1.
    Representatives {
        /// How many clusters, each with a column in band 0.
        clusters: usize,
        /// Representatives of each cluster, besides its mean.
        each: usize,
    },
    /// So many lamps or groups of lights, each a function of its own: what one-light-at-a-time pictures are taken under. One
    /// band.
    Lamps {
        /// How many.
        count: usize,
    },
    /// Daubechies-4 wavelets of BRDF curves of 256 samples (`basis/daubechies4.rs`), once for each of so many factors that a
    /// curve may be multiplied by (of Fresnel's reflectance, `brdf/curve.rs`).
    ///
    /// Band 0 holds the scaling functions of all factors, factor after factor; each further level is a band, the three finest
    /// are three: the eighth at the highlight, the next, and the rest. Where a highlight is narrow its details lie in the
    /// first, and what rows lack in the last: bounds by bands are up to 30 times tighter than by levels (of one factor).
    Daubechies4 {
        /// Functions of the other angle, at least one.
        factors: usize,
    },
}

/// How columns group into bands: all that an update method knows of a basis.
#[derive(Clone, Debug, PartialEq)]
pub struct Bands {
    /// Band b is columns `starts[b]..starts[b + 1]`; the last entry is the number of columns.
    pub starts: Vec<usize>,
    /// Texels under the support of each column; 1 for functions that cover the whole sphere. The light prior: E[V_j^2] is
    /// taken to grow with it. Of a texel column the side of a face: no wavelet of its band is so much of the light that rows
    /// receive, as what a texel sends them does not cancel. The mean of a face, over side^2 texels, sends side times as much.
    pub areas: Vec<f64>,
    /// So many of the first columns are never dropped: without the scaling functions rows no longer sum to the light
    /// that they receive (the white furnace).
    pub always: usize,
    /// So many of the last columns, a band of their own, are texels: rows keep bits for them, and no entries.
    pub texels: usize,
}

impl Bands {
    /// Refuses starts that do not ascend from 0 to the number of areas.
    pub fn check(&self) -> Result<()> {
        let ends = (self.starts.first(), self.starts.last());
        let ascend = self.starts.windows(2).all(|pair| pair[0] <= pair[1]);
        if self.starts.len() > 1 && ends == (Some(&0), Some(&self.areas.len())) && ascend {
            return Ok(());
        }
        let (columns, starts) = (self.areas.len(), &self.starts);
        Err(Error::input(format!("expected starts of bands that ascend from 0 to {columns}, got {starts:?}")))
    }

    /// The number of bands.
    pub fn count(&self) -> usize {
        self.starts.len() - 1
    }

    /// The number of columns, over all bands.
    pub fn columns(&self) -> usize {
        *self.starts.last().expect("starts is never empty")
    }

    /// The columns that have entries.
    pub fn stored(&self) -> usize {
        self.columns() - self.texels
    }

    /// The columns of a band; panics where there is no such band.
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

    /// The Haar basis of a cubemap; refuses faces that are not a power of two from 1 to `MAX_HAAR` texels wide.
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

    /// The Haar basis and the texels of the same cubemap.
    pub fn haar_texels(size: usize) -> Result<Self> {
        Self::haar(size).map(|_| ColumnSpace::HaarTexels { size })
    }

    /// Texels along a face, where some columns are texels.
    pub fn texels(self) -> Option<usize> {
        match self {
            ColumnSpace::HaarTexels { size } => Some(size),
            _ => None,
        }
    }

    /// The highest order of spherical harmonics.
    pub const MAX_ORDER: usize = 30;

    /// The harmonics of the degrees below `order`; refuses orders outside 1 to `MAX_ORDER`.
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

    /// The most surface samples, and the most representatives with their means.
    pub const MAX_SAMPLES: usize = 1 << 20;

    /// The wavelets over a tree of surface samples; refuses counts outside 1 to `MAX_SAMPLES`.
    pub fn tree(samples: usize) -> Result<Self> {
        if (1..=Self::MAX_SAMPLES).contains(&samples) {
            Ok(ColumnSpace::Tree { samples })
        } else {
            Err(Error::input(format!("expected a tree of 1 to {} samples, got {samples}", Self::MAX_SAMPLES)))
        }
    }

    /// The space of clustered transport; refuses no clusters, more than 255 representatives each, and more than `MAX_SAMPLES`
    /// columns in all.
    pub fn representatives(clusters: usize, each: usize) -> Result<Self> {
        let count = each.checked_add(1).and_then(|each| clusters.checked_mul(each));
        if clusters > 0 && each <= 255 && count.is_some_and(|count| count <= Self::MAX_SAMPLES) {
            Ok(ColumnSpace::Representatives { clusters, each })
        } else {
            Err(Error::input(format!(
                "expected at least one cluster of at most 255 representatives, {} in all with their means, got \
                 {clusters} x {each}",
                Self::MAX_SAMPLES
            )))
        }
    }

    /// The most lamps.
    pub const MAX_LAMPS: usize = 1 << 16;

    /// The space of so many lamps; refuses counts outside 1 to `MAX_LAMPS`.
    pub fn lamps(count: usize) -> Result<Self> {
        if (1..=Self::MAX_LAMPS).contains(&count) {
            Ok(ColumnSpace::Lamps { count })
        } else {
            Err(Error::input(format!("expected 1 to {} lamps, got {count}", Self::MAX_LAMPS)))
        }
    }

    /// The most factors of curves.
    pub const MAX_FACTORS: usize = 16;

    /// The wavelets of curves; refuses factors outside 1 to `MAX_FACTORS`.
    pub fn daubechies4(factors: usize) -> Result<Self> {
        if (1..=Self::MAX_FACTORS).contains(&factors) {
            Ok(ColumnSpace::Daubechies4 { factors })
        } else {
            Err(Error::input(format!("expected 1 to {} factors of curves, got {factors}", Self::MAX_FACTORS)))
        }
    }

    /// The cluster that a column of clustered transport belongs to; in all other spaces there is one.
    pub fn cluster_of(self, column: usize) -> usize {
        match self {
            ColumnSpace::Representatives { clusters, .. } if column < clusters => column,
            ColumnSpace::Representatives { clusters, each } => (column - clusters) / each,
            _ => 0,
        }
    }

    /// The length of V: one coefficient a column.
    pub fn columns(self) -> usize {
        match self {
            ColumnSpace::Tree { samples } => samples.next_power_of_two(),
            ColumnSpace::Representatives { clusters, each } => clusters * (1 + each),
            ColumnSpace::Haar { size } => 6 * size * size,
            ColumnSpace::HaarTexels { size } => 12 * size * size,
            ColumnSpace::SphericalHarmonics { order } => order * order,
            ColumnSpace::Daubechies4 { factors } => factors * CURVE,
            ColumnSpace::Lamps { count } => count,
        }
    }

    /// How the columns group into bands, and how large their supports are.
    pub fn bands(self) -> Bands {
        match self {
            ColumnSpace::Tree { .. } => {
                let columns = self.columns();
                // The wavelets of level l are columns 2^l to 2^(l + 1), each over columns / 2^l leaves.
                let level = |column: usize| column.max(1).ilog2();
                let areas = (0..columns).map(|column| (columns >> level(column)) as f64).collect();
                let mut starts = vec![0, columns.min(8)];
                while starts[starts.len() - 1] < columns {
                    starts.push(2 * starts[starts.len() - 1]);
                }
                Bands { starts, areas, always: columns.min(8), texels: 0 }
            }
            ColumnSpace::Representatives { clusters, each } => {
                let mut starts = vec![0, clusters];
                starts.extend((each > 0).then(|| self.columns()));
                Bands { starts, areas: vec![1.0; self.columns()], always: clusters, texels: 0 }
            }
            ColumnSpace::Lamps { count } => {
                Bands { starts: vec![0, count], areas: vec![1.0; count], always: 0, texels: 0 }
            }
            ColumnSpace::HaarTexels { size } => {
                let mut bands = ColumnSpace::Haar { size }.bands();
                let texels = 6 * size * size;
                bands.starts.push(2 * texels);
                bands.areas.resize(2 * texels, size as f64);
                Bands { texels, ..bands }
            }
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
                Bands { starts, areas, always: 6, texels: 0 }
            }
            ColumnSpace::SphericalHarmonics { order } => Bands {
                starts: (0..=order).map(|degree| degree * degree).collect(),
                areas: vec![1.0; order * order],
                always: 1,
                texels: 0,
            },
            ColumnSpace::Daubechies4 { factors } => {
                let mut starts = vec![0, factors * COARSEST];
                let mut areas = vec![(CURVE / COARSEST) as f64; factors * COARSEST];
                while areas.len() < factors * CURVE {
                    // As many details as there are coarser functions, each over that share of the curve.
                    let (level, support) = (areas.len(), (factors * CURVE / areas.len()) as f64);
                    if support <= FINE {
                        starts.extend([level + level / 8, level + level / 4]);
                    }
                    areas.resize(2 * level, support);
                    starts.push(areas.len());
                }
                Bands { starts, areas, always: factors * COARSEST, texels: 0 }
            }
        }
    }
}

impl fmt::Display for ColumnSpace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ColumnSpace::Haar { size } => write!(f, "haar:{size}"),
            ColumnSpace::HaarTexels { size } => write!(f, "haar:{size}+texels"),
            ColumnSpace::SphericalHarmonics { order } => write!(f, "sh:{order}"),
            ColumnSpace::Tree { samples } => write!(f, "tree:{samples}"),
            ColumnSpace::Representatives { clusters, each } => write!(f, "representatives:{clusters}x{each}"),
            ColumnSpace::Daubechies4 { factors } => write!(f, "d4:{factors}"),
            ColumnSpace::Lamps { count } => write!(f, "lamps:{count}"),
        }
    }
}

impl FromStr for ColumnSpace {
    type Err = Error;

    /// Reads what `Display` writes: `haar:64`, `haar:64+texels`, `sh:20`, `tree:4096`, `representatives:398x25`, `d4:3`,
    /// `lamps:50`.
    fn from_str(text: &str) -> Result<Self> {
        let texels = text.strip_prefix("haar:").and_then(|rest| rest.strip_suffix("+texels")?.parse().ok());
        if let Some(size) = texels {
            return ColumnSpace::haar_texels(size);
        }
        let (kind, number) = text.split_once(':').unwrap_or((text, ""));
        let pair = number.split_once('x').and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
        match (kind, number.parse(), pair) {
            ("haar", Ok(size), _) => ColumnSpace::haar(size),
            ("sh", Ok(order), _) => ColumnSpace::spherical_harmonics(order),
            ("d4", Ok(factors), _) => ColumnSpace::daubechies4(factors),
            ("lamps", Ok(count), _) => ColumnSpace::lamps(count),
            ("tree", Ok(samples), _) => ColumnSpace::tree(samples),
            ("representatives", _, Some((clusters, each))) => ColumnSpace::representatives(clusters, each),
            _ => Err(Error::input(format!(
                "expected columns like \"haar:64\", \"haar:64+texels\" or \"sh:20\", got {text:?}"
            ))),
        }
    }
}
