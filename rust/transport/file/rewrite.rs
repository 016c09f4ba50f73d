//! A stored M under a coarser rule: how it is chosen, and how it is written.

use std::path::Path;

use rayon::prelude::*;

use crate::error::Result;

use super::manifest::TILES_PER_SHARD;
use super::open::Opened;
use super::writer::{Description, Writer};
use crate::transport::matrix::TransportMatrix;
use crate::transport::survey::Survey;
use crate::transport::truncate::Truncation;

/// The energies of all groups of a matrix; tile by tile, merged in order.
pub fn survey(matrix: &TransportMatrix, rule: &Truncation) -> Result<Survey> {
    let empty = Survey::new(&matrix.bands, rule.quantum, rule.width)?;
    let parts = matrix.tiles.par_iter().map(|tile| {
        let mut part = empty.clone();
        tile.for_each_group(matrix.bands.columns(), matrix.quantum, |_, lanes| part.add(lanes, &matrix.bands))?;
        Ok(part)
    });
    let mut all = empty.clone();
    parts.collect::<Result<Vec<_>>>()?.iter().for_each(|part| all.merge(part));
    Ok(all)
}

/// Writes a stored matrix under a coarser rule as a transport of its own; what was finished before is not done again.
pub fn rewrite(
    stored: &Opened,
    path: &Path,
    rule: &Truncation,
    plan: String,
    step: impl Fn(usize) -> Result<()> + Sync,
) -> Result<()> {
    let Opened { manifest, matrix, receivers, audit } = stored;
    let job = format!("{{\"truncation\": \"{rule:?}\", \"of\": {:?}, \"plan\": {plan:?}}}", manifest.files);
    let mut writer = Writer::open(path, &job)?;
    let finished = writer.finished();
    for (shard, tiles) in matrix.tiles.chunks(TILES_PER_SHARD).enumerate() {
        if !finished.contains(&shard) {
            let tiles = tiles.par_iter().map(|tile| tile.retruncate(&matrix.bands, matrix.quantum, rule));
            writer.write_shard(shard, &tiles.collect::<Result<Vec<_>>>()?)?;
        }
        step(tiles.len())?;
    }
    let about = Description {
        space: matrix.space,
        rows: matrix.rows,
        quantum: rule.quantum,
        width: rule.width,
        tile_rows: matrix.tile_rows,
        image: manifest.image,
        camera: manifest.camera.get().to_owned(),
        plan,
        scene: manifest.scene.clone(),
    };
    // An audit counts in the quantum of its file.
    writer.finish(&about, receivers, audit.as_ref().filter(|_| rule.quantum == matrix.quantum))
}
