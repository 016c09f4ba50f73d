//! Which terms: those with the largest keys, as many as the budget allows.
//!
//! A *candidate* is what one term may change: a column (the three colours jointly) or one colour of a column. Its *key*
//! says how much sending it is worth: weight * |change|, as in `Area(j) |L_j|` (Overbeck 2006, section 6.1). Ties go to
//! the lower candidate, so that a choice is the same on any machine.
//!
//! Dropped: `select_nth_unstable` over all (key, candidate) pairs. Most keys lie far below the largest few, and a scan
//! that only compares is several times faster.

use std::cmp::Ordering;

use super::approximation::Choice;
use super::frame::Frame;

/// When a frame has sent enough.
#[derive(Clone, Debug, PartialEq)]
pub enum Budget {
    /// So many candidates.
    Terms(usize),
    /// So much of `Settings::costs`: candidates are sent while their costs, and those of resets, sum to at most this;
    /// the first that costs anything is sent even if it costs more, so that no column waits for ever.
    Cost(f64),
    /// Until, in every colour, the sum over bands of `factors[band] * |what is still unsent in the band|_2` is at most
    /// `tolerance`. With the largest row norms of M as factors this bounds the error of every receiver.
    Error { tolerance: f64, factors: Vec<f64> },
}

impl Budget {
    /// Whether nothing may be sent at all.
    pub fn is_nothing(&self) -> bool {
        match *self {
            Budget::Terms(terms) => terms == 0,
            Budget::Cost(cost) => cost == 0.0,
            Budget::Error { .. } => false,
        }
    }
}

/// A candidate and its key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Keyed {
    pub key: f64,
    pub candidate: u32,
}

/// Larger keys first; of equal keys the lower candidate.
pub(super) fn by_key(a: &Keyed, b: &Keyed) -> Ordering {
    b.key.total_cmp(&a.key).then(a.candidate.cmp(&b.candidate))
}

/// The largest of a stream of keys; keys of zero are never taken.
pub(super) struct Largest {
    count: usize,
    /// INVARIANT: `found` holds at least `count` keys that are no smaller, unless it is still zero.
    floor: f64,
    found: Vec<Keyed>,
}

impl Largest {
    /// Keys that are compared with the floor at once.
    const BLOCK: usize = 64;

    pub fn new(count: usize) -> Self {
        Largest { count, floor: 0.0, found: Vec::new() }
    }

    /// Takes the keys of candidates `first`, `first + 1`, ...: candidates must arrive in ascending order, since one
    /// that only equals the floor loses against those before it.
    pub fn offer(&mut self, first: usize, keys: &[f64]) {
        if self.count == 0 {
            return;
        }
        for (number, block) in keys.chunks(Self::BLOCK).enumerate() {
            // Most blocks hold nothing above the floor; this fold compiles to vector comparisons.
            if !block.iter().fold(false, |any, &key| any | (key > self.floor)) {
                continue;
            }
            let start = first + number * Self::BLOCK;
            for (lane, &key) in block.iter().enumerate() {
                if key > self.floor {
                    self.found.push(Keyed { key, candidate: (start + lane) as u32 });
                }
            }
            if self.found.len() > self.count.saturating_mul(2).saturating_add(Self::BLOCK) {
                self.cut();
            }
        }
    }

    /// Keeps the `count` largest found so far and raises the floor to the least of them.
    fn cut(&mut self) {
        if self.found.len() > self.count {
            let (_, least, _) = self.found.select_nth_unstable_by(self.count - 1, by_key);
            self.floor = least.key;
            self.found.truncate(self.count);
        }
    }

    /// The largest, in no order.
    pub fn finish(mut self) -> Vec<Keyed> {
        self.cut();
        self.found
    }

    /// The largest, largest first.
    pub fn sorted(self) -> Vec<Keyed> {
        let mut found = self.finish();
        found.sort_unstable_by(by_key);
        found
    }
}

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
    fn within(frame: &Frame, mut anew: Vec<bool>, budget: &Budget) -> Resets {
        let Budget::Cost(budget) = *budget else { return Resets { anew, cost: 0.0, streams: false } };
        if (0..anew.len()).all(|band| anew[band] || !frame.band_held(band)) {
            return Resets { anew, cost: 0.0, streams: false };
        }
        let mut cost = 0.0;
        for band in (0..anew.len()).filter(|&band| anew[band]).collect::<Vec<_>>() {
            let own = frame.held_cost(band);
            anew[band] = cost + own <= budget;
            cost += if anew[band] { own } else { 0.0 };
        }
        Resets { anew, cost, streams: true }
    }

    /// Whether a candidate costs nothing more, as its column is streamed by a reset.
    fn pays(&self, frame: &Frame, candidate: u32) -> bool {
        self.streams && frame.held(candidate) && self.anew[frame.band(candidate)]
    }

    /// All candidates that cost nothing more: what a reset takes out is replaced by the light, not by black.
    fn paid(&self, frame: &Frame) -> Vec<u32> {
        let bands = (0..self.anew.len()).filter(|&band| self.streams && self.anew[band]);
        bands.flat_map(|band| frame.paid(band)).collect()
    }
}

/// The candidates of all bands in order of their keys, as many as the budget allows; `anew` tells the bands to reset.
pub(super) fn choose(frame: &Frame, anew: Vec<bool>, budget: &Budget) -> Choice {
    let resets = Resets::within(frame, anew, budget);
    let largest = |count: usize| {
        let mut largest = Largest::new(count);
        for (band, &anew) in resets.anew.iter().enumerate() {
            largest.offer(frame.range(band).start, frame.keys(band, anew));
        }
        largest
    };
    let candidates = |keyed: Vec<Keyed>| keyed.into_iter().map(|keyed| keyed.candidate);
    if let Budget::Terms(terms) = *budget {
        return Choice { sent: candidates(largest(terms).finish()).collect(), anew: resets.anew };
    }

    // Where the budget is not a number of terms, look at more and more of them until it ends among them.
    let mut count = 256;
    loop {
        let listed = largest(count).sorted();
        let all = listed.len() < count;
        let mut sent: Vec<u32> = candidates(listed).filter(|&candidate| !resets.pays(frame, candidate)).collect();
        let kept = prefix(frame, &resets.anew, budget, resets.cost, &sent);
        if kept < sent.len() || all {
            sent.truncate(kept);
            sent.extend(resets.paid(frame));
            return Choice { anew: resets.anew, sent };
        }
        count = count.saturating_mul(4);
    }
}

/// The first candidates from black, as many as the budget allows; those without light count, but need not be sent.
pub(super) fn first(frame: &Frame, budget: &Budget) -> Choice {
    let anew = vec![true; frame.bands.count()];
    let mut sent: Vec<u32> = (0..frame.candidates() as u32).collect();
    sent.truncate(prefix(frame, &anew, budget, 0.0, &sent));
    sent.retain(|&candidate| frame.change(candidate, true) != [0.0; 3]);
    Choice { anew, sent }
}

/// How many of the candidates in `order` the budget allows, where so much of a budget in cost is spent already.
pub(super) fn prefix(frame: &Frame, anew: &[bool], budget: &Budget, mut spent: f64, order: &[u32]) -> usize {
    match budget {
        Budget::Terms(terms) => order.len().min(*terms),
        Budget::Cost(budget) => {
            let fits = |&&candidate: &&u32| {
                let first = spent == 0.0;
                spent += frame.cost(candidate);
                spent <= *budget || first
            };
            if *budget == 0.0 { 0 } else { order.iter().take_while(fits).count() }
        }
        Budget::Error { tolerance, factors } => until_error(frame, anew, *tolerance, factors, order),
    }
}

/// The least prefix of `order` after which the bound on the error is within the tolerance.
fn until_error(frame: &Frame, anew: &[bool], tolerance: f64, factors: &[f64], order: &[u32]) -> usize {
    // What stays unsent whatever the prefix is: squares per band and colour.
    let mut listed = vec![false; frame.candidates()];
    for &candidate in order {
        listed[candidate as usize] = true;
    }
    let mut unsent = vec![[0.0; 3]; anew.len()];
    for (band, &anew) in anew.iter().enumerate() {
        for candidate in frame.range(band).filter(|&candidate| !listed[candidate]) {
            add_squares(&mut unsent[band], frame.change(candidate as u32, anew));
        }
    }

    // Take candidates back, smallest first, for as long as the rest is within the tolerance: sums only grow, so nothing
    // cancels and the bound is sound.
    let mut kept = order.len();
    while kept > 0 {
        let candidate = order[kept - 1];
        let band = frame.band(candidate);
        add_squares(&mut unsent[band], frame.change(candidate, anew[band]));
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
