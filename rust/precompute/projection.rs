//! The last step of a pass: the rows V cos / π of 16 receivers, texel by texel, become coefficients.
//!
//! Both bases integrate over the texels: Haar takes T_p = V_p cos / π * sqrt(dω_p), spherical harmonics take V cos / π as
//! constant over the texel and hold ∫ Y dω themselves (`basis/harmonic_projection.rs`).

use std::f64::consts::PI;

use crate::basis::cubemap::solid_angles;
use crate::basis::haar::Haar;
use crate::basis::{ColumnSpace, HARMONIC_FACE, HarmonicProjection};
use crate::error::{Error, Result};

use crate::transport::{GROUP, Rows16};

/// From texels to columns.
pub(super) struct Projection {
    basis: Basis,
    /// Texels along a face that the pass shoots.
    size: usize,
    /// What a cosine is multiplied by to be a texel's entry, for the texels of one face.
    factors: Vec<f32>,
    /// Solid angles of the texels of a face.
    areas: Vec<f64>,
}

enum Basis {
    Haar(&'static Haar),
    Harmonics(&'static HarmonicProjection),
}

/// Texels of 16 rows, kept by each thread: one face at a time for Haar, all six for harmonics.
pub(super) struct Scratch {
    texels: Vec<Rows16>,
    folded: Vec<Rows16>,
}

impl Projection {
    /// Refuses columns that are not a basis of light.
    pub fn new(space: ColumnSpace) -> Result<Self> {
        Ok(match space {
            ColumnSpace::Haar { size } | ColumnSpace::HaarTexels { size } => {
                let haar = Haar::shared(size)?;
                let factors = haar.roots().iter().map(|root| (root / PI) as f32).collect();
                Projection { basis: Basis::Haar(haar), size, factors, areas: solid_angles(size) }
            }
            ColumnSpace::SphericalHarmonics { order } => Projection {
                basis: Basis::Harmonics(HarmonicProjection::shared(order)?),
                size: HARMONIC_FACE,
                factors: vec![(1.0 / PI) as f32; HARMONIC_FACE * HARMONIC_FACE],
                areas: solid_angles(HARMONIC_FACE),
            },
            ColumnSpace::Tree { .. }
            | ColumnSpace::Representatives { .. }
            | ColumnSpace::Daubechies4 { .. }
            | ColumnSpace::Lamps { .. } => {
                return Err(Error::input(format!("expected columns that light is measured in, got {space}")));
            }
        })
    }

    /// Texels along a face that the pass shoots.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Solid angles of the texels of a face.
    pub fn areas(&self) -> &[f64] {
        &self.areas
    }

    /// What the cosine at a texel is multiplied by; the faces are alike.
    pub fn factor(&self, texel_of_face: usize) -> f32 {
        self.factors[texel_of_face]
    }

    /// Fresh scratch for one thread.
    pub fn scratch(&self) -> Scratch {
        let faces = match self.basis {
            Basis::Haar(_) => 1,
            Basis::Harmonics(_) => 6,
        };
        Scratch { texels: vec![[0.0; GROUP]; faces * self.factors.len()], folded: Vec::new() }
    }

    /// Where the entries of a face's texels go; faces come in order.
    pub fn face<'a>(&self, face: usize, scratch: &'a mut Scratch) -> &'a mut [Rows16] {
        match self.basis {
            Basis::Haar(_) => &mut scratch.texels,
            Basis::Harmonics(_) => &mut scratch.texels[face * self.factors.len()..(face + 1) * self.factors.len()],
        }
    }

    /// A face is filled; after the last one all `coefficients` are there.
    pub fn face_done(&self, face: usize, scratch: &mut Scratch, coefficients: &mut [Rows16]) {
        match self.basis {
            Basis::Haar(haar) => haar.forward_face(face, &mut scratch.texels, coefficients),
            Basis::Harmonics(harmonics) if face == 5 => {
                harmonics.project(&scratch.texels, &mut scratch.folded, coefficients);
            }
            Basis::Harmonics(_) => {}
        }
    }
}
