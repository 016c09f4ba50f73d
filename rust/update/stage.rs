//! One stage of a product: V is chosen once, and what changes of it is sent through all of the stage's matrices.

use std::sync::Arc;

use crate::basis::haar::Haar;
use crate::basis::{Bands, ColumnSpace};
use crate::error::Result;
use crate::transport::{Factors, TransportMatrix};

use super::change::{Update, between, whole};
use super::choosing::approximation::{Approximation, MAX_COEFFICIENT};
use super::choosing::method::{Budget, Settings};
use super::multiplying::bound::{BandNorms, Bound, Measured};
use super::multiplying::grid::{Grid, HEADROOM, Span, light_norm};
use super::multiplying::merged::merged;
use super::multiplying::response::Response;

/// Light so many times below what its grid allows for gets a finer one, which costs nothing.
const REFINE: f64 = 65536.0;
/// Twice what exactness needs, and a little for rounding to the grid: a fresh product of what is applied then chooses a
/// grid of its own that is no coarser, and has the same bits.
const ROOM: f64 = 2.125;

/// Who says what is sent.
pub enum Chosen<'a> {
    /// The stage's own method.
    Own,
    /// Everything.
    Whole,
    /// The largest terms of the light within the budget, from black.
    Largest,
    /// Somebody else: bands to reset, and columns in the order of their worth, as many as the budget allows.
    Given {
        /// Bands to set to zero first.
        resets: &'a [usize],
        /// Columns to send, the worthiest first; repetitions are passed over.
        columns: &'a [u32],
    },
}

/// A matrix of a stage, and what is known of its response.
#[derive(Clone, Copy)]
pub struct Output<'a> {
    /// M, or one of its factors.
    pub matrix: &'a TransportMatrix,
    /// Its exact sums for what has been applied.
    pub response: &'a Response,
    /// The largest norms of its rows.
    pub bound: &'a Bound,
    /// None before the first frame.
    pub measured: Option<&'a Measured>,
    /// The same as if all of V had been applied.
    pub settled: Option<&'a Measured>,
}

/// A follower of V over the matrices of one stage.
pub struct Stage {
    factors: Factors,
    span: Span,
    approximation: Approximation,
    responses: Vec<Response>,
    bounds: Vec<Bound>,
    grid: Option<Grid>,
    /// V on its grid.
    target: Vec<[f64; 3]>,
    /// After the last step, and as if it had applied all of V.
    measured: Option<[Measured; 2]>,
    /// What those matrices follow that have no texels.
    merged: Option<Merged>,
}

/// V~ put together in wavelets: a function of V~, rounded to its grid, so that whoever follows it is where a fresh product
/// would be.
struct Merged {
    haar: &'static Haar,
    bands: Bands,
    /// Of all matrices, the largest.
    span: Span,
    /// It follows the size of V~, and nothing else; None before the first frame.
    grid: Option<Grid>,
    values: Vec<[f64; 3]>,
    measured: Option<[Measured; 2]>,
}

impl Merged {
    fn new(size: usize, span: Span) -> Result<Merged> {
        let haar = Haar::shared(size)?;
        let bands = ColumnSpace::haar(size)?.bands();
        Ok(Merged { haar, span, grid: None, values: vec![[0.0; 3]; bands.columns()], bands, measured: None })
    }

    /// Takes V~ as it is now, and says what that changes.
    fn follow(&mut self, values: &[[f64; 3]]) -> Result<Update> {
        let (grid, values) = merged(self.haar, values, self.span)?;
        let update = if self.grid == Some(grid) { between(&self.values, &values) } else { whole(&values) };
        (self.grid, self.values) = (Some(grid), values);
        Ok(update)
    }
}

impl Stage {
    /// `span`: of the stage's matrices, the largest.
    pub fn new(factors: Factors, span: Span, settings: Settings) -> Result<Self> {
        let merged = factors.merged().map(|size| Merged::new(size, span)).transpose()?;
        Ok(Stage {
            merged,
            approximation: Approximation::new(factors.first().bands.clone(), settings)?,
            responses: factors.iter().map(|matrix| Response::new(matrix)).collect(),
            bounds: factors.iter().map(|matrix| Bound::new(matrix)).collect(),
            span,
            grid: None,
            target: Vec::new(),
            measured: None,
            factors,
        })
    }

    /// How the columns of V group into bands.
    pub fn bands(&self) -> &Bands {
        self.approximation.bands()
    }

    /// V~: what has been applied.
    pub fn values(&self) -> &[[f64; 3]] {
        self.approximation.values()
    }

    /// V on its grid, as last received.
    pub fn target(&self) -> &[[f64; 3]] {
        &self.target
    }

    /// The stage's matrices in their order, each with its response and bound.
    pub fn outputs(&self) -> impl Iterator<Item = Output<'_>> {
        let all = self.factors.iter().zip(&self.responses).zip(&self.bounds);
        all.map(move |((matrix, response), bound)| {
            let merged = self.merged.as_ref().filter(|_| matrix.space != self.factors.space());
            let measured = merged.map_or(self.measured.as_ref(), |merged| merged.measured.as_ref());
            let [measured, settled] = [0, 1].map(|which| Some(&measured?[which]));
            Output { matrix, response, bound, measured, settled }
        })
    }

    /// Sets the budget of later frames; refuses one that the settings do not allow.
    pub fn set_budget(&mut self, budget: Budget) -> Result<()> {
        self.approximation.set_budget(budget)
    }

    /// Refuses light that is not finite, or of the wrong length.
    pub fn check(&self, light: &[[f64; 3]]) -> Result<()> {
        self.approximation.check(light)
    }

    /// Refuses a choice of bands or columns that are not there.
    pub fn check_choice(&self, resets: &[usize], columns: &[u32]) -> Result<()> {
        self.approximation.check_choice(resets, columns)
    }

    /// The budget as last set.
    pub fn budget(&self) -> &Budget {
        &self.approximation.settings().budget
    }

    /// Takes in V, rounded to a grid that follows its size: what outgrows the one in use takes a coarser one, on which
    /// what was applied is rounded and multiplied afresh; what has faded takes a finer one, on which everything already
    /// lies. A V that is refused leaves everything as it was.
    pub fn receive(&mut self, light: &[[f64; 3]]) -> Result<()> {
        let norm = light_norm(light);
        // A norm within the limit says so of every coefficient; what is not finite has an infinite norm.
        if light.len() != self.bands().columns() || norm > MAX_COEFFICIENT {
            self.approximation.check(light)?;
        }
        let norms = ROOM * (norm + self.applied());
        let grid = match self.grid {
            Some(grid) if grid.holds(norms) && norms * REFINE >= grid.limit => grid,
            Some(grid) if grid.holds(norms) => {
                let finer = Grid::for_light(norms, self.span, HEADROOM)?;
                if finer.exponent < grid.exponent { finer } else { grid }
            }
            _ => {
                let grid = Grid::for_light(norms, self.span, HEADROOM)?;
                self.restart(&grid.quantise_all(self.values()))?;
                grid
            }
        };
        self.grid = Some(grid);
        grid.quantise_into(light, &mut self.target);
        Ok(())
    }

    /// Takes in V, rounded to a grid that somebody else fixes. Where what was applied does not lie on it, it is rounded;
    /// where both do not fit together, all of V is applied at once.
    pub fn receive_on(&mut self, grid: Grid, light: &[[f64; 3]]) -> Result<()> {
        self.approximation.check(light)?;
        grid.quantise_into(light, &mut self.target);
        let norm = light_norm(&self.target);
        let coarser = self.grid.is_none_or(|before| before.exponent < grid.exponent);
        self.grid = Some(grid);
        if coarser {
            self.restart(&grid.quantise_all(self.values()))?;
        }
        if !grid.holds(ROOM * (norm + light_norm(self.values()))) {
            let target = self.target.clone();
            self.restart(&target)?;
        }
        Ok(())
    }

    /// Applies `values` from black.
    fn restart(&mut self, values: &[[f64; 3]]) -> Result<()> {
        self.approximation.set_values(values)?;
        let update = whole(values);
        let merged =
            self.merged.as_mut().map(|merged| merged.follow(values).map(|_| whole(&merged.values))).transpose()?;
        for (matrix, response) in self.factors.iter().zip(&mut self.responses) {
            *response = Response::new(matrix);
            let own = if matrix.space == self.factors.space() { Some(&update) } else { merged.as_ref() };
            response.apply(matrix, own.unwrap_or(&update), None)?;
        }
        Ok(())
    }

    fn applied(&self) -> f64 {
        self.measured.as_ref().map_or(0.0, |measured| measured[0].applied)
    }

    /// Chooses what is sent of the V received.
    pub fn choose(&mut self, chosen: &Chosen) -> Result<Update> {
        match chosen {
            Chosen::Own => Ok(self.approximation.follow(&self.target)),
            Chosen::Largest => Ok(self.approximation.follow_largest(&self.target)),
            Chosen::Given { resets, columns } => Ok(self.approximation.follow_choice(&self.target, resets, columns)),
            Chosen::Whole => {
                self.approximation.set_values(&self.target)?;
                Ok(whole(&self.target))
            }
        }
    }

    /// Sends an update through all matrices. `out`, rows x 3, may be given where there is one.
    pub fn multiply(&mut self, update: &Update, mut out: Option<&mut [f32]>) -> Result<()> {
        debug_assert!(out.is_none() || self.factors.count() == 1);
        let values = self.approximation.values();
        let merged = self.merged.as_mut().map(|merged| merged.follow(values)).transpose()?;
        for (matrix, response) in self.factors.iter().zip(&mut self.responses) {
            let own = if matrix.space == self.factors.space() { update } else { merged.as_ref().unwrap_or(update) };
            response.apply(matrix, own, out.as_deref_mut())?;
        }
        Ok(())
    }

    /// What is left to apply of V as it was before it was rounded; V itself may be off by `unsure`, and by the second of
    /// them once the stage before has applied all of its own.
    pub fn measure(&mut self, light: &[[f64; 3]], unsure: Option<[BandNorms; 2]>) {
        let mut both = Measured::new(self.bands(), light, self.values()).and_settled();
        if let Some(unsure) = unsure {
            both.iter_mut().zip(&unsure).for_each(|(measured, unsure)| measured.add(unsure));
        }
        self.measured = Some(both);
        if let Some(merged) = &mut self.merged {
            let light = merged.haar.without_texels(light);
            merged.measured = Some(Measured::new(&merged.bands, &light, &merged.values).and_settled());
        }
    }

    /// For each matrix what would be measured of a light once all of it had been applied.
    pub fn settled(&self, light: &[[f64; 3]]) -> Vec<Measured> {
        let own = |bands: &Bands, light: &[[f64; 3]]| {
            let [_, settled] = Measured::new(bands, light, light).and_settled();
            settled
        };
        let of_matrix = |matrix: &Arc<TransportMatrix>| match &self.merged {
            Some(merged) if matrix.space != self.factors.space() => {
                own(&merged.bands, &merged.haar.without_texels(light))
            }
            _ => own(self.bands(), light),
        };
        self.factors.iter().map(of_matrix).collect()
    }

    /// V~ is V, bit for bit on its grid.
    pub fn is_converged(&self) -> bool {
        self.approximation.is_converged(&self.target)
    }

    /// The cost of the columns that the last update streamed through all matrices.
    pub fn streamed(&self) -> f64 {
        let costs = &self.approximation.settings().costs;
        let own = self.factors.iter().zip(&self.responses).filter(|(matrix, _)| matrix.space == self.factors.space());
        let moved = own.clone().flat_map(|(_, response)| response.moved());
        // The cost of a column is that of all matrices together.
        moved.map(|column| costs[column]).sum::<f64>() / own.count() as f64
    }

    /// Bytes beyond M: the responses, V~, and V on its grid.
    pub fn nbytes(&self) -> usize {
        let responses: usize = self.responses.iter().map(Response::nbytes).sum();
        responses + size_of_val(self.values()) + size_of_val(&self.target[..])
    }
}
