//! Choosing: every method under one suite of laws, and against brute force.

use _core::basis::{Bands, ColumnSpace};
use _core::error::Error;
use _core::update::{Approximation, BandTest, Budget, Colours, Method, Norm, Pace, Settings, Update};
use proptest::prelude::*;

type Light = Vec<[f64; 3]>;

/// Four bands of 6 + 18, 72 and 288 columns would be slow to enumerate: 6, 6, 12 and 20 do.
fn bands() -> Bands {
    let areas = [(12, 16.0), (12, 4.0), (20, 1.0)];
    Bands {
        starts: vec![0, 6, 12, 24, 44],
        areas: areas.iter().flat_map(|&(n, area)| vec![area; n]).collect(),
        always: 0,
        texels: 0,
    }
}

const PER_BAND: fn(BandTest, Norm) -> Method = |test, norm| Method::PerBand { test, norm };

/// The one list that a new method joins.
pub fn every_method() -> Vec<Method> {
    use {BandTest::*, Norm::*};
    vec![
        Method::Full,
        Method::Nonlinear,
        Method::Linear,
        Method::Incremental,
        PER_BAND(Simple, L1),
        PER_BAND(Simple, L2),
        PER_BAND(Dealer, L1),
        PER_BAND(Dealer, L2),
        PER_BAND(Exhaustive, L1),
        PER_BAND(Exhaustive, L2),
        PER_BAND(Fixed { incremental: 2 }, L1),
        Method::HarmonicOrder { tolerance: 5e-4 },
    ]
}

fn methods() -> impl Strategy<Value = Method> {
    prop::sample::select(every_method())
}

fn settings() -> impl Strategy<Value = Settings> {
    let channels = prop::sample::select(vec![Colours::Joint, Colours::Separate]);
    let budget = prop_oneof![
        prop::sample::select(vec![0, 1, 7, 30, usize::MAX]).prop_map(Budget::Terms),
        prop::sample::select(vec![0.0, 1.0, 50.0, 1e9]).prop_map(Budget::Cost),
    ];
    (methods(), budget, channels, any::<bool>(), 0..3usize).prop_map(|(method, budget, channels, area, free)| {
        let bands = bands();
        // Some columns may be worth nothing, and some may cost nothing.
        let weights = if area { bands.areas.clone() } else { (0..44).map(|j| (j % 5) as f64 * 0.3).collect() };
        let costs = (0..44).map(|j| if j % 7 < free { 0.0 } else { 1.0 + (j % 11) as f64 }).collect();
        Settings { method, budget, weights, costs, colours: channels }
    })
}

/// Coefficients with many zeros and ties, or of wildly different size.
fn light() -> impl Strategy<Value = Light> {
    let tied = (-2..3i32).prop_map(f64::from);
    let wild = (-1.0..1.0f64, -30..38i32).prop_map(|(x, exponent)| x * 10f64.powi(exponent));
    let even = -1.0..1.0f64;
    prop_oneof![
        prop::collection::vec(prop::array::uniform3(tied), 44),
        prop::collection::vec(prop::array::uniform3(wild), 44),
        prop::collection::vec(prop::array::uniform3(even), 44),
        Just(vec![[0.0; 3]; 44]),
    ]
}

/// Coefficients whose sums are exact in any order, so that two programs cannot differ by rounding.
fn exact_light() -> impl Strategy<Value = Light> {
    let even = prop::array::uniform3((-1i64 << 40..1 << 40).prop_map(|x| x as f64));
    let tied = prop::array::uniform3((-2..3i32).prop_map(f64::from));
    prop_oneof![prop::collection::vec(even, 44), prop::collection::vec(tied, 44)]
}

/// Follows an update by hand: what whoever multiplies does.
fn replay(bands: &Bands, values: &[[f64; 3]], update: &Update) -> Light {
    let mut values = values.to_vec();
    for &band in &update.resets {
        values[bands.range(band)].fill([0.0; 3]);
    }
    for term in &update.terms {
        for (value, change) in values[term.column as usize].iter_mut().zip(term.change) {
            *value += change;
        }
    }
    values
}

/// The columns that an update streams: those it sends, and those that a reset takes out. Where all that is held is reset,
/// sums start from zero, and nothing is taken out.
fn streamed(bands: &Bands, before: &[[f64; 3]], update: &Update) -> impl Iterator<Item = usize> {
    let held = |j: &usize| before[*j] != [0.0; 3];
    let all: Vec<usize> = (0..bands.columns()).filter(held).collect();
    let reset: Vec<usize> = update.resets.iter().flat_map(|&band| bands.range(band)).filter(held).collect();
    let sent = update.terms.iter().map(|term| term.column as usize);
    let out = if reset == all { Vec::new() } else { reset };
    sent.chain(out).collect::<std::collections::BTreeSet<usize>>().into_iter()
}

/// The error that a method promises not to raise, band by band: weighted L1, or squared L2.
fn error(settings: &Settings, target: &[[f64; 3]], values: &[[f64; 3]]) -> f64 {
    let square = matches!(settings.method, Method::PerBand { norm: Norm::L2, .. });
    let term = |x: f64| if square { x * x } else { x.abs() };
    let light = settings.weights.iter().zip(target.iter().zip(values));
    light.flat_map(|(w, (t, v))| (0..3).map(move |c| term(w * (t[c] - v[c])))).sum()
}

fn start(settings: Settings, values: &[[f64; 3]]) -> Approximation {
    let mut follow = Approximation::new(bands(), settings).unwrap();
    follow.set_values(values).unwrap();
    follow
}

fn norm(keys: impl Iterator<Item = f64>) -> f64 {
    keys.sum()
}

/// Fig. 6.1 as it is printed: modes by the simple test, keys, a full sort, the first `terms`.
fn printed(method: Method, terms: usize, weights: &[f64], target: &[[f64; 3]], values: &[[f64; 3]]) -> Light {
    let bands = bands();
    let size = |x: [f64; 3]| x[0].abs() + x[1].abs() + x[2].abs();
    let change = |j: usize| [0, 1, 2].map(|c| target[j][c] - values[j][c]);
    let mut keys = Vec::new();
    let mut result = values.to_vec();
    for band in 0..bands.count() {
        let difference = norm(bands.range(band).map(|j| weights[j] * size(change(j))));
        let whole = norm(bands.range(band).map(|j| weights[j] * size(target[j])));
        let incremental = match method {
            Method::Nonlinear => false,
            Method::Incremental => true,
            _ => difference < whole || difference == 0.0,
        };
        for j in bands.range(band) {
            keys.push((weights[j] * size(if incremental { change(j) } else { target[j] }), j));
            if !incremental {
                result[j] = [0.0; 3];
            }
        }
    }
    keys.sort_by(|a, b| b.0.partial_cmp(&a.0).unwrap().then(a.1.cmp(&b.1)));
    for &(key, j) in keys.iter().take(terms) {
        if key > 0.0 {
            result[j] = target[j];
        }
    }
    result
}

fn joint(method: Method, budget: Budget) -> Settings {
    Settings { method, budget, weights: bands().areas, costs: Vec::new(), colours: Colours::Joint }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    /// One step of anything: the update tells all that happened, within the budget, and nothing that did not.
    #[test]
    fn step_is_an_update(settings in settings(), before in light(), target in light()) {
        let bands = bands();
        let mut follow = start(settings.clone(), &before);
        let update = follow.step(&target).unwrap();

        prop_assert!(update.resets.is_sorted_by(|a, b| a < b));
        prop_assert!(update.terms.is_sorted_by(|a, b| a.column < b.column));
        for &band in &update.resets {
            prop_assert!(before[bands.range(band)].iter().any(|value| *value != [0.0; 3]));
        }
        prop_assert!(update.terms.iter().all(|term| term.change != [0.0; 3]));

        // Changes round, values do not: they are the light itself, bit for bit.
        let replayed = replay(&bands, &before, &update);
        for j in 0..bands.columns() {
            let sent = update.terms.iter().find(|term| term.column as usize == j);
            for c in 0..3 {
                let value = follow.values()[j][c];
                prop_assert!((value - replayed[j][c]).abs() <= 1e-15 * (before[j][c].abs() + target[j][c].abs()));
                match sent {
                    Some(term) if term.change[c] != 0.0 => prop_assert_eq!(value.to_bits(), target[j][c].to_bits()),
                    _ => prop_assert_eq!(value, replayed[j][c]),
                }
            }
        }

        let pairs = |term: &_core::update::Term| term.change.iter().filter(|change| **change != 0.0).count();
        let sent = match settings.colours {
            Colours::Joint => update.terms.len(),
            Colours::Separate => update.terms.iter().map(pairs).sum(),
        };
        match settings.budget {
            _ if settings.method == Method::Full => prop_assert_eq!(follow.values(), &target[..]),
            Budget::Terms(0) | Budget::Cost(0.0) if !matches!(settings.method, Method::Nonlinear | Method::Linear) => {
                prop_assert_eq!(update, Update::default());
            }
            Budget::Terms(terms) => prop_assert!(sent <= terms),
            Budget::Cost(budget) if settings.colours == Colours::Joint => {
                let costs: Vec<f64> = streamed(&bands, &before, &update).map(|j| settings.costs[j]).collect();
                let paid = costs.iter().filter(|cost| **cost > 0.0).count();
                prop_assert!(costs.iter().sum::<f64>() <= budget || paid == 1, "{costs:?} for {budget}");
            }
            _ => {}
        }
    }

    /// Still light: the error never rises, and every column is right within ceil(m / k) frames.
    #[test]
    fn still_light_is_reached(settings in settings(), before in light(), target in light()) {
        let stuck = matches!(
            settings.method,
            Method::Nonlinear | Method::Linear | Method::PerBand { test: BandTest::Fixed { .. }, .. }
        );
        prop_assume!(!stuck && !matches!(settings.budget, Budget::Terms(0) | Budget::Cost(0.0)));
        let mut follow = start(settings.clone(), &before);
        let mut last = error(&settings, &target, &before);
        let first = follow.step(&target).unwrap();

        // m is what differs once the first frame has reset what it resets.
        let lanes = if settings.colours == Colours::Joint { 1 } else { 3 };
        let left = follow.values().iter().zip(&target).filter(|(v, t)| v != t).count() * lanes;
        let automatic = matches!(
            settings.method,
            Method::PerBand { test: BandTest::Dealer | BandTest::Exhaustive, .. }
        );
        let frames = match settings.budget {
            Budget::Terms(terms) if !automatic => left.div_ceil(terms),
            _ => 3 * 2 * 44,
        };
        for frame in 0..=frames {
            let now = error(&settings, &target, follow.values());
            prop_assert!(now <= last * (1.0 + 1e-12), "frame {frame}: {last:e} rose to {now:e}, {first:?}");
            last = now;
            if follow.is_converged(&target) {
                prop_assert_eq!(follow.step(&target).unwrap(), Update::default());
                return Ok(());
            }
            prop_assert!(frame < frames, "not there after {frames} frames");
            follow.step(&target).unwrap();
        }
    }

    /// A bad frame is refused and forgotten.
    #[test]
    fn bad_light_is_refused(settings in settings(), before in light(), at in 0..44usize, colour in 0..3usize) {
        let mut follow = start(settings, &before);
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e91] {
            let mut target = before.clone();
            target[at][colour] = bad;
            prop_assert!(matches!(follow.step(&target), Err(Error::Input(_))));
            prop_assert_eq!(follow.values(), &before[..]);
        }
        prop_assert!(matches!(follow.step(&before[1..]), Err(Error::Input(_))));
        prop_assert_eq!(follow.values(), &before[..]);
    }

    /// NWA, BI and PBI against the page they come from.
    #[test]
    fn as_printed(before in exact_light(), target in exact_light(), terms in 1..50usize) {
        for method in [Method::Nonlinear, Method::Incremental, PER_BAND(BandTest::Simple, Norm::L1)] {
            let mut follow = start(joint(method, Budget::Terms(terms)), &before);
            follow.step(&target).unwrap();
            let expected = printed(method, terms, &bands().areas, &target, &before);
            prop_assert_eq!(follow.values(), &expected[..], "{:?}", method);
        }
    }

    /// No combination of modes, with any allocation, beats the exhaustive test; the dealer leaves no band black.
    #[test]
    fn automatic_tests(before in light(), target in light(), terms in 1..50usize) {
        let error = |values: &[[f64; 3]]| error(&joint(Method::Full, Budget::Terms(0)), &target, values);
        let mut best = f64::INFINITY;
        for combination in 0..16 {
            // Brute force: reset by hand, then BI.
            let mut values = before.clone();
            for band in (0..4).filter(|band| combination >> band & 1 == 1) {
                values[bands().range(band)].fill([0.0; 3]);
            }
            let mut follow = start(joint(Method::Incremental, Budget::Terms(terms)), &values);
            follow.step(&target).unwrap();
            best = best.min(error(follow.values()));
        }
        let mut follow = start(joint(PER_BAND(BandTest::Exhaustive, Norm::L1), Budget::Terms(terms)), &before);
        follow.step(&target).unwrap();
        prop_assert!((error(follow.values()) - best).abs() <= 1e-12 * best);

        let mut follow = start(joint(PER_BAND(BandTest::Dealer, Norm::L1), Budget::Terms(terms)), &before);
        let update = follow.step(&target).unwrap();
        prop_assert!(error(follow.values()) >= best * (1.0 - 1e-12));
        for band in update.resets {
            let range = bands().range(band);
            let lit = follow.values()[range.clone()].iter().any(|value| *value != [0.0; 3]);
            prop_assert!(lit || target[range].iter().all(|value| *value == [0.0; 3]));
        }
    }

    /// A budget in error sends what it must and no more.
    #[test]
    fn error_budget(before in light(), target in light(), method in methods(), share in 0.0..1.5f64) {
        let automatic = matches!(method, Method::PerBand { test: BandTest::Dealer | BandTest::Exhaustive, .. });
        let factors = vec![2.0, 1.0, 0.5, 0.25];
        let bound = |values: &[[f64; 3]]| {
            let colour = |c: usize| -> f64 {
                let band = |b: usize| bands().range(b).map(|j| (target[j][c] - values[j][c]).powi(2)).sum::<f64>();
                (0..4).map(|b| factors[b] * band(b).sqrt()).sum()
            };
            colour(0).max(colour(1)).max(colour(2))
        };
        let tolerance = share * bound(&before);
        let settings = joint(method, Budget::Error { tolerance, factors: factors.clone() });
        if automatic {
            let refused = Approximation::new(bands(), settings);
            prop_assert!(matches!(refused, Err(Error::Input(_))));
            return Ok(());
        }
        let mut follow = start(settings, &before);
        let update = follow.step(&target).unwrap();
        prop_assert!(bound(follow.values()) <= tolerance * (1.0 + 1e-12));

        // One term fewer of the least key would not do (keys and order are those of BI).
        if method == Method::Incremental && !update.terms.is_empty() {
            let mut shorter = start(joint(method, Budget::Terms(update.terms.len() - 1)), &before);
            shorter.step(&target).unwrap();
            prop_assert!(bound(shorter.values()) > tolerance * (1.0 - 1e-12));
        }
    }
}

/// Linear: the first columns of the light, dark ones counted, and nothing else.
#[test]
fn linear_keeps_the_first_columns() {
    let mut target: Light = (0..44).map(|j| [j as f64 + 1.0, 0.5, 0.0]).collect();
    target[3] = [0.0; 3];
    let mut follow = start(joint(Method::Linear, Budget::Terms(9)), &[[7.0; 3]; 44]);
    let update = follow.step(&target).unwrap();
    assert_eq!((update.resets, update.terms.len()), (vec![0, 1, 2, 3], 8));
    let expected: Light = (0..44).map(|j| if j < 9 { target[j] } else { [0.0; 3] }).collect();
    assert_eq!(follow.values(), &expected[..]);
}

/// 256 coefficients and 30 a frame: exact in ceil(256 / 30) = 9 frames (Overbeck 2006, section 4.2), not in 8.
#[test]
fn nine_frames() {
    let bands = Bands { starts: vec![0, 256], areas: vec![1.0; 256], always: 0, texels: 0 };
    let target: Light = (0..256).map(|j| [1.0 / (j + 1) as f64, 0.3, -(j as f64)]).collect();
    let settings = Settings { weights: vec![1.0; 256], ..joint(Method::Incremental, Budget::Terms(30)) };
    let mut follow = Approximation::new(bands, settings).unwrap();
    for frame in 1..=9 {
        follow.step(&target).unwrap();
        assert_eq!(follow.is_converged(&target), frame == 9);
    }
}

/// By hand. Light (4, 1 | 8, 6), copy (5, 0 | -8, 0), two bands of two columns, weights 1, two terms.
///
/// Band 0: |(-1, 1)| = 2 < 5, incremental, keys 1, 1. Band 1: |(16, 6)| = 22 >= 14, reset, keys 8, 6. The largest two
/// are both of band 1. A static threshold between them says the same. With one term, dealer: resetting band 1 for its
/// largest takes 22 - 6 = 16 off, its largest change 16 as well: of equals the increment stays.
#[test]
fn two_bands_by_hand() {
    let bands = Bands { starts: vec![0, 2, 4], areas: vec![1.0; 4], always: 0, texels: 0 };
    let gray = |x: [f64; 4]| x.map(|x| [x, 0.0, 0.0]).to_vec();
    let (copy, target) = (gray([5.0, 0.0, -8.0, 0.0]), gray([4.0, 1.0, 8.0, 6.0]));
    let after = |test, terms| {
        let settings = Settings { weights: vec![1.0; 4], ..joint(PER_BAND(test, Norm::L1), Budget::Terms(terms)) };
        let mut follow = Approximation::new(bands.clone(), settings).unwrap();
        follow.set_values(&copy).unwrap();
        let update = follow.step(&target).unwrap();
        (update.resets, follow.values().iter().map(|value| value[0]).collect::<Vec<f64>>())
    };
    assert_eq!(after(BandTest::Simple, 2), (vec![1], vec![5.0, 0.0, 8.0, 6.0]));
    assert_eq!(after(BandTest::Simple, 1), (vec![1], vec![5.0, 0.0, 8.0, 0.0]));
    assert_eq!(after(BandTest::Fixed { incremental: 1 }, 2), (vec![1], vec![5.0, 0.0, 8.0, 6.0]));
    assert_eq!(after(BandTest::Dealer, 1), (vec![], vec![5.0, 0.0, 8.0, 0.0]));
    assert_eq!(after(BandTest::Exhaustive, 1), (vec![], vec![5.0, 0.0, 8.0, 0.0]));
}

/// Fig. 8.1: the low band is filled to its tolerance before the high one gets a term, whatever is larger; a band that
/// gets none keeps its values.
#[test]
fn harmonics_fill_low_bands_first() {
    let bands = Bands { starts: vec![0, 1, 4], areas: vec![1.0; 4], always: 0, texels: 0 };
    let gray = |x: [f64; 4]| x.map(|x| [x, 0.0, 0.0]).to_vec();
    let target = gray([1.0, 100.0, 50.0, 2.0]);
    let after = |tolerance, terms| {
        let method = Method::HarmonicOrder { tolerance };
        let settings = Settings { weights: vec![1.0; 4], ..joint(method, Budget::Terms(terms)) };
        let mut follow = Approximation::new(bands.clone(), settings).unwrap();
        follow.set_values(&gray([0.0, 7.0, 0.0, 0.0])).unwrap();
        follow.step(&target).unwrap();
        follow.values().iter().map(|value| value[0]).collect::<Vec<f64>>()
    };
    assert_eq!(after(5e-4, 1), [1.0, 7.0, 0.0, 0.0]);
    assert_eq!(after(5e-4, 2), [1.0, 100.0, 0.0, 0.0]);
    // 1 is within a tenth of 153: the high band comes first, down to 15.3; then 1.53 lets the 2 in before the 1.
    assert_eq!(after(0.1, 1), [0.0, 100.0, 0.0, 0.0]);
    assert_eq!(after(0.1, 3), [0.0, 100.0, 50.0, 2.0]);
    assert_eq!(after(0.1, 4), [1.0, 100.0, 50.0, 2.0]);
}

/// By hand. Light (4, 1 | 8, 6, 0), copy (5, 0 | -8, -7, -1), every column costs 1. Band 1 is nearer to zero; to reset it
/// costs 3, and puts the light into the columns that it takes out. What is left pays for the first band.
#[test]
fn resets_cost_what_they_stream() {
    let bands = Bands { starts: vec![0, 2, 5], areas: vec![1.0; 5], always: 0, texels: 0 };
    let gray = |x: [f64; 5]| x.map(|x| [x, 0.0, 0.0]).to_vec();
    let (copy, target) = (gray([5.0, 0.0, -8.0, -7.0, -1.0]), gray([4.0, 1.0, 8.0, 6.0, 0.0]));
    let after = |test, cost| {
        let budget = Budget::Cost(cost);
        let settings =
            Settings { weights: vec![1.0; 5], costs: vec![1.0; 5], ..joint(PER_BAND(test, Norm::L1), budget) };
        let mut follow = Approximation::new(bands.clone(), settings).unwrap();
        follow.set_values(&copy).unwrap();
        let update = follow.step(&target).unwrap();
        (update.resets, follow.values().iter().map(|value| value[0]).collect::<Vec<f64>>())
    };
    for test in [BandTest::Simple, BandTest::Fixed { incremental: 1 }] {
        assert_eq!(after(test, 1.0), (vec![], vec![5.0, 0.0, 8.0, -7.0, -1.0]));
        assert_eq!(after(test, 2.0), (vec![], vec![5.0, 0.0, 8.0, 6.0, -1.0]));
        assert_eq!(after(test, 3.0), (vec![1], vec![5.0, 0.0, 8.0, 6.0, 0.0]));
        assert_eq!(after(test, 4.0), (vec![1], vec![4.0, 0.0, 8.0, 6.0, 0.0]));
    }
    for test in [BandTest::Dealer, BandTest::Exhaustive] {
        assert_eq!(after(test, 1.0), (vec![], vec![5.0, 0.0, 8.0, -7.0, -1.0]));
        assert_eq!(after(test, 5.0).1, vec![4.0, 1.0, 8.0, 6.0, 0.0]);
    }
}

/// A band whose columns M does not have is not reset, though all of them have changed.
#[test]
fn colours_share_the_cost_of_their_column() {
    let settings =
        Settings { costs: vec![1.0; 44], colours: Colours::Separate, ..joint(Method::Incremental, Budget::Cost(2.0)) };
    let mut follow = Approximation::new(bands(), settings).unwrap();
    let target: Light = (0..44).map(|column| [1.0 + f64::from(column), 0.5, 0.25]).collect();
    let sent = follow.step(&target).unwrap().terms;
    assert_eq!(sent.iter().flat_map(|term| term.change).filter(|change| *change != 0.0).count(), 6);
}

#[test]
fn worthless_bands_are_left_alone() {
    for norm in [Norm::L1, Norm::L2] {
        let weights = (0..44).map(|j| if j < 24 { 1.0 } else { 0.0 }).collect();
        let settings = Settings { weights, ..joint(PER_BAND(BandTest::Simple, norm), Budget::Terms(10)) };
        let update = start(settings, &[[-1.0; 3]; 44]).step(&[[1.0; 3]; 44]).unwrap();
        assert_eq!(update.resets, [0, 1, 2]);
    }
}

/// A machine with a fixed part of 0.4 ms and 5 GB/s, off by up to a fifth, where one frame in fifty takes thrice as long;
/// then one of half the speed. Of frames of 2 ms nearly all are in time, and they use it.
#[test]
fn pace_keeps_time() {
    let mut state = 1u64;
    let mut noise = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let (mut pace, budget) = (Pace::default(), 2e-3);
    for slow in [1.0, 2.0, 1.0] {
        let mut times: Vec<f64> = (0..400)
            .map(|_| {
                // A band reset now and then takes more than can be cut.
                let cost = pace.affordable(budget).max(if noise() < 0.1 { 1e6 } else { 0.0 });
                let late = if noise() < 0.02 { 3.0 } else { 1.0 };
                let seconds = (4e-4 + slow * cost / 5e9) * (0.9 + 0.2 * noise()) * late;
                pace.learn(cost, seconds);
                seconds
            })
            .collect();
        // It has learnt within a few frames.
        let mut settled = times.split_off(40);
        settled.sort_by(f64::total_cmp);
        let [median, p95] = [settled.len() / 2, settled.len() * 95 / 100].map(|k| settled[k] / budget);
        assert!((0.75..1.0).contains(&median) && p95 <= 1.1, "at {slow}: median {median}, p95 {p95}");
    }
    assert_eq!(pace.affordable(0.0), 0.0);
    assert_eq!(pace.affordable(-1.0), 0.0);
}

/// One test for every way to set it up wrong.
#[test]
fn settings_are_checked() {
    let good = joint(PER_BAND(BandTest::Exhaustive, Norm::L1), Budget::Terms(1));
    let refused = |bands: Bands, settings: Settings| {
        assert!(matches!(Approximation::new(bands, settings), Err(Error::Input(_))));
    };
    assert!(Approximation::new(bands(), good.clone()).is_ok());
    refused(bands(), Settings { weights: vec![1.0; 43], ..good.clone() });
    refused(bands(), Settings { weights: vec![-1.0; 44], ..good.clone() });
    refused(bands(), Settings { weights: vec![f64::NAN; 44], ..good.clone() });
    refused(bands(), Settings { costs: vec![1.0; 43], ..good.clone() });
    refused(bands(), Settings { budget: Budget::Cost(1.0), ..good.clone() });
    refused(bands(), Settings { budget: Budget::Cost(f64::NAN), costs: vec![1.0; 44], ..good.clone() });
    let tolerated = |factors| Budget::Error { tolerance: 0.1, factors };
    refused(bands(), joint(Method::Incremental, tolerated(vec![1.0; 3])));
    refused(bands(), joint(Method::HarmonicOrder { tolerance: f64::NAN }, Budget::Terms(1)));
    let many = Bands { starts: (0..=13).collect(), areas: vec![1.0; 13], always: 0, texels: 0 };
    refused(many, Settings { weights: vec![1.0; 13], ..good.clone() });
    for starts in [vec![], vec![0], vec![0, 12, 6, 24, 44], vec![1, 6, 44], vec![0, 6, 12, 24, 43]] {
        refused(Bands { starts, ..bands() }, good.clone());
    }

    // A budget that is refused leaves the old one in force.
    let mut follow = Approximation::new(bands(), good).unwrap();
    assert!(follow.set_budget(Budget::Cost(-1.0)).is_err());
    assert_eq!(follow.settings().budget, Budget::Terms(1));
}

/// The bands of a real basis: a light that stands still on a Haar cubemap of 16 x 16 texels a face.
#[test]
fn haar_bands() {
    let bands = ColumnSpace::haar(16).unwrap().bands();
    let columns = bands.columns();
    let target: Light = (0..columns).map(|j| [(j as f64).sin(), 1.0 / (1.0 + j as f64), 0.5]).collect();
    let settings =
        Settings { weights: bands.areas.clone(), ..joint(PER_BAND(BandTest::Simple, Norm::L1), Budget::Terms(100)) };
    let mut follow = Approximation::new(bands, settings).unwrap();
    for frame in 1..=columns.div_ceil(100) {
        assert!(!follow.is_converged(&target), "frame {frame}");
        assert!(follow.step(&target).unwrap().resets.is_empty());
    }
    assert!(follow.is_converged(&target));
}
