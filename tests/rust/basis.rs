//! Bases: the Haar transform against its explicit matrix, its norms, its round trip and its order of columns.

use _core::basis::ColumnSpace;
use _core::basis::cubemap::solid_angles;
use _core::basis::haar::Haar;
use proptest::prelude::*;

/// Any size that is allowed and small enough to look at.
fn sizes() -> impl Strategy<Value = usize> {
    (0u32..7).prop_map(|level| 1 << level)
}

/// A sequence of numbers in [0, 1) from a seed (a linear congruential generator: a test needs no better).
fn uniform(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Cubemaps of the kinds that break transforms: wide ranges, extremes of f32, a single texel.
fn cubemap(size: usize, kind: u8, seed: u64) -> Vec<[f32; 3]> {
    let mut random = uniform(seed);
    let texels = 6 * size * size;
    let hot = (random() * texels as f64) as usize;
    let mut normal = move || (0..12).map(|_| random()).sum::<f64>() - 6.0;
    (0..texels)
        .map(|texel| {
            std::array::from_fn(|_| match kind {
                0 => (5.0 * normal()).exp() as f32,
                1 => (1e38 * normal() / 6.0) as f32,
                2 => f32::from_bits((normal().abs() * 1000.0) as u32),
                _ => f32::from(texel == hot) * 1e5,
            })
        })
        .collect()
}

fn norm(values: impl Iterator<Item = f64>) -> f64 {
    values.map(|x| x * x).sum::<f64>().sqrt()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    /// inverse(forward(x)) = x to rounding, against the norm of the face (a hot texel's error spreads over its face).
    #[test]
    fn round_trip(size in sizes(), kind in 0u8..4, seed in any::<u64>()) {
        let (haar, light) = (Haar::new(size).unwrap(), cubemap(size, kind, seed));
        let back = haar.inverse(&haar.forward(&light));
        let roots: Vec<f64> = haar.roots().iter().copied().cycle().take(light.len()).collect();
        let error = norm((0..light.len()).flat_map(|p| [0, 1, 2].map(|c| (back[p][c] - light[p][c] as f64) * roots[p])));
        let size = norm((0..light.len()).flat_map(|p| [0, 1, 2].map(|c| light[p][c] as f64 * roots[p])));
        prop_assert!(error <= 2e-15 * size, "{error} against {size}");
    }

    /// Parseval on the sphere: Σ c² = Σ L² dω.
    #[test]
    fn parseval(size in sizes(), kind in 0u8..4, seed in any::<u64>()) {
        prop_assume!(kind != 2); // The squares of subnormal numbers vanish in f64 as well.
        let (haar, light) = (Haar::new(size).unwrap(), cubemap(size, kind, seed));
        let areas = solid_angles(size);
        let sphere: f64 = light.iter().zip(areas.iter().cycle()).map(|(l, a)| a * (l[0] as f64).powi(2)).sum();
        let sum: f64 = haar.forward(&light).iter().map(|c| c[0] * c[0]).sum();
        prop_assert!((sum - sphere).abs() <= 1e-12 * sphere);
    }

    /// Sixteen rows at once, in f32, are the f64 transform to f32 rounding; every column of the face is written.
    #[test]
    fn sixteen_lanes(size in sizes(), face in 0usize..6, seed in any::<u64>()) {
        let haar = Haar::new(size).unwrap();
        let mut random = uniform(seed);
        let mut wide: Vec<[f32; 16]> = (0..size * size).map(|_| std::array::from_fn(|_| random() as f32)).collect();
        let lane = (seed % 16) as usize;
        let mut narrow: Vec<f64> = wide.iter().map(|lanes| lanes[lane] as f64).collect();
        let mut got = vec![[f32::NAN; 16]; haar.columns()];
        let mut expected = vec![f64::NAN; haar.columns()];
        haar.forward_face(face, &mut wide, &mut got);
        haar.forward_face(face, &mut narrow, &mut expected);
        let scale = norm(expected.iter().copied().filter(|x| !x.is_nan()));
        prop_assert_eq!(expected.iter().filter(|x| !x.is_nan()).count(), size * size);
        for (g, e) in got.iter().zip(&expected) {
            prop_assert_eq!(g[lane].is_nan(), e.is_nan());
            prop_assert!(e.is_nan() || (g[lane] as f64 - e).abs() <= 1e-6 * scale);
        }
    }
}

/// The columns of the matrix, from one-hot vectors, have the identity as their Gram matrix.
#[test]
fn orthonormal() {
    for size in [1, 2, 4, 8] {
        let haar = Haar::new(size).unwrap();
        let columns: Vec<Vec<f64>> = (0..size * size)
            .map(|hot| {
                let mut texels: Vec<f64> = (0..size * size).map(|texel| f64::from(texel == hot)).collect();
                let mut coefficients = vec![0.0; haar.columns()];
                haar.forward_face(4, &mut texels, &mut coefficients);
                coefficients
            })
            .collect();
        for (i, a) in columns.iter().enumerate() {
            for (j, b) in columns.iter().enumerate() {
                let dot: f64 = a.iter().zip(b).map(|(x, y)| x * y).sum();
                assert!((dot - f64::from(i == j)).abs() < 8.0 * f64::EPSILON, "size {size}, <{i}, {j}> = {dot}");
            }
        }
    }
}

/// ∫ over a face of a constant 1 is 4π/6, so its scaling coefficient is sqrt(4π/6), and nothing else is left.
#[test]
fn a_constant_sky_needs_six_coefficients() {
    for size in [1, 2, 16, 64] {
        let coefficients = Haar::new(size).unwrap().forward(&vec![[1.0; 3]; 6 * size * size]);
        let expected = (4.0 * std::f64::consts::PI / 6.0).sqrt();
        for (column, value) in coefficients.iter().enumerate() {
            let expected = if column < 6 { expected } else { 0.0 };
            assert!((value[1] - expected).abs() < 1e-14, "column {column} of size {size}: {}", value[1]);
        }
    }
}

/// At size 2 the four texels of a face are congruent: the usual Haar, h = (a - b + c - d) / 2 and so on, in this order.
#[test]
fn equal_areas_give_the_usual_haar() {
    let haar = Haar::new(2).unwrap();
    let mut texels = [1.0, 2.0, 4.0, 8.0];
    let mut coefficients = vec![0.0; 24];
    haar.forward_face(3, &mut texels, &mut coefficients);
    let expected = [7.5, -2.5, 1.5, -4.5];
    let got = [coefficients[3], coefficients[6 + 9], coefficients[6 + 10], coefficients[6 + 11]];
    for (g, e) in got.iter().zip(expected) {
        assert!((g - e).abs() < 1e-14, "{got:?}");
    }
}

/// A column's support, found by inverting it, has the area that its band states, and stays on one face.
#[test]
fn columns_stand_in_their_bands() {
    let size = 8;
    let (haar, bands) = (Haar::new(size).unwrap(), ColumnSpace::haar(size).unwrap().bands());
    for column in 0..haar.columns() {
        let mut one = vec![[0.0; 3]; haar.columns()];
        one[column] = [1.0; 3];
        let support: Vec<usize> = (0..one.len()).filter(|&texel| haar.inverse(&one)[texel][0] != 0.0).collect();
        assert_eq!(support.len() as f64, bands.areas[column], "column {column}");
        assert_eq!(support[0] / (size * size), support[support.len() - 1] / (size * size));
    }
}

#[test]
fn other_sizes_are_refused() {
    for size in [0, 3, 48, 1024] {
        assert!(Haar::new(size).is_err());
    }
}
