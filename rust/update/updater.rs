//! Following a moving V: choosing and multiplying together, on one grid, with a bound for every frame.
//!
//! ```text
//! step(V):   V to the grid;   update = approximation.step(V);   B = response.apply(update);   bound(V - V~, V)
//! ```

use std::sync::Arc;
use std::time::Instant;

use crate::error::{Error, Result};
use crate::transport::TransportMatrix;

use super::change::{Term, Update};
use super::choosing::approximation::{Approximation, MAX_COEFFICIENT};
use super::choosing::method::{Budget, Settings};
use super::multiplying::bound::{Bound, Measured, bound_rows};
use super::multiplying::grid::{Grid, RowNorm, light_norm};
use super::multiplying::response::Response;
use super::pace::Pace;

/// Bits by which light may grow before its grid must be changed, which costs a whole product.
const HEADROOM: i32 = 6;
/// Light so many times below what its grid allows for gets a finer one, which costs nothing.
const REFINE: f64 = 65536.0;

/// What the first frame starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Initial {
    /// The whole product (Overbeck 2006, section 4: "we compute the full matrix-vector multiply").
    Full,
    /// The first update of the method itself, from black.
    Black,
}

/// What a step did.
pub struct Step {
    pub update: Update,
    /// No receiver is further than this from the untruncated product with the light asked for, in red, green and blue.
    pub bound: [f64; 3],
    /// V~ is the light, bit for bit on its grid.
    pub converged: bool,
    /// Seconds of choosing (grid, tests, selection) and of multiplying.
    pub choosing: f64,
    pub multiplying: f64,
}

/// One follower of the light: an approximation and the response to it.
pub struct Updater {
    matrix: Arc<TransportMatrix>,
    approximation: Approximation,
    response: Response,
    rows: RowNorm,
    bound: Bound,
    grid: Option<Grid>,
    initial: Option<Initial>,
    /// The light on its grid.
    target: Vec<[f64; 3]>,
    /// After the last step.
    measured: Option<Measured>,
    pace: Pace,
}

impl Updater {
    pub fn new(matrix: Arc<TransportMatrix>, settings: Settings, initial: Initial) -> Result<Self> {
        Ok(Updater {
            approximation: Approximation::new(matrix.bands.clone(), settings)?,
            response: Response::new(&matrix),
            rows: RowNorm::of(&matrix),
            bound: Bound::new(&matrix),
            grid: None,
            initial: Some(initial),
            target: Vec::new(),
            measured: None,
            pace: Pace::default(),
            matrix,
        })
    }

    /// Moves towards `light` (columns x 3) and writes B (rows x 3). A light that is refused leaves everything as it was.
    pub fn step(&mut self, light: &[[f64; 3]], out: &mut [f32]) -> Result<Step> {
        self.frame(light, out, None)
    }

    /// `step`, with a budget of its own: what can be sent so that the step ends in `seconds`, as far as earlier ones tell.
    ///
    /// Where nothing fits, the first column is sent. The settings need the cost of every column.
    pub fn step_within(&mut self, light: &[[f64; 3]], out: &mut [f32], seconds: f64) -> Result<Step> {
        self.frame(light, out, Some(seconds))
    }

    fn frame(&mut self, light: &[[f64; 3]], out: &mut [f32], seconds: Option<f64>) -> Result<Step> {
        let started = Instant::now();
        let norm = light_norm(light);
        // A norm within the limit says so of every coefficient; what is not finite has an infinite norm.
        if light.len() != self.matrix.bands.columns() || norm > MAX_COEFFICIENT {
            self.approximation.check(light)?;
        }
        if out.len() != 3 * self.matrix.rows {
            return Err(Error::input(format!("expected room for {} x 3 values, got {}", self.matrix.rows, out.len())));
        }
        self.settle_grid(norm, out)?.quantise_into(light, &mut self.target);
        let settled = started.elapsed().as_secs_f64();
        if let Some(seconds) = seconds {
            // A budget of nothing would change nothing, for ever.
            let cost = self.pace.affordable(seconds - settled).max(f64::MIN_POSITIVE);
            self.approximation.set_budget(Budget::Cost(cost))?;
        }
        let whole = self.initial.take() == Some(Initial::Full);
        let update = if whole { self.everything()? } else { self.approximation.follow(&self.target) };
        let choosing = started.elapsed().as_secs_f64();
        self.response.apply(&self.matrix, &update, out)?;
        let multiplying = started.elapsed().as_secs_f64() - choosing;

        let bound = self.measure(light);
        let converged = self.approximation.is_converged(&self.target);
        if seconds.is_some() && !whole {
            self.pace.learn(self.streamed(), started.elapsed().as_secs_f64() - settled);
        }
        Ok(Step { update, bound, converged, choosing, multiplying })
    }

    /// The cost of the columns that the last update streamed.
    fn streamed(&self) -> f64 {
        let costs = &self.approximation.settings().costs;
        self.response.moved().map(|column| costs[column]).sum()
    }

    /// The grid for this light. Light that outgrows the one in use takes a coarser one, on which what was applied is
    /// rounded and multiplied afresh; light that has faded takes a finer one, on which everything already lies.
    fn settle_grid(&mut self, norm: f64, out: &mut [f32]) -> Result<Grid> {
        let norms = norm + self.measured.as_ref().map_or(0.0, |measured| measured.applied);
        // Twice what exactness needs, and a little for rounding to the grid: a fresh product of what is applied then
        // chooses a grid of its own that is no coarser, and has the same bits.
        let norms = 2.125 * norms;
        match self.grid {
            Some(grid) if grid.holds(norms) && norms * REFINE >= grid.limit => return Ok(grid),
            Some(grid) if grid.holds(norms) => {
                let finer = Grid::for_light(norms, self.rows, HEADROOM)?;
                self.grid = Some(if finer.exponent < grid.exponent { finer } else { grid });
            }
            _ => {
                let grid = Grid::for_light(norms, self.rows, HEADROOM)?;
                let rounded = grid.quantise_all(self.approximation.values());
                self.response = Response::new(&self.matrix);
                self.response.apply(&self.matrix, &whole(&rounded), out)?;
                self.approximation.set_values(&rounded)?;
                self.grid = Some(grid);
            }
        }
        Ok(self.grid.expect("just set"))
    }

    /// The whole light at once.
    fn everything(&mut self) -> Result<Update> {
        self.approximation.set_values(&self.target)?;
        Ok(whole(&self.target))
    }

    /// The bound of this frame, from the light before it was rounded.
    fn measure(&mut self, light: &[[f64; 3]]) -> [f64; 3] {
        let measured = Measured::new(&self.matrix.bands, light, self.approximation.values());
        let bound = self.bound.largest(&measured);
        self.measured = Some(measured);
        bound
    }

    /// The bound of every receiver (rows x 3) for the picture that the last step wrote.
    pub fn bounds(&self, shown: &[f32], out: &mut [f32]) -> Result<()> {
        match &self.measured {
            Some(measured) => {
                bound_rows(&self.matrix, measured, shown, out);
                Ok(())
            }
            None => Err(Error::input("a bound needs a frame: call step first")),
        }
    }

    /// V~, as applied so far.
    pub fn values(&self) -> &[[f64; 3]] {
        self.approximation.values()
    }

    /// Bytes beyond M: the response, V~ as choosing knows it, and V on its grid.
    pub fn nbytes(&self) -> usize {
        self.response.nbytes() + size_of_val(self.approximation.values()) + size_of_val(&self.target[..])
    }
}

/// The update that takes black to `values`.
fn whole(values: &[[f64; 3]]) -> Update {
    let terms = values.iter().enumerate().filter(|(_, change)| **change != [0.0; 3]);
    let terms = terms.map(|(column, &change)| Term { column: column as u32, change });
    Update { resets: Vec::new(), terms: terms.collect() }
}
