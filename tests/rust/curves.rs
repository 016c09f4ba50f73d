//! BRDF curves: their wavelets against the matrix that they are, how few of them a highlight takes, and models against their
//! curves times what is left.

use std::sync::Arc;

use _core::basis::ColumnSpace;
use _core::basis::daubechies4::{COARSEST, CURVE, Daubechies4};
use _core::brdf::measured::{MERL, Merl};
use _core::brdf::quotient::{Shares, between};
use _core::brdf::{Brdf, Lambert, Measured, Quotient};
use _core::precompute::curve::columns_of;
use proptest::prelude::*;

use crate::brdf::{models, near, pairs};

/// A function of the samples 0 to 255.
fn sampled(f: impl Fn(usize) -> f64) -> [f64; CURVE] {
    std::array::from_fn(f)
}

/// Row j of W: the wavelet of coefficient j.
fn wavelet(j: usize) -> [f64; CURVE] {
    Daubechies4::shared().inverse(&sampled(|k| f64::from(u8::from(k == j))))
}

fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, |most: f64, x| most.max(x.abs()))
}

/// The curve of its largest coefficients.
fn of_terms(curve: &[f64; CURVE], terms: usize) -> [f64; CURVE] {
    let d4 = Daubechies4::shared();
    let mut coefficients = d4.forward(curve);
    let mut order: Vec<usize> = (0..CURVE).collect();
    order.sort_by(|&a, &b| coefficients[b].abs().total_cmp(&coefficients[a].abs()));
    order[terms..].iter().for_each(|&j| coefficients[j] = 0.0);
    d4.inverse(&coefficients)
}

/// Highlights of a roughness with their peak at 1, over u = sqrt(|n - h| / sqrt 2): Beckmann, GGX, Ashikhmin-Shirley. With
/// s = u⁴ / 2 = sin²(theta / 2): cos theta = 1 - 2 s, sin² theta = 4 s (1 - s).
fn highlights(sigma: f64) -> [(&'static str, [f64; CURVE]); 3] {
    let of = |f: &dyn Fn(f64, f64) -> f64| {
        sampled(|k| {
            let s = 0.5 * (k as f64 / (CURVE - 1) as f64).powi(4);
            f(1.0 - 2.0 * s, 4.0 * s * (1.0 - s))
        })
    };
    let square = sigma * sigma;
    [
        ("Beckmann", of(&|c, s2| if c > 0.0 { (-s2 / (c * c) / square).exp() / c.powi(4) } else { 0.0 })),
        ("GGX", of(&|c, s2| 1.0 / (c * c + s2 / square).powi(2))),
        ("Ashikhmin-Shirley", of(&|c, _| c.powf(2.0 / square))),
    ]
}

#[test]
fn wavelets_are_orthonormal() {
    let rows: Vec<[f64; CURVE]> = (0..CURVE).map(wavelet).collect();
    for (i, a) in rows.iter().enumerate() {
        for (j, b) in rows.iter().enumerate() {
            let product: f64 = a.iter().zip(b).map(|(x, y)| x * y).sum();
            assert!((product - f64::from(u8::from(i == j))).abs() <= 1e-14, "<{i}, {j}> = {product:e}");
        }
    }
}

/// W of the interior, as it is printed (Daubechies 1992, table 6.1), and of both ends, as it was when it was first made:
/// coefficients in files mean what they meant.
#[test]
fn wavelets_are_those_of_the_files() {
    let finest = wavelet(CURVE / 2 + 2);
    let expected = [-0.12940952255126037, -0.224_143_868_042_013_4, 0.836516303737808, -0.48296291314453416];
    for (k, e) in expected.iter().enumerate() {
        assert!((finest[3 + k] - e).abs() < 1e-15, "{:?}", &finest[..8]);
    }
    let [left, right] = [wavelet(CURVE / 2), wavelet(CURVE - 1)];
    for (found, expected) in [(&left[..5], FIRST), (&right[CURVE - 5..], LAST)] {
        for (f, e) in found.iter().zip(expected) {
            assert!((f - e).abs() < 1e-14, "{found:?}");
        }
    }
}

const FIRST: [f64; 5] =
    [-0.23198099841120287, 0.3564292099038641, -0.4182332488336155, 0.6951028616004581, -0.4013178242595038];
const LAST: [f64; 5] =
    [0.05572249300812741, 0.09651418901447824, -0.621352591012901, 0.7302726429498555, -0.26115673395956];

/// Each column's wavelet lies in the band of its level, and in the finest levels of its place.
#[test]
fn columns_stand_in_their_bands() {
    let bands = ColumnSpace::daubechies4(1).unwrap().bands();
    assert_eq!(bands.starts, [0, 8, 16, 32, 36, 40, 64, 72, 80, 128, 144, 160, 256]);
    for j in 128..CURVE {
        let touched: Vec<usize> = (0..CURVE).filter(|&k| wavelet(j)[k] != 0.0).collect();
        assert!(touched.len() <= 5 && bands.areas[j] == 2.0, "{j}: {touched:?}");
        let place = [31, 63].iter().filter(|&&first| touched[0] >= first).count();
        assert_eq!(bands.of(j), 9 + place, "{j}: {touched:?}");
    }
    assert_eq!((bands.areas[0], bands.areas[8], bands.areas[16], bands.always), (32.0, 32.0, 16.0, COARSEST));
    let three = ColumnSpace::daubechies4(3).unwrap().bands();
    assert_eq!(three.starts, bands.starts.iter().map(|start| 3 * start).collect::<Vec<_>>());
    assert_eq!(three.always, 24);
    assert!(ColumnSpace::daubechies4(0).is_err() && ColumnSpace::daubechies4(17).is_err());
}

#[test]
fn constants_and_ramps_stay_in_the_scaling_functions() {
    for (curve, most) in [(sampled(|_| 1.0), 6), (sampled(|k| k as f64), 8)] {
        let coefficients = Daubechies4::shared().forward(&curve);
        let size = largest(coefficients);
        let kept = coefficients.iter().filter(|c| c.abs() > 1e-13 * size).count();
        assert!(kept <= most && coefficients[COARSEST..].iter().all(|c| c.abs() <= 1e-13 * size), "{kept}");
    }
}

/// Terms until a curve is within a share of its peak.
fn needed(curve: &[f64; CURVE], error: f64) -> usize {
    let off = |terms| {
        let near = of_terms(curve, terms);
        largest((0..CURVE).map(|k| curve[k] - near[k]))
    };
    (1..=CURVE).find(|&terms| off(terms) <= error).expect("all terms are the curve")
}

/// REFLECTANCE 5.1: 17 terms are within 1 % of the peak, at the roughnesses of its table; of those between, 231 of 243 take no
/// more, and none takes more than 19.
#[test]
fn seventeen_terms_are_a_highlight() {
    for sigma in [0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.3] {
        for (name, curve) in highlights(sigma) {
            assert!(needed(&curve, 0.01) <= 17, "{name} of {sigma}");
        }
    }
    let between = (0..=80).flat_map(|step| highlights(0.01 * 30f64.powf(f64::from(step) / 80.0)));
    let terms: Vec<usize> = between.map(|(_, curve)| needed(&curve, 0.01)).collect();
    assert_eq!((terms.iter().filter(|&&terms| terms <= 17).count(), terms.iter().max()), (231, Some(&19)));
}

/// A highlight of ten terms leaves nothing at grazing angles, where periodic wavelets leave a fifth of it.
#[test]
fn nothing_leaks_to_the_other_end() {
    for step in 0..=20 {
        let sigma = 0.01 * 20f64.powf(f64::from(step) / 20.0);
        let [(name, curve), ..] = highlights(sigma);
        let end = largest(of_terms(&curve, 10)[CURVE - 16..].to_vec());
        assert!(end < 1e-9, "{name} of {sigma:.3}: {end:e}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn curves_come_back(values in prop::array::uniform32(-1e6..1e6f64), at in 0usize..CURVE) {
        let curve = sampled(|k| values[(k + at) % 32] * (k as f64 / 9.0).sin());
        let d4 = Daubechies4::shared();
        let back = d4.inverse(&d4.forward(&curve));
        prop_assert!(largest((0..CURVE).map(|k| back[k] - curve[k])) <= 1e-14 * 1e6 * 16.0);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4000, failure_persistence: None, ..ProptestConfig::default() })]

    /// c F q is f cos theta_i, whatever the model; what is far below the peak is lost in rounding.
    #[test]
    fn a_curve_times_what_is_left_is_the_model(model in models(), (wi, wo) in pairs()) {
        let model: Arc<dyn Brdf> = Arc::from(model);
        let Some(curved) = model.curved() else { return Ok(()) };
        let Some((share, colours)) = Quotient::of_model(Arc::clone(&model)).unwrap().share(wi, wo) else {
            prop_assert_eq!(model.evaluate(wi, wo), 0.0);
            return Ok(());
        };
        prop_assert!((0.0..=1.0).contains(&share.u) && share.quotient.is_finite() && share.quotient >= 0.0);
        prop_assert_eq!(colours, [share.quotient; 3]);
        let (curve, fresnel) = (curved.curve(share.u), curved.fresnel().at(share.cos_d));
        prop_assert!(curve.is_finite() && curve >= 0.0);
        let (found, expected) = (curve * fresnel * share.quotient, model.evaluate(wi, wo) * wi[2]);
        // At the horizon of half vectors 1 - u⁴ has no digits left.
        let far = 1.0 - share.u.powi(4) < 1e-4 || expected < 1e-100;
        prop_assert!(far || near(found, expected, 1e-7), "{model:?}: {found} {expected}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, ..ProptestConfig::default() })]

    /// Many directions at once take what each takes by itself, to the bit, whatever lies below the horizon.
    #[test]
    fn many_shares_are_those_of_each(model in models(), all in prop::collection::vec(pairs(), 1..20), flip in 0usize..20) {
        let model: Arc<dyn Brdf> = Arc::from(model);
        let Ok(quotient) = Quotient::of_model(model) else { return Ok(()) };
        let wo = all[0].1;
        let mut wi: Vec<[f64; 3]> = all.iter().map(|pair| pair.0).collect();
        wi.iter_mut().skip(flip).for_each(|own| own[2] = -own[2]);
        let axes: [Vec<f64>; 3] = std::array::from_fn(|axis| wi.iter().map(|own| own[axis]).collect());
        let mut found = Shares::default();
        quotient.shares(axes.each_ref().map(Vec::as_slice), wo, &mut found);
        for (k, &wi) in wi.iter().enumerate() {
            let colours: [f64; 3] = std::array::from_fn(|c| found.colours[c][k]);
            match quotient.share(wi, wo) {
                Some((share, expected)) => {
                    prop_assert_eq!((found.u[k], found.cos_d[k], colours), (share.u, share.cos_d, expected));
                }
                None => prop_assert_eq!((found.u[k], found.cos_d[k], colours), (0.0, 0.0, [0.0; 3])),
            }
        }
    }
}

/// A model without a lobe has no curve, and a measured one needs one above 0.
#[test]
fn what_has_no_curve_is_refused() {
    assert!(Quotient::of_model(Arc::new(Lambert)).is_err());
    let table: Arc<dyn Measured> = Arc::new(Merl::new(vec![[0.25; 3]; MERL.iter().product()]).unwrap());
    for curve in [vec![], vec![[1.0; 3]], vec![[1.0, 0.0, 1.0]; 4], vec![[f64::NAN; 3]; 4]] {
        assert!(Quotient::of_measured(Arc::clone(&table), curve).is_err());
    }
}

/// With its own curve a measured material is what it is.
#[test]
fn the_quotient_of_a_measured_material_holds_the_rest() {
    let table: Arc<dyn Measured> = Arc::new(Merl::new(vec![[0.25, 0.5, 0.75]; MERL.iter().product()]).unwrap());
    let curve: Vec<[f64; 3]> = (0..9).map(|k| [1.0 + f64::from(k), 9.0, 0.5 * f64::from(k + 1)]).collect();
    let quotient = Quotient::of_measured(Arc::clone(&table), curve.clone()).unwrap();
    let (wi, wo) = ([0.48, 0.6, 0.64], [-0.6, 0.0, 0.8]);
    let (share, colours) = quotient.share(wi, wo).unwrap();
    let (node, rest) = between(share.u, curve.len());
    for k in 0..3 {
        let own = (1.0 - rest) * curve[node][k] + rest * curve[node + 1][k];
        assert!(near(own * colours[k], table.colour(wi, wo)[k] * wi[2], 1e-12));
    }
}

/// Columns of several factors stand in the bands of their coefficients, each once.
#[test]
fn factors_share_bands() {
    for factors in 1..=5 {
        let bands = ColumnSpace::daubechies4(factors).unwrap().bands();
        let one = ColumnSpace::daubechies4(1).unwrap().bands();
        let mut met = vec![false; factors * CURVE];
        for own in columns_of(factors).unwrap() {
            for (coefficient, column) in own.into_iter().enumerate() {
                assert_eq!(bands.of(column), one.of(coefficient));
                assert!(!std::mem::replace(&mut met[column], true));
            }
        }
    }
}
