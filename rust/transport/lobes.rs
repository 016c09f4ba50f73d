//! What glossy rows take of texels where diffuse ones take cosines: the lobe of a model, as one eye sees it.
//!
//! A row keeps the number of its model, the direction to its eye and how wide its lobe is there. What it takes of a texel is
//! made anew from these when a sun moves, as a cosine is from a normal: no lobe is stored, and a highlight is as sharp as
//! texels are. What a model reflects is not known in this room: whoever makes a matrix, or opens one, brings the models.

use std::ops::Range;
use std::sync::Arc;

use crate::error::Result;

use super::slab::Slab;

/// In place of a model's number: the row takes cosines.
pub const DIFFUSE: u16 = u16::MAX;
/// How far the squared length of a direction may be from 1.
const UNIT: f32 = 1e-4;

/// Models of reflectance by their numbers.
pub trait LobeModels: Send + Sync {
    /// How many there are.
    fn count(&self) -> usize;

    /// For each of some texels of faces of `size` x `size` pi times the mean over it of f cos: what a row has where a diffuse
    /// one has its cosine. Of nothing but what is given, and the same to the bit on every machine.
    fn means(&self, lobe: &RowLobe, size: usize, texels: &[usize], means: &mut [f32]);

    /// Their kinds, and `PARAMETERS` parameters each, as files hold them.
    fn stored(&self) -> (Vec<u32>, Vec<f64>);
}

/// Parameters that a file has for each model.
pub const PARAMETERS: usize = 8;

/// Makes models from what files hold of them.
pub type MakeModels<'a> = dyn Fn(&[u32], &[f64]) -> Result<Arc<dyn LobeModels>> + Sync + 'a;

/// The lobe of a row.
#[derive(Clone, Copy, Debug)]
pub struct RowLobe {
    /// The number of its model.
    pub model: usize,
    /// Unit, in space.
    pub normal: [f32; 3],
    /// Unit, to the eye.
    pub eye: [f32; 3],
    /// Radians from its axis to where it has fallen to a half.
    pub half_width: f32,
}

/// The lobes of the rows of a tile, or of all rows.
#[derive(Clone)]
pub struct Lobes {
    /// Shared by all tiles.
    pub models: Arc<dyn LobeModels>,
    /// Of each row the number of its model, or `DIFFUSE`.
    pub model: Slab<u16>,
    /// `[row][xyz]`
    pub eye: Slab<f32>,
    /// One a row.
    pub half_width: Slab<f32>,
}

impl Lobes {
    /// Whether `normals`, `[row][xyz]`, and what is known of the lobes go together, and every number can be used.
    pub fn check(&self, normals: &[f32]) -> std::result::Result<(), String> {
        let (rows, count) = (self.model.len(), self.models.count());
        if [normals.len(), self.eye.len(), 3 * self.half_width.len()] != [3 * rows; 3] {
            return Err(format!("expected a normal, an eye and a half width of each of {rows} lobes"));
        }
        for row in 0..rows {
            let Some(lobe) = self.of(row, [0, 1, 2].map(|axis| normals[3 * row + axis])) else { continue };
            let unit = |v: [f32; 3]| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2] - 1.0).abs() <= UNIT;
            let whole = unit(lobe.normal) && unit(lobe.eye) && lobe.half_width > 0.0;
            if lobe.model >= count || !whole {
                return Err(format!(
                    "expected one of {count} models, unit vectors and a width, found {lobe:?} of row {row}"
                ));
            }
        }
        Ok(())
    }

    /// Of a row with this normal; None of a diffuse one.
    pub fn of(&self, row: usize, normal: [f32; 3]) -> Option<RowLobe> {
        let model = *self.model.get(row).filter(|&&model| model != DIFFUSE)?;
        let eye = [0, 1, 2].map(|axis| self.eye[3 * row + axis]);
        Some(RowLobe { model: usize::from(model), normal, eye, half_width: self.half_width[row] })
    }

    /// Those of some rows.
    pub fn part(&self, rows: Range<usize>) -> Lobes {
        Lobes {
            models: Arc::clone(&self.models),
            model: self.model.part(rows.clone()),
            eye: self.eye.part(3 * rows.start..3 * rows.end),
            half_width: self.half_width.part(rows),
        }
    }

    /// Those of some rows, one after the other; rows behind the last are diffuse.
    pub fn picked(&self, rows: impl Iterator<Item = usize> + Clone) -> Lobes {
        let there = |row: &usize| *row < self.model.len();
        let eye = |row: usize| [0, 1, 2].map(|axis| if there(&row) { self.eye[3 * row + axis] } else { 0.0 });
        let model = |row: usize| if there(&row) { self.model[row] } else { DIFFUSE };
        let half_width = |row: usize| if there(&row) { self.half_width[row] } else { 0.0 };
        Lobes {
            models: Arc::clone(&self.models),
            model: rows.clone().map(model).collect::<Vec<_>>().into(),
            eye: rows.clone().flat_map(eye).collect::<Vec<_>>().into(),
            half_width: rows.map(half_width).collect::<Vec<_>>().into(),
        }
    }

    /// Bytes of the three arrays.
    pub fn nbytes(&self) -> usize {
        2 * self.model.len() + 4 * (self.eye.len() + self.half_width.len())
    }
}
