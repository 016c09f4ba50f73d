//! What studios stand on: rows over trees, families as tables, freezing, and lamps.

use std::sync::Arc;

use proptest::prelude::*;

use _core::basis::{ColumnSpace, HaarTree};
use _core::brdf::family::lookup::{Angles, WIDE};
use _core::brdf::family::{Edited, Family, MODELS, Model};
use _core::scene::rays::Tracer;
use _core::scene::{Beam, Lamp, Mesh, Points, Source};
use _core::transport::{Channels, Factors, Truncation, Width, freeze};

use crate::brdf::pairs;
use crate::transport::{matrix, noise, stored_norms};

/// A row times light is the same sum over samples and over the tree.
#[test]
fn rows_over_a_tree_take_what_they_take_of_samples() {
    let mut random = noise(3);
    for samples in [1usize, 2, 5, 16, 21] {
        let areas: Vec<f64> = (0..samples).map(|k| if k % 7 == 5 { 0.0 } else { 0.2 + random().abs() }).collect();
        let tree = HaarTree::new(areas.clone()).unwrap();
        let light: Vec<[f64; 3]> = (0..samples).map(|_| [random(), random(), random()]).collect();
        // What has no area takes nothing.
        let row = |area: &f64| std::array::from_fn(|_| if *area > 0.0 { random() as f32 } else { 0.0 });
        let rows: Vec<[f32; 4]> = areas.iter().map(row).collect();
        let mut out = vec![[0.0f32; 4]; tree.space().columns()];
        tree.project(&rows, &mut out);
        let coefficients = tree.forward(&light);
        for lane in 0..4 {
            for c in 0..3 {
                let over = |rows: &[[f32; 4]], light: &[[f64; 3]]| -> f64 {
                    rows.iter().zip(light).map(|(row, light)| f64::from(row[lane]) * light[c]).sum()
                };
                let (plain, wavelets) = (over(&rows, &light), over(&out, &coefficients));
                assert!((plain - wavelets).abs() < 1e-5 * samples as f64, "{samples}: {plain} and {wavelets}");
            }
        }
    }
}

fn range(model: Model) -> [f64; 2] {
    match model {
        Model::BlinnPhong | Model::Lafortune | Model::AshikhminShirley => [3.0, 3000.0],
        Model::Ward | Model::WardDuer => [0.02, 2.0],
        Model::CookTorrance => [0.05, 2.0],
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// The table has the functions and the other factor, to what 32-bit floats hold.
    #[test]
    fn tables_of_families_are_the_families(
        (wi, wo) in pairs(),
        at in 0..MODELS.len(),
        segment in 0usize..2,
        f0 in prop_oneof![Just(1.0), 0.0f64..1.0],
    ) {
        let model = MODELS[at].1;
        let edited = Edited { model, printed: false, f0: if model == Model::Lafortune { 1.0 } else { f0 } };
        let family = Family::segmented(edited, range(model), 5, 2).unwrap();
        let lookup = family.lookup(segment);
        let Some((fall, fixed)) = edited.fixed(wi, wo).filter(|_| wi[2] > 0.02 && wo[2] > 0.02) else { return Ok(()) };
        let sum: [f64; 3] = std::array::from_fn(|k| wi[k] + wo[k]);
        let off: [f64; 3] = [wi[0] + wo[0], wi[1] + wo[1], wi[2] - wo[2]];
        let square = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>();
        let tan_h2 = square(&sum[..2]) / (sum[2] * sum[2]);
        let found = lookup.fixed(&Angles {
            cos_i: wi[2] as f32,
            cos_o: wo[2] as f32,
            cos_h2: (1.0 / (1.0 + tan_h2)) as f32,
            tan_h2: tan_h2 as f32,
            cos_d: ((0..3).map(|k| sum[k] * wo[k]).sum::<f64>() / square(&sum).sqrt()) as f32,
            off_mirror: (0.5 * square(&off)) as f32,
        });
        prop_assert!((f64::from(found.0) - fall).abs() <= 1e-5 * fall + 1e-9, "{} and {fall}", found.0);
        prop_assert!((f64::from(found.1) - fixed).abs() <= 1e-5 * fixed, "{} and {fixed}", found.1);
        let mut sums = [0.0f32; WIDE];
        lookup.add(0, found.0, 2.0, &mut sums);
        let largest = family.basis(segment, 0.0).map(f64::abs).fold(0.0, f64::max);
        for (k, b) in family.basis(segment, fall).enumerate() {
            prop_assert!((f64::from(sums[k]) - 2.0 * b).abs() <= 2e-3 * largest, "{k}: {} and {}", sums[k], 2.0 * b);
        }
    }

    /// A frozen matrix is the sum, to what it says that it has lost.
    #[test]
    fn what_is_frozen_is_the_sum_of_its_factors(
        numbers in prop::collection::vec(-3.0f64..3.0, 3),
        seed in 0u64..1000,
        threshold in prop_oneof![Just(0.0), Just(0.3)],
    ) {
        let space = ColumnSpace::tree(20).unwrap();
        let each: Vec<_> =
            (0..3).map(|k| Arc::new(matrix(space, 40, Channels::One, seed + k, Width::I16))).collect();
        let weights: Vec<f64> = (0..space.columns()).map(|k| 1.0 / (1.0 + k as f64)).collect();
        let rule = Truncation::with_weights(weights, 8, threshold, each[0].quantum, Width::I16).unwrap();
        let frozen = freeze(&Factors::new(each.clone()).unwrap(), &numbers, &rule).unwrap();
        let bands = frozen.bands.clone();
        let lost = stored_norms(&frozen, |tile| &tile.dropped);
        for row in 0..frozen.rows {
            let (found, parts) = (frozen.row(row), each.iter().map(|part| part.row(row)).collect::<Vec<_>>());
            for band in 0..bands.count() {
                let off = bands.range(band).map(|column| {
                    let sum: f64 = parts.iter().zip(&numbers).map(|(part, c)| c * f64::from(part[column])).sum();
                    (f64::from(found[column]) - sum).powi(2)
                });
                let norm = off.sum::<f64>().sqrt();
                prop_assert!(norm <= lost[row * bands.count() + band] * (1.0 + 1e-6), "row {row}: {norm}");
            }
        }
        let wrong = freeze(&Factors::new(each).unwrap(), &numbers[..2], &rule);
        prop_assert!(wrong.is_err());
    }
}

/// A floor of 4 x 4 with a small roof over its middle.
fn floor_and_roof() -> (Mesh, Tracer, Points) {
    let square = |half: f64, y: f64| [[-half, y, -half], [half, y, -half], [half, y, half], [-half, y, half]];
    let vertices: Vec<[f64; 3]> = square(2.0, 0.0).into_iter().chain(square(0.5, 1.0)).collect();
    let triangles: [[u32; 3]; 4] = [[0, 2, 1], [0, 3, 2], [4, 6, 5], [4, 7, 6]];
    let mesh = Mesh::new(&vertices, &triangles).unwrap();
    let tracer = Tracer::new(&mesh);
    let places: Vec<[f64; 3]> =
        (0..100).map(|k| [-1.8 + 0.4 * f64::from(k % 10), 1e-4, -1.8 + 0.4 * f64::from(k / 10)]).collect();
    let origin = places.iter().map(|&place| mesh.normalised(place)).collect();
    (mesh, tracer, Points { origin, normal: vec![[0.0, 1.0, 0.0]; places.len()], horizon: vec![] })
}

/// Near and far lamps by the formulas of their irradiance, and shadows where a ray meets the roof.
#[test]
fn lamps_send_what_their_formulas_say() {
    let (mesh, tracer, points) = floor_and_roof();
    let lamp = |far: bool, sources: Vec<Source>| Lamp { sources, far };
    let near = |at: [f64; 3], beam: Beam| Source { at, colour: [3.0, 2.0, 1.0], beam };
    let low = [0.3, 2.0, -0.2];
    let slanted = [0.6, 0.8, 0.0];
    let place = |k: usize| points.origin[k].map(f64::from).map(|x| x / mesh.scale);
    // The roof is seen from a point where the line to it crosses the square at height 1.
    let hidden = |at: [f64; 3], way: [f64; 3]| {
        let t = (1.0 - at[1]) / way[1];
        (at[0] + t * way[0]).abs() < 0.5 && (at[2] + t * way[2]).abs() < 0.5
    };
    for (lamp, far) in [
        (lamp(false, vec![near(low, Beam::Even)]), false),
        (lamp(false, vec![near(low, Beam::Cone([0.0, -1.0, 0.0], [0.9, 0.8]))]), false),
        (lamp(false, vec![near(low, Beam::Facing([0.0, -1.0, 0.0]))]), false),
        (lamp(true, vec![Source { at: slanted, colour: [3.0, 2.0, 1.0], beam: Beam::Even }]), true),
    ] {
        lamp.check().unwrap();
        let sights = lamp.sights(&mesh, &tracer, &points, &|_| Ok(())).unwrap();
        let found = lamp.irradiance(&mesh, &points, &sights, 1);
        let mut dark = 0;
        for (k, found) in found.iter().enumerate() {
            let at: [f64; 3] = std::array::from_fn(|axis| place(k)[axis] + mesh.centre[axis]);
            let way: [f64; 3] = if far { slanted } else { std::array::from_fn(|axis| low[axis] - at[axis]) };
            let length = way.iter().map(|x| x * x).sum::<f64>().sqrt();
            let cosine = way[1] / length;
            let beam = match lamp.sources[0].beam {
                Beam::Even => 1.0,
                Beam::Facing(_) => cosine,
                Beam::Cone(_, [full, none]) => {
                    let x = ((cosine - none) / (full - none)).clamp(0.0, 1.0);
                    x * x * (3.0 - 2.0 * x)
                }
            };
            let falls = if far { 1.0 } else { 1.0 / (length * length) };
            let wanted = if hidden(at, way) { 0.0 } else { beam * cosine * falls / std::f64::consts::PI };
            dark += usize::from(hidden(at, way));
            assert!((found[2] - wanted).abs() < 1e-4 * wanted + 1e-9, "{k}: {} and {wanted}", found[2]);
            assert!((found[0] - 3.0 * found[2]).abs() < 1e-12 + 1e-12 * found[0]);
        }
        assert!(dark > 0, "the roof hides something");
        let rows: Vec<u32> = (0..points.len() as u32).collect();
        let up = vec![[0.0f32, 1.0, 0.0]; points.len()];
        // What leaves is f of what arrives, whose cosine and 1 / pi are in it.
        for (_, model) in MODELS {
            let edited = Edited { model, printed: false, f0: 1.0 };
            let glints = lamp.glints(&mesh, (&points, &sights), &rows, &up, edited);
            for gamma in range(model) {
                let curve = glints.curve(gamma);
                for (k, found) in found.iter().enumerate() {
                    let at: [f64; 3] = std::array::from_fn(|axis| place(k)[axis] + mesh.centre[axis]);
                    let way: [f64; 3] = if far { slanted } else { std::array::from_fn(|axis| low[axis] - at[axis]) };
                    let length = way.iter().map(|x| x * x).sum::<f64>().sqrt();
                    // Any frame about the normal, which is y.
                    let wi = [way[2] / length, way[0] / length, way[1] / length];
                    let (fall, fixed) = edited.fixed(wi, [0.0, 0.0, 1.0]).unwrap();
                    let wanted = std::f64::consts::PI * found[1] * fixed * edited.value(gamma, fall);
                    let off = (glints.reflected(k, curve)[1] - wanted).abs();
                    assert!(off < 1e-4 * wanted + 1e-9, "{model:?} {gamma}, {k}: off by {off} of {wanted}");
                }
            }
        }
    }
    let wrong = lamp(true, vec![Source { at: [1.0, 1.0, 0.0], colour: [1.0; 3], beam: Beam::Even }]);
    assert!(wrong.check().is_err());
    assert!(lamp(false, vec![near([f64::NAN, 0.0, 0.0], Beam::Even)]).check().is_err());
    // At the surface itself, and inside the roof: finite.
    let within = lamp(false, vec![near([-1.8, 1e-4, -1.8], Beam::Even)]);
    let sights = within.sights(&mesh, &tracer, &points, &|_| Ok(())).unwrap();
    assert!(within.irradiance(&mesh, &points, &sights, 1).iter().flatten().all(|x| x.is_finite()));
}
