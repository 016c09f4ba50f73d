//! One suite: every form of storage x every space of columns x every method, followed through frames and held against
//! plain products in f64. A new form, space or method joins by one line.

use std::sync::Arc;

use _core::basis::cubemap::{solid_angles, texel_direction};
use _core::basis::{ColumnSpace, HaarTree};
use _core::transport::lobes::DIFFUSE;
use _core::transport::weights::NEGATIVE;
use _core::transport::{
    Channels, Dense, Factors, Link, LobeModels, Lobes, Product, RowLobe, RowNorms, TransportMatrix, Weights, Width,
    bf16_up,
};
use _core::update::{Budget, Chain, Chosen, Colours, Initial, Mix, Settings, Updater};

use crate::transport::{matrix, noise, random_dense, rule};
use crate::update::every_method;

type Light = Vec<[f64; 3]>;

const ROWS: usize = 40;
const TERMS: usize = 24;

fn spaces() -> Vec<ColumnSpace> {
    vec![ColumnSpace::haar(4).unwrap(), ColumnSpace::spherical_harmonics(6).unwrap(), ColumnSpace::lamps(30).unwrap()]
}

/// A product, its mix, and what it stands for in f64.
struct Form {
    product: Product,
    mix: Option<Mix>,
    oracle: Oracle,
}

/// From V to B, both in f64.
type Oracle = Box<dyn Fn(&[[f64; 3]]) -> Vec<[f64; 3]>>;
/// A form over a column space.
type Make = fn(ColumnSpace) -> Form;

/// The one list that a new form joins.
const FORMS: &[(&str, Make)] = &[
    ("i8", |space| one(matrix(space, ROWS, Channels::One, 1, Width::I8))),
    ("i16", |space| one(matrix(space, ROWS, Channels::One, 2, Width::I16))),
    ("truncated", |space| {
        let dense = random_dense(space, ROWS, Channels::One, 22);
        Form {
            oracle: Box::new(plain(dense.clone())),
            ..one(dense.compress(space, &rule(space, 0.05, Width::I8), 32).unwrap())
        }
    }),
    ("long rows", |space| {
        let mut dense = random_dense(space, ROWS, Channels::One, 23);
        dense.values.iter_mut().enumerate().for_each(|(k, x)| *x *= if k % 3 == 0 { 4096.0 } else { 1.0 });
        Form {
            oracle: Box::new(plain(dense.clone())),
            ..one(dense.compress(space, &rule(space, 0.0, Width::I16), 32).unwrap())
        }
    }),
    ("texels", |_| texels(0.0, false)),
    ("texels, truncated", |_| texels(0.05, false)),
    ("texels, glossy", |_| texels(0.05, true)),
    ("three channels", |space| one(matrix(space, ROWS, Channels::Three, 3, Width::I8))),
    ("factors", |space| {
        let each: Vec<_> = (4..7).map(|seed| Arc::new(matrix(space, ROWS, Channels::One, seed, Width::I8))).collect();
        let product = Product::new(Factors::new(each.clone()).unwrap(), Link::None, None).unwrap();
        let oracles: Vec<_> = each.iter().map(|matrix| dense(matrix)).collect();
        mixed(product, move |light| oracles.iter().map(|oracle| oracle(light)).collect())
    }),
    ("nodes", |space| {
        let direct = Arc::new(matrix(space, ROWS, Channels::One, 7, Width::I8));
        let nodes = Arc::new(matrix(space, 20, Channels::Three, 8, Width::I8));
        let starts: Vec<u32> = (0..=ROWS as u32).map(|row| 2 * row).collect();
        // Every third weight is negative.
        let named: Vec<u32> = (0..2 * ROWS as u32).map(|k| (k * 7 % 20) | ((k % 3 / 2) * NEGATIVE)).collect();
        let amounts: Vec<u16> = (0..2 * ROWS as u16).map(|k| k * 37 % 200).collect();
        let weights = Weights::new(starts.into(), named.into(), amounts.into(), -8, 20).unwrap();
        let link = Link::Weights(Arc::new(weights.clone()));
        let (first, second) = (dense(&direct), dense(&nodes));
        Form {
            product: Product::new(Factors::new(vec![direct, nodes]).unwrap(), link, None).unwrap(),
            mix: None,
            oracle: Box::new(move |light| {
                let (mut sums, nodes) = (first(light), second(light));
                for (row, sum) in sums.iter_mut().enumerate() {
                    for (node, weight) in weights.row(row) {
                        (0..3).for_each(|c| sum[c] += weight * nodes[node][c]);
                    }
                }
                sums
            }),
        }
    }),
    ("tree", |space| {
        let mut random = noise(9);
        let tree = HaarTree::new((0..20).map(|_| random().max(0.0)).collect()).unwrap();
        let samples = Arc::new(matrix(space, 20, Channels::One, 10, Width::I16));
        let each: Vec<_> =
            (11..13).map(|seed| Arc::new(matrix(tree.space(), ROWS, Channels::One, seed, Width::I8))).collect();
        let (gathered, then): (_, Vec<_>) = (dense(&samples), each.iter().map(|matrix| dense(matrix)).collect());
        let link = Link::Tree(Arc::new(tree.clone()));
        let product =
            Product::new(Factors::new(vec![samples]).unwrap(), link, Some(Factors::new(each).unwrap())).unwrap();
        mixed(product, move |light| {
            let light = tree.forward(&gathered(light));
            then.iter().map(|oracle| oracle(&light)).collect()
        })
    }),
    ("tree with direct light", |_| {
        // The samples' own columns: what arrives at them is added to what is sent out by them.
        let tree = HaarTree::new(vec![1.0; 16]).unwrap();
        let bounced = Arc::new(matrix(tree.space(), 16, Channels::One, 13, Width::I16));
        let gathering = Arc::new(matrix(tree.space(), ROWS, Channels::One, 14, Width::I8));
        let (more, then) = (dense(&bounced), dense(&gathering));
        let product = Product::new(
            Factors::new(vec![bounced]).unwrap(),
            Link::Tree(Arc::new(tree.clone())),
            Some(Factors::new(vec![gathering]).unwrap()),
        )
        .unwrap();
        let oracle = Box::new(move |light: &[[f64; 3]]| {
            let mut sum = tree.forward(&more(light));
            sum.iter_mut().zip(light).for_each(|(sum, direct)| (0..3).for_each(|c| sum[c] += direct[c]));
            then(&sum)
        });
        Form { product, mix: None, oracle }
    }),
    ("representatives", |space| {
        let clusters = ColumnSpace::representatives(5, 3).unwrap();
        let each = |space, rows, seeds: std::ops::Range<u64>| -> Vec<Arc<TransportMatrix>> {
            seeds.map(|seed| Arc::new(matrix(space, rows, Channels::One, seed, Width::I16))).collect()
        };
        let (firsts, seconds) = (each(space, clusters.columns(), 15..17), each(clusters, ROWS, 17..19));
        let pairs: Vec<_> = firsts.iter().zip(&seconds).map(|(first, then)| (dense(first), dense(then))).collect();
        let norms: Vec<_> = firsts.iter().zip(&seconds).map(|(first, then)| norms_of_both(first, then)).collect();
        let (firsts, seconds) = (Factors::new(firsts).unwrap(), Factors::new(seconds).unwrap());
        let product = Product::new(firsts, Link::Representatives(norms.into()), Some(seconds)).unwrap();
        mixed(product, move |light| pairs.iter().map(|(first, then)| then(&first(light))).collect())
    }),
];

/// Norms of the rows that two stages stand for, of which nothing is off.
pub fn norms_of_both(first: &TransportMatrix, then: &TransportMatrix) -> RowNorms {
    let (firsts, thens) = (Dense::of(first), Dense::of(then));
    let (bands, count) = (&first.bands, first.bands.count());
    let mut kept = Vec::new();
    for row in 0..then.rows {
        let mut both = vec![0.0; firsts.columns];
        for (k, weight) in thens.row(row).iter().enumerate() {
            both.iter_mut().zip(firsts.row(k)).for_each(|(sum, value)| *sum += weight * value);
        }
        let norm = |band: usize| both[bands.range(band)].iter().map(|x| x * x).sum::<f64>().sqrt();
        kept.extend((0..count).map(|band| bf16_up((1.0 + 1e-9) * norm(band))));
    }
    let dropped = vec![0u16; kept.len()];
    RowNorms::new(count, Channels::One, kept.into(), dropped.into()).unwrap()
}

/// Lobes about the eye: a power of the cosine to it, 2 or 8.
struct Powers;

impl LobeModels for Powers {
    fn count(&self) -> usize {
        2
    }

    fn means(&self, lobe: &RowLobe, size: usize, texels: &[usize], means: &mut [f32]) {
        for (mean, &texel) in means.iter_mut().zip(texels) {
            *mean = power(lobe.model, lobe.eye, size, texel) as f32;
        }
    }

    fn stored(&self) -> (Vec<u32>, Vec<f64>) {
        unreachable!("it is never written")
    }
}

fn power(model: usize, eye: [f32; 3], size: usize, texel: usize) -> f64 {
    let d = texel_direction(size, texel / (size * size), texel / size % size, texel % size);
    let cosine: f64 = (0..3).map(|k| f64::from(eye[k]) * d[k]).sum();
    cosine.max(0.0).powi(if model == 0 { 2 } else { 8 })
}

/// Wavelets and texels: what rows see is random, a third of them see all or nothing of a block, and one has no normal; every
/// other row may be glossy.
fn texels(threshold: f64, glossy: bool) -> Form {
    let space = ColumnSpace::haar_texels(4).unwrap();
    let wavelets = random_dense(ColumnSpace::haar(4).unwrap(), ROWS, Channels::One, 24);
    let mut random = noise(25);
    let mut normals: Vec<[f32; 3]> = Vec::new();
    for row in 0..ROWS {
        let n: [f64; 3] = std::array::from_fn(|_| random());
        let length = n.iter().map(|x| x * x).sum::<f64>().sqrt();
        normals.push(if row == 5 { [0.0; 3] } else { n.map(|x| (x / length) as f32) });
    }
    let open: Vec<bool> = (0..ROWS * 96)
        .map(|k| match k % 96 / 16 {
            0 => true,
            1 => false,
            _ => random() > 0.0,
        })
        .collect();
    let rule = rule(space, threshold, Width::I8);
    let lobe = move |row: usize| if glossy && row % 2 == 1 { row as u16 / 2 % 2 } else { DIFFUSE };
    let eyes: Vec<[f32; 3]> = normals.iter().map(|&[x, y, z]| [y, z, x]).collect();
    let lobes = Lobes {
        models: Arc::new(Powers),
        model: (0..ROWS).map(lobe).collect::<Vec<_>>().into(),
        eye: eyes.as_flattened().to_vec().into(),
        half_width: vec![1.0; ROWS].into(),
    };
    let lobes = glossy.then_some(&lobes);
    let matrix = wavelets.compress(space, &rule, 32).unwrap();
    let matrix = matrix.with_sight(&normals, lobes, |row, texel| open[row * 96 + texel]);
    let areas = solid_angles(4);
    let oracle = plain(wavelets);
    Form {
        oracle: Box::new(move |light| {
            let mut sums = oracle(&light[..96]);
            for (row, texel) in (0..ROWS).flat_map(|row| (0..96).map(move |texel| (row, texel))) {
                let d = texel_direction(4, texel / 16, texel / 4 % 4, texel % 4);
                let cosine: f64 = (0..3).map(|k| f64::from(normals[row][k]) * d[k]).sum();
                if open[row * 96 + texel] && cosine > 0.0 {
                    let own = lobe(row);
                    let mean = if own == DIFFUSE { cosine } else { power(own.into(), eyes[row], 4, texel) };
                    let value = mean / std::f64::consts::PI * areas[texel % 16].sqrt();
                    (0..3).for_each(|c| sums[row][c] += value * light[96 + texel][c]);
                }
            }
            sums
        }),
        ..one(matrix)
    }
}

/// Rows of texels come out of all bundles of all tiles: M row by row is M column by column.
#[test]
fn rows_of_texels_are_those_of_the_product() {
    let (rows, space) = (200, ColumnSpace::haar_texels(4).unwrap());
    let wavelets = random_dense(ColumnSpace::haar(4).unwrap(), rows, Channels::One, 27);
    let normals: Vec<[f32; 3]> = (0..rows).map(|row| [[1.0, 0.0, 0.0], [0.0, 0.6, 0.8]][row % 2]).collect();
    // Tiles of 160 rows are two and a half bundles.
    let matrix = wavelets.compress(space, &rule(space, 0.0, Width::I8), 160).unwrap();
    let matrix = matrix.with_sight(&normals, None, |row, texel| (7 * row + 5 * texel) % 11 < 6);
    let (csr, light) = (matrix.to_csr(0), light(space.columns(), 28));
    let mut out = vec![0.0; 3 * rows];
    Chain::new(Product::one(Arc::new(matrix))).multiply(&[&light], None, &mut out).unwrap();
    for (row, found) in out.chunks_exact(3).enumerate() {
        let own = csr.indptr[row] as usize..csr.indptr[row + 1] as usize;
        assert!(own.len() > 10);
        for c in 0..3 {
            let terms = own.clone().map(|k| f64::from(csr.data[k]) * light[csr.indices[k] as usize][c]);
            let (sum, size) = terms.fold((0.0, 0.0), |(sum, size), term| (sum + term, size + term.abs()));
            assert!((f64::from(found[c]) - sum).abs() <= 1e-6 * size, "row {row}: {} is not {sum}", found[c]);
        }
    }
}

/// What a matrix holds, as a plain product.
fn dense(matrix: &TransportMatrix) -> impl Fn(&[[f64; 3]]) -> Vec<[f64; 3]> + 'static {
    plain(Dense::of(matrix))
}

fn plain(dense: Dense) -> impl Fn(&[[f64; 3]]) -> Vec<[f64; 3]> + 'static {
    move |light| {
        dense.multiply(light.as_flattened(), 3).chunks_exact(3).map(|colours| colours.try_into().unwrap()).collect()
    }
}

fn one(matrix: TransportMatrix) -> Form {
    let oracle = Box::new(dense(&matrix));
    let first = Factors::new(vec![Arc::new(matrix)]).unwrap();
    Form { product: Product::new(first, Link::None, None).unwrap(), mix: None, oracle }
}

/// Factors that are mixed by weights of either sign.
fn mixed(product: Product, responses: impl Fn(&[[f64; 3]]) -> Vec<Vec<[f64; 3]>> + 'static) -> Form {
    let factors = product.factors();
    let mut random = noise(20);
    let mix = Mix::new((0..ROWS * factors).map(|_| random() as f32).collect(), factors).unwrap();
    let own = mix.clone();
    let oracle = Box::new(move |light: &[[f64; 3]]| {
        let each = responses(light);
        let of_row = |row: usize, c: usize| {
            own.row(row).iter().zip(&each).map(|(&weight, rows)| f64::from(weight) * rows[row][c]).sum()
        };
        (0..ROWS).map(|row| std::array::from_fn(|c| of_row(row, c))).collect()
    });
    Form { product, mix: Some(mix), oracle }
}

fn settings(space: ColumnSpace, method: _core::update::Method, terms: usize) -> Settings {
    let areas = space.bands().areas;
    let costs = vec![1.0; areas.len()];
    Settings { method, budget: Budget::Terms(terms), weights: areas, costs, colours: Colours::Joint }
}

/// Integers, which every grid holds: what is compared is choosing and multiplying.
fn light(columns: usize, seed: u64) -> Light {
    let mut random = noise(seed);
    (0..columns).map(|_| std::array::from_fn(|_| (1000.0 * random().powi(3)).round())).collect()
}

fn between(a: &[[f64; 3]], b: &[[f64; 3]], t: f64) -> Light {
    a.iter().zip(b).map(|(a, b)| std::array::from_fn(|c| (a[c] + t * (b[c] - a[c])).round())).collect()
}

#[test]
fn every_form_under_every_method_is_within_its_bound_and_ends_exact() {
    for &(name, form) in FORMS {
        for (space, method) in
            spaces().into_iter().flat_map(|space| every_method().into_iter().map(move |m| (space, m)))
        {
            let Form { product, mix, oracle } = form(space);
            let chain = Arc::new(Chain::new(product));
            let (product, space) = (&chain.product, chain.product.first.space());
            let second = product.then.as_ref().map(|then| settings(then.space(), method, usize::MAX));
            let mut follow =
                Updater::new(Arc::clone(&chain), settings(space, method, TERMS), second, mix.clone(), Initial::Black)
                    .unwrap();
            let (from, to) = (light(space.columns(), 21), light(space.columns(), 22));
            let moving = (0..8).map(|frame| between(&from, &to, f64::from(frame) / 7.0));
            let still = std::iter::repeat_n(to.clone(), space.columns().div_ceil(TERMS) + 1);
            let mut converged = false;
            let (mut out, mut bounds) = (vec![0.0; 3 * ROWS], vec![0.0; 3 * ROWS]);
            for (frame, target) in moving.chain(still).enumerate() {
                let step = follow.step(&target, &mut out).unwrap();
                converged = step.converged;
                assert!(
                    !converged || follow.values() == target,
                    "{name}, {method:?}, frame {frame}: not what was asked"
                );
                follow.bounds(step.number, &out, &mut bounds).unwrap();
                let exact = oracle(&target);
                for (k, ((&found, &bound), exact)) in out.iter().zip(&bounds).zip(exact.as_flattened()).enumerate() {
                    let error = (f64::from(found) - exact).abs();
                    assert!(
                        error <= f64::from(bound),
                        "{name}, {method:?}, frame {frame}, value {k}: {error} > {bound}"
                    );
                    assert!(
                        error <= step.bound[k % 3],
                        "{name}, {method:?}, frame {frame}: {error} > {:?}",
                        step.bound
                    );
                }
                for (&whole, &truncation) in step.bound.iter().zip(&step.truncation) {
                    assert!(truncation <= whole, "{name}, {method:?}, frame {frame}: {truncation} of {whole}");
                    // What is left then was rounded on the way, most of it between two stages, to 2^-20 of their light.
                    let largest = exact.as_flattened().iter().fold(0.0, |most: f64, x| most.max(x.abs()));
                    let left = if converged { whole - truncation } else { 0.0 };
                    assert!(left <= 1e-3 * largest, "{name}, {method:?}, frame {frame}: {left} of {largest} is left");
                }
            }
            // Those that start anew in every frame, or keep bands that do, never hold more than their budget.
            use _core::update::{BandTest, Method};
            let never = matches!(
                method,
                Method::Nonlinear | Method::Linear | Method::PerBand { test: BandTest::Fixed { .. }, .. }
            );
            assert!(converged || never, "{name}, {space}, {method:?}: not converged");
            // Mixed anew, the last picture is that of a fresh product again, and its bound is of the new mix.
            let remixed = mix.as_ref().map(|mix| {
                let (rows, factors) = mix.shape();
                let weights = (0..rows).flat_map(|row| mix.row(row).iter().map(|weight| 1e-3 * weight)).collect();
                Mix::new(weights, factors).unwrap()
            });
            if let Some(smaller) = remixed {
                let mut small = vec![0.0; 3 * ROWS];
                let step = follow.remix(smaller.clone(), &mut small).unwrap();
                assert!(follow.bounds(step.number - 1, &out, &mut bounds).is_err());
                follow.bounds(step.number, &small, &mut bounds).unwrap();
                let exact = oracle(&to);
                let size = exact.as_flattened().iter().fold(0.0f64, |most, x| most.max(x.abs()));
                for ((&found, &bound), exact) in small.iter().zip(&bounds).zip(exact.as_flattened()) {
                    // The weights of the smaller mix are rounded to f32, each by 2^-24 of it.
                    let error = (f64::from(found) - 1e-3 * exact).abs();
                    assert!(error <= f64::from(bound) + 1e-7 * size, "{name}, {method:?}: {error} > {bound}");
                }
                if converged {
                    let mut fresh = vec![0.0; 3 * ROWS];
                    chain.multiply(&[&to], Some(&smaller), &mut fresh).unwrap();
                    assert_eq!(small, fresh, "{name}, {space}, {method:?}: mixed anew");
                }
            }
            if converged {
                let mut fresh = vec![0.0; 3 * ROWS];
                chain.multiply(&[&to], mix.as_ref(), &mut fresh).unwrap();
                assert_eq!(out, fresh, "{name}, {space}, {method:?}: other bits than a fresh product");
            }
        }
    }
}

/// A budget in error is one of what is shown: what truncation takes of it is not there to be spent.
#[test]
fn a_budget_in_error_holds_with_what_truncation_takes() {
    let space = ColumnSpace::haar(4).unwrap();
    let dense = random_dense(space, ROWS, Channels::One, 22);
    let matrix = dense.compress(space, &rule(space, 0.05, Width::I8), 32).unwrap();
    let chain = Arc::new(Chain::new(Product::one(Arc::new(matrix))));
    let (target, mut out) = (light(space.columns(), 21), vec![0.0; 3 * ROWS]);
    let mut first = |budget| {
        let settings = Settings { budget, ..settings(space, _core::update::Method::Incremental, 0) };
        Updater::new(Arc::clone(&chain), settings, None, None, Initial::Black).unwrap().step(&target, &mut out)
    };
    let largest = |of: [f64; 3]| of.into_iter().fold(0.0, f64::max);
    let truncation = largest(first(Budget::Terms(usize::MAX)).unwrap().truncation);
    let mut sent = Vec::new();
    for times in [1.1, 1.5, 4.0, 30.0] {
        let (tolerance, factors) = (times * truncation, chain.error_factors(None));
        let step = first(Budget::Error { tolerance, factors }).unwrap();
        assert!(largest(step.bound) <= tolerance, "{:?} of {tolerance}", step.bound);
        sent.push(step.update.terms.len());
    }
    assert!(sent.is_sorted_by(|more, fewer| more >= fewer) && sent[0] > sent[3], "{sent:?}");
    let factors = chain.error_factors(None);
    let message = first(Budget::Error { tolerance: 0.9 * truncation, factors }).err().unwrap().to_string();
    assert!(message.contains("what truncation takes"), "{message}");
}

/// What somebody else chooses is sent as it is; bands and columns that are not there are refused, and change nothing.
#[test]
fn a_choice_from_outside_is_sent_or_refused() {
    let space = ColumnSpace::haar(4).unwrap();
    let chain = Arc::new(Chain::new(Product::one(Arc::new(matrix(space, ROWS, Channels::One, 1, Width::I8)))));
    let all = settings(space, _core::update::Method::Incremental, usize::MAX);
    let mut follow = Updater::new(chain, all, None, None, Initial::Black).unwrap();
    let (target, mut out) = (light(space.columns(), 21), vec![0.0; 3 * ROWS]);
    let (band, column) = (space.bands().count(), space.columns() as u32);
    for (resets, columns) in [(&[band][..], &[][..]), (&[][..], &[column][..])] {
        let message =
            follow.frame(&target, &mut out, None, &Chosen::Given { resets, columns }).err().unwrap().to_string();
        assert!(message.contains("below"), "{message}");
        assert!(follow.values().iter().all(|value| *value == [0.0; 3]));
    }
    follow.frame(&target, &mut out, None, &Chosen::Given { resets: &[], columns: &[3, 95] }).unwrap();
    for (column, (value, target)) in follow.values().iter().zip(&target).enumerate() {
        assert_eq!(*value, if [3, 95].contains(&column) { *target } else { [0.0; 3] });
    }
}

/// Bit for bit it is held in Python (`test_adjoint.py`); what lies between two stages is rounded to a grid of its own.
#[test]
fn the_adjoint_of_every_form_is_its_transpose() {
    let product = |a: &[[f64; 3]], b: &[[f64; 3]]| -> f64 {
        a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| a * b).sum()
    };
    let size = |a: &[[f64; 3]]| product(a, a).sqrt();
    for &(name, form) in FORMS {
        for space in spaces() {
            let Form { product: made, mix, .. } = form(space);
            let chain = Chain::new(made);
            let r: Light = light(ROWS, 31);
            let sums = chain.adjoint(&r, mix.as_ref(), true).unwrap();
            let v = light(sums.len(), 32);
            let mut b = vec![0.0; 3 * ROWS];
            chain.multiply_double(&[&v], mix.as_ref(), &mut b).unwrap();
            let (left, right) = (product(b.as_chunks().0, &r), product(&v, &sums));
            assert!((left - right).abs() <= 1e-6 * size(&v) * size(&sums), "{name}, {space}: {left} and {right}");
            assert!(chain.adjoint(&r[1..], mix.as_ref(), true).is_err());
            // Without texels all other columns are what they are.
            let stored = chain.adjoint(&r, mix.as_ref(), false).unwrap();
            let texels = chain.product.first.first().bands.texels;
            let (own, left_out) = stored.split_at(stored.len() - texels);
            assert!(own == &sums[..own.len()] && left_out.iter().all(|column| *column == [0.0; 3]), "{name}, {space}");
        }
    }
}

/// A transform keeps the integral of the square; a constant is one coefficient.
#[test]
fn haar_over_a_tree_is_orthonormal_under_its_areas() {
    let mut random = noise(30);
    for samples in [1, 2, 3, 8, 21, 64] {
        let areas: Vec<f64> = (0..samples).map(|k| if k % 5 == 4 { 0.0 } else { 0.1 + random().abs() }).collect();
        let tree = HaarTree::new(areas.clone()).unwrap();
        let values: Light = (0..samples).map(|_| [random(), random(), random()]).collect();
        let coefficients = tree.forward(&values);
        let total: f64 = areas.iter().sum();
        for c in 0..3 {
            let integral: f64 = values.iter().zip(&areas).map(|(value, area)| value[c] * value[c] * area).sum();
            let squares: f64 = coefficients.iter().map(|x| x[c] * x[c]).sum();
            assert!((integral - squares).abs() <= 1e-12 * integral, "{samples} samples: {integral} and {squares}");
        }
        let constant = tree.forward(&vec![[2.0, 0.0, -1.0]; samples]);
        assert!((constant[0][0] - 2.0 * total.sqrt()).abs() < 1e-12 * total.sqrt());
        assert!(constant[1..].iter().flatten().all(|x| x.abs() < 1e-12 * total.sqrt()));
    }
    assert!(HaarTree::new(vec![0.0; 4]).is_err() && HaarTree::new(vec![1.0, f64::NAN]).is_err());
    assert!(HaarTree::new(vec![]).is_err() && HaarTree::new(vec![1.0, -1.0]).is_err());
}

#[test]
fn products_that_do_not_fit_together_are_refused() {
    let space = ColumnSpace::haar(4).unwrap();
    let of = |space, rows, seed| Arc::new(matrix(space, rows, Channels::One, seed, Width::I8));
    let factors = |each: Vec<Arc<TransportMatrix>>| Factors::new(each).unwrap();
    let tree = Arc::new(HaarTree::new(vec![1.0; 20]).unwrap());
    let weights = |rows: u32, nodes: usize| {
        let starts: Vec<u32> = (0..=rows).collect();
        let named = vec![nodes as u32 - 1; rows as usize];
        Arc::new(Weights::new(starts.into(), named.into(), vec![1u16; rows as usize].into(), 0, nodes).unwrap())
    };
    assert!(Factors::new(vec![]).is_err());
    assert!(Factors::new(vec![of(space, 40, 1), of(ColumnSpace::haar(2).unwrap(), 40, 1)]).is_err());
    let first = factors(vec![of(space, 20, 1)]);
    let then = Some(factors(vec![of(tree.space(), 40, 2)]));
    let alike = Product::new;
    assert!(alike(first.clone(), Link::Tree(Arc::clone(&tree)), then.clone()).is_ok());
    assert!(alike(first.clone(), Link::Tree(Arc::clone(&tree)), None).is_err());
    assert!(alike(first.clone(), Link::None, then.clone()).is_err());
    assert!(alike(factors(vec![of(space, 21, 1)]), Link::Tree(Arc::clone(&tree)), then.clone()).is_err());
    let norms =
        |first: &TransportMatrix, then: &TransportMatrix| Link::Representatives([norms_of_both(first, then)].into());
    let representatives = of(ColumnSpace::representatives(5, 3).unwrap(), 40, 3);
    let whole = norms(first.first(), &representatives);
    let second = Some(factors(vec![Arc::clone(&representatives)]));
    assert!(alike(first.clone(), whole.clone(), second.clone()).is_ok());
    assert!(alike(first.clone(), whole, then).is_err());
    assert!(alike(first.clone(), Link::Representatives([].into()), second.clone()).is_err());
    let short = of(ColumnSpace::representatives(5, 3).unwrap(), 39, 3);
    assert!(alike(first.clone(), norms(first.first(), &short), second).is_err());
    assert!(alike(factors(vec![of(space, 20, 1), of(space, 21, 1)]), Link::None, None).is_err());
    let both = factors(vec![of(space, 40, 1), of(space, 20, 1)]);
    assert!(alike(both.clone(), Link::Weights(weights(40, 20)), None).is_ok());
    assert!(alike(both.clone(), Link::Weights(weights(39, 20)), None).is_err());
    assert!(alike(both, Link::Weights(weights(40, 21)), None).is_err());
}
