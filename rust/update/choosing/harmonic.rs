//! Low bands first: per-band incremental updates for spherical harmonics (Overbeck 2006, chapter 8 and Fig. 8.1).
//!
//! Each band is filled until its error is within the tolerance before the next one gets a term; once all bands are, the
//! tolerance falls to a tenth and the lowest band is looked at again. That discourages terms from jumping between
//! bands, which is what flickers.
//!
//! Fig. 8.1 as printed spends one term less than the budget, does not refresh a band's error as terms are given to it,
//! and would zero every band that gets none. Here the budget is spent, the error is what is left of the band, and every
//! band is incremental: one that gets no term keeps its values. The tolerance is relative to the light's own norm, so
//! that a brighter light chooses the same columns.

use crate::update::change::Choice;

use super::candidates::Candidates;
use super::largest::Largest;
use super::method::Budget;
use super::select;

/// Passes before the tolerance is taken as zero: a tenth each, down to the precision of f64.
const PASSES: i32 = 16;

/// What Fig. 8.1 sends within the budget; no band starts anew.
pub(super) fn choose(candidates: &Candidates, budget: &Budget, tolerance: f64) -> Choice {
    let anew = vec![false; candidates.bands.count()];
    let mut sent = order(candidates, tolerance);
    sent.truncate(select::prefix(candidates, &anew, budget, 0.0, &sent));
    Choice { anew, sent }
}

/// All candidates that changed, in the order in which Fig. 8.1 hands them out.
fn order(candidates: &Candidates, tolerance: f64) -> Vec<u32> {
    let light: f64 = (0..candidates.bands.count()).map(|band| candidates.keys(band, true).iter().sum::<f64>()).sum();
    let bands: Vec<_> = (0..candidates.bands.count()).map(|band| falling(candidates, band)).collect();
    let mut given = vec![0; bands.len()];
    let mut order = Vec::new();
    for pass in 0..=PASSES {
        let tolerance = if pass < PASSES { tolerance * light * 0.1_f64.powi(pass) } else { 0.0 };
        for (given, band) in given.iter_mut().zip(&bands) {
            while let Some((_, candidate)) = band.get(*given).filter(|(error, _)| *error > tolerance) {
                order.push(*candidate);
                *given += 1;
            }
        }
    }
    order
}

/// A band's candidates, largest first, each with the band's error before it is sent.
fn falling(candidates: &Candidates, band: usize) -> Vec<(f64, u32)> {
    let mut largest = Largest::new(usize::MAX);
    largest.offer(candidates.range(band).start, candidates.keys(band, false));
    let mut error = 0.0;
    let mut falling: Vec<(f64, u32)> = largest
        .sorted()
        .into_iter()
        .rev()
        .map(|card| {
            error += card.key;
            (error, card.candidate)
        })
        .collect();
    falling.reverse();
    falling
}
