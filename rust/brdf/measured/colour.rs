//! One colour of a measured table, as a model: what a row of a transport of one channel holds.

use std::sync::Arc;

use crate::error::{Error, Result};

use super::super::direction::Direction;
use super::super::model::Brdf;
use super::table::Measured;

/// Red, green or blue of a table; sampled as all of it is.
#[derive(Clone, Debug)]
pub struct Colour {
    table: Arc<dyn Measured>,
    channel: usize,
}

impl Colour {
    /// Refuses a channel that is not 0, 1 or 2.
    pub fn new(table: Arc<dyn Measured>, channel: usize) -> Result<Self> {
        if channel > 2 {
            return Err(Error::input(format!("expected a channel from 0 to 2, got {channel}")));
        }
        Ok(Colour { table, channel })
    }
}

impl Brdf for Colour {
    fn evaluate(&self, wi: Direction, wo: Direction) -> f64 {
        self.table.colour(wi, wo)[self.channel]
    }

    fn sample(&self, wo: Direction, u: [f64; 2]) -> Option<(Direction, f64)> {
        self.table.sample(wo, u)
    }

    fn pdf(&self, wi: Direction, wo: Direction) -> f64 {
        self.table.pdf(wi, wo)
    }

    fn axis(&self, wo: Direction) -> Direction {
        self.table.axis(wo)
    }

    fn half_width(&self, wo: Direction) -> f64 {
        self.table.half_width(wo)
    }
}
