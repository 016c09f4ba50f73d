//! B = M V on a transport of 512 x 512 receivers and 24,576 columns: frames of each method, and the whole product.
//!
//! `cargo bench --bench multiply`. A table of p50 and p95 comes first: a frame is judged by its slowest, too. Cold frames
//! change their columns each time, after 64 MB of other data went through the caches; warm ones repeat their columns.

mod common;

use std::hint::black_box;
use std::time::{Duration, Instant};

use _core::transport::TransportMatrix;
use _core::update::{Response, Span, Term, Update, multiply};
use common::Random;
use criterion::Criterion;

const ROWS: usize = 512 * 512;
const TILE_ROWS: usize = 16384;
const THREADS: [usize; 2] = [1, 2];
/// Coefficients are multiples of this: a grid on which the sums are exact.
const SPACING: f64 = 1.0 / (1u64 << 20) as f64;

/// A method's frame: how many terms of each band, coarse to fine, and which bands are reset.
struct Frame {
    name: &'static str,
    terms: [usize; 6],
    resets: &'static [usize],
}

const FRAMES: [Frame; 4] = [
    Frame { name: "PBI-30", terms: [4, 6, 8, 6, 4, 2], resets: &[4, 5] },
    Frame { name: "NWA-30", terms: [16, 13, 1, 0, 0, 0], resets: &[0, 1, 2, 3, 4, 5] },
    Frame { name: "NWA-100", terms: [24, 50, 22, 4, 0, 0], resets: &[0, 1, 2, 3, 4, 5] },
    Frame { name: "NWA-300", terms: [24, 72, 140, 50, 14, 0], resets: &[0, 1, 2, 3, 4, 5] },
];

impl Frame {
    fn update(&self, matrix: &TransportMatrix, random: &mut Random) -> Update {
        let change = |random: &mut Random| (1 + random.next() % 1000) as f64 * SPACING;
        let terms: Vec<Term> = common::columns(matrix, &self.terms, random)
            .into_iter()
            .map(|column| Term { column, change: [change(random), -change(random), change(random)] })
            .collect();
        // As from a state in which the reset bands held nothing: what is measured is the streaming of the terms.
        let afresh = self.resets.len() == self.terms.len();
        Update { resets: self.resets.to_vec(), moves: terms.clone(), terms, afresh }
    }
}

/// Milliseconds of each of `count` frames.
fn frame_times(matrix: &TransportMatrix, frame: &Frame, cold: bool, count: usize) -> Vec<f64> {
    let mut random = Random(3);
    let mut response = Response::new(matrix);
    let mut rows = vec![0.0; 3 * matrix.rows];
    let mut other = vec![1u64; 64 << 17];
    let mut update = frame.update(matrix, &mut random);
    let mut times = Vec::new();
    for _ in 0..count {
        if cold {
            update = frame.update(matrix, &mut random);
            black_box(&mut other).iter_mut().for_each(|x| *x += 1);
        }
        let start = Instant::now();
        response.apply(matrix, &update, Some(&mut rows)).expect("a valid update");
        times.push(1e3 * start.elapsed().as_secs_f64());
    }
    times.sort_by(f64::total_cmp);
    times
}

fn print_percentiles(matrix: &TransportMatrix) {
    println!("{:10} {:>7} {:>5} {:>8} {:>8} {:>8}", "frame", "threads", "", "best ms", "p50", "p95");
    for threads in THREADS {
        for frame in &FRAMES {
            for cold in [true, false] {
                let times = in_pool(threads, || frame_times(matrix, frame, cold, 60));
                let state = if cold { "cold" } else { "warm" };
                let [best, p50, p95] = [0, times.len() / 2, times.len() * 95 / 100].map(|k| times[k]);
                println!("{:10} {threads:7} {state:>5} {best:8.3} {p50:8.3} {p95:8.3}", frame.name);
            }
        }
    }
}

fn in_pool<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads").install(work)
}

fn bench_frames(criterion: &mut Criterion, matrix: &TransportMatrix) {
    let mut group = criterion.benchmark_group("frame");
    for threads in THREADS {
        for frame in &FRAMES {
            let mut response = Response::new(matrix);
            let mut rows = vec![0.0; 3 * matrix.rows];
            let update = frame.update(matrix, &mut Random(3));
            group.bench_function(format!("{}/{threads}", frame.name), |bencher| {
                in_pool(threads, || bencher.iter(|| response.apply(matrix, &update, Some(&mut rows))));
            });
        }
    }
}

fn bench_products(criterion: &mut Criterion, matrix: &TransportMatrix) {
    let mut random = Random(5);
    let mut light = || -> Vec<[f64; 3]> {
        (0..matrix.bands.columns()).map(|_| [random.unit(), random.unit(), random.unit()]).collect()
    };
    let lights = [light(), light(), light(), light()];
    let span = Span::of(matrix);
    let mut group = criterion.benchmark_group("product");
    for threads in THREADS {
        for count in [1, 4] {
            let lights: Vec<&[[f64; 3]]> = lights[..count].iter().map(|light| &light[..]).collect();
            let mut rows = vec![0.0; count * 3 * matrix.rows];
            group.bench_function(format!("{count} lights/{threads}"), |bencher| {
                in_pool(threads, || bencher.iter(|| multiply(matrix, span, &lights, &mut rows)));
            });
        }
    }
}

fn main() {
    let matrix = common::matrix(ROWS, TILE_ROWS);
    let entries: usize = matrix.tiles.iter().map(|tile| tile.words.len()).sum();
    let state = Response::new(&matrix).nbytes();
    println!(
        "{entries} entries of 18 bytes: {:.0} MB; a response: {:.1} MB",
        entries as f64 * 18e-6,
        state as f64 * 1e-6
    );
    print_percentiles(&matrix);
    let mut criterion = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(2))
        .configure_from_args();
    bench_frames(&mut criterion, &matrix);
    bench_products(&mut criterion, &matrix);
    criterion.final_summary();
}
