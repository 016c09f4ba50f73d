//! Spherical harmonics: orthonormal by quadrature, rotated as functions are, projected as the map is.

use std::f64::consts::PI;

use _core::basis::ColumnSpace;
use _core::basis::cubemap::{solid_angles, texel_direction};
use _core::basis::spherical_harmonics::{Rotation, SphericalHarmonics, degree_and_m, index, windowed};
use _core::basis::{HARMONIC_FACE, HarmonicProjection};
use _core::light::{EnvironmentMap, Layout};
use proptest::prelude::*;

type Matrix = [[f64; 3]; 3];

const ORDER: usize = 30;
const IDENTITY: Matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn evaluate(order: usize, direction: [f64; 3]) -> Vec<f64> {
    let mut values = vec![f64::NAN; order * order];
    SphericalHarmonics::new(order).unwrap().evaluate(direction, &mut values);
    values
}

/// A unit direction from two numbers in [0, 1].
fn direction(u: f64, v: f64) -> [f64; 3] {
    let (z, phi) = (1.0 - 2.0 * u, 2.0 * PI * v);
    let flat = (1.0 - z * z).max(0.0).sqrt();
    [flat * phi.cos(), flat * phi.sin(), z]
}

/// The rotation by the right-hand rule about a unit axis (Rodrigues).
fn turn([x, y, z]: [f64; 3], angle: f64) -> Matrix {
    let (s, c) = angle.sin_cos();
    let k = 1.0 - c;
    [
        [c + k * x * x, k * x * y - s * z, k * x * z + s * y],
        [k * x * y + s * z, c + k * y * y, k * y * z - s * x],
        [k * x * z - s * y, k * y * z + s * x, c + k * z * z],
    ]
}

fn apply(matrix: &Matrix, d: [f64; 3]) -> [f64; 3] {
    matrix.map(|row| row[0] * d[0] + row[1] * d[1] + row[2] * d[2])
}

fn transpose(matrix: &Matrix) -> Matrix {
    std::array::from_fn(|row| std::array::from_fn(|column| matrix[column][row]))
}

fn turns() -> impl Strategy<Value = Matrix> {
    let any_turn = (0.0..1.0f64, 0.0..1.0f64, -7.0..7.0f64).prop_map(|(u, v, angle)| turn(direction(u, v), angle));
    let quarter = (0..3usize, -4..5i32).prop_map(|(axis, quarters)| {
        let unit = std::array::from_fn(|k| f64::from(k == axis));
        turn(unit, f64::from(quarters) * PI / 2.0)
    });
    (prop_oneof![any_turn, quarter], any::<bool>())
        .prop_map(|(turn, mirror)| if mirror { turn.map(|[x, y, z]| [-x, y, z]) } else { turn })
}

/// Coefficients of order n, in [-1, 1], from a seed.
fn coefficients(order: usize, seed: u64) -> Vec<[f64; 3]> {
    let mut state = seed | 1;
    let mut random = move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    (0..order * order).map(|_| [random(), random(), random()]).collect()
}

fn norm(coefficients: &[[f64; 3]]) -> f64 {
    coefficients.as_flattened().iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn distance(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    let apart = a.iter().zip(b).map(|(a, b)| [0, 1, 2].map(|c| a[c] - b[c]));
    norm(&apart.collect::<Vec<_>>())
}

/// Gauss-Legendre points and weights on [-1, 1], by Newton's method.
fn gauss(points: usize) -> Vec<(f64, f64)> {
    let n = points as f64;
    (0..points)
        .map(|k| {
            let mut x = (PI * (k as f64 + 0.75) / (n + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..50 {
                let (mut now, mut before) = (1.0, 0.0);
                for l in 1..=points {
                    let l = l as f64;
                    (now, before) = (((2.0 * l - 1.0) * x * now - (l - 1.0) * before) / l, now);
                }
                slope = n * (x * now - before) / (x * x - 1.0);
                x -= now / slope;
            }
            (x, 2.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}

/// <Y_j, Y_k> = δ_jk up to order 30: Gauss in z, even steps in φ, exact for products of two functions of degree 29.
#[test]
fn orthonormal_to_the_last() {
    let (columns, harmonics) = (ORDER * ORDER, SphericalHarmonics::new(ORDER).unwrap());
    let mut values = vec![0.0; columns];
    let mut gram = vec![0.0; columns * columns];
    for (z, weight) in gauss(ORDER) {
        for step in 0..2 * ORDER {
            let d = direction((1.0 - z) / 2.0, (step as f64 + 0.3) / (2 * ORDER) as f64);
            harmonics.evaluate(d, &mut values);
            let weight = weight * 2.0 * PI / (2 * ORDER) as f64;
            for (j, row) in gram.chunks_exact_mut(columns).enumerate() {
                let scaled = weight * values[j];
                row.iter_mut().zip(&values).for_each(|(sum, value)| *sum += scaled * value);
            }
        }
    }
    let worst = (0..columns * columns).map(|at| (gram[at] - f64::from(at % columns == at / columns)).abs());
    let worst = worst.fold(0.0, f64::max);
    println!("orthonormality to {worst:e}");
    assert!(worst < 1e-12, "{worst:e}");
}

/// By hand: Y_0 = sqrt(1/4π), Y_1 = sqrt(3/4π) (y, z, x), Y_2^{-2, 0, 2} = sqrt(15/4π) xy, sqrt(5/16π) (3z² - 1),
/// sqrt(15/16π) (x² - y²).
#[test]
fn first_functions_by_hand() {
    let [x, y, z] = [0.48, -0.6, 0.64];
    let values = evaluate(3, [x, y, z]);
    let root = |x: f64| (x / PI).sqrt();
    let expected = [
        (0, root(0.25)),
        (1, root(0.75) * y),
        (2, root(0.75) * z),
        (3, root(0.75) * x),
        (4, root(15.0 / 4.0) * x * y),
        (6, root(5.0 / 16.0) * (3.0 * z * z - 1.0)),
        (8, root(15.0 / 16.0) * (x * x - y * y)),
    ];
    for (column, value) in expected {
        assert!((values[column] - value).abs() < 1e-15, "column {column}: {} for {value}", values[column]);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// The addition theorem: Σ_m Y_l^m(a) Y_l^m(b) = (2l + 1) / 4π P_l(a·b), poles included.
    #[test]
    fn addition_theorem(u in prop_oneof![Just(0.0), Just(1.0), 0.0..1.0f64], v in 0.0..1.0f64, s in 0.0..1.0f64, t in 0.0..1.0f64) {
        let (a, b) = (direction(u, v), direction(s, t));
        let (of_a, of_b) = (evaluate(ORDER, a), evaluate(ORDER, b));
        let cosine: f64 = (0..3).map(|k| a[k] * b[k]).sum();
        let (mut now, mut before) = (1.0, 0.0);
        for l in 0..ORDER {
            let own = l * l..(l + 1) * (l + 1);
            let sum: f64 = own.map(|j| of_a[j] * of_b[j]).sum();
            prop_assert!((sum - (2 * l + 1) as f64 / (4.0 * PI) * now).abs() < 2e-13 * (2 * l + 1) as f64, "degree {l}");
            (now, before) = (((2 * l + 1) as f64 * cosine * now - l as f64 * before) / (l + 1) as f64, now);
        }
    }

    /// f'(d) = f(R^-1 d), for mirrors too; the norm of every degree stays.
    #[test]
    fn rotated_coefficients_are_the_rotated_function(matrix in turns(), order in 1..=ORDER, seed in any::<u64>(), u in 0.0..1.0f64, v in 0.0..1.0f64) {
        let original = coefficients(order, seed);
        let rotated = Rotation::new(order, &matrix).unwrap().apply(&original);
        let d = direction(u, v);
        let (here, there) = (evaluate(order, d), evaluate(order, apply(&transpose(&matrix), d)));
        for channel in 0..3 {
            let turned: f64 = rotated.iter().zip(&here).map(|(c, y)| c[channel] * y).sum();
            let expected: f64 = original.iter().zip(&there).map(|(c, y)| c[channel] * y).sum();
            prop_assert!((turned - expected).abs() < 1e-13 * (order * order) as f64, "{turned} for {expected}");
        }
        for l in 0..order {
            let own = l * l..(l + 1) * (l + 1);
            let (before, after) = (norm(&original[own.clone()]), norm(&rotated[own]));
            prop_assert!((before - after).abs() < 1e-12 * before);
        }
    }

    /// And back.
    #[test]
    fn rotations_invert(matrix in turns(), seed in any::<u64>()) {
        let original = coefficients(ORDER, seed);
        let rotated = Rotation::new(ORDER, &matrix).unwrap().apply(&original);
        let back = Rotation::new(ORDER, &transpose(&matrix)).unwrap().apply(&rotated);
        prop_assert!(distance(&back, &original) < 1e-12 * norm(&original));
    }

    /// The folded projection is Σ_p L_p ∫_p Y dω, here with 8 x 8 midpoints a texel.
    #[test]
    fn projection_is_the_integral(half in 1..4usize, seed in any::<u64>()) {
        let (order, size, fine) = (6, 2 * half, 8);
        let texels = 6 * size * size;
        let radiance: Vec<[f32; 3]> = coefficients(30, seed)[..texels].iter().map(|c| c.map(|x| x as f32)).collect();
        let areas = solid_angles(size * fine);
        let mut expected = vec![[0.0; 3]; order * order];
        for face in 0..6 {
            for (k, area) in areas.iter().enumerate() {
                let (row, column) = (k / (size * fine), k % (size * fine));
                let values = evaluate(order, texel_direction(size * fine, face, row, column));
                let colour = radiance[(face * size + row / fine) * size + column / fine];
                for (sum, value) in expected.iter_mut().zip(&values) {
                    (0..3).for_each(|c| sum[c] += area * value * f64::from(colour[c]));
                }
            }
        }
        let projected = HarmonicProjection::new(order, size).unwrap().forward(&radiance);
        prop_assert!(distance(&projected, &expected) < 0.01 * norm(&expected), "{}", distance(&projected, &expected) / norm(&expected));
    }

    /// Sixteen rows in f32 are the light's projection in f64, to f32 rounding.
    #[test]
    fn sixteen_lanes(seed in any::<u64>(), order in 1..8usize) {
        let size = 16;
        let texels: Vec<[f32; 16]> = (0..6 * size * size)
            .map(|p| std::array::from_fn(|lane| ((p * 31 + lane * 17) as u64 ^ seed) as f32 % 101.0 / 50.0 - 1.0))
            .collect();
        let projection = HarmonicProjection::new(order, size).unwrap();
        let (mut folded, mut got) = (Vec::new(), vec![[f32::NAN; 16]; order * order]);
        projection.project(&texels, &mut folded, &mut got);
        for lane in [0, 7, 15] {
            let one: Vec<[f32; 3]> = texels.iter().map(|lanes| [lanes[lane]; 3]).collect();
            for (wide, narrow) in got.iter().zip(projection.forward(&one)) {
                prop_assert!((f64::from(wide[lane]) - narrow[0]).abs() < 2e-6 * norm(&projection.forward(&one)).max(1.0));
            }
        }
    }
}

/// A constant sky is its Y_0 and nothing else; the integrals of texels are exact to rounding.
#[test]
fn a_constant_sky_is_one_coefficient() {
    let projected = HarmonicProjection::new(ORDER, 16).unwrap().forward(&vec![[1.0; 3]; 6 * 16 * 16]);
    assert!((projected[0][1] - (4.0 * PI).sqrt()).abs() < 1e-13);
    let rest = projected[1..].as_flattened().iter().fold(0.0f64, |most, x| most.max(x.abs()));
    println!("constant sky leaks {rest:e}");
    assert!(rest < 1e-9, "{rest:e}");
}

/// Rotate then project = project then rotate, but for the resampling of the light; a quarter turn resamples nothing.
#[test]
fn rotating_the_light_is_rotating_its_coefficients() {
    let order = 10;
    let harmonics = SphericalHarmonics::new(6).unwrap();
    let mut values = vec![0.0; 36];
    let mut smooth = |k: usize| {
        let n = HARMONIC_FACE;
        harmonics.evaluate(texel_direction(n, k / (n * n), k / n % n, k % n), &mut values);
        let gray = 2.0 + values.iter().zip(coefficients(6, 7)).map(|(y, c)| y * c[0] * 0.1).sum::<f64>();
        [gray as f32, 1.0 - gray as f32, 0.5]
    };
    let texels: Vec<[f32; 3]> = (0..6 * HARMONIC_FACE * HARMONIC_FACE).map(&mut smooth).collect();
    let map = EnvironmentMap::new(Layout::Cubemap { size: HARMONIC_FACE }, texels).unwrap();
    for (matrix, most) in
        [(IDENTITY, 1e-14), (turn([0.0, 1.0, 0.0], PI / 2.0), 1e-7), (turn([0.6, 0.0, 0.8], 0.7), 1e-3)]
    {
        let mut turned = vec![[0.0; 3]; order * order];
        map.project(order, &matrix, [1.0; 3], &mut turned).unwrap();
        let mut radiance = vec![[0.0; 3]; 6 * HARMONIC_FACE * HARMONIC_FACE];
        map.resample(HARMONIC_FACE, &matrix, [1.0; 3], &mut radiance);
        let projected = HarmonicProjection::shared(order).unwrap().forward(&radiance);
        let error = distance(&turned, &projected) / norm(&projected);
        println!("rotate then project against project then rotate: {error:e}");
        assert!(error < most, "{error:e} for {most:e}");
    }
}

/// Ten thousand half degrees from the originals: the last is as right as the first (composed, errors add up).
#[test]
fn always_from_the_originals() {
    let original = coefficients(20, 3);
    let at = |step: usize| {
        let matrix = turn([0.0, 1.0, 0.0], (step as f64 * 0.5).to_radians());
        Rotation::new(20, &matrix).unwrap().apply(&original)
    };
    assert!((norm(&at(10_000)) / norm(&original) - 1.0).abs() < 1e-13);
    assert!(distance(&at(720), &original) < 1e-12 * norm(&original));
}

/// The window is linear in the coefficients, leaves Y_0 alone, ends at its width, and takes most of the ringing away.
#[test]
fn window() {
    let ones = vec![[1.0, 2.0, -1.0]; 25];
    let soft = windowed(&ones, 4.0).unwrap();
    for (column, value) in soft.iter().enumerate() {
        let (l, m) = degree_and_m(column);
        assert_eq!(index(l, m), column);
        let factor = if l < 4 { (PI * l as f64 / 8.0).cos().powi(2) } else { 0.0 };
        assert_eq!(*value, ones[column].map(|x| x * factor));
    }
    // A delta light on the axis, seen from all sides.
    let delta: Vec<[f64; 3]> = evaluate(5, [0.0, 0.0, 1.0]).iter().map(|&y| [y; 3]).collect();
    let least = |coefficients: &[[f64; 3]]| {
        let at = |k: usize| evaluate(5, direction(k as f64 / 100.0, 0.0));
        let light = |k: usize| at(k).iter().zip(coefficients).map(|(y, c)| y * c[0]).sum::<f64>();
        (0..=100).map(light).fold(f64::INFINITY, f64::min) / light(0)
    };
    assert!(least(&windowed(&delta, 5.0).unwrap()) > 0.4 * least(&delta) && least(&delta) < -0.1);
    for width in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(windowed(&ones, width).is_err());
    }
}

#[test]
fn names_and_bands() {
    let space: ColumnSpace = "sh:20".parse().unwrap();
    assert_eq!((space.to_string().as_str(), space.columns()), ("sh:20", 400));
    let bands = space.bands();
    assert_eq!((bands.count(), bands.columns(), bands.range(19)), (20, 400, 361..400));
    for text in ["sh:0", "sh:31", "sh", "sh:x", "sh:-1", "zh:5"] {
        assert!(text.parse::<ColumnSpace>().is_err(), "{text}");
    }
    assert!(HarmonicProjection::new(4, 7).is_err() && HarmonicProjection::new(4, 0).is_err());
}
