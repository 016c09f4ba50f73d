//! The response B = M V~ to the coefficients applied so far, and how an update changes it.
//!
//! The state is the f64 sums of all rows, exact because coefficients lie on a grid (`update/grid.rs`), and V~ itself.
//! PBI as published keeps an image of every band, so that a band can be reset (Overbeck 2006, section 4). Exactness
//! makes these images unnecessary: what a band's columns have put in is taken out again, term by term, and nothing
//! stays behind. A reset then costs no more than what its band has taken in since it was last reset, and
//! nothing where all that has been applied is reset; images cost every frame a read and a write of whole pictures
//! (measured: 0.7 of 2.3 ms), and three times the memory.

use rayon::prelude::*;

use crate::basis::Bands;
use crate::error::{Error, Result};
use crate::transport::TransportMatrix;

use super::grid::power_of_two;
use super::kernel::{Engine, Move, Scratch, Sums, Target, batches};
use crate::update::change::{Term, Update};

/// B for one follower of the light.
pub struct Response {
    engine: Engine,
    /// V~: what has been applied.
    values: Vec<[f64; 3]>,
    /// Whether a column has an entry in any tile: the finest of a truncated transport often have none.
    stored: Vec<bool>,
    /// Whether a band of V~ may hold anything. INVARIANT: true wherever one does.
    held: Vec<bool>,
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
        let columns = matrix.bands.columns();
        let stored = |column: usize| matrix.tiles.iter().any(|tile| tile.starts[column] < tile.starts[column + 1]);
        Response {
            engine,
            values: vec![[0.0; 3]; columns],
            stored: (0..columns).map(stored).collect(),
            held: vec![false; matrix.bands.count()],
            moves: Vec::new(),
            tiles,
        }
    }

    /// V~: the coefficients applied so far.
    pub fn values(&self) -> &[[f64; 3]] {
        &self.values
    }

    /// The columns that the last update streamed.
    pub fn moved(&self) -> impl Iterator<Item = usize> {
        self.moves.iter().map(|moved| moved.column as usize)
    }

    /// The exact sums, tile by tile, group by group.
    pub fn sums(&self) -> impl Iterator<Item = &Sums> {
        self.tiles.iter().flatten()
    }

    /// Bytes beyond M.
    pub fn nbytes(&self) -> usize {
        let sums: usize = self.tiles.iter().map(|sums| size_of_val(&sums[..])).sum();
        sums + size_of_val(&self.values[..]) + self.stored.len()
    }

    /// Applies an update and writes B, rounded once, as rows x 3.
    ///
    /// The coefficients before and after must lie on one `Grid` that `holds` the sum of their norms.
    pub fn apply(&mut self, matrix: &TransportMatrix, update: &Update, out: &mut [f32]) -> Result<()> {
        if out.len() != 3 * matrix.rows || self.tiles.len() != matrix.tiles.len() {
            return Err(Error::input(format!(
                "expected an image of 3 x {} values and the response's own transport, got {} values",
                matrix.rows,
                out.len()
            )));
        }
        check(update, &matrix.bands)?;
        let kept = |band: usize| self.held[band] && update.resets.binary_search(&band).is_err();
        let afresh = !(0..matrix.bands.count()).any(kept);
        self.advance(matrix, update, afresh);
        let (engine, moves) = (self.engine, &self.moves);
        matrix
            .tiles
            .par_iter()
            .zip(&mut self.tiles)
            .zip(out.par_chunks_mut(3 * matrix.tile_rows.max(1)))
            .for_each_init(Scratch::default, |scratch, ((tile, sums), out)| {
                let mut out = Some(out);
                for batch in batches(tile, moves) {
                    let out = out.take_if(|_| batch.moves.end == moves.len());
                    let afresh = afresh && batch.moves.start == 0;
                    engine.walk(tile, &batch, moves, scratch, Target { sums, afresh, out });
                }
            });
        Ok(())
    }

    /// Takes V~ to what it is after the update, and lists the columns that change, and by how much.
    ///
    /// Where all that is held is reset the sums start afresh; otherwise a reset column changes by its new value less its
    /// old.
    fn advance(&mut self, matrix: &TransportMatrix, update: &Update, afresh: bool) {
        let unit = power_of_two(matrix.quantum);
        self.moves.clear();
        let mut push = |column: usize, change: [f64; 3]| {
            if self.stored[column] && change != [0.0; 3] {
                self.moves.push(Move { column: column as u32, change: change.map(|x| x * unit) });
            }
        };
        let mut terms = &update.terms[..];
        for band in 0..matrix.bands.count() {
            let columns = matrix.bands.range(band);
            let (mine, rest) = terms.split_at(terms.partition_point(|term| (term.column as usize) < columns.end));
            terms = rest;
            let reset = update.resets.binary_search(&band).is_ok();
            self.held[band] = (self.held[band] && !reset) || !mine.is_empty();
            if !reset {
                for Term { column, change } in mine {
                    let value = &mut self.values[*column as usize];
                    *value = std::array::from_fn(|colour| value[colour] + change[colour]);
                    push(*column as usize, *change);
                }
                continue;
            }
            let mut mine = mine.iter().peekable();
            for column in columns {
                let term = mine.next_if(|term| term.column as usize == column);
                let new = term.map_or([0.0; 3], |term| term.change);
                let old = if afresh { [0.0; 3] } else { self.values[column] };
                self.values[column] = new;
                push(column, std::array::from_fn(|colour| new[colour] - old[colour]));
            }
        }
    }
}

/// An update must name bands and columns that exist, ascending.
fn check(update: &Update, bands: &Bands) -> Result<()> {
    let ascending = update.terms.is_sorted_by(|a, b| a.column < b.column) && update.resets.is_sorted_by(|a, b| a < b);
    let column = update.terms.last().map_or(0, |term| term.column as usize);
    let band = update.resets.last().copied().unwrap_or(0);
    if ascending && column < bands.columns() && band < bands.count() {
        return Ok(());
    }
    Err(Error::input(format!(
        "expected ascending terms below column {} and ascending resets below band {}, got up to column {column} and \
         band {band}",
        bands.columns(),
        bands.count()
    )))
}
