//! Ray queries: the only file that names obvhs, which builds the tree.
//!
//! `Tracer::blocked` answers for fans of rays from one point (`walk.rs`), the bulk of all rays; `closest_hit` and `occluded`
//! take one ray at a time over obvhs's own nodes, for primary rays and as a check of the other. All use the triangle
//! tests of this crate: obvhs's own test leaks at shared edges and vertices.

use std::cell::Cell;
use std::time::Duration;

use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::ray::{Ray, RayHit};
use obvhs::{Boundable, BvhBuildParams};

use super::cone::Apex;
use super::fan::Fan;
use super::holes::{Found, Holes, Kind, Porous, ray_number};
use super::tree::{LEAF, Leaf, Node, WideTree};
use super::walk::{self, Walk};
use crate::scene::mesh::{Mesh, unit};

pub use crate::scene::mesh::LIFT;

/// Boxes are padded by this much of the normalised scene: eight units in the last place of its largest coordinate.
const PAD: f32 = 1e-6;

/// Most triangles of a leaf of the wide tree.
const LEAF_SIZE: u32 = 8;

struct Boxed([[f32; 3]; 3]);

impl Boundable for Boxed {
    fn aabb(&self) -> Aabb {
        let pad = PAD * unit(&self.0);
        let [a, b, c] = self.0.map(Vec3A::from_array);
        Aabb::new(a.min(b).min(c) - pad, a.max(b).max(c) + pad)
    }
}

/// Where a ray first meets the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Number of the triangle in the mesh.
    pub triangle: usize,
    /// Distance in the normalised scene.
    pub distance: f32,
    /// Weights of corners 1 and 2.
    pub barycentric: [f32; 2],
}

/// A scene's triangles, ready for rays.
pub struct Tracer {
    bvh: Bvh2,
    /// Corners in the tree's own order.
    corners: Vec<[[f32; 3]; 3]>,
    /// Of what is solid.
    wide: WideTree,
    /// Of the rest; None where everything is solid.
    porous: Option<Porous>,
}

/// Watertight ray-triangle test (Woop, Benthin and Wald 2013), the shear prepared once for a ray.
struct Shear {
    axes: [usize; 3],
    shear: [f32; 3],
    origin: [f32; 3],
}

impl Shear {
    fn new(origin: [f32; 3], direction: [f32; 3]) -> Self {
        let z = (0..3).fold(0, |best, k| if direction[k].abs() > direction[best].abs() { k } else { best });
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if direction[z] < 0.0 {
            std::mem::swap(&mut x, &mut y);
        }
        let shear = [direction[x] / direction[z], direction[y] / direction[z], 1.0 / direction[z]];
        Shear { axes: [x, y, z], shear, origin }
    }

    /// Distance and weights of the three corners; infinite when the ray misses.
    fn meet(&self, corners: &[[f32; 3]; 3]) -> (f32, [f32; 3]) {
        const MISS: (f32, [f32; 3]) = (f32::INFINITY, [0.0; 3]);
        let [x, y, z] = self.axes;
        let seen = corners.map(|corner| {
            let at: [f32; 3] = std::array::from_fn(|k| corner[k] - self.origin[k]);
            [at[x] - self.shear[0] * at[z], at[y] - self.shear[1] * at[z], self.shear[2] * at[z]]
        });
        let edge = |a: usize, b: usize| {
            let fast = seen[a][0] * seen[b][1] - seen[a][1] * seen[b][0];
            if fast != 0.0 {
                return fast;
            }
            // On the edge in f32: f64 products of f32 are exact, so the sign is the true one.
            (seen[a][0] as f64 * seen[b][1] as f64 - seen[a][1] as f64 * seen[b][0] as f64) as f32
        };
        let weights = [edge(2, 1), edge(0, 2), edge(1, 0)];
        if weights.iter().any(|&w| w < 0.0) && weights.iter().any(|&w| w > 0.0) {
            return MISS;
        }
        let sum: f32 = weights.iter().sum();
        if sum == 0.0 {
            return MISS;
        }
        let distance = (0..3).map(|k| weights[k] * seen[k][2]).sum::<f32>() / sum;
        if distance > 0.0 { (distance, weights.map(|w| w / sum)) } else { MISS }
    }
}

/// A tree over triangles of a mesh, by their numbers, and their corners in its order; its places bear those numbers.
fn tree_over(mesh: &Mesh, numbers: &[u32]) -> (Bvh2, Vec<[[f32; 3]; 3]>) {
    if numbers.is_empty() {
        return Default::default();
    }
    let boxes: Vec<Boxed> = numbers.iter().map(|&number| Boxed(mesh.corners[number as usize])).collect();
    let mut bvh = build_bvh2(&boxes, BvhBuildParams::medium_build(), &mut Duration::default());
    bvh.primitive_indices.iter_mut().for_each(|place| *place = numbers[*place as usize]);
    let corners = bvh.primitive_indices.iter().map(|&number| mesh.corners[number as usize]).collect();
    (bvh, corners)
}

impl Tracer {
    /// Builds both trees, of all triangles; a mesh without any blocks no ray.
    pub fn new(mesh: &Mesh) -> Self {
        Self::with_holes(mesh, Holes::default())
    }

    /// The same where triangles have holes.
    pub fn with_holes(mesh: &Mesh, holes: Holes) -> Self {
        let of = |wanted: &dyn Fn(Kind) -> bool| -> Vec<u32> {
            (0..mesh.corners.len() as u32).filter(|&number| wanted(holes.kind(number as usize))).collect()
        };
        let (bvh, corners) = tree_over(mesh, &of(&|kind| kind != Kind::Gone));
        if holes.is_empty() {
            let wide = Collapse::run(&bvh, &corners).0;
            return Tracer { bvh, corners, wide, porous: None };
        }
        let (solid, own) = tree_over(mesh, &of(&|kind| kind == Kind::Solid));
        let (thin, thin_own) = tree_over(mesh, &of(&|kind| matches!(kind, Kind::Porous(_))));
        let (tree, mut numbers) = Collapse::run(&thin, &thin_own);
        for number in numbers.as_flattened_mut() {
            // Places left over in a leaf block nothing.
            *number = match thin.primitive_indices.get(*number as usize).map(|&n| holes.kind(n as usize)) {
                Some(Kind::Porous(place)) => place,
                _ => 0,
            };
        }
        let porous = Some(Porous { holes, wide: tree, numbers });
        Tracer { bvh, corners, wide: Collapse::run(&solid, &own).0, porous }
    }

    /// Which of the `active` rays of a fan, one bit each, meet a triangle. An answer does not depend on the other rays.
    pub fn blocked(&self, from: &Apex, fan: &Fan, active: u64, room: &mut Walk) -> u64 {
        let blocked = walk::blocked(&self.wide, from, fan, active, room);
        match &self.porous {
            None => blocked,
            Some(porous) => blocked | walk::blocked_porous(porous, from, fan, active & !blocked, room),
        }
    }

    /// Whether no triangle has holes.
    pub fn is_solid(&self) -> bool {
        self.porous.is_none()
    }

    /// The tree that fans walk, for tests of its two paths.
    pub fn wide(&self) -> &WideTree {
        &self.wide
    }

    /// What one ray finds of a triangle that it meets, by its place in the tree and the weights of its corners.
    fn found(&self, place: usize, weights: [f32; 3], ray: u64) -> Found {
        let solid = Found { stops: true, thin: false };
        let Some(porous) = &self.porous else { return solid };
        match porous.holes.kind(self.bvh.primitive_indices[place] as usize) {
            Kind::Porous(number) => porous.holes.meet(number, [weights[1], weights[2]], ray),
            _ => solid,
        }
    }

    /// A number of one ray, where any triangle has holes.
    fn number(&self, origin: [f32; 3], direction: [f32; 3]) -> u64 {
        if self.porous.is_some() { ray_number(origin, &direction) } else { 0 }
    }

    /// Whether one ray meets anything.
    pub fn occluded(&self, origin: [f32; 3], direction: [f32; 3]) -> bool {
        if self.corners.is_empty() {
            return false;
        }
        let (shear, number) = (Shear::new(origin, direction), self.number(origin, direction));
        let ray = Ray::new_inf(Vec3A::from_array(origin), Vec3A::from_array(direction));
        !self.bvh.ray_traverse_miss(ray, |_, place| {
            let (distance, weights) = shear.meet(&self.corners[place]);
            if distance < f32::INFINITY && self.found(place, weights, number).stops { distance } else { f32::INFINITY }
        })
    }

    /// The first triangle that a ray meets.
    pub fn closest_hit(&self, origin: [f32; 3], direction: [f32; 3]) -> Option<Hit> {
        self.look(origin, direction).0
    }

    /// The first triangle that a ray meets, and whether anything on its way was thin.
    pub fn look(&self, origin: [f32; 3], direction: [f32; 3]) -> (Option<Hit>, bool) {
        if self.corners.is_empty() {
            return (None, false);
        }
        let (shear, number) = (Shear::new(origin, direction), self.number(origin, direction));
        let ray = Ray::new_inf(Vec3A::from_array(origin), Vec3A::from_array(direction));
        let (mut hit, thin) = (RayHit::none(), Cell::new(false));
        self.bvh.ray_traverse(ray, &mut hit, |_, place| {
            let (distance, weights) = shear.meet(&self.corners[place]);
            if distance == f32::INFINITY || self.porous.is_none() {
                return distance;
            }
            let found = self.found(place, weights, number);
            thin.set(thin.get() | found.thin);
            if found.stops { distance } else { f32::INFINITY }
        });
        if hit.t == f32::INFINITY {
            return (None, thin.get());
        }
        let place = hit.primitive_id as usize;
        let (distance, weights) = shear.meet(&self.corners[place]);
        let triangle = self.bvh.primitive_indices[place] as usize;
        (Some(Hit { triangle, distance, barycentric: [weights[1], weights[2]] }), thin.get())
    }

    /// Bytes of both trees and of the triangles.
    pub fn nbytes(&self) -> usize {
        std::mem::size_of_val(&*self.bvh.nodes)
            + std::mem::size_of_val(&*self.corners)
            + self.wide.nbytes()
            + self.porous.as_ref().map_or(0, |porous| porous.wide.nbytes())
    }
}

/// Turns the binary tree into eight-wide nodes: each takes its largest child apart until it has eight.
struct Collapse<'a> {
    bvh: &'a Bvh2,
    corners: &'a [[[f32; 3]; 3]],
    tree: WideTree,
    /// Of each leaf the places of its triangles in the binary tree; the largest number where there is none.
    places: Vec<[u32; 8]>,
}

impl<'a> Collapse<'a> {
    fn run(bvh: &'a Bvh2, corners: &'a [[[f32; 3]; 3]]) -> (WideTree, Vec<[u32; 8]>) {
        let reach = corners.iter().map(unit).fold(1.0, f32::max);
        let tree = WideTree { reach, ..WideTree::default() };
        let mut collapse = Collapse { bvh, corners, tree, places: Vec::new() };
        if !corners.is_empty() {
            collapse.fill();
        }
        (collapse.tree, collapse.places)
    }

    fn fill(&mut self) {
        let counts = self.counts();
        // Breadth first: each task is a binary node and the wide node to fill with what lies under it.
        self.tree.nodes.push(Node::empty());
        let mut tasks = vec![(0u32, 0usize)];
        while let Some((root, place)) = tasks.pop() {
            for (slot, below) in self.eight_under(root, &counts).into_iter().enumerate() {
                let child = if counts[below as usize] <= LEAF_SIZE {
                    self.leaf(below);
                    LEAF | (self.tree.leaves.len() - 1) as u32
                } else {
                    self.tree.nodes.push(Node::empty());
                    tasks.push((below, self.tree.nodes.len() - 1));
                    (self.tree.nodes.len() - 1) as u32
                };
                let bounds = self.bvh.nodes[below as usize].aabb();
                let node = &mut self.tree.nodes[place];
                node.child[slot] = child;
                for axis in 0..3 {
                    node.bounds[0][axis][slot] = bounds.min[axis];
                    node.bounds[1][axis][slot] = bounds.max[axis];
                }
            }
        }
    }

    /// Triangles under each binary node. Children may stand before their parents, hence the explicit stack.
    fn counts(&self) -> Vec<u32> {
        let mut counts = vec![0u32; self.bvh.nodes.len()];
        let mut stack = vec![(0u32, false)];
        while let Some((number, below_done)) = stack.pop() {
            let node = &self.bvh.nodes[number as usize];
            if node.is_leaf() {
                counts[number as usize] = node.prim_count;
            } else if below_done {
                counts[number as usize] = counts[node.first_index as usize] + counts[node.first_index as usize + 1];
            } else {
                stack.extend([(number, true), (node.first_index, false), (node.first_index + 1, false)]);
            }
        }
        counts
    }

    fn eight_under(&self, root: u32, counts: &[u32]) -> Vec<u32> {
        let mut parts = vec![root];
        while parts.len() < 8 {
            let divisible = |&&number: &&u32| {
                !self.bvh.nodes[number as usize].is_leaf() && (counts[number as usize] > LEAF_SIZE || number == root)
            };
            let area = |number: &u32| self.bvh.nodes[*number as usize].aabb().half_area();
            let Some(&largest) = parts.iter().filter(divisible).max_by(|a, b| area(a).total_cmp(&area(b))) else {
                break;
            };
            parts.retain(|&number| number != largest);
            let first = self.bvh.nodes[largest as usize].first_index;
            parts.extend([first, first + 1]);
        }
        parts
    }

    fn leaf(&mut self, root: u32) {
        let mut leaf = Leaf { corner: [[[0.0; 8]; 3]; 3] };
        let mut places = [u32::MAX; 8];
        let mut slot = 0;
        let mut stack = vec![root];
        while let Some(number) = stack.pop() {
            let node = &self.bvh.nodes[number as usize];
            if !node.is_leaf() {
                stack.extend([node.first_index, node.first_index + 1]);
                continue;
            }
            for place in node.first_index..node.first_index + node.prim_count {
                for (k, corner) in self.corners[place as usize].iter().enumerate() {
                    for (axis, &at) in corner.iter().enumerate() {
                        leaf.corner[k][axis][slot] = at;
                    }
                }
                places[slot] = place;
                slot += 1;
            }
        }
        self.tree.leaves.push(leaf);
        self.places.push(places);
    }
}
