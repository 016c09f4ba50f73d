//! What choosing can be told: a method, a budget, what a change is worth and what it costs.

use std::ops::Range;

use crate::basis::Bands;
use crate::error::{Error, Result};

/// How the columns of a frame are chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// Every column that differs, whatever the budget.
    Full,
    /// NWA: the values are exactly the largest terms of the light.
    Nonlinear,
    /// The values are exactly the first columns of the light: spherical harmonics of a low order, say.
    Linear,
    /// BI: the largest changes.
    Incremental,
    /// PBI: each band is either reset or updated incrementally.
    PerBand {
        /// How it is found which.
        test: BandTest,
        /// How that test measures error.
        norm: Norm,
    },
    /// PBI for spherical harmonics: low bands first, each to a tolerance relative to the light (`harmonic.rs`).
    HarmonicOrder {
        /// The error a band may keep before the next is filled, as a share of the light; a tenth of it pass by pass.
        tolerance: f64,
    },
}

/// How the band tests measure error, over columns and colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Norm {
    /// Sums of magnitudes.
    L1,
    /// Roots of sums of squares.
    L2,
}

/// Whether a term changes the three colours of its column or one of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colours {
    /// All three: a column is one candidate.
    Joint,
    /// One: a column is three candidates.
    Separate,
}

impl Colours {
    /// Candidates of a column.
    pub(in crate::update) fn per_column(self) -> usize {
        match self {
            Colours::Joint => 1,
            Colours::Separate => 3,
        }
    }

    /// The colours that a candidate changes.
    pub(in crate::update) fn of(self, candidate: u32) -> Range<usize> {
        match self {
            Colours::Joint => 0..3,
            Colours::Separate => {
                let colour = candidate as usize % 3;
                colour..colour + 1
            }
        }
    }
}

/// How a band is found to be worth resetting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BandTest {
    /// Incremental if |L - L~| < |L|.
    Simple,
    /// Deal one term at a time to the band where the error falls most.
    Dealer,
    /// The combination of least error, of all 2^bands.
    Exhaustive,
    /// The first bands are always incremental, the others always reset.
    Fixed {
        /// How many bands, from the coarsest on, are never reset.
        incremental: usize,
    },
}

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
    Error {
        /// The most that may be left, in the unit of B where factors are row norms of M.
        tolerance: f64,
        /// One a band, not negative.
        factors: Vec<f64>,
    },
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

/// All that choosing can be told.
#[derive(Clone, Debug)]
pub struct Settings {
    /// How columns are chosen.
    pub method: Method,
    /// When a frame has sent enough; `Method::Full` asks nothing of it.
    pub budget: Budget,
    /// What a unit of change in a column is worth: area, the norm of the column of M, ...
    pub weights: Vec<f64>,
    /// What sending a column costs, in the unit of `Budget::Cost`; empty if nothing is known of it.
    pub costs: Vec<f64>,
    /// What a candidate is: a column, or one colour of it.
    pub colours: Colours,
}

/// Weights and costs up to this limit neither overflow a key nor the square of one.
const MAX_WEIGHT: f64 = 1e30;

impl Settings {
    /// Refuses numbers that are negative or too large, and lists of the wrong length.
    pub(super) fn check(&self, bands: &Bands) -> Result<()> {
        check_numbers("weights", &self.weights, bands.columns(), MAX_WEIGHT)?;
        if !self.costs.is_empty() {
            check_numbers("costs", &self.costs, bands.columns(), MAX_WEIGHT)?;
        }
        self.check_choice(bands)
    }

    /// The budget and the method.
    pub(super) fn check_choice(&self, bands: &Bands) -> Result<()> {
        match &self.budget {
            Budget::Terms(_) => {}
            Budget::Cost(_) if self.costs.is_empty() => {
                return Err(Error::input("a budget in cost needs the cost of every column, got none"));
            }
            Budget::Cost(cost) => check_number("the budget in cost", *cost)?,
            Budget::Error { tolerance, factors } => {
                check_number("the tolerated error", *tolerance)?;
                check_numbers("band factors", factors, bands.count(), MAX_WEIGHT)?;
            }
        }
        match self.method {
            Method::HarmonicOrder { tolerance } => check_number("the tolerance of a band", tolerance),
            Method::PerBand { test, .. } => check_test(test, bands, &self.budget),
            _ => Ok(()),
        }
    }
}

fn check_number(name: &str, number: f64) -> Result<()> {
    if number >= 0.0 && number.is_finite() {
        return Ok(());
    }
    Err(Error::input(format!("expected {name} to be finite and not negative, got {number}")))
}

fn check_numbers(name: &str, numbers: &[f64], count: usize, most: f64) -> Result<()> {
    if numbers.len() != count {
        return Err(Error::input(format!("expected {count} {name}, got {}", numbers.len())));
    }
    match numbers.iter().position(|number| !(0.0..=most).contains(number)) {
        Some(at) => Err(Error::input(format!("expected {name} from 0 to {most:e}, got {} at {at}", numbers[at]))),
        None => Ok(()),
    }
}

/// 2^bands allocations a frame are tried up to here.
const MAX_EXHAUSTIVE_BANDS: usize = 12;

fn check_test(test: BandTest, bands: &Bands, budget: &Budget) -> Result<()> {
    let automatic = matches!(test, BandTest::Dealer | BandTest::Exhaustive);
    if automatic && matches!(budget, Budget::Error { .. }) {
        return Err(Error::input(
            "the dealer and exhaustive band tests minimise error within a budget: expected one in terms or in cost, \
             got a tolerated error",
        ));
    }
    if test == BandTest::Exhaustive && bands.count() > MAX_EXHAUSTIVE_BANDS {
        return Err(Error::input(format!(
            "the exhaustive band test tries all combinations: expected at most {MAX_EXHAUSTIVE_BANDS} bands, got {}",
            bands.count()
        )));
    }
    Ok(())
}
