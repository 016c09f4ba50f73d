//! Which of some surface points are nearest to another: in place, and in the way their surfaces face.
//!
//! A k-d tree over six numbers, the place and a scale times the normal, so that the two sides of a leaf, or the walls of a
//! corner, are far apart. Answers do not depend on the order of the points: of two that are equally near the first counts.

/// Points of a leaf: looked at together.
const LEAF: usize = 8;
/// Rounding must not hide what is as near as the last.
const CAREFUL: f32 = 1.00001;

type Key = [f32; 6];

/// A place and a normal as the tree takes them.
fn key(place: [f64; 3], normal: [f64; 3], scale: f64) -> Key {
    std::array::from_fn(|k| if k < 3 { place[k] as f32 } else { (scale * normal[k - 3]) as f32 })
}

/// A tree of points.
pub struct Near {
    /// What a unit of a normal counts for.
    scale: f64,
    branches: Vec<Branch>,
    leaves: Vec<Leaf>,
    root: Child,
}

#[derive(Clone, Copy)]
enum Child {
    Branch(u32),
    Leaf(u32),
}

/// Two halves on both sides of a plane.
struct Branch {
    axis: usize,
    at: f32,
    halves: [Child; 2],
}

/// Up to eight points, axis by axis; places left over are infinitely far.
struct Leaf {
    keys: [[f32; LEAF]; 6],
    numbers: [u32; LEAF],
}

/// A question on its way through the tree.
struct Search<'a> {
    at: Key,
    count: usize,
    /// How far the box of the branch lies away along each axis.
    off: Key,
    found: &'a mut Vec<(f32, u32)>,
}

impl Search<'_> {
    /// What is further than this is not among the nearest.
    fn limit(&self) -> f32 {
        if self.found.len() < self.count { f32::MAX } else { self.found[self.found.len() - 1].0 }
    }
}

impl Near {
    /// Of places and unit normals.
    pub fn new(points: impl Iterator<Item = ([f64; 3], [f64; 3])>, scale: f64) -> Near {
        let mut all: Vec<(Key, u32)> =
            points.enumerate().map(|(number, (place, normal))| (key(place, normal, scale), number as u32)).collect();
        let mut near = Near { scale, branches: Vec::new(), leaves: Vec::new(), root: Child::Leaf(0) };
        near.root = near.divide(&mut all);
        near
    }

    /// Puts the middle along the widest axis into the middle, and likewise on both sides.
    fn divide(&mut self, points: &mut [(Key, u32)]) -> Child {
        if points.len() <= LEAF {
            let mut leaf = Leaf { keys: [[f32::INFINITY; LEAF]; 6], numbers: [u32::MAX; LEAF] };
            for (slot, (key, number)) in points.iter().enumerate() {
                (0..6).for_each(|axis| leaf.keys[axis][slot] = key[axis]);
                leaf.numbers[slot] = *number;
            }
            self.leaves.push(leaf);
            return Child::Leaf(self.leaves.len() as u32 - 1);
        }
        let extent = |axis: usize| {
            let ends = (f32::MAX, f32::MIN);
            let (low, high) =
                points.iter().fold(ends, |(low, high), (key, _)| (low.min(key[axis]), high.max(key[axis])));
            high - low
        };
        let extents: [f32; 6] = std::array::from_fn(extent);
        let axis = (0..6).fold(0, |best, axis| if extents[axis] > extents[best] { axis } else { best });
        let middle = points.len() / 2;
        points.select_nth_unstable_by(middle, |a, b| a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1)));
        let at = points[middle].0[axis];
        let place = self.branches.len();
        self.branches.push(Branch { axis, at, halves: [Child::Leaf(0); 2] });
        let (left, right) = points.split_at_mut(middle);
        self.branches[place].halves = [self.divide(left), self.divide(right)];
        Child::Branch(place as u32)
    }

    /// The nearest `count` points, the nearest first, into `found`: squared distances and numbers.
    pub fn nearest(&self, place: [f64; 3], normal: [f64; 3], count: usize, found: &mut Vec<(f32, u32)>) {
        found.clear();
        if count > 0 {
            let mut search = Search { at: key(place, normal, self.scale), count, off: [0.0; 6], found };
            self.search(&mut search, 0.0, self.root);
        }
    }

    /// `square`: from the point to the box of this branch, by the planes that lie between.
    fn search(&self, search: &mut Search, square: f32, child: Child) {
        let Branch { axis, at, halves } = match child {
            Child::Leaf(leaf) => return self.leaves[leaf as usize].look(search),
            Child::Branch(branch) => &self.branches[branch as usize],
        };
        let off = search.at[*axis] - at;
        let side = usize::from(off >= 0.0);
        self.search(search, square, halves[side]);
        let before = std::mem::replace(&mut search.off[*axis], off);
        let further = square - before * before + off * off;
        if further <= search.limit() * CAREFUL {
            self.search(search, further, halves[1 - side]);
        }
        search.off[*axis] = before;
    }
}

impl Leaf {
    fn look(&self, search: &mut Search) {
        let mut squares = [0.0f32; LEAF];
        for (keys, at) in self.keys.iter().zip(search.at) {
            for (square, key) in squares.iter_mut().zip(keys) {
                *square += (at - key) * (at - key);
            }
        }
        for (square, number) in squares.into_iter().zip(self.numbers) {
            let one = (square, number);
            let full = search.found.len() == search.count;
            if square == f32::INFINITY || full && search.found[search.found.len() - 1] <= one {
                continue;
            }
            if full {
                search.found.pop();
            }
            let place = search.found.partition_point(|other| *other <= one);
            search.found.insert(place, one);
        }
    }
}
