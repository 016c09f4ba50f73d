//! Writing a transport: shard by shard into a directory beside the target, published by rename when it is whole.
//!
//! `NAME.partial/` holds a run in progress: `job.json` (what is being computed, by its exact text), and for each
//! finished shard its file and a small record with size and checksum. A run with the same job resumes from the intact
//! shards; one with another job starts anew. `NAME` itself is only touched by the last two renames.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::value::RawValue;

use crate::basis::ColumnSpace;
use crate::error::{Error, Result};

use super::beside::{self, Beside};
use super::link;
use super::manifest::{
    AUDIT, FORMAT, FileEntry, LINK, LOBED, MAJOR, MANIFEST, Manifest, PartEntry, RECEIVERS, ReceiversEntry, SIGNED,
    TILES_PER_SHARD, is_part_name, read_small, sealed, shard_name, written,
};
use super::open::{self, Audit};
use super::receivers;
use super::shard::{Tensor, is_intact, sync_directory, unit_of, write_file, write_in_unit, write_tensors};
use crate::transport::entry::{Channels, GROUP, Width};
use crate::transport::product::Link;
use crate::transport::receivers::{ReceiverKind, ReceiverTable};
use crate::transport::sight::blocks_of;
use crate::transport::tile::{Tile, Values};

const JOB: &str = "job.json";
const LOCK: &str = "lock";
/// A job is a page of text.
const MAX_JOB: u64 = 16 << 20;
/// A record is a name, a size and a checksum.
const MAX_RECORD: u64 = 4096;

/// One matrix of a transport, before its tiles are there.
#[derive(Clone, Debug)]
pub struct Part {
    /// Of lower-case letters, digits and underscores.
    pub name: String,
    /// What its columns are.
    pub space: ColumnSpace,
    /// Its rows, over all tiles.
    pub rows: usize,
    /// One number for all colours, or one each.
    pub channels: Channels,
    /// The exponent of two that all values are multiples of.
    pub quantum: i32,
    /// Of the stored integers.
    pub width: Width,
    /// Rows of every tile but the last: a multiple of 16, at most 16,384.
    pub tile_rows: usize,
}

/// What the manifest says that the tiles and the receivers do not.
#[derive(Clone)]
pub struct Description {
    /// In the order of the chain.
    pub parts: Vec<Part>,
    /// How many of them are the first stage.
    pub first: usize,
    /// What stands between the first stage and the other parts.
    pub link: Link,
    /// JSON objects, opaque here; a camera where the receivers are its pixels.
    pub camera: Option<String>,
    /// How M was made: a JSON object, opaque here.
    pub plan: String,
    /// The hash of the scene that M was computed from.
    pub scene: String,
    /// What lies beside the product, in the order of `beside::FILES`.
    pub beside: Vec<Beside>,
}

/// A transport being written.
pub struct Writer {
    target: PathBuf,
    partial: PathBuf,
    /// Held until the writer goes: no second run writes here.
    lock: File,
    /// By part and number.
    shards: BTreeMap<(String, usize), FileEntry>,
}

impl Writer {
    /// Begins a run, or resumes one that was writing the same `job` to the same path.
    ///
    /// Refuses, before anything is written, a target that exists and is not a transport.
    pub fn open(path: &Path, job: &str) -> Result<Writer> {
        let (target, partial) = Self::check(path)?;
        // Only one run at a time: the lock goes with the process, however it ends.
        fs::create_dir_all(&partial).map_err(|source| Error::os(&partial, source))?;
        let lock = lock(&partial)?;
        recover(&target)?;

        // Another job's shards are never mixed in.
        let same = read_small(&partial.join(JOB), MAX_JOB).is_ok_and(|text| text == job.as_bytes());
        if !same {
            remove_ours(&partial, |name| name != LOCK)?;
            write_file(&partial, JOB, std::iter::once(job.as_bytes()))?;
        }
        let shards = finished_shards(&partial)?;
        Ok(Writer { target, partial, lock, shards })
    }

    /// What `open` would refuse, found without writing anything; the directories of the result and of the run.
    pub fn check(path: &Path) -> Result<(PathBuf, PathBuf)> {
        let target = std::path::absolute(path).map_err(|source| Error::os(path, source))?;
        // A link to a transport stays: what it points at is replaced.
        let target = fs::canonicalize(&target).unwrap_or(target);
        check_replaceable(&target)?;
        let partial = sibling(&target, ".partial")?;
        check_partial(&partial)?;
        Ok((target, partial))
    }

    /// Numbers of the shards of a part that are there and intact, ascending.
    pub fn finished(&self, part: &str) -> Vec<usize> {
        self.shards.keys().filter(|(name, _)| name == part).map(|&(_, shard)| shard).collect()
    }

    /// The directory that `finish` publishes.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Writes tiles `4 shard ..` of a part; returns the bytes written. A shard that exists is replaced.
    pub fn write_shard(&mut self, part: &str, shard: usize, tiles: &[Tile]) -> Result<u64> {
        let entry = put_shard(&self.partial, part, shard, tiles)?;
        let bytes = entry.bytes;
        self.shards.insert((part.to_owned(), shard), entry);
        Ok(bytes)
    }

    /// Writes a shard of a run that another process has begun, on this machine or on another that sees the same files;
    /// that run `adopt`s it. Refuses where no run of this job is there.
    pub fn deliver(path: &Path, job: &str, part: &str, shard: usize, tiles: &[Tile]) -> Result<u64> {
        let (_, partial) = Self::check(path)?;
        if !read_small(&partial.join(JOB), MAX_JOB).is_ok_and(|text| text == job.as_bytes()) {
            let place = partial.display();
            return Err(Error::input(format!("{place}: expected the run that asked for this shard, found none of it")));
        }
        Ok(put_shard(&partial, part, shard, tiles)?.bytes)
    }

    /// Takes in a shard that was delivered, checked as one that an earlier run has left.
    pub fn adopt(&mut self, part: &str, shard: usize) -> Result<()> {
        let record = read_small(&self.partial.join(record_name(part, shard)), MAX_RECORD)?;
        let entry = intact(&self.partial, part, shard, &record).ok_or_else(|| {
            let place = self.partial.display();
            Error::input(format!("{place}: expected shard {shard} of {part} as it was delivered, found it altered"))
        })?;
        self.shards.insert((part.to_owned(), shard), entry);
        Ok(())
    }

    /// Completes the run: receivers, link, audit, what lies beside, manifest, a full check of everything as a reader would see it, and
    /// publication.
    pub fn finish(self, about: &Description, table: &ReceiverTable, audit: Option<&Audit>) -> Result<()> {
        table.check(about.receiving_rows()?).map_err(Error::Input)?;
        let mut manifest = about.manifest(table)?;
        for part in &manifest.parts {
            for shard in 0..part.shards() {
                let entry = self.shards.get(&(part.name.clone(), shard)).ok_or_else(|| {
                    let (name, count) = (&part.name, part.shards());
                    Error::input(format!("expected {count} shards of {name}, but shard {shard} was not written"))
                })?;
                manifest.files.push(entry.clone());
            }
        }
        let models = receivers::stored_models(table);
        manifest.files.push(write_tensors(&self.partial, RECEIVERS, receivers::tensors(table, &models))?);
        if let Some(arrays) = link::tensors(&about.link) {
            manifest.files.push(write_tensors(&self.partial, LINK, arrays)?);
        }
        if let Some(audit) = audit {
            let mut all = tensors("audit", &audit.tile);
            all.push(Tensor::new("audit.groups", &[audit.groups.len()], &audit.groups));
            manifest.files.push(write_in_unit(&self.partial, AUDIT, unit(&audit.tile), all)?);
        }
        for own in &about.beside {
            manifest.beside.push(write_tensors(&self.partial, own.file, own.tensors())?);
        }
        write_file(&self.partial, MANIFEST, std::iter::once(&sealed(&manifest)?[..]))?;

        // What a reader would refuse is never published; the run stays where it can be resumed.
        let lobes = || table.lobes.as_ref().ok_or_else(|| Error::input("expected rows with lobes"));
        drop(open::open(&self.partial, &|_, _| lobes().map(|lobes| Arc::clone(&lobes.models)))?);
        publish(&self.partial, &self.target)
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        // A process that was forked meanwhile has the file open as well: closing it here would let go of nothing.
        let _ = self.lock.unlock();
    }
}

impl Part {
    fn entry(&self) -> PartEntry {
        PartEntry {
            name: self.name.clone(),
            columns: self.space.to_string(),
            rows: self.rows,
            channels: self.channels.count(),
            quantum: self.quantum,
            width: self.width.name().to_owned(),
            tile_rows: self.tile_rows,
        }
    }
}

impl Description {
    /// Rows of the part whose rows are the receivers.
    pub fn receiving_rows(&self) -> Result<usize> {
        let last = if self.parts.len() > self.first { self.first } else { 0 };
        self.parts.get(last).map(|part| part.rows).ok_or_else(|| Error::input("expected at least one part, got none"))
    }

    /// The manifest without its files.
    fn manifest(&self, table: &ReceiverTable) -> Result<Manifest> {
        let raw = |what: &str, text: &str| {
            RawValue::from_string(text.to_owned())
                .map_err(|error| Error::input(format!("expected {what} as JSON text: {error}")))
        };
        let image = match &table.kind {
            ReceiverKind::Pixels { image, .. } => Some(*image),
            ReceiverKind::Vertices { .. } | ReceiverKind::Gather { .. } => None,
        };
        let signed = matches!(&self.link, Link::Weights(weights) if weights.any_negative());
        let major = match (table.lobes.is_some(), signed) {
            (true, true) => {
                return Err(Error::input("expected weights of at least 0 where texel columns are of lobes"));
            }
            (true, false) => LOBED,
            (false, true) => SIGNED,
            (false, false) => MAJOR,
        };
        let parts: Vec<PartEntry> = self.parts.iter().map(Part::entry).collect();
        parts.iter().try_for_each(PartEntry::check)?;
        let names: Vec<String> = parts.iter().map(|part| part.name.clone()).collect();
        Ok(Manifest {
            format: FORMAT.to_owned(),
            version: [major, written(major)],
            parts,
            chain: link::entry(&names, self.first, &self.link),
            tiles_per_shard: TILES_PER_SHARD,
            receivers: ReceiversEntry {
                kind: table.kind.name().to_owned(),
                image,
                camera: self.camera.as_ref().map(|camera| raw("the camera", camera)).transpose()?,
            },
            plan: raw("the plan", &self.plan)?,
            scene: self.scene.clone(),
            files: Vec::new(),
            beside: Vec::new(),
        })
    }
}

/// What a tile's integers are multiples of, as its file says it.
fn unit(tile: &Tile) -> String {
    let width = match tile.values {
        Values::I8(_) => Width::I8,
        Values::I16(_) => Width::I16,
    };
    unit_of(width, tile.quantum)
}

/// The arrays of a tile: five, and two more where it has texel columns.
fn tensors<'a>(name: &str, tile: &'a Tile) -> Vec<Tensor<'a>> {
    let entries = tile.words.len();
    let bands = tile.kept.len() / (tile.rows * tile.channels.count()).max(1);
    // Files of one channel have no axis for it.
    let (norms, integers) = match tile.channels {
        Channels::One => (vec![tile.rows, bands], vec![entries, GROUP]),
        Channels::Three => (vec![tile.rows, bands, 3], vec![entries, 3, GROUP]),
    };
    let values = format!("{name}.values");
    let mut all = vec![
        Tensor::new(format!("{name}.starts"), &[tile.starts.len()], &tile.starts),
        Tensor::new(format!("{name}.words"), &[entries], &tile.words),
        match &tile.values {
            Values::I8(items) => Tensor::new(values, &integers, items),
            Values::I16(items) => Tensor::new(values, &integers, items),
        },
        Tensor::new(format!("{name}.kept"), &norms, &tile.kept),
        Tensor::new(format!("{name}.dropped"), &norms, &tile.dropped),
    ];
    if let Some(sight) = &tile.sight {
        let shape = [sight.bundles(), blocks_of(sight.size)];
        all.push(Tensor::new(format!("{name}.blocks"), &shape, &sight.blocks));
        all.push(Tensor::new(format!("{name}.masks"), &[sight.stream.len()], &sight.stream));
        if sight.lobes.is_some() {
            all.push(Tensor::new(format!("{name}.shifts"), &[sight.shifts.len()], &sight.shifts));
        }
    }
    all
}

/// `NAME.transport` with a suffix, in the same directory.
fn sibling(target: &Path, suffix: &str) -> Result<PathBuf> {
    let name = target
        .file_name()
        .ok_or_else(|| Error::input(format!("expected the name of a directory to write, got {}", target.display())))?;
    let mut name: OsString = name.to_owned();
    name.push(suffix);
    Ok(target.with_file_name(name))
}

fn record_name(part: &str, shard: usize) -> String {
    format!("tiles-{part}-{shard:05}.json")
}

/// The part, number and ending in the name of a shard or of its record; the part is empty in version 1.
fn parse_shard(name: &str) -> Option<(&str, usize, &str)> {
    let (stem, ending) = name.strip_prefix("tiles-")?.split_once('.')?;
    let (part, number) = stem.rsplit_once('-').unwrap_or(("", stem));
    let known = (part.is_empty() || is_part_name(part)) && ["safetensors", "json"].contains(&ending);
    let digits = number.len() >= 5 && number.bytes().all(|c| c.is_ascii_digit());
    if known && digits { Some((part, number.parse().ok()?, ending)) } else { None }
}

/// Whether a name is one that this file writes. Nothing else is ever removed.
fn is_ours(name: &str) -> bool {
    [MANIFEST, RECEIVERS, LINK, AUDIT, JOB, LOCK].contains(&name)
        || beside::FILES.contains(&name)
        || name.starts_with(".tmp-")
        || parse_shard(name).is_some()
}

/// The names in a directory; None where there is no directory.
fn names(directory: &Path) -> Result<Option<Vec<String>>> {
    match fs::symlink_metadata(directory) {
        Err(source) if source.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(source) => return Err(Error::os(directory, source)),
        Ok(seen) if !seen.is_dir() => {
            return Err(Error::file(directory, "expected a transport directory or nothing, found something else"));
        }
        Ok(_) => {}
    }
    let entries = fs::read_dir(directory).and_then(|entries| {
        entries.map(|entry| entry.map(|entry| entry.file_name().to_string_lossy().into_owned())).collect()
    });
    entries.map(Some).map_err(|source| Error::os(directory, source))
}

/// Refuses a target whose replacement would cost the user anything but a transport.
fn check_replaceable(target: &Path) -> Result<()> {
    let Some(names) = names(target)? else { return Ok(()) };
    if names.is_empty() {
        return Ok(());
    }
    if let Some(foreign) = names.iter().find(|name| !is_ours(name)) {
        let what = format!("will not be replaced: it holds {foreign:?}, which is not part of a transport");
        return Err(Error::file(target, what));
    }
    if !Manifest::is_transport(target) {
        return Err(Error::file(target, "will not be replaced: it exists and is not a transport"));
    }
    Ok(())
}

/// Refuses to work in a directory that no run of ours left.
fn check_partial(partial: &Path) -> Result<()> {
    match names(partial)?.unwrap_or_default().iter().find(|name| !is_ours(name)) {
        Some(foreign) => Err(Error::file(partial, format!("expected the remains of a run, found {foreign:?}"))),
        None => Ok(()),
    }
}

fn lock(partial: &Path) -> Result<File> {
    let path = partial.join(LOCK);
    let file = File::create(&path).map_err(|source| Error::os(&path, source))?;
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Err(Error::file(partial, "another run is writing here")),
        // File systems without locks still get whole files, by rename.
        Ok(()) | Err(TryLockError::Error(_)) => Ok(file),
    }
}

/// A shard's file and then its record: what has a record is whole.
fn put_shard(partial: &Path, part: &str, shard: usize, tiles: &[Tile]) -> Result<FileEntry> {
    if !is_part_name(part) {
        return Err(Error::input(format!("expected the name of a part, of a-z, 0-9 and _, got {part:?}")));
    }
    if tiles.is_empty() || tiles.len() > TILES_PER_SHARD || shard > u32::MAX as usize {
        let count = tiles.len();
        return Err(Error::input(format!(
            "expected 1 to {TILES_PER_SHARD} tiles of a shard below 2^32, got {count} of shard {shard}"
        )));
    }
    let numbered = tiles.iter().enumerate();
    let tensors = numbered.flat_map(|(k, tile)| tensors(&format!("{:05}", shard * TILES_PER_SHARD + k), tile));
    let unit = unit(&tiles[0]);
    if let Some(other) = tiles.iter().find(|tile| self::unit(tile) != unit) {
        return Err(Error::input(format!("expected tiles in one unit, got {unit} and {}", self::unit(other))));
    }
    let entry = write_in_unit(partial, &shard_name(part, shard), unit, tensors.collect())?;
    let record = serde_json::to_vec(&entry).map_err(|error| Error::input(error.to_string()))?;
    write_file(partial, &record_name(part, shard), std::iter::once(&record[..]))?;
    Ok(entry)
}

/// What a record says of a shard, where the shard's file agrees.
fn intact(partial: &Path, part: &str, shard: usize, record: &[u8]) -> Option<FileEntry> {
    let entry = serde_json::from_slice::<FileEntry>(record).ok()?;
    (entry.name == shard_name(part, shard) && is_intact(partial, &entry)).then_some(entry)
}

/// Shards whose record and file agree; what does not is removed, with whatever a killed run left half-written.
fn finished_shards(partial: &Path) -> Result<BTreeMap<(String, usize), FileEntry>> {
    let mut shards = BTreeMap::new();
    for name in names(partial)?.unwrap_or_default() {
        let Some((part, shard, "json")) = parse_shard(&name) else { continue };
        let record = read_small(&partial.join(&name), MAX_RECORD)?;
        if let Some(entry) = intact(partial, part, shard, &record) {
            shards.insert((part.to_owned(), shard), entry);
        }
    }
    remove_ours(partial, |name| {
        let known =
            shards.keys().any(|(part, shard)| name == shard_name(part, *shard) || name == record_name(part, *shard));
        !known && name != JOB && name != LOCK
    })?;
    Ok(shards)
}

/// Removes those of our files that `which` picks; never anything else.
fn remove_ours(directory: &Path, which: impl Fn(&str) -> bool) -> Result<()> {
    for name in names(directory)?.unwrap_or_default() {
        if is_ours(&name) && which(&name) {
            let path = directory.join(&name);
            unless_gone(fs::remove_file(&path)).map_err(|source| Error::os(&path, source))?;
        }
    }
    Ok(())
}

/// Removes a directory of ours; one that holds more than our files stays, with the rest in it.
fn remove_directory(directory: &Path) -> Result<()> {
    remove_ours(directory, |_| true)?;
    match unless_gone(fs::remove_dir(directory)) {
        Err(source) if source.kind() != std::io::ErrorKind::DirectoryNotEmpty => Err(Error::os(directory, source)),
        _ => Ok(()),
    }
}

/// Somebody else may have removed the same remains first.
fn unless_gone(removed: std::io::Result<()>) -> std::io::Result<()> {
    removed.or_else(|source| if source.kind() == std::io::ErrorKind::NotFound { Ok(()) } else { Err(source) })
}

/// After a run that was killed in `publish`: the old result comes back, or goes where the new one has taken its place.
fn recover(target: &Path) -> Result<()> {
    let old = sibling(target, ".old")?;
    if Manifest::is_transport(target) {
        // Whole, or what a kill has left of its removal: the next result could not be put aside to make room.
        return remove_directory(&old);
    }
    if !Manifest::is_transport(&old) {
        return Ok(());
    }
    // An empty directory in its place is nobody's work.
    if names(target)?.is_some() {
        fs::remove_dir(target).map_err(|source| Error::os(target, source))?;
    }
    fs::rename(&old, target).map_err(|source| Error::os(target, source))
}

/// Puts a complete directory in the target's place. Until the second rename the old result is whole, under one name or
/// the other.
fn publish(partial: &Path, target: &Path) -> Result<()> {
    check_replaceable(target)?;
    let old = sibling(target, ".old")?;
    let replaces = target.exists();
    if replaces {
        fs::rename(target, &old).map_err(|source| Error::os(target, source))?;
    }
    if let Err(source) = fs::rename(partial, target) {
        if replaces {
            fs::rename(&old, target).map_err(|source| Error::os(&old, source))?;
        }
        return Err(Error::os(target, source));
    }
    if let Some(parent) = target.parent() {
        sync_directory(parent).map_err(|source| Error::os(parent, source))?;
    }

    // From here on the new result stands; what is left of the run and of the old result only takes space.
    if replaces {
        remove_directory(&old)?;
    }
    remove_ours(target, |name| name == JOB || name == LOCK || name.ends_with(".json") && name != MANIFEST)
}
