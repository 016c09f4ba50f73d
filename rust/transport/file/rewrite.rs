//! A stored M under a coarser rule: how it is chosen, and how it is written.

use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;

use crate::error::{Error, Result};

use super::manifest::TILES_PER_SHARD;
use super::open::Opened;
use super::writer::{Description, Part, Writer};
use crate::transport::matrix::TransportMatrix;
use crate::transport::product::Link;
use crate::transport::survey::Survey;
use crate::transport::truncate::Truncation;

/// What the one part of a rewritten transport is called.
const PART: &str = "direct";

/// The energies of all groups of a matrix; tile by tile, merged in order.
pub fn survey(matrix: &TransportMatrix, rule: &Truncation) -> Result<Survey> {
    let empty = Survey::new(&matrix.bands, rule, Arc::default())?;
    let parts = matrix.tiles.par_iter().map(|tile| {
        let mut part = empty.clone();
        tile.for_each_group(matrix.bands.stored(), matrix.quantum, |_, planes| part.add(planes))?;
        Ok(part)
    });
    let mut all = empty.clone();
    parts.collect::<Result<Vec<_>>>()?.iter().for_each(|part| all.merge(part));
    Ok(all)
}

/// Writes a stored matrix under a coarser rule as a transport of its own; what was finished before is not done again.
///
/// Refuses transports of several parts: one rule cannot serve them all.
pub fn rewrite(
    stored: &Opened,
    path: &Path,
    rule: &Truncation,
    plan: String,
    step: impl Fn(usize) -> Result<()> + Sync,
) -> Result<()> {
    let Opened { manifest, product, receivers, audit, beside } = stored;
    let matrix = product.alone().ok_or_else(|| {
        let count = manifest.parts.len();
        Error::input(format!("expected a transport of one part to truncate, got one of {count}"))
    })?;
    let (threshold, width) = (rule.threshold, rule.width.name());
    let job = format!(
        "{{\"threshold\": {threshold:e}, \"quantum\": {}, \"width\": {width:?}, \"of\": {:?}, \"plan\": {plan:?}}}",
        rule.quantum, manifest.files
    );
    let part = Part {
        name: PART.to_owned(),
        space: matrix.space,
        rows: matrix.rows,
        channels: matrix.channels,
        quantum: rule.quantum,
        width: rule.width,
        tile_rows: matrix.tile_rows,
    };
    let mut writer = Writer::open(path, &job)?;
    let finished = writer.finished(PART);
    for (shard, tiles) in matrix.tiles.chunks(TILES_PER_SHARD).enumerate() {
        if !finished.contains(&shard) {
            let tiles = tiles.par_iter().map(|tile| tile.retruncate(&matrix.bands, matrix.quantum, rule));
            writer.write_shard(PART, shard, &tiles.collect::<Result<Vec<_>>>()?)?;
        }
        step(tiles.len())?;
    }
    let about = Description {
        parts: vec![part],
        first: 1,
        link: Link::None,
        camera: manifest.receivers.camera.as_ref().map(|camera| camera.get().to_owned()),
        plan,
        scene: manifest.scene.clone(),
        beside: beside.clone(),
    };
    // An audit counts in the quantum of its file.
    let audit = audit.as_ref().filter(|_| rule.quantum == matrix.quantum);
    writer.finish(&about, receivers, audit)
}
