//! Shading: albedos in, receivers resolved into their pixels.

/// What turns rows into pixels: for each row its pixel, its share of it, and its albedo.
pub struct Rows<'a> {
    /// The pixel that each row adds to, row-major.
    pub pixel: &'a [u32],
    /// What share of its pixel each row is, from 0 to 1.
    pub weight: &'a [f32],
    /// rows x 3
    pub albedo: &'a [f32],
}

/// Sums weight * albedo * B over the rows of each pixel, into a black picture of pixels x 3.
pub fn resolve(rows: &Rows, response: &[f32], picture: &mut [f32]) {
    let shades = rows.albedo.chunks_exact(3).zip(response.chunks_exact(3));
    for ((&pixel, &weight), (albedo, light)) in rows.pixel.iter().zip(rows.weight).zip(shades) {
        let out = &mut picture[3 * pixel as usize..3 * pixel as usize + 3];
        for colour in 0..3 {
            out[colour] += weight * albedo[colour] * light[colour];
        }
    }
}
