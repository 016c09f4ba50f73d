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
use super::lanes::{Lanes, Portable};

/// Rays of a bundle.
pub const BUNDLE: usize = 64;
const PACKETS: usize = BUNDLE / 8;

/// Set in a child's word when it is a leaf.
pub(super) const LEAF: u32 = 1 << 31;

/// Slack on every box test, in units of the normalised scene: covers the rounding of projected boxes and origins.
const SLACK: f32 = 2e-6;

/// The same for heights over a bundle's plane: more than their rounding, less than the lift of receivers.
const FLOOR: f32 = 5e-7;

/// Origins within this many median steps of each other belong to one patch.
const LINK: f32 = 4.0;

/// Triangles met per ray of a patch beyond which the rays are better walked one by one.
const FINE: u32 = 12;

/// Directions for which a patch that was too fine once goes one by one from the start: the next ones are its neighbours.
const MEMORY: u8 = 15;

/// Relative width of an edge that still counts as inside: a few units in the last place.
const EDGE: f32 = 4.8e-7;

/// Eight children of a node: centres and half extents of their boxes, and where they are.
#[repr(C, align(32))]
#[derive(Clone)]
pub(super) struct Node {
    pub centre: [[f32; 8]; 3],
    /// Negative for a child that is not there: its box meets nothing.
    pub half: [[f32; 8]; 3],
    pub child: [u32; 8],
}

/// Up to eight triangles, `corner[k][axis][triangle]`; a place that is not used repeats one point and blocks nothing.
#[repr(C, align(32))]
#[derive(Clone)]
pub(super) struct Leaf {
    pub corner: [[[f32; 8]; 3]; 3],
}

/// The tree of eight-wide nodes that beams walk; made by `tracer.rs` from the binary tree.
#[derive(Default)]
pub struct WideTree {
    pub(super) nodes: Vec<Node>,
    pub(super) leaves: Vec<Leaf>,
}

/// Origins of a bundle's rays, in the normalised scene.
#[repr(C, align(32))]
#[derive(Clone)]
pub struct Bundle {
    origin: [[[f32; 8]; PACKETS]; 3],
    /// Origins that lie close together, one bit each, and a normal of their surface. A bundle across a silhouette comes
    /// apart here: one beam around both sides would meet everything between them.
    pub patches: Vec<(u64, [f32; 3])>,
}

impl Bundle {
    /// A bundle of at most 64 origins and the normals of their surface; places left over repeat the last origin.
    pub fn new(origins: &[[f32; 3]], normals: &[[f32; 3]]) -> Self {
        debug_assert!(origins.len() <= BUNDLE && origins.len() == normals.len());
        let mut bundle = Bundle { origin: [[[0.0; 8]; PACKETS]; 3], patches: Vec::new() };
        for ray in 0..BUNDLE {
            if let Some(origin) = origins.get(ray.min(origins.len().saturating_sub(1))) {
                for axis in 0..3 {
                    bundle.origin[axis][ray / 8][ray % 8] = origin[axis];
                }
            }
        }
        bundle.patches = patches(origins, normals);
        bundle
    }
}

/// Single-linkage clusters: origins are linked when they are nearer than a few typical steps between neighbours.
fn patches(origins: &[[f32; 3]], normals: &[[f32; 3]]) -> Vec<(u64, [f32; 3])> {
    let square = |a: usize, b: usize| (0..3).map(|k| (origins[a][k] - origins[b][k]).powi(2)).sum::<f32>();
    let count = origins.len();
    let mut steps: Vec<f32> = (1..count).map(|ray| square(ray - 1, ray)).collect();
    steps.sort_by(f32::total_cmp);
    let link = steps.get(steps.len() / 2).map_or(0.0, |step| LINK * LINK * step);

    let mut found = Vec::new();
    let mut left: u64 = if count == BUNDLE { u64::MAX } else { (1 << count) - 1 };
    while left != 0 {
        let mut patch = left & left.wrapping_neg();
        let mut front = patch;
        left &= !patch;
        while front != 0 {
            let ray = front.trailing_zeros() as usize;
            front &= front - 1;
            for other in (0..count).filter(|&other| left >> other & 1 == 1 && square(ray, other) <= link) {
                front |= 1 << other;
                patch |= 1 << other;
            }
            left &= !patch;
        }
        let mut normal = [0.0; 3];
        for ray in (0..count).filter(|&ray| patch >> ray & 1 == 1) {
            normal = std::array::from_fn(|k| normal[k] + normals[ray][k]);
        }
        let length = normal.iter().map(|n| n * n).sum::<f32>().sqrt();
        found.push((patch, if length > 0.0 { normal.map(|n| n / length) } else { normals[patch.trailing_zeros() as usize] }));
    }
    found
}

/// A direction and the plane across it: an orthonormal frame.
struct BeamFrame {
    /// u, v and the direction itself.
    axes: [[f32; 3]; 3],
    normal: [f32; 3],
    /// Whether the direction leads away from the surface.
    rises: bool,
}

impl BeamFrame {
    /// The frame of a unit direction, its v axis along the projected normal of a surface: a patch of that surface is
    /// foreshortened along v, and the rectangle around it stays tight.
    fn new(direction: [f32; 3], normal: [f32; 3]) -> Self {
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
struct Reach<L> {
    /// u, v and the direction, one component a vector.
    axes: [[L; 3]; 3],
    /// A normal of the surface under the origins. Rays that rise along it cannot meet what lies below them all.
    up: [L; 3],
    /// Bounds in u and v, and of the origins' depths.
    low: [f32; 3],
    high: [f32; 3],
    /// The origins' heights over their plane reach down to this.
    floor: f32,
}

/// Bundle origins seen along the direction, and the boxes around those that are still open.
struct Beam<L> {
    /// u, v, depth, and height over the bundle's plane, of each packet.
    at: [[L; PACKETS]; 4],
    rises: bool,
    reach: Reach<L>,
    /// The bounds of each packet of eight rays, one packet a lane.
    packet_low: [[f32; 8]; 3],
    packet_high: [[f32; 8]; 3],
    packet_floor: [f32; 8],
}

impl<L: Lanes> Reach<L> {
    /// Bounds that nothing meets yet.
    #[inline(always)]
    fn new(frame: &BeamFrame) -> Self {
        let axes = [splat(&frame.axes[0]), splat(&frame.axes[1]), splat(&frame.axes[2])];
        Reach { axes, up: splat(&frame.normal), low: [0.0; 3], high: [0.0; 3], floor: f32::NEG_INFINITY }
    }
}

impl<L: Lanes> Beam<L> {
    #[inline(always)]
    fn new(bundle: &Bundle, frame: &BeamFrame) -> Self {
        let reach = Reach::<L>::new(frame);
        let mut at = [[L::splat(0.0); PACKETS]; 4];
        for packet in 0..PACKETS {
            let (x, y, z) =
                (L::load(&bundle.origin[0][packet]), L::load(&bundle.origin[1][packet]), L::load(&bundle.origin[2][packet]));
            for k in 0..3 {
                at[k][packet] = L::dot(x, y, z, &reach.axes[k]);
            }
            at[3][packet] = L::dot(x, y, z, &reach.up);
        }
        Beam {
            at,
            rises: frame.rises,
            reach,
            packet_low: [[0.0; 8]; 3],
            packet_high: [[0.0; 8]; 3],
            packet_floor: [f32::NEG_INFINITY; 8],
        }
    }

    /// The box around the open rays, so that a half-closed bundle meets less of the tree.
    #[inline(always)]
    fn bound(&mut self, open: u64) {
        let (lowest, highest) = (L::splat(f32::INFINITY), L::splat(f32::NEG_INFINITY));
        for k in 0..3 {
            for packet in 0..PACKETS {
                let bits = (open >> (8 * packet)) as u32 & 0xff;
                let (mut lows, mut highs) = ([0.0; 8], [0.0; 8]);
                L::select(bits, self.at[k][packet], lowest).store(&mut lows);
                L::select(bits, self.at[k][packet], highest).store(&mut highs);
                self.packet_low[k][packet] = least(&lows) - SLACK;
                self.packet_high[k][packet] = greatest(&highs) + SLACK;
            }
            self.reach.low[k] = least(&self.packet_low[k]);
            self.reach.high[k] = greatest(&self.packet_high[k]);
        }
        if self.rises {
            for packet in 0..PACKETS {
                let bits = (open >> (8 * packet)) as u32 & 0xff;
                let mut heights = [0.0; 8];
                L::select(bits, self.at[3][packet], lowest).store(&mut heights);
                self.packet_floor[packet] = least(&heights) - FLOOR;
            }
            self.reach.floor = least(&self.packet_floor);
        }
    }
}

// Inside the walk there are no closures over lanes (`map`, iterators): they do not inherit the caller's instruction set,
// and every operation in them becomes a call.

#[inline(always)]
fn least(of: &[f32; 8]) -> f32 {
    let (a, b) = (of[0].min(of[1]).min(of[2].min(of[3])), of[4].min(of[5]).min(of[6].min(of[7])));
    a.min(b)
}

#[inline(always)]
fn greatest(of: &[f32; 8]) -> f32 {
    let (a, b) = (of[0].max(of[1]).max(of[2].max(of[3])), of[4].max(of[5]).max(of[6].max(of[7])));
    a.max(b)
}

#[inline(always)]
fn splat<L: Lanes>(of: &[f32; 3]) -> [L; 3] {
    [L::splat(of[0]), L::splat(of[1]), L::splat(of[2])]
}

#[inline(always)]
fn load<L: Lanes>(of: &[[f32; 8]; 3]) -> [L; 3] {
    [L::load(&of[0]), L::load(&of[1]), L::load(&of[2])]
}

#[inline(always)]
fn length<L: Lanes>(of: [L; 2]) -> L {
    of[0].mul(of[0]).add(of[1].mul(of[1]))
}

#[inline(always)]
fn abs<L: Lanes>(of: &[L; 3]) -> [L; 3] {
    [of[0].abs(), of[1].abs(), of[2].abs()]
}

/// Which children of a node the beam meets: the box's shadow overlaps the rectangle, and the box is not behind.
#[inline(always)]
fn children_met<L: Lanes>(node: &Node, reach: &Reach<L>) -> u32 {
    let centre: [L; 3] = load(&node.centre);
    let half: [L; 3] = load(&node.half);
    let mut met = 0xff;
    for k in 0..2 {
        let middle = L::dot(centre[0], centre[1], centre[2], &reach.axes[k]);
        let extent = L::dot(half[0], half[1], half[2], &abs(&reach.axes[k]));
        met &= L::splat(reach.low[k]).le(middle.add(extent)) & middle.sub(extent).le(L::splat(reach.high[k]));
    }
    let far = L::dot(centre[0], centre[1], centre[2], &reach.axes[2])
        .add(L::dot(half[0], half[1], half[2], &abs(&reach.axes[2])));
    let top =
        L::dot(centre[0], centre[1], centre[2], &reach.up).add(L::dot(half[0], half[1], half[2], &abs(&reach.up)));
    met & L::splat(reach.low[2]).le(far) & L::splat(reach.floor).le(top)
}

/// Eight triangles seen along the beam: edge functions oriented to be positive inside, ready to be met by rays.
#[repr(C, align(32))]
#[derive(Default)]
struct Shadow {
    /// Edge k runs from corner k to k + 1: its base, its coefficients and its tolerance.
    base: [[[f32; 8]; 2]; 3],
    coefficient: [[[f32; 8]; 2]; 3],
    tolerance: [[f32; 8]; 3],
    /// Depth of the corner opposite to edge k.
    depth: [[f32; 8]; 3],
    /// The box around the shadow, and the farthest depth.
    low: [[f32; 8]; 2],
    high: [[f32; 8]; 3],
    /// The greatest height over the bundle's plane.
    top: [f32; 8],
}

/// Projects a leaf's triangles; returns those that the rectangle may meet and those that cover all of it in front.
#[inline(always)]
fn cast<L: Lanes>(leaf: &Leaf, reach: &Reach<L>, shadow: &mut Shadow) -> (u32, u32) {
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
        low.store(&mut shadow.low[k]);
        high.store(&mut shadow.high[k]);
    }
    let near = corner[0][2].min(corner[1][2]).min(corner[2][2]);
    let far = corner[0][2].max(corner[1][2]).max(corner[2][2]);
    met &= L::splat(reach.low[2]).lt(far);
    far.store(&mut shadow.high[2]);
    top.store(&mut shadow.top);
    if met == 0 {
        return (0, 0);
    }

    // Orientation; a triangle seen edge-on blocks nothing (its neighbours' edges hold the rounding error).
    let first = [corner[1][0].sub(corner[0][0]), corner[1][1].sub(corner[0][1])];
    let last = [corner[2][0].sub(corner[0][0]), corner[2][1].sub(corner[0][1])];
    let area = first[0].mul(last[1]).sub(first[1].mul(last[0]));
    let flat = L::splat(EDGE).mul(length(first).max(length(last)));
    met &= flat.lt(area.abs());
    let clockwise = area.lt(L::splat(0.0));

    let middle = [L::splat(0.5 * (reach.low[0] + reach.high[0])), L::splat(0.5 * (reach.low[1] + reach.high[1]))];
    let radius =
        [L::splat(0.5 * (reach.high[0] - reach.low[0]) + SLACK), L::splat(0.5 * (reach.high[1] - reach.low[1]) + SLACK)];
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
        let tolerance = L::splat(EDGE).mul(length(along));

        // The whole rectangle beyond one edge: not met. Inside all three and in front: everything is blocked.
        let value = a.mul(middle[0].sub(base[0])).add(b.mul(middle[1].sub(base[1])));
        let extent = a.abs().mul(radius[0]).add(b.abs().mul(radius[1]));
        met &= tolerance.neg().le(value.add(extent));
        covered &= tolerance.lt(value.sub(extent));

        base[0].store(&mut shadow.base[k][0]);
        base[1].store(&mut shadow.base[k][1]);
        a.store(&mut shadow.coefficient[k][0]);
        b.store(&mut shadow.coefficient[k][1]);
        tolerance.neg().store(&mut shadow.tolerance[k]);
        corner[(k + 2) % 3][2].store(&mut shadow.depth[k]);
    }
    (met, covered & met)
}

/// The open rays that one triangle blocks.
#[inline(always)]
fn blocked_by<L: Lanes>(shadow: &Shadow, triangle: usize, beam: &Beam<L>, open: u64) -> u64 {
    // Small triangles meet few packets: one comparison over the eight packet boxes finds them.
    let mut packets = L::load(&beam.packet_low[2]).le(L::splat(shadow.high[2][triangle]));
    packets &= L::load(&beam.packet_floor).le(L::splat(shadow.top[triangle]));
    for k in 0..2 {
        packets &= L::load(&beam.packet_low[k]).le(L::splat(shadow.high[k][triangle]));
        packets &= L::splat(shadow.low[k][triangle]).le(L::load(&beam.packet_high[k]));
    }
    let mut blocked = 0;
    while packets != 0 {
        let packet = packets.trailing_zeros() as usize;
        packets &= packets - 1;
        let bits = (open >> (8 * packet)) as u32 & 0xff;
        let (u, v, t) = (beam.at[0][packet], beam.at[1][packet], beam.at[2][packet]);
        let mut inside = bits;
        let mut ahead = L::splat(0.0);
        for k in 0..3 {
            let (base, slope) = (&shadow.base[k], &shadow.coefficient[k]);
            let edge = L::splat(slope[0][triangle])
                .mul(u.sub(L::splat(base[0][triangle])))
                .add(L::splat(slope[1][triangle]).mul(v.sub(L::splat(base[1][triangle]))));
            inside &= L::splat(shadow.tolerance[k][triangle]).le(edge);
            // Edge functions are barycentric weights: their sum with the depths says whether the hit lies in front.
            ahead = ahead.add(edge.mul(L::splat(shadow.depth[k][triangle]).sub(t)));
        }
        if inside != 0 {
            inside &= L::splat(0.0).lt(ahead);
            blocked |= (inside as u64) << (8 * packet);
        }
    }
    blocked
}

/// Whether any of eight triangles blocks one ray: the same arithmetic as `blocked_by`, across triangles.
#[inline(always)]
fn blocks<L: Lanes>(shadow: &Shadow, at: [f32; 3]) -> u32 {
    let (u, v, t) = (L::splat(at[0]), L::splat(at[1]), L::splat(at[2]));
    let mut inside = 0xff;
    let mut ahead = L::splat(0.0);
    for k in 0..3 {
        let (base, slope) = (&shadow.base[k], &shadow.coefficient[k]);
        let edge = L::load(&slope[0])
            .mul(u.sub(L::load(&base[0])))
            .add(L::load(&slope[1]).mul(v.sub(L::load(&base[1]))));
        inside &= L::load(&shadow.tolerance[k]).le(edge);
        ahead = ahead.add(edge.mul(L::load(&shadow.depth[k]).sub(t)));
    }
    inside & L::splat(0.0).lt(ahead)
}

/// Room for the walk, kept between calls.
#[derive(Default)]
pub struct Walk {
    stack: Vec<u32>,
    shadow: Shadow,
    /// For each patch of the bundle at hand, for how many directions more it goes one by one.
    fine: Vec<u8>,
}

impl Walk {
    /// Forgets what the last bundle's patches were like.
    pub fn begin(&mut self, bundle: &Bundle) {
        self.fine.clear();
        self.fine.resize(bundle.patches.len(), 0);
    }
}

#[inline(always)]
fn walk<L: Lanes>(tree: &WideTree, bundle: &Bundle, direction: [f32; 3], active: u64, room: &mut Walk) -> u64 {
    let mut blocked = 0;
    if tree.nodes.is_empty() {
        return blocked;
    }
    for (number, &(patch, normal)) in bundle.patches.iter().enumerate() {
        let active = patch & active;
        if active == 0 {
            continue;
        }
        let mut beam = Beam::<L>::new(bundle, &BeamFrame::new(direction, normal));
        let mut fine = room.fine.get(number).copied().unwrap_or(0);
        blocked |= if fine > 0 { one_by_one(tree, &mut beam, active, room) } else { together(tree, &mut beam, active, room, &mut fine) };
        if let Some(memory) = room.fine.get_mut(number) {
            *memory = fine.saturating_sub(1);
        }
    }
    blocked
}

/// The walk of one patch: box by box, until every ray is blocked or nothing is left.
///
/// Where triangles are much smaller than the patch, eight rays at a time meet one triangle at a time for nothing: the
/// rays still open then go their way one by one. Both ways give the same answer to the bit.
#[inline(always)]
fn together<L: Lanes>(tree: &WideTree, beam: &mut Beam<L>, active: u64, room: &mut Walk, fine: &mut u8) -> u64 {
    beam.bound(active);
    let mut open = active;
    let mut bounded = active.count_ones();
    let mut met_so_far = 0;
    room.stack.clear();
    room.stack.push(0);
    while let Some(place) = room.stack.pop() {
        if place & LEAF == 0 {
            push_children(&tree.nodes[place as usize], &beam.reach, room);
            continue;
        }
        let (mut met, covering) = cast(&tree.leaves[(place & !LEAF) as usize], &beam.reach, &mut room.shadow);
        if covering != 0 {
            return active;
        }
        met_so_far += met.count_ones();
        while met != 0 {
            open &= !blocked_by(&room.shadow, met.trailing_zeros() as usize, beam, open);
            met &= met - 1;
        }
        if open == 0 {
            return active;
        }
        if met_so_far > FINE * bounded {
            *fine = MEMORY;
            return active & !open | one_by_one(tree, beam, open, room);
        }
        if 2 * open.count_ones() <= bounded {
            bounded = open.count_ones();
            beam.bound(open);
        }
    }
    active & !open
}

#[inline(always)]
fn push_children<L: Lanes>(node: &Node, reach: &Reach<L>, room: &mut Walk) {
    let mut met = children_met(node, reach);
    while met != 0 {
        room.stack.push(node.child[met.trailing_zeros() as usize]);
        met &= met - 1;
    }
}

/// Each open ray by itself, across eight boxes and eight triangles at a time.
#[inline(always)]
fn one_by_one<L: Lanes>(tree: &WideTree, beam: &mut Beam<L>, open: u64, room: &mut Walk) -> u64 {
    let mut seen = [[0.0f32; BUNDLE]; 4];
    for k in 0..4 {
        for packet in 0..PACKETS {
            let lanes: &mut [f32; 8] = (&mut seen[k][8 * packet..8 * packet + 8]).try_into().expect("eight lanes");
            beam.at[k][packet].store(lanes);
        }
    }
    let mut blocked = 0;
    let mut left = open;
    while left != 0 {
        let ray = left.trailing_zeros() as usize;
        left &= left - 1;
        for k in 0..3 {
            beam.reach.low[k] = seen[k][ray] - SLACK;
            beam.reach.high[k] = seen[k][ray] + SLACK;
        }
        beam.reach.floor = if beam.rises { seen[3][ray] - FLOOR } else { f32::NEG_INFINITY };
        let at = [seen[0][ray], seen[1][ray], seen[2][ray]];
        room.stack.clear();
        room.stack.push(0);
        while let Some(place) = room.stack.pop() {
            if place & LEAF == 0 {
                push_children(&tree.nodes[place as usize], &beam.reach, room);
                continue;
            }
            let (met, _) = cast(&tree.leaves[(place & !LEAF) as usize], &beam.reach, &mut room.shadow);
            if met != 0 && met & blocks::<L>(&room.shadow, at) != 0 {
                blocked |= 1 << ray;
                break;
            }
        }
    }
    blocked
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn walk_avx2(tree: &WideTree, bundle: &Bundle, direction: [f32; 3], active: u64, room: &mut Walk) -> u64 {
    walk::<Avx2>(tree, bundle, direction, active, room)
}

/// The portable walk: what processors without AVX2 take, and the oracle of the other.
pub fn blocked_portable(tree: &WideTree, bundle: &Bundle, direction: [f32; 3], active: u64, room: &mut Walk) -> u64 {
    walk::<Portable>(tree, bundle, direction, active, room)
}

/// Which of the `active` rays (one bit each) of a bundle meet a triangle in a unit direction.
pub fn blocked(tree: &WideTree, bundle: &Bundle, direction: [f32; 3], active: u64, room: &mut Walk) -> u64 {
    #[cfg(target_arch = "x86_64")]
    if std::is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has AVX2.
        return unsafe { walk_avx2(tree, bundle, direction, active, room) };
    }
    blocked_portable(tree, bundle, direction, active, room)
}
