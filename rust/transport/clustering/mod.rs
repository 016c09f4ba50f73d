//! Clustered principal components of a stored M (Sloan 2003; Overbeck 2006, section 7.4): rows that look alike share a mean
//! and a few representatives.
//!
//! ```text
//!     t_x = mean_c + sum_k w_xk r_ck,  c the cluster of x:    B = W (R V)
//! ```
//!
//! R, the means and representatives of all clusters, is the first stage, truncated as M was; W, the weights, is the second,
//! in eight bits. Rows are put in the order of their clusters, so that the sixteen rows of a group share their columns of W.
//!
//! Distances are those of the picture under the light prior: columns count by the roots of their areas. Means and
//! representatives are scaled so that W's columns all have about the same norm: what truncation takes of a row of R then costs
//! the picture the same whichever row it is of, and one threshold serves all.

mod assign;
mod compress;

use crate::basis::ColumnSpace;
use crate::error::{Error, Result};
use crate::transport::csr_rows::CsrRows;
use crate::transport::entry::{Channels, GROUP, group_of};
use crate::transport::matrix::TransportMatrix;

pub use assign::{Advance, Clustering};
pub use compress::Clusters;

/// How often each row is counted.
pub const STEPS: usize = 2 * assign::ROUNDS + 1;

/// Clusters the rows of a matrix; the same bits on any number of threads.
pub fn cluster(source: &TransportMatrix, asked: Clustering, advance: &Advance) -> Result<Clusters> {
    ColumnSpace::representatives(asked.clusters, asked.representatives)?;
    if source.bands.texels > 0 {
        return Err(Error::input(format!(
            "expected columns without texels to cluster, as rows keep bits for texels and no numbers; got {}",
            source.space
        )));
    }
    if source.channels != Channels::One {
        return Err(Error::input("expected a transport of one channel to cluster, got one of three"));
    }
    let rows = CsrRows::of(source);
    let found = assign::assign(&rows, asked, advance)?;
    compress::compress(source, &rows, found, asked, advance)
}

/// The cluster of each row of W: the one whose mean it takes most of. Refuses other matrices.
pub fn labels(then: &TransportMatrix) -> Result<Vec<u32>> {
    let ColumnSpace::Representatives { clusters, .. } = then.space else {
        return Err(Error::input(format!("expected a clustered transport, got one over {}", then.space)));
    };
    let mut most = vec![(0.0, 0); then.tiles.iter().map(|tile| tile.groups() * GROUP).sum()];
    let mut first = 0;
    for tile in &then.tiles {
        for (cluster, entry) in
            (0..clusters).flat_map(|cluster| tile.entries(cluster).map(move |entry| (cluster, entry)))
        {
            let group = &mut most[first + group_of(tile.words[entry]) * GROUP..][..GROUP];
            for (most, weight) in group.iter_mut().zip(tile.lanes(entry, 0, then.quantum)) {
                if weight.abs() > most.0 {
                    *most = (weight.abs(), cluster as u32);
                }
            }
        }
        first += tile.rows;
    }
    most.truncate(then.rows);
    Ok(most.into_iter().map(|(_, cluster)| cluster).collect())
}
