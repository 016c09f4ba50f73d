//! Triangles seen along a beam: flat figures with edge functions, and which rays (points) lie inside them.

// By index, as in `reach.rs`.
#![allow(clippy::needless_range_loop)]

use super::beam::Beam;
use super::eight::Eight;
use super::reach::{Reach, SLACK, load};

/// Relative width of an edge that still counts as inside: a few units in the last place.
const EDGE: f32 = 4.8e-7;

/// So few rays are not held against the edges as one rectangle first.
const SINGLE: u32 = 4;

/// Up to eight triangles, `corner[k][axis][triangle]`; a place that is not used repeats one point and blocks nothing.
#[repr(C, align(32))]
#[derive(Clone)]
pub(super) struct Leaf {
    /// In the normalised scene.
    pub corner: [[[f32; 8]; 3]; 3],
}

/// Eight triangles seen along the beam, their corners counterclockwise.
#[repr(C, align(32))]
#[derive(Default)]
pub(super) struct Shadow {
    /// u, v and depth of the corners: `corner[k][axis]`.
    corner: [[[f32; 8]; 3]; 3],
    /// Minus the rounding error of the edge from corner k to k + 1.
    tolerance: [[f32; 8]; 3],
    /// The box around the shadow: u, v, and the farthest depth.
    low: [[f32; 8]; 2],
    high: [[f32; 8]; 3],
    /// The greatest height over the plane of the beam's origins.
    top: [f32; 8],
}

#[inline(always)]
fn square<L: Eight>(of: [L; 2]) -> L {
    of[0].mul(of[0]).add(of[1].mul(of[1]))
}

/// Twice the area between the origin, `from` and `to`: exactly the opposite from `to` to `from`.
#[inline(always)]
fn turn<L: Eight>(from: [L; 2], to: [L; 2]) -> L {
    from[0].mul(to[1]).sub(from[1].mul(to[0]))
}

impl Shadow {
    /// Projects a leaf's triangles; returns those that the rectangle may meet and those that cover all of it in front.
    #[inline(always)]
    pub(super) fn cast<L: Eight>(&mut self, leaf: &Leaf, reach: &Reach<L>, rays: u32) -> (u32, u32) {
        let mut top = L::splat(f32::NEG_INFINITY);
        let mut corner = [[L::splat(0.0); 3]; 3];
        for k in 0..3 {
            let [x, y, z]: [L; 3] = load(&leaf.corner[k]);
            top = top.max(L::dot(x, y, z, &reach.up));
            for axis in 0..3 {
                corner[k][axis] = L::dot(x, y, z, &reach.axes[axis]);
            }
        }

        // The box of the shadow against the rectangle, and the farthest corner against the nearest ray.
        let mut met = L::splat(reach.floor).le(top);
        for k in 0..2 {
            let low = corner[0][k].min(corner[1][k]).min(corner[2][k]);
            let high = corner[0][k].max(corner[1][k]).max(corner[2][k]);
            met &= low.le(L::splat(reach.high[k])) & L::splat(reach.low[k]).le(high);
            low.store(&mut self.low[k]);
            high.store(&mut self.high[k]);
        }
        let far = corner[0][2].max(corner[1][2]).max(corner[2][2]);
        met &= L::splat(reach.low[2]).lt(far);
        if met == 0 {
            return (0, 0);
        }
        far.store(&mut self.high[2]);
        top.store(&mut self.top);
        met &= self.orient(&mut corner);
        if met == 0 || rays <= SINGLE { (met, 0) } else { self.against_rectangle(&corner, reach, met) }
    }

    /// Puts the corners in order and stores them; returns the triangles that are not seen edge-on. Those block nothing:
    /// their neighbours' edges hold the rounding error.
    #[inline(always)]
    fn orient<L: Eight>(&mut self, corner: &mut [[L; 3]; 3]) -> u32 {
        let first = [corner[1][0].sub(corner[0][0]), corner[1][1].sub(corner[0][1])];
        let last = [corner[2][0].sub(corner[0][0]), corner[2][1].sub(corner[0][1])];
        let area = turn(first, last);
        let clockwise = area.lt(L::splat(0.0));
        for axis in 0..3 {
            let (one, two) = (corner[1][axis], corner[2][axis]);
            corner[1][axis] = L::select(clockwise, two, one);
            corner[2][axis] = L::select(clockwise, one, two);
        }
        for k in 0..3 {
            let (from, to) = (&corner[k], &corner[(k + 1) % 3]);
            let width = L::splat(-EDGE).mul(square([to[0].sub(from[0]), to[1].sub(from[1])]));
            width.store(&mut self.tolerance[k]);
            for axis in 0..3 {
                from[axis].store(&mut self.corner[k][axis]);
            }
        }
        L::splat(EDGE).mul(square(first).max(square(last))).lt(area.abs())
    }

    /// The whole rectangle beyond one edge: not met. Inside all three and in front: everything is blocked.
    #[inline(always)]
    fn against_rectangle<L: Eight>(&self, corner: &[[L; 3]; 3], reach: &Reach<L>, mut met: u32) -> (u32, u32) {
        let middle = [L::splat(0.5 * (reach.low[0] + reach.high[0])), L::splat(0.5 * (reach.low[1] + reach.high[1]))];
        let radius = [
            L::splat(0.5 * (reach.high[0] - reach.low[0]) + SLACK),
            L::splat(0.5 * (reach.high[1] - reach.low[1]) + SLACK),
        ];
        let near = corner[0][2].min(corner[1][2]).min(corner[2][2]);
        let mut covered = L::splat(reach.high[2]).lt(near);
        let mut from = [corner[0][0].sub(middle[0]), corner[0][1].sub(middle[1])];
        for k in 0..3 {
            let next = &corner[(k + 1) % 3];
            let to = [next[0].sub(middle[0]), next[1].sub(middle[1])];
            let value = turn(from, to);
            let extent = to[1].sub(from[1]).abs().mul(radius[0]).add(to[0].sub(from[0]).abs().mul(radius[1]));
            let tolerance = L::load(&self.tolerance[k]);
            met &= tolerance.le(value.add(extent));
            covered &= tolerance.neg().lt(value.sub(extent));
            from = to;
        }
        (met, covered & met)
    }

    /// Those of `rays` that any of the `met` triangles blocks, one triangle after the other.
    #[inline(always)]
    pub(super) fn blocked_packets<L: Eight>(&self, mut met: u32, beam: &Beam<L>, rays: u64) -> u64 {
        let mut blocked = 0;
        while met != 0 {
            blocked |= self.blocked_by(met.trailing_zeros() as usize, beam, rays & !blocked);
            met &= met - 1;
        }
        blocked
    }

    /// Those of `rays` that any of the `met` triangles blocks, one ray against eight triangles at a time.
    #[inline(always)]
    pub(super) fn blocked_rays<L: Eight>(&self, met: u32, mut rays: u64, beam: &Beam<L>) -> u64 {
        let mut blocked = 0;
        while rays != 0 {
            let ray = rays.trailing_zeros() as usize;
            rays &= rays - 1;
            let (u, v, t) = (
                L::splat(beam.at[0][ray / 8][ray % 8]),
                L::splat(beam.at[1][ray / 8][ray % 8]),
                L::splat(beam.at[2][ray / 8][ray % 8]),
            );
            let (mut inside, mut ahead) = (met, L::splat(0.0));
            for k in 0..3 {
                let (from, to, opposite) = (&self.corner[k], &self.corner[(k + 1) % 3], &self.corner[(k + 2) % 3]);
                let edge = turn(
                    [L::load(&from[0]).sub(u), L::load(&from[1]).sub(v)],
                    [L::load(&to[0]).sub(u), L::load(&to[1]).sub(v)],
                );
                inside &= L::load(&self.tolerance[k]).le(edge);
                ahead = ahead.add(edge.mul(L::load(&opposite[2]).sub(t)));
            }
            if inside & L::splat(0.0).lt(ahead) != 0 {
                blocked |= 1 << ray;
            }
        }
        blocked
    }

    /// The open rays that one triangle blocks, eight rays at a time: the same arithmetic as `blocked_rays`.
    #[inline(always)]
    fn blocked_by<L: Eight>(&self, triangle: usize, beam: &Beam<L>, open: u64) -> u64 {
        // Small triangles meet few packets: one comparison over the eight packet boxes finds them.
        let low = [L::splat(self.low[0][triangle]), L::splat(self.low[1][triangle])];
        let high =
            [L::splat(self.high[0][triangle]), L::splat(self.high[1][triangle]), L::splat(self.high[2][triangle])];
        let mut packets = beam.packets_near(&low, &high, L::splat(self.top[triangle]));
        let mut blocked = 0;
        while packets != 0 {
            let packet = packets.trailing_zeros() as usize;
            packets &= packets - 1;
            let (u, v, t) = (L::load(&beam.at[0][packet]), L::load(&beam.at[1][packet]), L::load(&beam.at[2][packet]));
            let (mut inside, mut ahead) = ((open >> (8 * packet)) as u32 & 0xff, L::splat(0.0));
            for k in 0..3 {
                let (from, to, opposite) = (&self.corner[k], &self.corner[(k + 1) % 3], &self.corner[(k + 2) % 3]);
                let edge = turn(
                    [L::splat(from[0][triangle]).sub(u), L::splat(from[1][triangle]).sub(v)],
                    [L::splat(to[0][triangle]).sub(u), L::splat(to[1][triangle]).sub(v)],
                );
                inside &= L::splat(self.tolerance[k][triangle]).le(edge);
                // Edge functions are barycentric weights: their sum with the depths says whether the hit lies in front.
                ahead = ahead.add(edge.mul(L::splat(opposite[2][triangle]).sub(t)));
            }
            inside &= L::splat(0.0).lt(ahead);
            blocked |= (inside as u64) << (8 * packet);
        }
        blocked
    }
}
