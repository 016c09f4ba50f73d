//! What a bundle of 64 receivers sees of the sky, texel by texel: one ray to the centre of every texel above the horizon;
//! where a texel and its neighbour differ, an edge of what the receiver sees runs through one of them, and stratified
//! rays measure how much of each is open.

use std::ops::Range;
use std::sync::Arc;

use crate::error::{Error, Result};
use crate::scene::Receivers;
use crate::scene::rays::{BUNDLE, Bundle, Tracer, Walk};

use super::pass::{BUNDLE_ROWS, Rays};
use super::texels::Texels;

const _: () = assert!(BUNDLE == BUNDLE_ROWS);

/// Most samples along a side of an edge texel.
const MAX_EDGE_SIDE: usize = 16;

/// A texel that an edge runs through: for the receivers in `rows`, the mean of V cos over its samples.
pub(super) struct EdgeTexel {
    /// Its number, row-major, face after face.
    pub texel: u32,
    /// The receivers that see it and a neighbour differently, one bit each.
    pub rows: u64,
    /// For those receivers; 0 for the others.
    pub mean: [f32; BUNDLE],
}

/// What a bundle of 64 receivers sees.
pub(super) struct View {
    /// For each texel the receivers from which its centre is open, one bit each.
    pub open: Vec<u64>,
    /// By texel, ascending.
    pub edges: Vec<EdgeTexel>,
    /// Rays that it took.
    pub rays: Rays,
}

/// Normals of a bundle, one component a list, so that a cosine is taken for all receivers at once.
pub(super) struct Normals([[f32; BUNDLE]; 3]);

impl Normals {
    /// From at most 64 unit normals.
    pub fn new(normals: &[[f32; 3]]) -> Self {
        // Places left over look away from everything: their cosine is never above zero.
        Normals(std::array::from_fn(|axis| std::array::from_fn(|ray| normals.get(ray).map_or(0.0, |n| n[axis]))))
    }

    /// Cosines between a unit direction and the normals from `first` on.
    pub fn cosines(&self, direction: [f32; 3], first: usize, cosines: &mut [f32]) {
        for (k, cosine) in cosines.iter_mut().enumerate() {
            let ray = first + k;
            *cosine = self.0[0][ray] * direction[0] + self.0[1][ray] * direction[1] + self.0[2][ray] * direction[2];
        }
    }

    /// Receivers that have a direction above their horizon.
    fn above(&self, direction: [f32; 3]) -> u64 {
        let mut cosines = [0.0; BUNDLE];
        self.cosines(direction, 0, &mut cosines);
        cosines.iter().enumerate().fold(0, |bits, (ray, &cosine)| bits | ((cosine > 0.0) as u64) << ray)
    }
}

/// Neighbouring directions that are traced together, and the answers.
#[derive(Default)]
struct Beams {
    directions: Vec<[f32; 3]>,
    active: Vec<u64>,
    blocked: Vec<u64>,
}

impl Beams {
    fn clear(&mut self) {
        self.directions.clear();
        self.active.clear();
    }

    fn push(&mut self, direction: [f32; 3], active: u64) {
        self.directions.push(direction);
        self.active.push(active);
    }

    /// Returns how many rays that were.
    fn trace(&mut self, tracer: &Tracer, bundle: &Bundle, walk: &mut Walk) -> u64 {
        self.blocked.clear();
        self.blocked.resize(self.directions.len(), 0);
        tracer.blocked_each(bundle, &self.directions, &self.active, walk, &mut self.blocked);
        self.active.iter().map(|active| u64::from(active.count_ones())).sum()
    }
}

/// Room for looking, kept by each thread.
#[derive(Default)]
pub(super) struct Looking {
    walk: Walk,
    beams: Beams,
}

/// Looks at the sky from the receivers of a scene.
pub(super) struct Visibility {
    tracer: Arc<Tracer>,
    pub receivers: Arc<Receivers>,
    pub texels: Texels,
    /// Edge texels are sampled `edge_side` x `edge_side` times; 0 takes the centre for the whole texel.
    edge_side: usize,
}

impl Visibility {
    /// Refuses edge sampling that no texel needs. `size`: texels along a face.
    pub fn new(tracer: Arc<Tracer>, receivers: Arc<Receivers>, size: usize, edge_side: usize) -> Result<Self> {
        if edge_side > MAX_EDGE_SIDE {
            return Err(Error::input(format!(
                "expected at most {MAX_EDGE_SIDE} x {MAX_EDGE_SIDE} rays for an edge texel, got {edge_side}"
            )));
        }
        Ok(Visibility { tracer, receivers, texels: Texels::new(size), edge_side })
    }

    /// Shoots the rays of one bundle.
    pub(super) fn view(&self, rows: Range<usize>, room: &mut Looking) -> View {
        let normals = Normals::new(&self.receivers.normal[rows.clone()]);
        let bundle = Bundle::new(&self.receivers.origin[rows.clone()], &self.receivers.normal[rows]);
        let count = self.texels.len();
        let mut view = View { open: vec![0; count], edges: Vec::new(), rays: Rays::default() };
        let above: Vec<u64> = self.texels.centre.iter().map(|&direction| normals.above(direction)).collect();
        room.walk.begin();
        for block in &self.texels.blocks {
            room.beams.clear();
            for &texel in block {
                room.beams.push(self.texels.centre[texel as usize], above[texel as usize]);
            }
            view.rays.first += room.beams.trace(&self.tracer, &bundle, &mut room.walk);
            for (&texel, &blocked) in block.iter().zip(&room.beams.blocked) {
                view.open[texel as usize] = above[texel as usize] & !blocked;
                view.rays.open += u64::from(view.open[texel as usize].count_ones());
            }
        }
        if self.edge_side > 0 {
            for block in &self.texels.blocks {
                self.edges(block, &above, &bundle, &normals, room, &mut view);
            }
        }
        view.edges.sort_unstable_by_key(|edge| edge.texel);
        view
    }

    /// Receivers that see this texel and a neighbour above the horizon differently.
    fn unlike_a_neighbour(&self, texel: usize, above: &[u64], open: &[u64]) -> u64 {
        self.texels.neighbours[texel].iter().fold(0, |unlike, &next| {
            let next = next as usize;
            unlike | (open[texel] ^ open[next]) & above[texel] & above[next]
        })
    }

    /// Measures the texels of a block that an edge runs through, all their samples in one go.
    fn edges(
        &self,
        block: &[u32],
        above: &[u64],
        bundle: &Bundle,
        normals: &Normals,
        room: &mut Looking,
        view: &mut View,
    ) {
        let samples = self.edge_side * self.edge_side;
        let first = view.edges.len();
        room.beams.clear();
        for &texel in block {
            let rows = self.unlike_a_neighbour(texel as usize, above, &view.open);
            if rows != 0 {
                view.edges.push(EdgeTexel { texel, rows, mean: [0.0; BUNDLE] });
                for k in 0..samples {
                    let direction = self.texels.sample(texel as usize, self.edge_side, k);
                    room.beams.push(direction, rows & normals.above(direction));
                }
            }
        }
        view.rays.edge += room.beams.trace(&self.tracer, bundle, &mut room.walk);
        let mut cosines = [0.0f32; BUNDLE];
        for (beam, &direction) in room.beams.directions.iter().enumerate() {
            let open = room.beams.active[beam] & !room.beams.blocked[beam];
            normals.cosines(direction, 0, &mut cosines);
            for (ray, sum) in view.edges[first + beam / samples].mean.iter_mut().enumerate() {
                *sum += if open >> ray & 1 == 1 { cosines[ray] / samples as f32 } else { 0.0 };
            }
        }
    }
}
