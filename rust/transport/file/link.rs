//! The chain of a transport: how its parts are put together, and the numbers of the link between stages.

use std::sync::Arc;

use crate::basis::HaarTree;
use crate::error::{Error, Result};
use crate::transport::entry::Channels;
use crate::transport::matrix::TransportMatrix;
use crate::transport::product::{Factors, Link, Product};
use crate::transport::row_norms::RowNorms;
use crate::transport::weights::Weights;

use super::manifest::{ChainEntry, Manifest, PartEntry};
use super::shard::{Shard, Tensor};

/// Puts a file's parts together.
pub(super) fn product(
    manifest: &Manifest,
    mut matrices: Vec<Arc<TransportMatrix>>,
    file: Option<&Shard>,
) -> Result<Product> {
    let then = matrices.split_off(manifest.chain.first.len());
    let link = match (manifest.chain.link.as_str(), file) {
        ("weights", Some(file)) => Link::Weights(Arc::new(read_weights(file, manifest, &matrices)?)),
        ("tree", Some(file)) => Link::Tree(Arc::new(read_tree(file, &matrices)?)),
        ("representatives", Some(file)) => Link::Representatives(read_norms(file, manifest)?.into()),
        _ => Link::None,
    };
    let then = if then.is_empty() { None } else { Some(Factors::new(then)?) };
    Product::new(Factors::new(matrices)?, link, then)
}

fn read_weights(file: &Shard, manifest: &Manifest, matrices: &[Arc<TransportMatrix>]) -> Result<Weights> {
    file.expect_count(3)?;
    let exponent = manifest.chain.exponent.ok_or_else(|| Error::input("expected the exponent of the weights"))?;
    let count = file.len("weights")?;
    let (starts, nodes) = (file.slab("starts", &[matrices[0].rows + 1])?, file.slab("nodes", &[count])?);
    let node_count = matrices.get(1).map_or(0, |nodes| nodes.rows);
    Weights::new(starts, nodes, file.slab("weights", &[count])?, exponent, node_count)
        .map_err(|error| file.error(error.to_string()))
}

fn read_tree(file: &Shard, matrices: &[Arc<TransportMatrix>]) -> Result<HaarTree> {
    file.expect_count(1)?;
    let areas = file.slab::<f64>("areas", &[matrices[0].rows])?;
    HaarTree::new(areas.to_vec()).map_err(|error| file.error(error.to_string()))
}

/// Norms of the rows of every pair of stages.
fn read_norms(file: &Shard, manifest: &Manifest) -> Result<Vec<RowNorms>> {
    let (first, then) = manifest.parts.split_at(manifest.chain.first.len());
    file.expect_count(2 * then.len())?;
    let read = |(number, (first, then)): (usize, (&PartEntry, &PartEntry))| {
        let bands = first.space()?.bands().count();
        let channels = Channels::from_count(first.channels.max(then.channels))?;
        let array = |name: &str| file.slab(&format!("{number}.{name}"), &shape_of(then.rows, bands, channels));
        RowNorms::new(bands, channels, array("kept")?, array("dropped")?).map_err(|error| file.error(error.to_string()))
    };
    first.iter().zip(then).enumerate().map(read).collect()
}

/// Arrays of one channel have no axis for it.
fn shape_of(rows: usize, bands: usize, channels: Channels) -> Vec<usize> {
    match channels {
        Channels::One => vec![rows, bands],
        Channels::Three => vec![rows, bands, 3],
    }
}

/// The chain of parts with these names, of which so many are the first stage.
pub(super) fn entry(names: &[String], first: usize, link: &Link) -> ChainEntry {
    let (first, then) = names.split_at(first.min(names.len()));
    let (link, exponent) = match link {
        Link::None => ("none", None),
        Link::Weights(weights) => ("weights", Some(weights.exponent())),
        Link::Tree(_) => ("tree", None),
        Link::Representatives(_) => ("representatives", None),
    };
    ChainEntry { first: first.to_vec(), link: link.to_owned(), exponent, then: then.to_vec() }
}

/// The arrays of `link.safetensors`, where the link has any.
pub(super) fn tensors(link: &Link) -> Option<Vec<Tensor<'_>>> {
    match link {
        Link::Weights(weights) => {
            let (starts, nodes, weights) = weights.arrays();
            Some(vec![
                Tensor::new("starts", &[starts.len()], starts),
                Tensor::new("nodes", &[nodes.len()], nodes),
                Tensor::new("weights", &[weights.len()], weights),
            ])
        }
        Link::Tree(tree) => Some(vec![Tensor::new("areas", &[tree.areas().len()], tree.areas())]),
        Link::Representatives(norms) => {
            let arrays = norms.iter().enumerate().flat_map(|(number, norms)| {
                let ((bands, channels), (kept, dropped)) = (norms.shape(), norms.arrays());
                let shape = shape_of(norms.rows(), bands, channels);
                let array = move |name: &str, items| Tensor::new(format!("{number}.{name}"), &shape, items);
                [array("kept", kept), array("dropped", dropped)]
            });
            Some(arrays.collect())
        }
        Link::None => None,
    }
}
