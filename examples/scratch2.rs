#[path = "../benches/common/mod.rs"]
mod common;
use _core::update::*;
use common::*;
fn main() {
    let m = matrix(std::env::args().nth(1).unwrap().parse().unwrap(), 8192);
    let mut out = vec![0f32; m.rows * 3];
    let mut rnd = Random(3);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        let mut r = Response::new(&m);
        let c = columns(&m, &[24, 50, 22, 4, 0, 0], &mut rnd);
        let u = Update {
            resets: vec![0, 1, 2, 3, 4, 5],
            terms: c.iter().map(|&column| Term { column, change: [1., 2., 3.] }).collect(),
        };
        for _ in 0..std::env::args().nth(2).unwrap().parse().unwrap() {
            r.apply(&m, &u, &mut out).unwrap();
        }
    });
}
