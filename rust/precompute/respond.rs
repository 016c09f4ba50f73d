//! The response of rows as they are made, to one V: no row is stored, and nothing is truncated.

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::transport::GROUP;

use super::pass::{Advance, BUNDLE_ROWS, Pass};

/// B = M V of the first factor, (rows, 3); each sum runs over the columns in order, whatever the number of threads.
pub fn respond<P: Pass>(pass: &P, v: &[[f64; 3]], advance: &Advance) -> Result<Vec<[f32; 3]>> {
    let shape = pass.shape();
    let columns = shape.bands.stored();
    if v.len() != columns {
        return Err(Error::input(format!("expected {columns} coefficients, got {}", v.len())));
    }
    let mut response = vec![[0f32; 3]; shape.rows];
    response.par_chunks_mut(BUNDLE_ROWS).enumerate().try_for_each_init(
        || pass.room(),
        |room, (bundle, out)| {
            let start = bundle * BUNDLE_ROWS;
            let mut groups = out.chunks_mut(GROUP);
            pass.bundle(start..start + BUNDLE_ROWS.min(shape.rows - start), room, &mut |factor, planes, _| {
                let Some(out) = (if factor == 0 { groups.next() } else { None }) else { return Ok(()) };
                for colour in 0..3 {
                    let mut sums = [0f64; GROUP];
                    for (lanes, coefficient) in planes[shape.channels.of(colour)].iter().zip(v) {
                        sums.iter_mut().zip(lanes).for_each(|(sum, &x)| *sum += f64::from(x) * coefficient[colour]);
                    }
                    out.iter_mut().zip(sums).for_each(|(out, sum)| out[colour] = sum as f32);
                }
                Ok(())
            })?;
            advance(BUNDLE_ROWS.min(shape.rows - start) as u64)
        },
    )?;
    Ok(response)
}
