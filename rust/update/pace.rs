//! How much of M a frame may stream to end in time, learnt from the frames before.
//!
//! From the moment at which a frame chooses, it takes a fixed part and a part for each unit of cost. Both follow by least
//! squares from the last frames, in relative errors and with old frames fading, so that a budget on a busy machine shrinks
//! and one on an idle machine grows. Frames scatter about that line; a margin above it is held where all but a few of
//! them end (a stochastic quantile: up by much after a frame that was late, down by little after one that was not).

/// What is left of a frame's weight in the next one: the last 20 frames or so count.
const FADING: f64 = 0.95;
/// Before anything is known: half a millisecond, and 2 GB a second, with the weight of a twentieth of a frame.
const PRIOR: [(f64, f64); 2] = [(0.0, 5e-4), (4e6, 2.5e-3)];
const PRIOR_WEIGHT: f64 = 0.05;
/// The share of frames that may end beyond margin times prediction, and how quickly the margin moves.
const LATE: f64 = 0.04;
const AGILITY: f64 = 0.12;
/// A frame that was stopped by the system says nothing about the next.
const MARGINS: std::ops::RangeInclusive<f64> = 1.0..=2.0;

/// The pace of one machine on one transport.
pub struct Pace {
    seen: Moments,
    /// Predictions are taken so many times.
    margin: f64,
}

impl Default for Pace {
    fn default() -> Pace {
        Pace { seen: Moments::default(), margin: 1.1 }
    }
}

/// Weighted sums over frames of 1, x, x^2, t and x t; x is the cost and t the time.
#[derive(Clone, Copy, Default)]
struct Moments([f64; 5]);

impl Moments {
    fn add(&mut self, x: f64, t: f64, weight: f64) {
        // Relative errors: a frame of twice the time may be off by twice as much.
        let weight = weight / (t * t);
        for (sum, item) in self.0.iter_mut().zip([1.0, x, x * x, t, x * t]) {
            *sum += weight * item;
        }
    }

    /// The line t = fixed + rate x, neither negative.
    fn line(&self) -> (f64, f64) {
        let [n, x, xx, t, xt] = self.0;
        let rate = ((n * xt - x * t) / (n * xx - x * x)).max(0.0);
        let fixed = (t - rate * x) / n;
        if fixed >= 0.0 { (fixed, rate) } else { (0.0, xt / xx) }
    }
}

impl Pace {
    fn line(&self) -> (f64, f64) {
        let mut all = self.seen;
        PRIOR.into_iter().for_each(|(x, t)| all.add(x, t, PRIOR_WEIGHT));
        all.line()
    }

    /// The cost that fits into so many seconds; zero if nothing does.
    pub fn affordable(&self, seconds: f64) -> f64 {
        let (fixed, rate) = self.line();
        ((seconds / self.margin - fixed) / rate.max(1e-12)).max(0.0)
    }

    /// Takes in one frame: what it streamed, and what it took.
    pub fn learn(&mut self, cost: f64, seconds: f64) {
        let (fixed, rate) = self.line();
        let late = seconds > self.margin * (fixed + rate * cost);
        let step = AGILITY * (if late { 1.0 - LATE } else { -LATE });
        self.margin = (self.margin * (1.0 + step)).clamp(*MARGINS.start(), *MARGINS.end());
        self.seen.0.iter_mut().for_each(|sum| *sum *= FADING);
        self.seen.add(cost, seconds.max(1e-6), 1.0);
    }
}
