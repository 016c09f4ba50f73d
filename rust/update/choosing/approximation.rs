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
//!     channels: Colours::Joint,
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

use crate::basis::Bands;
use crate::error::{Error, Result};

use crate::update::change::{Choice, Term, Update};

use super::band_test;
use super::candidates::{Candidates, Keys};
use super::harmonic;
use super::method::{BandTest, Budget, Method, Settings};
use super::select;

/// A copy of V that follows it within a budget.
#[derive(Clone)]
pub struct Approximation {
    bands: Bands,
    settings: Settings,
    /// V~. INVARIANT: finite, and where a term was sent equal to that frame's light bit for bit.
    values: Vec<[f64; 3]>,
    keys: Keys,
}

/// Coefficients up to this limit neither overflow a key nor the square of one.
pub(in crate::update) const MAX_COEFFICIENT: f64 = 1e90;

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
    pub(in crate::update) fn follow(&mut self, target: &[[f64; 3]]) -> Update {
        let choice = self.choose(target);
        self.send(target, choice)
    }

    /// `SetupBands()` of Fig. 6.1: the mode of every band and the list of its columns.
    fn choose(&mut self, target: &[[f64; 3]]) -> Choice {
        let Approximation { bands, settings, values, keys } = self;
        keys.measure(settings.channels, &settings.weights, target, values);
        let candidates = Candidates {
            bands,
            channels: settings.channels,
            weights: &settings.weights,
            costs: &settings.costs,
            target,
            values,
            scratch: keys,
        };

        let budget = &settings.budget;
        let by_key = |anew: Vec<bool>, budget: &Budget| select::choose(&candidates, anew, budget);
        match settings.method {
            Method::Full => by_key(vec![false; bands.count()], &Budget::Terms(usize::MAX)),
            Method::Nonlinear => by_key(vec![true; bands.count()], budget),
            Method::Linear => select::first(&candidates, budget),
            _ if budget.is_nothing() => Choice { anew: vec![false; bands.count()], sent: Vec::new() },
            Method::Incremental => by_key(vec![false; bands.count()], budget),
            Method::PerBand { test: BandTest::Simple, norm } => by_key(band_test::simple(&candidates, norm), budget),
            Method::PerBand { test: BandTest::Fixed { incremental }, .. } => {
                by_key((0..bands.count()).map(|band| band >= incremental).collect(), budget)
            }
            Method::PerBand { test: BandTest::Dealer, norm } => band_test::deal(&candidates, budget, norm),
            Method::PerBand { test: BandTest::Exhaustive, norm } => band_test::exhaustive(&candidates, budget, norm),
            Method::HarmonicOrder { tolerance } => harmonic::choose(&candidates, budget, tolerance),
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
            let column = candidate as usize / self.settings.channels.per_column();
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
