//! Occlusion of parallel beams: up to 64 rays of one direction, from neighbouring receivers, in one walk of the tree.
//!
//! Precomputation shoots every direction of a cubemap from every receiver, so rays come in bundles that share their
//! direction. Seen along that direction a triangle is a flat figure and a ray is a point: a box is met when its shadow
//! meets the bundle's rectangle, and a triangle blocks a ray when three edge functions agree and it lies in front. The
//! walk is paid once for 64 rays and nothing is divided.
//!
//! Watertight by construction: a vertex is projected the same way in every triangle that uses it, an edge is always
//! evaluated from the same one of its ends, so that two triangles see exactly opposite values, and a point within the
//! rounding error of an edge counts as inside (NUMERICS 2g).
//!
//! Tried and dropped: packets of eight rays over obvhs's binary nodes (two to four times slower, `cargo bench`).

#[cfg(target_arch = "x86_64")]
use super::lanes::Avx2;
use super::bundle::{Bundle, PACKETS};
use super::lanes::{Lanes, Portable};
use super::shadow::{Leaf, Shadow};
use super::shaft::Shaft;

/// Set in a child's word when it is a leaf.
pub(super) const LEAF: u32 = 1 << 31;

/// Slack on every box test, in units of the normalised scene: covers the rounding of projected boxes and origins.
pub(super) const SLACK: f32 = 2e-6;

/// The same for heights over a bundle's plane: more than their rounding, less than the lift of receivers.
const FLOOR: f32 = 5e-7;

/// Eight children of a node: centres and half extents of their boxes, and where they are.
#[repr(C, align(32))]
#[derive(Clone)]
pub(super) struct Node {
    pub centre: [[f32; 8]; 3],
    /// Negative for a child that is not there: its box meets nothing.
    pub half: [[f32; 8]; 3],
    pub child: [u32; 8],
}

impl Node {
    pub(super) fn empty() -> Self {
        Node { centre: [[0.0; 8]; 3], half: [[-1e30; 8]; 3], child: [0; 8] }
    }
}

/// The tree of eight-wide nodes that beams walk; made by `tracer.rs` from the binary tree.
#[derive(Default)]
pub struct WideTree {
    pub(super) nodes: Vec<Node>,
    pub(super) leaves: Vec<Leaf>,
}

/// A direction and the plane across it: an orthonormal frame.
pub(super) struct BeamFrame {
    /// u, v and the direction itself.
    pub(super) axes: [[f32; 3]; 3],
    normal: [f32; 3],
    /// Whether the direction leads away from the surface.
    rises: bool,
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
    pub(super) high: [f32; 3],
    /// Signs of the direction's components: a box is behind when its sides lie before the first origin along any axis.
    sign: [L; 3],
    behind: [f32; 3],
    /// The origins' heights over their plane reach down to this.
    pub(super) floor: f32,
    /// And up to this.
    ceiling: f32,
}

#[inline(always)]
fn sign<L: Lanes>(of: f32) -> L {
    L::splat(1.0f32.copysign(of))
}

impl<L: Lanes> Reach<L> {
    /// Bounds that nothing meets yet.
    #[inline(always)]
    fn new(frame: &BeamFrame) -> Self {
        let axes = [splat(&frame.axes[0]), splat(&frame.axes[1]), splat(&frame.axes[2])];
        let direction = frame.axes[2];
        let sign = [sign(direction[0]), sign(direction[1]), sign(direction[2])];
        Reach { axes, up: splat(&frame.normal), low: [0.0; 3], high: [0.0; 3], floor: f32::NEG_INFINITY, ceiling: f32::NEG_INFINITY,
            sign, behind: [f32::NEG_INFINITY; 3] }
    }

    /// The shadows of a node's eight boxes.
    #[inline(always)]
    fn project(&self, node: &Node) -> Boxes<L> {
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
    fn meets(&self, boxes: &Boxes<L>) -> (u32, u32) {
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
struct Boxes<L> {
    /// Lower ends in u and v.
    low: [L; 2],
    /// Upper ends in u and v, and the greatest height over the plane.
    high: [L; 3],
    /// Boxes that are not behind the origins along any axis of space.
    ahead: u32,
}

/// Bundle origins seen along the direction, and the boxes around those that are still open.
pub(super) struct Beam<L> {
    /// u, v, depth, and height over the patch's plane, of each packet of eight rays.
    pub(super) at: [[[f32; 8]; PACKETS]; 4],
    rises: bool,
    pub(super) reach: Reach<L>,
    /// The bounds of each packet, one packet a lane.
    packet_low: [[f32; 8]; 3],
    packet_high: [[f32; 8]; 2],
    packet_floor: [f32; 8],
    /// The rays that the packets' bounds were made for.
    packets_of: u64,
}

impl<L: Lanes> Beam<L> {
    #[inline(always)]
    fn new(bundle: &Bundle, frame: &BeamFrame) -> Self {
        let reach = Reach::<L>::new(frame);
        let mut at = [[[0.0; 8]; PACKETS]; 4];
        for packet in 0..PACKETS {
            let (x, y, z) =
                (L::load(&bundle.origin[0][packet]), L::load(&bundle.origin[1][packet]), L::load(&bundle.origin[2][packet]));
            for k in 0..3 {
                L::dot(x, y, z, &reach.axes[k]).store(&mut at[k][packet]);
            }
            L::dot(x, y, z, &reach.up).store(&mut at[3][packet]);
        }
        Beam {
            at,
            rises: frame.rises,
            reach,
            packet_low: [[0.0; 8]; 3],
            packet_high: [[0.0; 8]; 2],
            packet_floor: [f32::NEG_INFINITY; 8],
            packets_of: 0,
        }
    }

    /// The rectangle around the open rays, so that a half-closed bundle meets less of the tree.
    #[inline(always)]
    fn bound(&mut self, open: u64, behind: [f32; 3]) {
        let out = L::splat(f32::INFINITY);
        let mut bounds = [out; 8];
        for packet in 0..PACKETS {
            let bits = (open >> (8 * packet)) as u32 & 0xff;
            for k in 0..4 {
                let at = L::load(&self.at[k][packet]);
                bounds[k] = bounds[k].min(L::select(bits, at, out));
                bounds[4 + k] = bounds[4 + k].min(L::select(bits, at.neg(), out));
            }
        }
        let mut least = [0.0; 8];
        L::least_each(&bounds).store(&mut least);
        for k in 0..3 {
            self.reach.low[k] = least[k] - SLACK;
            self.reach.high[k] = SLACK - least[4 + k];
        }
        self.reach.behind = behind;
        if self.rises {
            self.reach.floor = least[3] - FLOOR;
            self.reach.ceiling = -least[7];
        }
    }

    /// The same for each packet: only leaves need it.
    #[inline(always)]
    fn bound_packets(&mut self, open: u64) {
        self.packets_of = open;
        let out = L::splat(f32::INFINITY);
        for k in 0..4 {
            let (mut low, mut high) = ([out; 8], [out; 8]);
            for packet in 0..PACKETS {
                let bits = (open >> (8 * packet)) as u32 & 0xff;
                let at = L::load(&self.at[k][packet]);
                low[packet] = L::select(bits, at, out);
                high[packet] = L::select(bits, at.neg(), out);
            }
            if k < 3 {
                L::least_each(&low).sub(L::splat(SLACK)).store(&mut self.packet_low[k]);
            } else if self.rises {
                L::least_each(&low).sub(L::splat(FLOOR)).store(&mut self.packet_floor);
            }
            if k < 2 {
                L::splat(SLACK).sub(L::least_each(&high)).store(&mut self.packet_high[k]);
            }
        }
    }

    /// Packets whose bounds meet a box in u and v that reaches so far and so high.
    #[inline(always)]
    pub(super) fn packets_near(&self, low: &[L; 2], high: &[L; 3], top: L) -> u32 {
        let mut packets = L::load(&self.packet_low[2]).le(high[2]) & L::load(&self.packet_floor).le(top);
        for k in 0..2 {
            packets &= L::load(&self.packet_low[k]).le(high[k]) & low[k].le(L::load(&self.packet_high[k]));
        }
        packets
    }
}

#[inline(always)]
pub(super) fn splat<L: Lanes>(of: &[f32; 3]) -> [L; 3] {
    [L::splat(of[0]), L::splat(of[1]), L::splat(of[2])]
}

#[inline(always)]
pub(super) fn load<L: Lanes>(of: &[[f32; 8]; 3]) -> [L; 3] {
    [L::load(&of[0]), L::load(&of[1]), L::load(&of[2])]
}

#[inline(always)]
pub(super) fn abs<L: Lanes>(of: &[L; 3]) -> [L; 3] {
    [of[0].abs(), of[1].abs(), of[2].abs()]
}

impl<L: Lanes> Beam<L> {
    /// Those of `rays` that lie within one of eight boxes.
    #[inline(always)]
    fn rays_in(&self, boxes: &BoxArrays, place: usize, rays: u64) -> u64 {
        let low = [L::splat(boxes.low[0][place]), L::splat(boxes.low[1][place])];
        let high = [L::splat(boxes.high[0][place]), L::splat(boxes.high[1][place]), L::splat(f32::INFINITY)];
        let mut packets = self.packets_near(&low, &high, L::splat(boxes.high[2][place]));
        let (low, high) = (
            [low[0].sub(L::splat(SLACK)), low[1].sub(L::splat(SLACK))],
            [high[0].add(L::splat(SLACK)), high[1].add(L::splat(SLACK))],
        );
        let mut inside = 0;
        while packets != 0 {
            let packet = packets.trailing_zeros() as usize;
            packets &= packets - 1;
            let (u, v) = (L::load(&self.at[0][packet]), L::load(&self.at[1][packet]));
            let hit = low[0].le(u) & u.le(high[0]) & low[1].le(v) & v.le(high[1]);
            inside |= (hit as u64) << (8 * packet);
        }
        inside & rays
    }

    /// The boxes that one ray lies in.
    #[inline(always)]
    fn boxes_at(&self, boxes: &Boxes<L>, ray: usize) -> u32 {
        let (u, v) = (self.at[0][ray / 8][ray % 8], self.at[1][ray / 8][ray % 8]);
        boxes.low[0].le(L::splat(u + SLACK))
            & L::splat(u - SLACK).le(boxes.high[0])
            & boxes.low[1].le(L::splat(v + SLACK))
            & L::splat(v - SLACK).le(boxes.high[1])
    }
}

/// `Boxes` in memory.
#[repr(C, align(32))]
struct BoxArrays {
    low: [[f32; 8]; 2],
    high: [[f32; 8]; 3],
}

/// Where the walks of a block of directions start: boxes in nodes of eight.
#[derive(Default)]
pub(super) struct Starts {
    nodes: Vec<Node>,
    /// Boxes (node, child) that are leaves, and those that are not.
    pub(super) leaves: Vec<(u32, u32)>,
    pub(super) queue: Vec<(u32, u32)>,
}

impl Starts {
    pub(super) fn clear(&mut self) {
        self.nodes.clear();
        self.leaves.clear();
        self.queue.clear();
    }

    /// The walk starts from the root.
    fn root(&mut self, tree: &WideTree) {
        self.clear();
        self.nodes.push(tree.nodes[0].clone());
    }

    /// Copies the leaves and the queue from `next` on into nodes.
    pub(super) fn fill(&mut self, tree: &WideTree, next: usize) {
        for (place, &(from, slot)) in self.leaves.iter().chain(&self.queue[next..]).enumerate() {
            if place % 8 == 0 {
                self.nodes.push(Node::empty());
            }
            let (from, slot) = (&tree.nodes[from as usize], slot as usize);
            let to = &mut self.nodes[place / 8];
            for axis in 0..3 {
                to.centre[axis][place % 8] = from.centre[axis][slot];
                to.half[axis][place % 8] = from.half[axis][slot];
            }
            to.child[place % 8] = from.child[slot];
        }
    }
}

/// Room for the walk, kept between calls.
#[derive(Default)]
pub struct Walk {
    stack: Vec<(u32, u64)>,
    shadow: Shadow,
    starts: Starts,
    /// The leaf that last covered a whole beam: the next direction tries it first.
    cover: Option<u32>,
}

impl Walk {
    /// Forgets what the last bundle met.
    pub fn begin(&mut self, _bundle: &Bundle) {
        self.cover = None;
    }
}

#[inline(always)]
fn walk<L: Lanes>(
    tree: &WideTree,
    bundle: &Bundle,
    directions: &[[f32; 3]],
    active: &[u64],
    room: &mut Walk,
    blocked: &mut [u64],
) {
    blocked.fill(0);
    if tree.nodes.is_empty() {
        return;
    }
    let mut any = 0;
    for &rays in active {
        any |= rays;
    }
    for &(patch, normal) in &bundle.patches {
        if patch & any == 0 {
            continue;
        }
        let (low, high) = bundle.bounds(patch & any);
        let shaft = if directions.len() > 1 { Shaft::<L>::new(bundle, normal, directions, patch & any, (low, high)) } else { None };
        match shaft {
            Some(shaft) => shaft.gather(tree, &mut room.starts),
            None => room.starts.root(tree),
        }
        if room.starts.nodes.is_empty() {
            continue;
        }
        for k in 0..directions.len() {
            if patch & active[k] != 0 {
                let (mut behind, direction) = ([0.0; 3], directions[k]);
                for axis in 0..3 {
                    behind[axis] = if direction[axis] >= 0.0 { low[axis] } else { -high[axis] } - SLACK;
                }
                let mut beam = Beam::<L>::new(bundle, &BeamFrame::new(directions[k], normal));
                blocked[k] |= blocked_along(tree, &mut beam, patch & active[k], behind, room);
            }
        }
    }
}

/// The walk of one patch in one direction: box by box, until every ray is blocked or nothing is left. Each box on the
/// stack comes with the rays that lie in it.
#[inline(always)]
fn blocked_along<L: Lanes>(tree: &WideTree, beam: &mut Beam<L>, active: u64, behind: [f32; 3], room: &mut Walk) -> u64 {
    beam.bound(active, behind);
    beam.packets_of = 0;
    room.stack.clear();
    for start in 0..room.starts.nodes.len() {
        push_children(&room.starts.nodes[start], beam, active, active, &mut room.stack);
    }
    if room.stack.is_empty() {
        return 0;
    }
    if let Some(cover) = room.cover {
        room.stack.push((cover, active));
    }
    let mut open = active;
    let mut bounded = active.count_ones();
    while let Some((place, rays)) = room.stack.pop() {
        let rays = rays & open;
        if rays == 0 {
            continue;
        }
        if place & LEAF == 0 {
            push_children(&tree.nodes[place as usize], beam, rays, open, &mut room.stack);
            continue;
        }
        let (met, covering) = room.shadow.cast(&tree.leaves[(place & !LEAF) as usize], &beam.reach);
        if covering != 0 {
            room.cover = Some(place);
            return active;
        }
        if met == 0 {
            continue;
        }
        if rays.count_ones() < PRICE * met.count_ones() {
            open &= !room.shadow.blocked_rays(met, rays, beam);
        } else {
            if beam.packets_of == 0 {
                beam.bound_packets(open);
            }
            open &= !room.shadow.blocked_packets(met, beam, rays);
        }
        if open == 0 {
            return active;
        }
        // Once half of the rays are blocked, the rest lie in a smaller rectangle.
        if 2 * open.count_ones() <= bounded {
            bounded = open.count_ones();
            beam.bound(open, behind);
            beam.packets_of = 0;
        }
    }
    active & !open
}

/// What one triangle against its packets costs, in rays against eight triangles.
const PRICE: u32 = 2;

/// With fewer rays, each is held against eight boxes; with more, each box against packets of rays.
const SCATTERED: u32 = 8;

/// Pushes the boxes of a node that any of the `rays` lies in.
#[inline(always)]
fn push_children<L: Lanes>(node: &Node, beam: &mut Beam<L>, rays: u64, open: u64, stack: &mut Vec<(u32, u64)>) {
    let boxes = beam.reach.project(node);
    let (mut met, mut whole) = beam.reach.meets(&boxes);
    met &= !whole;
    while whole != 0 {
        stack.push((node.child[whole.trailing_zeros() as usize], rays));
        whole &= whole - 1;
    }
    if met == 0 {
        return;
    }
    if rays.count_ones() < SCATTERED {
        let mut inside = [0u64; 8];
        let mut left = rays;
        let mut any = 0;
        while left != 0 {
            let ray = left.trailing_zeros() as usize;
            left &= left - 1;
            let mut at = met & beam.boxes_at(&boxes, ray);
            any |= at;
            while at != 0 {
                inside[at.trailing_zeros() as usize] |= 1 << ray;
                at &= at - 1;
            }
        }
        while any != 0 {
            let place = any.trailing_zeros() as usize;
            any &= any - 1;
            stack.push((node.child[place], inside[place]));
        }
        return;
    }
    if beam.packets_of == 0 {
        beam.bound_packets(open);
    }
    let mut stored = BoxArrays { low: [[0.0; 8]; 2], high: [[0.0; 8]; 3] };
    for k in 0..3 {
        boxes.high[k].store(&mut stored.high[k]);
        if k < 2 {
            boxes.low[k].store(&mut stored.low[k]);
        }
    }
    while met != 0 {
        let place = met.trailing_zeros() as usize;
        met &= met - 1;
        let inside = beam.rays_in(&stored, place, rays);
        if inside != 0 {
            stack.push((node.child[place], inside));
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn walk_avx2(
    tree: &WideTree,
    bundle: &Bundle,
    directions: &[[f32; 3]],
    active: &[u64],
    room: &mut Walk,
    blocked: &mut [u64],
) {
    walk::<Avx2>(tree, bundle, directions, active, room, blocked)
}

/// The portable walk: what processors without AVX2 take, and the oracle of the other.
pub fn blocked_portable(
    tree: &WideTree,
    bundle: &Bundle,
    directions: &[[f32; 3]],
    active: &[u64],
    room: &mut Walk,
    blocked: &mut [u64],
) {
    walk::<Portable>(tree, bundle, directions, active, room, blocked)
}

/// For each of some neighbouring unit directions, which of its `active` rays (one bit each) of a bundle meet a triangle.
pub fn blocked(
    tree: &WideTree,
    bundle: &Bundle,
    directions: &[[f32; 3]],
    active: &[u64],
    room: &mut Walk,
    blocked: &mut [u64],
) {
    debug_assert!(directions.len() == active.len() && directions.len() == blocked.len());
    #[cfg(target_arch = "x86_64")]
    if std::is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has AVX2.
        return unsafe { walk_avx2(tree, bundle, directions, active, room, blocked) };
    }
    blocked_portable(tree, bundle, directions, active, room, blocked)
}
