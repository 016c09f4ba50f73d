//! Lobes over texels: means against plain quadrature, the same bits everywhere, and files that lie.

use std::f64::consts::PI;

use _core::basis::cubemap::{face_point, texel_centre};
use _core::brdf::{Brdf, Stored};
use _core::precompute::models;
use _core::sampling::frame;
use _core::transport::lobes::{DIFFUSE, LobeModels, Lobes, PARAMETERS, RowLobe};
use proptest::prelude::*;
use xxhash_rust::xxh3::xxh3_64;

/// One of each kind, its parameters as files hold them.
const KINDS: [(u32, [f64; PARAMETERS]); 11] = [
    (1, [-1.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0]),
    (2, [60.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0]),
    (3, [80.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0]),
    (4, [0.2, 0.4, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0]),
    (5, [0.3, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0]),
    (6, [30.0, -1.0, -0.9, 0.8, -1.0, -1.0, -1.0, -1.0]),
    (7, [0.25, 1.5, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0]),
    (8, [0.3, -1.0, 0.2, 3.0, -1.0, -1.0, -1.0, -1.0]),
    (9, [0.1, 0.3, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0]),
    (10, [50.0, 300.0, 0.3, -1.0, -1.0, -1.0, -1.0, -1.0]),
    (2, [1e5, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0]),
];

fn all() -> std::sync::Arc<dyn LobeModels> {
    let (kinds, parameters): (Vec<u32>, Vec<[f64; PARAMETERS]>) = KINDS.into_iter().unzip();
    models(&kinds, parameters.as_flattened()).unwrap()
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    v.map(|x| x / length)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| a[k] * b[k]).sum()
}

/// A lobe of a surface with a normal, seen from somewhere above it.
fn row(model: usize, normal: [f64; 3], [x, y]: [f64; 2]) -> RowLobe {
    let normal = unit(normal);
    let [tangent, bitangent] = frame(normal);
    let eye = unit(std::array::from_fn(|k| normal[k] + x * tangent[k] + y * bitangent[k]));
    let half_width = half_width(model, normal, eye);
    RowLobe { model, normal: normal.map(|x| x as f32), eye: eye.map(|x| x as f32), half_width }
}

fn local(normal: [f64; 3], v: [f64; 3]) -> [f64; 3] {
    let [tangent, bitangent] = frame(normal);
    [dot(tangent, v), dot(bitangent, v), dot(normal, v)]
}

fn half_width(model: usize, normal: [f64; 3], eye: [f64; 3]) -> f32 {
    let (kind, parameters) = KINDS[model];
    Stored::new(kind, parameters.to_vec()).unwrap().model.half_width(local(normal, eye)) as f32
}

/// pi times the mean of f cos over a texel, by points of a fine grid over it.
fn plain(model: &dyn Brdf, lobe: &RowLobe, size: usize, texel: usize) -> f64 {
    const SIDE: usize = 160;
    let normal = lobe.normal.map(f64::from);
    let wo = local(normal, lobe.eye.map(f64::from));
    let (face, row, column) = (texel / (size * size), texel / size % size, texel % size);
    let (mut sum, mut area) = (0.0, 0.0);
    for k in 0..SIDE * SIDE {
        let at = |whole: usize, part: usize| texel_centre(SIDE * size, whole * SIDE + part);
        let point = face_point(face, at(column, k % SIDE), at(row, k / SIDE));
        let weight = dot(point, point).powf(-1.5);
        let wi = local(normal, unit(point));
        sum += if wi[2] > 0.0 { weight * model.evaluate(wi, wo) * wi[2] } else { 0.0 };
        area += weight;
    }
    PI * sum / area
}

/// The texel that a direction falls into and those around it.
fn near(size: usize, direction: [f64; 3]) -> Vec<usize> {
    let centre = |texel: usize| {
        let (face, row, column) = (texel / (size * size), texel / size % size, texel % size);
        unit(face_point(face, texel_centre(size, column), texel_centre(size, row)))
    };
    let mut texels: Vec<usize> = (0..6 * size * size).collect();
    texels.sort_by(|&a, &b| dot(centre(b), direction).total_cmp(&dot(centre(a), direction)));
    texels.truncate(9);
    texels
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    /// Where a lobe points to, its means are those of 160 x 160 points a texel. Parts are a third of the half width w of a
    /// lobe: of a normal distribution the middle of one, h wide, is above its mean by h² / 24 of the Laplacian, which at the
    /// axis is 4 ln 2 / w²: 1.3 %.
    #[test]
    fn means_are_those_of_many_points(
        model in 0..KINDS.len(), x in -1.0f64..1.0, y in -1.0f64..1.0, z in 0.2f64..1.0,
        eye in [-1.5f64..1.5, -1.5f64..1.5], level in 2u32..6,
    ) {
        let (size, lobe) = (1 << level, row(model, [x, y, z], eye));
        // 64 parts along a texel are the most there are: of a lobe that needs more, a twentieth of a texel wide, no mean is right.
        prop_assume!(3.0 * PI / 2.0 / size as f64 <= 64.0 * f64::from(lobe.half_width));
        let stored = Stored::new(KINDS[model].0, KINDS[model].1.to_vec()).unwrap();
        let normal = lobe.normal.map(f64::from);
        let [tangent, bitangent] = frame(normal);
        let axis = stored.model.axis(local(normal, lobe.eye.map(f64::from)));
        let texels = near(size, std::array::from_fn(|k| axis[0] * tangent[k] + axis[1] * bitangent[k] + axis[2] * normal[k]));
        let mut means = vec![0.0; texels.len()];
        all().means(&lobe, size, &texels, &mut means);
        let exact: Vec<f64> = texels.iter().map(|&texel| plain(&*stored.model, &lobe, size, texel)).collect();
        let most = exact.iter().fold(0.0f64, |most, &x| most.max(x));
        for (mean, exact) in means.iter().zip(&exact) {
            prop_assert!((f64::from(*mean) - exact).abs() <= 0.03 * most, "{:?} {:?}", means, exact);
        }
        let (sum, whole) = (means.iter().map(|&x| f64::from(x)).sum::<f64>(), exact.iter().sum::<f64>());
        prop_assert!((sum / whole - 1.0).abs() < 0.02, "{sum} {whole}");
    }
}

/// On any machine, with any instructions: what texel columns are made of has these bits.
#[test]
fn means_have_the_same_bits_on_every_machine() {
    let (models, size) = (all(), 8);
    let texels: Vec<usize> = (0..6 * size * size).collect();
    let mut bytes = Vec::new();
    for model in 0..KINDS.len() {
        let half_width = 0.01 + 0.03 * model as f32;
        let lobe = RowLobe { half_width, ..row(model, [0.3, 0.5, 0.8], [0.7, -0.4]) };
        let mut means = vec![0.0f32; texels.len()];
        models.means(&lobe, size, &texels, &mut means);
        assert!(means.iter().all(|mean| mean.is_finite() && *mean >= 0.0) && means.iter().any(|&mean| mean > 0.0));
        bytes.extend(means.iter().flat_map(|mean| mean.to_le_bytes()));
    }
    assert_eq!(xxh3_64(&bytes), 7_312_482_227_017_976_183);
}

#[test]
fn models_come_back_from_what_files_hold_of_them() {
    let (kinds, parameters) = all().stored();
    assert_eq!(kinds, KINDS.map(|(kind, _)| kind));
    assert_eq!(parameters, KINDS.map(|(_, parameters)| parameters).as_flattened());
    for (kind, first) in [(0, 0.1), (11, 0.1), (9, 0.0001), (9, f64::NAN), (2, -3.0)] {
        let mut parameters = [-1.0; PARAMETERS];
        parameters[0] = first;
        assert!(models(&[kind], &parameters).is_err(), "{kind} {first}");
    }
}

#[test]
fn lobes_that_cannot_be_are_refused() {
    let normals = [0.0f32, 0.0, 1.0, 0.0, 0.6, 0.8];
    let sound = Lobes {
        models: all(),
        model: vec![3u16, DIFFUSE].into(),
        eye: vec![0.6f32, 0.0, 0.8, 0.0, 0.0, 0.0].into(),
        half_width: vec![0.1f32, 0.0].into(),
    };
    assert_eq!(sound.check(&normals), Ok(()));
    let nan = f32::NAN;
    let harmed = [
        Lobes { model: vec![11u16, DIFFUSE].into(), ..sound.clone() },
        Lobes { model: vec![3u16].into(), ..sound.clone() },
        Lobes { eye: vec![0.6f32, 0.0, 0.9, 0.0, 0.0, 0.0].into(), ..sound.clone() },
        Lobes { eye: vec![nan, 0.0, 0.8, 0.0, 0.0, 0.0].into(), ..sound.clone() },
        Lobes { half_width: vec![0.0f32, 0.0].into(), ..sound.clone() },
        Lobes { half_width: vec![nan, 0.0].into(), ..sound.clone() },
    ];
    assert!(harmed.iter().all(|lobes| lobes.check(&normals).is_err()));
    assert!(sound.check(&[0.0, 0.0, 0.0, 0.0, 0.6, 0.8]).is_err());
}
