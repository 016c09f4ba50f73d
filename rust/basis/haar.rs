//! The 2D Haar transform on the six faces of a cubemap, orthonormal on the *sphere*.
//!
//! A texel's coefficient is its value times sqrt(dω), dω being its solid angle. A 2x2 block whose parts cover areas a_k
//! is turned by an orthogonal 4x4 matrix with weights w_k = sqrt(a_k / Σ a), so that the first row keeps constants:
//!
//! ```text
//!     ll = ( w0,  w1,  w2,  w3)        children: 0 1
//!     h  = ( w1, -w0,  w3, -w2)                  2 3
//!     d  = ( w2, -w3, -w0,  w1)
//!     v  = ( w3,  w2, -w1, -w0)
//! ```
//!
//! Equal areas give the usual Haar wavelets. Since the transform is orthogonal, Σ c_j T_j = ∫ L T dω exactly, the sum of
//! c_j² is the squared L2 norm on the sphere, and a constant sky needs 6 coefficients. (The unweighted Haar transform of
//! L sqrt(dω) needs nearly all of them; that of L alone has no Parseval theorem on the sphere.)
//! Columns are numbered as `ColumnSpace::Haar` says.

use std::sync::OnceLock;

use rayon::prelude::*;

use crate::error::Result;
use crate::twice::compiled_twice;

use super::bands::ColumnSpace;
use super::cubemap::solid_angles;
use super::texel::Texel;

/// The transform for one face size.
pub struct Haar {
    size: usize,
    /// `weights[l]` holds the w_k of the 2^l x 2^l blocks of level l, in rows; level 0 is the coarsest.
    weights: Vec<Vec<[f64; 4]>>,
    /// sqrt(dω) of one face's texels.
    roots: Vec<f64>,
}

impl Haar {
    /// Makes the tables of one size; refuses faces that are not a power of two from 1 to 512 texels wide.
    pub fn new(size: usize) -> Result<Self> {
        ColumnSpace::haar(size)?;
        let mut areas = solid_angles(size);
        let roots = areas.iter().map(|area| area.sqrt()).collect();

        // From the finest level up: a block's area is the sum of its parts' areas.
        let mut weights = Vec::new();
        let mut side = size;
        while side > 1 {
            side /= 2;
            let parts: Vec<[f64; 4]> = (0..side * side).map(|block| children(block, side).map(|k| areas[k])).collect();
            areas = parts.iter().map(|part| part.iter().sum()).collect();
            let normalised = |(part, area): (&[f64; 4], &f64)| part.map(|a| (a / area).sqrt());
            weights.push(parts.iter().zip(&areas).map(normalised).collect());
        }
        weights.reverse();
        Ok(Haar { size, weights, roots })
    }

    /// The transform of this size, made once and kept: its tables are small and a frame has no time to make them.
    pub fn shared(size: usize) -> Result<&'static Self> {
        static MADE: [OnceLock<Haar>; 10] = [const { OnceLock::new() }; 10];
        ColumnSpace::haar(size)?;
        let slot = &MADE[size.trailing_zeros() as usize];
        match slot.get() {
            Some(haar) => Ok(haar),
            None => {
                let fresh = Haar::new(size)?;
                Ok(slot.get_or_init(|| fresh))
            }
        }
    }

    /// Texels along a face.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Coefficients of a cubemap, 6 n² for faces of n x n texels.
    pub fn columns(&self) -> usize {
        6 * self.size * self.size
    }

    /// sqrt(dω) of one face's texels, row by row.
    pub fn roots(&self) -> &[f64] {
        &self.roots
    }

    /// Transforms one face. `texels` (its n² values, already times sqrt(dω)) is scratch and destroyed; the face's columns
    /// of `coefficients` (the whole vector) are written, the others left alone.
    pub fn forward_face<L: Texel>(&self, face: usize, texels: &mut [L], coefficients: &mut [L]) {
        let [mut own] = self.face_columns(coefficients, [face]);
        analyse(&self.weights, texels, &mut own);
    }

    /// The coefficients of a cubemap's radiance, face by face in rows.
    pub fn forward(&self, cubemap: &[[f32; 3]]) -> Vec<[f64; 3]> {
        let mut coefficients = vec![[0.0; 3]; self.columns()];
        let faces = self.face_columns(&mut coefficients, [0, 1, 2, 3, 4, 5]);
        faces.into_par_iter().zip(cubemap.par_chunks_exact(self.size * self.size)).for_each(|(mut own, radiance)| {
            let weigh = |(colour, root): (&[f32; 3], &f64)| colour.map(|value| value as f64 * root);
            let mut texels: Vec<[f64; 3]> = radiance.iter().zip(&self.roots).map(weigh).collect();
            analyse(&self.weights, &mut texels, &mut own);
        });
        coefficients
    }

    /// Coefficients of wavelets and, behind them, of texels: the same light in wavelets alone. A function of its values: the
    /// same bits on every machine.
    pub fn without_texels(&self, coefficients: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let (wavelets, texels) = coefficients.split_at(self.columns());
        let mut all = wavelets.to_vec();
        let mut own = Vec::new();
        for (face, texels) in texels.chunks_exact(self.size * self.size).enumerate() {
            if texels.iter().all(|texel| *texel == [0.0; 3]) {
                continue;
            }
            own.resize(self.columns(), [0.0; 3]);
            self.forward_face(face, &mut texels.to_vec(), &mut own);
            let [mut sums] = self.face_columns(&mut all, [face]);
            let [parts] = self.face_columns(&mut own, [face]);
            for (sum, part) in sums.iter_mut().zip(&parts).flat_map(|(sums, parts)| sums.iter_mut().zip(parts.iter())) {
                (0..3).for_each(|c| sum[c] += part[c]);
            }
        }
        all
    }

    /// The transpose of `without_texels`: the wavelets, and behind them the texels that have these coefficients.
    pub fn with_texels(&self, mut wavelets: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
        let texels: Vec<[f64; 3]> = (0..6).flat_map(|face| self.texels_of_face(face, &wavelets)).collect();
        wavelets.extend(texels);
        wavelets
    }

    /// The radiance that has these coefficients: the inverse of `forward`.
    pub fn inverse(&self, coefficients: &[[f64; 3]]) -> Vec<[f64; 3]> {
        (0..6).flat_map(|face| self.inverse_face(face, coefficients)).collect()
    }

    fn inverse_face(&self, face: usize, coefficients: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let texels = self.texels_of_face(face, coefficients);
        texels.iter().zip(&self.roots).map(|(texel, root)| texel.map(|value| value / root)).collect()
    }

    /// A face's texels in their own orthonormal basis: radiance times sqrt(dω).
    fn texels_of_face(&self, face: usize, coefficients: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let mut coarse = vec![coefficients[face]];
        for (level, weights) in self.weights.iter().enumerate() {
            let (side, blocks) = (1 << level, 1 << (2 * level));
            let start = 6 * blocks + 3 * blocks * face;
            let mut fine = vec![[0.0; 3]; 4 * blocks];
            for (block, &[w0, w1, w2, w3]) in weights.iter().enumerate() {
                let [h, d, v] = [0, 1, 2].map(|kind| &coefficients[start + 3 * block + kind]);
                // The transposed matrix.
                let lanes = [&coarse[block], h, d, v];
                let rows = [[w0, w1, w2, w3], [w1, -w0, -w3, w2], [w2, w3, -w0, -w1], [w3, -w2, w1, -w0]];
                for (child, row) in children(block, side).into_iter().zip(rows) {
                    fine[child] = Texel::combine(lanes, row);
                }
            }
            coarse = fine;
        }
        coarse
    }

    /// Cuts a coefficient vector into each face's own columns: the scaling function first, then level after level.
    fn face_columns<'a, L, const F: usize>(&self, mut all: &'a mut [L], faces: [usize; F]) -> [Vec<&'a mut [L]>; F] {
        let mut own = faces.map(|_| Vec::with_capacity(self.weights.len() + 1));
        let lengths = std::iter::once(1).chain(self.weights.iter().map(|level| 3 * level.len()));
        for length in lengths {
            let (level, rest) = all.split_at_mut(6 * length);
            all = rest;
            for (face, part) in level.chunks_exact_mut(length).enumerate() {
                if let Some(slot) = faces.iter().position(|&wanted| wanted == face) {
                    own[slot].push(part);
                }
            }
        }
        own
    }
}

/// The four texels of a block, in a grid of 2 `side` x 2 `side` texels.
fn children(block: usize, side: usize) -> [usize; 4] {
    let first = 4 * side * (block / side) + 2 * (block % side);
    [first, first + 1, first + 2 * side, first + 2 * side + 1]
}

compiled_twice! {
    /// All levels of one face, finest first; `own[0]` takes the scaling coefficient, `own[l + 1]` level l.
    fn analyse[L: Texel](weights: &[Vec<[f64; 4]>], texels: &mut [L], own: &mut [&mut [L]]) = analyse_any;
}

/// The same operations in the same order on every machine (no fused multiply-add), hence the same bits.
#[inline(always)]
fn analyse_any<L: Texel>(weights: &[Vec<[f64; 4]>], texels: &mut [L], own: &mut [&mut [L]]) {
    for (level, weights) in weights.iter().enumerate().rev() {
        let side = 1 << level;
        for row in 0..side {
            for column in 0..side {
                // The scaling coefficients pack the front of the scratch, always behind the texels still to be read.
                let block = row * side + column;
                let [w0, w1, w2, w3] = weights[block];
                let first = 4 * side * row + 2 * column;
                let (upper, lower) = (&texels[first..first + 2], &texels[first + 2 * side..first + 2 * side + 2]);
                let lanes = [&upper[0], &upper[1], &lower[0], &lower[1]];
                let scaling = L::combine(lanes, [w0, w1, w2, w3]);
                let wavelets = &mut own[level + 1][3 * block..3 * block + 3];
                wavelets[0] = L::combine(lanes, [w1, -w0, w3, -w2]);
                wavelets[1] = L::combine(lanes, [w2, -w3, -w0, w1]);
                wavelets[2] = L::combine(lanes, [w3, w2, -w1, -w0]);
                texels[block] = scaling;
            }
        }
    }
    own[0][0] = texels[0];
}
