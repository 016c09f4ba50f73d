//! Reading a manifest of any version.

use std::path::Path;

use serde::Deserialize;
use serde_json::value::RawValue;

use crate::error::{Error, Result};

use super::manifest::{
    ChainEntry, FIRST, FORMAT, FileEntry, LOBED, MAJOR, MANIFEST, MAX_MANIFEST, Manifest, PartEntry, Preamble,
    ReceiversEntry, SIGNED, check_seal, read_small,
};

/// Reads `manifest.json` of a directory and checks all that can be checked without the other files.
pub fn read_manifest(directory: &Path) -> Result<Manifest> {
    let path = directory.join(MANIFEST);
    let text = read_small(&path, MAX_MANIFEST)?;
    let preamble: Preamble = serde_json::from_slice(&text)
        .map_err(|error| Error::file(&path, format!("not the manifest of a transport: {error}")))?;
    if preamble.format != FORMAT {
        let found = preamble.format;
        return Err(Error::file(&path, format!("expected the format {FORMAT:?}, found {found:?}")));
    }
    check_seal(&text, preamble.version).map_err(|what| Error::file(&path, what))?;
    let manifest = match preamble.version[0] {
        MAJOR | LOBED | SIGNED => serde_json::from_slice(&text),
        FIRST => serde_json::from_slice::<Version1>(&text).map(Manifest::from),
        found => {
            let what = format!("expected version {FIRST} to {SIGNED} of the format, found version {found}");
            return Err(Error::file(&path, what));
        }
    };
    let manifest = manifest.map_err(|error| Error::file(&path, format!("the manifest is damaged: {error}")))?;
    manifest.check().map_err(|error| Error::file(&path, error.to_string()))?;
    Ok(manifest)
}

/// What a manifest of version 1 says: one matrix of pixels, which is one part without a name.
#[derive(Deserialize)]
struct Version1 {
    format: String,
    version: [u32; 2],
    columns: String,
    rows: usize,
    channels: usize,
    quantum: i32,
    width: String,
    tile_rows: usize,
    tiles_per_shard: usize,
    image: [usize; 2],
    camera: Box<RawValue>,
    plan: Box<RawValue>,
    scene: String,
    files: Vec<FileEntry>,
}

impl From<Version1> for Manifest {
    fn from(old: Version1) -> Self {
        let Version1 { format, version, columns, rows, channels, quantum, width, tile_rows, .. } = old;
        let name = String::new();
        Manifest {
            format,
            version,
            chain: ChainEntry { first: vec![name.clone()], link: "none".to_owned(), exponent: None, then: Vec::new() },
            parts: vec![PartEntry { name, columns, rows, channels, quantum, width, tile_rows }],
            tiles_per_shard: old.tiles_per_shard,
            receivers: ReceiversEntry { kind: "pixels".to_owned(), image: Some(old.image), camera: Some(old.camera) },
            plan: old.plan,
            scene: old.scene,
            files: old.files,
            beside: Vec::new(),
        }
    }
}
