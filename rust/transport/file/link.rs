//! The chain of a transport: how its parts are put together, and the numbers of the link between stages.

use std::sync::Arc;

use crate::basis::HaarTree;
use crate::error::{Error, Result};
use crate::transport::matrix::TransportMatrix;
use crate::transport::product::{Factors, Link, Product};
use crate::transport::weights::Weights;

use super::manifest::{ChainEntry, Manifest};
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
        ("representatives", _) => Link::Representatives,
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

/// The chain of parts with these names, of which so many are the first stage.
pub(super) fn entry(names: &[String], first: usize, link: &Link) -> ChainEntry {
    let (first, then) = names.split_at(first.min(names.len()));
    let (link, exponent) = match link {
        Link::None => ("none", None),
        Link::Weights(weights) => ("weights", Some(weights.exponent())),
        Link::Tree(_) => ("tree", None),
        Link::Representatives => ("representatives", None),
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
        Link::None | Link::Representatives => None,
    }
}
