//! Receivers in their file.

use crate::error::Result;
use crate::transport::lobes::{Lobes, MakeModels, PARAMETERS};
use crate::transport::receivers::{ReceiverKind, ReceiverTable};

use super::manifest::Manifest;
use super::shard::{Shard, Tensor};

/// Reads and checks `receivers.safetensors`, of the kind that the manifest names.
pub(super) fn read(file: &Shard, manifest: &Manifest, models: &MakeModels) -> Result<ReceiverTable> {
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
    let lobes = if manifest.has_lobes() { Some(read_lobes(file, rows, models)?) } else { None };
    file.expect_count(3 + own + usize::from(has_material) + if lobes.is_some() { LOBE_ARRAYS } else { 0 })?;
    let table = ReceiverTable {
        albedo: file.slab("albedo", &[rows, 3])?,
        position: file.slab("position", &[rows, 3])?,
        normal: file.slab("normal", &[rows, 3])?,
        material: if has_material { Some(file.slab("material", &[rows])?) } else { None },
        lobes,
        kind,
    };
    table.check(rows).map_err(|what| file.error(what))?;
    Ok(table)
}

/// Arrays of lobes.
const LOBE_ARRAYS: usize = 5;

fn read_lobes(file: &Shard, rows: usize, models: &MakeModels) -> Result<Lobes> {
    let count = file.len("models")?;
    let (kinds, parameters) = (file.slab("models", &[count])?, file.slab("parameters", &[count, PARAMETERS])?);
    Ok(Lobes {
        models: models(&kinds, &parameters).map_err(|error| file.error(error.to_string()))?,
        model: file.slab("lobe", &[rows])?,
        eye: file.slab("eye", &[rows, 3])?,
        half_width: file.slab("half_width", &[rows])?,
    })
}

/// What the models of lobes are stored as: kinds and parameters.
pub(super) fn stored_models(table: &ReceiverTable) -> (Vec<u32>, Vec<f64>) {
    table.lobes.as_ref().map_or_else(Default::default, |lobes| lobes.models.stored())
}

/// The arrays of `receivers.safetensors`; `models`: what `stored_models` says.
pub(super) fn tensors<'a>(table: &'a ReceiverTable, (kinds, parameters): &'a (Vec<u32>, Vec<f64>)) -> Vec<Tensor<'a>> {
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
    if let Some(lobes) = &table.lobes {
        all.extend([
            Tensor::new("models", &[kinds.len()], kinds),
            Tensor::new("parameters", &[kinds.len(), PARAMETERS], parameters),
            Tensor::new("lobe", &[rows], &lobes.model),
            Tensor::new("eye", &[rows, 3], &lobes.eye),
            Tensor::new("half_width", &[rows], &lobes.half_width),
        ]);
    }
    all
}
