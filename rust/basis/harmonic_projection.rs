//! Cubemaps to spherical harmonics: c_j = ∫ L Y_j dω of a map that is constant over each texel.
//!
//! Y_j is integrated over every texel by Gauss-Legendre points, so that what is projected is the map itself, not samples
//! of it; with M's rows projected alike, Σ T_j c_j = Σ_p T_p L_p dω_p up to the degrees that are left out.
//!
//! The mirrors x -> -x, y -> -y and z -> -z map texels to texels and Y_j to ± Y_j. The eight texels that they make of
//! one in the octant x, y, z > 0 are therefore folded into eight sums and differences, one for each triple of signs;
//! a function then meets only the octant: an eighth of the work, and of the table (9.8 MB for order 20).

use std::sync::OnceLock;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::twice::compiled_twice;

use super::bands::ColumnSpace;
use super::cubemap::{direction_to_face_uv, face_point, texel_centre, texel_direction, texel_of};
use super::spherical_harmonics::{SphericalHarmonics, degree_and_m};
use super::texel::Texel;

/// Texels along a face of the cubemap that stands between light and harmonics.
pub const HARMONIC_FACE: usize = 64;

/// Functions whose sums run side by side.
const BLOCK: usize = 4;
/// Products that are summed before they join the total: in f32 the error grows with the longer of the two chains.
const CHAIN: usize = 64;

/// Points and weights of the Gauss-Legendre rule on [-1, 1] with five points: exact to degree 9.
const GAUSS: [(f64, f64); 5] = [
    (-0.906179845938664, 0.23692688505618908),
    (-0.5384693101056831, 0.47862867049936647),
    (0.0, 0.5688888888888889),
    (0.5384693101056831, 0.47862867049936647),
    (0.906179845938664, 0.23692688505618908),
];

/// Up to four functions of the same signs under the three mirrors.
struct Block {
    signs: usize,
    /// Their numbers; places that are left over hold `usize::MAX`.
    columns: [usize; BLOCK],
    /// ∫ Y_j dω over each texel of the octant.
    integrals: Vec<[f64; BLOCK]>,
}

/// The projection of cubemaps of one size on the functions of one order.
pub struct HarmonicProjection {
    order: usize,
    size: usize,
    /// For each texel of the octant the texels at its eight mirror images: bit 0 is set where x is negative, 1 y, 2 z.
    images: Vec<[u32; 8]>,
    blocks: Vec<Block>,
}

impl HarmonicProjection {
    /// `size`: texels along a face; even, so that mirrors keep texels whole.
    pub fn new(order: usize, size: usize) -> Result<Self> {
        ColumnSpace::spherical_harmonics(order)?;
        if size == 0 || size % 2 == 1 {
            return Err(Error::input(format!(
                "expected an even cubemap face to project on harmonics, got {size} texels"
            )));
        }
        let octant = octant(size);
        let images = octant.iter().map(|texel| texel.images(size)).collect();
        let integrals: Vec<Vec<f64>> = {
            let harmonics = SphericalHarmonics::new(order)?;
            octant.par_iter().map(|texel| texel.integrals(size, &harmonics)).collect()
        };

        let mut blocks = Vec::new();
        for signs in 0..8 {
            let alike: Vec<usize> = (0..order * order).filter(|&column| signs_of(column) == signs).collect();
            for some in alike.chunks(BLOCK) {
                let columns = std::array::from_fn(|k| some.get(k).copied().unwrap_or(usize::MAX));
                let of = |texel: &Vec<f64>| columns.map(|column: usize| texel.get(column).copied().unwrap_or(0.0));
                blocks.push(Block { signs, columns, integrals: integrals.iter().map(of).collect() });
            }
        }
        Ok(HarmonicProjection { order, size, images, blocks })
    }

    /// The projection from `HARMONIC_FACE`, made once and kept.
    pub fn shared(order: usize) -> Result<&'static Self> {
        static MADE: [OnceLock<HarmonicProjection>; ColumnSpace::MAX_ORDER + 1] =
            [const { OnceLock::new() }; ColumnSpace::MAX_ORDER + 1];
        ColumnSpace::spherical_harmonics(order)?;
        match MADE[order].get() {
            Some(made) => Ok(made),
            None => {
                let fresh = Self::new(order, HARMONIC_FACE)?;
                Ok(MADE[order].get_or_init(|| fresh))
            }
        }
    }

    /// Coefficients that a projection gives: order².
    pub fn columns(&self) -> usize {
        self.order * self.order
    }

    /// Texels that it takes, over all six faces.
    pub fn texels(&self) -> usize {
        6 * self.size * self.size
    }

    /// Coefficients of a cubemap's texels (all six faces). `folded` is scratch.
    pub fn project<L: Texel>(&self, texels: &[L], folded: &mut Vec<L>, coefficients: &mut [L]) {
        self.fold(texels, folded);
        for block in &self.blocks {
            self.store(block, self.sums(block, folded), coefficients);
        }
    }

    /// Coefficients of a cubemap's radiance, face by face in rows.
    pub fn forward(&self, cubemap: &[[f32; 3]]) -> Vec<[f64; 3]> {
        let texels: Vec<[f64; 3]> = cubemap.iter().map(|colour| colour.map(f64::from)).collect();
        let mut folded = Vec::new();
        self.fold(&texels, &mut folded);
        let sums: Vec<_> = self.blocks.par_iter().map(|block| self.sums(block, &folded)).collect();
        let mut coefficients = vec![[0.0; 3]; self.columns()];
        for (block, sums) in self.blocks.iter().zip(sums) {
            self.store(block, sums, &mut coefficients);
        }
        coefficients
    }

    /// Sums and differences of the images of each texel: eight lists, one for each triple of signs.
    fn fold<L: Texel>(&self, texels: &[L], folded: &mut Vec<L>) {
        assert_eq!(texels.len(), self.texels());
        let count = self.images.len();
        folded.clear();
        folded.resize(8 * count, L::ZERO);
        for (k, images) in self.images.iter().enumerate() {
            let mut values = images.map(|texel| texels[texel as usize]);
            for bit in [1, 2, 4] {
                for low in (0..8).filter(|low| low & bit == 0) {
                    let (a, b) = (values[low], values[low | bit]);
                    (values[low], values[low | bit]) = (a.plus(&b, 1.0), a.plus(&b, -1.0));
                }
            }
            for (signs, value) in values.into_iter().enumerate() {
                folded[signs * count + k] = value;
            }
        }
    }

    fn sums<L: Texel>(&self, block: &Block, folded: &[L]) -> [L; BLOCK] {
        let count = self.images.len();
        let values = &folded[block.signs * count..(block.signs + 1) * count];
        products(&block.integrals, values)
    }

    fn store<L: Texel>(&self, block: &Block, sums: [L; BLOCK], coefficients: &mut [L]) {
        for (column, sum) in block.columns.into_iter().zip(sums) {
            if column < self.columns() {
                coefficients[column] = sum;
            }
        }
    }
}

compiled_twice! {
    fn products[L: Texel](integrals: &[[f64; BLOCK]], values: &[L]) -> [L; BLOCK] = products_any;
}

#[inline(always)]
fn products_any<L: Texel>(integrals: &[[f64; BLOCK]], values: &[L]) -> [L; BLOCK] {
    let mut total = [L::ZERO; BLOCK];
    for (integrals, values) in integrals.chunks(CHAIN).zip(values.chunks(CHAIN)) {
        let mut sums = [L::ZERO; BLOCK];
        for (integrals, value) in integrals.iter().zip(values) {
            for k in 0..BLOCK {
                sums[k] = sums[k].plus(value, integrals[k]);
            }
        }
        for k in 0..BLOCK {
            total[k] = total[k].plus(&sums[k], 1.0);
        }
    }
    total
}

/// Which mirrors change a function's sign: bit 0 x, bit 1 y, bit 2 z.
///
/// z -> -z gives (-1)^(l + m); y -> -y is φ -> -φ, odd for sines; x -> -x is φ -> π - φ, odd for cosines of odd and
/// sines of even multiples.
fn signs_of(column: usize) -> usize {
    let (degree, m) = degree_and_m(column);
    let (odd, sine) = (m.unsigned_abs() % 2 == 1, m < 0);
    usize::from(odd != sine) | usize::from(sine) << 1 | usize::from((degree % 2 == 1) != odd) << 2
}

/// A texel in the octant where all components are positive.
struct Place {
    face: usize,
    row: usize,
    column: usize,
}

fn octant(size: usize) -> Vec<Place> {
    let all = (0..6 * size * size).map(|k| Place { face: k / (size * size), row: k / size % size, column: k % size });
    all.filter(|texel| texel.direction(size).iter().all(|&component| component > 0.0)).collect()
}

impl Place {
    fn direction(&self, size: usize) -> [f64; 3] {
        texel_direction(size, self.face, self.row, self.column)
    }

    /// The texels where its mirror images lie.
    fn images(&self, size: usize) -> [u32; 8] {
        let direction = self.direction(size);
        std::array::from_fn(|signs| {
            let image = std::array::from_fn(|k| if signs >> k & 1 == 1 { -direction[k] } else { direction[k] });
            let (face, s, t) = direction_to_face_uv(image);
            ((face * size + texel_of(size, t)) * size + texel_of(size, s)) as u32
        })
    }

    /// ∫ Y_j dω over it for all j: on the face at distance 1, dω = ds dt / r³.
    fn integrals(&self, size: usize, harmonics: &SphericalHarmonics) -> Vec<f64> {
        let (s, t, half) = (texel_centre(size, self.column), texel_centre(size, self.row), 1.0 / size as f64);
        let mut values = vec![0.0; harmonics.order() * harmonics.order()];
        let mut integrals = values.clone();
        for (x, wx) in GAUSS {
            for (y, wy) in GAUSS {
                let point = face_point(self.face, s + half * x, t + half * y);
                let r = point.iter().map(|component| component * component).sum::<f64>().sqrt();
                harmonics.evaluate(point.map(|component| component / r), &mut values);
                let weight = wx * wy * half * half / (r * r * r);
                integrals.iter_mut().zip(&values).for_each(|(sum, value)| *sum += weight * value);
            }
        }
        integrals
    }
}
