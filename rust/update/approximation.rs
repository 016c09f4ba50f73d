//! Choosing: which columns of V to bring up to date in this frame, by which method, within which budget.
//!
//! V is where the light is, `values` (V~) where our copy of it is. A step chooses columns, sets V~ to V there *bit for
//! bit*, and returns the change, so that whoever multiplies can follow (Overbeck 2006, chapters 4, 6 and 8):
//!
//! ```text
//! Nonlinear    (NWA)  all bands start anew;                  the largest weight_j |V_j|
//! Incremental  (BI)   no band starts anew;                   the largest weight_j |V_j - V~_j|
//! Linear              all bands start anew;                  the first columns
//! PerBand      (PBI)  each band as its test says (Fig. 6.1); the largest of both kinds, over all bands
//! ```
//!
//! ```
//! # use _core::{basis::ColumnSpace, update::*};
//! let bands = ColumnSpace::haar(4)?.bands();
//! let target = vec![[1.0, 2.0, 3.0]; bands.columns()];
//! let mut follow = Approximation::new(bands.clone(), Settings {
//!     method: Method::PerBand { test: BandTest::Simple, norm: Norm::L1 },
//!     budget: Budget::Terms(30),
//!     weights: bands.areas,
//!     costs: Vec::new(),
//!     channels: Channels::Joint,
//! })?;
//! let update = follow.step(&target)?;
//! assert_eq!(update.terms.len(), 30);
//! # Ok::<(), _core::error::Error>(())
//! ```
//!
//! Three rules where the papers are silent. A band is only listed as reset if it holds anything to forget. A budget of
//! nothing changes nothing: a reset without terms would only lose light (`Nonlinear` and `Linear` excepted: their values
//! are always exactly their terms). And as there are no images of bands (`response.rs`), a reset streams every column
//! that its band holds: a budget in cost pays for them before it pays for terms. A reset that does not fit is not made,
//! and its band goes on incrementally; one that fits sends the light in those columns, which then costs nothing more.
//! (Where all that is held is reset, sums start from zero, and only terms cost.)

use std::ops::Range;

use crate::basis::Bands;
use crate::error::{Error, Result};

use super::band_test::{self, BandTest};
use super::change::{Term, Update};
use super::frame::{Frame, Keys};
use super::harmonic;
use super::select::{self, Budget};

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
    PerBand { test: BandTest, norm: Norm },
    /// PBI for spherical harmonics: low bands first, each to a tolerance relative to the light (`harmonic.rs`).
    HarmonicOrder { tolerance: f64 },
}

/// How the band tests measure error, over columns and colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Norm {
    L1,
    L2,
}

/// Whether a term changes the three colours of its column or one of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channels {
    Joint,
    Separate,
}

impl Channels {
    /// Candidates of a column.
    pub(super) fn lanes(self) -> usize {
        match self {
            Channels::Joint => 1,
            Channels::Separate => 3,
        }
    }

    /// The colours that a candidate changes.
    pub(super) fn colours(self, candidate: u32) -> Range<usize> {
        match self {
            Channels::Joint => 0..3,
            Channels::Separate => {
                let colour = candidate as usize % 3;
                colour..colour + 1
            }
        }
    }
}

/// All that choosing can be told.
#[derive(Clone, Debug)]
pub struct Settings {
    pub method: Method,
    pub budget: Budget,
    /// What a unit of change in a column is worth: area, the norm of the column of M, ...
    pub weights: Vec<f64>,
    /// What sending a column costs, in the unit of `Budget::Cost`; empty if nothing is known of it.
    pub costs: Vec<f64>,
    pub channels: Channels,
}

/// A copy of V that follows it within a budget.
#[derive(Clone)]
pub struct Approximation {
    bands: Bands,
    settings: Settings,
    /// V~. INVARIANT: finite, and where a term was sent equal to that frame's light bit for bit.
    values: Vec<[f64; 3]>,
    keys: Keys,
}

/// Coefficients and weights up to these limits neither overflow a key nor the square of one.
pub(super) const MAX_COEFFICIENT: f64 = 1e90;
const MAX_WEIGHT: f64 = 1e30;

/// What a frame does: which bands start anew, and which candidates are sent.
pub(super) struct Choice {
    pub anew: Vec<bool>,
    pub sent: Vec<u32>,
}

impl Approximation {
    /// Starts from no light at all.
    pub fn new(bands: Bands, settings: Settings) -> Result<Self> {
        settings.check(&bands)?;
        let values = vec![[0.0; 3]; bands.columns()];
        Ok(Approximation { bands, settings, values, keys: Keys::default() })
    }

    /// Brings the values nearer to `target`, within the budget. An error leaves everything as it was.
    pub fn step(&mut self, target: &[[f64; 3]]) -> Result<Update> {
        self.check(target)?;
        Ok(self.follow(target))
    }

    /// `step`, for light that has been checked.
    pub(super) fn follow(&mut self, target: &[[f64; 3]]) -> Update {
        let choice = self.choose(target);
        self.send(target, choice)
    }

    /// `SetupBands()` of Fig. 6.1: the mode of every band and the list of its columns.
    fn choose(&mut self, target: &[[f64; 3]]) -> Choice {
        let Approximation { bands, settings, values, keys } = self;
        keys.measure(settings.channels, &settings.weights, target, values);
        let frame = Frame {
            bands,
            channels: settings.channels,
            weights: &settings.weights,
            costs: &settings.costs,
            target,
            values,
            scratch: keys,
        };

        let budget = &settings.budget;
        let by_key = |anew: Vec<bool>, budget: &Budget| select::choose(&frame, anew, budget);
        match settings.method {
            Method::Full => by_key(vec![false; bands.count()], &Budget::Terms(usize::MAX)),
            Method::Nonlinear => by_key(vec![true; bands.count()], budget),
            Method::Linear => select::first(&frame, budget),
            _ if budget.is_nothing() => Choice { anew: vec![false; bands.count()], sent: Vec::new() },
            Method::Incremental => by_key(vec![false; bands.count()], budget),
            Method::PerBand { test: BandTest::Simple, norm } => by_key(band_test::simple(&frame, norm), budget),
            Method::PerBand { test: BandTest::Fixed { incremental }, .. } => {
                by_key((0..bands.count()).map(|band| band >= incremental).collect(), budget)
            }
            Method::PerBand { test: BandTest::Dealer, norm } => band_test::deal(&frame, budget, norm),
            Method::PerBand { test: BandTest::Exhaustive, norm } => band_test::exhaustive(&frame, budget, norm),
            Method::HarmonicOrder { tolerance } => harmonic::choose(&frame, budget, tolerance),
        }
    }

    /// Applies a choice to the values; lines 6 to 19 of Fig. 6.1 without the images.
    fn send(&mut self, target: &[[f64; 3]], mut choice: Choice) -> Update {
        let mut update = Update::default();
        for band in (0..self.bands.count()).filter(|&band| choice.anew[band]) {
            let held = &mut self.values[self.bands.range(band)];
            if held.iter().any(|value| *value != [0.0; 3]) {
                held.fill([0.0; 3]);
                update.resets.push(band);
            }
        }

        // A few by their keys, and perhaps a band's in order: a stable sort merges such runs.
        choice.sent.sort();
        update.terms.reserve_exact(choice.sent.len());
        for candidate in choice.sent {
            let column = candidate as usize / self.settings.channels.lanes();
            if update.terms.last().is_none_or(|term| term.column as usize != column) {
                update.terms.push(Term { column: column as u32, change: [0.0; 3] });
            }
            let term = update.terms.last_mut().expect("one was just pushed");
            for colour in self.settings.channels.colours(candidate) {
                term.change[colour] = target[column][colour] - self.values[column][colour];
                self.values[column][colour] = target[column][colour];
            }
        }
        update
    }

    /// V~: what has been applied so far.
    pub fn values(&self) -> &[[f64; 3]] {
        &self.values
    }

    /// Starts again from `values`, exactly.
    pub fn set_values(&mut self, values: &[[f64; 3]]) -> Result<()> {
        check_coefficients(values, self.bands.columns())?;
        self.values.copy_from_slice(values);
        Ok(())
    }

    /// Sets the budget of later frames.
    pub fn set_budget(&mut self, budget: Budget) -> Result<()> {
        let before = std::mem::replace(&mut self.settings.budget, budget);
        self.settings.check_choice(&self.bands).inspect_err(|_| self.settings.budget = before)
    }

    /// Refuses light that is not finite, or of the wrong length.
    pub fn check(&self, light: &[[f64; 3]]) -> Result<()> {
        check_coefficients(light, self.bands.columns())
    }

    /// Whether there is nothing left to send.
    pub fn is_converged(&self, target: &[[f64; 3]]) -> bool {
        self.values == target
    }

    pub fn bands(&self) -> &Bands {
        &self.bands
    }

    pub fn settings(&self) -> &Settings {
        &self.settings
    }
}

impl Settings {
    fn check(&self, bands: &Bands) -> Result<()> {
        check_numbers("weights", &self.weights, bands.columns(), MAX_WEIGHT)?;
        if !self.costs.is_empty() {
            check_numbers("costs", &self.costs, bands.columns(), MAX_WEIGHT)?;
        }
        self.check_choice(bands)
    }

    /// The budget and the method.
    fn check_choice(&self, bands: &Bands) -> Result<()> {
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
            Method::PerBand { test, .. } => band_test::check(test, bands, &self.budget),
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

fn check_coefficients(coefficients: &[[f64; 3]], columns: usize) -> Result<()> {
    if coefficients.len() != columns {
        return Err(Error::input(format!("expected {columns} columns of coefficients, got {}", coefficients.len())));
    }
    // A NaN fails every comparison; the fold compiles to vector instructions.
    let flat = coefficients.as_flattened();
    if flat.iter().fold(true, |all, number| all & (number.abs() <= MAX_COEFFICIENT)) {
        return Ok(());
    }
    let at = flat.iter().position(|number| number.is_nan() || number.abs() > MAX_COEFFICIENT).unwrap_or(0);
    Err(Error::input(format!(
        "expected finite coefficients of at most {MAX_COEFFICIENT:e} in magnitude, got {} in column {}, colour {}",
        flat[at],
        at / 3,
        at % 3
    )))
}
