//! The tree of eight-wide nodes that fans walk; `tracer.rs` makes it from obvhs's binary one.

/// Set in a child's word when it is a leaf.
pub(super) const LEAF: u32 = 1 << 31;

/// Eight children of a node: their boxes, and where they are.
#[repr(C, align(32))]
#[derive(Clone)]
pub(super) struct Node {
    /// Lower and upper ends of each child's box: `bounds[end][axis][child]`. A child that is not there ends before it
    /// begins: its box meets nothing.
    pub bounds: [[[f32; 8]; 3]; 2],
    /// A node's number, or a leaf's with `LEAF` set.
    pub child: [u32; 8],
}

impl Node {
    /// Eight children that are not there.
    pub(super) fn empty() -> Self {
        Node { bounds: [[[1e30; 8]; 3], [[-1e30; 8]; 3]], child: [0; 8] }
    }
}

/// Up to eight triangles, `corner[k][axis][triangle]`; a place that is not used repeats one point and blocks nothing.
#[repr(C, align(32))]
#[derive(Clone)]
pub(super) struct Leaf {
    /// In the normalised scene.
    pub corner: [[[f32; 8]; 3]; 3],
}

/// All nodes and leaves of a scene.
#[derive(Default)]
pub struct WideTree {
    /// The root is the first.
    pub(super) nodes: Vec<Node>,
    /// Up to eight triangles each.
    pub(super) leaves: Vec<Leaf>,
    /// The largest coordinate, at least 1: rounding grows with it.
    pub(super) reach: f32,
}

impl WideTree {
    /// Bytes of it.
    pub(super) fn nbytes(&self) -> usize {
        std::mem::size_of_val(&*self.nodes) + std::mem::size_of_val(&*self.leaves)
    }
}
