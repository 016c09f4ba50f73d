//! Receivers in their file.

use crate::error::Result;
use crate::transport::receivers::ReceiverTable;

use super::manifest::Manifest;
use super::shard::{Shard, Tensor};

pub(super) fn read(file: &Shard, manifest: &Manifest) -> Result<ReceiverTable> {
    let rows = manifest.rows;
    let [height, width] = manifest.image;
    let has_material = file.has("material");
    file.expect_count(6 + usize::from(has_material))?;
    let table = ReceiverTable {
        pixel: file.slab("pixel", &[rows])?,
        weight: file.slab("weight", &[rows])?,
        albedo: file.slab("albedo", &[rows, 3])?,
        position: file.slab("position", &[rows, 3])?,
        normal: file.slab("normal", &[rows, 3])?,
        material: if has_material { Some(file.slab("material", &[rows])?) } else { None },
        background: file.slab("background", &[height * width])?,
    };
    table.check(rows, manifest.image).map_err(|what| file.error(what))?;
    Ok(table)
}

/// The arrays of `receivers.safetensors`.
pub(super) fn tensors(table: &ReceiverTable, image: [usize; 2]) -> Vec<Tensor<'_>> {
    let rows = table.pixel.len();
    let mut all = vec![
        Tensor::new("pixel", &[rows], &table.pixel),
        Tensor::new("weight", &[rows], &table.weight),
        Tensor::new("albedo", &[rows, 3], &table.albedo),
        Tensor::new("position", &[rows, 3], &table.position),
        Tensor::new("normal", &[rows, 3], &table.normal),
        Tensor::new("background", &[image[0] * image[1]], &table.background),
    ];
    if let Some(material) = &table.material {
        all.push(Tensor::new("material", &[rows], material));
    }
    all
}
