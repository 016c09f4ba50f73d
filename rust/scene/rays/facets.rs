//! Triangles seen from the apex of a fan: the planes through the apex and each edge, and which rays lie inside all three.
//!
//! With corners a, b seen from the apex, the plane of their edge has the normal (b - a) x (a + b) = -2 a x b: taken so it
//! does not cancel where the triangle is small and far, and it is exactly the opposite when the edge is read from the
//! other side. A point within the rounding error of an edge counts as inside. Together that is watertight.
//!
//! With the sign of det = a . (b x c) the three values are positive only in front of the apex: no distance is taken.

// By index, as in `cone.rs`.
#![allow(clippy::needless_range_loop)]

use super::cone::Cone;
use super::eight::Eight;
use super::fan::{Fan, PACKETS};
use super::tree::Leaf;

/// Rounding of an edge's value, in units of |b - a|_1 |a + b|_max: half a unit in the last place. With none a closed
/// surface leaks at its vertices; with four times as much, edges block rays that pass them.
const EDGE: f32 = 0.6e-7;

/// So few rays are not held against the edges as one cone first.
const FEW: u32 = 4;

type Vector<L> = [L; 3];

#[inline(always)]
fn cross<L: Eight>(a: Vector<L>, b: Vector<L>) -> Vector<L> {
    [a[1].mul(b[2]).sub(a[2].mul(b[1])), a[2].mul(b[0]).sub(a[0].mul(b[2])), a[0].mul(b[1]).sub(a[1].mul(b[0]))]
}

/// Up to eight triangles as a fan sees them.
#[derive(Default)]
#[repr(C, align(32))]
pub(super) struct Facets {
    /// The normals of the three edge planes, positive inside: `edge[k][axis][triangle]`.
    edge: [[[f32; 8]; 3]; 3],
    /// Minus the rounding error of their values.
    tolerance: [[f32; 8]; 3],
    /// The triangle's normal, pointing away from the apex, and what it is at the corners: a ray meets the plane at
    /// depth `reach / (normal . ray)`.
    normal: [[f32; 8]; 3],
    reach: [f32; 8],
}

impl Facets {
    /// Looks at the triangles of a leaf; returns those that the cone may meet, and those that block all of it.
    #[inline(always)]
    pub(super) fn look<L: Eight>(&mut self, leaf: &Leaf, cone: &Cone, finite: bool, rays: u32) -> (u32, u32) {
        let mut corner = [[L::splat(0.0); 3]; 3];
        for axis in 0..3 {
            let (apex, sign) = (L::splat(cone.apex[axis]), L::splat(cone.sign[axis]));
            for k in 0..3 {
                corner[k][axis] = L::load(&leaf.corner[k][cone.axes[axis]]).sub(apex).mul(sign);
            }
        }
        let met = near::<L>(&corner, cone);
        if met == 0 { (0, 0) } else { self.edges(&corner, cone, met, finite, rays) }
    }

    /// The planes through the edges, and the whole cone against them: beyond one it is not met, inside all it is blocked.
    #[inline(always)]
    fn edges<L: Eight>(
        &mut self,
        corner: &[Vector<L>; 3],
        cone: &Cone,
        mut met: u32,
        finite: bool,
        rays: u32,
    ) -> (u32, u32) {
        let zero = L::splat(0.0);
        let (mut side, mut sum) = ([[zero; 3]; 3], [[zero; 3]; 3]);
        for k in 0..3 {
            for axis in 0..3 {
                side[k][axis] = corner[(k + 1) % 3][axis].sub(corner[k][axis]);
                sum[k][axis] = corner[(k + 1) % 3][axis].add(corner[k][axis]);
            }
        }
        let normal = cross(side[0], side[1]);
        let det = L::dot(normal[0], normal[1], normal[2], &corner[0]);
        let behind = det.lt(zero);
        let away = L::select(behind, L::splat(-1.0), L::splat(1.0));
        // Seen exactly edge-on, or no triangle at all: its neighbours' edges hold the rounding error.
        met &= zero.lt(det.abs());

        let together = rays > FEW;
        let mut covered = if together { met } else { 0 };
        for k in 0..3 {
            let mut edge = cross(side[k], sum[k]);
            for axis in 0..3 {
                edge[axis] = edge[axis].mul(away.neg());
                edge[axis].store(&mut self.edge[k][axis]);
            }
            let long = side[k][0].abs().add(side[k][1].abs()).add(side[k][2].abs());
            let off = sum[k][0].abs().max(sum[k][1].abs()).max(sum[k][2].abs());
            let tolerance = L::splat(-EDGE).mul(long).mul(off);
            tolerance.store(&mut self.tolerance[k]);
            if together {
                let (least, greatest) = cone.range(edge);
                met &= tolerance.le(greatest);
                covered &= tolerance.le(least);
            }
        }
        if finite {
            let mut outward = [zero; 3];
            for axis in 0..3 {
                outward[axis] = normal[axis].mul(away);
                outward[axis].store(&mut self.normal[axis]);
            }
            det.abs().store(&mut self.reach);
            covered &= det.abs().lt(cone.range(outward).0.mul(L::splat(cone.far[0])));
        }
        (met, covered & met)
    }

    /// Those of `rays` that any of the `met` triangles blocks, one ray against eight triangles at a time.
    #[inline(always)]
    pub(super) fn blocked_rays<L: Eight>(&self, met: u32, fan: &Fan, mut rays: u64) -> u64 {
        let mut blocked = 0;
        while rays != 0 {
            let ray = rays.trailing_zeros() as usize;
            rays &= rays - 1;
            let (packet, lane) = (ray / 8, ray % 8);
            let (s, t) = (L::splat(fan.slope[0][packet][lane]), L::splat(fan.slope[1][packet][lane]));
            let mut inside = met;
            for k in 0..3 {
                let value =
                    value(L::load(&self.edge[k][0]), L::load(&self.edge[k][1]), L::load(&self.edge[k][2]), s, t);
                inside &= L::load(&self.tolerance[k]).le(value);
            }
            if fan.finite && inside != 0 {
                let slope = value(L::load(&self.normal[0]), L::load(&self.normal[1]), L::load(&self.normal[2]), s, t);
                inside &= L::load(&self.reach).lt(slope.mul(L::splat(fan.far[packet][lane])));
            }
            blocked |= u64::from(inside != 0) << ray;
        }
        blocked
    }

    /// Weights of corners 1 and 2 where a ray meets a triangle: an edge's value is that of the corner across.
    pub(super) fn weights(&self, place: usize, fan: &Fan, ray: usize) -> [f32; 2] {
        let (s, t) = (fan.slope[0][ray / 8][ray % 8], fan.slope[1][ray / 8][ray % 8]);
        let [c, a, b] = [0, 1, 2].map(|k| {
            let [x, y, z] = [0, 1, 2].map(|axis| self.edge[k][axis][place]);
            x * s + y * t + z
        });
        let sum = a + b + c;
        if sum > 0.0 { [b / sum, c / sum] } else { [0.0; 2] }
    }

    /// The same, one triangle after the other against packets of eight rays: the same arithmetic.
    #[inline(always)]
    pub(super) fn blocked_packets<L: Eight>(&self, mut met: u32, fan: &Fan, rays: u64) -> u64 {
        let mut blocked = 0;
        while met != 0 {
            let place = met.trailing_zeros() as usize;
            met &= met - 1;
            for packet in 0..PACKETS {
                let mut inside = ((rays & !blocked) >> (8 * packet)) as u32 & 0xff;
                if inside == 0 {
                    continue;
                }
                let (s, t) = (L::load(&fan.slope[0][packet]), L::load(&fan.slope[1][packet]));
                for k in 0..3 {
                    let [x, y, z] = [self.edge[k][0][place], self.edge[k][1][place], self.edge[k][2][place]];
                    inside &= L::splat(self.tolerance[k][place]).le(value(L::splat(x), L::splat(y), L::splat(z), s, t));
                }
                if fan.finite && inside != 0 {
                    let [x, y, z] = [self.normal[0][place], self.normal[1][place], self.normal[2][place]];
                    let slope = value(L::splat(x), L::splat(y), L::splat(z), s, t);
                    inside &= L::splat(self.reach[place]).lt(slope.mul(L::load(&fan.far[packet])));
                }
                blocked |= u64::from(inside) << (8 * packet);
            }
        }
        blocked
    }
}

/// n . (s, t, 1), added up in this order everywhere: bounds over a cone are then bounds to the bit.
#[inline(always)]
fn value<L: Eight>(x: L, y: L, z: L, s: L, t: L) -> L {
    x.mul(s).add(y.mul(t)).add(z)
}

/// Triangles that are not wholly below the apex's plane, behind it, or beyond one of the cone's four planes.
#[inline(always)]
fn near<L: Eight>(corner: &[Vector<L>; 3], cone: &Cone) -> u32 {
    let (below, slack) = (L::splat(-cone.slack), L::splat(cone.slack));
    let normal = [L::splat(cone.normal[0]), L::splat(cone.normal[1]), L::splat(cone.normal[2])];
    let mut top = L::dot(corner[0][0], corner[0][1], corner[0][2], &normal);
    let mut deep = corner[0][2];
    for k in 1..3 {
        top = top.max(L::dot(corner[k][0], corner[k][1], corner[k][2], &normal));
        deep = deep.max(corner[k][2]);
    }
    let mut met = L::splat(cone.floor).le(top) & below.le(deep);
    for axis in 0..2 {
        let (least, greatest) = (L::splat(cone.slope[axis][0]), L::splat(cone.slope[axis][1]));
        let mut above = corner[0][axis].sub(least.mul(corner[0][2]));
        let mut under = corner[0][axis].sub(greatest.mul(corner[0][2]));
        for k in 1..3 {
            above = above.max(corner[k][axis].sub(least.mul(corner[k][2])));
            under = under.min(corner[k][axis].sub(greatest.mul(corner[k][2])));
        }
        met &= below.le(above) & under.le(slack);
    }
    met
}

impl Cone {
    /// The least and the greatest `value` of a normal over the cone.
    #[inline(always)]
    fn range<L: Eight>(&self, normal: Vector<L>) -> (L, L) {
        let [[s0, s1], [t0, t1]] = self.slope;
        let (x0, x1) = (normal[0].mul(L::splat(s0)), normal[0].mul(L::splat(s1)));
        let (y0, y1) = (normal[1].mul(L::splat(t0)), normal[1].mul(L::splat(t1)));
        (x0.min(x1).add(y0.min(y1)).add(normal[2]), x0.max(x1).add(y0.max(y1)).add(normal[2]))
    }
}
