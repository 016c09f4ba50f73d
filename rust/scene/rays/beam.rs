//! Occlusion of parallel beams: up to 64 rays of one direction, from neighbouring receivers, in one walk of the tree.
//!
//! Precomputation shoots every direction of a cubemap from every receiver, so rays come in bundles that share their
//! direction. Seen along that direction a triangle is a flat figure and a ray is a point: a box is met when its shadow
//! meets the bundle's rectangle, and a triangle blocks a ray when three edge functions agree and it lies in front. The
//! walk is paid once for 64 rays and nothing is divided.
//!
//! Watertight by construction: a vertex is projected the same way in every triangle that uses it, an edge function
//! changes its sign and nothing else with the order of its ends, and a point within the rounding error of an edge counts
//! as inside.
//!
//! Tried and kept: a block of neighbouring directions starts from what its shaft meets (`shaft.rs`), and each box on the
//! stack comes with the rays that lie in it, so that small triangles are met by few rays.
//!
//! Tried and dropped: packets of eight rays over obvhs's binary nodes (two to four times slower), and going ray by ray
//! where triangles are small.

// By index, as in `reach.rs`.
#![allow(clippy::needless_range_loop)]

use super::bundle::{Bundle, PACKETS};
#[cfg(target_arch = "x86_64")]
use super::eight::Avx2;
use super::eight::{Eight, Portable};
use super::reach::{BeamFrame, Boxes, LEAF, Node, Reach, SLACK, WideTree};
use super::shadow::Shadow;
use super::shaft::Shaft;

/// The same for heights over a bundle's plane: more than their rounding, less than the lift of receivers.
const FLOOR: f32 = 5e-7;

/// Bundle origins seen along the direction, and the boxes around those that are still open.
pub(super) struct Beam<L> {
    /// u, v, depth, and height over the patch's plane, of each packet of eight rays.
    pub(super) at: [[[f32; 8]; PACKETS]; 4],
    rises: bool,
    /// What boxes and triangles must meet.
    pub(super) reach: Reach<L>,
    /// The bounds of each packet, one packet a lane.
    packet_low: [[f32; 8]; 3],
    packet_high: [[f32; 8]; 2],
    packet_floor: [f32; 8],
    /// The rays that the packets' bounds were made for.
    packets_of: u64,
}

impl<L: Eight> Beam<L> {
    #[inline(always)]
    fn new(bundle: &Bundle, frame: &BeamFrame, active: u64) -> Self {
        let reach = Reach::<L>::new(frame);
        let mut at = [[[0.0; 8]; PACKETS]; 4];
        for packet in 0..PACKETS {
            if (active >> (8 * packet)) & 0xff == 0 {
                continue;
            }
            let (x, y, z) = (
                L::load(&bundle.origin[0][packet]),
                L::load(&bundle.origin[1][packet]),
                L::load(&bundle.origin[2][packet]),
            );
            for k in 0..3 {
                L::dot(x, y, z, &reach.axes[k]).store(&mut at[k][packet]);
            }
            L::dot(x, y, z, &reach.up).store(&mut at[3][packet]);
        }
        Beam {
            at,
            rises: frame.rises,
            reach,
            packet_low: [[0.0; 8]; 3],
            packet_high: [[0.0; 8]; 2],
            packet_floor: [f32::NEG_INFINITY; 8],
            packets_of: 0,
        }
    }

    /// The rectangle around the open rays, so that a half-closed bundle meets less of the tree.
    #[inline(always)]
    fn bound(&mut self, open: u64, behind: [f32; 3]) {
        let out = L::splat(f32::INFINITY);
        let mut bounds = [out; 8];
        for packet in 0..PACKETS {
            let bits = (open >> (8 * packet)) as u32 & 0xff;
            if bits == 0 {
                continue;
            }
            for k in 0..4 {
                let at = L::load(&self.at[k][packet]);
                bounds[k] = bounds[k].min(L::select(bits, at, out));
                bounds[4 + k] = bounds[4 + k].min(L::select(bits, at.neg(), out));
            }
        }
        let mut least = [0.0; 8];
        L::least_each(&bounds).store(&mut least);
        for k in 0..3 {
            self.reach.low[k] = least[k] - SLACK;
            self.reach.high[k] = SLACK - least[4 + k];
        }
        self.reach.behind = behind;
        if self.rises {
            self.reach.floor = least[3] - FLOOR;
            self.reach.ceiling = -least[7];
        }
    }

    /// The same for each packet: only leaves need it.
    #[inline(always)]
    fn bound_packets(&mut self, open: u64) {
        self.packets_of = open;
        let out = L::splat(f32::INFINITY);
        for k in 0..4 {
            let (mut low, mut high) = ([out; 8], [out; 8]);
            for packet in 0..PACKETS {
                let bits = (open >> (8 * packet)) as u32 & 0xff;
                if bits == 0 {
                    continue;
                }
                let at = L::load(&self.at[k][packet]);
                low[packet] = L::select(bits, at, out);
                high[packet] = L::select(bits, at.neg(), out);
            }
            if k < 3 {
                L::least_each(&low).sub(L::splat(SLACK)).store(&mut self.packet_low[k]);
            } else if self.rises {
                L::least_each(&low).sub(L::splat(FLOOR)).store(&mut self.packet_floor);
            }
            if k < 2 {
                L::splat(SLACK).sub(L::least_each(&high)).store(&mut self.packet_high[k]);
            }
        }
    }

    /// Packets whose bounds meet a box in u and v that reaches so far and so high.
    #[inline(always)]
    pub(super) fn packets_near(&self, low: &[L; 2], high: &[L; 3], top: L) -> u32 {
        let mut packets = L::load(&self.packet_low[2]).le(high[2]) & L::load(&self.packet_floor).le(top);
        for k in 0..2 {
            packets &= L::load(&self.packet_low[k]).le(high[k]) & low[k].le(L::load(&self.packet_high[k]));
        }
        packets
    }
}

impl<L: Eight> Beam<L> {
    /// Those of `rays` that lie within one of eight boxes.
    #[inline(always)]
    fn rays_in(&self, boxes: &BoxArrays, place: usize, rays: u64) -> u64 {
        let low = [L::splat(boxes.low[0][place]), L::splat(boxes.low[1][place])];
        let high = [L::splat(boxes.high[0][place]), L::splat(boxes.high[1][place]), L::splat(f32::INFINITY)];
        let mut packets = self.packets_near(&low, &high, L::splat(boxes.high[2][place]));
        let (low, high) = (
            [low[0].sub(L::splat(SLACK)), low[1].sub(L::splat(SLACK))],
            [high[0].add(L::splat(SLACK)), high[1].add(L::splat(SLACK))],
        );
        let mut inside = 0;
        while packets != 0 {
            let packet = packets.trailing_zeros() as usize;
            packets &= packets - 1;
            let (u, v) = (L::load(&self.at[0][packet]), L::load(&self.at[1][packet]));
            let hit = low[0].le(u) & u.le(high[0]) & low[1].le(v) & v.le(high[1]);
            inside |= (hit as u64) << (8 * packet);
        }
        inside & rays
    }

    /// The boxes that one ray lies in.
    #[inline(always)]
    fn boxes_at(&self, boxes: &Boxes<L>, ray: usize) -> u32 {
        let (u, v) = (self.at[0][ray / 8][ray % 8], self.at[1][ray / 8][ray % 8]);
        boxes.low[0].le(L::splat(u + SLACK))
            & L::splat(u - SLACK).le(boxes.high[0])
            & boxes.low[1].le(L::splat(v + SLACK))
            & L::splat(v - SLACK).le(boxes.high[1])
    }
}

/// `Boxes` in memory.
#[repr(C, align(32))]
struct BoxArrays {
    low: [[f32; 8]; 2],
    high: [[f32; 8]; 3],
}

/// Where the walks of a block of directions start: boxes in nodes of eight.
#[derive(Default)]
pub(super) struct Starts {
    nodes: Vec<Node>,
    /// Boxes (node, child) that are leaves, and those that are not.
    pub(super) leaves: Vec<(u32, u32)>,
    /// Inner boxes, which the walk goes on from.
    pub(super) queue: Vec<(u32, u32)>,
}

impl Starts {
    /// Forgets the last block, and keeps the memory.
    pub(super) fn clear(&mut self) {
        self.nodes.clear();
        self.leaves.clear();
        self.queue.clear();
    }

    /// The walk starts from the root.
    fn root(&mut self, tree: &WideTree) {
        self.clear();
        self.nodes.push(tree.nodes[0].clone());
    }

    /// Copies the leaves and the queue from `next` on into nodes.
    pub(super) fn fill(&mut self, tree: &WideTree, next: usize) {
        for (place, &(from, slot)) in self.leaves.iter().chain(&self.queue[next..]).enumerate() {
            if place % 8 == 0 {
                self.nodes.push(Node::empty());
            }
            let (from, slot) = (&tree.nodes[from as usize], slot as usize);
            let to = &mut self.nodes[place / 8];
            for axis in 0..3 {
                to.centre[axis][place % 8] = from.centre[axis][slot];
                to.half[axis][place % 8] = from.half[axis][slot];
            }
            to.child[place % 8] = from.child[slot];
        }
    }
}

/// Room for the walk, kept between calls.
#[derive(Default)]
pub struct Walk {
    stack: Vec<(u32, u64)>,
    shadow: Shadow,
    starts: Starts,
    /// The leaf that last covered a whole beam: the next direction tries it first.
    cover: Option<u32>,
}

impl Walk {
    /// Forgets what the last bundle met.
    pub fn begin(&mut self) {
        self.cover = None;
    }
}

#[inline(always)]
fn walk<L: Eight>(
    tree: &WideTree,
    bundle: &Bundle,
    directions: &[[f32; 3]],
    active: &[u64],
    room: &mut Walk,
    blocked: &mut [u64],
) {
    blocked.fill(0);
    if tree.nodes.is_empty() {
        return;
    }
    let mut any = 0;
    for &rays in active {
        any |= rays;
    }
    for &(patch, normal) in &bundle.patches {
        if patch & any == 0 {
            continue;
        }
        let (low, high) = bundle.bounds(patch & any);
        let shaft = if directions.len() > 1 {
            Shaft::<L>::new(bundle, normal, directions, patch & any, (low, high))
        } else {
            None
        };
        match shaft {
            Some(shaft) => shaft.gather(tree, &mut room.starts),
            None => room.starts.root(tree),
        }
        if room.starts.nodes.is_empty() {
            continue;
        }
        for k in 0..directions.len() {
            if patch & active[k] != 0 {
                let (mut behind, direction) = ([0.0; 3], directions[k]);
                for axis in 0..3 {
                    behind[axis] = if direction[axis] >= 0.0 { low[axis] } else { -high[axis] } - SLACK;
                }
                let mut beam = Beam::<L>::new(bundle, &BeamFrame::new(directions[k], normal), patch & active[k]);
                blocked[k] |= blocked_along(tree, &mut beam, patch & active[k], behind, room);
            }
        }
    }
}

/// The walk of one patch in one direction: box by box, until every ray is blocked or nothing is left. Each box on the
/// stack comes with the rays that lie in it.
#[inline(always)]
fn blocked_along<L: Eight>(tree: &WideTree, beam: &mut Beam<L>, active: u64, behind: [f32; 3], room: &mut Walk) -> u64 {
    beam.bound(active, behind);
    beam.packets_of = 0;
    room.stack.clear();
    for start in 0..room.starts.nodes.len() {
        push_children(tree, &room.starts.nodes[start], beam, active, active, &mut room.stack);
    }
    if room.stack.is_empty() {
        return 0;
    }
    if let Some(cover) = room.cover {
        room.stack.push((cover, active));
    }
    let mut open = active;
    let mut bounded = active.count_ones();
    while let Some((place, rays)) = room.stack.pop() {
        let rays = rays & open;
        if rays == 0 {
            continue;
        }
        if place & LEAF == 0 {
            push_children(tree, &tree.nodes[place as usize], beam, rays, open, &mut room.stack);
            continue;
        }
        let (met, covering) = room.shadow.cast(&tree.leaves[(place & !LEAF) as usize], &beam.reach, rays.count_ones());
        if covering != 0 {
            room.cover = Some(place);
            return active;
        }
        if met == 0 {
            continue;
        }
        if rays.count_ones() < PRICE * met.count_ones() {
            open &= !room.shadow.blocked_rays(met, rays, beam);
        } else {
            if beam.packets_of == 0 {
                beam.bound_packets(open);
            }
            open &= !room.shadow.blocked_packets(met, beam, rays);
        }
        if open == 0 {
            return active;
        }
        // Once half of the rays are blocked, the rest lie in a smaller rectangle.
        if 2 * open.count_ones() <= bounded {
            bounded = open.count_ones();
            beam.bound(open, behind);
            beam.packets_of = 0;
        }
    }
    active & !open
}

/// What one triangle against its packets costs, in rays against eight triangles.
const PRICE: u32 = 8;

/// With fewer rays, each is held against eight boxes; with more, each box against packets of rays.
const SCATTERED: u32 = 8;

#[inline(always)]
fn push<L: Eight>(tree: &WideTree, place: u32, rays: u64, stack: &mut Vec<(u32, u64)>) {
    let number = (place & !LEAF) as usize;
    if place & LEAF == 0 {
        L::prefetch(&tree.nodes[number]);
    } else {
        L::prefetch(&tree.leaves[number]);
    }
    stack.push((place, rays));
}

/// Pushes the boxes of a node that any of the `rays` lies in.
#[inline(always)]
fn push_children<L: Eight>(
    tree: &WideTree,
    node: &Node,
    beam: &mut Beam<L>,
    rays: u64,
    open: u64,
    stack: &mut Vec<(u32, u64)>,
) {
    let boxes = beam.reach.project(node);
    let (mut met, mut whole) = beam.reach.meets(&boxes);
    met &= !whole;
    while whole != 0 {
        push::<L>(tree, node.child[whole.trailing_zeros() as usize], rays, stack);
        whole &= whole - 1;
    }
    if met == 0 {
        return;
    }
    if rays.count_ones() < SCATTERED {
        let mut inside = [0u64; 8];
        let mut left = rays;
        let mut any = 0;
        while left != 0 {
            let ray = left.trailing_zeros() as usize;
            left &= left - 1;
            let mut at = met & beam.boxes_at(&boxes, ray);
            any |= at;
            while at != 0 {
                inside[at.trailing_zeros() as usize] |= 1 << ray;
                at &= at - 1;
            }
        }
        while any != 0 {
            let place = any.trailing_zeros() as usize;
            any &= any - 1;
            push::<L>(tree, node.child[place], inside[place], stack);
        }
        return;
    }
    if beam.packets_of == 0 {
        beam.bound_packets(open);
    }
    let mut stored = BoxArrays { low: [[0.0; 8]; 2], high: [[0.0; 8]; 3] };
    for k in 0..3 {
        boxes.high[k].store(&mut stored.high[k]);
        if k < 2 {
            boxes.low[k].store(&mut stored.low[k]);
        }
    }
    while met != 0 {
        let place = met.trailing_zeros() as usize;
        met &= met - 1;
        let inside = beam.rays_in(&stored, place, rays);
        if inside != 0 {
            push::<L>(tree, node.child[place], inside, stack);
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn walk_avx2(
    tree: &WideTree,
    bundle: &Bundle,
    directions: &[[f32; 3]],
    active: &[u64],
    room: &mut Walk,
    blocked: &mut [u64],
) {
    walk::<Avx2>(tree, bundle, directions, active, room, blocked)
}

/// The portable walk: what processors without AVX2 take, and the oracle of the other.
pub fn blocked_portable(
    tree: &WideTree,
    bundle: &Bundle,
    directions: &[[f32; 3]],
    active: &[u64],
    room: &mut Walk,
    blocked: &mut [u64],
) {
    walk::<Portable>(tree, bundle, directions, active, room, blocked)
}

/// For each of some neighbouring unit directions, which of its `active` rays (one bit each) of a bundle meet a triangle.
pub fn blocked(
    tree: &WideTree,
    bundle: &Bundle,
    directions: &[[f32; 3]],
    active: &[u64],
    room: &mut Walk,
    blocked: &mut [u64],
) {
    debug_assert!(directions.len() == active.len() && directions.len() == blocked.len());
    #[cfg(target_arch = "x86_64")]
    if std::is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has AVX2.
        return unsafe { walk_avx2(tree, bundle, directions, active, room, blocked) };
    }
    blocked_portable(tree, bundle, directions, active, room, blocked)
}
