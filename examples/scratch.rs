#[path = "../benches/common/mod.rs"]
mod common;
use _core::update::*;
use common::*;
use std::time::Instant;
fn flush(buf: &mut Vec<u64>) {
    for x in buf.iter_mut() {
        *x = x.wrapping_add(1);
    }
    std::hint::black_box(buf);
}
fn main() {
    let tile_rows: usize = std::env::args().nth(1).and_then(|x| x.parse().ok()).unwrap_or(8192);
    let m = matrix(512 * 512, tile_rows);
    let e: usize = m.tiles.iter().map(|t| t.words.len()).sum();
    println!("tile_rows {tile_rows} entries {:.2}M  {:.0} MB", e as f64 / 1e6, e as f64 * 18e-6);
    if std::env::args().nth(2).as_deref() == Some("dump") {
        use std::io::Write;
        let mut f = std::io::BufWriter::new(std::fs::File::create("/tmp/m.bin").unwrap());
        for t in &m.tiles {
            f.write_all(bytemuck::cast_slice(&t.starts)).unwrap();
        }
        for t in &m.tiles {
            f.write_all(bytemuck::cast_slice(&t.words)).unwrap();
        }
        for t in &m.tiles {
            if let _core::transport::Values::I8(v) = &t.values {
                f.write_all(bytemuck::cast_slice(v)).unwrap();
            }
        }
        return;
    }
    let mut buf = vec![1u64; 96 << 17];
    let mut out = vec![0f32; m.rows * 3];
    let g = 2f64.powi(-20);
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            for (name, counts, resets, _b) in [
                ("PBI-30 reset 5", vec![4, 6, 8, 6, 4, 2], vec![5usize], true),
                ("PBI-30 no image", vec![4, 6, 8, 6, 4, 2], vec![], false),
                ("PBI-30 reset 4,5", vec![4, 6, 8, 6, 4, 2], vec![4, 5], true),
                ("NWA-30 17,13", vec![16, 13, 1, 0, 0, 0], vec![0, 1, 2, 3, 4, 5], false),
                ("NWA-100", vec![24, 50, 22, 4, 0, 0], vec![0, 1, 2, 3, 4, 5], false),
                ("PBI-30 coarse", vec![8, 8, 8, 4, 2, 0], vec![5], true),
            ] {
                for cold in [true, false] {
                    let mut rnd = Random(3);
                    let mut r = Response::new(&m);
                    let mut ts = vec![];
                    let mut c = columns(&m, &counts, &mut rnd);
                    for i in 0..if cold { 25 } else { 60 } {
                        if cold {
                            flush(&mut buf);
                            c = columns(&m, &counts, &mut rnd);
                        }
                        let u = Update {
                            resets: resets.clone(),
                            terms: c
                                .iter()
                                .map(|&column| Term { column, change: [(1 + i) as f64 * g, -3. * g, 5. * g] })
                                .collect(),
                        };
                        let t = Instant::now();
                        r.apply(&m, &u, &mut out).unwrap();
                        ts.push(t.elapsed().as_secs_f64() * 1e3);
                    }
                    let tail = &mut ts[5..];
                    tail.sort_by(f64::total_cmp);
                    println!(
                        "{threads}T {name:18} {} min {:.3} p50 {:.3} p95 {:.3}",
                        if cold { "cold" } else { "warm" },
                        tail[0],
                        tail[tail.len() / 2],
                        tail[tail.len() * 95 / 100]
                    );
                }
            }
            let v: Vec<[f64; 3]> = (0..24576).map(|i| [(i as f64 - 1e4) * g, g, (3 * i) as f64 * g]).collect();
            let mut best = 1e9f64;
            for _ in 0..5 {
                let t = Instant::now();
                multiply(&m, RowNorm::of(&m), &[&v], &mut out).unwrap();
                best = best.min(t.elapsed().as_secs_f64() * 1e3);
            }
            println!("{threads}T multiply {best:.1}");
            let mut o4 = vec![0f32; 4 * m.rows * 3];
            let t = Instant::now();
            multiply(&m, RowNorm::of(&m), &[&v, &v, &v, &v], &mut o4).unwrap();
            println!("{threads}T multiply x4 {:.1}", t.elapsed().as_secs_f64() * 1e3);
        });
    }
}
