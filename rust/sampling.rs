//! Directions and numbers that are spread evenly, and depend on nothing but an index.

/// Two numbers in [0, 1) (SplitMix64).
pub fn jitter(index: u64) -> [f64; 2] {
    let z = mixed(index);
    [(z >> 32) as f64, (z & 0xffff_ffff) as f64].map(|half| half / 4_294_967_296.0)
}

/// A number that looks like none of its neighbours.
pub fn mixed(index: u64) -> u64 {
    let mut z = index.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Two unit vectors that make a right-handed frame with a unit normal (Duff et al. 2017).
pub fn frame(n: [f64; 3]) -> [[f64; 3]; 2] {
    let sign = 1.0f64.copysign(n[2]);
    let a = -1.0 / (sign + n[2]);
    let b = n[0] * n[1] * a;
    [[1.0 + sign * n[0] * n[0] * a, sign * b, -sign * n[0]], [b, sign + n[1] * n[1] * a, -n[1]]]
}

/// `side` x `side` directions about a normal, as dense as the cosine to it: each stands for the same share of the light
/// that a diffuse surface receives. `seed` moves them inside their strata.
pub fn cosine_directions(normal: [f64; 3], side: usize, seed: u64) -> impl Iterator<Item = [f64; 3]> {
    let [tangent, bitangent] = frame(normal);
    (0..side * side).map(move |k| {
        let [x, y] = jitter(mixed(seed) ^ k as u64);
        let (height, turn) = (((k % side) as f64 + x) / side as f64, ((k / side) as f64 + y) / side as f64);
        let (radius, angle) = (height.sqrt(), std::f64::consts::TAU * turn);
        let (s, t, up) = (radius * angle.cos(), radius * angle.sin(), (1.0 - height).max(0.0).sqrt());
        std::array::from_fn(|k| s * tangent[k] + t * bitangent[k] + up * normal[k])
    })
}

/// A direction in part `k` of the hemisphere about z, which is cut into `heights` x `turns` parts of one size: at `x`, `y`
/// inside it, from 0 to 1.
pub fn in_part(k: usize, [heights, turns]: [usize; 2], [x, y]: [f64; 2]) -> [f64; 3] {
    let (up, turn) = (((k % heights) as f64 + x) / heights as f64, ((k / heights) as f64 + y) / turns as f64);
    let (radius, angle) = ((1.0 - up * up).max(0.0).sqrt(), std::f64::consts::TAU * turn);
    [radius * angle.cos(), radius * angle.sin(), up]
}

/// Which of some shares a number between 0 and their sum falls into, and how far inside it lies, from 0 to 1: as good as
/// another even number. `sums`: of the shares, up to and with each.
pub fn chosen(sums: &[f64], at: f64) -> (usize, f64) {
    let number = sums.partition_point(|&sum| sum <= at).min(sums.len() - 1);
    let before = if number == 0 { 0.0 } else { sums[number - 1] };
    (number, ((at - before) / (sums[number] - before)).clamp(0.0, 1.0))
}
