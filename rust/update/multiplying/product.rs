//! The whole product B = M V, for one light or for several in one pass over M.

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::transport::{Tile, TransportMatrix};

use super::grid::{Grid, Span, light_norm, power_of_two};
use super::kernel::{Engine, Move, Scratch, Sums, Target, batches};

/// Lights whose sums of a tile are held at once: they share the cache.
const TOGETHER: usize = 4;

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
    let columns = matrix.bands.columns();
    if let Some(light) = lights.iter().find(|light| light.len() != columns) {
        return Err(Error::input(format!("expected {columns} coefficients a light, got {}", light.len())));
    }
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
        let moves = moves(matrix, lights);
        // Tile by tile, the rows of each image.
        let mut rows: Vec<Vec<&mut [f32]>> = matrix.tiles.iter().map(|_| Vec::new()).collect();
        for image in out.chunks_mut(matrix.rows * 3) {
            image.chunks_mut(matrix.tile_rows * 3).zip(&mut rows).for_each(|(part, rows)| rows.push(part));
        }
        matrix.tiles.par_iter().zip(rows).for_each_init(Scratch::default, |scratch, (tile, rows)| {
            multiply_tile(engine, tile, &moves, scratch, rows);
        });
    }
    Ok(())
}

/// The changes of each light, for the columns that some light needs: the same for all, so that batches are the same.
fn moves(matrix: &TransportMatrix, lights: &[&[[f64; 3]]]) -> Vec<Vec<Move>> {
    let unit = power_of_two(matrix.quantum);
    let needed = |column: &usize| lights.iter().any(|light| light[*column] != [0.0; 3]);
    let columns: Vec<usize> = (0..matrix.bands.columns()).filter(needed).collect();
    let moved =
        |light: &[[f64; 3]], column: usize| Move { column: column as u32, change: light[column].map(|x| x * unit) };
    lights.iter().map(|light| columns.iter().map(|&column| moved(light, column)).collect()).collect()
}

/// All lights' products with a tile: batch by batch of columns, so that each is read from memory once.
fn multiply_tile(engine: Engine, tile: &Tile, moves: &[Vec<Move>], scratch: &mut Scratch, rows: Vec<&mut [f32]>) {
    let mut rows: Vec<Option<&mut [f32]>> = rows.into_iter().map(Some).collect();
    let mut sums = vec![vec![Sums::ZERO; tile.groups()]; moves.len()];
    for batch in batches(tile, &moves[0]) {
        let last = batch.moves.end == moves[0].len();
        for ((moves, sums), rows) in moves.iter().zip(&mut sums).zip(&mut rows) {
            let out = rows.take_if(|_| last);
            engine.walk(tile, &batch, moves, scratch, Target { sums, afresh: false, out });
        }
    }
}
