//! Real, orthonormal spherical harmonics: evaluated, rotated, windowed.
//!
//! Convention, for a unit direction (x, y, z) with polar axis +Z, z = cos θ and x + iy = sin θ e^{iφ}:
//!
//! ```text
//!     Y_l^m  = sqrt(2) N_l^m P_l^m(z) cos(m φ)       m > 0
//!     Y_l^0  =         N_l^0 P_l^0(z)                                  ∫ Y_j Y_k dω = δ_jk
//!     Y_l^-m = sqrt(2) N_l^m P_l^m(z) sin(m φ)       m > 0
//! ```
//!
//! with P_l^m *without* the Condon-Shortley sign (-1)^m, so that Y_1^{-1, 0, 1} = sqrt(3 / 4π) (y, z, x). An order of n
//! takes the degrees l = 0 .. n - 1; Y_l^m is number l² + l + m: degree by degree, the n² first of any higher order.
//!
//! Evaluation recurs on fully normalised functions (Holmes and Featherstone 2002, section 2): factorials never appear,
//! which in f32 vanish silently from l = 18 on.

use std::f64::consts::PI;

use crate::error::{Error, Result};

use super::bands::ColumnSpace;

/// The number of Y_l^m.
pub fn index(degree: usize, m: isize) -> usize {
    (degree * (degree + 1)).wrapping_add_signed(m)
}

/// The degree and m of a function's number.
pub fn degree_and_m(index: usize) -> (usize, isize) {
    let degree = index.isqrt();
    (degree, index as isize - (degree * (degree + 1)) as isize)
}

/// Evaluates the functions of one order.
pub struct SphericalHarmonics {
    order: usize,
    /// (a, b) of N_l^m P_l^m = a (z N_{l-1}^m P_{l-1}^m - b N_{l-2}^m P_{l-2}^m), at `index(l, m)` for 0 <= m < l.
    steps: Vec<(f64, f64)>,
}

impl SphericalHarmonics {
    /// Prepares the recurrences; refuses orders outside 1 to `ColumnSpace::MAX_ORDER`.
    pub fn new(order: usize) -> Result<Self> {
        ColumnSpace::spherical_harmonics(order)?;
        let mut steps = vec![(0.0, 0.0); order * order];
        for degree in 1..order {
            let l = degree as f64;
            for m in 0..degree {
                let square = (m * m) as f64;
                let a = ((4.0 * l * l - 1.0) / (l * l - square)).sqrt();
                let b = (((l - 1.0) * (l - 1.0) - square) / (4.0 * (l - 1.0) * (l - 1.0) - 1.0)).sqrt();
                // P_{l-2}^m = 0 where l - 2 < m, and then b is 0 as well (or 0 / -1 at l = 1).
                steps[index(degree, m as isize)] = (a, if degree >= m + 2 { b } else { 0.0 });
            }
        }
        Ok(SphericalHarmonics { order, steps })
    }

    /// Degrees evaluated: l = 0 .. order - 1.
    pub fn order(&self) -> usize {
        self.order
    }

    /// Writes all order² functions of a unit direction.
    pub fn evaluate(&self, [x, y, z]: [f64; 3], values: &mut [f64]) {
        assert_eq!(values.len(), self.order * self.order);
        // sin^m θ (cos mφ, sin mφ) = (Re, Im) (x + iy)^m, times what P_m^m and the root of 2 contribute.
        let mut sectoral = (1.0 / (4.0 * PI)).sqrt();
        let (mut cosine, mut sine) = (1.0, 0.0);
        for m in 0..self.order {
            if m > 0 {
                (cosine, sine) = (x * cosine - y * sine, x * sine + y * cosine);
                let both = if m == 1 { 2.0 } else { 1.0 };
                sectoral *= (both * (2 * m + 1) as f64 / (2 * m) as f64).sqrt();
            }
            let (mut now, mut before) = (sectoral, 0.0);
            for degree in m..self.order {
                if degree > m {
                    let (a, b) = self.steps[index(degree, m as isize)];
                    (now, before) = (a * (z * now - b * before), now);
                }
                values[index(degree, -(m as isize))] = now * sine;
                values[index(degree, m as isize)] = now * cosine;
            }
        }
    }
}

/// How the coefficients of every degree turn with the sphere: f'(d) = f(R⁻¹ d).
///
/// Ivanic and Ruedenberg 1996 with the corrections of 1998, in f64: each degree from the one before it and R itself.
/// R may be any orthogonal matrix, a mirror too. Rotate the original coefficients every frame: rotations of rotations
/// gather rounding (‖R Rᵀ - I‖ grows linearly), one rotation is right to 1e-13.
pub struct Rotation {
    /// `degrees[l]` holds the (2l + 1)² elements R^l_{m n} in rows.
    degrees: Vec<Vec<f64>>,
}

/// One degree of a rotation, addressed by m and n from -l to l.
struct Degree<'a> {
    degree: isize,
    elements: &'a [f64],
}

impl Degree<'_> {
    fn at(&self, m: isize, n: isize) -> f64 {
        let side = 2 * self.degree + 1;
        self.elements[((m + self.degree) * side + n + self.degree) as usize]
    }
}

impl Rotation {
    /// For the degrees of an order, from an orthogonal matrix in rows.
    pub fn new(order: usize, matrix: &[[f64; 3]; 3]) -> Result<Self> {
        ColumnSpace::spherical_harmonics(order)?;
        // Degree 1 is the matrix itself, on (y, z, x).
        const AXES: [usize; 3] = [1, 2, 0];
        let first: Vec<f64> = (0..9).map(|k| matrix[AXES[k / 3]][AXES[k % 3]]).collect();
        let mut degrees = vec![vec![1.0], first];
        for degree in 2..order {
            let next = next_degree(degree as isize, &degrees[1], &degrees[degree - 1]);
            degrees.push(next);
        }
        degrees.truncate(order);
        Ok(Rotation { degrees })
    }

    /// The coefficients of the rotated function.
    pub fn apply(&self, coefficients: &[[f64; 3]]) -> Vec<[f64; 3]> {
        assert_eq!(coefficients.len(), self.degrees.len() * self.degrees.len());
        let mut rotated = Vec::with_capacity(coefficients.len());
        for (degree, elements) in self.degrees.iter().enumerate() {
            let own = &coefficients[degree * degree..(degree + 1) * (degree + 1)];
            rotated.extend(elements.chunks_exact(own.len()).map(|row| {
                row.iter().zip(own).fold([0.0; 3], |sum: [f64; 3], (element, colour)| {
                    std::array::from_fn(|channel| sum[channel] + element * colour[channel])
                })
            }));
        }
        rotated
    }
}

/// R^l from R^1 and R^{l-1}: tables 1 and 2 of the paper, row by row.
fn next_degree(l: isize, first: &[f64], below: &[f64]) -> Vec<f64> {
    let first = Degree { degree: 1, elements: first };
    let below = Degree { degree: l - 1, elements: below };
    // P_i(m, n): an element of R^{l-1}, moved by row i of R^1; in the outermost columns two of them.
    let moved = |i: isize, m: isize, n: isize| {
        if n == l {
            first.at(i, 1) * below.at(m, l - 1) - first.at(i, -1) * below.at(m, 1 - l)
        } else if n == -l {
            first.at(i, 1) * below.at(m, 1 - l) + first.at(i, -1) * below.at(m, l - 1)
        } else {
            first.at(i, 0) * below.at(m, n)
        }
    };

    let mut elements = Vec::with_capacity(((2 * l + 1) * (2 * l + 1)) as usize);
    for m in -l..=l {
        for n in -l..=l {
            let [u, v, w] = factors(l, m, n);
            let mut sum = 0.0;
            // Where a factor is zero, its function would look beyond R^{l-1}.
            if u != 0.0 {
                sum += u * moved(0, m, n);
            }
            if v != 0.0 {
                sum += v * raised(m, n, &moved);
            }
            if w != 0.0 {
                sum += w * lowered(m, n, &moved);
            }
            elements.push(sum);
        }
    }
    elements
}

/// u, v and w.
fn factors(l: isize, m: isize, n: isize) -> [f64; 3] {
    let along = if n.abs() == l { 2 * l * (2 * l - 1) } else { (l + n) * (l - n) } as f64;
    let root = |product: isize| (product as f64 / along).sqrt();
    let size = m.abs();
    let v = if m == 0 { -(2.0f64.sqrt()) } else { 1.0 } * root((l + size - 1) * (l + size)) / 2.0;
    let w = if m == 0 { 0.0 } else { -root((l - size - 1) * (l - size)) / 2.0 };
    [root((l + m) * (l - m)), v, w]
}

/// V of the paper.
fn raised(m: isize, n: isize, moved: &impl Fn(isize, isize, isize) -> f64) -> f64 {
    let twice = 2.0f64.sqrt();
    match m {
        0 => moved(1, 1, n) + moved(-1, -1, n),
        1 => moved(1, 0, n) * twice,
        -1 => moved(-1, 0, n) * twice,
        2.. => moved(1, m - 1, n) - moved(-1, 1 - m, n),
        _ => moved(1, m + 1, n) + moved(-1, -m - 1, n),
    }
}

/// W of the paper, for m other than zero.
fn lowered(m: isize, n: isize, moved: &impl Fn(isize, isize, isize) -> f64) -> f64 {
    if m > 0 { moved(1, m + 1, n) + moved(-1, -m - 1, n) } else { moved(1, m - 1, n) - moved(-1, 1 - m, n) }
}

/// The Hanning (cos²) window of a width: degree l is multiplied by cos²(π l / 2 width), by 0 from `width` on.
///
/// It trades sharpness for less ringing. Coefficients are never clamped: that would not be linear.
pub fn windowed(coefficients: &[[f64; 3]], width: f64) -> Result<Vec<[f64; 3]>> {
    if !(width > 0.0 && width.is_finite()) {
        return Err(Error::input(format!("expected a finite window width above 0, in degrees l, got {width}")));
    }
    let factor = |degree: f64| if degree < width { (PI * degree / (2.0 * width)).cos().powi(2) } else { 0.0 };
    let window = |(index, colour): (usize, &[f64; 3])| {
        let factor = factor(degree_and_m(index).0 as f64);
        colour.map(|value| value * factor)
    };
    Ok(coefficients.iter().enumerate().map(window).collect())
}
