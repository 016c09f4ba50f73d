//! Triangles seen along a beam: flat figures with edge functions, and which rays (points) lie inside them.

// Lanes in loops go by index: closures (`map`, iterators) do not inherit the caller's instruction set, and every
// operation inside them would become a call.
#![allow(clippy::needless_range_loop)]

use super::beam::{Beam, Reach, SLACK, load};
use super::lanes::Lanes;

/// Relative width of an edge that still counts as inside: a few units in the last place.
const EDGE: f32 = 4.8e-7;

/// Up to eight triangles, `corner[k][axis][triangle]`; a place that is not used repeats one point and blocks nothing.
#[repr(C, align(32))]
#[derive(Clone)]
pub(super) struct Leaf {
    pub corner: [[[f32; 8]; 3]; 3],
}

/// Eight triangles seen along the beam: edge functions oriented to be positive inside, ready to be met by rays.
#[repr(C, align(32))]
#[derive(Default)]
pub(super) struct Shadow {
    /// Edge k runs from corner k to k + 1: its base, its coefficients and minus its tolerance.
    base: [[[f32; 8]; 2]; 3],
    coefficient: [[[f32; 8]; 2]; 3],
    tolerance: [[f32; 8]; 3],
    /// Depth of the corner opposite to edge k.
    depth: [[f32; 8]; 3],
    /// The box around the shadow: u, v, and the farthest depth.
    low: [[f32; 8]; 2],
    high: [[f32; 8]; 3],
    /// The greatest height over the plane of the beam's origins.
    top: [f32; 8],
}

#[inline(always)]
fn square<L: Lanes>(of: [L; 2]) -> L {
    of[0].mul(of[0]).add(of[1].mul(of[1]))
}

impl Shadow {
    /// Projects a leaf's triangles; returns those that the rectangle may meet and those that cover all of it in front.
    #[inline(always)]
    pub(super) fn cast<L: Lanes>(&mut self, leaf: &Leaf, reach: &Reach<L>) -> (u32, u32) {
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
        self.edges(&corner, reach, met)
    }

    /// The edge functions of the triangles, and the same two answers with the rectangle held against the edges.
    #[inline(always)]
    fn edges<L: Lanes>(&mut self, corner: &[[L; 3]; 3], reach: &Reach<L>, mut met: u32) -> (u32, u32) {
        // Orientation; a triangle seen edge-on blocks nothing (its neighbours' edges hold the rounding error).
        let first = [corner[1][0].sub(corner[0][0]), corner[1][1].sub(corner[0][1])];
        let last = [corner[2][0].sub(corner[0][0]), corner[2][1].sub(corner[0][1])];
        let area = first[0].mul(last[1]).sub(first[1].mul(last[0]));
        let flat = L::splat(EDGE).mul(square(first).max(square(last)));
        met &= flat.lt(area.abs());
        let clockwise = area.lt(L::splat(0.0));

        let middle = [L::splat(0.5 * (reach.low[0] + reach.high[0])), L::splat(0.5 * (reach.low[1] + reach.high[1]))];
        let radius = [
            L::splat(0.5 * (reach.high[0] - reach.low[0]) + SLACK),
            L::splat(0.5 * (reach.high[1] - reach.low[1]) + SLACK),
        ];
        let near = corner[0][2].min(corner[1][2]).min(corner[2][2]);
        let mut covered = L::splat(reach.high[2]).lt(near);
        for k in 0..3 {
            let (from, to) = (&corner[k], &corner[(k + 1) % 3]);
            // Both triangles at an edge start from the same end: the one with the lower (u, v).
            let level = to[0].le(from[0]) & from[0].le(to[0]);
            let swapped = to[0].lt(from[0]) | level & to[1].lt(from[1]);
            let base = [L::select(swapped, to[0], from[0]), L::select(swapped, to[1], from[1])];
            let end = [L::select(swapped, from[0], to[0]), L::select(swapped, from[1], to[1])];
            let along = [end[0].sub(base[0]), end[1].sub(base[1])];
            let turned = swapped ^ clockwise;
            let a = L::select(turned, along[1], along[1].neg());
            let b = L::select(turned, along[0].neg(), along[0]);
            let tolerance = L::splat(EDGE).mul(square(along));

            // The whole rectangle beyond one edge: not met. Inside all three and in front: everything is blocked.
            let value = a.mul(middle[0].sub(base[0])).add(b.mul(middle[1].sub(base[1])));
            let extent = a.abs().mul(radius[0]).add(b.abs().mul(radius[1]));
            met &= tolerance.neg().le(value.add(extent));
            covered &= tolerance.lt(value.sub(extent));

            base[0].store(&mut self.base[k][0]);
            base[1].store(&mut self.base[k][1]);
            a.store(&mut self.coefficient[k][0]);
            b.store(&mut self.coefficient[k][1]);
            tolerance.neg().store(&mut self.tolerance[k]);
            corner[(k + 2) % 3][2].store(&mut self.depth[k]);
        }
        (met, covered & met)
    }

    /// Those of `rays` that any of the `met` triangles blocks, one triangle after the other.
    #[inline(always)]
    pub(super) fn blocked_packets<L: Lanes>(&self, mut met: u32, beam: &Beam<L>, rays: u64) -> u64 {
        let mut blocked = 0;
        while met != 0 {
            blocked |= self.blocked_by(met.trailing_zeros() as usize, beam, rays & !blocked);
            met &= met - 1;
        }
        blocked
    }

    /// Those of `rays` that any of the `met` triangles blocks, one ray against eight triangles at a time.
    #[inline(always)]
    pub(super) fn blocked_rays<L: Lanes>(&self, met: u32, mut rays: u64, beam: &Beam<L>) -> u64 {
        let mut blocked = 0;
        while rays != 0 {
            let ray = rays.trailing_zeros() as usize;
            rays &= rays - 1;
            let (u, v, t) = (
                L::splat(beam.at[0][ray / 8][ray % 8]),
                L::splat(beam.at[1][ray / 8][ray % 8]),
                L::splat(beam.at[2][ray / 8][ray % 8]),
            );
            let mut inside = met;
            let mut ahead = L::splat(0.0);
            for k in 0..3 {
                let (base, slope) = (&self.base[k], &self.coefficient[k]);
                let edge = L::load(&slope[0])
                    .mul(u.sub(L::load(&base[0])))
                    .add(L::load(&slope[1]).mul(v.sub(L::load(&base[1]))));
                inside &= L::load(&self.tolerance[k]).le(edge);
                ahead = ahead.add(edge.mul(L::load(&self.depth[k]).sub(t)));
            }
            if inside & L::splat(0.0).lt(ahead) != 0 {
                blocked |= 1 << ray;
            }
        }
        blocked
    }

    /// The open rays that one triangle blocks, eight rays at a time: the same arithmetic as `blocked_rays`.
    #[inline(always)]
    fn blocked_by<L: Lanes>(&self, triangle: usize, beam: &Beam<L>, open: u64) -> u64 {
        // Small triangles meet few packets: one comparison over the eight packet boxes finds them.
        let low = [L::splat(self.low[0][triangle]), L::splat(self.low[1][triangle])];
        let high = [L::splat(self.high[0][triangle]), L::splat(self.high[1][triangle]), L::splat(self.high[2][triangle])];
        let mut packets = beam.packets_near(&low, &high, L::splat(self.top[triangle]));
        let mut blocked = 0;
        while packets != 0 {
            let packet = packets.trailing_zeros() as usize;
            packets &= packets - 1;
            let (u, v, t) =
                (L::load(&beam.at[0][packet]), L::load(&beam.at[1][packet]), L::load(&beam.at[2][packet]));
            let mut inside = (open >> (8 * packet)) as u32 & 0xff;
            let mut ahead = L::splat(0.0);
            for k in 0..3 {
                let (base, slope) = (&self.base[k], &self.coefficient[k]);
                let edge = L::splat(slope[0][triangle])
                    .mul(u.sub(L::splat(base[0][triangle])))
                    .add(L::splat(slope[1][triangle]).mul(v.sub(L::splat(base[1][triangle]))));
                inside &= L::splat(self.tolerance[k][triangle]).le(edge);
                // Edge functions are barycentric weights: their sum with the depths says whether the hit lies in front.
                ahead = ahead.add(edge.mul(L::splat(self.depth[k][triangle]).sub(t)));
            }
            inside &= L::splat(0.0).lt(ahead);
            blocked |= (inside as u64) << (8 * packet);
        }
        blocked
    }
}
