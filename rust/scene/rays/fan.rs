//! Fans: up to 64 rays that share an origin and lead into one octant of one axis.
//!
//! Seen along its major axis a ray is a pair of slopes: it goes through (s z, t z, z) for z > 0. A fan's own axes are
//! those of space, permuted and mirrored so that all slopes lie in [0, 1] and all rays go up: boxes stay boxes, and
//! nothing is rotated.

use super::holes::ray_number;

/// Rays of a fan, one bit each.
pub const FAN: usize = 64;
/// Packets of eight rays in a fan.
pub(super) const PACKETS: usize = FAN / 8;

/// Slopes below this have the inverse of this: no product of a box with it is NaN or infinite.
const FLAT: f32 = 1e-20;

/// 1 / slope, as every path takes it.
#[inline(always)]
pub(super) fn inverse(slope: f32) -> f32 {
    1.0 / slope.max(FLAT)
}

/// The axes of a fan: which axis of space each of its own is, and in which sense.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Octant {
    /// Axes of space of the two slopes, and the major one.
    pub axes: [usize; 3],
    /// Where the fan's axis runs against that of space.
    pub mirrored: [bool; 3],
}

impl Octant {
    /// The octant of a direction (of any length but zero): its largest component is the major axis.
    pub fn of(direction: [f32; 3]) -> Self {
        let major = (0..3).fold(0, |best, k| if direction[k].abs() > direction[best].abs() { k } else { best });
        let axes = [(major + 1) % 3, (major + 2) % 3, major];
        Octant { axes, mirrored: axes.map(|axis| direction[axis] < 0.0) }
    }

    /// A vector of space along the fan's axes.
    pub(super) fn seen(&self, vector: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|k| if self.mirrored[k] { -vector[self.axes[k]] } else { vector[self.axes[k]] })
    }

    /// The slopes of a direction that lies in this octant.
    pub fn slopes(&self, direction: [f32; 3]) -> [f32; 2] {
        let [x, y, z] = self.seen(direction);
        [x / z, y / z]
    }
}

/// Up to 64 rays of one octant; where they start is said when they are traced.
#[derive(Clone, Debug, Default)]
pub struct Fan {
    pub(super) octant: Octant,
    len: usize,
    /// `slope[axis][packet][ray]`, and the inverse of each.
    pub(super) slope: [[[f32; 8]; PACKETS]; 2],
    pub(super) inverse: [[[f32; 8]; PACKETS]; 2],
    /// Where each ray ends along the major axis: it is blocked by what lies nearer.
    pub(super) far: [[f32; 8]; PACKETS],
    /// Whether any ray ends at all.
    pub(super) finite: bool,
}

impl Fan {
    /// No ray yet.
    pub fn new(octant: Octant) -> Self {
        Fan { octant, ..Fan::default() }
    }

    /// Forgets all rays, and takes others of an octant.
    pub fn restart(&mut self, octant: Octant) {
        self.octant = octant;
        self.clear();
    }

    /// Forgets all rays.
    pub fn clear(&mut self) {
        (self.len, self.finite) = (0, false);
    }

    /// Adds a ray that never ends. `slopes` lie in [0, 1]; at most `FAN` rays.
    pub fn push(&mut self, slopes: [f32; 2]) {
        self.push_segment(slopes, f32::INFINITY);
    }

    /// Adds a ray that ends `far` along the major axis.
    pub fn push_segment(&mut self, slopes: [f32; 2], far: f32) {
        debug_assert!(self.len < FAN && slopes.iter().all(|slope| (0.0..=1.0).contains(slope)));
        let (packet, lane) = (self.len / 8, self.len % 8);
        for (axis, slope) in slopes.into_iter().enumerate() {
            self.slope[axis][packet][lane] = slope;
            self.inverse[axis][packet][lane] = inverse(slope);
        }
        self.far[packet][lane] = far;
        self.finite |= far < f32::INFINITY;
        self.len += 1;
    }

    /// A number of one of its rays, which none of the others changes.
    pub(super) fn number(&self, origin: [f32; 3], ray: usize) -> u64 {
        let slopes = [0, 1].map(|axis: usize| self.slope[axis][ray / 8][ray % 8]);
        let sides: u64 =
            (0..3).map(|k| (self.octant.axes[k] as u64 * 2 + u64::from(self.octant.mirrored[k])) << (8 * k)).sum();
        ray_number(origin, &slopes) ^ sides
    }

    /// Rays in it.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether it has no ray.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Whether it takes no more.
    pub fn is_full(&self) -> bool {
        self.len == FAN
    }

    /// All its rays, one bit each.
    pub fn all(&self) -> u64 {
        if self.is_empty() { 0 } else { u64::MAX >> (FAN - self.len) }
    }
}

/// Sorts any directions into fans: each with the places in the list that its rays come from. Neighbours in the list stay
/// together: a list of blocks of neighbouring directions makes narrow fans.
pub fn fans(directions: &[[f32; 3]]) -> Vec<(Fan, Vec<usize>)> {
    let mut found: Vec<(Fan, Vec<usize>)> = Vec::new();
    for (place, &direction) in directions.iter().enumerate() {
        let octant = Octant::of(direction);
        let open = found.iter_mut().rev().take(OCTANTS).find(|(fan, _)| fan.octant == octant && !fan.is_full());
        let (fan, places) = match open {
            Some(open) => open,
            None => {
                found.push((Fan::new(octant), Vec::new()));
                found.last_mut().expect("just pushed")
            }
        };
        fan.push(octant.slopes(direction));
        places.push(place);
    }
    found
}

/// Three major axes, two senses of each axis.
const OCTANTS: usize = 24;
