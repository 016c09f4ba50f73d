//! The whole product B = M V, for one light or for several in one pass over M.

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::transport::{Tile, TransportMatrix};

use super::grid::{Grid, Span, light_norm, power_of_two};
use super::kernel::{Engine, Lights, Move, Scratch, Sums, Target, batches};

/// Lights that go through M together. Finding and converting an entry takes as long as adding it for four lights; their
/// sums are 6 MB for each thread.
const TOGETHER: usize = 32;

/// B = M V for each of `lights` (columns x 3 each), written one after the other into `out` (lights x rows x 3).
///
/// `span` is `Span::of(matrix)`. Coefficients are rounded to the finest grid that is exact for each light
/// (`Grid::for_light`); B is rounded once.
pub fn multiply(matrix: &TransportMatrix, span: Span, lights: &[&[[f64; 3]]], out: &mut [f32]) -> Result<()> {
    let gridded = lights
        .iter()
        .map(|light| Ok(Grid::for_light(light_norm(light), span, 1)?.quantise_all(light)))
        .collect::<Result<Vec<_>>>()?;
    let gridded: Vec<&[[f64; 3]]> = gridded.iter().map(|light| &light[..]).collect();
    multiply_gridded(matrix, &gridded, Engine::Native, out)
}

/// `multiply` for coefficients that lie on a grid already, and are used as they are.
pub fn multiply_gridded(
    matrix: &TransportMatrix,
    lights: &[&[[f64; 3]]],
    engine: Engine,
    out: &mut [f32],
) -> Result<()> {
    check(matrix, lights)?;
    if out.len() != lights.len() * matrix.rows * 3 {
        return Err(Error::input(format!(
            "expected room for {} x {} x 3 values, got {}",
            lights.len(),
            matrix.rows,
            out.len()
        )));
    }
    if matrix.rows == 0 {
        return Ok(());
    }
    for (lights, out) in lights.chunks(TOGETHER).zip(out.chunks_mut(TOGETHER * matrix.rows * 3)) {
        let sent = Sent::new(matrix, lights);
        // Tile by tile, the rows of each image.
        let mut rows: Vec<Vec<Option<&mut [f32]>>> = matrix.tiles.iter().map(|_| Vec::new()).collect();
        for image in out.chunks_mut(matrix.rows * 3) {
            image.chunks_mut(matrix.tile_rows * 3).zip(&mut rows).for_each(|(part, rows)| rows.push(Some(part)));
        }
        matrix.tiles.par_iter().zip(rows).for_each_init(Scratch::default, |scratch, (tile, rows)| {
            sent.respond(engine, tile, scratch, rows);
        });
    }
    Ok(())
}

/// The exact sums of B for each of some lights, which lie on a grid: tile by tile, group by group.
pub(in crate::update) fn responses(matrix: &TransportMatrix, lights: &[&[[f64; 3]]]) -> Result<Vec<Vec<Vec<Sums>>>> {
    check(matrix, lights)?;
    let sent = Sent::new(matrix, lights);
    let of_tile = |scratch: &mut Scratch, tile: &Tile| {
        sent.respond(Engine::Native, tile, scratch, lights.iter().map(|_| None).collect())
    };
    let tiles: Vec<_> = matrix.tiles.par_iter().map_init(Scratch::default, of_tile).collect();
    let mut found: Vec<Vec<Vec<Sums>>> = lights.iter().map(|_| Vec::with_capacity(tiles.len())).collect();
    for tile in tiles {
        found.iter_mut().zip(tile).for_each(|(own, sums): (&mut Vec<Vec<Sums>>, Vec<Sums>)| own.push(sums));
    }
    Ok(found)
}

fn check(matrix: &TransportMatrix, lights: &[&[[f64; 3]]]) -> Result<()> {
    let columns = matrix.bands.columns();
    match lights.iter().find(|light| light.len() != columns) {
        Some(light) => Err(Error::input(format!("expected {columns} coefficients a light, got {}", light.len()))),
        None => Ok(()),
    }
}

/// What some lights send through M: columns that they share, and what each sends by itself.
struct Sent {
    /// Stored columns that some light needs; none where each goes by itself.
    shared: Vec<Move>,
    /// What they move by: `[move][light]`.
    changes: Vec<[f64; 3]>,
    /// Of each light its texels; and all that it needs where nothing is shared.
    own: Vec<Vec<Move>>,
}

impl Sent {
    /// Lights share their columns where there are several, and most need the same.
    fn new(matrix: &TransportMatrix, lights: &[&[[f64; 3]]]) -> Sent {
        let unit = power_of_two(matrix.quantum);
        let moved =
            |light: &[[f64; 3]], column: usize| Move { column: column as u32, change: light[column].map(|x| x * unit) };
        let needs = |light: &[[f64; 3]], column: usize| light[column] != [0.0; 3];
        let stored = matrix.bands.stored();
        let needed: Vec<usize> =
            (0..stored).filter(|&column| lights.iter().any(|light| needs(light, column))).collect();
        let all: usize = lights.iter().map(|light| needed.iter().filter(|&&column| needs(light, column)).count()).sum();
        let share = lights.len() > 1 && 2 * all > lights.len() * needed.len();

        let first = if share { stored } else { 0 };
        let own = |light: &&[[f64; 3]]| {
            (first..light.len()).filter(|&column| needs(light, column)).map(|column| moved(light, column)).collect()
        };
        let shared: Vec<Move> = needed.iter().filter(|_| share).map(|&column| moved(lights[0], column)).collect();
        let of =
            |moves: &Move| lights.iter().map(|light| moved(light, moves.column as usize).change).collect::<Vec<_>>();
        Sent { changes: shared.iter().flat_map(of).collect(), own: lights.iter().map(own).collect(), shared }
    }

    /// The exact sums of a tile for each light; rows that are given are written, rounded once.
    fn respond(
        &self,
        engine: Engine,
        tile: &Tile,
        scratch: &mut Scratch,
        rows: Vec<Option<&mut [f32]>>,
    ) -> Vec<Vec<Sums>> {
        let mut sums = vec![vec![Sums::ZERO; tile.groups()]; self.own.len()];
        if !self.shared.is_empty() {
            let lights = Lights { moves: &self.shared, changes: &self.changes, sums: &mut sums };
            engine.walk_together(tile, scratch, lights);
        }
        for ((moves, sums), mut rows) in self.own.iter().zip(&mut sums).zip(rows) {
            for batch in batches(tile, moves) {
                let out = rows.take_if(|_| batch.moves.end == moves.len());
                engine.walk(tile, &batch, moves, scratch, Target { sums, afresh: false, out });
            }
        }
        sums
    }
}
