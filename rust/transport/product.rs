//! What V is multiplied by: one stage, or two.
//!
//! ```text
//!     first                           V -> B                             direct transport
//!     first x K                       V -> B_1 .. B_K, mixed by row      glossy factors
//!     first: receivers and nodes      B_x + sum_n w_xn B_n               bounces
//!     first -> tree -> then x K       V -> V2 = Haar(B) -> B2_1 .. B2_K  indirect light by gather samples
//!     first x K -> then x K           V -> V2 = B_k -> B2_k              clustered transport
//! ```

use std::sync::Arc;

use crate::basis::{ColumnSpace, HaarTree};
use crate::error::{Error, Result};

use super::entry::Channels;
use super::matrix::TransportMatrix;
use super::row_norms::RowNorms;
use super::weights::Weights;

/// Matrices over the same columns: one V, chosen once, is sent through all of them.
///
/// Where the first has texels besides its wavelets, others may have the wavelets alone (nodes, whose rows are no bits): they
/// take the same light, put together in wavelets.
#[derive(Clone)]
pub struct Factors(Vec<Arc<TransportMatrix>>);

impl Factors {
    /// Refuses none, and columns that are not alike.
    pub fn new(matrices: Vec<Arc<TransportMatrix>>) -> Result<Self> {
        let Some(first) = matrices.first() else {
            return Err(Error::input("expected at least one matrix, got none"));
        };
        let alike = |matrix: &TransportMatrix| matrix.space == first.space || takes(first.space, matrix.space);
        match matrices.iter().find(|matrix| !alike(matrix)) {
            Some(other) => Err(Error::input(format!(
                "expected factors over the same columns, {}, got {}",
                first.space, other.space
            ))),
            None => Ok(Factors(matrices)),
        }
    }

    /// The matrices in their order, at least one.
    pub fn as_slice(&self) -> &[Arc<TransportMatrix>] {
        &self.0
    }

    /// Each by itself.
    pub fn each(&self) -> Vec<Factors> {
        self.0.iter().map(|matrix| Factors(vec![Arc::clone(matrix)])).collect()
    }

    /// One after the other, in their order.
    pub fn iter(&self) -> std::slice::Iter<'_, Arc<TransportMatrix>> {
        self.0.iter()
    }

    /// How many.
    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// The first of them, which there always is.
    pub fn first(&self) -> &Arc<TransportMatrix> {
        &self.0[0]
    }

    /// The columns that all share.
    pub fn space(&self) -> ColumnSpace {
        self.0[0].space
    }

    /// The size of the wavelets that some take alone, where others have texels besides.
    pub fn merged(&self) -> Option<usize> {
        match self.space() {
            ColumnSpace::HaarTexels { size } if self.iter().any(|matrix| matrix.space != self.space()) => Some(size),
            _ => None,
        }
    }

    /// Whether all have the same rows in the same tiles, so that they can be mixed row by row.
    fn are_alike(&self) -> bool {
        let shape = |matrix: &TransportMatrix| (matrix.rows, matrix.tile_rows);
        self.0.iter().all(|matrix| shape(matrix) == shape(&self.0[0]))
    }

    fn nbytes(&self) -> usize {
        self.0.iter().map(|matrix| matrix.nbytes()).sum()
    }
}

/// Whether light in the columns `first` can be put together in the columns `other`.
fn takes(first: ColumnSpace, other: ColumnSpace) -> bool {
    matches!((first, other), (ColumnSpace::HaarTexels { size }, ColumnSpace::Haar { size: own }) if size == own)
}

/// What the rows of the first stage are to what follows.
#[derive(Clone)]
pub enum Link {
    /// They are the receivers, and nothing follows.
    None,
    /// The first matrix has the receivers as its rows and the second the nodes, from which receivers take by weight.
    Weights(Arc<Weights>),
    /// They are the samples of a tree: their response, in Haar wavelets over it, is the V of the second stage. Where the
    /// first stage's columns are the same tree, its own V joins (light that arrives directly).
    Tree(Arc<HaarTree>),
    /// Those of each first matrix are the columns of its own matrix in the second stage. For each of them the norms of the
    /// rows that both stand for.
    Representatives(Arc<[RowNorms]>),
}

/// One or two stages.
#[derive(Clone)]
pub struct Product {
    /// The matrices that V itself is sent through.
    pub first: Factors,
    /// What their rows are to the second stage or to the receivers.
    pub link: Link,
    /// The second stage, where the link leads to one.
    pub then: Option<Factors>,
}

impl Product {
    /// One matrix.
    pub fn one(matrix: Arc<TransportMatrix>) -> Product {
        Product { first: Factors(vec![matrix]), link: Link::None, then: None }
    }

    /// Refuses stages that do not fit each other.
    pub fn new(first: Factors, link: Link, then: Option<Factors>) -> Result<Product> {
        let product = Product { first, link, then };
        product.check()?;
        Ok(product)
    }

    fn check(&self) -> Result<()> {
        let expect = |holds: bool, what: String| if holds { Ok(()) } else { Err(Error::input(what)) };
        let (count, rows) = (self.first.count(), self.first.first().rows);
        match (&self.link, &self.then) {
            (Link::None, None) => {}
            (Link::Weights(weights), None) => {
                expect(count == 2, format!("expected receivers and nodes before weights, got {count} matrices"))?;
                let found = weights.rows();
                expect(found == rows, format!("expected weights for {rows} rows, got {found}"))?;
                // All nodes that the weights name are rows of the second matrix.
                let nodes = self.first.0[1].rows;
                let most = weights.node_count();
                return expect(most <= nodes, format!("expected weights of at most {nodes} nodes, got {most}"));
            }
            (Link::Tree(tree), Some(then)) => {
                expect(count == 1, format!("expected one matrix before a tree, got {count}"))?;
                let samples = tree.areas().len();
                expect(samples == rows, format!("expected a tree of {rows} samples, got {samples}"))?;
                let (columns, found) = (tree.space(), then.space());
                expect(columns == found, format!("expected a second stage over {columns}, got {found}"))?;
            }
            (Link::Representatives(norms), Some(then)) => {
                let found = then.count();
                expect(found == count, format!("expected a second matrix for each of {count}, got {found}"))?;
                let pairs = self.first.iter().zip(then.iter());
                let shape = |(first, then): (&Arc<TransportMatrix>, &Arc<TransportMatrix>)| {
                    let three = [first, then].iter().any(|matrix| matrix.channels == Channels::Three);
                    (then.rows, (first.bands.count(), if three { Channels::Three } else { Channels::One }))
                };
                let fit = pairs.map(shape).eq(norms.iter().map(|norms| (norms.rows(), norms.shape())));
                expect(
                    fit,
                    "expected norms of all rows, in all bands and channels, of each pair of stages".to_owned(),
                )?;
                let (columns, alike) = (then.space().columns(), self.first.iter().all(|first| first.rows == rows));
                let representatives = matches!(then.space(), ColumnSpace::Representatives { .. });
                expect(
                    alike && representatives && columns == rows,
                    format!("expected a second stage over {rows} representatives, got {}", then.space()),
                )?;
            }
            (_, then) => {
                let then = if then.is_some() { "one" } else { "none" };
                return Err(Error::input(format!("expected a second stage where the link leads to one, got {then}")));
            }
        }
        expect(self.outputs().are_alike(), "expected factors of the same rows in the same tiles".to_owned())
    }

    /// The matrices whose rows are the receivers.
    pub fn outputs(&self) -> &Factors {
        self.then.as_ref().unwrap_or(&self.first)
    }

    /// Receivers.
    pub fn rows(&self) -> usize {
        self.outputs().first().rows
    }

    /// How many responses a mix adds for each receiver.
    pub fn factors(&self) -> usize {
        if matches!(self.link, Link::Weights(_)) { 1 } else { self.outputs().count() }
    }

    /// The one matrix, where that is all.
    pub fn alone(&self) -> Option<&Arc<TransportMatrix>> {
        (matches!(self.link, Link::None) && self.first.count() == 1).then(|| self.first.first())
    }

    /// Bytes of all stages.
    pub fn nbytes(&self) -> usize {
        let link = match &self.link {
            Link::Weights(weights) => weights.nbytes(),
            Link::Tree(tree) => size_of_val(tree.areas()),
            Link::Representatives(norms) => norms.iter().map(RowNorms::nbytes).sum(),
            Link::None => 0,
        };
        self.first.nbytes() + link + self.then.as_ref().map_or(0, Factors::nbytes)
    }
}
