//! Occlusion rays of the precomputation: in fans of 64 directions, as segments, one ray at a time, and without AVX2. A wavy ground under a field of needles; `benches/peers_rays.py` holds real scenes against Embree.

// Of this only the random numbers: the transports are for the other benchmarks.
#[allow(dead_code)]
mod common;

use std::hint::black_box;

use _core::scene::Mesh;
use _core::scene::rays::{Apex, FAN, Fan, LIFT, Octant, Tracer, Walk, walk};
use common::Random;
use criterion::{Criterion, Throughput};

/// Squares along a side of the ground, and needles on it.
const GROUND: usize = 128;
const NEEDLES: usize = 20_000;
const POINTS: usize = 4096;

fn ground(x: f64, z: f64) -> f64 {
    0.02 * ((9.0 * x).sin() + (7.0 * z).cos())
}

fn scene(random: &mut Random) -> Mesh {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    let at = |k: usize| 2.0 * k as f64 / GROUND as f64 - 1.0;
    for (row, column) in (0..=GROUND).flat_map(|row| (0..=GROUND).map(move |column| (row, column))) {
        vertices.push([at(column), ground(at(column), at(row)), at(row)]);
        if row < GROUND && column < GROUND {
            let corner = (row * (GROUND + 1) + column) as u32;
            let below = corner + GROUND as u32 + 1;
            triangles.extend([[corner, below, corner + 1], [corner + 1, below, below + 1]]);
        }
    }
    for _ in 0..NEEDLES {
        let (x, z) = (2.0 * random.unit() - 1.0, 2.0 * random.unit() - 1.0);
        let first = vertices.len() as u32;
        let tip = [x + 0.05 * random.unit(), ground(x, z) + 0.1 + 0.2 * random.unit(), z + 0.05 * random.unit()];
        vertices.extend([[x, ground(x, z), z], [x + 0.004, ground(x, z), z + 0.003], tip]);
        triangles.push([first, first + 1, first + 2]);
    }
    Mesh::new(&vertices, &triangles).expect("a valid scene")
}

/// A receiver on the ground.
fn apex(mesh: &Mesh, random: &mut Random) -> Apex {
    let (x, z) = (1.6 * random.unit() - 0.8, 1.6 * random.unit() - 0.8);
    let origin = mesh.normalised([x, ground(x, z) + 0.001 + LIFT / mesh.scale, z]);
    Apex { origin, normal: [0.0, 1.0, 0.0] }
}

/// 8 x 8 neighbouring texels of a 6 x 64 x 64 cubemap, above the horizon.
fn block(random: &mut Random) -> Vec<[f32; 3]> {
    let (s, t) = (0.75 * random.unit(), 0.75 * random.unit());
    let texel = |k: usize| {
        let d = [s + (k % 8) as f64 / 32.0, 1.0, t + (k / 8) as f64 / 32.0];
        let length = d.iter().map(|x| x * x).sum::<f64>().sqrt();
        d.map(|x| (x / length) as f32)
    };
    (0..FAN).map(texel).collect()
}

/// A fan of them, each ray ending `far` up its axis.
fn fan(directions: &[[f32; 3]], far: f32) -> Fan {
    let octant = Octant::of(directions[0]);
    let mut fan = Fan::new(octant);
    directions.iter().for_each(|&direction| fan.push_segment(octant.slopes(direction), far));
    fan
}

fn main() {
    let mut random = Random(5);
    let mesh = scene(&mut random);
    let tracer = Tracer::new(&mesh);
    let work: Vec<_> = (0..POINTS)
        .map(|_| {
            let directions = block(&mut random);
            (apex(&mesh, &mut random), fan(&directions, f32::INFINITY), fan(&directions, 0.5), directions)
        })
        .collect();
    let mut room = Walk::default();

    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group("rays");
    group.sample_size(10).throughput(Throughput::Elements((POINTS * FAN) as u64));
    group.bench_function("fans", |bencher| {
        bencher.iter(|| {
            work.iter().for_each(|(from, fan, ..)| {
                black_box(tracer.blocked(from, fan, fan.all(), &mut room));
            })
        });
    });
    group.bench_function("fans of segments", |bencher| {
        bencher.iter(|| {
            work.iter().for_each(|(from, _, fan, _)| {
                black_box(tracer.blocked(from, fan, fan.all(), &mut room));
            })
        });
    });
    group.bench_function("fans, portable", |bencher| {
        bencher.iter(|| {
            work.iter().for_each(|(from, fan, ..)| {
                black_box(walk::blocked_portable(tracer.wide(), from, fan, fan.all(), &mut room));
            })
        });
    });
    group.bench_function("one ray", |bencher| {
        bencher.iter(|| {
            for (from, .., directions) in &work {
                for &direction in directions {
                    black_box(tracer.occluded(from.origin, direction));
                }
            }
        });
    });
    group.finish();
    criterion.final_summary();
}
