//! Occlusion of fans: up to 64 rays from one point in one walk of the tree.
//!
//! Precomputation shoots every direction of a cubemap from every receiver, and samples inside texels; lamps and gather
//! samples will ask for segments. All of these are rays that share an origin and lie in a narrow cone: boxes are held
//! against the cone first and against rays only where the cone does not decide, triangles likewise. The walk is paid
//! once for 64 rays, and does not depend on how far receivers lie apart.
//!
//! Each box on the stack comes with the rays that meet it, so that small triangles are met by few rays.
//!
//! Tried and dropped: beams of 64 receivers that share a direction (1.4 to 6 times slower, and slower still the coarser
//! the picture); a shaft around neighbouring receivers to start from (-16 to +10 %); children sorted nearest first; the
//! leaf that blocked the last fan tried first (below 1 %); 128 rays a fan (10 to 25 % slower); leaves of at most 4 or 6
//! triangles (20, 10 % slower); slower builds of the tree (-15 to +10 %); the largest flat convex pieces of the scene,
//! merged and tried before the walk (5 to 10 % faster first rays on scenes with a floor, for 250 lines).

use super::cone::{Apex, Boxes, Cone};
#[cfg(target_arch = "x86_64")]
use super::eight::Avx2;
use super::eight::{Eight, Portable};
use super::facets::Facets;
use super::fan::Fan;
use super::holes::Porous;
use super::tree::{LEAF, WideTree};
use crate::twice::compiled_twice;

/// Room for the walk, kept between calls.
#[derive(Default)]
pub struct Walk {
    stack: Vec<(u32, u64)>,
    boxes: Boxes,
    facets: Facets,
    /// Rays of the last fan that met something thin, one bit each: another ray there might have found otherwise.
    pub thin: u64,
}

/// The walk of one fan: box by box, until every ray is blocked or nothing is left.
#[inline(always)]
fn walk<L: Eight>(tree: &WideTree, from: &Apex, fan: &Fan, active: u64, room: &mut Walk) -> u64 {
    if active == 0 || tree.nodes.is_empty() {
        return 0;
    }
    let Walk { stack, boxes, facets, .. } = room;
    let mut cone = Cone::new(fan, from, tree.reach);
    cone.bound::<L>(fan, active);
    let mut open = active;
    let mut bounded = active.count_ones();
    stack.clear();
    stack.push((0, active));
    while let Some((place, rays)) = stack.pop() {
        let rays = rays & open;
        if rays == 0 {
            continue;
        }
        if place & LEAF == 0 {
            push_children::<L>(tree, place, fan, &cone, rays, boxes, stack);
            continue;
        }
        let leaf = &tree.leaves[(place & !LEAF) as usize];
        let (met, covering) = facets.look::<L>(leaf, &cone, fan.finite, rays.count_ones());
        if covering != 0 {
            return active;
        }
        if met == 0 {
            continue;
        }
        open &= !if by_ray(rays, met) {
            facets.blocked_rays::<L>(met, fan, rays)
        } else {
            facets.blocked_packets::<L>(met, fan, rays)
        };
        if open == 0 {
            return active;
        }
        // Once half of the rays are blocked, the rest lie in a smaller cone.
        if 2 * open.count_ones() <= bounded {
            bounded = open.count_ones();
            cone.bound::<L>(fan, open);
        }
    }
    active & !open
}

/// The walk among triangles with holes: what they stop is asked ray by ray.
#[inline(always)]
fn walk_porous<L: Eight>(porous: &Porous, from: &Apex, fan: &Fan, active: u64, room: &mut Walk) -> u64 {
    let tree = &porous.wide;
    let Walk { stack, boxes, facets, thin } = room;
    *thin = 0;
    if active == 0 || tree.nodes.is_empty() {
        return 0;
    }
    let mut cone = Cone::new(fan, from, tree.reach);
    cone.bound::<L>(fan, active);
    let mut open = active;
    stack.clear();
    stack.push((0, active));
    while let Some((place, rays)) = stack.pop() {
        let rays = rays & open;
        if rays == 0 {
            continue;
        }
        if place & LEAF == 0 {
            push_children::<L>(tree, place, fan, &cone, rays, boxes, stack);
            continue;
        }
        let number = (place & !LEAF) as usize;
        let (mut met, _) = facets.look::<L>(&tree.leaves[number], &cone, fan.finite, rays.count_ones());
        while met != 0 {
            let slot = met.trailing_zeros();
            met &= met - 1;
            let mut inside = facets.blocked_packets::<L>(1 << slot, fan, rays & open);
            while inside != 0 {
                let ray = inside.trailing_zeros() as usize;
                inside &= inside - 1;
                let weights = facets.weights(slot as usize, fan, ray);
                let found =
                    porous.holes.meet(porous.numbers[number][slot as usize], weights, fan.number(from.origin, ray));
                open &= !(u64::from(found.stops) << ray);
                *thin |= u64::from(found.thin) << ray;
            }
        }
    }
    active & !open
}

/// Whether going ray by ray, eight things at a time, takes fewer steps than going thing by thing, eight rays at a time.
#[inline(always)]
fn by_ray(rays: u64, things: u32) -> bool {
    // The lowest bit of each byte gathers the others: what is set are the packets with any ray.
    let mut any = rays | rays >> 4;
    any |= any >> 2;
    any |= any >> 1;
    let packets = (any & 0x0101_0101_0101_0101).count_ones();
    rays.count_ones() <= packets * things.count_ones()
}

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

/// Pushes the boxes of a node that any of the `rays` meets.
#[inline(always)]
fn push_children<L: Eight>(
    tree: &WideTree,
    place: u32,
    fan: &Fan,
    cone: &Cone,
    rays: u64,
    boxes: &mut Boxes,
    stack: &mut Vec<(u32, u64)>,
) {
    let node = &tree.nodes[place as usize];
    let (mut met, mut whole) = cone.meets::<L>(node, boxes);
    met &= !whole;
    while whole != 0 {
        push::<L>(tree, node.child[whole.trailing_zeros() as usize], rays, stack);
        whole &= whole - 1;
    }
    if met == 0 {
        return;
    }
    if !by_ray(rays, met) {
        while met != 0 {
            let place = met.trailing_zeros() as usize;
            met &= met - 1;
            let inside = boxes.rays_in::<L>(place, fan, rays);
            if inside != 0 {
                push::<L>(tree, node.child[place], inside, stack);
            }
        }
        return;
    }
    let (mut inside, mut any, mut left) = ([0u64; 8], 0, rays);
    while left != 0 {
        let ray = left.trailing_zeros() as usize;
        left &= left - 1;
        let mut at = met & boxes.met_by::<L>(fan, ray);
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
}

compiled_twice! {
    /// Which of the `active` rays triangles with holes stop; `room.thin` says which of them might have gone another way.
    pub(super) fn blocked_porous(porous: &Porous, from: &Apex, fan: &Fan, active: u64, room: &mut Walk) -> u64
        = walk_porous::<Portable>, walk_porous::<Avx2>;

    /// Which of the `active` rays of a fan (one bit each) meet a triangle. An answer does not depend on the other rays.
    pub fn blocked(tree: &WideTree, from: &Apex, fan: &Fan, active: u64, room: &mut Walk) -> u64
        = walk::<Portable>, walk::<Avx2>;
}

/// The portable walk: what processors without AVX2 take, and the oracle of the other.
pub fn blocked_portable(tree: &WideTree, from: &Apex, fan: &Fan, active: u64, room: &mut Walk) -> u64 {
    walk::<Portable>(tree, from, fan, active, room)
}
