//! What all passes share, on a pass whose rows are known: several factors, three channels, any split.

use std::ops::Range;
use std::sync::Arc;

use _core::basis::ColumnSpace;
use _core::error::{Error, Result};
use _core::precompute::{Made, Pass, Rays, Shape, pass::Take, probe, survey, tile};
use _core::transport::{Channels, Dense, GROUP, Rows16, Survey, TransportMatrix, Truncation, Width};
use proptest::prelude::*;

use crate::transport::{random_dense, rule};

/// Rows that somebody else made.
struct Ready {
    shape: Shape,
    factors: Vec<Dense>,
}

impl Pass for Ready {
    type Room = ();

    fn shape(&self) -> &Shape {
        &self.shape
    }

    fn room(&self) {}

    fn bundle(&self, rows: Range<usize>, _: &mut (), take: &mut Take) -> Result<Made> {
        for group in rows.clone().step_by(GROUP) {
            for (factor, dense) in self.factors.iter().enumerate() {
                let planes = dense.planes(group);
                take(factor, &planes.iter().map(Vec::as_slice).collect::<Vec<&[Rows16]>>(), 0.0)?;
            }
        }
        Ok(Made { rays: Rays { first: rows.len() as u64, ..Rays::default() }, seen: None })
    }
}

fn ready(space: ColumnSpace, rows: usize, channels: Channels, factors: usize, seed: u64) -> Ready {
    let shape = Shape { rows, texels: None, lobes: None, bands: space.bands(), channels, factors };
    let factors = (0..factors as u64).map(|k| random_dense(space, rows, channels, seed.wrapping_add(k))).collect();
    Ready { shape, factors }
}

fn matrix(
    space: ColumnSpace,
    rows: usize,
    pass: &Ready,
    rule: &Truncation,
    tiles: Vec<_core::transport::Tile>,
) -> Dense {
    let Shape { channels, .. } = pass.shape;
    let bands = space.bands();
    Dense::of(&TransportMatrix { space, bands, rows, channels, quantum: rule.quantum, tile_rows: 128, tiles })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 32, failure_persistence: None, ..ProptestConfig::default() })]

    /// Tiles are what compressing each factor by its own rule gives, and no row is missed or met twice.
    #[test]
    fn tiles_hold_what_a_pass_hands_over(
        seed: u64, rows in 1usize..300, three: bool, factors in 1usize..4, threshold in 0.0f64..0.5,
    ) {
        let space = ColumnSpace::haar(4).unwrap();
        let channels = if three { Channels::Three } else { Channels::One };
        let pass = ready(space, rows, channels, factors, seed);
        let rules: Vec<Truncation> = (0..factors)
            .map(|k| rule(space, threshold * k as f64, if k % 2 == 0 { Width::I8 } else { Width::I16 }))
            .collect();
        let mut tiles = vec![Vec::new(); factors];
        let mut shot = 0;
        for first in (0..rows).step_by(128) {
            let (own, rays) = tile(&pass, first..rows.min(first + 128), &rules, &|_| Ok(())).unwrap();
            tiles.iter_mut().zip(own).for_each(|(all, tile)| all.push(tile));
            shot += rays.first;
        }
        prop_assert_eq!(shot, rows as u64);
        for ((dense, rule), tiles) in pass.factors.iter().zip(&rules).zip(tiles) {
            let expected = dense.compress(space, rule, 128).unwrap();
            prop_assert_eq!(Dense::of(&expected), matrix(space, rows, &pass, rule, tiles));
        }
    }

    /// A survey of all bundles has seen every group of each factor, and keeps some of them untruncated.
    #[test]
    fn a_survey_sees_each_factor_by_itself(seed: u64, groups in 1usize..160, factors in 1usize..3, three: bool) {
        let space = ColumnSpace::haar(2).unwrap();
        let channels = if three { Channels::Three } else { Channels::One };
        let rows = groups * GROUP - 3;
        let pass = ready(space, rows, channels, factors, seed);
        let rules = vec![rule(space, 0.0, Width::I8); factors];
        let (found, rays) = survey(&pass, usize::MAX, &rules, &Arc::default(), &|_| Ok(())).unwrap();
        prop_assert_eq!(rays.first, rows as u64);
        for (dense, found) in pass.factors.iter().zip(&found) {
            let mut expected = Survey::new(&space.bands(), &rules[0], Arc::default()).unwrap();
            for first in (0..rows).step_by(GROUP) {
                let planes = dense.planes(first);
                expected.add(&planes.iter().map(Vec::as_slice).collect::<Vec<_>>()).unwrap();
            }
            let (a, b) = (expected.threshold_for(0.1).unwrap(), found.survey.threshold_for(0.1).unwrap());
            // Sums of the same numbers in another order.
            prop_assert_eq!(a.value, b.value);
            prop_assert!((a.error - b.error).abs() < 1e-9 && a.entries_per_group == b.entries_per_group);

            prop_assert!(found.groups.len() <= groups && found.audit.rows == found.groups.len() * GROUP);
            prop_assert!(found.groups.windows(2).all(|pair| pair[0] < pair[1]));
            if !found.groups.is_empty() {
                let tiles = vec![found.audit.clone()];
                let kept = matrix(space, found.audit.rows, &pass, &rules[0], tiles);
                for (k, &group) in found.groups.iter().enumerate() {
                    for lane in 0..GROUP {
                        let (kept, whole) = (kept.row(k * GROUP + lane), dense.row(group as usize * GROUP + lane));
                        let far = kept.iter().zip(whole).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                        prop_assert!(far <= 2f64.powi(-14), "{far}");
                    }
                }
            }
        }
    }
}

#[test]
fn a_pass_that_is_stopped_stops_and_rows_beyond_its_end_are_refused() {
    let space = ColumnSpace::haar(2).unwrap();
    let pass = ready(space, 200, Channels::One, 2, 1);
    let rules = vec![rule(space, 0.0, Width::I8); 2];
    let stop = |_| Err(Error::input("enough"));
    assert!(tile(&pass, 0..128, &rules, &stop).is_err());
    assert!(survey(&pass, 3, &rules, &Arc::default(), &stop).is_err());
    assert!(probe(&pass, 0.1, &rules, &stop).is_err());
    for rows in [0..0, 100..201, 300..310] {
        assert!(tile(&pass, rows, &rules, &|_| Ok(())).is_err());
    }
    assert!(tile(&pass, 0..128, &rules[..1], &|_| Ok(())).is_err());
    // More rows than a tile can number.
    let long = ready(ColumnSpace::haar(1).unwrap(), 20_000, Channels::One, 1, 1);
    assert!(tile(&long, 0..20_000, &[rule(ColumnSpace::haar(1).unwrap(), 0.0, Width::I8)], &|_| Ok(())).is_err());
    // A small pass is probed as a whole, and no further.
    let found = probe(&pass, 1e9, &rules, &|_| Ok(())).unwrap();
    assert!(found.bundles >= 4 && found.rays.first >= 200);
}
