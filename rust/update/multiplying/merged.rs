//! Light in wavelets and texels, put together in wavelets alone: what nodes follow, whose rows are no bits.
//!
//! It is a function of what has been applied, and rounded to a grid that is too: whoever follows it, with any history, is
//! where a fresh product would be.

use crate::basis::haar::Haar;
use crate::error::Result;

use super::grid::{Grid, Span, light_norm};

/// What is applied, `values`, put together; and the grid that it lies on.
pub(in crate::update) fn merged(haar: &Haar, values: &[[f64; 3]], span: Span) -> Result<(Grid, Vec<[f64; 3]>)> {
    let grid = Grid::for_merged(light_norm(values), span)?;
    Ok((grid, grid.quantise_all(&haar.without_texels(values))))
}
