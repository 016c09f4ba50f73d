//! The response B = M V~ to the coefficients applied so far, and how an update changes it.
//!
//! The state is the f64 sums of all rows, exact because coefficients lie on a grid (`grid.rs`), and nothing else.
//! PBI as published keeps an image of every band, so that a band can be reset (Overbeck 2006, section 4). Exactness
//! makes these images unnecessary: what a band's columns have put in is taken out again, term by term, and nothing
//! stays behind. A reset then costs no more than what its band has taken in since it was last reset, and
//! nothing where all that has been applied is reset; images cost every frame a read and a write of whole pictures
//! (measured: 0.7 of 2.3 ms), and three times the memory.

use rayon::prelude::*;

use crate::basis::Bands;
use crate::error::{Error, Result};
use crate::transport::{Tile, TransportMatrix};

use super::grid::power_of_two;
use super::kernel::{Engine, Move, Scratch, Sums, Target, batches};
use crate::update::change::Update;

/// B of one matrix for one follower of V.
pub struct Response {
    engine: Engine,
    /// Whether a column has an entry in any tile: the finest of a truncated transport often have none.
    stored: Vec<bool>,
    /// What the last update moved.
    moves: Vec<Move>,
    /// The sums of each tile's groups.
    tiles: Vec<Vec<Sums>>,
}

impl Response {
    /// The response to V = 0.
    pub fn new(matrix: &TransportMatrix) -> Response {
        Response::with_engine(matrix, Engine::Native)
    }

    /// `new`, with the kernel named: for tests and benchmarks.
    pub fn with_engine(matrix: &TransportMatrix, engine: Engine) -> Response {
        let tiles = matrix.tiles.iter().map(|tile| vec![Sums::ZERO; tile.groups()]).collect();
        let texel = |column: usize| column >= matrix.bands.stored();
        let stored = |column: usize| texel(column) || matrix.tiles.iter().any(|tile| !tile.entries(column).is_empty());
        Response { engine, stored: (0..matrix.bands.columns()).map(stored).collect(), moves: Vec::new(), tiles }
    }

    /// The columns that the last update streamed.
    pub fn moved(&self) -> impl Iterator<Item = usize> {
        self.moves.iter().map(|moved| moved.column as usize)
    }

    /// The exact sums, tile by tile, group by group.
    pub fn tiles(&self) -> &[Vec<Sums>] {
        &self.tiles
    }

    /// Bytes beyond M.
    pub fn nbytes(&self) -> usize {
        let sums: usize = self.tiles.iter().map(|sums| size_of_val(&sums[..])).sum();
        sums + self.stored.len()
    }

    /// Applies an update; where `out` is given, writes B, rounded once, as rows x 3.
    ///
    /// The coefficients before and after must lie on one `Grid` that `holds` the sum of their norms.
    pub fn apply(&mut self, matrix: &TransportMatrix, update: &Update, out: Option<&mut [f32]>) -> Result<()> {
        if self.tiles.len() != matrix.tiles.len() || out.as_ref().is_some_and(|out| out.len() != 3 * matrix.rows) {
            return Err(Error::input(format!(
                "expected an image of 3 x {} values and the response's own transport, got {} values",
                matrix.rows,
                out.map_or(0, |out| out.len())
            )));
        }
        check(update, &matrix.bands)?;
        let unit = power_of_two(matrix.quantum);
        self.moves.clear();
        let streamed = update.moves.iter().filter(|term| self.stored[term.column as usize] && term.change != [0.0; 3]);
        self.moves.extend(streamed.map(|term| Move { column: term.column, change: term.change.map(|x| x * unit) }));

        let (engine, moves, afresh) = (self.engine, &self.moves, update.afresh);
        let walk = |scratch: &mut Scratch, tile: &Tile, sums: &mut [Sums], mut out: Option<&mut [f32]>| {
            for batch in batches(tile, moves) {
                let out = out.take_if(|_| batch.moves.end == moves.len());
                let afresh = afresh && batch.moves.start == 0;
                engine.walk(tile, &batch, moves, scratch, Target { sums, afresh, out });
            }
        };
        let tiles = matrix.tiles.par_iter().zip(&mut self.tiles);
        match out {
            Some(out) => tiles
                .zip(out.par_chunks_mut(3 * matrix.tile_rows.max(1)))
                .for_each_init(Scratch::default, |scratch, ((tile, sums), out)| walk(scratch, tile, sums, Some(out))),
            None => tiles.for_each_init(Scratch::default, |scratch, (tile, sums)| walk(scratch, tile, sums, None)),
        }
        Ok(())
    }
}

/// An update must name bands and columns that exist, ascending.
fn check(update: &Update, bands: &Bands) -> Result<()> {
    let ascending = update.moves.is_sorted_by(|a, b| a.column < b.column) && update.resets.is_sorted_by(|a, b| a < b);
    let column = update.moves.last().map_or(0, |term| term.column as usize);
    let band = update.resets.last().copied().unwrap_or(0);
    if ascending && column < bands.columns() && band < bands.count() {
        return Ok(());
    }
    Err(Error::input(format!(
        "expected ascending moves below column {} and ascending resets below band {}, got up to column {column} and \
         band {band}",
        bands.columns(),
        bands.count()
    )))
}
