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
//!     colours: Colours::Joint,
//! })?;
//! let update = follow.step(&target)?;
//! assert_eq!(update.terms.len(), 30);
//! # Ok::<(), _core::error::Error>(())
//! ```
//!
//! Three rules where the papers are silent. A band is only listed as reset if it holds anything to forget. A budget of
//! nothing changes nothing: a reset without terms would only lose light (`Nonlinear` and `Linear` excepted: their values
//! are always exactly their terms). And as there are no images of bands (`multiplying/response.rs`), a reset streams
//! every column that its band holds: a budget in cost pays for them before it pays for terms. A reset that does not fit is
//! not made, and its band goes on incrementally; one that fits sends the light in those columns, which then costs nothing
//! more. (Where all that is held is reset, sums start from zero, and only terms cost.)

use crate::basis::Bands;
use crate::error::{Error, Result};

use crate::update::change::{Applied, Choice, Update};

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
    applied: Applied,
    keys: Keys,
}

/// Coefficients up to this limit neither overflow a key nor the square of one.
pub(in crate::update) const MAX_COEFFICIENT: f64 = 1e90;

impl Approximation {
    /// Starts from no light at all.
    pub fn new(bands: Bands, settings: Settings) -> Result<Self> {
        bands.check()?;
        settings.check(&bands)?;
        Ok(Approximation { applied: Applied::new(&bands), bands, settings, keys: Keys::default() })
    }

    /// Brings the values nearer to `target`, within the budget. An error leaves everything as it was.
    pub fn step(&mut self, target: &[[f64; 3]]) -> Result<Update> {
        self.check(target)?;
        Ok(self.follow(target))
    }

    /// `step`, where somebody else has chosen: the bands to reset, and the columns to send in the order of their worth, of
    /// which as many are sent as the budget allows.
    pub fn step_given(&mut self, target: &[[f64; 3]], resets: &[usize], columns: &[u32]) -> Result<Update> {
        self.check(target)?;
        self.check_choice(resets, columns)?;
        Ok(self.follow_choice(target, resets, columns))
    }

    /// `step`, for light that has been checked.
    pub(in crate::update) fn follow(&mut self, target: &[[f64; 3]]) -> Update {
        let choice = self.choose(target);
        self.send(target, choice)
    }

    /// What there is to choose from.
    fn look<'a>(&'a mut self, target: &'a [[f64; 3]]) -> (Candidates<'a>, &'a Settings) {
        let Approximation { bands, settings, applied, keys } = self;
        let values = applied.values();
        keys.measure(settings.colours, &settings.weights, target, values);
        let (settings, keys) = (&*settings, &*keys);
        let Settings { colours, weights, costs, .. } = settings;
        (Candidates { bands, colours: *colours, weights, costs, target, values, scratch: keys }, settings)
    }

    /// `SetupBands()` of Fig. 6.1: the mode of every band and the list of its columns.
    fn choose(&mut self, target: &[[f64; 3]]) -> Choice {
        let count = self.bands.count();
        let (candidates, settings) = self.look(target);
        let budget = &settings.budget;
        let by_key = |anew: Vec<bool>, budget: &Budget| select::choose(&candidates, anew, budget);
        match settings.method {
            Method::Full => by_key(vec![false; count], &Budget::Terms(usize::MAX)),
            Method::Nonlinear => by_key(vec![true; count], budget),
            Method::Linear => select::first(&candidates, budget),
            _ if budget.is_nothing() => Choice { anew: vec![false; count], sent: Vec::new() },
            Method::Incremental => by_key(vec![false; count], budget),
            Method::PerBand { test: BandTest::Simple, norm } => by_key(band_test::simple(&candidates, norm), budget),
            Method::PerBand { test: BandTest::Fixed { incremental }, .. } => {
                by_key((0..count).map(|band| band >= incremental).collect(), budget)
            }
            Method::PerBand { test: BandTest::Dealer, norm } => band_test::deal(&candidates, budget, norm),
            Method::PerBand { test: BandTest::Exhaustive, norm } => band_test::exhaustive(&candidates, budget, norm),
            Method::HarmonicOrder { tolerance } => harmonic::choose(&candidates, budget, tolerance),
        }
    }

    /// Applies a choice to the values.
    fn send(&mut self, target: &[[f64; 3]], mut choice: Choice) -> Update {
        // A few by their keys, and perhaps a band's in order: a stable sort merges such runs.
        choice.sent.sort();
        let colours = self.settings.colours;
        let column = |candidate: u32| (candidate as usize / colours.per_column(), colours.of(candidate));
        self.applied.send(&self.bands, &choice.anew, choice.sent.into_iter().map(column), target)
    }

    /// `follow`, by the largest terms of the light within the budget, from black, whatever the method.
    pub(in crate::update) fn follow_largest(&mut self, target: &[[f64; 3]]) -> Update {
        let anew = vec![true; self.bands.count()];
        let (candidates, settings) = self.look(target);
        let choice = select::choose(&candidates, anew, &settings.budget);
        self.send(target, choice)
    }

    /// `step_given`, for light and a choice that have been checked.
    pub(in crate::update) fn follow_choice(
        &mut self,
        target: &[[f64; 3]],
        resets: &[usize],
        columns: &[u32],
    ) -> Update {
        let mut anew = vec![false; self.bands.count()];
        resets.iter().for_each(|&band| anew[band] = true);
        let per_column = self.settings.colours.per_column() as u32;
        let mut first = vec![true; self.bands.columns()];
        let new = columns.iter().filter(|&&column| std::mem::take(&mut first[column as usize]));
        let order = new.flat_map(|&column| (0..per_column).map(move |k| column * per_column + k)).collect();
        let choice = self.within_budget(target, anew, order);
        self.send(target, choice)
    }

    /// Refuses bands and columns that are not there.
    pub fn check_choice(&self, resets: &[usize], columns: &[u32]) -> Result<()> {
        let (bands, count) = (self.bands.count(), self.bands.columns());
        if let Some(band) = resets.iter().find(|&&band| band >= bands) {
            return Err(Error::input(format!("expected bands below {bands} to reset, got {band}")));
        }
        match columns.iter().find(|&&column| column as usize >= count) {
            Some(column) => Err(Error::input(format!("expected columns below {count} to send, got {column}"))),
            None => Ok(()),
        }
    }

    fn within_budget(&mut self, target: &[[f64; 3]], anew: Vec<bool>, order: Vec<u32>) -> Choice {
        let (candidates, settings) = self.look(target);
        select::ordered(&candidates, anew, &settings.budget, order)
    }

    /// V~: what has been applied so far.
    pub fn values(&self) -> &[[f64; 3]] {
        self.applied.values()
    }

    /// Starts again from `values`, exactly.
    pub fn set_values(&mut self, values: &[[f64; 3]]) -> Result<()> {
        check_coefficients(values, self.bands.columns())?;
        self.applied.set(&self.bands, values);
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
        self.applied.values() == target
    }

    /// How the columns group into bands.
    pub fn bands(&self) -> &Bands {
        &self.bands
    }

    /// What it goes by, with the budget as last set.
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
