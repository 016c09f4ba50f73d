#[path = "../benches/common/mod.rs"]
mod common;
use _core::update::*;
use common::*;
use std::time::Instant;
fn main() {
    let tr = std::env::args().nth(1).unwrap().parse().unwrap();
    let m = matrix(512 * 512, tr);
    let mut out = vec![0f32; m.rows * 3];
    let g = 2f64.powi(-20);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        for (n, r) in
            [("b0-2", 0..384usize), ("b3", 384..1536), ("b4", 1536..6144), ("b5", 6144..24576), ("all", 0..24576)]
        {
            let v: Vec<[f64; 3]> = (0..24576)
                .map(|i| if r.contains(&i) { [(i as f64 - 1e4 + 0.5) * g, g, (3 * i) as f64 * g] } else { [0.; 3] })
                .collect();
            let e: usize = m.tiles.iter().map(|t| (t.starts[r.end] - t.starts[r.start]) as usize).sum();
            let mut best = 1e9f64;
            for _ in 0..6 {
                let t = Instant::now();
                multiply(&m, RowNorm::of(&m), &[&v], &mut out).unwrap();
                best = best.min(t.elapsed().as_secs_f64() * 1e3);
            }
            print!("{n} {best:.1} ms {:.2} ns/e; ", best * 1e6 / e as f64);
        }
        println!();
    });
}
