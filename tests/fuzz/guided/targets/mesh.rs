//! Bytes as corners of triangles: a hundred rays among them, in fans, one by one and on the portable path, against brute
//! force.
#![no_main]

use _core::scene::Mesh;
use _core::scene::rays::{Apex, Tracer, Walk, fans, walk};

type Point = [f64; 3];

fn sub(a: Point, b: Point) -> Point {
    std::array::from_fn(|k| a[k] - b[k])
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// In extents of the mesh: what passes nearer to an edge, or begins nearer to a triangle, may fall on either side.
const NEAR: f64 = 1e-4;

/// Whether any triangle is met, and whether that is beyond doubt.
fn brute(mesh: &Mesh, origin: [f32; 3], way: [f32; 3]) -> (bool, bool) {
    let (o, d) = (origin.map(f64::from), way.map(f64::from));
    let (mut met, mut sure) = (false, true);
    for corners in &mesh.corners {
        let [a, b, c] = corners.map(|corner| corner.map(f64::from));
        let n = cross(sub(b, a), sub(c, a));
        let area = dot(n, n).sqrt();
        let slope = dot(n, d);
        if area < 1e-9 || slope.abs() < 1e-2 * area {
            // Edge on, or a needle: in doubt wherever its plane and its box are near the ray.
            sure = false;
            continue;
        }
        let t = dot(n, sub(a, o)) / slope;
        let at = std::array::from_fn(|k| o[k] + t * d[k]);
        let inside = [(a, b), (b, c), (c, a)].map(|(from, to)| {
            let side = sub(to, from);
            dot(cross(n, side), sub(at, from)) / (area * dot(side, side).sqrt())
        });
        let least = inside.into_iter().fold(f64::INFINITY, f64::min);
        if least < -NEAR || t < -NEAR {
            continue;
        }
        met |= least > NEAR && t > NEAR;
        sure &= least > NEAR && t > NEAR;
    }
    (met, met || sure)
}

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let [kind, seed, bytes @ ..] = data else { return };
    // On a grid of bytes, where all is degenerate, or of whatever bits.
    let numbers: Vec<f64> = match kind % 2 {
        0 => bytes.iter().map(|&byte| f64::from(byte as i8)).collect(),
        _ => bytes.chunks_exact(4).map(|four| f64::from(f32::from_le_bytes(four.try_into().unwrap()))).collect(),
    };
    let vertices: Vec<Point> = numbers.as_chunks::<3>().0.iter().copied().take(600).collect();
    let triangles: Vec<[u32; 3]> = (0..vertices.len() as u32 / 3).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    let Ok(mesh) = Mesh::new(&vertices, &triangles) else { return };
    let tracer = Tracer::new(&mesh);
    let mut state = u64::from(*seed) + 1;
    let mut number = || {
        state = state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(0x1405_7b7e_f767_814f);
        (state >> 40) as f32 / (1 << 23) as f32 - 1.0
    };
    let ways: Vec<[f32; 3]> = (0..10)
        .map(|_| {
            let way = [number(), number(), number()];
            let length = way.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-3);
            way.map(|x| x / length)
        })
        .filter(|way| way.iter().any(|x| x.abs() > 0.5))
        .collect();
    let mut room = Walk::default();
    for _ in 0..10 {
        let origin = [number(), number(), number()];
        let from = Apex { origin, normal: [0.0; 3] };
        for (fan, places) in fans(&ways) {
            let blocked = tracer.blocked(&from, &fan, fan.all(), &mut room);
            let portable = walk::blocked_portable(tracer.wide(), &from, &fan, fan.all(), &mut room);
            assert_eq!(blocked, portable, "the portable path");
            for (ray, &place) in places.iter().enumerate() {
                let found = blocked >> ray & 1 == 1;
                assert_eq!(tracer.blocked(&from, &fan, 1 << ray, &mut room) != 0, found, "one ray at a time");
                let (met, sure) = brute(&mesh, origin, ways[place]);
                assert!(!sure || met == found, "{origin:?} towards {:?}: {found}", ways[place]);
            }
        }
    }
});
