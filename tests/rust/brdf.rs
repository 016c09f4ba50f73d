//! Reflectance: densities are those of the samples, albedos those of brute force, energy and reciprocity as claimed, and no
//! draw of parameters and directions makes a NaN.

use std::f64::consts::{FRAC_1_PI, FRAC_PI_2, PI};

use _core::brdf::measured::{MERL, Merl, Rgl, RglTables};
use _core::brdf::{
    AshikhminShirley, Beckmann, BlinnPhong, Brdf, CookTorrance, Direction, Fresnel, Ggx, Lafortune, Lambert, Measured,
    Ward, WardDuer, phong,
};
use _core::sampling::jitter;
use proptest::prelude::*;

pub type Model = Box<dyn Brdf>;

/// A direction at an angle to the normal and an azimuth, in degrees.
fn at(theta: f64, phi: f64) -> Direction {
    let ((s, c), (y, x)) = (theta.to_radians().sin_cos(), phi.to_radians().sin_cos());
    [s * x, s * y, c]
}

/// A number between two, evenly by its logarithm.
fn logarithmic(low: f64, high: f64) -> impl Strategy<Value = f64> {
    (low.ln()..=high.ln()).prop_map(move |x| x.exp().clamp(low, high))
}

fn roughness() -> impl Strategy<Value = f64> {
    prop_oneof![4 => logarithmic(0.002, 2.0), 1 => Just(0.002), 1 => Just(10.0)]
}

fn exponent(narrowest: f64) -> impl Strategy<Value = f64> {
    prop_oneof![4 => logarithmic(0.1, narrowest), 1 => Just(0.0), 1 => Just(narrowest)]
}

fn fresnel() -> impl Strategy<Value = Fresnel> {
    prop_oneof![
        Just(Fresnel::None),
        (0.0..=1.0f64).prop_map(|f0| Fresnel::schlick(f0).unwrap()),
        (logarithmic(0.01, 100.0), prop_oneof![Just(0.0), logarithmic(1e-3, 100.0)])
            .prop_map(|(n, k)| Fresnel::index(n, k).unwrap()),
    ]
}

/// Models that reflect no more light than there is.
fn conserving() -> impl Strategy<Value = Model> {
    let coefficients = [-1.0..=1.0f64, -1.0..=1.0f64, -1.0..=1.0f64];
    let skewed = (exponent(1.25e5), coefficients)
        .prop_filter("all 0", |(_, c)| c.iter().any(|c| *c != 0.0))
        .prop_map(|(n, c)| Box::new(Lafortune::new(n, c).unwrap()) as Model);
    prop_oneof![
        Just(()).prop_map(|()| Box::new(Lambert) as Model),
        exponent(1.25e5).prop_map(|n| Box::new(phong(n).unwrap()) as Model),
        exponent(5e5).prop_map(|n| Box::new(BlinnPhong::new(n).unwrap()) as Model),
        skewed,
        [roughness(), roughness()].prop_map(|a| Box::new(Ward::new(a).unwrap()) as Model),
        (roughness(), fresnel()).prop_map(|(s, f)| Box::new(CookTorrance::new(s, f).unwrap()) as Model),
        ([roughness(), roughness()], fresnel()).prop_map(|(a, f)| Box::new(Beckmann::new(a, f).unwrap()) as Model),
        ([roughness(), roughness()], fresnel()).prop_map(|(a, f)| Box::new(Ggx::new(a, f).unwrap()) as Model),
        ([exponent(5e5), exponent(5e5)], fresnel())
            .prop_map(|(n, f)| Box::new(AshikhminShirley::new(n, f).unwrap()) as Model),
    ]
}

pub fn models() -> impl Strategy<Value = Model> {
    let duer = [roughness(), roughness()].prop_map(|a| Box::new(WardDuer::new(a).unwrap()) as Model);
    prop_oneof![8 => conserving(), 1 => duer]
}

/// Above the horizon, down to where a cosine is nearly nothing.
fn raised() -> impl Strategy<Value = Direction> {
    let cosine = prop_oneof![3 => 0.0..=1.0f64, 1 => logarithmic(1e-40, 1.0), 1 => Just(1.0), 1 => Just(1e-300)];
    (cosine, prop_oneof![-180.0..180.0f64, Just(0.0), Just(90.0)]).prop_map(|(z, phi)| {
        let (s, (y, x)) = (((1.0 - z) * (1.0 + z)).max(0.0).sqrt(), phi.to_radians().sin_cos());
        [s * x, s * y, z]
    })
}

/// Two directions: any, or related as what is hard to tell apart is.
pub fn pairs() -> impl Strategy<Value = (Direction, Direction)> {
    (raised(), raised(), 0..8).prop_map(|(wi, wo, kind)| match kind {
        0 => (wo, wo),
        1 => (wo.map(|x| -x), wo),
        2 => ([-wo[0], -wo[1], wo[2]], wo),
        3 => (wi, [wo[0], wo[1], -wo[2]]),
        // As near the mirror direction as may be, and of length 1: models may count on it.
        4 => {
            let near = [-wo[0] + 1e-9, -wo[1], wo[2]];
            let length = near.iter().map(|x| x * x).sum::<f64>().sqrt();
            (near.map(|x| x / length), wo)
        }
        _ => (wi, wo),
    })
}

pub fn near(a: f64, b: f64, relative: f64) -> bool {
    (a - b).abs() <= relative * a.abs().max(b.abs())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]

    #[test]
    fn nothing_is_nan_or_negative(model in models(), (wi, wo) in pairs(), u in [0.0..1.0f64, 0.0..1.0f64]) {
        for value in [model.evaluate(wi, wo), model.pdf(wi, wo), model.half_width(wo)] {
            prop_assert!(value.is_finite() && value >= 0.0, "{value}");
        }
        if wi[2] <= 0.0 || wo[2] <= 0.0 {
            prop_assert_eq!([model.evaluate(wi, wo), model.pdf(wi, wo)], [0.0; 2]);
        }
        for u in [u, [0.0, u[1]], [1.0 - f64::EPSILON / 2.0, u[1]]] {
            if let Some((wi, pdf)) = model.sample(wo, u) {
                prop_assert!(wi[2] > 0.0 && near(wi.iter().map(|x| x * x).sum(), 1.0, 1e-12));
                prop_assert_eq!(pdf, model.pdf(wi, wo));
                prop_assert!(model.evaluate(wi, wo).is_finite());
            }
        }
    }

    #[test]
    fn light_goes_both_ways(model in models(), (wi, wo) in pairs()) {
        let (there, back) = (model.evaluate(wi, wo), model.evaluate(wo, wi));
        prop_assert!(there.max(back) < 1e-250 || near(there, back, 1e-7), "{there} {back}");
    }

    /// A small square of numbers becomes a parallelogram of directions whose area is its share of 1 over the density.
    #[test]
    fn the_density_is_that_of_the_samples(
        model in models(),
        cosine in 0.02..=1.0f64,
        phi in -180.0..180.0f64,
        u in [0.01..0.99f64, 0.01..0.99f64],
    ) {
        let wo = at(cosine.acos().to_degrees(), phi);
        let step = 1e-5;
        let moved = |axis: usize, by: f64| {
            let mut u = u;
            u[axis] += by;
            model.sample(wo, u).map(|(wi, _)| wi)
        };
        let difference = |axis| {
            let (more, less) = (moved(axis, step)?, moved(axis, -step)?);
            Some::<Direction>(std::array::from_fn(|k| (more[k] - less[k]) / (2.0 * step)))
        };
        if let (Some((wi, pdf)), Some(a), Some(b)) = (model.sample(wo, u), difference(0), difference(1)) {
            let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
            let area: f64 = (0..3).map(|k| cross[k] * wi[k]).sum();
            prop_assert!((area.abs() * pdf - 1.0).abs() < 1e-3, "{} at {wi:?}", area.abs() * pdf);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn no_more_light_than_there_is(model in conserving(), theta in prop_oneof![0.0..=89.0f64, Just(89.0)], phi in -180.0..180.0f64) {
        let albedo = model.albedo(at(theta, phi));
        prop_assert!((0.0..=1.0 + 1e-3).contains(&albedo), "{albedo}");
    }
}

/// One of each, wide and narrow.
fn some() -> Vec<(&'static str, Model)> {
    let metal = Fresnel::index(0.2, 3.9).unwrap();
    vec![
        ("lambert", Box::new(Lambert)),
        ("phong 30", Box::new(phong(30.0).unwrap())),
        ("phong 1e5", Box::new(phong(1e5).unwrap())),
        ("blinn-phong 3", Box::new(BlinnPhong::new(3.0).unwrap())),
        ("blinn-phong 300", Box::new(BlinnPhong::new(300.0).unwrap())),
        ("ward 0.3", Box::new(Ward::new([0.3; 2]).unwrap())),
        ("ward 0.1 0.4", Box::new(Ward::new([0.1, 0.4]).unwrap())),
        ("ward 0.002 1", Box::new(Ward::new([0.002, 1.0]).unwrap())),
        ("ward-duer 0.2", Box::new(WardDuer::new([0.2; 2]).unwrap())),
        ("lafortune off-specular", Box::new(Lafortune::new(20.0, [-1.0, -1.0, 0.6]).unwrap())),
        ("lafortune back", Box::new(Lafortune::new(50.0, [1.0, 1.0, 1.0]).unwrap())),
        ("cook-torrance 0.1", Box::new(CookTorrance::new(0.1, metal).unwrap())),
        ("cook-torrance 1", Box::new(CookTorrance::new(1.0, Fresnel::None).unwrap())),
        ("beckmann 0.3 0.15", Box::new(Beckmann::new([0.3, 0.15], metal).unwrap())),
        ("ggx 0.002", Box::new(Ggx::new([0.002; 2], Fresnel::None).unwrap())),
        ("ggx 0.2 0.6", Box::new(Ggx::new([0.2, 0.6], metal).unwrap())),
        ("ashikhmin-shirley 10 100", Box::new(AshikhminShirley::new([10.0, 100.0], Fresnel::None).unwrap())),
        ("ashikhmin-shirley 5e5", Box::new(AshikhminShirley::new([5e5; 2], Fresnel::None).unwrap())),
    ]
}

/// Centres of the cells of a square.
fn grid(side: usize) -> impl Iterator<Item = [f64; 2]> {
    let centre = move |k: usize| (k as f64 + 0.5) / side as f64;
    (0..side * side).map(move |k| [centre(k / side), centre(k % side)])
}

#[test]
fn samples_carry_the_albedo() {
    const SIDE: usize = 400;
    for (name, model) in some() {
        for theta in [0.0, 40.0, 75.0, 85.0] {
            let wo = at(theta, 25.0);
            let weight = |(wi, pdf): (Direction, f64)| model.evaluate(wi, wo) * wi[2] / pdf;
            let sum: f64 = grid(SIDE).filter_map(|u| model.sample(wo, u)).map(weight).sum();
            let (sampled, albedo) = (sum / (SIDE * SIDE) as f64, model.albedo(wo));
            assert!((sampled - albedo).abs() < 4e-4, "{name} at {theta}: sampled {sampled}, by quadrature {albedo}");
        }
    }
}

/// Bins of equal solid angle; within each the density is averaged over 20 x 20 directions. Pearson's statistic of n bins is
/// about n with a variance of 2 n.
#[test]
fn samples_fall_where_the_density_says() {
    const SIDE: usize = 16;
    const FINE: usize = 20;
    const COUNT: usize = 400_000;
    let narrow = ["phong 1e5", "ward 0.002 1", "ggx 0.002", "ashikhmin-shirley 5e5"];
    for (name, model) in some().into_iter().filter(|(name, _)| !narrow.contains(name)) {
        let wo = at(50.0, 25.0);
        let mut expected = vec![0.0; SIDE * SIDE];
        for [z, turn] in grid(SIDE * FINE) {
            let bin = (z * SIDE as f64) as usize * SIDE + (turn * SIDE as f64) as usize;
            let share = 2.0 * PI / (SIDE * SIDE * FINE * FINE) as f64;
            expected[bin] += COUNT as f64 * share * model.pdf(at(z.acos().to_degrees(), 360.0 * turn), wo);
        }
        let mut found = vec![0.0; SIDE * SIDE];
        let mut lost = 0.0;
        for [a, b] in (0..COUNT as u64).map(jitter) {
            match model.sample(wo, [a, b]) {
                Some((wi, _)) => {
                    let turn = wi[1].atan2(wi[0]).rem_euclid(2.0 * PI) / (2.0 * PI);
                    let [row, column] = [wi[2], turn].map(|x| ((x * SIDE as f64) as usize).min(SIDE - 1));
                    found[row * SIDE + column] += 1.0;
                }
                None => lost += 1.0,
            }
        }
        let integral: f64 = expected.iter().sum::<f64>() / COUNT as f64;
        assert!((integral + lost / COUNT as f64 - 1.0).abs() < 4e-3, "{name}: {integral}, lost {lost}");
        let bins: Vec<_> = expected.iter().zip(&found).filter(|(expected, _)| **expected > 8.0).collect();
        let statistic: f64 = bins.iter().map(|(e, f)| (*e - *f) * (*e - *f) / *e).sum();
        let n = bins.len() as f64;
        assert!(n > 4.0 && statistic < n + 5.0 * (2.0 * n).sqrt(), "{name}: {statistic} over {n} bins");
    }
}

/// At normal incidence cos theta_h = cos(theta / 2), and the integral of cos^n(theta / 2) cos theta is the constant's inverse;
/// that of Phong's cos^(n + 1) is 2 pi / (n + 2).
#[test]
fn all_light_is_reflected_at_normal_incidence() {
    let up = [0.0, 0.0, 1.0];
    for n in [0.0, 1.0, 3.0, 30.0, 300.0, 1e4, 1e5] {
        assert!((BlinnPhong::new(n).unwrap().albedo(up) - 1.0).abs() < 2e-6, "{n}");
        assert!((phong(n).unwrap().albedo(up) - 1.0).abs() < 2e-6, "{n}");
    }
    assert_eq!(Lambert.evaluate(at(20.0, 0.0), up), FRAC_1_PI);
    assert!((Lambert.albedo(at(80.0, 0.0)) - 1.0).abs() < 2e-6);
}

#[test]
fn half_widths() {
    // acos(2^(-1 / n)), in degrees.
    for (n, degrees) in [(20.0, 15.0), (100.0, 6.7), (1e3, 2.13), (1e4, 0.675), (1e5, 0.213)] {
        let width = phong(n).unwrap().half_width(at(30.0, 70.0)).to_degrees();
        assert!(near(width, degrees, 0.02), "{n}: {width}");
    }
    assert!(near(Lambert.half_width(at(30.0, 0.0)), FRAC_PI_2, 0.01));
    // exp(-tan²theta_h / alpha²) is a half at alpha sqrt(ln 2); across the plane of incidence half vectors turn the light by
    // twice their own angle times the cosine to the eye.
    for alpha in [0.002, 0.02] {
        for theta in [0.0, 60.0, 80.0] {
            let width = Ward::new([alpha, 1.0]).unwrap().half_width(at(theta, 90.0));
            let expected = 2.0 * alpha * 2.0f64.ln().sqrt() * theta.to_radians().cos();
            assert!(near(width, expected, 0.03), "{alpha} {theta}: {width} {expected}");
        }
    }
    // A lobe that goes back is narrow about the eye.
    assert!(Lafortune::new(1e4, [1.0; 3]).unwrap().half_width(at(40.0, 0.0)) < 0.013);
}

#[test]
fn refusals_say_what_was_expected() {
    let said =
        |model: Result<Model, _core::error::Error>| model.err().map(|error| error.to_string()).unwrap_or_default();
    let boxed = |alpha| said(Ggx::new([alpha, 0.1], Fresnel::None).map(|model| Box::new(model) as Model));
    assert_eq!(boxed(0.001), "expected alpha of 0.002 or more, got 0.001: mirrors are not supported");
    assert_eq!(boxed(11.0), "expected alpha from 0.002 to 10, got 11");
    assert_eq!(boxed(f64::NAN), "expected alpha from 0.002 to 10, got NaN");
    let power = |n| said(phong(n).map(|model| Box::new(model) as Model));
    assert_eq!(power(2e5), "expected exponent of 125000 or less, got 200000: mirrors are not supported");
    assert_eq!(power(-1.0), "expected exponent from 0 to 125000, got -1");
    let lafortune = |c| said(Lafortune::new(1.0, c).map(|model| Box::new(model) as Model));
    assert_eq!(lafortune([0.0; 3]), "expected three finite coefficients, not all 0, got [0.0, 0.0, 0.0]");
    assert!(Fresnel::index(0.0, 1.0).is_err() && Fresnel::index(1.0, f64::INFINITY).is_err());
    assert!(Fresnel::schlick(1.5).is_err());
}

#[test]
fn tables_that_do_not_fit_are_refused() {
    let cells = MERL.iter().product::<usize>();
    let said = |cells| Merl::new(cells).unwrap_err().to_string();
    assert_eq!(said(vec![[1.0; 3]; 7]), format!("expected {} numbers of reflectance, got 21", 3 * cells));
    assert_eq!(said(vec![[-1.0; 3]; cells]), "expected reflectance of 0 or more and finite, got -1");
    let ones = [1.0; 600];
    let whole = |points| RglTables {
        phi_i: &[0.0],
        theta_i: &[0.0, 1.5],
        ndf: (&ones[..4], [2, 2]),
        sigma: (&ones[..4], [2, 2]),
        vndf: (&ones[..points], [3, 3]),
        luminance: (&ones[..8], [2, 2]),
        rgb: (&ones[..24], [2, 2]),
        jacobian: true,
    };
    assert_eq!(Rgl::new(&whole(17)).unwrap_err().to_string(), "expected 18 numbers of vndf, got 17");
    let flipped = RglTables { vndf: (&ones, [usize::MAX, usize::MAX]), ..whole(18) };
    assert_eq!(Rgl::new(&flipped).unwrap_err().to_string(), "expected fewer numbers of vndf, got 600");
    let table = Rgl::new(&whole(18)).unwrap();
    // ndf / 4 sigma is a quarter, and the table holds f cos theta_i.
    assert!(near(table.colour(at(60.0, 0.0), at(10.0, 30.0))[1], 0.5, 1e-12));
}
