//! What a box must meet to matter to a beam: its shadow across the direction against the rectangle around the rays.

// Eight in loops go by index: closures (`map`, iterators) do not inherit the caller's instruction set, and every
// operation inside them would become a call.
#![allow(clippy::needless_range_loop)]

use super::eight::Eight;
use super::shadow::Leaf;

/// Set in a child's word when it is a leaf.
pub(super) const LEAF: u32 = 1 << 31;

/// Slack on every box test, in units of the normalised scene: covers the rounding of projected boxes and origins.
pub(super) const SLACK: f32 = 2e-6;

/// Eight children of a node: centres and half extents of their boxes, and where they are.
#[repr(C, align(32))]
#[derive(Clone)]
pub(super) struct Node {
    /// The middle of each child's box, axis by axis.
    pub centre: [[f32; 8]; 3],
    /// Negative for a child that is not there: its box meets nothing.
    pub half: [[f32; 8]; 3],
    /// A node's number, or a leaf's with `LEAF` set.
    pub child: [u32; 8],
}

impl Node {
    /// Eight children that are not there.
    pub(super) fn empty() -> Self {
        Node { centre: [[0.0; 8]; 3], half: [[-1e30; 8]; 3], child: [0; 8] }
    }
}

/// The tree of eight-wide nodes that beams walk; made by `tracer.rs` from the binary tree.
#[derive(Default)]
pub struct WideTree {
    /// The root is the first.
    pub(super) nodes: Vec<Node>,
    /// Up to eight triangles each.
    pub(super) leaves: Vec<Leaf>,
}

/// A direction and the plane across it: an orthonormal frame.
pub(super) struct BeamFrame {
    /// u, v and the direction itself.
    pub(super) axes: [[f32; 3]; 3],
    /// A normal of the surface under the origins.
    pub(super) normal: [f32; 3],
    /// Whether the direction leads away from the surface.
    pub(super) rises: bool,
}

impl BeamFrame {
    /// The frame of a unit direction, its v axis along the projected normal of a surface: a patch of that surface is
    /// foreshortened along v, and the rectangle around it stays tight.
    pub(super) fn new(direction: [f32; 3], normal: [f32; 3]) -> Self {
        let d = direction;
        let cross = |a: [f32; 3], b: [f32; 3]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let mut across = cross(normal, d);
        let mut square = across[0] * across[0] + across[1] * across[1] + across[2] * across[2];
        if square < 1e-6 {
            // Seen face on, any frame will do: start from the axis that the direction is farthest from.
            let least = (0..3).fold(0, |best, k| if d[k].abs() < d[best].abs() { k } else { best });
            across = cross(std::array::from_fn(|k| (k == least) as u8 as f32), d);
            square = across[0] * across[0] + across[1] * across[1] + across[2] * across[2];
        }
        let u = across.map(|component| component / square.sqrt());
        let along = normal[0] * d[0] + normal[1] * d[1] + normal[2] * d[2];
        BeamFrame { axes: [u, cross(d, u), d], normal, rises: along >= 0.0 }
    }
}

/// What a box or a triangle must meet to matter: the part of space that a beam, or one ray, passes through.
pub(super) struct Reach<L> {
    /// u, v and the direction, one component a vector.
    pub(super) axes: [[L; 3]; 3],
    /// A normal of the surface under the origins. Rays that rise along it cannot meet what lies below them all.
    pub(super) up: [L; 3],
    /// Bounds in u and v, and of the origins' depths.
    pub(super) low: [f32; 3],
    /// The upper ends of the same.
    pub(super) high: [f32; 3],
    /// Signs of the direction's components: a box is behind when its sides lie before the first origin along any axis.
    sign: [L; 3],
    /// The first origin along each axis, in the sense of the direction.
    pub(super) behind: [f32; 3],
    /// The origins' heights over their plane reach down to this.
    pub(super) floor: f32,
    /// And up to this.
    pub(super) ceiling: f32,
}

#[inline(always)]
fn sign<L: Eight>(of: f32) -> L {
    L::splat(1.0f32.copysign(of))
}

impl<L: Eight> Reach<L> {
    /// Bounds that nothing meets yet.
    #[inline(always)]
    pub(super) fn new(frame: &BeamFrame) -> Self {
        let axes = [splat(&frame.axes[0]), splat(&frame.axes[1]), splat(&frame.axes[2])];
        let direction = frame.axes[2];
        let sign = [sign(direction[0]), sign(direction[1]), sign(direction[2])];
        Reach {
            axes,
            up: splat(&frame.normal),
            low: [0.0; 3],
            high: [0.0; 3],
            floor: f32::NEG_INFINITY,
            ceiling: f32::NEG_INFINITY,
            sign,
            behind: [f32::NEG_INFINITY; 3],
        }
    }

    /// The shadows of a node's eight boxes.
    #[inline(always)]
    pub(super) fn project(&self, node: &Node) -> Boxes<L> {
        let centre: [L; 3] = load(&node.centre);
        let half: [L; 3] = load(&node.half);
        let mut boxes = Boxes { low: [L::splat(0.0); 2], high: [L::splat(0.0); 3], ahead: 0xff };
        for k in 0..3 {
            let axis = if k < 2 { &self.axes[k] } else { &self.up };
            let middle = L::dot(centre[0], centre[1], centre[2], axis);
            let extent = L::dot(half[0], half[1], half[2], &abs(axis));
            boxes.high[k] = middle.add(extent);
            if k < 2 {
                boxes.low[k] = middle.sub(extent);
            }
            boxes.ahead &= L::splat(self.behind[k]).le(centre[k].mul(self.sign[k]).add(half[k]));
        }
        boxes
    }

    /// Which boxes the rectangle meets, and which of those hold all of it, so that every ray meets them.
    #[inline(always)]
    pub(super) fn meets(&self, boxes: &Boxes<L>) -> (u32, u32) {
        let (low, high) = (&self.low, &self.high);
        let mut met = boxes.ahead & L::splat(self.floor).le(boxes.high[2]);
        for k in 0..2 {
            met &= L::splat(low[k]).le(boxes.high[k]) & boxes.low[k].le(L::splat(high[k]));
        }
        if met == 0 {
            return (0, 0);
        }
        let mut whole = met & L::splat(self.ceiling).le(boxes.high[2]);
        for k in 0..2 {
            whole &= boxes.low[k].le(L::splat(low[k])) & L::splat(high[k]).le(boxes.high[k]);
        }
        (met, whole)
    }
}

/// Eight boxes seen along the direction.
pub(super) struct Boxes<L> {
    /// Lower ends in u and v.
    pub(super) low: [L; 2],
    /// Upper ends in u and v, and the greatest height over the plane.
    pub(super) high: [L; 3],
    /// Boxes that are not behind the origins along any axis of space.
    ahead: u32,
}

/// Each component in all lanes.
#[inline(always)]
pub(super) fn splat<L: Eight>(of: &[f32; 3]) -> [L; 3] {
    [L::splat(of[0]), L::splat(of[1]), L::splat(of[2])]
}

/// Eight vectors, one a lane.
#[inline(always)]
pub(super) fn load<L: Eight>(of: &[[f32; 8]; 3]) -> [L; 3] {
    [L::load(&of[0]), L::load(&of[1]), L::load(&of[2])]
}

/// Magnitudes, component by component.
#[inline(always)]
pub(super) fn abs<L: Eight>(of: &[L; 3]) -> [L; 3] {
    [of[0].abs(), of[1].abs(), of[2].abs()]
}
