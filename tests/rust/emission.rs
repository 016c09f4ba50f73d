//! Light that surfaces give off: against the form factor of a rectangle, under the light of a lobe, and its bounces against
//! a dense solution.

use _core::brdf::{Fresnel, Ggx};
use _core::precompute::links::Counts;
use _core::precompute::{Bounces, Emitters, Interreflection, LobeShape, Lobes};
use _core::scene::rays::Tracer;
use _core::scene::{Mesh, Points, Surfaces};
use _core::transport::Channels;
use proptest::prelude::*;
use std::sync::Arc;

/// A square of half width `a` at height 1 that glows, and a small far one that does not.
fn square(a: f64) -> Mesh {
    let lamp = [[-a, 1.0, -a], [a, 1.0, -a], [a, 1.0, a], [-a, 1.0, a]];
    let dark = [[-1.0, 0.0, -1.0], [-0.99, 0.0, -1.0], [-1.0, 0.0, -0.99]];
    let vertices: Vec<[f64; 3]> = lamp.into_iter().chain(dark).collect();
    Mesh::new(&vertices, &[[0, 1, 2], [0, 2, 3], [4, 5, 6]]).unwrap()
}

/// The share of the cosine-weighted hemisphere of a point at height 0, right under the middle, that the square fills.
fn form_factor(a: f64) -> f64 {
    let root = (1.0 + a * a).sqrt();
    4.0 * (2.0 * a / root * (a / root).atan()) / std::f64::consts::TAU
}

fn under(mesh: &Mesh) -> Points {
    Points { origin: vec![mesh.normalised([0.0; 3])], normal: vec![[0.0, 1.0, 0.0]], horizon: Vec::new() }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// Small and far, or so near that it fills the sky: what arrives is L times the form factor.
    #[test]
    fn a_rectangle_gives_its_form_factor(a in 0.02f64..40.0, colour in prop::array::uniform3(0.1f32..10.0)) {
        let mesh = square(a);
        let tracer = Tracer::new(&mesh);
        let surfaces = Surfaces { mesh: &mesh, tracer: &tracer };
        let emitters = Emitters::new(surfaces, &[colour, colour, [0.0; 3]]).unwrap();
        let found = emitters.arriving(surfaces, (&under(&mesh), &Lobes::default()), 32, &|_| Ok(())).unwrap();
        for k in 0..3 {
            let expected = f64::from(colour[k]) * form_factor(a);
            prop_assert!((found[0][k] / expected - 1.0).abs() < 0.03, "{} {}", found[0][k], expected);
        }
    }
}

/// A narrow lobe that looks into the square sees its radiance, whatever its size; one that looks past it sees nothing.
#[test]
fn a_narrow_lobe_shows_the_emitter_itself() {
    let mesh = square(0.5);
    let tracer = Tracer::new(&mesh);
    let surfaces = Surfaces { mesh: &mesh, tracer: &tracer };
    let emitters = Emitters::new(surfaces, &[[2.0, 3.0, 4.0], [2.0, 3.0, 4.0], [0.0; 3]]).unwrap();
    let lobe: LobeShape = LobeShape::Measured(Arc::new(Ggx::new([0.01, 0.01], Fresnel::None).unwrap()));
    for (eye, share) in [([0.0, 1.0, 0.0], 1.0), ([0.8, 0.6, 0.0], 0.0)] {
        let lobes = Lobes::new(vec![lobe.clone()], vec![0], vec![eye], &[[0.0, 1.0, 0.0]]).unwrap();
        let found = emitters.arriving(surfaces, (&under(&mesh), &lobes), 16, &|_| Ok(())).unwrap();
        for (k, l) in [2.0, 3.0, 4.0].into_iter().enumerate() {
            assert!((found[0][k] / l - share).abs() < 0.02, "{found:?}");
        }
    }
}

#[test]
fn bad_radiances_are_refused() {
    let mesh = square(0.5);
    let tracer = Tracer::new(&mesh);
    let surfaces = Surfaces { mesh: &mesh, tracer: &tracer };
    for bad in [vec![[1.0; 3]; 2], vec![[-1.0; 3]; 3], vec![[f32::NAN; 3]; 3]] {
        assert!(Emitters::new(surfaces, &bad).is_err());
    }
    let dark = Emitters::new(surfaces, &[[0.0; 3]; 3]).unwrap();
    assert!(dark.is_empty());
    let found = dark.arriving(surfaces, (&under(&mesh), &Lobes::default()), 4, &|_| Ok(())).unwrap();
    assert_eq!(found, [[0.0; 3]]);
}

/// Two nodes that see half of each other: the series by hand, in colours of their own.
#[test]
fn bounces_of_a_still_light_are_those_of_its_series() {
    let factors = Counts { starts: vec![0, 1, 2], nodes: vec![1, 0], counts: vec![2, 2], rays: 4 };
    let albedo = [[0.5, 0.25, 0.0], [0.8, 0.4, 0.2]];
    let between =
        Interreflection { factors: &factors, albedo: &albedo, checks: &[], arriving: &[], channels: Channels::Three };
    let direct = [[1.0, 2.0, 3.0], [0.0; 3]];
    let made = between.still(&direct, Bounces::Count(2)).unwrap();
    for k in 0..3 {
        let [a, b] = [f64::from(albedo[0][k]), f64::from(albedo[1][k])];
        let t = direct[0][k];
        // Irradiance: of the second node after one bounce, of the first after two.
        assert!((made[0][k] - 0.25 * a * b * t).abs() < 1e-6);
        assert!((made[1][k] - 0.5 * a * t).abs() < 1e-6);
        // Radiosity holds one bounce less.
        assert!((made[2][k] - a * t).abs() < 1e-6);
        assert!((made[3][k] - b * 0.5 * a * t).abs() < 1e-6);
    }
    let all = between.still(&direct, Bounces::All(1e-6)).unwrap();
    for k in 0..3 {
        let [a, b] = [f64::from(albedo[0][k]), f64::from(albedo[1][k])];
        assert!((all[1][k] - 0.5 * a * direct[0][k] / (1.0 - 0.25 * a * b)).abs() < 1e-5);
    }
}
