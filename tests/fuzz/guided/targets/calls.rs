//! Bytes as lights and calls of a follower: every frame has the bits of a fresh product, and errors within its bound.
#![no_main]

use std::sync::{Arc, LazyLock};

use _core::basis::ColumnSpace;
use _core::transport::{Channels, Dense, Product, Truncation, Width};
use _core::update::{BandTest, Budget, Chain, Colours, Initial, Method, Norm, Settings, Updater};

const ROWS: usize = 40;

/// In 8 and 16 bits, and truncated, each with what it was made of.
static TRANSPORTS: LazyLock<Vec<(Arc<Chain>, Dense)>> = LazyLock::new(|| {
    let space = ColumnSpace::haar(2).unwrap();
    let made = |(width, threshold): (Width, f64)| {
        let mut state = 1u64;
        let mut number = || {
            state = state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(0x1405_7b7e_f767_814f);
            f64::from(((state >> 40) as f32 / (1 << 23) as f32 - 1.0) * 0.3)
        };
        let dense = Dense::new(ROWS, space.columns(), (0..ROWS * space.columns()).map(|_| number()).collect());
        let rule = Truncation::new(&space.bands(), threshold, -24, width).unwrap();
        let matrix = dense.compress(space, &rule, 16).unwrap();
        assert_eq!(matrix.channels, Channels::One);
        (Arc::new(Chain::new(Product::one(Arc::new(matrix)))), dense)
    };
    [(Width::I8, 0.0), (Width::I16, 0.0), (Width::I8, 0.05)].map(made).into()
});

const METHODS: [Method; 8] = [
    Method::Full,
    Method::Nonlinear,
    Method::Linear,
    Method::Incremental,
    Method::PerBand { test: BandTest::Simple, norm: Norm::L1 },
    Method::PerBand { test: BandTest::Simple, norm: Norm::L2 },
    Method::PerBand { test: BandTest::Dealer, norm: Norm::L1 },
    Method::PerBand { test: BandTest::Exhaustive, norm: Norm::L2 },
];

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let [which, method, budget, start, calls @ ..] = data else { return };
    let (chain, dense) = &TRANSPORTS[usize::from(*which) % TRANSPORTS.len()];
    let columns = dense.columns;
    let budget = match budget % 4 {
        0 => Budget::Cost(f64::from(budget / 4)),
        _ => Budget::Terms(usize::from(budget / 4)),
    };
    let settings = Settings {
        method: METHODS[usize::from(*method) % METHODS.len()],
        budget,
        weights: vec![1.0; columns],
        costs: (0..columns).map(|column| f64::from(method / 8) * (column % 3) as f64).collect(),
        colours: if start & 4 == 0 { Colours::Joint } else { Colours::Separate },
    };
    let initial = [Initial::Black, Initial::Full, Initial::Nonlinear][usize::from(start & 3) % 3];
    let Ok(mut follow) = Updater::new(Arc::clone(chain), settings, None, None, initial) else { return };
    let (mut light, mut refused) = (vec![[0.0; 3]; columns], 0);
    let (mut out, mut fresh, mut bounds) = (vec![0.0; 3 * ROWS], vec![0.0; 3 * ROWS], vec![0.0; 3 * ROWS]);
    // Nine bytes a call: what is done to which coefficient, and the bits of a number.
    for call in calls.chunks_exact(9).take(64) {
        let (kind, bits) = (call[0], f64::from_bits(u64::from_le_bytes(call[1..].try_into().unwrap())));
        let at = usize::from(kind / 8) % columns;
        let before = light.clone();
        match kind % 8 {
            0..4 => light[at][usize::from(kind % 8) % 3] = bits,
            4 => light[at] = [bits; 3],
            5 => light.iter_mut().flatten().for_each(|x| *x *= bits),
            6 => light.fill([0.0; 3]),
            _ => light.truncate(at),
        }
        let Ok(step) = follow.step(&light, &mut out) else {
            light = before;
            refused += 1;
            continue;
        };
        chain.multiply(&[follow.values()], None, &mut fresh).expect("what was applied can be multiplied");
        assert!(out == fresh, "other bits than a fresh product, after {refused} refusals");
        follow.bounds(step.number, &out, &mut bounds).unwrap();
        let exact = dense.multiply(light.as_flattened(), 3);
        for ((&found, &bound), exact) in out.iter().zip(&bounds).zip(exact) {
            // f64 has roundings of its own.
            let error = (f64::from(found) - exact).abs();
            assert!(error <= f64::from(bound) * (1.0 + 1e-9) || !exact.is_finite(), "{error} is beyond {bound}");
        }
    }
});
