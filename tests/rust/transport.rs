//! The transport floor: truncation and tiles against the dense oracle, the file against damage of every kind.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use _core::basis::ColumnSpace;
use _core::error::Error;
use _core::transport::entry::power_of_two;
use _core::transport::file::manifest::{FileEntry, MANIFEST, Manifest, TILES_PER_SHARD};
use _core::transport::truncate::compress_portable;
use _core::transport::{
    Audit, CompressedGroup, Dense, Description, GROUP, Opened, ReceiverTable, Rows16, TransportMatrix, Truncation,
    Values, Width, Writer, bf16, bf16_up, compress_group, open, threshold_for,
};
use proptest::prelude::*;

const QUANTUM: i32 = -24;

/// A reproducible stream of numbers in [-1, 1).
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(2).wrapping_add(1);
    move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// Rows with magnitudes over several octaves, zeros, empty columns and an empty row.
fn random_dense(space: ColumnSpace, rows: usize, seed: u64) -> Dense {
    let columns = space.columns();
    let mut next = noise(seed);
    let scales: Vec<f64> = (0..columns).map(|_| next().max(0.0).powi(6)).collect();
    let mut values: Vec<f64> = (0..rows * columns).map(|k| next() * scales[k % columns]).collect();
    values.iter_mut().for_each(|value| *value = f64::from(*value as f32));
    if rows > 2 {
        values[columns..2 * columns].fill(0.0);
    }
    Dense::new(rows, columns, values)
}

fn rule(space: ColumnSpace, threshold: f64, width: Width) -> Truncation {
    Truncation::new(&space.bands(), threshold, QUANTUM, width).unwrap()
}

fn matrix(space: ColumnSpace, rows: usize, seed: u64, width: Width) -> TransportMatrix {
    random_dense(space, rows, seed).compress(space, &rule(space, 0.0, width), 32).unwrap()
}

/// L2 norm of each row in each band of a - b.
fn band_norms(a: &Dense, b: &Dense, space: ColumnSpace) -> Vec<f64> {
    let bands = space.bands();
    let norm = |row: usize, band: usize| {
        let pairs = a.row(row)[bands.range(band)].iter().zip(&b.row(row)[bands.range(band)]);
        pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    };
    (0..a.rows)
        .flat_map(|row| (0..bands.count()).map(move |band| (row, band)))
        .map(|(row, band)| norm(row, band))
        .collect()
}

fn stored_norms(matrix: &TransportMatrix, of: fn(&_core::transport::Tile) -> &[u16]) -> Vec<f64> {
    matrix.tiles.iter().flat_map(|tile| of(tile).iter()).map(|&bits| f64::from(bf16(bits))).collect()
}

fn width_strategy() -> impl Strategy<Value = Width> {
    prop_oneof![Just(Width::I8), Just(Width::I16)]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// Every stored value is the nearest multiple of its entry's step, the step is the least that fits, and both losses
    /// and remains are stated from above by no more than a bfloat16 step.
    #[test]
    fn truncation_keeps_its_word(seed: u64, rows in 1usize..70, log_size in 0u32..4, width in width_strategy(), threshold in 0.0f64..1.0) {
        let space = ColumnSpace::haar(1 << log_size).unwrap();
        let dense = random_dense(space, rows, seed);
        let matrix = dense.compress(space, &rule(space, threshold, width), 32).unwrap();
        let stored = Dense::of(&matrix);

        let lost = band_norms(&dense, &stored, space);
        let zero = Dense::new(rows, dense.columns, vec![0.0; rows * dense.columns]);
        let kept = band_norms(&stored, &zero, space);
        for (truth, stated) in [(lost, stored_norms(&matrix, |tile| &tile.dropped)), (kept, stored_norms(&matrix, |tile| &tile.kept))] {
            for (truth, stated) in truth.iter().zip(&stated) {
                prop_assert!(truth <= stated, "{truth} is stated as {stated}");
                prop_assert!(*stated <= truth * 1.008 + 1e-19, "{truth} is stated as {stated}");
                prop_assert_eq!(*truth == 0.0, *stated == 0.0);
            }
        }

        let bands = space.bands();
        for first in (0..rows).step_by(GROUP) {
            let lanes = dense.lanes(first);
            for (column, lanes) in lanes.iter().enumerate() {
                let energy: f64 = lanes.iter().map(|&x| f64::from(x).powi(2)).sum();
                let weighed = energy * bands.areas[column];
                let stored: Vec<f64> = (first..rows.min(first + GROUP)).map(|row| stored.row(row)[column]).collect();
                let largest = lanes.iter().fold(0.0f64, |most, &x| most.max(f64::from(x).abs()));
                let mut step = f64::from(power_of_two(QUANTUM));
                while (largest / step).round_ties_even() > f64::from(width.max()) {
                    step *= 2.0;
                }
                if stored.iter().all(|&value| value == 0.0) {
                    // Dropped: too weak together, or nothing but zeros after rounding.
                    let weak = column >= 6 && weighed <= threshold * threshold * (1.0 + 1e-5);
                    prop_assert!(weak || largest <= step / 2.0);
                } else {
                    prop_assert!(column < 6 || weighed >= threshold * threshold * (1.0 - 1e-5));
                    for (value, &truth) in stored.iter().zip(lanes) {
                        prop_assert_eq!(*value, (f64::from(truth) / step).round_ties_even() * step);
                    }
                }
            }
        }
    }

    /// The two paths give the same bits.
    #[test]
    fn instruction_sets_agree(seed: u64, threshold in 0.0f64..1.0, width in width_strategy()) {
        let space = ColumnSpace::haar(8).unwrap();
        let lanes = random_dense(space, GROUP, seed).lanes(0);
        let (mut a, mut b) = (CompressedGroup::default(), CompressedGroup::default());
        compress_group(&lanes, &space.bands(), &rule(space, threshold, width), &mut a).unwrap();
        compress_portable(&lanes, &space.bands(), &rule(space, threshold, width), &mut b).unwrap();
        prop_assert_eq!(format!("{a:?}"), format!("{b:?}"));
    }

    /// Norms round up, to the next bfloat16 and no further; zero stays zero.
    #[test]
    fn bfloat16_rounds_up(bits in 0u32..0x7f00_0000, wobble in 0u32..1 << 29) {
        let norm = f64::from_bits(f64::from(f32::from_bits(bits)).to_bits() + u64::from(wobble));
        let up = bf16_up(norm);
        prop_assert!(f64::from(bf16(up)) >= norm);
        prop_assert!(up == 0 || f64::from(bf16(up - 1)) < norm);
    }

    /// Rows, the copy by rows, the transpose and the norms of columns all come from the same numbers.
    #[test]
    fn every_reading_agrees(seed: u64, rows in 1usize..70, width in width_strategy()) {
        let space = ColumnSpace::haar(4).unwrap();
        let matrix = matrix(space, rows, seed, width);
        let dense = Dense::of(&matrix);

        let csr = matrix.to_csr();
        let mut copy = vec![0.0; rows * dense.columns];
        for row in 0..rows {
            let range = csr.indptr[row] as usize..csr.indptr[row + 1] as usize;
            prop_assert!(csr.indices[range.clone()].windows(2).all(|pair| pair[0] < pair[1]));
            for k in range {
                copy[row * dense.columns + csr.indices[k] as usize] = f64::from(csr.data[k]);
            }
        }
        prop_assert_eq!(&copy, &dense.values);
        prop_assert!(csr.data.iter().all(|&value| value != 0.0));

        let mut next = noise(seed ^ 1);
        let y: Vec<f64> = (0..rows * 3).map(|_| next()).collect();
        let product = matrix.transpose_multiply(&y, 3);
        for column in 0..dense.columns {
            for k in 0..3 {
                let truth: f64 = (0..rows).map(|row| dense.row(row)[column] * y[row * 3 + k]).sum();
                prop_assert!((product[column * 3 + k] - truth).abs() <= 1e-12);
            }
            let norm = (0..rows).map(|row| dense.row(row)[column].powi(2)).sum::<f64>().sqrt();
            prop_assert!((matrix.column_norms()[column] - norm).abs() <= 1e-12 * norm);
        }
        let entries: u32 = matrix.column_entries().iter().sum();
        prop_assert_eq!(entries as usize, matrix.entries());
    }

    /// What a smaller version states as lost is never below what it lost of the original rows.
    #[test]
    fn truncating_twice_states_the_whole_loss(seed: u64, first in 0.0f64..0.5, second in 0.0f64..1.0) {
        let space = ColumnSpace::haar(4).unwrap();
        let dense = random_dense(space, 40, seed);
        let once = dense.compress(space, &rule(space, first, Width::I16), 32).unwrap();
        let twice = once.truncated(&rule(space, second, Width::I8)).unwrap();
        let lost = band_norms(&dense, &Dense::of(&twice), space);
        for (truth, stated) in lost.iter().zip(stored_norms(&twice, |tile| &tile.dropped)) {
            prop_assert!(*truth <= stated);
        }
        prop_assert!(twice.entries() <= once.entries());
    }

    /// The error that a threshold was chosen for is the error that it makes, under the prior it was chosen under.
    #[test]
    fn thresholds_meet_their_tolerance(seed: u64, tolerance in 0.02f64..0.5) {
        let space = ColumnSpace::haar(8).unwrap();
        let (bands, dense) = (space.bands(), random_dense(space, 64, seed));
        let samples: Vec<Vec<Rows16>> = (0..4).map(|group| dense.lanes(16 * group)).collect();
        let views: Vec<&[Rows16]> = samples.iter().map(Vec::as_slice).collect();
        let choice = threshold_for(&views, &bands, QUANTUM, Width::I8, tolerance).unwrap();
        let matrix = dense.compress(space, &rule(space, choice.value, Width::I8), 64).unwrap();
        let stored = Dense::of(&matrix);
        let (mut lost, mut all) = (0.0, 0.0);
        for (k, (truth, stored)) in dense.values.iter().zip(&stored.values).enumerate() {
            lost += (truth - stored).powi(2) * bands.areas[k % dense.columns];
            all += truth.powi(2) * bands.areas[k % dense.columns];
        }
        prop_assert!(choice.error <= tolerance);
        prop_assert!(((lost / all).sqrt() - choice.error).abs() <= 1e-3 * choice.error, "{} {}", (lost / all).sqrt(), choice.error);
        prop_assert!((choice.entries_per_group - matrix.entries() as f64 / 4.0).abs() < 1e-9);
    }
}

/// A row with one value v in a fine column (area 4 of haar:4 has weight 2 for 2x2 blocks): dropped from threshold 2|v|
/// on.
#[test]
fn the_threshold_weighs_by_the_root_of_the_area() {
    let space = ColumnSpace::haar(4).unwrap();
    let bands = space.bands();
    let column = bands.range(1).start;
    assert_eq!(bands.areas[column], 4.0);
    let mut lanes = vec![[0.0; GROUP]; bands.columns()];
    lanes[column][3] = 0.25;
    lanes[0][0] = 2.0f32.powi(-20);
    for (threshold, expected) in [(0.5, vec![0, column as u32]), (0.51, vec![0])] {
        let mut out = CompressedGroup::default();
        compress_group(&lanes, &bands, &rule(space, threshold, Width::I8), &mut out).unwrap();
        // The scaling column stays however small it is.
        assert_eq!(out.columns, expected);
    }
}

#[test]
fn coefficients_that_cannot_be_stored_are_refused() {
    let space = ColumnSpace::haar(2).unwrap();
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 2.0e6, 1e30] {
        for column in [0, 20] {
            let mut lanes = vec![[0.0; GROUP]; space.columns()];
            lanes[column][5] = bad;
            let found = compress_group(&lanes, &space.bands(), &rule(space, 0.1, Width::I8), &mut Default::default());
            assert!(matches!(found, Err(Error::Input(_))), "{bad} in column {column}");
        }
    }
    for (threshold, quantum) in [(f64::NAN, QUANTUM), (-1.0, QUANTUM), (0.0, -65), (0.0, 14)] {
        assert!(Truncation::new(&space.bands(), threshold, quantum, Width::I8).is_err());
    }
}

// ----------------------------------------------------------------------------------------------------------------
// files

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
    matrix(ColumnSpace::haar(2).unwrap(), ROWS, 7, width)
}

fn about(matrix: &TransportMatrix, width: Width) -> Description {
    Description {
        space: matrix.space,
        rows: matrix.rows,
        quantum: matrix.quantum,
        width,
        tile_rows: matrix.tile_rows,
        image: [10, 20],
        camera: r#"{"fov": 40.1}"#.to_owned(),
        plan: "{}".to_owned(),
        scene: "0123".to_owned(),
    }
}

fn receivers(rows: usize) -> ReceiverTable {
    let floats = |count: usize| -> Vec<f32> { (0..count).map(|k| k as f32 / 7.0).collect() };
    ReceiverTable {
        pixel: (0..rows as u32).collect::<Vec<_>>().into(),
        weight: floats(rows).into(),
        albedo: floats(3 * rows).into(),
        position: floats(3 * rows).into(),
        normal: floats(3 * rows).into(),
        material: Some((0..rows as u16).collect::<Vec<_>>().into()),
        background: floats(200).into(),
    }
}

fn write(path: &Path, matrix: &TransportMatrix, width: Width) {
    let mut writer = Writer::open(path, "{}").unwrap();
    for (shard, tiles) in matrix.tiles.chunks(TILES_PER_SHARD).enumerate() {
        writer.write_shard(shard, tiles).unwrap();
    }
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
    match open(path) {
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
        let Opened { matrix: read, receivers: table, audit, manifest } = open(&path).unwrap();
        assert_eq!(Dense::of(&read), Dense::of(&matrix));
        assert_eq!(read.to_csr(), matrix.to_csr());
        assert_eq!(stored_norms(&read, |tile| &tile.dropped), stored_norms(&matrix, |tile| &tile.dropped));
        assert_eq!(matches!(read.tiles[0].values, Values::I8(_)), width == Width::I8);
        assert_eq!(&table.albedo[..], &receivers(ROWS).albedo[..]);
        assert_eq!(table.material.unwrap()[3], 3);
        assert_eq!(manifest.camera.get(), r#"{"fov": 40.1}"#);
        assert_eq!(&audit.unwrap().groups[..], &[0, 5]);
        let names: Vec<String> = contents(&path).into_iter().map(|(name, _)| name).collect();
        let expected = ["audit", "manifest", "receivers", "tiles-00000", "tiles-00001"];
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
    writer.write_shard(0, &matrix.tiles[..4]).unwrap();
    writer.write_shard(1, &matrix.tiles[4..]).unwrap();
    drop(writer);
    let partial = scratch.path("resumed.transport.partial");
    let torn = fs::read(partial.join("tiles-00001.safetensors")).unwrap();
    fs::write(partial.join("tiles-00001.safetensors"), &torn[..torn.len() / 2]).unwrap();
    fs::write(partial.join(".tmp-1-tiles-00001.safetensors"), b"half").unwrap();
    assert!(!resumed.exists());

    // Another job shares nothing with it; the same job finds the whole shard only.
    assert_eq!(Writer::open(&resumed, "{}").unwrap().finished(), [0]);
    let mut writer = Writer::open(&resumed, "{}").unwrap();
    assert_eq!(writer.finished(), [0]);
    writer.write_shard(1, &matrix.tiles[4..]).unwrap();
    let audit = Audit { groups: vec![0u32, 5].into(), tile: small(Width::I16).tiles[0].clone() };
    writer.finish(&about(&matrix, Width::I8), &receivers(ROWS), Some(&audit)).unwrap();
    assert_eq!(contents(&resumed), contents(&whole));
    assert!(!partial.exists());
}

#[test]
fn another_job_starts_anew() {
    let (scratch, matrix) = (Scratch::new(), small(Width::I8));
    let path = scratch.path("a.transport");
    Writer::open(&path, "one").unwrap().write_shard(0, &matrix.tiles[..4]).unwrap();
    assert_eq!(Writer::open(&path, "two").unwrap().finished(), Vec::<usize>::new());
    assert_eq!(Writer::open(&path, "one").unwrap().finished(), Vec::<usize>::new());
}

#[test]
fn an_existing_result_stays_until_the_new_one_is_whole() {
    let (scratch, matrix) = (Scratch::new(), small(Width::I8));
    let path = scratch.path("a.transport");
    write(&path, &matrix, Width::I8);
    let before = contents(&path);
    let mut writer = Writer::open(&path, "other").unwrap();
    writer.write_shard(0, &matrix.tiles[..4]).unwrap();
    assert_eq!(contents(&path), before);

    // Incomplete, and then with tiles that no reader would take: both fail, both leave the old result alone.
    let missing = writer.finish(&about(&matrix, Width::I8), &receivers(ROWS), None);
    assert!(missing.unwrap_err().to_string().contains("shard 1 was not written"));
    let mut writer = Writer::open(&path, "other").unwrap();
    writer.write_shard(1, &matrix.tiles[..2]).unwrap();
    assert!(writer.finish(&about(&matrix, Width::I8), &receivers(ROWS), None).is_err());
    assert_eq!(contents(&path), before);

    let replacement = small(Width::I16);
    write(&path, &replacement, Width::I16);
    assert_eq!(Dense::of(&open(&path).unwrap().matrix), Dense::of(&replacement));
    assert_eq!(fs::read_dir(&scratch.0).unwrap().count(), 1);
}

#[test]
fn a_kill_between_the_renames_loses_nothing() {
    let (scratch, matrix) = (Scratch::new(), small(Width::I8));
    let path = scratch.path("a.transport");
    write(&path, &matrix, Width::I8);
    let before = contents(&path);
    fs::rename(&path, scratch.path("a.transport.old")).unwrap();
    drop(Writer::open(&path, "next").unwrap());
    assert_eq!(contents(&path), before);
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
    let mut manifest = Manifest::read(path).unwrap();
    let entry = manifest.files.iter_mut().find(|entry| entry.name == name).unwrap();
    *entry = FileEntry {
        name: name.to_owned(),
        bytes: bytes.len() as u64,
        xxh3: format!("{:016x}", xxhash_rust::xxh3::xxh3_64(bytes)),
    };
    fs::write(path.join(MANIFEST), serde_json::to_vec(&manifest).unwrap()).unwrap();
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
    let shard = path.join("tiles-00000.safetensors");
    let bytes = fs::read(&shard).unwrap();
    for length in (0..bytes.len()).step_by(64) {
        fs::write(&shard, &bytes[..length]).unwrap();
        assert!(refused(&path).contains("truncated"), "{length}");
        // The same with a manifest that agrees: the header or an array must give it away.
        if length % 1024 == 0 {
            let saved = fs::read(path.join(MANIFEST)).unwrap();
            forge(&path, "tiles-00000.safetensors", &bytes[..length]);
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
    let name = "tiles-00000.safetensors";
    let bytes = fs::read(path.join(name)).unwrap();
    let header = 8 + split(&bytes).0.len();
    let mut refusals = 0;
    for position in 0..header {
        let mut forged = bytes.clone();
        forged[position] ^= 1 << (position % 7);
        forge(&path, name, &forged);
        match open(&path) {
            Ok(read) => assert_eq!(read.matrix.rows, ROWS),
            Err(Error::File { .. }) => refusals += 1,
            Err(error) => panic!("{error}"),
        }
    }
    assert!(refusals > header * 9 / 10, "{refusals} of {header}");
}

#[test]
fn manifests_are_checked_byte_by_byte() {
    let scratch = Scratch::new();
    let path = scratch.path("a.transport");
    write(&path, &small(Width::I8), Width::I8);
    let text = fs::read_to_string(path.join(MANIFEST)).unwrap();
    for position in 0..text.len() {
        let mut flipped = text.clone().into_bytes();
        flipped[position] ^= 1 << (position % 7);
        fs::write(path.join(MANIFEST), &flipped).unwrap();
        match open(&path) {
            Ok(read) => assert_eq!(read.matrix.rows, ROWS),
            Err(Error::File { .. }) => {}
            Err(error) => panic!("byte {position}: {error}"),
        }
    }
    fs::remove_file(path.join(MANIFEST)).unwrap();
    assert!(matches!(open(&path), Err(Error::Os { .. })));
}

#[test]
fn hostile_manifests_are_refused_with_a_reason() {
    let scratch = Scratch::new();
    let path = scratch.path("a.transport");
    write(&path, &small(Width::I8), Width::I8);
    let text = fs::read_to_string(path.join(MANIFEST)).unwrap();
    let cases = [
        ("\"deltalux.transport\"", "\"something.else\"", "format"),
        ("1,\n    0", "2,\n    0", "version 2"),
        ("\"rows\": 170", "\"rows\": 18446744073709551615", "rows"),
        ("\"rows\": 170", "\"rows\": 4294967295", "expected"),
        ("\"rows\": 170", "\"rows\": 0", "rows"),
        ("\"rows\": 170", "\"rows\": 171", "shape"),
        ("\"rows\": 170", "\"rows\": -1", "damaged"),
        ("\"rows\": 170", "\"rows\": 170, \"rows\": 170", "duplicate"),
        ("haar:2", "haar:1024", "power of two"),
        ("haar:2", "haar:4", "shape"),
        ("\"quantum\": -24", "\"quantum\": 100", "quantum"),
        ("\"quantum\": -24", "\"quantum\": 12", "shift"),
        ("\"i8\"", "\"i16\"", "values"),
        ("\"i8\"", "\"f64\"", "width"),
        ("\"tile_rows\": 32", "\"tile_rows\": 0", "tiles"),
        ("\"tile_rows\": 32", "\"tile_rows\": 33", "tiles"),
        ("\"tile_rows\": 32", "\"tile_rows\": 16", "expected"),
        ("\"channels\": 1", "\"channels\": 3", "channel"),
        ("10,\n    20", "10,\n    17", "background"),
        ("10,\n    20", "4294967296,\n    4294967296", "2^28"),
        ("\"tiles-00001.safetensors\"", "\"../tiles-00001.safetensors\"", "expected the file"),
        ("\"tiles-00001.safetensors\"", "\"/etc/passwd\"", "expected the file"),
        ("\"tiles-00001.safetensors\"", "\"tiles-00000.safetensors\"", "expected the file"),
        ("\"scene\":", "\"scenery\":", "missing field"),
    ];
    for (from, to, reason) in cases {
        let forged = text.replacen(from, to, 1);
        assert_ne!(forged, text, "{from}");
        fs::write(path.join(MANIFEST), forged).unwrap();
        let message = refused(&path);
        assert!(message.contains(reason), "{from} -> {to}: {message}");
    }
    // Keys that are unknown are ignored, as the format promises to its own future.
    fs::write(path.join(MANIFEST), text.replacen("\"rows\"", "\"mood\": [1, {\"a\": 2}], \"rows\"", 1)).unwrap();
    assert_eq!(open(&path).unwrap().matrix.rows, ROWS);
}

#[test]
fn hostile_tiles_are_refused_with_a_reason() {
    let scratch = Scratch::new();
    let path = scratch.path("a.transport");
    let matrix = small(Width::I8);
    let name = "tiles-00001.safetensors";
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
    let cases: [(Break, &str); 8] = [
        (|starts, _, _, _| starts[0] = 1, "starts"),
        (|starts, _, _, _| *starts.last_mut().unwrap() += 1, "starts"),
        (|starts, _, _, _| starts[3] = u32::MAX, "step back"),
        (|_, words, _, _| words[0] |= 0x3ff, "ascending groups"),
        (|_, words, _, _| words[1] = words[0], "ascending groups"),
        (|_, words, _, _| words[0] |= 63 << 10, "shifts"),
        (|_, _, values, _| values[0] = i8::MIN, "values from"),
        (|_, _, _, norms| norms[0] = 0x7f80, "norms"),
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
        writer.write_shard(0, &matrix.tiles[..4]).unwrap();
        writer.write_shard(1, &[tile, matrix.tiles[5].clone()]).unwrap();
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
    let cases: [(Break, &str); 5] = [
        (|table| table.pixel = vec![200u32; ROWS].into(), "pixels below 200"),
        (|table| table.weight = vec![f32::NAN; ROWS].into(), "weight"),
        (|table| table.albedo = vec![-1.0f32; 3 * ROWS].into(), "albedo"),
        (|table| table.position = vec![f32::INFINITY; 3 * ROWS].into(), "position"),
        (|table| table.background = vec![f32::NAN; 200].into(), "background"),
    ];
    for (harm, reason) in cases {
        let mut writer = Writer::open(&path, "{}").unwrap();
        writer.write_shard(0, &matrix.tiles[..4]).unwrap();
        writer.write_shard(1, &matrix.tiles[4..]).unwrap();
        let mut table = receivers(ROWS);
        harm(&mut table);
        let message = writer.finish(&about(&matrix, Width::I8), &table, None).unwrap_err().to_string();
        assert!(message.contains(reason), "{message}");
    }
}
