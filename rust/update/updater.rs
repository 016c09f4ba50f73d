//! Following a moving V: choosing and multiplying together, on one grid, with a bound for every frame.
//!
//! ```text
//! step(V):   V to the grid;   update = approximation.step(V);   B = response.apply(update);   bound(V - V~, V)
//! ```

use std::sync::Arc;
use std::time::Instant;

use crate::error::{Error, Result};
use crate::transport::TransportMatrix;

use super::approximation::{Approximation, Settings};
use super::bound::{BandNorms, Bound, band_norms, bound_rows};
use super::change::{Term, Update};
use super::grid::{Grid, RowNorm, light_norm};
use super::response::Response;
use super::select::Budget;

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
    /// Band norms of what remains and of the light itself, of the last step.
    norms: Option<(BandNorms, BandNorms)>,
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
            norms: None,
            matrix,
        })
    }

    /// Moves towards `light` (columns x 3) and writes B (rows x 3). A light that is refused leaves everything as it was.
    pub fn step(&mut self, light: &[[f64; 3]], out: &mut [f32]) -> Result<Step> {
        let started = Instant::now();
        self.approximation.check(light)?;
        if out.len() != 3 * self.matrix.rows {
            return Err(Error::input(format!("expected room for {} x 3 values, got {}", self.matrix.rows, out.len())));
        }
        let grid = self.settle_grid(light, out)?;
        let target = grid.quantise_all(light);
        let update = match self.initial {
            Some(Initial::Full) => self.everything(&target)?,
            _ => self.approximation.step(&target)?,
        };
        self.initial = None;
        let choosing = started.elapsed().as_secs_f64();
        self.response.apply(&self.matrix, &update, out)?;
        let multiplying = started.elapsed().as_secs_f64() - choosing;

        let bound = self.measure(light);
        Ok(Step { update, bound, converged: self.approximation.is_converged(&target), choosing, multiplying })
    }

    /// The grid for this light. Light that outgrows the one in use takes a coarser one, on which what was applied is
    /// rounded and multiplied afresh; light that has faded takes a finer one, on which everything already lies.
    fn settle_grid(&mut self, light: &[[f64; 3]], out: &mut [f32]) -> Result<Grid> {
        let norms = light_norm(light) + light_norm(self.approximation.values());
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
    fn everything(&mut self, target: &[[f64; 3]]) -> Result<Update> {
        self.approximation.set_values(target)?;
        Ok(whole(target))
    }

    /// The bound of this frame, from the light before it was rounded.
    fn measure(&mut self, light: &[[f64; 3]]) -> [f64; 3] {
        let values = self.approximation.values();
        let remaining = band_norms(&self.matrix.bands, |column| {
            std::array::from_fn(|colour| light[column][colour] - values[column][colour])
        });
        let whole = band_norms(&self.matrix.bands, |column| light[column]);
        let bound = self.bound.largest(&remaining, &whole);
        self.norms = Some((remaining, whole));
        bound
    }

    /// The bound of every receiver (rows x 3) for the picture that the last step wrote.
    pub fn bounds(&self, shown: &[f32], out: &mut [f32]) -> Result<()> {
        match &self.norms {
            Some((remaining, whole)) => {
                bound_rows(&self.matrix, remaining, whole, shown, out);
                Ok(())
            }
            None => Err(Error::input("a bound needs a frame: call step first")),
        }
    }

    /// V~, as applied so far.
    pub fn values(&self) -> &[[f64; 3]] {
        self.approximation.values()
    }

    pub fn set_budget(&mut self, budget: Budget) -> Result<()> {
        self.approximation.set_budget(budget)
    }

    /// Bytes beyond M: the response, and V~ as choosing knows it.
    pub fn nbytes(&self) -> usize {
        self.response.nbytes() + size_of_val(self.approximation.values())
    }
}

/// The update that takes black to `values`.
fn whole(values: &[[f64; 3]]) -> Update {
    let terms = values.iter().enumerate().filter(|(_, change)| **change != [0.0; 3]);
    let terms = terms.map(|(column, &change)| Term { column: column as u32, change });
    Update { resets: Vec::new(), terms: terms.collect() }
}
