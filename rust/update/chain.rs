//! A product with what exact sums through it need; and the whole of B = M V, one stage after the other.
//!
//! The second stage's V is the exact response of the first, rounded to a grid that depends on nothing but the V applied to
//! the first (`Grid::for_second`): a fresh product and a follower with any history behind it round alike, so that both
//! reach the same bits once the follower has sent everything.

use rayon::prelude::*;

use crate::basis::HaarTree;
use crate::basis::haar::Haar;
use crate::error::{Error, Result};
use crate::transport::{Factors, GROUP, Link, Product, TransportMatrix};

use super::change::whole;
use super::multiplying::bound::{BandNorms, Bound};
use super::multiplying::clustered::Clustered;
use super::multiplying::finish::{Mix, Node, Rounded, add_nodes, write};
use super::multiplying::grid::{Grid, Span, above, light_norm};
use super::multiplying::kernel::Sums;
use super::multiplying::merged::merged;
use super::multiplying::product::multiply;
use super::multiplying::response::Response;

/// Relative error of the f64 sums between two stages: far more than twenty levels of a tree can make.
const BETWEEN: f64 = 1.0 / (1u64 << 45) as f64;

/// One or two stages, ready to be multiplied by. Nothing in it changes: any number of followers share one.
pub struct Chain {
    /// The matrices, and what links them.
    pub product: Product,
    /// Of the first stage's matrices, the largest.
    pub span: Span,
    /// Of the second stage's.
    pub then_span: Span,
    /// The norm of the second stage's V is at most this times that of the first's; 0 where there is one stage.
    gain: f64,
    /// Of clustered transport, for each pair of matrices: what is known of both together. Empty where the link is another.
    pub(super) clustered: Vec<Clustered>,
}

impl Chain {
    /// Looks once through the norms of all rows, in parallel.
    pub fn new(product: Product) -> Self {
        let span = |factors: &Factors| factors.iter().map(|matrix| Span::of(matrix)).max().unwrap_or(Span(0));
        let gain = product.then.as_ref().map_or(0.0, |then| {
            let joins = f64::from(u8::from(then.space() == product.first.space()));
            product.first.iter().map(|matrix| gain(matrix, &product.link)).fold(0.0, f64::max) + joins
        });
        let clustered = match (&product.link, &product.then) {
            (Link::Representatives(norms), Some(then)) => {
                then.iter().zip(norms.iter()).map(|(then, norms)| Clustered::new(then, norms)).collect()
            }
            _ => Vec::new(),
        };
        let then_span = product.then.as_ref().map_or(Span(0), span);
        Chain { span: span(&product.first), then_span, gain, clustered, product }
    }

    /// B for each of `lights` (columns x 3 each), one after the other into `out` (lights x rows x 3).
    pub fn multiply(&self, lights: &[&[[f64; 3]]], mix: Option<&Mix>, out: &mut [f32]) -> Result<()> {
        check_mix(&self.product, mix)?;
        if let (Some(matrix), None) = (self.product.alone(), mix) {
            return multiply(matrix, self.span, lights, out);
        }
        self.multiply_each(lights, mix, out)
    }

    /// `multiply` in 64 bits: of one matrix the exact sums themselves.
    pub fn multiply_double(&self, lights: &[&[[f64; 3]]], mix: Option<&Mix>, out: &mut [f64]) -> Result<()> {
        check_mix(&self.product, mix)?;
        self.multiply_each(lights, mix, out)
    }

    fn multiply_each<T: Rounded>(&self, lights: &[&[[f64; 3]]], mix: Option<&Mix>, out: &mut [T]) -> Result<()> {
        let rows = self.product.rows();
        if out.len() != lights.len() * rows * 3 {
            let (count, found) = (lights.len(), out.len());
            return Err(Error::input(format!("expected room for {count} x {rows} x 3 values, got {found}")));
        }
        lights.iter().zip(out.chunks_mut(3 * rows)).try_for_each(|(light, out)| self.multiply_one(light, mix, out))
    }

    fn multiply_one<T: Rounded>(&self, light: &[[f64; 3]], mix: Option<&Mix>, out: &mut [T]) -> Result<()> {
        let columns = self.product.first.space().columns();
        if light.len() != columns {
            return Err(Error::input(format!("expected {columns} coefficients a light, got {}", light.len())));
        }
        let v = Grid::for_light(light_norm(light), self.span, 1)?.quantise_all(light);
        let first = respond(&self.product.first, &v, self.span)?;
        match &self.product.then {
            None => self.finish(&first.iter().collect::<Vec<_>>(), mix, out),
            Some(then) => {
                let grid = self.second_grid(&v)?;
                let second = match &self.product.link {
                    Link::Representatives(_) => {
                        let pairs = first.iter().zip(then.iter()).map(|(response, matrix)| {
                            let v = grid.quantise_all(&self.second_light(response, 0, &v));
                            respond_one(matrix, &v)
                        });
                        pairs.collect::<Result<Vec<_>>>()?
                    }
                    _ => respond(then, &grid.quantise_all(&self.second_light(&first[0], 0, &v)), self.then_span)?,
                };
                self.finish(&second.iter().collect::<Vec<_>>(), mix, out);
            }
        }
        Ok(())
    }

    /// The grid of the second stage for what is applied to the first.
    pub fn second_grid(&self, applied: &[[f64; 3]]) -> Result<Grid> {
        Grid::for_second(light_norm(applied), self.gain, self.then_span)
    }

    /// The V of the second stage, before it is rounded: from the exact response of the `factor`-th first matrix to `v`.
    pub fn second_light(&self, response: &Response, factor: usize, v: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let matrix = self.product.first.as_slice()[factor].as_ref();
        let rows = sums_of_rows(matrix, response);
        let Link::Tree(tree) = &self.product.link else { return rows };
        let mut light = tree.forward(&rows);
        if matrix.space == tree.space() {
            light.iter_mut().zip(v).for_each(|(sum, direct)| (0..3).for_each(|c| sum[c] += direct[c]));
        }
        light
    }

    /// How far the V of the second stage, over a tree, may be from that of the untruncated first stage, where its rows may be
    /// off by `rows`.
    pub fn unsure(&self, rows: &[[f64; 3]], light: &[[f64; 3]]) -> BandNorms {
        let then = self.product.then.as_ref().expect("there is a second stage");
        let weighted = rows.iter().zip(row_weights(&self.product.link, rows.len()));
        let squares = weighted.fold([0.0; 3], |sums: [f64; 3], (row, weight)| {
            std::array::from_fn(|c| sums[c] + row[c] * row[c] * weight)
        });
        // An orthonormal transform keeps norms, but not their place.
        let rounding = BETWEEN * light_norm(light);
        vec![squares.map(|square| above(square.sqrt()) + rounding); then.first().bands.count()]
    }

    /// From the responses of the last stage to B: mixed, or with what nodes add.
    pub fn finish<T: Rounded>(&self, responses: &[&Response], mix: Option<&Mix>, out: &mut [T]) {
        let matrix = self.product.outputs().first();
        match (&self.product.link, mix) {
            (Link::Weights(weights), _) => {
                let nodes = Node { response: responses[1], tile_rows: self.product.first.as_slice()[1].tile_rows };
                add_nodes(matrix, responses[0], weights, nodes, out);
            }
            (_, Some(mix)) => mix.write(matrix, responses, out),
            (_, None) => write(matrix, responses[0], out),
        }
    }

    /// For each band of the first stage a factor: B is off by no more than the sum over bands of factor * |what is unsent
    /// in the band|, on its account.
    pub fn error_factors(&self, mix: Option<&Mix>) -> Vec<f64> {
        let largest = |matrix: &TransportMatrix| Bound::new(matrix).largest_rows();
        let mut first: Vec<Vec<f64>> = self.product.first.iter().map(|matrix| largest(matrix)).collect();
        // What is unsent of texels may be in any band of those that have none.
        for (bands, matrix) in first.iter_mut().zip(self.product.first.iter()) {
            if matrix.space != self.product.first.space() {
                bands.push(above(bands.iter().map(|norm| norm * norm).sum::<f64>().sqrt()));
            }
        }
        let weighted = |factor: usize| mix.map_or(1.0, |mix| mix.largest()[factor]);
        let total = |of: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
            (0..first[0].len()).map(|band| (0..first.len()).map(|k| of(k, band)).sum()).collect()
        };
        match (&self.product.link, &self.product.then) {
            (Link::Weights(weights), _) => {
                let most = [1.0, weights.largest_sum()];
                total(&|k, band| most[k] * first[k][band])
            }
            (_, None) => total(&|k, band| weighted(k) * first[k][band]),
            (Link::Representatives(_), _) => {
                let rows: Vec<Vec<f64>> = self.clustered.iter().map(Clustered::largest_rows).collect();
                total(&|k, band| above(weighted(k) * rows[k][band]))
            }
            (link, Some(then)) => {
                // A row of the second stage times the norm of what the band makes of all rows of the first.
                let rows: Vec<f64> =
                    then.iter().map(|m| largest(m).iter().map(|x| x * x).sum::<f64>().sqrt()).collect();
                let of_band: Vec<Vec<f64>> = self.product.first.iter().map(|m| band_gains(m, link)).collect();
                let joins = f64::from(u8::from(then.space() == self.product.first.space()));
                let rows: f64 = rows.iter().enumerate().map(|(k, row)| weighted(k) * row).sum();
                total(&|k, band| above(rows * (of_band[k][band] + joins)))
            }
        }
    }
}

/// Refuses a mix that is not one of the product's.
pub fn check_mix(product: &Product, mix: Option<&Mix>) -> Result<()> {
    let (factors, rows) = (product.factors(), product.rows());
    match mix {
        None if factors == 1 => Ok(()),
        Some(mix) if !matches!(product.link, Link::Weights(_)) && mix.shape() == (rows, factors) => Ok(()),
        None => {
            Err(Error::input(format!("expected a mix of shape ({rows}, {factors}) for {factors} factors, got none")))
        }
        Some(mix) => Err(Error::input(format!("expected a mix of shape ({rows}, {factors}), got {:?}", mix.shape()))),
    }
}

/// The exact responses of all factors to one V, which lies on a grid.
fn respond(factors: &Factors, v: &[[f64; 3]], span: Span) -> Result<Vec<Response>> {
    let wavelets = match factors.merged() {
        Some(size) => Some(merged(Haar::shared(size)?, v, span)?.1),
        None => None,
    };
    let own = |matrix: &TransportMatrix| match &wavelets {
        Some(wavelets) if matrix.space != factors.space() => wavelets.as_slice(),
        _ => v,
    };
    factors.iter().map(|matrix| respond_one(matrix, own(matrix))).collect()
}

fn respond_one(matrix: &TransportMatrix, v: &[[f64; 3]]) -> Result<Response> {
    let mut response = Response::new(matrix);
    response.apply(matrix, &whole(v), None)?;
    Ok(response)
}

/// The exact sums, row by row.
fn sums_of_rows(matrix: &TransportMatrix, response: &Response) -> Vec<[f64; 3]> {
    // Group by group, into rows that are there.
    let mut rows = vec![[0.0; 3]; matrix.rows];
    rows.par_chunks_mut(matrix.tile_rows.max(1)).zip(response.tiles()).for_each(|(rows, sums)| {
        for (rows, Sums([red, green, blue])) in rows.chunks_mut(GROUP).zip(sums) {
            rows.iter_mut().enumerate().for_each(|(lane, row)| *row = [red[lane], green[lane], blue[lane]]);
        }
    });
    rows
}

/// What each row counts for in the norm of the second stage's V.
fn row_weights<'a>(link: &'a Link, rows: usize) -> Box<dyn Iterator<Item = f64> + 'a> {
    match link {
        Link::Tree(tree) => Box::new(HaarTree::areas(tree).iter().copied()),
        _ => Box::new(std::iter::repeat_n(1.0, rows)),
    }
}

/// The norm of all rows together, in the channel where it is largest.
fn gain(matrix: &TransportMatrix, link: &Link) -> f64 {
    let channels = matrix.channels.count();
    let mut sums = vec![0.0; channels];
    let squares = matrix.tiles.iter().flat_map(|tile| matrix.row_squares(tile)).collect::<Vec<_>>();
    for (row, weight) in squares.chunks(channels).zip(row_weights(link, matrix.rows)) {
        sums.iter_mut().zip(row).for_each(|(sum, square)| *sum += square * weight);
    }
    above(sums.into_iter().fold(0.0, f64::max).sqrt())
}

/// The same, band by band.
fn band_gains(matrix: &TransportMatrix, link: &Link) -> Vec<f64> {
    let (bands, channels) = (matrix.bands.count(), matrix.channels.count());
    let mut sums = vec![0.0; bands * channels];
    let rows = matrix.tiles.iter().flat_map(|tile| tile.kept.chunks_exact(bands * channels));
    for (norms, weight) in rows.zip(row_weights(link, matrix.rows)) {
        let squares = norms.iter().map(|&bits| f64::from(crate::transport::bf16(bits)).powi(2));
        sums.iter_mut().zip(squares).for_each(|(sum, square): (&mut f64, f64)| *sum += square * weight);
    }
    sums.chunks(channels).map(|own| above(own.iter().copied().fold(0.0, f64::max).sqrt())).collect()
}
