//! Which bands to reset: the tests of per-band incremental updates (Overbeck 2006, section 6.2).
//!
//! A reset is an increment from zero: it pays where the light has drifted so far from our copy that it is nearer to
//! zero. `simple` asks that before it knows how many terms the band will get; `dealer` decides it together with the
//! allocation, term by term; `exhaustive` tries all combinations. `fixed` is the static threshold that the thesis
//! rejects, for comparison.

use std::borrow::Cow;

use crate::update::change::Choice;

use super::candidates::Candidates;
use super::largest::{Keyed, Largest, by_key};
use super::method::{Budget, Norm};

/// Which bands are nearer to zero than to our copy. An unchanged band is not, even if it is zero.
pub(super) fn simple(candidates: &Candidates, norm: Norm) -> Vec<bool> {
    let anew = |band| {
        let change = candidates.norm(band, false, norm);
        change > 0.0 && change >= candidates.norm(band, true, norm)
    };
    (0..candidates.bands.count()).map(anew).collect()
}

/// The candidates of a band in one mode, largest first, and what is left once the first n are sent.
struct Hand {
    cards: Vec<Keyed>,
    /// Sent as well, whatever n is: where a budget in cost pays for the reset, the columns that it streams.
    paid: Vec<u32>,
    /// The band's error after n cards: `cards.len() + 1` numbers, additive over bands.
    left: Vec<f64>,
    /// The cost of the first n cards, and of the reset, likewise.
    spent: Vec<f64>,
}

/// Both modes of a band.
struct Deck {
    hands: [Hand; 2],
    /// Whether a reset has anything to forget, and fits into the budget; if not, it is not made.
    held: bool,
}

impl Hand {
    fn new(candidates: &Candidates, band: usize, anew: bool, budget: &Budget, norm: Norm) -> Hand {
        let streams = anew && matches!(budget, Budget::Cost(_));
        let paid: Vec<u32> = if streams { candidates.paid(band).collect() } else { Vec::new() };
        let mut keys = Cow::from(candidates.keys(band, anew));
        for &candidate in &paid {
            keys.to_mut()[candidate as usize - candidates.range(band).start] = 0.0;
        }
        let mut largest = Largest::new(most_terms(candidates, band, budget));
        largest.offer(candidates.range(band).start, &keys);
        let cards = largest.sorted();

        // What is never sent comes first, then the smallest card.
        let beyond = candidates.error_beyond(band, anew, norm, &keys, &cards);
        let mut left = vec![beyond; cards.len() + 1];
        for n in (0..cards.len()).rev() {
            left[n] = left[n + 1] + candidates.error(cards[n].candidate, anew, norm);
        }
        let mut spent = vec![if streams { candidates.held_cost(band) } else { 0.0 }; cards.len() + 1];
        for n in 0..cards.len() {
            spent[n + 1] = spent[n] + candidates.cost(cards[n].candidate);
        }
        Hand { cards, paid, left, spent }
    }
}

/// No band is ever sent more candidates than this.
fn most_terms(candidates: &Candidates, band: usize, budget: &Budget) -> usize {
    let all = candidates.range(band).len();
    match *budget {
        Budget::Terms(terms) => all.min(terms),
        Budget::Cost(cost) => {
            let least =
                candidates.range(band).map(|candidate| candidates.cost(candidate as u32)).fold(f64::INFINITY, f64::min);
            // A saturating conversion: cards that cost nothing are all listed.
            all.min(((cost / least) as usize).saturating_add(1))
        }
        Budget::Error { .. } => all,
    }
}

impl Deck {
    fn all(candidates: &Candidates, budget: &Budget, norm: Norm) -> Vec<Deck> {
        let deck = |band: usize| Deck {
            hands: [false, true].map(|anew| Hand::new(candidates, band, anew, budget, norm)),
            held: candidates.band_held(band),
        };
        (0..candidates.bands.count()).map(deck).collect()
    }

    /// The better mode for n cards: 1 is a reset. Without a card a band stays as it is, so that no reset leaves it
    /// black; only where the light itself is black does a reset need none, unless the reset itself costs something.
    fn mode(&self, n: usize) -> usize {
        let [incremental, anew] = &self.hands;
        let allowed = self.held && (n > 0 || (anew.cards.is_empty() && anew.spent(0) == 0.0));
        (allowed && anew.left(n) < incremental.left(n)) as usize
    }

    fn hand(&self, n: usize) -> &Hand {
        &self.hands[self.mode(n)]
    }

    /// How much the next card takes off the error; `None` once the band is up to date.
    fn gain(&self, n: usize) -> Option<f64> {
        let hand = self.hand(n);
        (n < hand.cards.len()).then(|| hand.left(n) - self.hand(n + 1).left(n + 1))
    }
}

impl Hand {
    /// The band's error after n cards, or after all.
    fn left(&self, n: usize) -> f64 {
        self.left[n.min(self.cards.len())]
    }

    fn spent(&self, n: usize) -> f64 {
        self.spent[n.min(self.cards.len())]
    }
}

/// The dealer algorithm (section 6.2.3): allocation and modes together, one card at a time.
///
/// A band's error is that of its better mode for the cards it has; the net gain of a card so includes a change of mode.
/// With a handful of bands a scan for the largest gain is as fast as a heap.
pub(super) fn deal(candidates: &Candidates, budget: &Budget, norm: Norm) -> Choice {
    let mut decks = Deck::all(candidates, budget, norm);
    let (mut dealt, mut cards) = (vec![0; decks.len()], 0);
    loop {
        // The band whose error falls most; of equals the coarsest.
        let gains = decks.iter().zip(&dealt).enumerate();
        let gains = gains.filter_map(|(band, (deck, &n))| deck.gain(n).map(|gain| (band, gain)));
        let Some((band, _)) = gains.reduce(|best, next| if next.1 > best.1 { next } else { best }) else { break };

        dealt[band] += 1;
        let of_all = |cost: fn(&Hand, usize) -> f64| {
            decks.iter().zip(&dealt).map(|(deck, &n)| cost(deck.hand(n), n)).sum::<f64>()
        };
        if affordable(budget, cards + 1, || of_all(|hand, _| hand.spent(0)), || of_all(Hand::spent)) {
            cards += 1;
            continue;
        }
        dealt[band] -= 1;
        // Where it is the reset that does not fit, the band goes on without.
        let deck = &mut decks[band];
        let resets = deck.mode(dealt[band]) == 0 && deck.mode(dealt[band] + 1) == 1;
        if !(resets && deck.hands[1].spent(0) > 0.0) {
            break;
        }
        deck.held = false;
    }
    let modes: Vec<usize> = decks.iter().zip(&dealt).map(|(deck, &n)| deck.mode(n)).collect();
    collect(&decks, &modes, &dealt)
}

/// Whether so many cards of so much cost are within the budget; the first card always is, if no reset costs anything.
fn affordable(budget: &Budget, cards: usize, resets: impl Fn() -> f64, spent: impl Fn() -> f64) -> bool {
    match *budget {
        Budget::Terms(terms) => cards <= terms,
        Budget::Cost(cost) => (cards <= 1 && resets() == 0.0) || spent() <= cost,
        Budget::Error { .. } => true,
    }
}

/// All combinations of modes (section 6.2.1); of equals the one with the fewest resets of coarse bands.
pub(super) fn exhaustive(candidates: &Candidates, budget: &Budget, norm: Norm) -> Choice {
    let decks = Deck::all(candidates, budget, norm);
    let free: Vec<usize> = (0..decks.len()).filter(|&band| decks[band].held).collect();
    let allocate = |combination: usize| {
        let mut modes = vec![0; decks.len()];
        for (bit, &band) in free.iter().rev().enumerate() {
            modes[band] = combination >> bit & 1;
        }
        let resets: f64 = decks.iter().zip(&modes).map(|(deck, &mode)| deck.hands[mode].spent(0)).sum();
        if matches!(budget, Budget::Cost(cost) if resets > *cost) {
            return (f64::INFINITY, modes, vec![0; decks.len()]);
        }
        let dealt = merge(&decks, &modes, budget);
        let hands = decks.iter().zip(modes.iter().zip(&dealt));
        let error: f64 = hands.map(|(deck, (&mode, &n))| deck.hands[mode].left(n)).sum();
        (error, modes, dealt)
    };
    let best =
        (1..1 << free.len()).map(allocate).fold(allocate(0), |best, next| if next.0 < best.0 { next } else { best });
    collect(&decks, &best.1, &best.2)
}

/// How many cards each band gets if the largest keys of all bands are sent.
fn merge(decks: &[Deck], modes: &[usize], budget: &Budget) -> Vec<usize> {
    let hands: Vec<&Hand> = decks.iter().zip(modes).map(|(deck, &mode)| &deck.hands[mode]).collect();
    let mut dealt = vec![0; hands.len()];
    for card in 0.. {
        let next = (0..hands.len()).filter_map(|band| hands[band].cards.get(dealt[band]).map(|card| (band, card)));
        let Some((band, _)) = next.min_by(|a, b| by_key(a.1, b.1)) else { break };
        dealt[band] += 1;
        let resets = || hands.iter().map(|hand| hand.spent(0)).sum::<f64>();
        let spent = || hands.iter().zip(&dealt).map(|(hand, &n)| hand.spent(n)).sum::<f64>();
        if !affordable(budget, card + 1, resets, spent) {
            dealt[band] -= 1;
            break;
        }
    }
    dealt
}

fn collect(decks: &[Deck], modes: &[usize], dealt: &[usize]) -> Choice {
    let mut sent = Vec::new();
    for (deck, (&mode, &n)) in decks.iter().zip(modes.iter().zip(dealt)) {
        sent.extend(deck.hands[mode].cards.iter().take(n).map(|card| card.candidate));
        sent.extend(&deck.hands[mode].paid);
    }
    Choice { anew: modes.iter().map(|&mode| mode == 1).collect(), sent }
}
