//! How much rows differ from their neighbours: where a mesh must be finer to show what falls on it.

use rayon::prelude::*;

use crate::error::{Error, Result};

use super::pass::{Advance, BUNDLE_ROWS, Pass};

/// For each pair of rows the norm of their difference, relative to the norm of all rows in the mean (root mean square); 0
/// where nothing is seen anywhere. All rows are held at once: this is for columns that are few.
pub fn contrast<P: Pass>(pass: &P, pairs: &[[u32; 2]], advance: &Advance) -> Result<Vec<f32>> {
    let (rows, columns) = (pass.shape().rows, pass.shape().bands.stored());
    if pairs.as_flattened().iter().any(|&row| row as usize >= rows) {
        return Err(Error::input(format!("expected pairs of rows below {rows}")));
    }
    let mut dense = vec![0f32; rows * columns];
    dense.par_chunks_mut(BUNDLE_ROWS * columns).enumerate().try_for_each_init(
        || pass.room(),
        |room, (bundle, out)| {
            let own = bundle * BUNDLE_ROWS..rows.min((bundle + 1) * BUNDLE_ROWS);
            let mut first = 0;
            pass.bundle(own.clone(), room, &mut |_, planes, _| {
                for (column, lanes) in planes[0].iter().enumerate() {
                    let there = lanes.iter().take(own.len() - first).enumerate();
                    there.for_each(|(lane, &value)| out[(first + lane) * columns + column] = value);
                }
                first += planes[0].first().map_or(0, |lanes| lanes.len());
                Ok(())
            })?;
            advance(own.len() as u64)
        },
    )?;
    let row = |row: u32| &dense[row as usize * columns..(row as usize + 1) * columns];
    let squares: f64 = dense.par_chunks(columns).map(square).collect::<Vec<f64>>().iter().sum();
    let whole = (squares / rows.max(1) as f64).sqrt();
    let apart = |&[a, b]: &[u32; 2]| {
        let sum: f64 = row(a).iter().zip(row(b)).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        if whole > 0.0 { (sum.sqrt() / whole) as f32 } else { 0.0 }
    };
    Ok(pairs.par_iter().map(apart).collect())
}

fn square(row: &[f32]) -> f64 {
    row.iter().map(|&x| f64::from(x) * f64::from(x)).sum()
}
