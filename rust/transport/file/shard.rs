//! One safetensors file: written beside and renamed, opened by memory map or copied, with every range checked.

use std::collections::HashMap;
use std::fs::{self, File};
use std::io::{BufWriter, Read, Write};
use std::path::Path;
use std::sync::Arc;

use memmap2::{Mmap, MmapMut};
use safetensors::tensor::{Metadata, TensorInfo};
use safetensors::{Dtype, SafeTensors};
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use crate::error::{Error, Result};

use super::manifest::FileEntry;
use crate::transport::entry::Width;
use crate::transport::slab::Slab;

#[cfg(not(target_endian = "little"))]
compile_error!("transport files are little-endian and are used as they lie in memory");

/// The longest header accepted: a shard of four tiles has two kilobytes.
const MAX_HEADER: u64 = 1 << 20;

/// A number type of the format.
pub trait Element: bytemuck::Pod + Send + Sync {
    /// Its word in the header of a file.
    const DTYPE: Dtype;
}

impl Element for u32 {
    const DTYPE: Dtype = Dtype::U32;
}
impl Element for f64 {
    const DTYPE: Dtype = Dtype::F64;
}
impl Element for u8 {
    const DTYPE: Dtype = Dtype::U8;
}
impl Element for f32 {
    const DTYPE: Dtype = Dtype::F32;
}
impl Element for u16 {
    const DTYPE: Dtype = Dtype::U16;
}
impl Element for i16 {
    const DTYPE: Dtype = Dtype::I16;
}
impl Element for i8 {
    const DTYPE: Dtype = Dtype::I8;
}

/// A named array to be written.
pub struct Tensor<'a> {
    /// The key of the array in its file.
    pub name: String,
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: &'a [u8],
}

impl<'a> Tensor<'a> {
    /// `items` in an array of this shape, row-major.
    pub fn new<T: Element>(name: impl Into<String>, shape: &[usize], items: &'a [T]) -> Self {
        debug_assert_eq!(shape.iter().product::<usize>(), items.len());
        Tensor { name: name.into(), dtype: T::DTYPE, shape: shape.to_vec(), bytes: bytemuck::cast_slice(items) }
    }
}

/// The key in the header of a file of tiles that says what its values are multiples of.
const UNIT: &str = "unit";

/// What integers of a width are multiples of, but for shifts: `i8 x 2^-24`.
pub fn unit_of(width: Width, quantum: i32) -> String {
    format!("{} x 2^{quantum}", width.name())
}

/// Writes arrays as `directory/name`: beside it first, synced, then renamed, so that the name only ever means a whole
/// file.
pub fn write_tensors(directory: &Path, name: &str, tensors: Vec<Tensor>) -> Result<FileEntry> {
    write_arrays(directory, name, None, tensors)
}

/// The same of tiles, with what their values are multiples of.
pub fn write_in_unit(directory: &Path, name: &str, unit: String, tensors: Vec<Tensor>) -> Result<FileEntry> {
    write_arrays(directory, name, Some(HashMap::from([(UNIT.to_owned(), unit)])), tensors)
}

fn write_arrays(
    directory: &Path,
    name: &str,
    about: Option<HashMap<String, String>>,
    mut tensors: Vec<Tensor>,
) -> Result<FileEntry> {
    // Widest numbers first: each array then starts at a multiple of its own size.
    tensors.sort_by_key(|tensor| std::cmp::Reverse(tensor.dtype.bitsize()));
    let mut end = 0;
    let infos = tensors.iter().map(|tensor| {
        let start = end;
        end += tensor.bytes.len();
        let info = TensorInfo { dtype: tensor.dtype, shape: tensor.shape.clone(), data_offsets: (start, end) };
        (tensor.name.clone(), info)
    });
    let header = Metadata::new(about, infos.collect())
        .map_err(|error| error.to_string())
        .and_then(|metadata| serde_json::to_string(&metadata).map_err(|error| error.to_string()))
        .map_err(|what| Error::file(&directory.join(name), what))?;
    let mut header = header.into_bytes();
    header.resize(header.len().next_multiple_of(8), b' ');

    let length = (header.len() as u64).to_le_bytes();
    let parts = [&length[..], &header[..]].into_iter().chain(tensors.iter().map(|tensor| tensor.bytes));
    write_file(directory, name, parts)
}

/// Writes a file in parts: beside, sync, rename, sync of the directory. What fails leaves nothing behind.
pub fn write_file<'a>(directory: &Path, name: &str, parts: impl Iterator<Item = &'a [u8]>) -> Result<FileEntry> {
    let target = directory.join(name);
    let beside = directory.join(format!(".tmp-{}-{name}", std::process::id()));
    let written = write_parts(&beside, parts).and_then(|summary| {
        fs::rename(&beside, &target)?;
        sync_directory(directory)?;
        Ok(summary)
    });
    match written {
        Ok((bytes, hash)) => Ok(FileEntry { name: name.to_owned(), bytes, xxh3: format!("{hash:016x}") }),
        Err(source) => {
            // The first error is the one to tell; the file beside may not even exist.
            let _ = fs::remove_file(&beside);
            Err(Error::os(&target, source))
        }
    }
}

fn write_parts<'a>(path: &Path, parts: impl Iterator<Item = &'a [u8]>) -> std::io::Result<(u64, u64)> {
    let mut file = BufWriter::with_capacity(1 << 20, File::create(path)?);
    let mut hash = Xxh3::new();
    let mut bytes = 0;
    for part in parts {
        file.write_all(part)?;
        hash.update(part);
        bytes += part.len() as u64;
    }
    let file = file.into_inner().map_err(std::io::IntoInnerError::into_error)?;
    file.sync_all()?;
    Ok((bytes, hash.digest()))
}

/// Makes renames in a directory survive a power failure. Where directories cannot be opened (Windows) they need no
/// sync.
pub fn sync_directory(directory: &Path) -> std::io::Result<()> {
    if cfg!(unix) { File::open(directory)?.sync_all() } else { Ok(()) }
}

/// Transports of at most so many bytes are read into memory, which costs time and memory of its own: whoever writes into their
/// files later changes nothing. (Measured: 401 MB in 0.36 s of a processor, mapped in 0.10; 1 GiB on a loaded machine in 1.2 and
/// 0.04; checksums included.)
const READ_MOST: u64 = 512 << 20;

/// Larger ones too, where they take no more than this part of the memory that is free: as many processes may open one at once.
const PART_OF_FREE: u64 = 16;

/// Bytes of memory that are free, or hold what can be read again; None where the system does not say.
fn free_memory() -> Option<u64> {
    let text = |path| fs::read_to_string(path).ok();
    let line = text("/proc/meminfo")?
        .lines()
        .find_map(|line| line.strip_prefix("MemAvailable:")?.strip_suffix("kB")?.trim().parse::<u64>().ok())?;
    // A container may hold less than its machine.
    let number = |path| text(path)?.trim().parse::<u64>().ok();
    let own = number("/sys/fs/cgroup/memory.max").zip(number("/sys/fs/cgroup/memory.current"));
    Some(own.map_or(u64::MAX, |(most, taken)| most.saturating_sub(taken)).min(line << 10))
}

/// Where the files of a transport lie, and how they come into memory.
#[derive(Clone, Copy)]
pub struct Directory<'a> {
    path: &'a Path,
    mapped: bool,
}

impl<'a> Directory<'a> {
    /// Of all these files.
    pub fn new<'b>(path: &'a Path, entries: impl IntoIterator<Item = &'b FileEntry>) -> Self {
        let bytes = entries.into_iter().fold(0u64, |sum, entry| sum.saturating_add(entry.bytes));
        let read = bytes <= READ_MOST || free_memory().is_some_and(|free| bytes <= free / PART_OF_FREE);
        Directory { path, mapped: !read }
    }
}

/// A verified safetensors file, read or mapped.
pub struct Shard {
    map: Arc<Mmap>,
    metadata: Metadata,
    /// Where the arrays begin.
    data: usize,
    path: std::path::PathBuf,
}

impl Shard {
    /// Opens a file and checks, in this order: that it is a plain file of the stated size, its checksum, its header.
    pub fn open(directory: Directory, entry: &FileEntry) -> Result<Shard> {
        let path = directory.path.join(&entry.name);
        let map = if directory.mapped { map_file(&path, entry)? } else { read_file(&path, entry)? };
        let found = format!("{:016x}", xxh3_64(&map));
        if found != entry.xxh3 {
            return Err(Error::file(&path, format!("altered or damaged: checksum {found}, expected {}", entry.xxh3)));
        }
        let header = map.first_chunk().map_or(u64::MAX, |length| u64::from_le_bytes(*length));
        if header > MAX_HEADER {
            return Err(Error::file(&path, format!("expected a header of at most {MAX_HEADER} bytes, found {header}")));
        }
        let damaged = |error: safetensors::SafeTensorError| Error::file(&path, format!("not a tile file: {error}"));
        let (length, metadata) = SafeTensors::read_metadata(&map).map_err(damaged)?;
        Ok(Shard { map: Arc::new(map), metadata, data: 8 + length, path })
    }

    /// An array by name; it must have exactly this type and shape.
    pub fn slab<T: Element>(&self, name: &str, shape: &[usize]) -> Result<Slab<T>> {
        let info = self.info(name)?;
        if info.dtype != T::DTYPE || info.shape != shape {
            return Err(self.error(format!(
                "expected {name:?} to be {:?} of shape {shape:?}, found {:?} of shape {:?}",
                T::DTYPE,
                info.dtype,
                info.shape
            )));
        }
        let start = self.data + info.data_offsets.0;
        let bytes = &self.map[start..self.data + info.data_offsets.1];
        let items = bytemuck::try_cast_slice::<u8, T>(bytes)
            .map_err(|_| self.error(format!("expected {name:?} to start at a multiple of its item size")))?;
        Ok(Slab::Mapped { map: self.map.clone(), start, len: items.len() })
    }

    /// How many items an array of one dimension has: known before anything is read or allocated.
    pub fn len(&self, name: &str) -> Result<usize> {
        match self.info(name)?.shape[..] {
            [len] => Ok(len),
            ref shape => Err(self.error(format!("expected {name:?} to have one dimension, found shape {shape:?}"))),
        }
    }

    /// Whether there is an array of this name.
    pub fn has(&self, name: &str) -> bool {
        self.metadata.info(name).is_some()
    }

    /// Name, type and shape of every array, by name.
    pub fn arrays(&self) -> Vec<(String, Dtype, Vec<usize>)> {
        let all = self.metadata.tensors();
        let mut all: Vec<_> = all.into_iter().map(|(name, info)| (name, info.dtype, info.shape.clone())).collect();
        all.sort_by(|a, b| a.0.cmp(&b.0));
        all
    }

    /// Refuses a file with arrays that nothing asks for.
    pub fn expect_count(&self, count: usize) -> Result<()> {
        let found = self.metadata.tensors().len();
        if found == count { Ok(()) } else { Err(self.error(format!("expected {count} arrays, found {found}"))) }
    }

    /// Refuses values in another unit than the manifest says; `said`: whether the file must say its own.
    pub fn expect_unit(&self, expected: &str, said: bool) -> Result<()> {
        match self.metadata.metadata().as_ref().and_then(|about| about.get(UNIT)) {
            Some(found) if found == expected => Ok(()),
            None if !said => Ok(()),
            found => Err(self.error(format!("expected values in the unit {expected:?}, found {found:?}"))),
        }
    }

    /// An error about this file.
    pub fn error(&self, what: impl Into<String>) -> Error {
        Error::file(&self.path, what)
    }

    fn info(&self, name: &str) -> Result<&TensorInfo> {
        self.metadata.info(name).ok_or_else(|| self.error(format!("the array {name:?} is missing")))
    }
}

/// Opens a file that must be a plain one of the stated size: no link leads out of the directory.
fn open_file(path: &Path, entry: &FileEntry) -> Result<File> {
    let seen = fs::symlink_metadata(path).map_err(|source| match source.kind() {
        std::io::ErrorKind::NotFound => Error::file(path, "the manifest names this file, but it is missing"),
        _ => Error::os(path, source),
    })?;
    if !seen.is_file() {
        return Err(Error::file(path, "expected a plain file, found a link, a directory or a device"));
    }
    let file = File::open(path).map_err(|source| Error::os(path, source))?;
    let bytes = file.metadata().map_err(|source| Error::os(path, source))?.len();
    if bytes != entry.bytes {
        return Err(Error::file(path, format!("expected {} bytes, found {bytes}: truncated or altered", entry.bytes)));
    }
    Ok(file)
}

/// A copy of a file.
fn read_file(path: &Path, entry: &FileEntry) -> Result<Mmap> {
    let mut file = open_file(path, entry)?;
    let mut read = || {
        let mut copy = MmapMut::map_anon(entry.bytes as usize)?;
        file.read_exact(&mut copy)?;
        copy.make_read_only()
    };
    read().map_err(|source| Error::os(path, source))
}

fn map_file(path: &Path, entry: &FileEntry) -> Result<Mmap> {
    let file = open_file(path, entry)?;
    // SAFETY: a map is sound while nobody changes the file; files of a transport are replaced by rename, never
    // rewritten.
    unsafe { Mmap::map(&file) }.map_err(|source| Error::os(path, source))
}

/// Whether a file is there, whole and as its entry says.
pub fn is_intact(directory: &Path, entry: &FileEntry) -> bool {
    map_file(&directory.join(&entry.name), entry).is_ok_and(|map| format!("{:016x}", xxh3_64(&map)) == entry.xxh3)
}
