//! Rows of D, M_s and T as a pass: what receivers take from gather samples, in wavelets over the samples' tree.
//!
//! ```text
//!     D      a row a pixel, by cosines            M_s    a row a sample, by cosines
//!     T_k    a row a pixel of one material, a factor for each function of each segment of its family
//! ```
//!
//! Tiles are cut off where what they hold no longer matters, all factors by one threshold, each weighed by how much of its
//! function the family takes: `threshold_for`.

use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use crate::basis::{Bands, HaarTree};
use crate::error::{Error, Result};
use crate::scene::rays::{Segments, Tracer};
use crate::scene::{GatherSamples, Mesh, Surfaces};
use crate::transport::entry::Channels;
use crate::transport::{GROUP, Measure, Rows16, Survey, Threshold, Truncation, Width};

use super::gather::{Gather, Kernel, SubArea};
use super::pass::{Advance, BUNDLE_ROWS, Made, Pass, Rays, Shape, Take, spread};
use super::standing::Receiver;

/// Rows of receivers over the tree of the samples, a factor for each row of each kernel.
pub struct GatherPass {
    mesh: Arc<Mesh>,
    tracer: Arc<Tracer>,
    samples: Arc<GatherSamples>,
    tree: HaarTree,
    receivers: Vec<Receiver>,
    kernels: Vec<Kernel>,
    shape: Shape,
}

/// Room for one bundle: of visibility, rows over samples, and one group of them over the tree.
#[derive(Default)]
pub struct Room {
    segments: Segments,
    rows: Vec<Rows16>,
    plane: Vec<Rows16>,
}

impl GatherPass {
    /// Refuses no receivers and no kernels.
    pub fn new(
        mesh: Arc<Mesh>,
        tracer: Arc<Tracer>,
        samples: Arc<GatherSamples>,
        receivers: Vec<Receiver>,
        kernels: Vec<Kernel>,
    ) -> Result<GatherPass> {
        if receivers.is_empty() || kernels.is_empty() {
            let (rows, kernels) = (receivers.len(), kernels.len());
            return Err(Error::input(format!("expected receivers and kernels, got {rows} and {kernels}")));
        }
        let tree = HaarTree::new(samples.areas.clone())?;
        let shape = Shape {
            rows: receivers.len(),
            texels: None,
            lobes: None,
            bands: tree.space().bands(),
            channels: Channels::One,
            factors: kernels.iter().map(Kernel::count).sum(),
        };
        Ok(GatherPass { mesh, tracer, samples, tree, receivers, kernels, shape })
    }

    /// The threshold that keeps the picture within a relative error: `measures` are a light of the samples (columns x 3) and
    /// what of each factor it is seen through; `weights` how much there is in each column, and `scales` in each factor.
    ///
    /// What the picture takes is one row over the columns of all factors, sum_kj c_k T_kj L_j: so one survey sees them all.
    pub fn threshold_for(
        &self,
        bundles: usize,
        tolerance: f64,
        (weights, scales): (&[f64], &[f64]),
        (quantum, width): (i32, Width),
        measures: &[(Vec<f64>, Vec<[f64; 3]>)],
        advance: &Advance,
    ) -> Result<Threshold> {
        let (columns, factors) = (self.shape.bands.columns(), self.shape.factors);
        let fits = |(through, light): &(Vec<f64>, Vec<[f64; 3]>)| through.len() == factors && light.len() == columns;
        if weights.len() != columns || scales.len() != factors || !measures.iter().all(fits) {
            return Err(Error::input(format!("expected weights of {columns} columns and {factors} factors")));
        }
        let outer = |(through, light): &(Vec<f64>, Vec<[f64; 3]>)| {
            let whole: Vec<[f64; 3]> =
                through.iter().flat_map(|c| light.iter().map(move |light| light.map(|x| c * x))).collect();
            Measure { decides: true, truncated: whole.clone(), whole }
        };
        let lights = Arc::new(measures.iter().map(outer).collect::<Vec<_>>());
        let stacked: Vec<f64> = scales.iter().flat_map(|scale| weights.iter().map(move |x| scale * x)).collect();
        let bands = Bands { starts: vec![0, stacked.len()], areas: vec![1.0; stacked.len()], always: 0, texels: 0 };
        let rule = Truncation::with_weights(stacked, 0, 0.0, quantum, width)?;
        let empty = Survey::new(&bands, &rule, lights)?;
        let count = bundles.clamp(1, self.shape.rows.div_ceil(BUNDLE_ROWS));
        let look = |room: &mut Room, k: usize| -> Result<Survey> {
            let rows = spread(self, k, count);
            let (mut survey, mut row) = (empty.clone(), Vec::with_capacity(columns * factors));
            self.bundle(rows.clone(), room, &mut |factor, planes, _| {
                row.extend_from_slice(planes[0]);
                if factor + 1 == factors {
                    survey.add(&[&row])?;
                    row.clear();
                }
                Ok(())
            })?;
            advance(rows.len() as u64)?;
            Ok(survey)
        };
        let found = (0..count).into_par_iter().map_init(|| self.room(), look).collect::<Result<Vec<_>>>()?;
        let mut whole = empty;
        found.iter().for_each(|survey| whole.merge(survey));
        whole.threshold_for(tolerance)
    }
}

impl Pass for GatherPass {
    type Room = Room;

    fn shape(&self) -> &Shape {
        &self.shape
    }

    fn room(&self) -> Room {
        Room { plane: vec![[0.0; GROUP]; self.shape.bands.columns()], ..Room::default() }
    }

    fn bundle(&self, rows: Range<usize>, room: &mut Room, take: &mut Take) -> Result<Made> {
        let (count, groups) = (self.samples.len(), rows.len().div_ceil(GROUP));
        let Room { segments, rows: all, plane } = room;
        let surfaces = Surfaces { mesh: &self.mesh, tracer: &self.tracer };
        let gather = Gather { surfaces, samples: &self.samples, kernels: &self.kernels, sub_area: SubArea::ByAngle };
        gather.rows(&self.receivers[rows.clone()], segments, all);
        for group in 0..groups {
            for factor in 0..self.shape.factors {
                let first = (factor * groups + group) * count;
                self.tree.project(&all[first..first + count], plane);
                take(factor, &[plane.as_slice()], 0.0)?;
            }
        }
        let pairs = (rows.len() * count) as u64;
        Ok(Made { rays: Rays { first: pairs, ..Rays::default() }, seen: None })
    }
}
