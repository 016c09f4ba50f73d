//! The transport file: what is written is what is read, and damage of every kind is refused.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use _core::basis::{ColumnSpace, HaarTree};
use _core::error::Error;
use _core::precompute::models;
use _core::transport::file::manifest::{FileEntry, MANIFEST, TILES_PER_SHARD, sealed};
use _core::transport::file::versions::read_manifest;
use _core::transport::weights::NEGATIVE;
use _core::transport::{
    Array, Audit, Beside, Channels, Dense, Description, Link, Numbers, Opened, Part, ReceiverKind, ReceiverTable, Slab,
    TransportMatrix, Values, Weights, Width, Writer, open,
};

use crate::suite::norms_of_both;
use crate::transport::{matrix, stored_norms};

/// A directory of its own, removed at the end.
struct Scratch(PathBuf);

impl Scratch {
    fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let path = std::env::temp_dir().join(format!("deltalux-{}-{number}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        Scratch(path)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

const ROWS: usize = 170;

/// 170 rows in tiles of 32: six tiles, two shards, the last group padded.
fn small(width: Width) -> TransportMatrix {
    matrix(ColumnSpace::haar(2).unwrap(), ROWS, Channels::One, 7, width)
}

const PART: &str = "direct";

fn part(name: &str, matrix: &TransportMatrix, width: Width) -> Part {
    let TransportMatrix { space, rows, channels, quantum, tile_rows, .. } = *matrix;
    Part { name: name.to_owned(), space, rows, channels, quantum, width, tile_rows }
}

fn about(matrix: &TransportMatrix, width: Width) -> Description {
    Description {
        parts: vec![part(PART, matrix, width)],
        first: 1,
        link: Link::None,
        camera: Some(r#"{"fov": 40.1}"#.to_owned()),
        plan: "{}".to_owned(),
        scene: "0123".to_owned(),
        beside: vec![Beside {
            file: "scene.safetensors",
            arrays: vec![
                Array {
                    name: "places".to_owned(),
                    shape: vec![2, 3],
                    numbers: Numbers::F64((0..6).map(f64::from).collect::<Vec<_>>().into()),
                },
                Array { name: "which".to_owned(), shape: vec![2], numbers: Numbers::U32(vec![7u32, 9].into()) },
            ],
        }],
    }
}

fn receivers(rows: usize) -> ReceiverTable {
    let floats = |count: usize| -> Vec<f32> { (0..count).map(|k| k as f32 / 7.0).collect() };
    ReceiverTable {
        albedo: floats(3 * rows).into(),
        position: floats(3 * rows).into(),
        normal: floats(3 * rows).into(),
        material: Some((0..rows as u16).collect::<Vec<_>>().into()),
        lobes: None,
        kind: ReceiverKind::Pixels {
            image: [10, 20],
            pixel: (0..rows as u32).collect::<Vec<_>>().into(),
            weight: floats(rows).into(),
            background: floats(200).into(),
        },
    }
}

fn write_tiles(writer: &mut Writer, name: &str, matrix: &TransportMatrix) {
    for (shard, tiles) in matrix.tiles.chunks(TILES_PER_SHARD).enumerate() {
        writer.write_shard(name, shard, tiles).unwrap();
    }
}

fn write(path: &Path, matrix: &TransportMatrix, width: Width) {
    let mut writer = Writer::open(path, "{}").unwrap();
    write_tiles(&mut writer, PART, matrix);
    let audit = Audit { groups: vec![0u32, 5].into(), tile: small(Width::I16).tiles[0].clone() };
    writer.finish(&about(matrix, width), &receivers(matrix.rows), Some(&audit)).unwrap();
}

fn contents(directory: &Path) -> Vec<(String, Vec<u8>)> {
    let mut all: Vec<_> = fs::read_dir(directory)
        .unwrap()
        .map(|entry| entry.unwrap())
        .map(|entry| (entry.file_name().into_string().unwrap(), fs::read(entry.path()).unwrap()))
        .collect();
    all.sort();
    all
}

fn refused(path: &Path) -> String {
    match open(path, &models) {
        Err(error @ (Error::File { .. } | Error::Os { .. })) => error.to_string(),
        Err(error) => panic!("not a file error: {error}"),
        Ok(_) => panic!("a damaged transport was opened"),
    }
}

#[test]
fn what_is_written_is_what_is_read() {
    for width in [Width::I8, Width::I16] {
        let scratch = Scratch::new();
        let (path, matrix) = (scratch.path("a.transport"), small(width));
        write(&path, &matrix, width);
        let Opened { product, receivers: table, audit, manifest, beside } = open(&path, &models).unwrap();
        let read = product.alone().unwrap();
        assert_eq!(Dense::of(read), Dense::of(&matrix));
        assert_eq!(read.to_csr(0), matrix.to_csr(0));
        assert_eq!(stored_norms(read, |tile| &tile.dropped), stored_norms(&matrix, |tile| &tile.dropped));
        assert_eq!(matches!(read.tiles[0].values, Values::I8(_)), width == Width::I8);
        assert_eq!(&table.albedo[..], &receivers(ROWS).albedo[..]);
        assert_eq!(table.material.unwrap()[3], 3);
        assert_eq!(manifest.receivers.camera.unwrap().get(), r#"{"fov": 40.1}"#);
        assert_eq!(&audit.unwrap().groups[..], &[0, 5]);
        let [scene] = &beside[..] else { panic!("{} files beside", beside.len()) };
        let [places, which] = &scene.arrays[..] else { panic!("{} arrays", scene.arrays.len()) };
        assert_eq!((&places.name[..], &which.name[..], &places.shape[..]), ("places", "which", &[2, 3][..]));
        assert!(matches!(&which.numbers, Numbers::U32(items) if items[..] == [7, 9]));
        assert!(matches!(&places.numbers, Numbers::F64(items) if items[5] == 5.0));
        let names: Vec<String> = contents(&path).into_iter().map(|(name, _)| name).collect();
        let expected = ["audit", "manifest", "receivers", "scene", "tiles-direct-00000", "tiles-direct-00001"];
        assert_eq!(names.len(), expected.len());
        assert!(names.iter().zip(expected).all(|(name, start)| name.starts_with(start)), "{names:?}");
        assert_eq!(fs::read_dir(&scratch.0).unwrap().count(), 1);
    }
}

#[test]
fn a_resumed_run_gives_the_same_bits() {
    let (scratch, matrix) = (Scratch::new(), small(Width::I8));
    let (whole, resumed) = (scratch.path("whole.transport"), scratch.path("resumed.transport"));
    write(&whole, &matrix, Width::I8);

    // The first run dies after a shard, and leaves half of another and a torn record behind.
    let mut writer = Writer::open(&resumed, "{}").unwrap();
    writer.write_shard(PART, 0, &matrix.tiles[..4]).unwrap();
    writer.write_shard(PART, 1, &matrix.tiles[4..]).unwrap();
    drop(writer);
    let partial = scratch.path("resumed.transport.partial");
    let torn = fs::read(partial.join("tiles-direct-00001.safetensors")).unwrap();
    fs::write(partial.join("tiles-direct-00001.safetensors"), &torn[..torn.len() / 2]).unwrap();
    fs::write(partial.join(".tmp-1-tiles-direct-00001.safetensors"), b"half").unwrap();
    assert!(!resumed.exists());

    // Another job shares nothing with it; the same job finds the whole shard only.
    assert_eq!(Writer::open(&resumed, "{}").unwrap().finished(PART), [0]);
    let mut writer = Writer::open(&resumed, "{}").unwrap();
    assert_eq!(writer.finished(PART), [0]);
    writer.write_shard(PART, 1, &matrix.tiles[4..]).unwrap();
    let audit = Audit { groups: vec![0u32, 5].into(), tile: small(Width::I16).tiles[0].clone() };
    writer.finish(&about(&matrix, Width::I8), &receivers(ROWS), Some(&audit)).unwrap();
    assert_eq!(contents(&resumed), contents(&whole));
    assert!(!partial.exists());
}

/// A shard that somebody else made is asked for, delivered and taken in; one that is altered on the way, or asked for by
/// another run, is not.
#[test]
fn delivered_shards_are_those_that_were_asked_for() {
    let (scratch, matrix) = (Scratch::new(), small(Width::I8));
    let path = scratch.path("a.transport");
    let mut writer = Writer::open(&path, "one").unwrap();
    let other = Writer::deliver(&path, "two", PART, 0, &matrix.tiles[..4]);
    assert!(other.unwrap_err().to_string().contains("expected the run that asked for this shard"));
    for (shard, tiles) in matrix.tiles.chunks(TILES_PER_SHARD).enumerate() {
        let bytes = Writer::deliver(&path, "one", PART, shard, tiles).unwrap();
        let file = scratch.path("a.transport.partial").join(format!("tiles-{PART}-{shard:05}.safetensors"));
        let whole = fs::read(&file).unwrap();
        assert_eq!(bytes, whole.len() as u64);
        let mut altered = whole.clone();
        *altered.last_mut().unwrap() ^= 1;
        fs::write(&file, altered).unwrap();
        assert!(writer.adopt(PART, shard).unwrap_err().to_string().contains("altered"));
        fs::write(&file, whole).unwrap();
        writer.adopt(PART, shard).unwrap();
    }
    writer.finish(&about(&matrix, Width::I8), &receivers(ROWS), None).unwrap();
    assert_eq!(Dense::of(open(&path, &models).unwrap().product.alone().unwrap()), Dense::of(&matrix));
}

#[test]
fn another_job_starts_anew() {
    let (scratch, matrix) = (Scratch::new(), small(Width::I8));
    let path = scratch.path("a.transport");
    Writer::open(&path, "one").unwrap().write_shard(PART, 0, &matrix.tiles[..4]).unwrap();
    assert_eq!(Writer::open(&path, "two").unwrap().finished(PART), Vec::<usize>::new());
    assert_eq!(Writer::open(&path, "one").unwrap().finished(PART), Vec::<usize>::new());
}

#[test]
fn an_existing_result_stays_until_the_new_one_is_whole() {
    let (scratch, matrix) = (Scratch::new(), small(Width::I8));
    let path = scratch.path("a.transport");
    write(&path, &matrix, Width::I8);
    let before = contents(&path);
    let mut writer = Writer::open(&path, "other").unwrap();
    writer.write_shard(PART, 0, &matrix.tiles[..4]).unwrap();
    assert_eq!(contents(&path), before);

    // Incomplete, and then with tiles that no reader would take: both fail, both leave the old result alone.
    let missing = writer.finish(&about(&matrix, Width::I8), &receivers(ROWS), None);
    assert!(missing.unwrap_err().to_string().contains("shard 1 was not written"));
    let mut writer = Writer::open(&path, "other").unwrap();
    writer.write_shard(PART, 1, &matrix.tiles[..2]).unwrap();
    assert!(writer.finish(&about(&matrix, Width::I8), &receivers(ROWS), None).is_err());
    assert_eq!(contents(&path), before);

    let replacement = small(Width::I16);
    write(&path, &replacement, Width::I16);
    assert_eq!(Dense::of(open(&path, &models).unwrap().product.alone().unwrap()), Dense::of(&replacement));
    assert_eq!(fs::read_dir(&scratch.0).unwrap().count(), 1);
}

#[test]
fn a_kill_between_the_renames_loses_nothing() {
    let (scratch, matrix) = (Scratch::new(), small(Width::I8));
    let path = scratch.path("a.transport");
    write(&path, &matrix, Width::I8);
    let before = contents(&path);
    for emptied in [false, true] {
        fs::rename(&path, scratch.path("a.transport.old")).unwrap();
        if emptied {
            // Somebody made the directory anew before the next run.
            fs::create_dir(&path).unwrap();
        }
        drop(Writer::open(&path, "next").unwrap());
        assert_eq!(contents(&path), before);
    }
    // While a run holds the place, no other tidies up behind it.
    let first = Writer::open(&path, "next").unwrap();
    fs::rename(&path, scratch.path("a.transport.old")).unwrap();
    assert!(Writer::open(&path, "next").is_err());
    assert!(!path.exists());
    drop(first);
}

#[test]
fn what_a_kill_leaves_of_an_old_result_is_in_nobodys_way() {
    let (scratch, matrix) = (Scratch::new(), small(Width::I8));
    let (path, old) = (scratch.path("a.transport"), scratch.path("a.transport.old"));
    write(&path, &matrix, Width::I8);
    // The manifest went first, and then the process.
    fs::create_dir(&old).unwrap();
    fs::copy(path.join("receivers.safetensors"), old.join("receivers.safetensors")).unwrap();
    write(&path, &small(Width::I16), Width::I16);
    assert_eq!(fs::read_dir(&scratch.0).unwrap().count(), 1);
}

#[test]
fn what_is_not_a_transport_is_never_replaced() {
    let scratch = Scratch::new();
    let matrix = small(Width::I8);

    let photos = scratch.path("photos");
    fs::create_dir(&photos).unwrap();
    fs::write(photos.join("one.jpg"), b"x").unwrap();
    assert!(Writer::open(&photos, "{}").err().unwrap().to_string().contains("one.jpg"));

    let file = scratch.path("file");
    fs::write(&file, b"x").unwrap();
    assert!(Writer::open(&file, "{}").is_err());

    let web = scratch.path("web");
    fs::create_dir(&web).unwrap();
    fs::write(web.join(MANIFEST), br#"{"name": "a web page"}"#).unwrap();
    assert!(Writer::open(&web, "{}").err().unwrap().to_string().contains("not a transport"));

    let mixed = scratch.path("mixed.transport");
    write(&mixed, &matrix, Width::I8);
    fs::write(mixed.join("notes.txt"), b"mine").unwrap();
    assert!(Writer::open(&mixed, "{}").err().unwrap().to_string().contains("notes.txt"));
    assert_eq!(fs::read_dir(&scratch.0).unwrap().count(), 4);
    assert_eq!(fs::read(mixed.join("notes.txt")).unwrap(), b"mine");
}

#[test]
fn two_runs_do_not_write_to_one_place() {
    let scratch = Scratch::new();
    let path = scratch.path("a.transport");
    let first = Writer::open(&path, "{}").unwrap();
    assert!(Writer::open(&path, "{}").err().unwrap().to_string().contains("another run"));
    drop(first);
    Writer::open(&path, "{}").unwrap();
}

/// Replaces a file and makes the manifest agree: only the contents can give the enemy away.
fn forge(path: &Path, name: &str, bytes: &[u8]) {
    fs::write(path.join(name), bytes).unwrap();
    let mut manifest = read_manifest(path).unwrap();
    let entry = manifest.files.iter_mut().find(|entry| entry.name == name).unwrap();
    *entry = FileEntry {
        name: name.to_owned(),
        bytes: bytes.len() as u64,
        xxh3: format!("{:016x}", xxhash_rust::xxh3::xxh3_64(bytes)),
    };
    fs::write(path.join(MANIFEST), sealed(&manifest).unwrap()).unwrap();
}

/// The text of a manifest with the digest that belongs to it, as a liar would write it.
fn resealed(text: &str) -> String {
    let (before, _) = text.rsplit_once("\"digest\"").unwrap();
    format!("{before}\"digest\": \"{:016x}\"\n}}", xxhash_rust::xxh3::xxh3_64(before.as_bytes()))
}

/// A safetensors file split into header text and data.
fn split(bytes: &[u8]) -> (String, Vec<u8>) {
    let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    (String::from_utf8(bytes[8..8 + length].to_vec()).unwrap(), bytes[8 + length..].to_vec())
}

fn join(header: &str, data: &[u8]) -> Vec<u8> {
    [&(header.len() as u64).to_le_bytes()[..], header.as_bytes(), data].concat()
}

#[test]
fn truncated_and_altered_files_are_refused() {
    let (scratch, path) = (Scratch::new(), Scratch::new().path("unused"));
    drop(path);
    let path = scratch.path("a.transport");
    write(&path, &small(Width::I8), Width::I8);
    let shard = path.join("tiles-direct-00000.safetensors");
    let bytes = fs::read(&shard).unwrap();
    for length in (0..bytes.len()).step_by(64) {
        fs::write(&shard, &bytes[..length]).unwrap();
        assert!(refused(&path).contains("truncated"), "{length}");
        // The same with a manifest that agrees: the header or an array must give it away.
        if length % 1024 == 0 {
            let saved = fs::read(path.join(MANIFEST)).unwrap();
            forge(&path, "tiles-direct-00000.safetensors", &bytes[..length]);
            refused(&path);
            fs::write(path.join(MANIFEST), saved).unwrap();
        }
    }
    for position in (0..bytes.len()).step_by(bytes.len() / 97) {
        let mut flipped = bytes.clone();
        flipped[position] ^= 1 << (position % 8);
        fs::write(&shard, &flipped).unwrap();
        assert!(refused(&path).contains("checksum"), "{position}");
    }
    fs::remove_file(&shard).unwrap();
    assert!(refused(&path).contains("missing"));
    #[cfg(unix)]
    {
        fs::write(scratch.path("elsewhere"), &bytes).unwrap();
        std::os::unix::fs::symlink(scratch.path("elsewhere"), &shard).unwrap();
        assert!(refused(&path).contains("link"));
    }
}

/// No flipped byte of a header, whatever the checksum says, leads to anything but an error or an equal reading.
#[test]
fn forged_headers_never_crash() {
    let scratch = Scratch::new();
    let path = scratch.path("a.transport");
    let matrix = small(Width::I8);
    write(&path, &matrix, Width::I8);
    let name = "tiles-direct-00000.safetensors";
    let bytes = fs::read(path.join(name)).unwrap();
    let header = 8 + split(&bytes).0.len();
    let mut refusals = 0;
    for position in 0..header {
        let mut forged = bytes.clone();
        forged[position] ^= 1 << (position % 7);
        forge(&path, name, &forged);
        match open(&path, &models) {
            Ok(read) => assert_eq!(read.product.rows(), ROWS),
            Err(Error::File { .. }) => refusals += 1,
            Err(error) => panic!("{error}"),
        }
    }
    assert!(refusals > header * 9 / 10, "{refusals} of {header}");
}

#[test]
fn no_flipped_bit_of_a_manifest_is_believed() {
    let scratch = Scratch::new();
    let path = scratch.path("a.transport");
    write(&path, &small(Width::I8), Width::I8);
    let text = fs::read(path.join(MANIFEST)).unwrap();
    for bit in 0..8 * text.len() {
        let mut flipped = text.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        fs::write(path.join(MANIFEST), &flipped).unwrap();
        assert!(matches!(read_manifest(&path), Err(Error::File { .. })), "bit {bit}");
    }
    for length in 0..text.len() {
        fs::write(path.join(MANIFEST), &text[..length]).unwrap();
        refused(&path);
    }
    fs::remove_file(path.join(MANIFEST)).unwrap();
    assert!(matches!(open(&path, &models), Err(Error::Os { .. })));
}

/// Whoever changes the quantum, or the width of integers that fit both, scales all values: files of tiles say their own.
#[test]
fn values_in_another_unit_are_refused() {
    let scratch = Scratch::new();
    let path = scratch.path("a.transport");
    write(&path, &small(Width::I8), Width::I8);
    let text = fs::read_to_string(path.join(MANIFEST)).unwrap();
    let at = text.find("\"quantum\": ").unwrap() + "\"quantum\": ".len();
    let end = at + text[at..].find(',').unwrap();
    let quantum: i32 = text[at..end].parse().unwrap();
    let forged = format!("{}{}{}", &text[..at], quantum + 1, &text[end..]);
    fs::write(path.join(MANIFEST), resealed(&forged)).unwrap();
    assert!(refused(&path).contains("expected values in the unit"));
    // Before version 2.3 nothing was said, but what is said is held against the manifest all the same.
    fs::write(path.join(MANIFEST), resealed(&forged.replacen("2,\n    3", "2,\n    2", 1))).unwrap();
    assert!(refused(&path).contains("expected values in the unit"));

    // A file that says nothing is taken where nothing was said, and nowhere else.
    fs::write(path.join(MANIFEST), &text).unwrap();
    let name = "tiles-direct-00000.safetensors";
    let (header, data) = split(&fs::read(path.join(name)).unwrap());
    let (before, said) = header.split_once("\"__metadata__\":{").unwrap();
    let (_, after) = said.split_once("},").unwrap();
    let silent = format!("{before}{after}").trim_end().to_owned();
    forge(&path, name, &join(&format!("{silent:<0$}", silent.len().next_multiple_of(8)), &data));
    assert!(refused(&path).contains("found None"));
    let earlier = fs::read_to_string(path.join(MANIFEST)).unwrap().replacen("2,\n    3", "2,\n    2", 1);
    fs::write(path.join(MANIFEST), resealed(&earlier)).unwrap();
    assert_eq!(open(&path, &models).unwrap().product.rows(), ROWS);
}

#[test]
fn hostile_manifests_are_refused_with_a_reason() {
    let scratch = Scratch::new();
    let path = scratch.path("a.transport");
    write(&path, &small(Width::I8), Width::I8);
    let text = fs::read_to_string(path.join(MANIFEST)).unwrap();
    let cases = [
        ("\"deltalux.transport\"", "\"something.else\"", "format"),
        ("2,\n    3", "5,\n    0", "version 5"),
        ("2,\n    3", "3,\n    0", "\"models\" is missing"),
        ("\"rows\": 170", "\"rows\": 18446744073709551615", "rows"),
        ("\"rows\": 170", "\"rows\": 4294967295", "expected 33554433 files"),
        ("\"rows\": 170", "\"rows\": 0", "rows"),
        ("\"rows\": 170", "\"rows\": 171", "shape"),
        ("\"rows\": 170", "\"rows\": -1", "damaged"),
        ("\"rows\": 170", "\"rows\": 170, \"rows\": 170", "duplicate"),
        ("haar:2", "haar:1024", "power of two"),
        ("haar:2", "haar:4", "shape"),
        ("\"quantum\": -24", "\"quantum\": 100", "quantum"),
        ("\"quantum\": -24", "\"quantum\": 12", "in the unit"),
        ("\"i8\"", "\"i16\"", "values"),
        ("\"i8\"", "\"f64\"", "width"),
        ("\"tile_rows\": 32", "\"tile_rows\": 0", "tiles"),
        ("\"tile_rows\": 32", "\"tile_rows\": 33", "tiles"),
        ("\"tile_rows\": 32", "\"tile_rows\": 16", "expected"),
        ("\"channels\": 1", "\"channels\": 3", "shape"),
        ("\"channels\": 1", "\"channels\": 2", "channels"),
        ("10,\n      20", "10,\n      17", "background"),
        ("10,\n      20", "4294967296,\n      4294967296", "2^28"),
        ("\"tiles-direct-00001.safetensors\"", "\"../tiles-direct-00001.safetensors\"", "expected the file"),
        ("\"tiles-direct-00001.safetensors\"", "\"/etc/passwd\"", "expected the file"),
        ("\"tiles-direct-00001.safetensors\"", "\"tiles-direct-00000.safetensors\"", "expected the file"),
        ("\"scene\":", "\"scenery\":", "missing field"),
        ("\"name\": \"direct\"", "\"name\": \"../a\"", "a part's name of up to 32"),
        ("\"name\": \"direct\"", "\"name\": \"Direct\"", "a part's name of up to 32"),
        ("\"name\": \"direct\"", "\"name\": \"\"", "a part's name of up to 32"),
        ("\"name\": \"direct\"", "\"name\": \"a_part_whose_name_is_far_too_long_\"", "a part's name of up to 32"),
        ("\"name\": \"direct\"", "\"name\": \"other\"", "chain"),
        ("\"none\"", "\"weights\"", "expected"),
        ("\"none\"", "\"tree\"", "each stage"),
        ("\"none\"", "\"chain\"", "expected a link"),
        ("\"pixels\"", "\"vertices\"", "kind"),
        ("\"fov\": 40.1", "\"width\": 10, \"height\": 20", "camera's 10 x 20"),
    ];
    for (from, to, reason) in cases {
        let forged = text.replacen(from, to, 1);
        assert_ne!(forged, text, "{from}");
        fs::write(path.join(MANIFEST), &forged).unwrap();
        refused(&path);
        // Behind the digest there is a reason of its own.
        fs::write(path.join(MANIFEST), resealed(&forged)).unwrap();
        let message = refused(&path);
        assert!(message.contains(reason), "{from} -> {to}: {message}");
    }
    // Before version 2.2 there was no digest; one that is there is checked all the same.
    let before = text.rsplit_once(",\n  \"digest\"").unwrap().0.to_owned() + "\n}";
    fs::write(path.join(MANIFEST), &before).unwrap();
    assert!(refused(&path).contains("digest"));
    fs::write(path.join(MANIFEST), before.replacen("2,\n    3", "2,\n    1", 1)).unwrap();
    assert_eq!(open(&path, &models).unwrap().product.rows(), ROWS);
    // Keys that are unknown are ignored, as the format promises to its own future.
    let moody = text.replacen("\"rows\"", "\"mood\": [1, {\"a\": 2}], \"rows\"", 1);
    fs::write(path.join(MANIFEST), resealed(&moody)).unwrap();
    assert_eq!(open(&path, &models).unwrap().product.rows(), ROWS);
}

#[test]
fn hostile_tiles_are_refused_with_a_reason() {
    let scratch = Scratch::new();
    let path = scratch.path("a.transport");
    let matrix = small(Width::I8);
    let name = "tiles-direct-00001.safetensors";
    write(&path, &matrix, Width::I8);
    let original = fs::read(path.join(name)).unwrap();
    let (header, data) = split(&original);

    // Headers: huge counts, overlaps, other types, arrays too few or too many.
    let entries = matrix.tiles[4].words.len();
    let swap = header.replacen("00005.starts", "00009.starts", 1);
    let longer = header.replacen(&format!("[{entries}]"), "[18446744073709551615]", 1);
    let typed = header.replacen("\"U32\"", "\"F32\"", 1);
    let overlap = header.replacen("\"data_offsets\":[0,", "\"data_offsets\":[4,", 1);
    for (forged, reason) in
        [(swap, "missing"), (longer, "not a tile file"), (typed, "F32"), (overlap, "not a tile file")]
    {
        assert_ne!(forged, header);
        forge(&path, name, &join(&forged, &data));
        let message = refused(&path);
        assert!(message.contains(reason), "{message}");
    }
    for length in [0, u64::MAX, 1 << 40] {
        let mut forged = original.clone();
        forged[..8].copy_from_slice(&length.to_le_bytes());
        forge(&path, name, &forged);
        refused(&path);
    }

    // Contents, one promise broken at a time, in a transport that is otherwise whole.
    type Break = fn(&mut Vec<u32>, &mut Vec<u16>, &mut Vec<i8>, &mut Vec<u16>);
    let cases: [(Break, &str); 10] = [
        (|starts, _, _, _| starts[0] = 1, "starts"),
        (|starts, _, _, _| *starts.last_mut().unwrap() += 1, "starts"),
        (|starts, _, _, _| starts[3] = u32::MAX, "step back"),
        (|_, words, _, _| words[0] |= 0x3ff, "ascending groups"),
        (|_, words, _, _| words[1] = words[0], "ascending groups"),
        (|_, words, _, _| words[0] |= 63 << 10, "shifts"),
        (|_, _, values, _| values[0] = i8::MIN, "values from"),
        (|_, _, _, norms| norms[0] = 0x7f80, "norms"),
        (|_, _, _, norms| norms[0] = 0, "or more kept"),
        // Half of what it was.
        (|_, _, _, norms| norms[0] -= 0x80, "or more kept"),
    ];
    for (harm, reason) in cases {
        let mut tile = matrix.tiles[4].clone();
        let Values::I8(values) = &tile.values else { panic!("eight bits") };
        let (mut starts, mut words, mut norms) = (tile.starts.to_vec(), tile.words.to_vec(), tile.kept.to_vec());
        let mut values = values.to_vec();
        harm(&mut starts, &mut words, &mut values, &mut norms);
        tile.starts = starts.into();
        tile.words = words.into();
        tile.values = Values::I8(values.into());
        tile.kept = norms.into();
        let other = scratch.path("b.transport");
        let mut writer = Writer::open(&other, reason).unwrap();
        writer.write_shard(PART, 0, &matrix.tiles[..4]).unwrap();
        writer.write_shard(PART, 1, &[tile, matrix.tiles[5].clone()]).unwrap();
        let message = writer.finish(&about(&matrix, Width::I8), &receivers(ROWS), None).unwrap_err().to_string();
        assert!(message.contains(reason) && message.contains("00004"), "{reason}: {message}");
        assert!(!other.exists());
    }
}

#[test]
fn receivers_are_checked() {
    let (scratch, matrix) = (Scratch::new(), small(Width::I8));
    let path = scratch.path("a.transport");
    type Break = fn(&mut ReceiverTable);
    fn pixels(table: &mut ReceiverTable, harm: fn(&mut Slab<u32>, &mut Slab<f32>, &mut Slab<f32>)) {
        let ReceiverKind::Pixels { pixel, weight, background, .. } = &mut table.kind else { panic!("pixels") };
        harm(pixel, weight, background);
    }
    let cases: [(Break, &str); 9] = [
        (|table| pixels(table, |pixel, _, _| *pixel = vec![200u32; ROWS].into()), "pixels below 200"),
        (|table| pixels(table, |_, weight, _| *weight = vec![f32::NAN; ROWS].into()), "weight"),
        (|table| table.albedo = vec![-1.0f32; 3 * ROWS].into(), "albedo"),
        (|table| table.position = vec![f32::INFINITY; 3 * ROWS].into(), "position"),
        (|table| pixels(table, |_, _, background| *background = vec![f32::NAN; 200].into()), "background"),
        (|table| table.kind = vertices(ROWS - 1, 0), "vertex"),
        (|table| table.kind = vertices(ROWS, 2), "buried"),
        (|table| table.kind = ReceiverKind::Gather { area: vec![-1.0f32; ROWS].into() }, "area"),
        (|table| table.kind = ReceiverKind::Gather { area: vec![1.0f32].into() }, "area"),
    ];
    for (harm, reason) in cases {
        let mut writer = Writer::open(&path, "{}").unwrap();
        writer.write_shard(PART, 0, &matrix.tiles[..4]).unwrap();
        writer.write_shard(PART, 1, &matrix.tiles[4..]).unwrap();
        let mut table = receivers(ROWS);
        harm(&mut table);
        let message = writer.finish(&about(&matrix, Width::I8), &table, None).unwrap_err().to_string();
        assert!(message.contains(reason), "{message}");
    }
}

fn vertices(rows: usize, flag: u8) -> ReceiverKind {
    let vertex: Vec<u32> = (0..rows as u32).rev().collect();
    ReceiverKind::Vertices { vertex: vertex.into(), buried: vec![flag; rows].into() }
}

/// Every kind of receivers, three channels, several parts and every link through a file and back.
#[test]
fn chains_are_read_as_they_were_written() {
    let haar = ColumnSpace::haar(2).unwrap();
    let (one, three) = (Channels::One, Channels::Three);
    let direct = matrix(haar, 40, one, 1, Width::I8);
    let nodes = matrix(haar, 20, three, 2, Width::I16);
    let weights = Weights::new(
        (0..=40u32).collect::<Vec<_>>().into(),
        (0..40u32).map(|k| (k % 20) | ((k % 3 / 2) * NEGATIVE)).collect::<Vec<_>>().into(),
        vec![128u16; 40].into(),
        -8,
        20,
    );
    let tree = HaarTree::new((0..20).map(|k| f64::from(k % 3)).collect()).unwrap();
    let gathered = matrix(tree.space(), 40, one, 3, Width::I8);
    let representatives = ColumnSpace::representatives(4, 4).unwrap();
    let clustered = matrix(representatives, 40, one, 4, Width::I8);
    let samples = matrix(haar, 20, one, 5, Width::I8);
    let norms = norms_of_both(&samples, &clustered);
    let chains: [(&str, Link, Vec<&TransportMatrix>, usize); 5] = [
        ("factors", Link::None, vec![&direct, &direct, &direct], 3),
        ("weights", Link::Weights(weights.unwrap().into()), vec![&direct, &nodes], 2),
        ("tree", Link::Tree(tree.into()), vec![&samples, &gathered, &gathered], 1),
        ("representatives", Link::Representatives([norms.clone()].into()), vec![&samples, &clustered], 1),
        ("alone", Link::None, vec![&direct], 1),
    ];
    let kinds = [
        vertices(40, 1),
        ReceiverKind::Gather { area: vec![0.5f32; 40].into() },
        vertices(40, 0),
        receivers(40).kind,
        receivers(40).kind,
    ];
    for ((name, link, parts, first), kind) in chains.into_iter().zip(kinds) {
        let scratch = Scratch::new();
        let path = scratch.path("a.transport");
        let mut writer = Writer::open(&path, name).unwrap();
        let names: Vec<String> = (0..parts.len()).map(|k| format!("part_{k}")).collect();
        names.iter().zip(&parts).for_each(|(name, matrix)| write_tiles(&mut writer, name, matrix));
        let width = |matrix: &TransportMatrix| match matrix.tiles[0].values {
            Values::I8(_) => Width::I8,
            Values::I16(_) => Width::I16,
        };
        let described = names.iter().zip(&parts).map(|(name, matrix)| part(name, matrix, width(matrix))).collect();
        let about = Description { parts: described, first, link, ..about(&direct, Width::I8) };
        let table = ReceiverTable { kind, ..receivers(40) };
        writer.finish(&about, &table, None).unwrap();

        let Opened { product, receivers, manifest, .. } = open(&path, &models).unwrap();
        let read: Vec<_> = product.first.iter().chain(product.then.iter().flat_map(|then| then.iter())).collect();
        assert_eq!(read.len(), parts.len());
        for (read, written) in read.iter().zip(&parts) {
            assert_eq!(Dense::of(read), Dense::of(written), "{name}");
            assert_eq!(stored_norms(read, |tile| &tile.kept), stored_norms(written, |tile| &tile.kept));
        }
        match (&product.link, &about.link) {
            (Link::Weights(read), Link::Weights(written)) => assert_eq!(read.arrays(), written.arrays()),
            (Link::Tree(read), Link::Tree(written)) => assert_eq!(read, written),
            (Link::Representatives(read), Link::Representatives(_)) => assert_eq!(read[0].arrays(), norms.arrays()),
            (Link::None, Link::None) => {}
            _ => panic!("{name}: another link"),
        }
        assert_eq!(manifest.version, if name == "weights" { [4, 2] } else { [2, 3] });
        assert_eq!(manifest.receivers.kind, table.kind.name());
        assert_eq!(receivers.kind.name(), table.kind.name());
        assert_eq!(&receivers.position[..], &table.position[..]);
    }
}

#[test]
fn parts_of_one_name_are_refused() {
    let scratch = Scratch::new();
    let path = scratch.path("a.transport");
    let matrix = small(Width::I8);
    let mut writer = Writer::open(&path, "names").unwrap();
    ["first", "other"].iter().for_each(|name| write_tiles(&mut writer, name, &matrix));
    let parts = vec![part("first", &matrix, Width::I8), part("other", &matrix, Width::I8)];
    let about = Description { parts, first: 2, ..about(&matrix, Width::I8) };
    writer.finish(&about, &receivers(ROWS), None).unwrap();
    let text = fs::read_to_string(path.join(MANIFEST)).unwrap();
    fs::write(path.join(MANIFEST), resealed(&text.replace("\"other\"", "\"first\""))).unwrap();
    let message = refused(&path);
    assert!(message.contains("\"first\" twice"), "{message}");
}
