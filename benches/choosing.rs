//! Everything of a frame but the product, for a light that turns: resampling 1024 x 512 pixels to 6 x 64 x 64 texels,
//! the Haar transform, the grid, band tests and selection.
//!
//! `cargo bench --bench choosing`. A table of best, median and p95 comes first: every frame of it sees a light that it has
//! not seen before, on one thread and on two.

use std::f64::consts::TAU;
use std::hint::black_box;
use std::time::{Duration, Instant};

use _core::basis::haar::Haar;
use _core::light::{EnvironmentMap, Layout, Rows};
use _core::update::{Approximation, BandTest, Budget, Colours, Grid, Method, Norm, Settings, Span, light_norm};
use criterion::Criterion;

const SIZE: usize = 64;
const THREADS: [usize; 2] = [1, 2];
const FRAMES: usize = 200;
/// Degrees a frame: 45 in 100.
const SPEED: f64 = 0.45;
/// Rows of M whose norm is at most 2^3, in units of 2^-17: those of the plant.
const ROWS: Span = Span(20);

const PBI: fn(BandTest) -> Method = |test| Method::PerBand { test, norm: Norm::L1 };

fn methods() -> [(&'static str, Method, usize); 5] {
    [
        ("PBI-30 simple", PBI(BandTest::Simple), 30),
        ("PBI-30 dealer", PBI(BandTest::Dealer), 30),
        ("PBI-30 exhaustive", PBI(BandTest::Exhaustive), 30),
        ("NWA-100", Method::Nonlinear, 100),
        ("BI-30", Method::Incremental, 30),
    ]
}

/// A hall: smooth walls, windows with sharp edges, and lamps of a few pixels that are a thousand times as bright.
fn hall() -> EnvironmentMap {
    let (width, height) = (1024, 512);
    let pixel = |k: usize| {
        let (u, v) = ((k % width) as f64 / width as f64, (k / width) as f64 / height as f64);
        let wall = 0.4 + 0.2 * (3.0 * TAU * u).sin() * (5.0 * TAU * v).cos() + 0.1 * (41.0 * TAU * u).cos();
        let window = if (8.0 * u).fract() < 0.3 && (0.25..0.45).contains(&v) { 6.0 } else { 0.0 };
        let lamp = if k.is_multiple_of(97) && (k / width) % 53 < 2 { 400.0 } else { 0.0 };
        [wall + window + lamp, 0.9 * wall + 1.1 * window + 0.8 * lamp, 0.7 * wall + 1.3 * window + 0.5 * lamp]
            .map(|value| value as f32)
    };
    let pixels = (0..width * height).map(pixel).collect();
    EnvironmentMap::new(Layout::LatLong { width, height, rows: Rows::Centre }, pixels).expect("finite pixels")
}

/// The turn about an axis that is no axis of the cube.
fn rotation(frame: usize) -> [[f64; 3]; 3] {
    let (sin, cos) = (SPEED * frame as f64).to_radians().sin_cos();
    let (tilt_sin, tilt_cos) = 0.3f64.sin_cos();
    [[cos, 0.0, sin], [tilt_sin * sin, tilt_cos, -tilt_sin * cos], [-tilt_cos * sin, tilt_sin, tilt_cos * cos]]
}

fn resampled(map: &EnvironmentMap, frame: usize) -> Vec<[f32; 3]> {
    let mut radiance = vec![[0.0; 3]; 6 * SIZE * SIZE];
    map.resample(SIZE, &rotation(frame), [1.0; 3], &mut radiance);
    radiance
}

fn approximation(haar: &Haar, method: Method, terms: usize) -> Approximation {
    let bands = _core::basis::ColumnSpace::haar(haar.size()).expect("a power of two").bands();
    let settings = Settings {
        method,
        budget: Budget::Terms(terms),
        weights: bands.areas.clone(),
        costs: Vec::new(),
        colours: Colours::Joint,
    };
    Approximation::new(bands, settings).expect("valid settings")
}

fn grid(light: &[[f64; 3]]) -> Grid {
    Grid::for_light(2.125 * 2.0 * light_norm(light), ROWS, 6).expect("sane light")
}

/// Milliseconds of the parts of every frame: resampling, transform, grid, tests with selection.
fn frame_times(map: &EnvironmentMap, haar: &Haar, method: Method, terms: usize) -> Vec<[f64; 4]> {
    let mut follow = approximation(haar, method, terms);
    let grid = grid(&haar.forward(&resampled(map, 0)));
    let mut times = Vec::new();
    for frame in 0..FRAMES {
        let start = Instant::now();
        let radiance = resampled(map, frame);
        let resampling = Instant::now();
        let light = haar.forward(&radiance);
        let transform = Instant::now();
        let target = grid.quantise_all(&light);
        let quantise = Instant::now();
        black_box(follow.step(&target).expect("finite light"));
        let marks = [start, resampling, transform, quantise, Instant::now()];
        times.push(std::array::from_fn(|k| 1e3 * (marks[k + 1] - marks[k]).as_secs_f64()));
    }
    times.split_off(FRAMES / 10)
}

/// Best, median and p95 of a number that every frame has.
fn percentiles(times: &[[f64; 4]], number: impl Fn(&[f64; 4]) -> f64) -> [f64; 3] {
    let mut numbers: Vec<f64> = times.iter().map(number).collect();
    numbers.sort_by(f64::total_cmp);
    [0, numbers.len() / 2, numbers.len() * 95 / 100].map(|k| numbers[k])
}

fn print_percentiles(map: &EnvironmentMap, haar: &Haar) {
    let heads = ["resampling", "transform", "grid", "test + selection", "the last three", "all four"];
    print!("{:18} {:>7} ", "ms: best p50 p95", "threads");
    heads.iter().for_each(|head| print!("{head:>21}"));
    println!();
    for threads in THREADS {
        for (name, method, terms) in methods() {
            let times = in_pool(threads, || frame_times(map, haar, method, terms));
            print!("{name:18} {threads:7} ");
            for k in 0..heads.len() {
                let number = |parts: &[f64; 4]| match k {
                    4 => parts[1..].iter().sum(),
                    5 => parts.iter().sum(),
                    part => parts[part],
                };
                let [best, p50, p95] = percentiles(&times, number);
                print!("{best:9.3}{p50:6.3}{p95:6.3}");
            }
            println!();
        }
    }
}

fn in_pool<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads").install(work)
}

fn bench_light(criterion: &mut Criterion, map: &EnvironmentMap, haar: &Haar) {
    let mut group = criterion.benchmark_group("light");
    for threads in THREADS {
        let mut frame = 0;
        group.bench_function(format!("resampling/{threads}"), |bencher| {
            in_pool(threads, || {
                bencher.iter(|| {
                    frame += 1;
                    resampled(map, frame)
                });
            });
        });
        let radiance = resampled(map, 1);
        group.bench_function(format!("transform/{threads}"), |bencher| {
            in_pool(threads, || bencher.iter(|| haar.forward(&radiance)));
        });
    }
    let light = haar.forward(&resampled(map, 1));
    let grid = grid(&light);
    group.bench_function("grid", |bencher| bencher.iter(|| grid.quantise_all(&light)));
}

fn bench_choosing(criterion: &mut Criterion, map: &EnvironmentMap, haar: &Haar) {
    // A light that goes to and fro, a few frames apart: bands are reset, and none converges.
    let lights: Vec<Vec<[f64; 3]>> = (0..20).map(|frame| haar.forward(&resampled(map, 4 * frame))).collect();
    let mut group = criterion.benchmark_group("choosing");
    for (name, method, terms) in methods() {
        let mut follow = approximation(haar, method, terms);
        let mut lights = lights.iter().chain(lights.iter().rev()).cycle();
        group.bench_function(name, |bencher| {
            bencher.iter(|| follow.step(lights.next().expect("a cycle")).expect("finite light"));
        });
    }
}

fn main() {
    let map = hall();
    let haar = Haar::new(SIZE).expect("a power of two");
    print_percentiles(&map, &haar);
    let mut criterion = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_secs(1))
        .configure_from_args();
    bench_light(&mut criterion, &map, &haar);
    bench_choosing(&mut criterion, &map, &haar);
    criterion.final_summary();
}
