//! The largest of many keys.
//!
//! Dropped: `select_nth_unstable` over all (key, candidate) pairs. Most keys lie far below the largest few, and a scan
//! that only compares is several times faster.

use std::cmp::Ordering;

/// A candidate and its key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Keyed {
    /// What sending it is worth.
    pub key: f64,
    /// Its number.
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

    /// For the `count` largest.
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
