//! The part of space that the rays of a patch pass through over a whole block of directions, and what of the tree it meets.
//!
//! Neighbouring directions meet nearly the same boxes. The tree is walked from its root once for a block of directions;
//! the walks of the directions start from what that left, usually nothing: most of a hemisphere is open.

// By index, as in `reach.rs`.
#![allow(clippy::needless_range_loop)]

use super::beam::Starts;
use super::bundle::{Bundle, PACKETS};
use super::eight::Eight;
use super::reach::{BeamFrame, LEAF, Node, SLACK, WideTree, abs, load, splat};

/// Boxes that the walks of a block start from, at most about so many.
const STARTS: usize = 32;

/// Directions farther than this from the middle of their block (in tangents) are walked from the root.
const WIDEST: f32 = 1.0;

/// Covers the rounding of slopes, over the depth of the scene.
const SLOPE_SLACK: f32 = 1e-6;

const PLANES: usize = 6;

/// Half-spaces `normal . x <= limit` that hold every point of every ray.
pub(super) struct Shaft<L> {
    normal: [[L; 3]; PLANES],
    limit: [f32; PLANES],
    /// Along each axis of space that all directions follow the same way: no ray comes before `behind`.
    sign: [f32; 3],
    behind: [f32; 3],
}

impl<L: Eight> Shaft<L> {
    /// The shaft of the rays `active` of a bundle, or none where the directions lie too far apart for one.
    ///
    /// With w the middle direction and slopes (d.u / d.w, d.v / d.w) in [low, high], a ray from o stays within
    /// (x - o).(u - high w) <= 0 <= (x - o).(u - low w), the same in v, and (x - o).w >= 0.
    #[inline(always)]
    pub(super) fn new(
        bundle: &Bundle,
        normal: [f32; 3],
        directions: &[[f32; 3]],
        active: u64,
        bounds: ([f32; 3], [f32; 3]),
    ) -> Option<Self> {
        let mut middle = [0.0f32; 3];
        for direction in directions {
            for axis in 0..3 {
                middle[axis] += direction[axis];
            }
        }
        let length = dot(middle, middle).sqrt();
        if length <= 0.5 * directions.len() as f32 {
            return None;
        }
        let BeamFrame { axes: [u, v, w], .. } = BeamFrame::new(middle.map(|m| m / length), normal);
        let (mut low, mut high, mut rises) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2], true);
        for &direction in directions {
            let along = dot(direction, w);
            for (k, axis) in [u, v].into_iter().enumerate() {
                let slope = dot(direction, axis) / along;
                if !(along > 0.0 && slope.abs() <= WIDEST) {
                    return None;
                }
                low[k] = low[k].min(slope - SLOPE_SLACK);
                high[k] = high[k].max(slope + SLOPE_SLACK);
            }
            rises &= dot(direction, normal) >= 0.0;
        }
        let lean = |axis: [f32; 3], slope: f32, sign: f32| std::array::from_fn(|k| sign * (axis[k] - slope * w[k]));
        // Where some direction sinks, the plane of the surface bounds nothing and the last place repeats the one before.
        let back = w.map(|x| -x);
        let normals = [
            lean(u, high[0], 1.0),
            lean(u, low[0], -1.0),
            lean(v, high[1], 1.0),
            lean(v, low[1], -1.0),
            back,
            if rises { normal.map(|x| -x) } else { back },
        ];
        let mut shaft = Self::around(bundle, &normals, active);
        for axis in 0..3 {
            if directions.iter().all(|direction| direction[axis] >= 0.0) {
                shaft.behind[axis] = bounds.0[axis] - SLACK;
            } else if directions.iter().all(|direction| direction[axis] <= 0.0) {
                shaft.sign[axis] = -1.0;
                shaft.behind[axis] = -bounds.1[axis] - SLACK;
            }
        }
        Some(shaft)
    }

    /// The limits: no ray starts beyond them, and rays lead inwards.
    #[inline(always)]
    fn around(bundle: &Bundle, normals: &[[f32; 3]; PLANES], active: u64) -> Self {
        let mut shaft = Shaft {
            normal: [[L::splat(0.0); 3]; PLANES],
            limit: [0.0; PLANES],
            sign: [1.0; 3],
            behind: [f32::NEG_INFINITY; 3],
        };
        let mut nearest = [L::splat(f32::INFINITY); 8];
        for k in 0..PLANES {
            shaft.normal[k] = splat(&normals[k]);
            for packet in 0..PACKETS {
                let bits = (active >> (8 * packet)) as u32 & 0xff;
                let at = L::dot(
                    L::load(&bundle.origin[0][packet]),
                    L::load(&bundle.origin[1][packet]),
                    L::load(&bundle.origin[2][packet]),
                    &shaft.normal[k],
                );
                nearest[k] = nearest[k].min(L::select(bits, at.neg(), L::splat(f32::INFINITY)));
            }
        }
        let mut limits = [0.0; 8];
        L::least_each(&nearest).store(&mut limits);
        for k in 0..PLANES {
            // Leaning normals are up to sqrt(2) long, and so is their rounding.
            shaft.limit[k] = 2.0 * SLACK - limits[k];
        }
        shaft
    }

    #[inline(always)]
    fn children_met(&self, node: &Node) -> u32 {
        let centre: [L; 3] = load(&node.centre);
        let half: [L; 3] = load(&node.half);
        let mut met = 0xff;
        for k in 0..PLANES {
            let middle = L::dot(centre[0], centre[1], centre[2], &self.normal[k]);
            let extent = L::dot(half[0], half[1], half[2], &abs(&self.normal[k]));
            met &= middle.sub(extent).le(L::splat(self.limit[k]));
        }
        for axis in 0..3 {
            let front = centre[axis].mul(L::splat(self.sign[axis])).add(half[axis]);
            met &= L::splat(self.behind[axis]).le(front);
        }
        met
    }

    /// The boxes that the shaft meets, level by level until there are many, gathered into nodes of eight.
    #[inline(always)]
    pub(super) fn gather(&self, tree: &WideTree, starts: &mut Starts) {
        starts.clear();
        // A queue of boxes (node, child): those before `next` have been opened or are leaves.
        let mut next = 0;
        let mut boxes = self.children_met(&tree.nodes[0]);
        let mut node = 0;
        loop {
            while boxes != 0 {
                let slot = boxes.trailing_zeros();
                boxes &= boxes - 1;
                let leaf = tree.nodes[node as usize].child[slot as usize] & LEAF != 0;
                if leaf { starts.leaves.push((node, slot)) } else { starts.queue.push((node, slot)) }
            }
            if next == starts.queue.len() || starts.leaves.len() + starts.queue.len() - next >= STARTS {
                break;
            }
            let (parent, slot) = starts.queue[next];
            next += 1;
            node = tree.nodes[parent as usize].child[slot as usize];
            boxes = self.children_met(&tree.nodes[node as usize]);
        }
        starts.fill(tree, next);
    }
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
