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
use super::matrix::TransportMatrix;
use super::shard::{Shard, Tensor};
use super::tile::{GROUP, MAX_TILE_ROWS, Slab, Tile, Values, Width, group_of, shift_of};
use super::truncate::max_step;

/// What turns rows into an image: one item a row, and the light that passes by the scene.
#[derive(Clone)]
pub struct ReceiverTable {
    /// The pixel that a row adds to, row-major.
    pub pixel: Slab<u32>,
    /// What share of the pixel the row is.
    pub weight: Slab<f32>,
    /// Diffuse reflectance, `[row][rgb]`.
    pub albedo: Slab<f32>,
    /// World coordinates, `[row][xyz]`.
    pub position: Slab<f32>,
    pub normal: Slab<f32>,
    pub material: Option<Slab<u16>>,
    /// What share of each pixel sees no surface.
    pub background: Slab<f32>,
}

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

    let receivers = read_receivers(&Shard::open(directory, &others[0])?, &manifest)?;
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

fn read_receivers(file: &Shard, manifest: &Manifest) -> Result<ReceiverTable> {
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

impl ReceiverTable {
    /// Whether there is one item a row and a pixel, pixels exist, and all numbers are finite, shares not negative.
    pub fn check(&self, rows: usize, image: [usize; 2]) -> std::result::Result<(), String> {
        let pixels = image[0].checked_mul(image[1]).ok_or("expected an image of at most 2^28 pixels")?;
        let lengths = [
            ("pixel", self.pixel.len(), rows),
            ("weight", self.weight.len(), rows),
            ("albedo", self.albedo.len(), 3 * rows),
            ("position", self.position.len(), 3 * rows),
            ("normal", self.normal.len(), 3 * rows),
            ("material", self.material.as_ref().map_or(rows, |items| items.len()), rows),
            ("background", self.background.len(), pixels),
        ];
        if let Some((what, found, expected)) = lengths.into_iter().find(|(_, found, expected)| found != expected) {
            return Err(format!("expected {expected} numbers of {what}, found {found}"));
        }
        if let Some(pixel) = self.pixel.iter().find(|&&pixel| pixel as usize >= pixels) {
            return Err(format!("expected pixels below {pixels}, found {pixel}"));
        }
        let shares = [("weight", &self.weight), ("albedo", &self.albedo), ("background", &self.background)];
        for (what, items) in shares {
            if let Some(item) = items.iter().find(|item| !(item.is_finite() && **item >= 0.0)) {
                return Err(format!("expected finite {what} values >= 0, found {item}"));
            }
        }
        for (what, items) in [("position", &self.position), ("normal", &self.normal)] {
            if let Some(item) = items.iter().find(|item| !item.is_finite()) {
                return Err(format!("expected finite {what} values, found {item}"));
            }
        }
        Ok(())
    }

    /// The arrays of `receivers.safetensors`.
    pub(super) fn tensors(&self, image: [usize; 2]) -> Vec<Tensor<'_>> {
        let rows = self.pixel.len();
        let mut all = vec![
            Tensor::new("pixel", &[rows], &self.pixel),
            Tensor::new("weight", &[rows], &self.weight),
            Tensor::new("albedo", &[rows, 3], &self.albedo),
            Tensor::new("position", &[rows, 3], &self.position),
            Tensor::new("normal", &[rows, 3], &self.normal),
            Tensor::new("background", &[image[0] * image[1]], &self.background),
        ];
        if let Some(material) = &self.material {
            all.push(Tensor::new("material", &[rows], material));
        }
        all
    }

    pub fn nbytes(&self) -> usize {
        let floats = self.weight.len() + self.albedo.len() + self.position.len() + self.normal.len();
        let material = self.material.as_ref().map_or(0, |material| material.len());
        4 * (self.pixel.len() + floats + self.background.len()) + 2 * material
    }
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
