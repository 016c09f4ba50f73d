//! Opening a transport directory (`FORMAT.md`): files are hostile, so everything is checked before anything is used.
//!
//! Order of the checks: the manifest alone; each file's kind, size and checksum; its header; types and shapes; then the
//! contents, so that afterwards no index, shift or norm can be out of range. Nothing is allocated by a size that a file
//! claims: sizes are those of files that exist, and the arrays stay where they are mapped.

use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;

use crate::basis::Bands;
use crate::error::{Error, Result};

use super::manifest::{FileEntry, MANIFEST, Manifest};
use super::receivers;
use super::shard::Shard;
use crate::transport::entry::{GROUP, MAX_TILE_ROWS, Width, group_of, max_step, shift_of};
use crate::transport::matrix::TransportMatrix;
use crate::transport::receivers::ReceiverTable;
use crate::transport::tile::{Slab, Tile, Values};

/// Untruncated sample groups: what truncation can be measured against.
#[derive(Clone)]
pub struct Audit {
    /// Numbers of the groups of 16 rows, counted over the whole matrix.
    pub groups: Slab<u32>,
    /// Those groups one below the other, in 16 bits.
    pub tile: Tile,
}

/// An opened transport.
pub struct Opened {
    pub manifest: Manifest,
    pub matrix: Arc<TransportMatrix>,
    pub receivers: ReceiverTable,
    pub audit: Option<Audit>,
}

/// Opens a directory by memory map. Every file is read once for its checksum, in parallel.
pub fn open(directory: &Path) -> Result<Opened> {
    let manifest = Manifest::read(directory)?;
    let manifest_error = |error: Error| Error::file(&directory.join(MANIFEST), error.to_string());
    let space = manifest.space().map_err(manifest_error)?;
    let width = manifest.width().map_err(manifest_error)?;
    let bands = space.bands();
    let (shard_files, others) = manifest.files.split_at(manifest.shards());

    // The tiles of all shards, verified in parallel; the first error in file order is told.
    let shards: Vec<Result<Vec<Tile>>> = shard_files
        .par_iter()
        .enumerate()
        .map(|(shard, entry)| read_shard(directory, entry, &manifest, shard, width, &bands))
        .collect();
    let mut tiles = Vec::new();
    for shard in shards {
        tiles.extend(shard?);
    }

    let receivers = receivers::read(&Shard::open(directory, &others[0])?, &manifest)?;
    let audit = match others.get(1) {
        Some(entry) => Some(read_audit(&Shard::open(directory, entry)?, &manifest, &bands)?),
        None => None,
    };
    let matrix = TransportMatrix {
        space,
        bands,
        rows: manifest.rows,
        quantum: manifest.quantum,
        tile_rows: manifest.tile_rows,
        tiles,
    };
    Ok(Opened { manifest, matrix: Arc::new(matrix), receivers, audit })
}

fn read_shard(
    directory: &Path,
    entry: &FileEntry,
    manifest: &Manifest,
    shard: usize,
    width: Width,
    bands: &Bands,
) -> Result<Vec<Tile>> {
    let file = Shard::open(directory, entry)?;
    let numbers = manifest.tiles_of(shard);
    file.expect_count(5 * numbers.len())?;
    numbers
        .map(|number| {
            let name = format!("{number:05}");
            read_tile(&file, &name, manifest.rows_of(number), manifest.quantum, width, bands)
        })
        .collect()
}

/// A tile by its arrays' common name, with everything about it checked.
fn read_tile(file: &Shard, name: &str, rows: usize, quantum: i32, width: Width, bands: &Bands) -> Result<Tile> {
    let entries = file.len(&format!("{name}.words"))?;
    let values = format!("{name}.values");
    let norms = [rows, bands.count()];
    let tile = Tile {
        rows,
        starts: file.slab(&format!("{name}.starts"), &[bands.columns() + 1])?,
        words: file.slab(&format!("{name}.words"), &[entries])?,
        values: match width {
            Width::I8 => Values::I8(file.slab(&values, &[entries, GROUP])?),
            Width::I16 => Values::I16(file.slab(&values, &[entries, GROUP])?),
        },
        kept: file.slab(&format!("{name}.kept"), &norms)?,
        dropped: file.slab(&format!("{name}.dropped"), &norms)?,
    };
    check_tile(&tile, quantum, width).map_err(|what| file.error(format!("tile {name:?}: {what}")))?;
    Ok(tile)
}

/// Whether a tile keeps every promise that its readers rely on.
pub fn check_tile(tile: &Tile, quantum: i32, width: Width) -> std::result::Result<(), String> {
    check_starts(&tile.starts, tile.words.len())?;
    check_words(tile, max_step(width) - quantum)?;

    // The most negative integer is never written, so that -q always exists.
    let whole = match &tile.values {
        Values::I8(values) => values.iter().all(|&value| value != i8::MIN),
        Values::I16(values) => values.iter().all(|&value| value != i16::MIN),
    };
    if !whole {
        return Err(format!("expected values from -{0} to {0}, found -{1}", width.max(), i32::from(width.max()) + 1));
    }
    if !padding_is_zero(tile) {
        return Err("expected zeros in the rows that pad the last group".to_owned());
    }
    for (what, norms) in [("kept", &tile.kept), ("dropped", &tile.dropped)] {
        // A bfloat16 with all exponent bits is infinite or no number; one with the sign bit is negative.
        if let Some(bits) = norms.iter().find(|&&bits| bits >= 0x7f80) {
            return Err(format!("expected finite {what} norms >= 0, found the bits {bits:#06x}"));
        }
    }
    Ok(())
}

fn check_starts(starts: &[u32], entries: usize) -> std::result::Result<(), String> {
    if starts.first() != Some(&0) || starts.last().map(|&last| last as usize) != Some(entries) {
        return Err(format!(
            "expected column starts from 0 to {entries}, found {:?} to {:?}",
            starts.first(),
            starts.last()
        ));
    }
    match starts.windows(2).position(|pair| pair[0] > pair[1]) {
        Some(column) => Err(format!("expected ascending column starts, found a step back in column {column}")),
        None => Ok(()),
    }
}

/// Groups exist and ascend inside each column; shifts keep all values below 2^20.
fn check_words(tile: &Tile, most: i32) -> std::result::Result<(), String> {
    let groups = tile.groups() as i32;
    for (column, range) in tile.starts.windows(2).enumerate() {
        let mut before = -1;
        for &word in &tile.words[range[0] as usize..range[1] as usize] {
            let (group, shift) = (group_of(word) as i32, shift_of(word));
            if group <= before || group >= groups {
                return Err(format!(
                    "expected ascending groups below {groups} in column {column}, found {group} after {before}"
                ));
            }
            if shift > most {
                return Err(format!("expected shifts up to {most} in column {column}, found {shift}"));
            }
            before = group;
        }
    }
    Ok(())
}

fn padding_is_zero(tile: &Tile) -> bool {
    let used = tile.rows % GROUP;
    let last = tile.groups() - 1;
    used == 0
        || tile.words.iter().enumerate().filter(|&(_, &word)| group_of(word) == last).all(|(entry, _)| {
            let padding = entry * GROUP + used..(entry + 1) * GROUP;
            match &tile.values {
                Values::I8(values) => values[padding].iter().all(|&value| value == 0),
                Values::I16(values) => values[padding].iter().all(|&value| value == 0),
            }
        })
}

fn read_audit(file: &Shard, manifest: &Manifest, bands: &Bands) -> Result<Audit> {
    file.expect_count(6)?;
    let count = file.len("audit.groups")?;
    if count == 0 || count * GROUP > MAX_TILE_ROWS {
        return Err(file.error(format!("expected 1 to {} sample groups, found {count}", MAX_TILE_ROWS / GROUP)));
    }
    let groups: Slab<u32> = file.slab("audit.groups", &[count])?;
    let all = manifest.rows.div_ceil(GROUP);
    if groups.windows(2).any(|pair| pair[0] >= pair[1]) || groups[count - 1] as usize >= all {
        return Err(file.error(format!("expected ascending group numbers below {all}")));
    }
    let tile = read_tile(file, "audit", count * GROUP, manifest.quantum, Width::I16, bands)?;
    Ok(Audit { groups, tile })
}
