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

use super::multiplying::bound::{BandNorms, Bound, Measured, ROUNDING, largest_of_all};
use super::multiplying::clustered::Clustered;
use super::multiplying::finish::{Mix, Node, Rounded, Tiles, add_nodes, write};
use super::multiplying::grid::{Grid, Span, above, light_norm};
use super::multiplying::kernel::Sums;
use super::multiplying::merged::merged;
use super::multiplying::product::{multiply, responses};

/// Relative error of the f64 sums between two stages: far more than twenty levels of a tree can make.
const BETWEEN: f64 = 1.0 / (1u64 << 45) as f64;

/// Lights whose exact sums are held at once where something follows from them: 24 bytes a row and light.
const TOGETHER: usize = 8;

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
        let mut several = lights.chunks(TOGETHER).zip(out.chunks_mut(3 * rows * TOGETHER));
        several.try_for_each(|(lights, out)| self.multiply_together(lights, mix, out))
    }

    /// Lights share the first stage; what comes after it is each one's own.
    fn multiply_together<T: Rounded>(&self, lights: &[&[[f64; 3]]], mix: Option<&Mix>, out: &mut [T]) -> Result<()> {
        lights.iter().try_for_each(|light| self.check_light(light))?;
        let gridded = |light: &&[[f64; 3]]| Ok(Grid::for_light(light_norm(light), self.span, 1)?.quantise_all(light));
        let lights = lights.iter().map(gridded).collect::<Result<Vec<_>>>()?;
        let first = respond(&self.product.first, &lights, self.span)?;
        for (k, (v, out)) in lights.iter().zip(out.chunks_mut(3 * self.product.rows())).enumerate() {
            let first: Vec<&Tiles> = first.iter().map(|of_factor| &of_factor[k][..]).collect();
            self.follow(v, &first, mix, out)?;
        }
        Ok(())
    }

    /// From the first stage's exact responses to the light `v` to B.
    fn follow<T: Rounded>(&self, v: &[[f64; 3]], first: &[&Tiles], mix: Option<&Mix>, out: &mut [T]) -> Result<()> {
        let Some(then) = &self.product.then else {
            self.finish(first, mix, out);
            return Ok(());
        };
        let grid = self.second_grid(v)?;
        let second = match &self.product.link {
            Link::Representatives(_) => {
                let pairs = first.iter().zip(then.iter()).map(|(response, matrix)| {
                    let v = grid.quantise_all(&self.second_light(response, 0, v));
                    responses(matrix, &[&v])
                });
                pairs.collect::<Result<Vec<_>>>()?
            }
            _ => respond(then, &[grid.quantise_all(&self.second_light(first[0], 0, v))], self.then_span)?,
        };
        self.finish(&second.iter().map(|of_factor| &of_factor[0][..]).collect::<Vec<_>>(), mix, out);
        Ok(())
    }

    /// For each light what no receiver's red, green and blue of its whole product are off by, against untruncated
    /// transport: truncation and rounding; infinite where B may be beyond what an f32 holds. Of one stage that nothing is
    /// mixed in.
    pub fn bounds(&self, lights: &[&[[f64; 3]]]) -> Result<Vec<[f64; 3]>> {
        if self.product.then.is_some() || self.product.factors() != 1 {
            return Err(Error::input(
                "expected a transport of one stage for bounds of whole products; steps have their own",
            ));
        }
        let first = &self.product.first;
        let bounds: Vec<Bound> = first.iter().map(|matrix| Bound::new(matrix)).collect();
        let haar = first.merged().map(Haar::shared).transpose()?;
        let of_light = |light: &&[[f64; 3]]| {
            self.check_light(light)?;
            let v = Grid::for_light(light_norm(light), self.span, 1)?.quantise_all(light);
            let measured = |matrix: &TransportMatrix| match haar {
                Some(haar) if matrix.space != first.space() => {
                    let (_, merged) = merged(haar, &v, self.span)?;
                    Ok(Measured::new(&matrix.bands, &haar.without_texels(light), &merged))
                }
                _ => Ok(Measured::new(&matrix.bands, light, &v)),
            };
            let weights = match &self.product.link {
                Link::Weights(weights) => vec![1.0, weights.largest_sum()],
                _ => vec![1.0],
            };
            let each = first.iter().zip(&bounds).map(|(matrix, bound)| Ok(bound.largest(&measured(matrix)?)));
            let all = largest_of_all(each.collect::<Result<Vec<_>>>()?.into_iter().zip(weights));
            Ok(all.map(|bound| if bound < ROUNDING * f64::from(f32::MAX) { bound } else { f64::INFINITY }))
        };
        lights.iter().map(of_light).collect()
    }

    /// Refuses light of the wrong length.
    fn check_light(&self, light: &[[f64; 3]]) -> Result<()> {
        let columns = self.product.first.space().columns();
        if light.len() == columns {
            return Ok(());
        }
        Err(Error::input(format!("expected {columns} coefficients a light, got {}", light.len())))
    }

    /// The grid of the second stage for what is applied to the first.
    pub fn second_grid(&self, applied: &[[f64; 3]]) -> Result<Grid> {
        Grid::for_second(light_norm(applied), self.gain, self.then_span)
    }

    /// The V of the second stage, before it is rounded: from the exact response of the `factor`-th first matrix to `v`.
    pub(in crate::update) fn second_light(&self, response: &Tiles, factor: usize, v: &[[f64; 3]]) -> Vec<[f64; 3]> {
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
    pub(in crate::update) fn finish<T: Rounded>(&self, responses: &[&Tiles], mix: Option<&Mix>, out: &mut [T]) {
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

/// The exact responses of all factors to some V, which lie on a grid: `[factor][light]`.
fn respond(factors: &Factors, lights: &[Vec<[f64; 3]>], span: Span) -> Result<Vec<Vec<Vec<Vec<Sums>>>>> {
    let wavelets = match factors.merged() {
        Some(size) => {
            let haar = Haar::shared(size)?;
            Some(lights.iter().map(|v| Ok(merged(haar, v, span)?.1)).collect::<Result<Vec<_>>>()?)
        }
        None => None,
    };
    let own = |matrix: &TransportMatrix| match &wavelets {
        Some(wavelets) if matrix.space != factors.space() => wavelets.as_slice(),
        _ => lights,
    };
    let of =
        |matrix: &TransportMatrix| responses(matrix, &own(matrix).iter().map(|light| &light[..]).collect::<Vec<_>>());
    factors.iter().map(|matrix| of(matrix)).collect()
}

/// The exact sums, row by row.
fn sums_of_rows(matrix: &TransportMatrix, response: &Tiles) -> Vec<[f64; 3]> {
    // Group by group, into rows that are there.
    let mut rows = vec![[0.0; 3]; matrix.rows];
    rows.par_chunks_mut(matrix.tile_rows.max(1)).zip(response).for_each(|(rows, sums)| {
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
