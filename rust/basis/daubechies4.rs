//! Daubechies-4 wavelets on an interval of 256 samples: the basis of BRDF curves (Ben-Artzi et al. 2006).
//!
//! ```text
//!     a = W c        low-pass taps h = (1 + √3, 3 + √3, 3 - √3, 1 - √3) / 4√2, high-pass g = (h3, -h2, h1, -h0)
//! ```
//!
//! At each of five levels the interior rows are the four taps at the odd offsets 3 to n - 7. What they leave is four
//! dimensions in the first five samples and four in the last five; there what the level has of 1 and of x spans two low-pass
//! rows, and the rest is high-pass: what it has of x³, and what is left (a highlight then takes one term less than with any
//! two rows). So W is orthonormal, constants and ramps stay in the scaling functions, and nothing leaks
//! from one end of a curve to the other.
//!
//! Tried and left: periodic ends (10 terms of a highlight leave a fifth of its peak at grazing angles), and mirroring to 512
//! samples (twice the columns, so twice the frames until a curve is exact).

use std::ops::Range;
use std::sync::OnceLock;

/// Samples of a curve, and its coefficients.
pub const CURVE: usize = 256;
/// Scaling functions, with which five levels end.
pub const COARSEST: usize = 8;
/// Samples that an end's rows touch.
const EDGE: usize = 5;

/// The two low-pass rows of an end, then its two high-pass ones.
type Edge = [[f64; EDGE]; 4];

/// One level: from n samples to n / 2 and as many details.
struct Level {
    left: Edge,
    /// Over the last five samples.
    right: Edge,
}

/// The transform of curves.
pub struct Daubechies4 {
    /// From the finest to the coarsest.
    levels: Vec<Level>,
}

/// h of the module's head.
fn taps() -> [f64; 4] {
    let (root, scale) = (3f64.sqrt(), 4.0 * 2f64.sqrt());
    [(1.0 + root) / scale, (3.0 + root) / scale, (3.0 - root) / scale, (1.0 - root) / scale]
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// What of a vector is at right angles to some unit vectors, made unit; twice, so that rounding is as well.
fn beside(mut vector: [f64; 4], others: &[[f64; 4]]) -> [f64; 4] {
    for _ in 0..2 {
        for other in others {
            let along = dot(&vector, other);
            vector.iter_mut().zip(other).for_each(|(x, y)| *x -= along * y);
        }
        let length = dot(&vector, &vector).sqrt();
        vector.iter_mut().for_each(|x| *x /= length);
    }
    vector
}

/// The rows of an end, whose free dimensions four unit vectors span, from what it has of 1, of x and of x³. Measured in those
/// dimensions nothing that rounding leaves reaches the interior rows.
fn edge(free: [[f64; EDGE]; 4], images: [&[f64]; 3]) -> Edge {
    let [one, x, cube] = images.map(|image| free.map(|own| dot(&own, image)));
    let constant = beside(one, &[]);
    let ramp = beside(x, &[constant]);
    let bend = beside(cube, &[constant, ramp]);
    let known = [constant, ramp, bend];
    // Of the four directions that which the three know least.
    let left = |k: usize| 1.0 - known.iter().map(|own| own[k] * own[k]).sum::<f64>();
    let least = (1..4).fold(0, |best, k| if left(k) > left(best) { k } else { best });
    let rest = beside(std::array::from_fn(|k| f64::from(u8::from(k == least))), &known);
    [constant, ramp, bend, rest].map(|row| std::array::from_fn(|k| (0..4).map(|own| row[own] * free[own][k]).sum()))
}

impl Level {
    /// `images`: what this level's samples are of curves that are 1, x and x³.
    fn new(images: &[Vec<f64>; 3]) -> Level {
        let [h0, h1, h2, h3] = taps();
        let unit = |place: usize| std::array::from_fn(|k| f64::from(u8::from(k == place)));
        // The interior rows that begin at sample 3 reach samples 3 and 4 of the left end by multiples of one vector, as
        // h0 h2 + h1 h3 = 0; those that end at sample n - 4 likewise on the right.
        let inner = |a: f64, b: f64| {
            let length = (a * a + b * b).sqrt();
            [b / length, -a / length]
        };
        let ([a, b], [c, d]) = (inner(h0, h1), inner(h2, h3));
        let left = [unit(0), unit(1), unit(2), [0.0, 0.0, 0.0, a, b]];
        let right = [unit(4), unit(3), unit(2), [c, d, 0.0, 0.0, 0.0]];
        let last = images[0].len() - EDGE;
        let [first, end] = [0..EDGE, last..last + EDGE];
        let of = |range: Range<usize>| images.each_ref().map(|image| &image[range.clone()]);
        Level { left: edge(left, of(first)), right: edge(right, of(end)) }
    }

    /// Rows of a level over n samples: their first samples and their values, low-pass ones first.
    fn rows(&self, n: usize) -> impl Iterator<Item = (usize, &[f64])> {
        static TAPS: OnceLock<[[f64; 4]; 2]> = OnceLock::new();
        let [low, high] = TAPS.get_or_init(|| {
            let h = taps();
            [h, [h[3], -h[2], h[1], -h[0]]]
        });
        let half = move |taps: &'static [f64; 4], first: usize| {
            let left = self.left[first..first + 2].iter().map(|row| (0, row.as_slice()));
            let inside = (3..=n - 7).step_by(2).map(move |offset| (offset, taps.as_slice()));
            let right = self.right[first..first + 2].iter().map(move |row| (n - EDGE, row.as_slice()));
            left.chain(inside).chain(right)
        };
        half(low, 0).chain(half(high, 2))
    }
}

impl Daubechies4 {
    /// The one table of its rows, made on first use.
    pub fn shared() -> &'static Daubechies4 {
        static MADE: OnceLock<Daubechies4> = OnceLock::new();
        MADE.get_or_init(|| {
            let mut levels = Vec::new();
            // About the middle, so that both ends are alike.
            let middle = 0.5 * (CURVE - 1) as f64;
            let power = |exponent| (0..CURVE).map(|k| (k as f64 - middle).powi(exponent)).collect();
            let mut images: [Vec<f64>; 3] = [0, 1, 3].map(power);
            while images[0].len() > COARSEST {
                let n = images[0].len();
                let level = Level::new(&images);
                images = images.map(|image| {
                    level.rows(n).take(n / 2).map(|(first, row)| dot(row, &image[first..first + row.len()])).collect()
                });
                levels.push(level);
            }
            Daubechies4 { levels }
        })
    }

    /// Coefficients of samples: the scaling functions, then details from coarse to fine.
    pub fn forward(&self, samples: &[f64; CURVE]) -> [f64; CURVE] {
        let (mut values, mut next) = (*samples, [0.0; CURVE]);
        let mut n = CURVE;
        for level in &self.levels {
            for (out, (first, row)) in next.iter_mut().zip(level.rows(n)) {
                *out = dot(row, &values[first..first + row.len()]);
            }
            values[..n].copy_from_slice(&next[..n]);
            n /= 2;
        }
        values
    }

    /// Samples of coefficients.
    pub fn inverse(&self, coefficients: &[f64; CURVE]) -> [f64; CURVE] {
        let mut values = *coefficients;
        let mut n = COARSEST;
        for level in self.levels.iter().rev() {
            n *= 2;
            let mut sum = [0.0; CURVE];
            for (value, (first, row)) in values.iter().zip(level.rows(n)) {
                sum[first..].iter_mut().zip(row).for_each(|(sum, tap)| *sum += value * tap);
            }
            values[..n].copy_from_slice(&sum[..n]);
        }
        values
    }
}
