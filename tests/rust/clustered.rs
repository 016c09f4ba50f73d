//! Clustered transport: subspaces against brute force, builds against the rows that they stand for, whatever the rows are.

use _core::basis::ColumnSpace;
use _core::basis::k_means::{DIMENSIONS, Point, k_means};
use _core::basis::pca::{SparseRows, Subspace, eigen};
use _core::error::Error;
use _core::transport::clustering::labels;
use _core::transport::{Channels, Clustering, Clusters, Dense, Truncation, Width, bf16, cluster};
use proptest::prelude::*;

use crate::transport::{matrix, noise, random_dense, rule};

/// Rows x columns of numbers, of which some are zero.
fn sparse(rows: &[Vec<f64>]) -> SparseRows {
    let mut all = SparseRows { starts: vec![0], width: rows[0].len(), ..SparseRows::default() };
    for row in rows {
        for (column, &value) in row.iter().enumerate().filter(|(_, value)| **value != 0.0) {
            all.columns.push(column as u32);
            all.values.push(value);
        }
        all.starts.push(all.values.len());
    }
    all
}

/// The least square that `each` axes can leave of centred rows: the smallest eigenvalues of their Gram matrix.
fn least_left(rows: &[Vec<f64>], each: usize) -> f64 {
    let (n, width) = (rows.len(), rows[0].len());
    let mean: Vec<f64> = (0..width).map(|c| rows.iter().map(|row| row[c]).sum::<f64>() / n as f64).collect();
    let centred: Vec<Vec<f64>> = rows.iter().map(|row| row.iter().zip(&mean).map(|(x, m)| x - m).collect()).collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let gram = centred.iter().flat_map(|a| centred.iter().map(|b| dot(a, b))).collect();
    eigen(gram, n).0.iter().skip(each).map(|x| x.max(0.0)).sum()
}

fn left(rows: &SparseRows, subspace: &Subspace) -> f64 {
    (0..rows.count()).map(|row| subspace.coordinates(rows.row(row)).1).sum()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Rows of falling importance: what is left is within two percent of the least, and nothing where there are axes for all.
    #[test]
    fn subspaces_leave_hardly_more_than_they_must(
        seed in 0u64..1000, count in 1usize..40, width in 1usize..50, each in 0usize..12, alike in any::<bool>()
    ) {
        let mut random = noise(seed);
        let rank = 1 + seed as usize % 20;
        let factors: Vec<Vec<f64>> = (0..rank).map(|k| (0..width).map(|_| random() * 0.7f64.powi(k as i32)).collect()).collect();
        let mut rows: Vec<Vec<f64>> = (0..count).map(|_| {
            let along: Vec<f64> = (0..rank).map(|_| random()).collect();
            (0..width).map(|c| 1.0 + along.iter().zip(&factors).map(|(x, f)| x * f[c]).sum::<f64>()).collect()
        }).collect();
        if alike {
            rows = vec![rows[0].clone(); count];
        }
        let given = sparse(&rows);
        let subspace = Subspace::fit(&given, each, 4);
        let whole: f64 = rows.iter().flatten().map(|x| x * x).sum();
        let (found, least) = (left(&given, &subspace), least_left(&rows, each));
        prop_assert!(found <= 1.02 * least + 1e-12 * whole, "{found} left, {least} least, of {whole}");
        // Orthonormal, the axis that holds most first, and no axis for rounding.
        let axes = &subspace.axes;
        for (p, q) in (0..axes.width).flat_map(|p| (0..axes.width).map(move |q| (p, q))) {
            let dot: f64 = axes.rows().map(|row| row[p] * row[q]).sum();
            prop_assert!((dot - f64::from(u8::from(p == q))).abs() < 1e-12, "axes {p} and {q}: {dot}");
        }
        prop_assert!(subspace.held.is_sorted_by(|a, b| a >= b));
        prop_assert!(axes.width <= each && axes.width <= rank.min(count.saturating_sub(1)));
        prop_assert!(!alike || axes.width == 0);
    }
}

#[test]
fn eigenvectors_are_those_of_a_matrix_made_of_them() {
    let (n, mut random) = (9, noise(4));
    let a: Vec<f64> = (0..n * n).map(|_| random()).collect();
    let symmetric: Vec<f64> = (0..n * n).map(|k| a[k] + a[k % n * n + k / n]).collect();
    let (values, vectors) = eigen(symmetric.clone(), n);
    assert!(values.is_sorted_by(|a, b| a >= b));
    for (row, column) in (0..n).flat_map(|row| (0..n).map(move |column| (row, column))) {
        let sum: f64 = (0..n).map(|k| symmetric[row * n + k] * vectors[k * n + column]).sum();
        assert!((sum - values[column] * vectors[row * n + column]).abs() < 1e-12);
    }
}

/// Nine hundred points in one place and a hundred elsewhere: no cluster is empty, and there are no more than differ.
#[test]
fn equal_points_make_one_cluster() {
    let mut random = noise(3);
    let mut points: Vec<Point> = vec![[1.0; DIMENSIONS]; 900];
    points.extend((0..100).map(|_| std::array::from_fn::<f32, DIMENSIONS, _>(|_| random() as f32)));
    for clusters in [1, 32, 101, 400] {
        let mut found = k_means(&points, clusters, 3);
        assert!(found[..900].iter().all(|&label| label == found[0]));
        found.sort_unstable();
        found.dedup();
        assert!(found.len() <= clusters.min(101) && found.len() >= clusters.min(101).div_ceil(2), "{}", found.len());
    }
}

fn space() -> ColumnSpace {
    ColumnSpace::haar(4).unwrap()
}

fn asked(clusters: usize, representatives: usize) -> Clustering {
    Clustering { clusters, representatives, tolerance: 0.0 }
}

fn made(dense: &Dense, width: Width, asked: Clustering) -> Clusters {
    let source = dense.compress(space(), &rule(space(), 0.0, width), 32).unwrap();
    cluster(&source, asked, &|_| Ok(())).unwrap()
}

/// W R, dense.
fn product(made: &Clusters) -> Dense {
    let (first, then) = (Dense::of(&made.first), Dense::of(&made.then));
    let mut values = vec![0.0; then.rows * first.columns];
    for (row, out) in values.chunks_mut(first.columns).enumerate() {
        for (k, weight) in then.row(row).iter().enumerate().filter(|(_, weight)| **weight != 0.0) {
            out.iter_mut().zip(first.row(k)).for_each(|(sum, value)| *sum += weight * value);
        }
    }
    Dense::new(then.rows, first.columns, values)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Norms are never below the truth: of what both stages stand for, and of what that is off the rows as they were traced.
    #[test]
    fn norms_of_both_stages_hold(
        seed in 0u64..1000, rows in 1usize..90, clusters in 1usize..12, each in 0usize..6, alike in any::<bool>(),
        tolerance in 0.0f64..0.2, width in prop_oneof![Just(Width::I8), Just(Width::I16)]
    ) {
        let mut dense = random_dense(space(), rows, Channels::One, seed);
        if alike {
            // An open floor: most rows are one.
            for row in (0..rows).filter(|row| row % 7 != 0) {
                dense.values.copy_within(0..dense.columns, row * dense.columns);
            }
        }
        let source = dense.compress(space(), &rule(space(), 0.01, width), 32).unwrap();
        let made = cluster(&source, Clustering { clusters, representatives: each, tolerance }, &|_| Ok(())).unwrap();
        let found = product(&made);
        let mut order = made.order.clone();
        order.sort_unstable();
        prop_assert!(order.iter().enumerate().all(|(k, &row)| k == row as usize), "each row once");
        prop_assert!(made.labels.is_sorted() && labels(&made.then).unwrap() == made.labels);
        prop_assert!(made.labels.last().map_or(0, |&last| last as usize) < clusters);
        let bands = space().bands();
        for row in 0..rows {
            let (kept, dropped) = made.norms.row(row);
            let truth = dense.row(made.order[row] as usize);
            for band in 0..bands.count() {
                let own = bands.range(band);
                let norm = |of: &dyn Fn(usize) -> f64| own.clone().map(|c| of(c).powi(2)).sum::<f64>().sqrt();
                let (stored, off) = (norm(&|c| found.row(row)[c]), norm(&|c| found.row(row)[c] - truth[c]));
                prop_assert!(stored <= f64::from(bf16(kept[band])), "row {row}, band {band}: {stored}");
                prop_assert!(off <= f64::from(bf16(dropped[band])), "row {row}, band {band}: {off}");
                // ... nor far above it: truncation of the source, and the eight bits of a bfloat16.
                let before = norm(&|c| f64::from(source.row(made.order[row] as usize)[c]) - truth[c]);
                prop_assert!(f64::from(bf16(dropped[band])) <= 1.02 * (off + 2.0 * before) + 1e-6);
            }
        }
    }
}

#[test]
fn a_cluster_for_every_row_is_the_matrix_itself() {
    let dense = random_dense(space(), 40, Channels::One, 5);
    let all = made(&dense, Width::I16, asked(64, 3));
    let found = product(&all);
    // Rounded twice to sixteen bits of the largest of sixteen lanes.
    let rounding = 2f64.powi(-15) * dense.values.iter().fold(0.0f64, |most, x| most.max(x.abs()));
    for row in 0..40 {
        for (found, truth) in found.row(row).iter().zip(dense.row(all.order[row] as usize)) {
            assert!((found - truth).abs() <= rounding, "row {row}: {found} for {truth}");
        }
    }
    assert!(all.error[1] < 1e-4, "{:?}", all.error);
    // One row of zeros and 39 others.
    assert_eq!(all.first.rows, 40 * 4);
}

/// Rows on a few lines in a space of many dimensions are on them again, but for the eight bits of their weights.
#[test]
fn rows_on_lines_are_found_on_them() {
    let mut random = noise(6);
    let columns = space().columns();
    let lines: Vec<Vec<f64>> = (0..8).map(|_| (0..columns).map(|_| random()).collect()).collect();
    let values = (0..200).flat_map(|row| {
        let (line, along) = (row % 4, random());
        (0..columns).map(|c| lines[line][c] + 0.2 * along * lines[4 + line][c]).collect::<Vec<f64>>()
    });
    let dense = Dense::new(200, columns, values.collect());
    let found = made(&dense, Width::I16, asked(4, 1));
    // Rows themselves have sixteen bits.
    assert!(found.error[0] < 2f64.powi(-15) && found.error[1] < 2e-3, "{:?}", found.error);
    let together = |row: usize| found.order.iter().position(|&own| own as usize == row).map(|at| found.labels[at]);
    assert!((0..200).all(|row| together(row) == together(row % 4)));
}

#[test]
fn the_same_bits_on_any_number_of_threads() {
    let dense = random_dense(space(), 300, Channels::One, 7);
    let of = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| made(&dense, Width::I8, Clustering { tolerance: 0.05, ..asked(12, 4) }))
    };
    let (one, three) = (of(1), of(3));
    assert_eq!((&one.order, &one.labels, one.error), (&three.order, &three.labels, three.error));
    assert_eq!(one.norms.arrays(), three.norms.arrays());
    for (a, b) in [(&one.first, &three.first), (&one.then, &three.then)] {
        assert_eq!(Dense::of(a), Dense::of(b));
    }
}

#[test]
fn what_cannot_be_clustered_is_refused() {
    let refused = |source: &_, asked| match cluster(source, asked, &|_| Ok(())) {
        Err(Error::Input(message)) => message,
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("expected a refusal"),
    };
    let one = matrix(space(), 20, Channels::One, 1, Width::I8);
    assert!(refused(&matrix(space(), 20, Channels::Three, 1, Width::I8), asked(4, 2)).contains("one channel"));
    assert!(refused(&one, asked(0, 2)).contains("at least one cluster"));
    assert!(refused(&one, asked(4, 256)).contains("at most 255 representatives"));
    assert!(labels(&one).is_err());
    let texels = ColumnSpace::haar_texels(4).unwrap();
    let rule = Truncation::new(&texels.bands(), 0.0, -24, Width::I8).unwrap();
    let dense = Dense::new(4, 96, vec![1.0; 4 * 96]);
    let seen = dense.compress(texels, &rule, 32).unwrap().with_sight(&[[0.0, 0.0, 1.0]; 4], None, |_, _| true);
    assert!(refused(&seen, asked(4, 2)).contains("without texels"));
    // Whoever listens may stop it, wherever it is.
    for at in [1, 25, 45, 90] {
        let done = std::sync::atomic::AtomicU64::new(0);
        let heard = |rows| {
            let before = done.fetch_add(rows, std::sync::atomic::Ordering::Relaxed);
            if before + rows >= at { Err(Error::Cancelled) } else { Ok(()) }
        };
        assert!(matches!(cluster(&one, asked(4, 2), &heard), Err(Error::Cancelled)), "at {at}");
    }
}
