//! The transpose of a whole product: M^T R through what links its matrices, backwards.
//!
//! ```text
//!     first x K                   sum_k M_k^T (mix_k R)
//!     receivers and nodes         M^T R + N^T (W^T R)
//!     first -> tree -> then x K   L^T H^T sum_k T_k^T (mix_k R)
//!     representatives             sum_k P_k^T W_k^T (mix_k R)
//! ```
//!
//! Each transpose is exact (`multiplying/adjoint.rs`); what goes from one to the next is rounded to 2^-34 of its largest, as
//! R is itself. Transforms between them (H, and that of texels into wavelets) round as they do forwards.

use crate::basis::haar::Haar;
use crate::error::{Error, Result};
use crate::transport::{Factors, Link, TransportMatrix};

use super::chain::{Chain, check_mix};
use super::multiplying::adjoint::{Gridded, adjoint, given};
use super::multiplying::finish::Mix;

impl Chain {
    /// M^T R for a number in each colour for every row: one triple a column of the first stage. Those of texels, which are
    /// made anew for all that rows see, may be left out, and are 0 then.
    pub fn adjoint(&self, r: &[[f64; 3]], mix: Option<&Mix>, texels: bool) -> Result<Vec<[f64; 3]>> {
        let product = &self.product;
        check_mix(product, mix)?;
        if r.len() != product.rows() {
            return Err(Error::input(format!(
                "expected a number for each of {} rows, got {}",
                product.rows(),
                r.len()
            )));
        }
        let own = |factor: usize| mix.map_or_else(|| r.to_vec(), |mix| mix.share(factor, r));
        let mut sums = vec![[0.0; 3]; product.first.space().columns()];
        match (&product.link, &product.then) {
            (Link::Weights(weights), _) => {
                let r = Gridded::new(r)?;
                let [receivers, nodes] = [0, 1].map(|k| &*product.first.as_slice()[k]);
                add(&mut sums, adjoint(receivers, &r, texels));
                let shares = given(weights, nodes.rows, &r);
                add(&mut sums, self.of_factor(nodes, &shares, texels)?);
            }
            (_, None) => {
                for (k, matrix) in product.first.iter().enumerate() {
                    add(&mut sums, self.of_factor(matrix, &own(k), texels)?);
                }
            }
            (Link::Tree(tree), Some(then)) => {
                let mut second = vec![[0.0; 3]; then.space().columns()];
                for (k, matrix) in then.iter().enumerate() {
                    add(&mut second, transposed(matrix, &own(k), true)?);
                }
                add(&mut sums, transposed(product.first.first(), &tree.backward(&second), texels)?);
                if product.first.space() == tree.space() {
                    add(&mut sums, second);
                }
            }
            (_, Some(then)) => {
                for (k, (first, matrix)) in product.first.iter().zip(then.iter()).enumerate() {
                    add(&mut sums, self.of_factor(first, &transposed(matrix, &own(k), true)?, texels)?);
                }
            }
        }
        Ok(sums)
    }

    /// Of a matrix of the first stage, in the columns that all have in common.
    fn of_factor(&self, matrix: &TransportMatrix, r: &[[f64; 3]], texels: bool) -> Result<Vec<[f64; 3]>> {
        let own = transposed(matrix, r, texels)?;
        let first: &Factors = &self.product.first;
        match first.merged().filter(|_| texels && matrix.space != first.space()) {
            Some(size) => Ok(Haar::shared(size)?.with_texels(own)),
            None => Ok(own),
        }
    }
}

fn transposed(matrix: &TransportMatrix, r: &[[f64; 3]], texels: bool) -> Result<Vec<[f64; 3]>> {
    Ok(adjoint(matrix, &Gridded::new(r)?, texels))
}

fn add(sums: &mut [[f64; 3]], more: Vec<[f64; 3]>) {
    sums.as_flattened_mut().iter_mut().zip(more.as_flattened()).for_each(|(sum, x)| *sum += x);
}
