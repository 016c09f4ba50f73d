//! The manifest of a transport directory: written last, read first (`FORMAT.md`).

use std::io::Read;
use std::ops::Range;
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use xxhash_rust::xxh3::xxh3_64;

use crate::basis::ColumnSpace;
use crate::error::{Error, Result};
use crate::transport::entry::{Channels, GROUP, MAX_TILE_ROWS, Width, check_quantum};

/// The word by which a manifest is known.
pub const FORMAT: &str = "deltalux.transport";
/// The major version is refused where it is unknown; a minor one only adds keys or files that older readers may ignore.
/// That which is written is the one that `written` says.
pub const MAJOR: u32 = 2;
/// The first version: one matrix of pixels, whose part has no name. It is read for good.
pub const FIRST: u32 = 1;
/// The major version of files whose texel columns are made of lobes, which readers of `MAJOR` would take for cosines: all
/// else in them is as there.
pub const LOBED: u32 = 3;
/// The major version of files in which weights of nodes may be negative, whose nodes readers of `MAJOR` would refuse: all else
/// in them is as there.
pub const SIGNED: u32 = 4;
/// The key of a manifest's own digest.
const SEAL: &[u8] = b"\"digest\"";
/// The file that is written last and read first.
pub const MANIFEST: &str = "manifest.json";
/// The file of what each row is.
pub const RECEIVERS: &str = "receivers.safetensors";
/// The file of the link's numbers, where it has any.
pub const LINK: &str = "link.safetensors";
/// The file of untruncated sample groups, where there are any.
pub const AUDIT: &str = "audit.safetensors";
/// Tiles in a shard file; the last file may hold fewer.
pub const TILES_PER_SHARD: usize = 4;
/// A manifest of a sane transport is some kilobytes.
pub(super) const MAX_MANIFEST: u64 = 16 << 20;
/// Rows times columns that 64-bit sizes hold with room to spare.
const MAX_CELLS: u64 = 1 << 48;
/// Pixels of an image: 16,384 squared.
const MAX_PIXELS: u64 = 1 << 28;
/// Parts of one transport: a basis of a family of BRDFs has a few tens.
const MAX_PARTS: usize = 256;
/// The longest name of a part.
const MAX_NAME: usize = 32;

/// One file of the directory.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileEntry {
    /// Its name in the directory, without a path.
    pub name: String,
    /// Its size.
    pub bytes: u64,
    /// XXH3, 64 bits, of the whole file, as 16 hexadecimal digits.
    pub xxh3: String,
}

/// One matrix of a transport.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PartEntry {
    /// Of lower-case letters, digits and underscores; empty for the one part of a file of version 1.
    pub name: String,
    /// As `ColumnSpace` writes it: `haar:64`.
    pub columns: String,
    /// Of the matrix: receivers, or what its place in the chain makes of them (nodes, samples, representatives).
    pub rows: usize,
    /// Numbers for each row and column: 1 or 3.
    pub channels: usize,
    /// The exponent of two that all values are multiples of.
    pub quantum: i32,
    /// `i8` or `i16`.
    pub width: String,
    /// Rows of every tile but the last: a multiple of 16, at most 16,384.
    pub tile_rows: usize,
}

/// How parts make up the product, by their names.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChainEntry {
    /// Parts that V is multiplied by.
    pub first: Vec<String>,
    /// `none`, `weights`, `tree` or `representatives`.
    pub link: String,
    /// The exponent of the weights, where those are the link.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exponent: Option<i32>,
    /// Parts of the second stage; empty where the link leads to none.
    #[serde(default)]
    pub then: Vec<String>,
}

/// What the rows are.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ReceiversEntry {
    /// `pixels`, `vertices` or `gather`.
    pub kind: String,
    /// The image that pixels resolve into: [height, width].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image: Option<[usize; 2]>,
    /// Opaque here: an object that Python writes and reads.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Box<RawValue>>,
}

/// What a camera says of its picture.
#[derive(Deserialize)]
struct Size {
    width: usize,
    height: usize,
}

/// All that a transport says of itself. Keys that are unknown here are ignored.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Manifest {
    /// `FORMAT`.
    pub format: String,
    /// [major, minor]
    pub version: [u32; 2],
    /// All matrices, in the order of the chain.
    pub parts: Vec<PartEntry>,
    /// How they make up the product.
    pub chain: ChainEntry,
    /// `TILES_PER_SHARD`.
    pub tiles_per_shard: usize,
    /// What the rows of the last stage stand for.
    pub receivers: ReceiversEntry,
    /// Opaque here, as the camera.
    pub plan: Box<RawValue>,
    /// Identifies the scene that M was computed from.
    pub scene: String,
    /// All files that the product needs: shards part by part, receivers, link, audit.
    pub files: Vec<FileEntry>,
    /// Files that it does not need, since 2.1: the scene and its nodes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub beside: Vec<FileEntry>,
}

/// What a newcomer sees first in a manifest of whatever version.
#[derive(Deserialize)]
pub(super) struct Preamble {
    /// `FORMAT`, or it is no manifest of ours.
    pub format: String,
    /// [major, minor]; the major one says how to read on.
    pub version: [u32; 2],
}

/// An expectation on hostile numbers.
fn expect(holds: bool, what: impl FnOnce() -> String) -> Result<()> {
    if holds { Ok(()) } else { Err(Error::input(what())) }
}

impl PartEntry {
    /// The columns; refuses a text that names none.
    pub fn space(&self) -> Result<ColumnSpace> {
        self.columns.parse()
    }

    /// The channels; refuses counts other than 1 and 3.
    pub fn channels(&self) -> Result<Channels> {
        Channels::from_count(self.channels)
    }

    /// The width of the stored integers; refuses other words than `i8` and `i16`.
    pub fn width(&self) -> Result<Width> {
        self.width.parse()
    }

    /// The number of tiles.
    pub fn tiles(&self) -> usize {
        self.rows.div_ceil(self.tile_rows)
    }

    /// The number of files that hold them.
    pub fn shards(&self) -> usize {
        self.tiles().div_ceil(TILES_PER_SHARD)
    }

    /// The tiles of a shard.
    pub fn tiles_of(&self, shard: usize) -> Range<usize> {
        shard * TILES_PER_SHARD..self.tiles().min((shard + 1) * TILES_PER_SHARD)
    }

    /// Rows of a tile: all tiles but the last are full.
    pub fn rows_of(&self, tile: usize) -> usize {
        self.tile_rows.min(self.rows - tile * self.tile_rows)
    }

    /// Whether the numbers make sense together.
    pub fn check(&self) -> Result<()> {
        let columns = self.space()?.columns();
        self.channels()?;
        let cells = (self.rows as u64).checked_mul(3 * columns as u64);
        expect(
            self.rows > 0 && self.rows <= u32::MAX as usize && cells.is_some_and(|cells| cells <= MAX_CELLS),
            || format!("expected at least one row and at most 2^48 entries, found {} rows", self.rows),
        )?;
        expect(self.tile_rows > 0 && self.tile_rows <= MAX_TILE_ROWS && self.tile_rows.is_multiple_of(GROUP), || {
            format!("expected tiles of 16 to {MAX_TILE_ROWS} rows, a multiple of 16, found {}", self.tile_rows)
        })?;
        check_quantum(self.quantum, self.width()?)
    }
}

/// The minor version from which on a manifest of a major one ends in its own digest.
pub const fn sealed_from(major: u32) -> u32 {
    match major {
        FIRST => u32::MAX,
        MAJOR => 2,
        _ => 1,
    }
}

/// The minor version of what is written, from which on files of tiles say what unit their values are in.
pub const fn written(major: u32) -> u32 {
    sealed_from(major) + 1
}

/// The last key of a manifest: XXH3 of all that stands before it.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Seal {
    digest: String,
}

/// The text of a manifest with its digest.
pub fn sealed(manifest: &Manifest) -> Result<Vec<u8>> {
    let mut text = serde_json::to_vec_pretty(manifest).map_err(|error| Error::input(error.to_string()))?;
    let end = text.iter().rposition(|&byte| byte == b'}').map_or(0, |at| text[..at].trim_ascii_end().len());
    text.truncate(end);
    text.extend_from_slice(b",\n  ");
    let digest = format!("{:016x}", xxh3_64(&text));
    text.extend_from_slice(format!("\"digest\": \"{digest}\"\n}}").as_bytes());
    Ok(text)
}

/// Refuses a manifest that is not what was written, or has lost its digest.
pub(super) fn check_seal(text: &[u8], version: [u32; 2]) -> std::result::Result<(), String> {
    let at = text.windows(SEAL.len()).rposition(|window| window == SEAL);
    // In files before the digest another object may have a key of this name.
    let seal = at.and_then(|at| Some((at, serde_json::from_slice::<Seal>(&[b"{", &text[at..]].concat()).ok()?)));
    match seal {
        Some((at, seal)) => {
            let found = format!("{:016x}", xxh3_64(&text[..at]));
            if found == seal.digest {
                Ok(())
            } else {
                Err(format!("altered or damaged: digest {found}, expected {}", seal.digest))
            }
        }
        None if version[1] < sealed_from(version[0]) => Ok(()),
        None => Err("altered or damaged: expected the manifest's digest as its last key".to_owned()),
    }
}

/// Whether a part may be called so.
pub fn is_part_name(name: &str) -> bool {
    let letter = |c: u8| c.is_ascii_lowercase() || c.is_ascii_digit() || c == b'_';
    !name.is_empty() && name.len() <= MAX_NAME && name.bytes().all(letter)
}

impl Manifest {
    /// Whether a directory has a manifest of this format, of whatever version.
    pub fn is_transport(directory: &Path) -> bool {
        read_small(&directory.join(MANIFEST), MAX_MANIFEST)
            .is_ok_and(|text| serde_json::from_slice::<Preamble>(&text).is_ok_and(|seen| seen.format == FORMAT))
    }

    /// Whether the numbers make sense together and the files are exactly those that they call for.
    pub fn check(&self) -> Result<()> {
        let count = self.parts.len();
        expect((1..=MAX_PARTS).contains(&count), || format!("expected 1 to {MAX_PARTS} parts, found {count}"))?;
        for part in &self.parts {
            part.check()?;
            // The names of version 1's files hold no part.
            let named = is_part_name(&part.name) || self.version[0] == FIRST;
            expect(named, || {
                format!("expected a part's name of up to {MAX_NAME} of a-z, 0-9 and _, found {:?}", part.name)
            })?;
        }
        let mut names: Vec<&str> = self.parts.iter().map(|part| part.name.as_str()).collect();
        names.sort_unstable();
        if let Some(twice) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(Error::input(format!("expected parts of different names, found {:?} twice", twice[0])));
        }
        expect(self.tiles_per_shard == TILES_PER_SHARD, || {
            format!("expected {TILES_PER_SHARD} tiles a file, found {}", self.tiles_per_shard)
        })?;
        self.check_chain()?;
        self.check_receivers()?;
        self.check_names()
    }

    /// Each part has its place in the chain, and parts come in its order.
    fn check_chain(&self) -> Result<()> {
        let ChainEntry { first, link, then, .. } = &self.chain;
        let two = match link.as_str() {
            "none" | "weights" => false,
            "tree" | "representatives" => true,
            other => {
                let links = "\"none\", \"weights\", \"tree\" or \"representatives\"";
                return Err(Error::input(format!("expected a link {links}, found {other:?}")));
            }
        };
        expect(!first.is_empty() && then.is_empty() != two, || {
            format!("expected parts for each stage of a chain by {link:?}, found {first:?} and {then:?}")
        })?;
        let named: Vec<&String> = first.iter().chain(then).collect();
        let parts: Vec<&String> = self.parts.iter().map(|part| &part.name).collect();
        expect(named == parts, || format!("expected the chain to name the parts {parts:?} in order, found {named:?}"))
    }

    fn check_receivers(&self) -> Result<()> {
        let ReceiversEntry { kind, image, camera } = &self.receivers;
        if let (Some(image), Some(camera)) = (image, camera)
            && let Ok(Size { width, height }) = serde_json::from_str(camera.get())
        {
            expect(*image == [height, width], || {
                format!(
                    "expected an image of the camera's {width} x {height} pixels, found {} x {}",
                    image[1], image[0]
                )
            })?;
        }
        match (kind.as_str(), image) {
            ("pixels", Some([height, width])) => {
                let pixels = (*height as u64).checked_mul(*width as u64);
                expect(pixels.is_some_and(|pixels| pixels <= MAX_PIXELS), || {
                    format!("expected an image of at most 2^28 pixels, found {width} x {height}")
                })
            }
            ("vertices" | "gather", None) => Ok(()),
            _ => Err(Error::input(format!(
                "expected receivers of the kind \"pixels\" with an image, \"vertices\" or \"gather\", found {kind:?} \
                 with the image {image:?}"
            ))),
        }
    }

    /// The list names each shard of each part once, in order, then the receivers, then what the link needs, then perhaps
    /// the audit: no path can hide in it.
    fn check_names(&self) -> Result<()> {
        // Counted before any name is made: a manifest may claim billions of rows.
        let shards: usize = self.parts.iter().map(PartEntry::shards).sum();
        let (needed, found) = (shards + 1 + usize::from(self.has_link_file()), self.files.len());
        expect(found == needed || found == needed + 1, || {
            format!("expected {needed} files of tiles and receivers and perhaps an audit, found {found} files")
        })?;
        let shards = self.parts.iter().flat_map(|part| (0..part.shards()).map(|shard| shard_name(&part.name, shard)));
        let link = self.has_link_file().then(|| LINK.to_owned());
        let names = shards.chain([RECEIVERS.to_owned()]).chain(link).chain([AUDIT.to_owned()]);
        for (entry, name) in self.files.iter().zip(names) {
            if entry.name != name {
                return Err(Error::input(format!("expected the file {name:?} in the list, found {:?}", entry.name)));
            }
        }
        Ok(())
    }

    /// Whether the files of tiles say what unit their values are in.
    pub fn says_unit(&self) -> bool {
        self.version[0] != FIRST && self.version[1] >= written(self.version[0])
    }

    /// Whether texel columns are made of lobes.
    pub fn has_lobes(&self) -> bool {
        self.version[0] == LOBED
    }

    /// Whether the chain's link has numbers of its own.
    pub fn has_link_file(&self) -> bool {
        self.chain.link != "none"
    }

    /// The files of a part, and of the receivers, the link and the audit.
    pub fn files_by_kind(&self) -> (Vec<&[FileEntry]>, &[FileEntry]) {
        let mut rest = &self.files[..];
        let mut of_parts = Vec::new();
        for part in &self.parts {
            let (own, others) = rest.split_at(part.shards());
            of_parts.push(own);
            rest = others;
        }
        (of_parts, rest)
    }

    /// The part whose rows are the receivers.
    pub fn receiving(&self) -> &PartEntry {
        let two = !self.chain.then.is_empty();
        &self.parts[if two { self.chain.first.len() } else { 0 }]
    }
}

/// The file of a shard of a part; files of version 1 name no part.
pub fn shard_name(part: &str, shard: usize) -> String {
    if part.is_empty() {
        format!("tiles-{shard:05}.safetensors")
    } else {
        format!("tiles-{part}-{shard:05}.safetensors")
    }
}

/// Reads a plain file that must not be larger than `limit`, whatever it claims: a pipe would be waited for.
pub fn read_small(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let seen = std::fs::metadata(path).map_err(|source| Error::os(path, source))?;
    if !seen.is_file() {
        return Err(Error::file(path, "expected a plain file, found a directory, a pipe or a device"));
    }
    let file = std::fs::File::open(path).map_err(|source| Error::os(path, source))?;
    let mut bytes = Vec::new();
    file.take(limit + 1).read_to_end(&mut bytes).map_err(|source| Error::os(path, source))?;
    if bytes.len() as u64 > limit {
        return Err(Error::file(path, format!("expected at most {limit} bytes, found more")));
    }
    Ok(bytes)
}
