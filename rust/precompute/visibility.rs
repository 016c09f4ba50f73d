//! What a bundle of 64 receivers sees of the sky, texel by texel: one ray to the centre of every texel above the horizon;
//! where a texel and its neighbour differ, an edge of what the receiver sees runs through one of them, and stratified
//! rays measure how much of each is open.

use std::ops::Range;
use std::sync::Arc;

use crate::error::{Error, Result};
use crate::scene::Points;
use crate::scene::rays::{Apex, FAN, Fan, Octant, Tracer, Walk};

use super::pass::{BUNDLE_ROWS, Rays};
use super::texels::{Block, Sample, Texels};

const _: () = assert!(BUNDLE_ROWS == FAN);

/// Most samples along a side of an edge texel.
const MAX_EDGE_SIDE: usize = 16;

/// A texel that an edge runs through: for the receivers in `rows`, the mean of V cos over its samples.
pub(super) struct EdgeTexel {
    /// Its number, row-major, face after face.
    pub texel: u32,
    /// The receivers that see it and a neighbour differently, one bit each.
    pub rows: u64,
    /// For those receivers; 0 for the others.
    pub mean: [f32; BUNDLE_ROWS],
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
pub(super) struct Normals([[f32; BUNDLE_ROWS]; 3]);

impl Normals {
    /// From at most 64 unit normals.
    pub fn new(normals: &[[f32; 3]]) -> Self {
        // Places left over look away from everything: their cosine is never above zero.
        Normals(std::array::from_fn(|axis| std::array::from_fn(|ray| normals.get(ray).map_or(0.0, |n| n[axis]))))
    }

    /// Cosines between a unit direction and the normals from `first` on.
    pub fn cosines(&self, direction: [f32; 3], first: usize, cosines: &mut [f32]) {
        for (k, cosine) in cosines.iter_mut().enumerate() {
            *cosine = self.cosine(direction, first + k);
        }
    }

    /// The cosine between a unit direction and one normal.
    #[inline(always)]
    pub fn cosine(&self, direction: [f32; 3], ray: usize) -> f32 {
        self.0[0][ray] * direction[0] + self.0[1][ray] * direction[1] + self.0[2][ray] * direction[2]
    }

    /// Receivers that have a direction above their horizon.
    fn above(&self, direction: [f32; 3]) -> u64 {
        let mut cosines = [0.0; BUNDLE_ROWS];
        self.cosines(direction, 0, &mut cosines);
        cosines.iter().enumerate().fold(0, |bits, (ray, &cosine)| bits | ((cosine > 0.0) as u64) << ray)
    }
}

/// Rows and columns of bits change places: bit j of word i goes to bit i of word j (Warren, Hacker's Delight 7.3).
fn transpose(bits: &mut [u64; 64]) {
    let (mut width, mut mask) = (32, 0xffff_ffffu64);
    while width > 0 {
        for k in (0..64).filter(|k| k & width == 0) {
            let swap = (bits[k] >> width ^ bits[k + width]) & mask;
            bits[k] ^= swap << width;
            bits[k + width] ^= swap;
        }
        width /= 2;
        mask ^= mask << width;
    }
}

/// Rays of one receiver into texels that an edge runs through, until a fan is full.
#[derive(Default)]
struct Pending {
    fan: Fan,
    /// For each ray the place of its texel among the view's edges, and what it adds to the mean if it is open.
    parts: Vec<(usize, f32)>,
}

/// Where a bundle looked from, the normals that its cosines are taken to, and what it saw.
type Looked = (Vec<Apex>, Vec<[f32; 3]>, Arc<View>);

/// Room for looking, kept by each thread.
#[derive(Default)]
pub(super) struct Looking {
    walk: Walk,
    pending: Pending,
    /// Of a block: the samples of each of its edge texels, one after the other.
    samples: Vec<Sample>,
    /// Of each texel the receivers whose ray to its centre met something thin; empty where everything is solid.
    thin: Vec<u64>,
    /// Where the last bundle looked from, and what it saw: another factor of the same receivers sees the same.
    last: Option<Looked>,
}

/// Looks at the sky from the receivers of a scene.
pub(super) struct Visibility {
    tracer: Arc<Tracer>,
    pub points: Arc<Points>,
    pub texels: Texels,
    /// Edge texels are sampled `edge_side` x `edge_side` times; 0 takes the centre for the whole texel.
    edge_side: usize,
}

impl Visibility {
    /// Refuses edge sampling that no texel needs. `size`: texels along a face.
    pub fn new(tracer: Arc<Tracer>, points: Arc<Points>, size: usize, edge_side: usize) -> Result<Self> {
        if edge_side > MAX_EDGE_SIDE {
            return Err(Error::input(format!(
                "expected at most {MAX_EDGE_SIDE} x {MAX_EDGE_SIDE} rays for an edge texel, got {edge_side}"
            )));
        }
        Ok(Visibility { tracer, points, texels: Texels::new(size), edge_side })
    }

    /// Shoots the rays of one bundle, unless the one before it in this room had the same receivers.
    pub(super) fn view(&self, rows: Range<usize>, room: &mut Looking) -> Arc<View> {
        let apex = |row: usize| Apex { origin: self.points.origin[row], normal: self.points.rise(row) };
        let apexes: Vec<Apex> = rows.clone().map(apex).collect();
        let normals = &self.points.normal[rows.clone()];
        if let Some((_, _, view)) = room.last.as_ref().filter(|(last, own, _)| *last == apexes && own == normals) {
            return Arc::clone(view);
        }
        let view = Arc::new(self.looked(rows, &apexes, room));
        room.last = Some((apexes, normals.to_vec(), Arc::clone(&view)));
        view
    }

    /// Which directions into one texel, at most 64, a row has open: one bit each.
    pub(super) fn open(&self, row: usize, directions: &[[f32; 3]], room: &mut Looking) -> u64 {
        let (octant, fan) = (Octant::of(directions[0]), &mut room.pending.fan);
        fan.restart(octant);
        directions.iter().for_each(|&direction| fan.push(octant.slopes(direction)));
        let apex = Apex { origin: self.points.origin[row], normal: self.points.normal[row] };
        fan.all() & !self.tracer.blocked(&apex, fan, fan.all(), &mut room.walk)
    }

    fn looked(&self, rows: Range<usize>, apexes: &[Apex], room: &mut Looking) -> View {
        let normals = Normals::new(&self.points.normal[rows.clone()]);
        let count = self.texels.len();
        let mut view = View { open: vec![0; count], edges: Vec::new(), rays: Rays::default() };
        let above: Vec<u64> = self.texels.centre.iter().map(|&direction| normals.above(direction)).collect();
        room.thin.clear();
        room.thin.resize(if self.tracer.is_solid() { 0 } else { count }, 0);
        if self.points.horizon.is_empty() {
            self.all_centres(apexes, &above, room, &mut view);
        } else {
            // What rises over the normal and not over the triangle is closed, and has an edge towards what is open.
            let horizon = Normals::new(&self.points.horizon[rows.clone()]);
            let risen = self.texels.centre.iter().zip(&above).map(|(&way, &above)| above & horizon.above(way));
            self.all_centres(apexes, &risen.collect::<Vec<u64>>(), room, &mut view);
        }
        if self.edge_side > 0 {
            for block in &self.texels.blocks {
                self.edges(block, rows.start, apexes, &above, room, &mut view);
            }
        }
        view.edges.sort_unstable_by_key(|edge| edge.texel);
        view
    }

    fn all_centres(&self, apexes: &[Apex], above: &[u64], room: &mut Looking, view: &mut View) {
        for block in &self.texels.blocks {
            self.centres(block, apexes, above, room, view);
        }
    }

    /// The rays to the centres of a block's texels, one fan a receiver.
    fn centres(&self, block: &Block, apexes: &[Apex], above: &[u64], room: &mut Looking, view: &mut View) {
        let mut bits = [0; 64];
        for (bits, &texel) in bits.iter_mut().zip(&block.texels) {
            *bits = above[texel as usize];
        }
        transpose(&mut bits);
        let mut thin = [0; 64];
        for (receiver, (bits, apex)) in bits.iter_mut().zip(apexes).enumerate() {
            view.rays.first += u64::from(bits.count_ones());
            *bits &= !self.tracer.blocked(apex, &block.centres, *bits, &mut room.walk);
            view.rays.open += u64::from(bits.count_ones());
            if !room.thin.is_empty() {
                thin[receiver] = room.walk.thin;
            }
        }
        if !room.thin.is_empty() {
            transpose(&mut thin);
            block.texels.iter().zip(thin).for_each(|(&texel, thin)| room.thin[texel as usize] = thin);
        }
        transpose(&mut bits);
        for (bits, &texel) in bits.iter().zip(&block.texels) {
            view.open[texel as usize] = *bits;
        }
    }

    /// Receivers that see this texel and a neighbour above the horizon differently, or whose ray there met something thin:
    /// were it only looked at closely where rays have found otherwise, the mean would not be kept.
    fn unlike_a_neighbour(&self, texel: usize, above: &[u64], open: &[u64], thin: &[u64]) -> u64 {
        let thin = thin.get(texel).copied().unwrap_or(0);
        self.texels.neighbours[texel].iter().fold(thin, |unlike, &next| {
            let next = next as usize;
            unlike | (open[texel] ^ open[next]) & above[texel] & above[next]
        })
    }

    /// Measures the texels of a block that an edge runs through: for each receiver, the samples of all its edge texels,
    /// as many fans as that takes.
    fn edges(&self, block: &Block, start: usize, apexes: &[Apex], above: &[u64], room: &mut Looking, view: &mut View) {
        let Looking { walk, pending, samples: inside, thin, .. } = room;
        let samples = self.edge_side * self.edge_side;
        let first = view.edges.len();
        let mut bits = [0; 64];
        inside.clear();
        for &texel in &block.texels {
            let rows = self.unlike_a_neighbour(texel as usize, above, &view.open, thin);
            if rows != 0 {
                bits[view.edges.len() - first] = rows;
                view.edges.push(EdgeTexel { texel, rows, mean: [0.0; BUNDLE_ROWS] });
                let sample = |k| self.texels.sample(texel as usize, &block.octant, self.edge_side, k);
                inside.extend((0..samples).map(sample));
            }
        }
        if view.edges.len() == first {
            return;
        }
        transpose(&mut bits);
        pending.fan.restart(block.octant);
        for (receiver, (&texels, apex)) in bits.iter().zip(apexes).enumerate() {
            let [x, y, z] = self.points.normal[start + receiver];
            let horizon = self.points.horizon.get(start + receiver).copied();
            let mut left = texels;
            while left != 0 {
                let edge = left.trailing_zeros() as usize;
                left &= left - 1;
                for sample in &inside[edge * samples..(edge + 1) * samples] {
                    let [dx, dy, dz] = sample.direction;
                    let cosine = x * dx + y * dy + z * dz;
                    if cosine > 0.0 && horizon.is_none_or(|[x, y, z]| x * dx + y * dy + z * dz > 0.0) {
                        pending.fan.push(sample.slopes);
                        pending.parts.push((first + edge, cosine / samples as f32));
                        if pending.fan.is_full() {
                            self.flush(apex, receiver, pending, walk, view);
                        }
                    }
                }
            }
            self.flush(apex, receiver, pending, walk, view);
        }
    }

    /// Traces what is pending and adds what is open to its texels.
    fn flush(&self, apex: &Apex, receiver: usize, pending: &mut Pending, walk: &mut Walk, view: &mut View) {
        let all = pending.fan.all();
        view.rays.edge += pending.fan.len() as u64;
        let mut open = all & !self.tracer.blocked(apex, &pending.fan, all, walk);
        while open != 0 {
            let (edge, part) = pending.parts[open.trailing_zeros() as usize];
            open &= open - 1;
            view.edges[edge].mean[receiver] += part;
        }
        pending.fan.clear();
        pending.parts.clear();
    }
}
