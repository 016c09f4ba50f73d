//! Light between surfaces: the nearest nodes against a search of all; the solver and its certificate against dense
//! solutions; rows against dense products; and the geometry of a closed box and of a corridor.

// By index: rows of several lists at once.
#![allow(clippy::needless_range_loop)]

use _core::basis::ColumnSpace;
use _core::precompute::links::{Check, Counts};
use _core::precompute::radiosity::{Operator, solve};
use _core::precompute::{Bounces, Gathering, Interreflection, Lobes, form_factors, links};
use _core::scene::near::Near;
use _core::scene::rays::Tracer;
use _core::scene::{Camera, Mesh, Placed, Points, Spacing, Surfaces, Wanted};
use _core::transport::{Channels, Dense, TransportMatrix, Truncation, Width};
use proptest::prelude::*;

use crate::transport::{random_dense, rule};

/// SplitMix64: the same cases on every machine.
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> u64 {
        self.0 = _core::sampling::mixed(self.0);
        self.0
    }

    /// In [0, 1).
    fn share(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Random counts: some rows nearly full, some empty.
fn random_counts(nodes: usize, rays: u32, dice: &mut Dice) -> Counts {
    let mut counts = Counts { starts: vec![0], rays, ..Counts::default() };
    for _ in 0..nodes {
        let mut left = (dice.share() * f64::from(rays + 1)) as u32;
        for node in 0..nodes as u32 {
            let count = left.min((dice.share() * 6.0 * f64::from(rays) / nodes as f64) as u32);
            if count > 0 && dice.share() < 0.6 {
                counts.nodes.push(node);
                counts.counts.push(count as u16);
                left -= count;
            }
        }
        counts.starts.push(counts.nodes.len() as u32);
    }
    counts
}

/// F rho as a dense matrix.
fn dense_operator(counts: &Counts, albedo: &[f32]) -> Vec<Vec<f64>> {
    let mut dense = vec![vec![0.0; counts.rows()]; counts.rows()];
    for (row, dense) in dense.iter_mut().enumerate() {
        counts.row(row).for_each(|(node, share)| dense[node] += share * f64::from(albedo[node]));
    }
    dense
}

/// Solves (1 - A) x = b by elimination.
fn eliminate(a: &[Vec<f64>], b: &[f64]) -> Vec<f64> {
    let n = b.len();
    let mut rows: Vec<Vec<f64>> =
        (0..n).map(|i| (0..n).map(|j| f64::from(u8::from(i == j)) - a[i][j]).chain([b[i]]).collect()).collect();
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| rows[i][k].abs().total_cmp(&rows[j][k].abs())).unwrap();
        rows.swap(k, pivot);
        let above = rows[k].clone();
        for row in rows.iter_mut().skip(k + 1) {
            let factor = row[k] / above[k];
            (k..=n).for_each(|j| row[j] -= factor * above[j]);
        }
    }
    let mut x = vec![0.0; n];
    for k in (0..n).rev() {
        let rest: f64 = (k + 1..n).map(|j| rows[k][j] * x[j]).sum();
        x[k] = (rows[k][n] - rest) / rows[k][k];
    }
    x
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_nearest_are_those_of_a_search_of_all(count in 0usize..300, asked in 1usize..40, seed: u64) {
        let mut dice = Dice(seed);
        // On a coarse lattice, so that many are equally near.
        let coordinate = |dice: &mut Dice| (dice.share() * 8.0).floor() / 8.0;
        let points: Vec<[f64; 6]> = (0..count).map(|_| std::array::from_fn(|_| coordinate(&mut dice))).collect();
        let halves = |p: &[f64; 6]| ([p[0], p[1], p[2]], [p[3], p[4], p[5]]);
        let near = Near::new(points.iter().map(halves), 0.5);
        let (mut found, at) = (Vec::new(), std::array::from_fn::<f64, 6, _>(|_| coordinate(&mut dice)));
        let (place, normal) = halves(&at);
        near.nearest(place, normal, asked, &mut found);
        let square = |p: &[f64; 6]| {
            (0..6).map(|k| ((at[k] - p[k]) * if k < 3 { 1.0 } else { 0.5 }).powi(2)).sum::<f64>() as f32
        };
        let mut expected: Vec<(f32, u32)> = points.iter().map(square).zip(0..).collect();
        expected.sort_by(|a, b| a.partial_cmp(b).unwrap());
        expected.truncate(asked);
        prop_assert_eq!(found, expected);
    }

    #[test]
    fn a_certificate_is_above_the_error(nodes in 1usize..40, bright in 0.0f64..0.999, tight in 1i32..7, seed: u64) {
        let mut dice = Dice(seed);
        let counts = random_counts(nodes, 256, &mut dice);
        let albedo: Vec<f32> = (0..nodes).map(|_| (bright * (0.5 + 0.5 * dice.share())) as f32).collect();
        let n = 3;
        let b: Vec<f64> = (0..nodes * n).map(|_| 2.0 * dice.share() - 1.0).collect();
        let solved = solve(&Operator::new(&counts, albedo.clone()), &b, n, 10f64.powi(-tight)).unwrap();
        prop_assert!(solved.residual <= 10f64.powi(-tight) * (1.0 + 1e-9));
        let dense = dense_operator(&counts, &albedo);
        for column in 0..n {
            let own: Vec<f64> = b.iter().skip(column).step_by(n).copied().collect();
            for (node, exact) in eliminate(&dense, &own).into_iter().enumerate() {
                let off = (exact - solved.values[node * n + column]).abs();
                // F rho is summed in f32 weights on one side.
                let allowed = solved.errors[column] * solved.furnace[node];
                prop_assert!(off <= allowed + 1e-4 * exact.abs().max(1e-3) / (1.0 - bright), "{off} {allowed}");
            }
        }
    }

    #[test]
    fn rows_are_those_of_dense_products(
        nodes in 1usize..60, bounces in 0usize..4, coloured: bool, endless: bool, threshold in 0.0f64..0.1, seed: u64
    ) {
        let mut dice = Dice(seed);
        let space = ColumnSpace::Haar { size: 4 };
        let dense = random_dense(space, nodes, Channels::One, seed);
        let fine = rule(space, 0.0, Width::I16);
        let direct = dense.compress(space, &fine, 32).unwrap();
        let counts = random_counts(nodes, 64, &mut dice);
        let albedo: Vec<[f32; 3]> = (0..nodes)
            .map(|_| {
                let grey = (0.9 * dice.share()) as f32;
                std::array::from_fn(|_| if coloured { (0.9 * dice.share()) as f32 } else { grey })
            })
            .collect();
        let channels = if coloured { Channels::Three } else { Channels::One };
        // A receiver that takes what it gathers is right; one that takes nothing is off by all of it.
        let rays: Vec<(usize, f64)> = counts.row(0).collect();
        let checks = [
            Check { receiver: 0, taken: vec![(0, 1.0)], gathered: rays.clone() },
            Check { receiver: 1, taken: vec![], gathered: rays.clone() },
        ];
        let arriving = Dense::new(2, space.columns(), vec![0.0; 2 * space.columns()]).compress(space, &fine, 32).unwrap().tiles;
        let between =
            Interreflection { factors: &counts, albedo: &albedo, checks: &checks, arriving: &arriving, channels };
        let asked = if endless { Bounces::All(1e-3) } else { Bounces::Count(bounces) };
        let bands = space.bands();
        let quantum = between.quantum(&direct.tiles, &bands, asked, -24).unwrap();
        let own = Truncation::new(&bands, threshold, quantum, Width::I8).unwrap();
        let (tiles, told) = between.solve(&direct.tiles, &bands, -24, asked, &own, &|_| Ok(())).unwrap();
        prop_assert!(told.residual <= 1e-3 * (1.0 + 1e-9));
        let off = &told.discretisation;
        prop_assert_eq!(off.len(), 2);
        // Where something of what is gathered is lit, and sends it on.
        let stored = Dense::of(&direct);
        let lit = |node: usize| albedo[node] != [0.0; 3] && stored.row(node).iter().any(|value| *value != 0.0);
        if rays.iter().any(|&(node, _)| lit(node)) {
            let [right, nothing] = [off[0], off[1]];
            // Of no bounce there is nothing to take.
            let expected = if asked == Bounces::Count(0) { 1.0 } else { 0.0 };
            // Solved to a residual, small values may be far off in relation to themselves.
            prop_assert!(endless || (right - expected).abs() < 2e-3, "{right}");
            prop_assert!((nothing - 1.0).abs() < 1e-9, "{nothing}");
        }
        let rows = between.rows();
        let made = TransportMatrix {
            space, bands: bands.clone(), rows, channels, quantum, tile_rows: 1024, tiles: tiles.clone(),
        };
        let made_rows = Dense::of(&made);
        let columns = bands.columns();
        for channel in 0..channels.count() {
            let own: Vec<f32> = albedo.iter().map(|rho| rho[channel]).collect();
            let operator = dense_operator(&counts, &own);
            let mut exact = vec![vec![0.0; columns]; nodes];
            // What a gathering row takes: one bounce less, as gathering is one.
            let mut before = exact.clone();
            for column in 0..columns {
                let t: Vec<f64> = (0..nodes).map(|row| dense.row(row)[column]).collect();
                let spread = |x: &[f64]| -> Vec<f64> {
                    operator.iter().map(|row| row.iter().zip(x).map(|(a, b)| a * b).sum()).collect()
                };
                let (sum, less) = match asked {
                    Bounces::All(_) => {
                        let all = eliminate(&operator, &spread(&t));
                        (all.clone(), all)
                    }
                    Bounces::Count(bounces) => {
                        let (mut term, mut sum, mut less) = (t.clone(), vec![0.0; nodes], vec![0.0; nodes]);
                        for _ in 0..bounces {
                            less.clone_from(&sum);
                            term = spread(&term);
                            sum.iter_mut().zip(&term).for_each(|(sum, term)| *sum += term);
                        }
                        (sum, less)
                    }
                };
                (0..nodes).for_each(|node| exact[node][column] = sum[node]);
                (0..nodes).for_each(|node| before[node][column] = less[node]);
            }
            for row in 0..rows {
                let truth: Vec<f64> = match row.checked_sub(nodes) {
                    None => exact[row].clone(),
                    Some(node) => {
                        let both = before[node].iter().zip(dense.row(node));
                        both.map(|(i, t)| f64::from(own[node]) * (i + t)).collect()
                    }
                };
                for band in 0..bands.count() {
                    let (mut off, mut kept) = (0.0, 0.0);
                    for column in bands.range(band) {
                        let stored = made_rows.row(row)[column * channels.count() + channel];
                        off += (truth[column] - stored).powi(2);
                        kept += stored * stored;
                    }
                    let at = (row * bands.count() + band) * channels.count() + channel;
                    let norm = |of: fn(&_core::transport::Tile) -> &[u16]| f64::from(_core::transport::bf16(of(&tiles[0])[at]));
                    prop_assert!(off.sqrt() <= norm(|tile| &tile.dropped) + 1e-9, "row {row} band {band}: {}", off.sqrt());
                    prop_assert!(kept.sqrt() <= norm(|tile| &tile.kept) + 1e-9);
                }
            }
        }
        // Grey: what one channel holds are the bits of each of three.
        if !coloured {
            let three = Interreflection { channels: Channels::Three, ..between };
            let (tiles, _) = three.solve(&direct.tiles, &bands, -24, asked, &own, &|_| Ok(())).unwrap();
            let of = |channel| TransportMatrix {
                space, bands: bands.clone(), rows, channels: Channels::Three, quantum, tile_rows: 1024, tiles: tiles.clone(),
            }.to_csr(channel);
            if threshold == 0.0 {
                (0..3).for_each(|channel| assert_eq!(of(channel), made.to_csr(0)));
            }
            prop_assert_eq!(of(0), of(1));
            prop_assert_eq!(of(1), of(2));
        }
    }
}

/// A closed box of six quads, seen from inside.
fn closed_box(size: [f64; 3]) -> (Mesh, Camera) {
    let [x, y, z] = size.map(|s| 0.5 * s);
    let vertices: Vec<[f64; 3]> = (0..8)
        .map(|k| [if k & 1 > 0 { x } else { -x }, if k & 2 > 0 { y } else { -y }, if k & 4 > 0 { z } else { -z }])
        .collect();
    let quads = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let triangles: Vec<[u32; 3]> = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    let camera = Camera {
        position: [0.0, 0.0, 0.45 * size[2]],
        right: [1.0, 0.0, 0.0],
        up: [0.0, 1.0, 0.0],
        forward: [0.0, 0.0, -1.0],
        half_height: 0.7,
        width: 32,
        height: 32,
    };
    (Mesh::new(&vertices, &triangles).unwrap(), camera)
}

fn room(size: [f64; 3], share: f64) -> (Mesh, Tracer, Camera, Spacing) {
    let (mesh, camera) = closed_box(size);
    let tracer = Tracer::new(&mesh);
    (mesh, tracer, camera, Spacing { share, cap: 4000 })
}

/// Bound over true error of a solution, the products it took, for right sides of several kinds.
fn furnace_of(size: [f64; 3], albedo: f32, cases: usize) -> (f64, usize) {
    let (mesh, tracer, camera, spacing) = room(size, 0.5);
    let surfaces = Surfaces { mesh: &mesh, tracer: &tracer };
    let placed = Placed::place(surfaces, Wanted::Seen(&camera), spacing, &|| Ok(())).unwrap();
    let factors = form_factors(surfaces, &placed, 16, &|_| Ok(())).unwrap();
    let nodes = &placed.nodes;
    assert_eq!(factors.lost, 0);
    let counts = &factors.counts;
    for row in 0..counts.rows() {
        let range = counts.starts[row] as usize..counts.starts[row + 1] as usize;
        // A closed box: every ray meets something, and is counted once.
        assert_eq!(counts.counts[range].iter().map(|&count| u32::from(count)).sum::<u32>(), counts.rays);
    }
    let operator = Operator::new(counts, vec![albedo; nodes.len()]);
    let rho = f64::from(albedo);
    // The furnace: every surface glows by 1, and so does everything that any of them sees.
    let n = cases + 1;
    let mut dice = Dice(7);
    let mut b: Vec<f64> = (0..nodes.len() * n).map(|_| dice.share()).collect();
    b.iter_mut().step_by(n).for_each(|b| *b = 1.0);
    let solved = solve(&operator, &b, n, 1e-4).unwrap();
    let exact = 1.0 / (1.0 - rho);
    let off = solved.values.iter().step_by(n).map(|x| (x - exact).abs()).fold(0.0, f64::max);
    let largest = solved.furnace.iter().copied().fold(0.0, f64::max);
    assert!(off <= solved.errors[0] * largest + 1e-4 * exact, "{off} {}", solved.errors[0] * largest);
    // The others against one that is far better.
    let better = solve(&operator, &b, n, 1e-10).unwrap();
    let mut worst = 0.0f64;
    for column in 1..n {
        let pairs = solved.values.iter().zip(&better.values).skip(column).step_by(n).zip(&solved.furnace);
        let (mut error, mut bound) = (0.0f64, 0.0f64);
        for ((x, truth), v) in pairs {
            let allowed = solved.errors[column] * v;
            assert!((x - truth).abs() <= allowed + better.errors[column] * v);
            error = error.max((x - truth).abs());
            bound = bound.max(allowed);
        }
        worst = worst.max(bound / error);
    }
    (worst, solved.products.iter().copied().max().unwrap())
}

#[test]
fn closed_rooms_and_corridors_are_certified() {
    for (name, size, most, products) in [("box", [1.0; 3], 8.0, 35), ("corridor", [1.0, 1.0, 16.0], 25.0, 70)] {
        for albedo in [0.5, 0.9, 0.99, 0.999] {
            let (ratio, took) = furnace_of(size, albedo, 40);
            println!("{name} {albedo}: bound at most {ratio:.2} times the error, {took} products");
            assert!(ratio <= most && took <= products, "{name} {albedo}: {ratio:.2}, {took}");
        }
    }
}

#[test]
fn links_sum_to_one_and_forms_do_not_depend_on_threads() {
    let (mesh, tracer, camera, spacing) = room([1.0; 3], 0.3);
    let surfaces = Surfaces { mesh: &mesh, tracer: &tracer };
    let run = || {
        let placed = Placed::place(surfaces, Wanted::Seen(&camera), spacing, &|| Ok(())).unwrap();
        let factors = form_factors(surfaces, &placed, 8, &|_| Ok(())).unwrap();
        let nodes = &placed.nodes;
        let mut points = Points::default();
        placed.cells.iter().take(100).for_each(|cell| points.push(&cell[1]));
        let ones = vec![0.5; nodes.len()];
        let gathering = Gathering { side: 8, audit: 0.05 };
        let linked =
            links(surfaces, nodes, (&points, &Lobes::default()), gathering, &ones, &ones, &|_| Ok(())).unwrap();
        (nodes.len(), factors.counts.nodes, linked.weights.arrays().1.to_vec(), linked.weights)
    };
    let (count, form, links, weights) = run();
    for row in 0..weights.rows() {
        let sum: f64 = weights.row(row).map(|(_, weight)| weight).sum();
        assert_eq!(sum, 1.0, "row {row}");
    }
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(run);
    assert_eq!((count, form, links), (alone.0, alone.1, alone.2));
}
