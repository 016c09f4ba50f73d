//! Models that are functions of the half vector, and are sampled by reflecting at one of all facets.

use std::fmt::Debug;

use super::albedo::over_facets;
use super::curve::Curved;
use super::direction::{Direction, Half, reflected};
use super::model::{Brdf, dense};

/// Normals of facets, by a density over solid angle whose integral is 1.
pub(super) trait Facets {
    /// A unit normal from two numbers.
    fn sample(&self, u: [f64; 2]) -> Direction;

    /// The density of that.
    fn density(&self, half: &Half) -> f64;

    /// About the slope along x, and along y, by which that has fallen to 1 / e.
    fn widths(&self) -> [f64; 2];
}

/// What such a model has of its own.
pub(super) trait HalfModel: Debug + Send + Sync {
    /// f, both directions being above the horizon.
    fn value(&self, half: &Half) -> f64;

    /// What it is sampled by.
    fn facets(&self) -> &impl Facets;

    /// As `Brdf::curved`.
    fn curved(&self) -> Option<&dyn Curved> {
        None
    }
}

impl<Model: HalfModel> Brdf for Model {
    fn evaluate(&self, wi: Direction, wo: Direction) -> f64 {
        Half::between(wi, wo).map_or(0.0, |half| self.value(&half))
    }

    fn sample(&self, wo: Direction, u: [f64; 2]) -> Option<(Direction, f64)> {
        let wi = reflected(wo, self.facets().sample(u))?;
        dense(self, wi, wo)
    }

    /// dw_h = dw_i / (4 h . wo)
    fn pdf(&self, wi: Direction, wo: Direction) -> f64 {
        Half::between(wi, wo).map_or(0.0, |half| self.facets().density(&half) / (4.0 * half.cos_d))
    }

    fn curved(&self) -> Option<&dyn Curved> {
        HalfModel::curved(self)
    }

    fn albedo(&self, wo: Direction) -> f64 {
        over_facets(wo, self.facets().widths(), |wi| self.evaluate(wi, wo))
    }
}
