//! What a box must meet to matter to a fan: the cone of the rays that are still open.

// Eight in loops go by index: closures (`map`, iterators) do not inherit the caller's instruction set, and every
// operation inside them would become a call.
#![allow(clippy::needless_range_loop)]

use super::eight::Eight;
use super::fan::{Fan, PACKETS, inverse};
use super::tree::Node;

/// Slack on what is thrown away before edges are looked at, in the normalised scene: more than the width of any edge.
const SLACK: f32 = 2e-6;

/// How far below the apex's plane a triangle's top may lie and still block: more than rounding, less than the lift of
/// receivers.
const FLOOR: f32 = -5e-7;

/// Where the rays of a fan start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Apex {
    /// In the normalised scene.
    pub origin: [f32; 3],
    /// A normal that all rays rise along: what lies below its plane blocks none of them. Zero where there is none.
    pub normal: [f32; 3],
}

impl Apex {
    /// What rounding and lifts are measured in there: 1 in the unit box, and farther off as far as it is.
    fn unit(&self) -> f32 {
        let off = self.origin.iter().fold(0.0f32, |most, x| most.max(x.abs()));
        if off < IN_THE_BOX { 1.0 } else { off }
    }
}

/// Lifted points of the unit box lie in this one.
const IN_THE_BOX: f32 = 1.01;

/// The open rays of a fan as one cone, in the fan's own axes, its apex in the origin.
pub(super) struct Cone {
    pub axes: [usize; 3],
    pub mirrored: [bool; 3],
    /// -1 along mirrored axes.
    pub sign: [f32; 3],
    /// In the axes of space, permuted.
    pub apex: [f32; 3],
    /// The apex's normal, in the fan's own axes.
    pub normal: [f32; 3],
    /// Least and greatest slope along each axis.
    pub slope: [[f32; 2]; 2],
    /// Their inverses, in the same places: the first is the greater.
    inverse: [[f32; 2]; 2],
    /// The nearest and the farthest end of a ray.
    pub far: [f32; 2],
    /// What rounding leaves open of a triangle's place, and of its height over the apex's plane.
    pub slack: f32,
    pub floor: f32,
}

/// Eight boxes in the fan's own axes, seen from the apex.
#[derive(Default)]
#[repr(C, align(32))]
pub(super) struct Boxes {
    /// Ends towards the apex; along the major axis at least 0.
    pub near: [[f32; 8]; 3],
    pub far: [[f32; 8]; 3],
}

impl Cone {
    /// Of no ray yet: `bound` comes next. `reach`: the largest coordinate of the scene.
    #[inline(always)]
    pub(super) fn new(fan: &Fan, from: &Apex, reach: f32) -> Self {
        let (axes, mirrored) = (fan.octant.axes, fan.octant.mirrored);
        let mut cone = Cone {
            axes,
            mirrored,
            sign: [1.0; 3],
            apex: [0.0; 3],
            normal: fan.octant.seen(from.normal),
            slope: [[0.0; 2]; 2],
            inverse: [[0.0; 2]; 2],
            far: [f32::INFINITY; 2],
            slack: SLACK * reach,
            floor: FLOOR * from.unit(),
        };
        for k in 0..3 {
            cone.sign[k] = if mirrored[k] { -1.0 } else { 1.0 };
            cone.apex[k] = from.origin[axes[k]];
        }
        cone
    }

    /// The cone around the open rays, so that a half-closed fan meets less of the tree.
    #[inline(always)]
    pub(super) fn bound<L: Eight>(&mut self, fan: &Fan, open: u64) {
        let out = L::splat(f32::INFINITY);
        let mut bounds = [out; 8];
        for packet in 0..PACKETS {
            let bits = (open >> (8 * packet)) as u32 & 0xff;
            if bits == 0 {
                continue;
            }
            for axis in 0..2 {
                let slope = L::load(&fan.slope[axis][packet]);
                bounds[2 * axis] = bounds[2 * axis].min(L::select(bits, slope, out));
                bounds[2 * axis + 1] = bounds[2 * axis + 1].min(L::select(bits, slope.neg(), out));
            }
            if fan.finite {
                let far = L::load(&fan.far[packet]);
                bounds[4] = bounds[4].min(L::select(bits, far, out));
                bounds[5] = bounds[5].min(L::select(bits, far.neg(), out));
            }
        }
        let mut least = [0.0; 8];
        L::least_each(&bounds).store(&mut least);
        for axis in 0..2 {
            self.slope[axis] = [least[2 * axis], -least[2 * axis + 1]];
            self.inverse[axis] = [inverse(self.slope[axis][0]), inverse(self.slope[axis][1])];
        }
        if fan.finite {
            self.far = [least[4], -least[5]];
        }
    }

    /// The boxes of a node that the cone meets, and those of them that every ray meets; the boxes are left in `boxes`.
    #[inline(always)]
    pub(super) fn meets<L: Eight>(&self, node: &Node, boxes: &mut Boxes) -> (u32, u32) {
        let (mut near, mut far) = ([L::splat(0.0); 3], [L::splat(0.0); 3]);
        for k in 0..3 {
            let (apex, sign) = (L::splat(self.apex[k]), L::splat(self.sign[k]));
            let end = usize::from(self.mirrored[k]);
            near[k] = L::load(&node.bounds[end][self.axes[k]]).sub(apex).mul(sign);
            far[k] = L::load(&node.bounds[1 - end][self.axes[k]]).sub(apex).mul(sign);
        }
        let zero = L::splat(0.0);
        near[2] = near[2].max(zero);

        // Somewhere between its ends the cone's cross-section meets the box: the lower slope at the near end, the upper
        // one at the far end, because slopes are never negative.
        let mut met = zero.le(far[2]) & near[2].le(L::splat(self.far[1]));
        for k in 0..2 {
            let [least, greatest] = self.slope[k];
            met &= L::splat(least).mul(near[2]).le(far[k]) & near[k].le(L::splat(greatest).mul(far[2]));
        }
        if met == 0 {
            return (0, 0);
        }

        // The last ray to enter does so before the first one leaves.
        let (mut enter, mut leave) = (near[2], far[2].min(L::splat(self.far[0])));
        for k in 0..2 {
            let (most, least) = (L::splat(self.inverse[k][0]), L::splat(self.inverse[k][1]));
            enter = enter.max(near[k].mul(most).max(near[k].mul(least)));
            leave = leave.min(far[k].mul(most).min(far[k].mul(least)));
        }
        let whole = met & enter.le(leave);
        if met != whole {
            for k in 0..3 {
                near[k].store(&mut boxes.near[k]);
                far[k].store(&mut boxes.far[k]);
            }
        }
        (met, whole)
    }
}

impl Boxes {
    /// The boxes that one ray of a fan meets.
    #[inline(always)]
    pub(super) fn met_by<L: Eight>(&self, fan: &Fan, ray: usize) -> u32 {
        let (packet, lane) = (ray / 8, ray % 8);
        let mut enter = L::load(&self.near[2]);
        let mut leave = L::load(&self.far[2]).min(L::splat(fan.far[packet][lane]));
        for k in 0..2 {
            let inverse = L::splat(fan.inverse[k][packet][lane]);
            enter = enter.max(L::load(&self.near[k]).mul(inverse));
            leave = leave.min(L::load(&self.far[k]).mul(inverse));
        }
        enter.le(leave)
    }

    /// Those of `rays` that meet one of the boxes: the same arithmetic, eight rays at a time.
    #[inline(always)]
    pub(super) fn rays_in<L: Eight>(&self, place: usize, fan: &Fan, rays: u64) -> u64 {
        let mut inside = 0;
        for packet in 0..PACKETS {
            if (rays >> (8 * packet)) & 0xff == 0 {
                continue;
            }
            let mut enter = L::splat(self.near[2][place]);
            let mut leave = L::splat(self.far[2][place]).min(L::load(&fan.far[packet]));
            for k in 0..2 {
                let inverse = L::load(&fan.inverse[k][packet]);
                enter = enter.max(L::splat(self.near[k][place]).mul(inverse));
                leave = leave.min(L::splat(self.far[k][place]).mul(inverse));
            }
            inside |= u64::from(enter.le(leave)) << (8 * packet);
        }
        inside & rays
    }
}
