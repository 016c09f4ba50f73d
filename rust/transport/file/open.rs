//! Opening a transport directory (`FORMAT.md`): files are hostile, so everything is checked before anything is used.
//!
//! Order of the checks: the manifest alone; each file's kind, size and checksum; its header; types and shapes; then the
//! contents, so that afterwards no index, shift or norm can be out of range. Nothing is allocated by a size that a file
//! claims: sizes are those of files that exist, and the arrays stay where the file is.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;

use crate::basis::Bands;
use crate::error::{Error, Result};

use super::beside::Beside;
use super::link;
use super::manifest::{FileEntry, MANIFEST, Manifest, PartEntry};
use super::receivers;
use super::shard::{Directory, Shard, unit_of};
use super::versions::read_manifest;
use crate::transport::entry::{
    Channels, GROUP, MAX_TILE_ROWS, Width, bf16, group_of, max_step, power_of_two, shift_of,
};
use crate::transport::lobes::{Lobes, MakeModels};
use crate::transport::matrix::TransportMatrix;
use crate::transport::product::Product;
use crate::transport::receivers::ReceiverTable;
use crate::transport::sight::{BUNDLE, Sight, blocks_of};
use crate::transport::slab::Slab;
use crate::transport::tile::{Tile, Values};

/// Untruncated sample groups of the first part: what truncation can be measured against.
#[derive(Clone)]
pub struct Audit {
    /// Numbers of the groups of 16 rows, counted over the whole matrix.
    pub groups: Slab<u32>,
    /// Those groups one below the other, in 16 bits.
    pub tile: Tile,
}

/// An opened transport.
pub struct Opened {
    /// What the directory says of itself, checked.
    pub manifest: Manifest,
    /// The matrices and what links them.
    pub product: Product,
    /// What the rows of B are.
    pub receivers: ReceiverTable,
    /// Untruncated sample groups, where the writer kept any.
    pub audit: Option<Audit>,
    /// What lies beside the product.
    pub beside: Vec<Beside>,
}

/// Opens a directory: what is large by memory map. Every file is read once for its checksum, in parallel. `models` makes the models that
/// texel columns are made of, where they are lobes.
pub fn open(path: &Path, models: &MakeModels) -> Result<Opened> {
    let manifest = read_manifest(path)?;
    let manifest_error = |error: Error| Error::file(&path.join(MANIFEST), error.to_string());
    let directory = Directory::new(path, manifest.files.iter().chain(&manifest.beside));
    let (of_parts, others) = manifest.files_by_kind();

    // Texel columns take their cosines from the normals of the receivers, or their lobes.
    let receivers = receivers::read(&Shard::open(directory, &others[0])?, &manifest, models)?;
    check_texels(&manifest).map_err(manifest_error)?;

    // The tiles of all shards, verified in parallel; the first error in file order is told.
    let parts = manifest.parts.iter().zip(of_parts);
    let shards =
        parts.flat_map(|(part, files)| files.iter().enumerate().map(move |(shard, entry)| (part, shard, entry)));
    let read: Vec<Result<Vec<Tile>>> = shards
        .collect::<Vec<_>>()
        .into_par_iter()
        .map(|(part, shard, entry)| read_shard(directory, entry, part, shard, &receivers, manifest.says_unit()))
        .collect();
    let mut read = read.into_iter();
    let mut matrices = Vec::new();
    for part in &manifest.parts {
        let mut tiles = Vec::new();
        for shard in read.by_ref().take(part.shards()) {
            tiles.extend(shard?);
        }
        matrices.push(Arc::new(matrix(part, tiles).map_err(manifest_error)?));
    }

    let (link_file, audit_file) = others[1..].split_at(usize::from(manifest.has_link_file()));
    let link_file = link_file.first().map(|entry| Shard::open(directory, entry)).transpose()?;
    let audit = match audit_file.first() {
        Some(entry) => Some(read_audit(&Shard::open(directory, entry)?, &manifest, &receivers)?),
        None => None,
    };
    let product = link::product(&manifest, matrices, link_file.as_ref()).map_err(|error| match error {
        Error::Input(_) => manifest_error(error),
        other => other,
    })?;
    let beside = manifest.beside.iter().filter_map(|entry| Beside::read(directory, entry).transpose());
    let beside = beside.collect::<Result<_>>()?;
    Ok(Opened { manifest, product, receivers, audit, beside })
}

/// A part from its tiles.
fn matrix(part: &PartEntry, tiles: Vec<Tile>) -> Result<TransportMatrix> {
    let space = part.space()?;
    let PartEntry { rows, quantum, tile_rows, .. } = *part;
    Ok(TransportMatrix { space, bands: space.bands(), rows, channels: part.channels()?, quantum, tile_rows, tiles })
}

/// Texel columns stand in the one matrix whose rows are the receivers: theirs are the normals.
fn check_texels(manifest: &Manifest) -> Result<()> {
    for (number, part) in manifest.parts.iter().enumerate() {
        let receiving = number == 0 && (manifest.parts.len() == 1 || manifest.chain.link == "weights");
        if part.space()?.texels().is_some() && !(receiving && part.channels == 1) {
            return Err(Error::input("expected texel columns in the receivers' part alone, with one channel"));
        }
    }
    Ok(())
}

fn read_shard(
    directory: Directory,
    entry: &FileEntry,
    part: &PartEntry,
    shard: usize,
    receivers: &ReceiverTable,
    says_unit: bool,
) -> Result<Vec<Tile>> {
    let file = Shard::open(directory, entry)?;
    file.expect_unit(&unit_of(part.width()?, part.quantum), says_unit)?;
    let numbers = part.tiles_of(shard);
    file.expect_count(arrays_of(part, receivers)? * numbers.len())?;
    let width = part.width()?;
    numbers
        .map(|number| {
            let rows = part.rows_of(number);
            let first = number * part.tile_rows;
            let tile = read_tile(&file, &format!("{number:05}"), rows, part, width)?;
            with_sight(&file, &format!("{number:05}"), part, tile, || {
                let lobes = receivers.lobes.as_ref().map(|lobes| lobes.part(first..first + rows));
                (receivers.normal.part(3 * first..3 * (first + rows)), lobes)
            })
        })
        .collect()
}

/// Arrays that a tile of a part is stored in.
fn arrays_of(part: &PartEntry, receivers: &ReceiverTable) -> Result<usize> {
    Ok(match part.space()?.texels() {
        None => 5,
        Some(_) => 7 + usize::from(receivers.lobes.is_some()),
    })
}

/// A tile with its texel columns, where the part has any; `own`: the normals and lobes of its rows.
fn with_sight(
    file: &Shard,
    name: &str,
    part: &PartEntry,
    tile: Tile,
    own: impl FnOnce() -> (Slab<f32>, Option<Lobes>),
) -> Result<Tile> {
    let Some(size) = part.space()?.texels() else { return Ok(tile) };
    let stream = format!("{name}.masks");
    let (normals, lobes) = own();
    let shifts: Slab<u8> = match lobes {
        Some(_) => file.slab(&format!("{name}.shifts"), &[tile.groups()])?,
        None => Vec::new().into(),
    };
    let most = max_step(part.width()?) - part.quantum;
    if let Some(shift) = shifts.iter().find(|&&shift| i32::from(shift) > most) {
        return Err(file.error(format!("tile {name:?}: expected shifts up to {most}, found {shift}")));
    }
    let sight = Sight {
        size,
        quantum: part.quantum,
        normals,
        lobes,
        shifts,
        blocks: file.slab(&format!("{name}.blocks"), &[tile.rows.div_ceil(BUNDLE), blocks_of(size)])?,
        stream: file.slab(&stream, &[file.len(&stream)?])?,
    };
    sight.check().map_err(|what| file.error(format!("tile {name:?}: {what}")))?;
    Ok(Tile { sight: Some(sight), ..tile })
}

/// A tile by its arrays' common name, with everything about it checked.
fn read_tile(file: &Shard, name: &str, rows: usize, part: &PartEntry, width: Width) -> Result<Tile> {
    let (bands, channels) = (part.space()?.bands(), part.channels()?);
    let entries = file.len(&format!("{name}.words"))?;
    let values = format!("{name}.values");
    // Files of one channel have no axis for it.
    let shape = |all: [usize; 3]| match channels {
        Channels::One => vec![all[0], all[1] * all[2]],
        Channels::Three => all.to_vec(),
    };
    let (norms, integers) = (shape([rows, bands.count(), channels.count()]), shape([entries, channels.count(), GROUP]));
    let tile = Tile {
        rows,
        channels,
        quantum: part.quantum,
        starts: file.slab(&format!("{name}.starts"), &[bands.stored() + 1])?,
        words: file.slab(&format!("{name}.words"), &[entries])?,
        values: match width {
            Width::I8 => Values::I8(file.slab(&values, &integers)?),
            Width::I16 => Values::I16(file.slab(&values, &integers)?),
        },
        kept: file.slab(&format!("{name}.kept"), &norms)?,
        dropped: file.slab(&format!("{name}.dropped"), &norms)?,
        sight: None,
    };
    check_tile(&tile, &bands, part.quantum, width).map_err(|what| file.error(format!("tile {name:?}: {what}")))?;
    Ok(tile)
}

/// Whether a tile keeps every promise that its readers rely on.
pub fn check_tile(tile: &Tile, bands: &Bands, quantum: i32, width: Width) -> std::result::Result<(), String> {
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
    check_kept(tile, bands, quantum)
}

/// Bounds stand on the norms of what is stored: none may be below its entries'. Those of texel columns, which have none,
/// are believed.
fn check_kept(tile: &Tile, bands: &Bands, quantum: i32) -> std::result::Result<(), String> {
    let channels = tile.channels.count();
    let unit = 2f64.powi(2 * quantum);
    let mut squares = vec![[0f64; GROUP]; tile.groups() * channels];
    for band in 0..bands.count() {
        squares.fill([0.0; GROUP]);
        for column in bands.range(band) {
            let entries = tile.entries(column);
            match &tile.values {
                Values::I8(values) => add_squares(tile, entries, values, &mut squares),
                Values::I16(values) => add_squares(tile, entries, values, &mut squares),
            }
        }
        for row in 0..tile.rows {
            for channel in 0..channels {
                let stated = f64::from(bf16(tile.kept[(row * bands.count() + band) * channels + channel]));
                let found = squares[row / GROUP * channels + channel][row % GROUP] * unit;
                if found > stated * stated {
                    let found = found.sqrt();
                    return Err(format!(
                        "expected {found:e} or more kept of row {row} in band {band}, found {stated:e}"
                    ));
                }
            }
        }
    }
    Ok(())
}

/// Adds the squares of entries, in units of the quantum, to those of their groups: `[group][channel][lane]`.
fn add_squares<T: Copy + Into<i32>>(tile: &Tile, entries: Range<usize>, values: &[T], squares: &mut [[f64; GROUP]]) {
    let channels = tile.channels.count();
    let (lanes, _) = values.as_chunks::<GROUP>();
    for entry in entries {
        let (group, step) = (group_of(tile.words[entry]), f64::from(power_of_two(shift_of(tile.words[entry]))));
        for channel in 0..channels {
            let sums = &mut squares[group * channels + channel];
            for (sum, &value) in sums.iter_mut().zip(&lanes[entry * channels + channel]) {
                let value: i32 = value.into();
                *sum += f64::from(value * value) * (step * step);
            }
        }
    }
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
            let channels = tile.channels.count();
            (entry * channels..(entry + 1) * channels).all(|plane| {
                let padding = plane * GROUP + used..(plane + 1) * GROUP;
                match &tile.values {
                    Values::I8(values) => values[padding].iter().all(|&value| value == 0),
                    Values::I16(values) => values[padding].iter().all(|&value| value == 0),
                }
            })
        })
}

fn read_audit(file: &Shard, manifest: &Manifest, receivers: &ReceiverTable) -> Result<Audit> {
    let part = &manifest.parts[0];
    file.expect_unit(&unit_of(Width::I16, part.quantum), manifest.says_unit())?;
    file.expect_count(1 + arrays_of(part, receivers)?)?;
    let count = file.len("audit.groups")?;
    if count == 0 || count * GROUP > MAX_TILE_ROWS {
        return Err(file.error(format!("expected 1 to {} sample groups, found {count}", MAX_TILE_ROWS / GROUP)));
    }
    let groups: Slab<u32> = file.slab("audit.groups", &[count])?;
    let all = part.rows.div_ceil(GROUP);
    if groups.windows(2).any(|pair| pair[0] >= pair[1]) || groups[count - 1] as usize >= all {
        return Err(file.error(format!("expected ascending group numbers below {all}")));
    }
    let tile = read_tile(file, "audit", count * GROUP, part, Width::I16)?;
    let tile = with_sight(file, "audit", part, tile, || {
        // Rows that pad the last group have no normal, and see nothing.
        let rows = groups.iter().flat_map(|&group| (group as usize * GROUP..).take(GROUP));
        let place = |row: usize| (3 * row..3 * row + 3).map(|at| receivers.normal.get(at).copied().unwrap_or(0.0));
        let lobes = receivers.lobes.as_ref().map(|lobes| lobes.picked(rows.clone()));
        (rows.flat_map(place).collect::<Vec<f32>>().into(), lobes)
    })?;
    Ok(Audit { groups, tile })
}
