//! Receivers in their file.

use crate::error::Result;
use crate::transport::receivers::{ReceiverKind, ReceiverTable};

use super::manifest::Manifest;
use super::shard::{Shard, Tensor};

/// Reads and checks `receivers.safetensors`, of the kind that the manifest names.
pub(super) fn read(file: &Shard, manifest: &Manifest) -> Result<ReceiverTable> {
    let rows = manifest.receiving().rows;
    let (kind, own) = match (manifest.receivers.kind.as_str(), manifest.receivers.image) {
        ("vertices", _) => {
            let (vertex, buried) = (file.slab("vertex", &[rows])?, file.slab("buried", &[rows])?);
            (ReceiverKind::Vertices { vertex, buried }, 2)
        }
        ("gather", _) => (ReceiverKind::Gather { area: file.slab("area", &[rows])? }, 1),
        // The manifest has been checked: pixels have an image.
        (_, image) => {
            let image = image.unwrap_or_default();
            let pixel = file.slab("pixel", &[rows])?;
            let (weight, background) =
                (file.slab("weight", &[rows])?, file.slab("background", &[image[0] * image[1]])?);
            (ReceiverKind::Pixels { image, pixel, weight, background }, 3)
        }
    };
    let has_material = file.has("material");
    file.expect_count(3 + own + usize::from(has_material))?;
    let table = ReceiverTable {
        albedo: file.slab("albedo", &[rows, 3])?,
        position: file.slab("position", &[rows, 3])?,
        normal: file.slab("normal", &[rows, 3])?,
        material: if has_material { Some(file.slab("material", &[rows])?) } else { None },
        kind,
    };
    table.check(rows).map_err(|what| file.error(what))?;
    Ok(table)
}

/// The arrays of `receivers.safetensors`.
pub(super) fn tensors(table: &ReceiverTable) -> Vec<Tensor<'_>> {
    let rows = table.albedo.len() / 3;
    let mut all = match &table.kind {
        ReceiverKind::Pixels { image, pixel, weight, background } => vec![
            Tensor::new("pixel", &[rows], pixel),
            Tensor::new("weight", &[rows], weight),
            Tensor::new("background", &[image[0] * image[1]], background),
        ],
        ReceiverKind::Vertices { vertex, buried } => {
            vec![Tensor::new("vertex", &[rows], vertex), Tensor::new("buried", &[rows], buried)]
        }
        ReceiverKind::Gather { area } => vec![Tensor::new("area", &[rows], area)],
    };
    all.extend([
        Tensor::new("albedo", &[rows, 3], &table.albedo),
        Tensor::new("position", &[rows, 3], &table.position),
        Tensor::new("normal", &[rows, 3], &table.normal),
    ]);
    if let Some(material) = &table.material {
        all.push(Tensor::new("material", &[rows], material));
    }
    all
}
