//! Light: cubemap geometry, and what resampling must keep (constants, flux, sign, orientation).

use std::f64::consts::PI;

use _core::basis::cubemap::{direction_to_face_uv, face_point, solid_angles, texel_centre, texel_direction, texel_of};
use _core::light::{Behind, EnvironmentMap, Layout, Rows};
use proptest::prelude::*;

type Matrix = [[f64; 3]; 3];

const IDENTITY: Matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// A rotation by `angle` about an axis (Rodrigues).
fn turn(axis: [f64; 3], angle: f64) -> Matrix {
    let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
    let [x, y, z] = axis.map(|a| a / length);
    let (s, c) = angle.sin_cos();
    let k = 1.0 - c;
    [
        [c + x * x * k, x * y * k - z * s, x * z * k + y * s],
        [y * x * k + z * s, c + y * y * k, y * z * k - x * s],
        [z * x * k - y * s, z * y * k + x * s, c + z * z * k],
    ]
}

/// Any rotation.
fn rotations() -> impl Strategy<Value = Matrix> {
    ([-1.0..1.0, -1.0..1.0, 0.1..1.0], 0.0..2.0 * PI).prop_map(|(axis, angle)| turn(axis, angle))
}

fn apply(matrix: &Matrix, d: [f64; 3]) -> [f64; 3] {
    matrix.map(|row| row[0] * d[0] + row[1] * d[1] + row[2] * d[2])
}

/// The 24 rotations of the cube: signed permutations with determinant 1.
fn cube_rotations() -> Vec<Matrix> {
    let mut all = Vec::new();
    for (x, y) in (0..3).flat_map(|x| (0..3).map(move |y| (x, y))).filter(|(x, y)| x != y) {
        for (sx, sy) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
            let (mut a, mut b) = ([0.0; 3], [0.0; 3]);
            (a[x], b[y]) = (sx, sy);
            let c = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
            all.push([a, b, c]);
        }
    }
    all
}

fn resampled(map: &EnvironmentMap, size: usize, rotation: &Matrix) -> Vec<[f32; 3]> {
    let mut radiance = vec![[0.0; 3]; 6 * size * size];
    map.resample(size, rotation, [1.0; 3], &mut radiance);
    radiance
}

/// Σ L dω of the red channel.
fn flux(radiance: &[[f32; 3]], size: usize) -> f64 {
    radiance.iter().zip(solid_angles(size).iter().cycle()).map(|(l, a)| l[0] as f64 * a).sum()
}

fn texel(size: usize, direction: [f64; 3]) -> usize {
    let (face, s, t) = direction_to_face_uv(direction);
    (face * size + texel_of(size, t)) * size + texel_of(size, s)
}

#[test]
fn solid_angles_fill_the_sphere() {
    for size in [1, 2, 3, 5, 64, 512] {
        let areas = solid_angles(size);
        assert!((6.0 * areas.iter().sum::<f64>() - 4.0 * PI).abs() < 1e-13 * 4.0 * PI, "size {size}");
        // The eight symmetries of the square, to the last bit.
        for (k, &area) in areas.iter().enumerate() {
            let (row, column) = (k / size, k % size);
            assert_eq!(area, areas[column * size + row]);
            assert_eq!(area, areas[row * size + size - 1 - column]);
        }
    }
    let areas = solid_angles(64);
    assert!((areas[32 * 64 + 32] / areas[0] - 5.03).abs() < 0.005);
}

/// Every texel's direction leads back to it, and the corner of +X at row 0, column 0 is (1, 1, 1), as in OpenGL.
#[test]
fn directions_and_texels() {
    for size in [1, 2, 7] {
        for k in 0..6 * size * size {
            let (face, row, column) = (k / (size * size), k / size % size, k % size);
            assert_eq!(texel(size, texel_direction(size, face, row, column)), k);
            let (s, t) = (texel_centre(size, column), texel_centre(size, row));
            assert_eq!(direction_to_face_uv(face_point(face, s, t)), (face, s, t));
        }
    }
    let corners = [[1., 1., 1.], [-1., 1., -1.], [-1., 1., -1.], [-1., -1., 1.], [-1., 1., 1.], [1., 1., -1.]];
    for (face, corner) in corners.into_iter().enumerate() {
        assert_eq!(face_point(face, -1.0, -1.0), corner);
    }
}

/// A texel of colour c at direction d is, after R, at R d: for all 24 rotations, texel by texel.
#[test]
fn cube_rotations_permute_texels() {
    let size = 8;
    let colour = |k: usize| [k as f32, (k * k % 97) as f32, -(k as f32)];
    let map = EnvironmentMap::new(Layout::Cubemap { size }, (0..6 * size * size).map(colour).collect()).unwrap();
    for rotation in cube_rotations() {
        let turned = resampled(&map, size, &rotation);
        for k in 0..6 * size * size {
            let direction = texel_direction(size, k / (size * size), k / size % size, k % size);
            let got = turned[texel(size, apply(&rotation, direction))];
            for (g, e) in got.iter().zip(colour(k)) {
                assert!((g - e).abs() <= 2e-6 * e.abs(), "texel {k}: {got:?} for {:?}", colour(k));
            }
        }
    }
}

/// The unrotated map is the box average: against a brute-force mean over a grid 16 times as fine.
#[test]
fn unrotated_is_the_area_average() {
    let (source, size) = (12, 4);
    let pixels: Vec<[f32; 3]> = (0..6 * source * source).map(|k| [(k * 7919 % 101) as f32; 3]).collect();
    let map = EnvironmentMap::new(Layout::Cubemap { size: source }, pixels.clone()).unwrap();
    let (got, areas) = (resampled(&map, size, &IDENTITY), solid_angles(source));
    for (k, value) in got.iter().enumerate() {
        let (face, row, column) = (k / (size * size), k / size % size, k % size);
        let (mut sum, mut area) = (0.0, 0.0);
        for part in 0..9 {
            let own = (3 * row + part / 3) * source + 3 * column + part % 3;
            sum += areas[own] * pixels[face * source * source + own][0] as f64;
            area += areas[own];
        }
        assert!((value[0] as f64 - sum / area).abs() < 1e-5 * sum / area, "texel {k}");
    }
}

/// Radiance that varies slowly is right wherever it is looked at, which fixes the conventions of lat-long images.
#[test]
fn lat_long_has_mitsubas_orientation() {
    let (width, height) = (256, 128);
    let pixels = (0..width * height)
        .map(|k| {
            let u = 2.0 * PI * ((k % width) as f64 + 0.5) / width as f64;
            let v = PI * ((k / width) as f64 + 0.5) / height as f64;
            // u = atan2(x, -z), v = acos(y).
            [v.sin() * u.sin(), v.cos(), -v.sin() * u.cos()].map(|x| (2.0 + x) as f32)
        })
        .collect();
    let map = EnvironmentMap::new(Layout::LatLong { width, height, rows: Rows::Centre }, pixels).unwrap();
    let rotation = turn([0.3, -0.5, 0.8], 1.1);
    let got = resampled(&map, 16, &rotation);
    for (k, value) in got.iter().enumerate() {
        let direction = texel_direction(16, k / 256, k / 16 % 16, k % 16);
        let inverse: Matrix = std::array::from_fn(|i| std::array::from_fn(|j| rotation[j][i]));
        let expected = apply(&inverse, direction);
        let sampled = map.sample(&[direction], &rotation, [1.0; 3])[0];
        for c in 0..3 {
            assert!((value[c] as f64 - 2.0 - expected[c]).abs() < 6e-3, "texel {k}: {value:?}, {expected:?}");
            assert!((sampled[c] as f64 - 2.0 - expected[c]).abs() < 1e-3);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..ProptestConfig::default() })]

    /// A sun of one pixel keeps its flux, and adds to nothing but the texels about it; nothing is negative.
    #[test]
    fn a_sun_keeps_its_flux(rotation in rotations(), u in 0usize..1024, v in 0usize..512, level in 0u32..8) {
        let (width, height, size) = (1024, 512, 1 << level);
        let mut pixels = vec![[0.0; 3]; width * height];
        pixels[v * width + u] = [1e5; 3];
        let map = EnvironmentMap::new(Layout::LatLong { width, height, rows: Rows::Centre }, pixels).unwrap();
        let edge = |row: usize| (PI * row as f64 / height as f64).cos();
        let expected = 1e5 * 2.0 * PI / width as f64 * (edge(v) - edge(v + 1));
        let turned = resampled(&map, size, &rotation);
        let got = flux(&turned, size);
        prop_assert!((got / expected - 1.0).abs() < 1e-3, "{got} for {expected}");
        prop_assert!(turned.iter().all(|l| l[0] >= 0.0));
        prop_assert!(turned.iter().filter(|l| l[0] > 1.0).count() <= 9);
    }

    /// One hot texel of a cubemap of any size keeps its flux under any rotation.
    #[test]
    fn a_hot_texel_keeps_its_flux(rotation in rotations(), source in 16usize..128, hot in any::<u32>()) {
        let mut pixels = vec![[0.0; 3]; 6 * source * source];
        let hot = hot as usize % pixels.len();
        pixels[hot] = [1e5; 3];
        let map = EnvironmentMap::new(Layout::Cubemap { size: source }, pixels).unwrap();
        let expected = 1e5 * solid_angles(source)[hot % (source * source)];
        let got = flux(&resampled(&map, 32, &rotation), 32);
        prop_assert!((got / expected - 1.0).abs() < 1e-3, "{got} for {expected}");
    }

    /// A constant stays the constant to f32 rounding, from and to any size.
    #[test]
    fn constants_stay(rotation in rotations(), width in 1usize..40, height in 1usize..40, size in 1usize..20, cube in any::<bool>(), edge in any::<bool>()) {
        let layout = if cube { Layout::Cubemap { size: width } } else { Layout::LatLong { width, height, rows: if edge { Rows::Edge } else { Rows::Centre } } };
        let map = EnvironmentMap::new(layout, vec![[0.7, -3e-5, 1e20]; layout.pixels()]).unwrap();
        for l in resampled(&map, size, &rotation) {
            prop_assert!((l[0] / 0.7 - 1.0).abs() < 1e-6 && (l[1] / -3e-5 - 1.0).abs() < 1e-6 && (l[2] / 1e20 - 1.0).abs() < 1e-6, "{l:?}");
        }
    }

    /// Noise of wide range keeps its mean, its bounds and (negated) its sign under any rotation.
    #[test]
    fn noise_keeps_its_bounds(rotation in rotations(), seed in any::<u32>()) {
        let layout = Layout::Cubemap { size: 64 };
        let value = |k: u32| ((k ^ seed).wrapping_mul(2654435761) >> 8) as f32 / (1 << 24) as f32;
        let pixels: Vec<[f32; 3]> = (0..layout.pixels() as u32).map(|k| [(8.0 * value(k)).exp(); 3]).collect();
        let negated = pixels.iter().map(|l| l.map(|x| -x)).collect();
        let turned = resampled(&EnvironmentMap::new(layout, pixels.clone()).unwrap(), 32, &rotation);
        let opposite = resampled(&EnvironmentMap::new(layout, negated).unwrap(), 32, &rotation);
        prop_assert!(turned.iter().zip(&opposite).all(|(a, b)| a[0] > 0.0 && a[0] == -b[0]));
        let (before, after) = (flux(&pixels, 64), flux(&turned, 32));
        prop_assert!((after / before - 1.0).abs() < 0.01, "{after} for {before}");
    }
}

/// Bright squares that overlap, in every strip of every face: added in one order, whoever adds them.
#[test]
fn threads_do_not_change_a_bit() {
    let (width, height) = (256, 128);
    let pixels = (0..width * height).map(|k| [1.0 + (k * 7919 % 101) as f32 * f32::from(k % 5 == 0); 3]).collect();
    let map = EnvironmentMap::new(Layout::LatLong { width, height, rows: Rows::Centre }, pixels).unwrap();
    let with_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| resampled(&map, 37, &turn([0.3, -0.5, 0.8], 1.1)))
    };
    let one = with_threads(1);
    assert!((2..5).all(|threads| with_threads(threads) == one));
}

/// A small rotation is a small change: no jump where the box average ends and interpolation begins.
#[test]
fn nothing_jumps_when_a_rotation_sets_in() {
    let pixels: Vec<[f32; 3]> =
        (0..6 * 64 * 64).map(|k| [(k * 7919 % 101) as f32 + 1e4 * f32::from(k % 4001 == 7); 3]).collect();
    let map = EnvironmentMap::new(Layout::Cubemap { size: 64 }, pixels).unwrap();
    let still = resampled(&map, 64, &IDENTITY);
    let moved = resampled(&map, 64, &turn([1.0, 2.0, 3.0], 1e-7));
    for (a, b) in still.iter().zip(&moved) {
        assert!((a[0] - b[0]).abs() < 0.1 + 1e-3 * a[0], "{} became {}", a[0], b[0]);
    }
}

/// What stands behind a scene is the map as it is looked up one direction at a time, by the share of each pixel.
#[test]
fn a_background_is_the_map_in_its_directions() {
    let rotation = turn([0.3, -0.5, 0.8], 1.1);
    let directions: Vec<[f32; 3]> =
        (0..6 * 64).map(|k| texel_direction(8, k / 64, k / 8 % 8, k % 8).map(|x| x as f32)).collect();
    let count = directions.len();
    let behind = Behind {
        // From the last pixel to the first.
        pixels: (0..count as u32).rev().collect(),
        shares: (0..count).map(|k| (k % 5) as f32 / 4.0).collect(),
        directions: directions.clone(),
    };
    for layout in [Layout::LatLong { width: 64, height: 32, rows: Rows::Centre }, Layout::Cubemap { size: 16 }] {
        let pixels = (0..layout.pixels()).map(|k| [(k * 7919 % 101) as f32, k as f32, 1.0]).collect();
        let map = EnvironmentMap::new(layout, pixels).unwrap();
        let mut picture = vec![[2.0; 3]; count];
        map.add_behind(&behind, &rotation, [1.0, 0.5, 3.0], &mut picture);
        let wide: Vec<[f64; 3]> = directions.iter().map(|d| d.map(f64::from)).collect();
        let seen = map.sample(&wide, &rotation, [1.0, 0.5, 3.0]);
        for (k, (seen, share)) in seen.iter().zip(&behind.shares).enumerate() {
            let found = picture[count - 1 - k];
            for c in 0..3 {
                let expected = 2.0 + share * seen[c];
                // Angles in f32, in pixels that differ by up to 100 and more.
                assert!((found[c] - expected).abs() <= 0.05 + 1e-3 * expected, "{layout:?}, {k}: {found:?}, {seen:?}");
            }
        }
    }
}

#[test]
fn bad_maps_are_refused() {
    assert!(EnvironmentMap::new(Layout::LatLong { width: 0, height: 3, rows: Rows::Centre }, vec![]).is_err());
    assert!(EnvironmentMap::new(Layout::Cubemap { size: 2 }, vec![[0.0; 3]; 23]).is_err());
    assert!(
        EnvironmentMap::new(Layout::LatLong { width: 1, height: 1, rows: Rows::Centre }, vec![[0.0, f32::NAN, 0.0]])
            .is_err()
    );
}
