//! Which terms: those with the largest keys, as many as the budget allows.
//!
//! A *candidate* is what one term may change: a column (the three colours jointly) or one colour of a column. Its *key*
//! says how much sending it is worth: weight * |change|, as in `Area(j) |L_j|` (Overbeck 2006, section 6.1). Ties go to
//! the lower candidate, so that a choice is the same on any machine.

use crate::update::change::Choice;

use super::candidates::Candidates;
use super::largest::{Keyed, Largest};
use super::method::Budget;

/// The resets that a budget in cost can pay for.
struct Resets {
    anew: Vec<bool>,
    /// What they cost: the columns that their bands hold are streamed once more, to be taken out...
    cost: f64,
    /// ...unless nothing else is held: then all sums start from zero, and nothing needs to be taken out.
    streams: bool,
}

impl Resets {
    /// Coarse bands first: a reset that does not fit into what is left is not made.
    fn within(candidates: &Candidates, mut anew: Vec<bool>, budget: &Budget) -> Resets {
        let Budget::Cost(budget) = *budget else { return Resets { anew, cost: 0.0, streams: false } };
        if (0..anew.len()).all(|band| anew[band] || !candidates.band_held(band)) {
            return Resets { anew, cost: 0.0, streams: false };
        }
        let mut cost = 0.0;
        for band in (0..anew.len()).filter(|&band| anew[band]).collect::<Vec<_>>() {
            let own = candidates.held_cost(band);
            anew[band] = cost + own <= budget;
            cost += if anew[band] { own } else { 0.0 };
        }
        Resets { anew, cost, streams: true }
    }

    /// Whether a candidate costs nothing more, as its column is streamed by a reset.
    fn pays(&self, candidates: &Candidates, candidate: u32) -> bool {
        self.streams && candidates.held(candidate) && self.anew[candidates.band(candidate)]
    }

    /// All candidates that cost nothing more: what a reset takes out is replaced by the light, not by black.
    fn paid(&self, candidates: &Candidates) -> Vec<u32> {
        let bands = (0..self.anew.len()).filter(|&band| self.streams && self.anew[band]);
        bands.flat_map(|band| candidates.paid(band)).collect()
    }
}

/// The candidates of all bands in order of their keys, as many as the budget allows; `anew` tells the bands to reset.
pub(super) fn choose(candidates: &Candidates, anew: Vec<bool>, budget: &Budget) -> Choice {
    let resets = Resets::within(candidates, anew, budget);
    let largest = |count: usize| {
        let mut largest = Largest::new(count);
        for (band, &anew) in resets.anew.iter().enumerate() {
            largest.offer(candidates.range(band).start, candidates.keys(band, anew));
        }
        largest
    };
    let numbers = |keyed: Vec<Keyed>| keyed.into_iter().map(|keyed| keyed.candidate);
    if let Budget::Terms(terms) = *budget {
        return Choice { sent: numbers(largest(terms).finish()).collect(), anew: resets.anew };
    }

    // Where the budget is not a number of terms, look at more and more of them until it ends among them.
    let mut count = 256;
    loop {
        let listed = largest(count).sorted();
        let all = listed.len() < count;
        let mut sent: Vec<u32> = numbers(listed).filter(|&candidate| !resets.pays(candidates, candidate)).collect();
        let kept = prefix(candidates, &resets.anew, budget, resets.cost, &sent);
        if kept < sent.len() || all {
            sent.truncate(kept);
            sent.extend(resets.paid(candidates));
            return Choice { anew: resets.anew, sent };
        }
        count = count.saturating_mul(4);
    }
}

/// The candidates in an order that somebody else gives, as many as the budget allows.
pub(super) fn ordered(candidates: &Candidates, anew: Vec<bool>, budget: &Budget, order: Vec<u32>) -> Choice {
    let resets = Resets::within(candidates, anew, budget);
    let lit = |&candidate: &u32| {
        let anew = resets.anew[candidates.band(candidate)];
        candidates.change(candidate, anew) != [0.0; 3] && !resets.pays(candidates, candidate)
    };
    let mut sent: Vec<u32> = order.into_iter().filter(lit).collect();
    sent.truncate(prefix(candidates, &resets.anew, budget, resets.cost, &sent));
    sent.extend(resets.paid(candidates));
    Choice { anew: resets.anew, sent }
}

/// The first candidates from black, as many as the budget allows; those without light count, but need not be sent.
pub(super) fn first(candidates: &Candidates, budget: &Budget) -> Choice {
    let anew = vec![true; candidates.bands.count()];
    let mut sent: Vec<u32> = (0..candidates.candidates() as u32).collect();
    sent.truncate(prefix(candidates, &anew, budget, 0.0, &sent));
    sent.retain(|&candidate| candidates.change(candidate, true) != [0.0; 3]);
    Choice { anew, sent }
}

/// How many of the candidates in `order` the budget allows, where so much of a budget in cost is spent already.
pub(super) fn prefix(candidates: &Candidates, anew: &[bool], budget: &Budget, mut spent: f64, order: &[u32]) -> usize {
    match budget {
        Budget::Terms(terms) => order.len().min(*terms),
        Budget::Cost(budget) => {
            let fits = |&&candidate: &&u32| {
                let first = spent == 0.0;
                spent += candidates.cost(candidate);
                spent <= *budget || first
            };
            if *budget == 0.0 { 0 } else { order.iter().take_while(fits).count() }
        }
        Budget::Error { tolerance, factors } => until_error(candidates, anew, *tolerance, factors, order),
    }
}

/// The least prefix of `order` after which the bound on the error is within the tolerance.
fn until_error(candidates: &Candidates, anew: &[bool], tolerance: f64, factors: &[f64], order: &[u32]) -> usize {
    // What stays unsent whatever the prefix is: squares per band and colour.
    let mut listed = vec![false; candidates.candidates()];
    for &candidate in order {
        listed[candidate as usize] = true;
    }
    let mut unsent = vec![[0.0; 3]; anew.len()];
    for (band, &anew) in anew.iter().enumerate() {
        for candidate in candidates.range(band).filter(|&candidate| !listed[candidate]) {
            add_squares(&mut unsent[band], candidates.change(candidate as u32, anew));
        }
    }

    // Take candidates back, smallest first, for as long as the rest is within the tolerance: sums only grow, so nothing
    // cancels and the bound is sound.
    let mut kept = order.len();
    while kept > 0 {
        let candidate = order[kept - 1];
        let band = candidates.band(candidate);
        add_squares(&mut unsent[band], candidates.change(candidate, anew[band]));
        if bound(factors, &unsent) > tolerance {
            break;
        }
        kept -= 1;
    }
    kept
}

fn add_squares(sums: &mut [f64; 3], change: [f64; 3]) {
    for (sum, change) in sums.iter_mut().zip(change) {
        *sum += change * change;
    }
}

/// The largest, over the colours, of sum over bands of factor * norm.
fn bound(factors: &[f64], squares: &[[f64; 3]]) -> f64 {
    let colour =
        |c: usize| factors.iter().zip(squares).map(|(factor, squares)| factor * squares[c].sqrt()).sum::<f64>();
    colour(0).max(colour(1)).max(colour(2))
}
