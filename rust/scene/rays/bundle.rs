//! Bundles: the neighbouring receivers whose rays are traced together.

/// Rays of a bundle.
pub const BUNDLE: usize = 64;
/// Packets of eight rays in a bundle.
pub(super) const PACKETS: usize = BUNDLE / 8;

/// Origins within this many median steps of each other belong to one patch.
const LINK: f32 = 3.0;

/// Origins of a bundle's rays, in the normalised scene.
#[repr(C, align(32))]
#[derive(Clone)]
pub struct Bundle {
    /// `[axis][packet][ray]`.
    pub(super) origin: [[[f32; 8]; PACKETS]; 3],
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
                for (axis, &at) in origin.iter().enumerate() {
                    bundle.origin[axis][ray / 8][ray % 8] = at;
                }
            }
        }
        bundle.patches = patches(origins, normals);
        bundle
    }

    /// The box around some origins: its least and greatest corner.
    pub(super) fn bounds(&self, mut rays: u64) -> ([f32; 3], [f32; 3]) {
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        while rays != 0 {
            let ray = rays.trailing_zeros() as usize;
            rays &= rays - 1;
            for axis in 0..3 {
                low[axis] = low[axis].min(self.origin[axis][ray / 8][ray % 8]);
                high[axis] = high[axis].max(self.origin[axis][ray / 8][ray % 8]);
            }
        }
        (low, high)
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
        found.push((
            patch,
            if length > 0.0 { normal.map(|n| n / length) } else { normals[patch.trailing_zeros() as usize] },
        ));
    }
    found
}
