//! The manifest of a transport directory: written last, read first (`FORMAT.md`).

use std::io::Read;
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;

use crate::basis::ColumnSpace;
use crate::error::{Error, Result};

use crate::transport::entry::{GROUP, MAX_TILE_ROWS, Width, check_quantum};

pub const FORMAT: &str = "deltalux.transport";
/// The major version is refused where it is unknown; a minor one only adds keys or files that older readers may ignore.
pub const MAJOR: u32 = 1;
pub const MINOR: u32 = 0;
pub const MANIFEST: &str = "manifest.json";
pub const RECEIVERS: &str = "receivers.safetensors";
pub const AUDIT: &str = "audit.safetensors";
/// Tiles in a shard file; the last file may hold fewer.
pub const TILES_PER_SHARD: usize = 4;
/// A manifest of a sane transport is some kilobytes.
const MAX_MANIFEST: u64 = 16 << 20;
/// Rows times columns that 64-bit sizes hold with room to spare.
const MAX_CELLS: u64 = 1 << 48;
/// Pixels of an image: 16,384 squared.
const MAX_PIXELS: u64 = 1 << 28;

/// One file of the directory.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileEntry {
    pub name: String,
    pub bytes: u64,
    /// XXH3, 64 bits, of the whole file, as 16 hexadecimal digits.
    pub xxh3: String,
}

/// All that a transport says of itself. Keys that are unknown here are ignored.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Manifest {
    pub format: String,
    /// [major, minor]
    pub version: [u32; 2],
    /// As `ColumnSpace` writes it: `haar:64`.
    pub columns: String,
    pub rows: usize,
    pub channels: usize,
    pub quantum: i32,
    /// `i8` or `i16`.
    pub width: String,
    pub tile_rows: usize,
    pub tiles_per_shard: usize,
    /// The image that the receivers resolve into: [height, width].
    pub image: [usize; 2],
    /// Opaque here: objects that Python writes and reads.
    pub camera: Box<RawValue>,
    pub plan: Box<RawValue>,
    /// Identifies the scene that M was computed from.
    pub scene: String,
    pub files: Vec<FileEntry>,
}

/// What a newcomer sees first in a manifest of whatever version.
#[derive(Deserialize)]
struct Preamble {
    format: String,
    version: [u32; 2],
}

impl Manifest {
    /// Whether a directory has a manifest of this format, of whatever version.
    pub fn is_transport(directory: &Path) -> bool {
        read_small(&directory.join(MANIFEST), MAX_MANIFEST)
            .is_ok_and(|text| serde_json::from_slice::<Preamble>(&text).is_ok_and(|seen| seen.format == FORMAT))
    }

    /// Reads `manifest.json` of a directory and checks all that can be checked without the other files.
    pub fn read(directory: &Path) -> Result<Manifest> {
        let path = directory.join(MANIFEST);
        let text = read_small(&path, MAX_MANIFEST)?;
        let preamble: Preamble = serde_json::from_slice(&text)
            .map_err(|error| Error::file(&path, format!("not the manifest of a transport: {error}")))?;
        if preamble.format != FORMAT {
            let found = preamble.format;
            return Err(Error::file(&path, format!("expected the format {FORMAT:?}, found {found:?}")));
        }
        if preamble.version[0] != MAJOR {
            let found = preamble.version[0];
            return Err(Error::file(&path, format!("expected version {MAJOR} of the format, found version {found}")));
        }
        let manifest: Manifest = serde_json::from_slice(&text)
            .map_err(|error| Error::file(&path, format!("the manifest is damaged: {error}")))?;
        manifest.check().map_err(|error| Error::file(&path, error.to_string()))?;
        Ok(manifest)
    }

    /// Whether the numbers make sense together and the files are exactly those that they call for.
    pub fn check(&self) -> Result<()> {
        let space = self.space()?;
        let [height, width] = self.image;
        let cells = (self.rows as u64).checked_mul(space.columns() as u64);
        let sane = [
            (self.channels == 1, format!("expected 1 channel, found {}", self.channels)),
            (
                self.rows > 0 && self.rows <= u32::MAX as usize && cells.is_some_and(|cells| cells <= MAX_CELLS),
                format!("expected at least one row and at most 2^48 entries, found {} rows", self.rows),
            ),
            (
                self.tile_rows > 0 && self.tile_rows <= MAX_TILE_ROWS && self.tile_rows.is_multiple_of(GROUP),
                format!("expected tiles of 16 to {MAX_TILE_ROWS} rows, a multiple of 16, found {}", self.tile_rows),
            ),
            (
                self.tiles_per_shard == TILES_PER_SHARD,
                format!("expected {TILES_PER_SHARD} tiles a file, found {}", self.tiles_per_shard),
            ),
            (
                (height as u64).checked_mul(width as u64).is_some_and(|pixels| pixels <= MAX_PIXELS),
                format!("expected an image of at most 2^28 pixels, found {width} x {height}"),
            ),
        ];
        if let Some((_, complaint)) = sane.into_iter().find(|(holds, _)| !holds) {
            return Err(Error::input(complaint));
        }
        check_quantum(self.quantum, self.width()?)?;
        self.check_names()
    }

    /// The list names each shard once, in order, then the receivers, then perhaps the audit: no path can hide in it.
    fn check_names(&self) -> Result<()> {
        let shards = self.shards();
        let expected = (0..shards).map(shard_name).chain([RECEIVERS.to_owned(), AUDIT.to_owned()]);
        for (entry, name) in self.files.iter().zip(expected) {
            if entry.name != name {
                return Err(Error::input(format!("expected the file {name:?} in the list, found {:?}", entry.name)));
            }
        }
        if self.files.len() != shards + 1 && self.files.len() != shards + 2 {
            let found = self.files.len();
            return Err(Error::input(format!("expected {shards} tile files and the receivers, found {found} files")));
        }
        Ok(())
    }

    pub fn space(&self) -> Result<ColumnSpace> {
        self.columns.parse()
    }

    pub fn width(&self) -> Result<Width> {
        match self.width.as_str() {
            "i8" => Ok(Width::I8),
            "i16" => Ok(Width::I16),
            other => Err(Error::input(format!("expected the width \"i8\" or \"i16\", found {other:?}"))),
        }
    }

    pub fn tiles(&self) -> usize {
        self.rows.div_ceil(self.tile_rows)
    }

    pub fn shards(&self) -> usize {
        self.tiles().div_ceil(TILES_PER_SHARD)
    }

    /// The tiles of a shard.
    pub fn tiles_of(&self, shard: usize) -> std::ops::Range<usize> {
        shard * TILES_PER_SHARD..self.tiles().min((shard + 1) * TILES_PER_SHARD)
    }

    /// Rows of a tile: all tiles but the last are full.
    pub fn rows_of(&self, tile: usize) -> usize {
        self.tile_rows.min(self.rows - tile * self.tile_rows)
    }
}

pub fn width_name(width: Width) -> &'static str {
    match width {
        Width::I8 => "i8",
        Width::I16 => "i16",
    }
}

pub fn shard_name(shard: usize) -> String {
    format!("tiles-{shard:05}.safetensors")
}

/// Reads a file that must not be larger than `limit`, whatever it claims.
pub fn read_small(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let file = std::fs::File::open(path).map_err(|source| Error::os(path, source))?;
    let mut bytes = Vec::new();
    file.take(limit + 1).read_to_end(&mut bytes).map_err(|source| Error::os(path, source))?;
    if bytes.len() as u64 > limit {
        return Err(Error::file(path, format!("expected at most {limit} bytes, found more")));
    }
    Ok(bytes)
}
