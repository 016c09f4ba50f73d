//! What a transform moves: a scalar, a colour, or the 16 rows of a group.

/// A texel's worth of numbers that are transformed alike: a scalar, a colour, or 16 neighbouring rows of M.
pub trait Texel: Copy + Send + Sync {
    /// All numbers zero: where sums start.
    const ZERO: Self;

    /// `Σ weights[k] * lanes[k]`.
    fn combine(lanes: [&Self; 4], weights: [f64; 4]) -> Self;

    /// self + weight * other.
    fn plus(&self, other: &Self, weight: f64) -> Self;
}

impl Texel for f64 {
    const ZERO: f64 = 0.0;

    #[inline(always)]
    fn combine([a, b, c, d]: [&f64; 4], w: [f64; 4]) -> f64 {
        (w[0] * a + w[1] * b) + (w[2] * c + w[3] * d)
    }

    #[inline(always)]
    fn plus(&self, other: &f64, weight: f64) -> f64 {
        self + weight * other
    }
}

impl Texel for [f64; 3] {
    const ZERO: [f64; 3] = [0.0; 3];

    #[inline(always)]
    fn combine([a, b, c, d]: [&[f64; 3]; 4], w: [f64; 4]) -> [f64; 3] {
        std::array::from_fn(|i| (w[0] * a[i] + w[1] * b[i]) + (w[2] * c[i] + w[3] * d[i]))
    }

    #[inline(always)]
    fn plus(&self, other: &[f64; 3], weight: f64) -> [f64; 3] {
        std::array::from_fn(|i| self[i] + weight * other[i])
    }
}

impl Texel for [f32; 16] {
    const ZERO: [f32; 16] = [0.0; 16];

    #[inline(always)]
    fn combine([a, b, c, d]: [&[f32; 16]; 4], w: [f64; 4]) -> [f32; 16] {
        let w = w.map(|weight| weight as f32);
        let mut sum = [0.0; 16];
        for i in 0..16 {
            sum[i] = (w[0] * a[i] + w[1] * b[i]) + (w[2] * c[i] + w[3] * d[i]);
        }
        sum
    }

    #[inline(always)]
    fn plus(&self, other: &[f32; 16], weight: f64) -> [f32; 16] {
        let weight = weight as f32;
        let mut sum = *self;
        for i in 0..16 {
            sum[i] += weight * other[i];
        }
        sum
    }
}
