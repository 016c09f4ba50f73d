//! Unit vectors of the local frame, and the half vector between two of them.

/// A unit vector; z is the cosine to the normal.
pub type Direction = [f64; 3];

/// Cosines up to this one are on the horizon: what divides by two of them stays finite.
pub(super) const HORIZON: f64 = 1e-30;

/// Whether a direction is above the horizon; NaN is not.
#[inline]
pub(super) fn above(direction: Direction) -> bool {
    direction[2] > HORIZON
}

/// The mirror image of a direction about the normal.
pub(super) fn mirrored([x, y, z]: Direction) -> Direction {
    [-x, -y, z]
}

/// The scalar product.
#[inline]
pub(super) fn dot(a: Direction, b: Direction) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// A vector that is not zero, made unit.
pub(super) fn unit(v: Direction) -> Direction {
    let length = dot(v, v).sqrt();
    v.map(|x| x / length)
}

/// `wo` reflected at a facet with the unit normal `h`: None where the facet is seen from behind, or sends it down.
pub(super) fn reflected(wo: Direction, h: Direction) -> Option<Direction> {
    let cosine = dot(wo, h);
    let wi: Direction = std::array::from_fn(|k| 2.0 * cosine * h[k] - wo[k]);
    (above(wo) && cosine > 0.0 && above(wi)).then_some(wi)
}

/// The facet that reflects one of two directions above the horizon into the other.
pub struct Half {
    /// To the light.
    pub wi: Direction,
    /// To the eye.
    pub wo: Direction,
    /// n . wi
    pub cos_i: f64,
    /// n . wo
    pub cos_o: f64,
    /// n . h
    pub cos_h: f64,
    /// h . wi = h . wo: half the length of wi + wo, which the scalar product would lose where they are opposite.
    pub cos_d: f64,
    /// tan theta_h (cos phi_h, sin phi_h) from the sum itself: 1 - cos theta_h would lose a narrow lobe's digits.
    pub slope: [f64; 2],
}

impl Half {
    /// None unless both directions are above the horizon.
    pub fn between(wi: Direction, wo: Direction) -> Option<Half> {
        (above(wi) && above(wo)).then(|| Half::of(wi, wo))
    }

    /// Of two directions above the horizon; of others whatever comes of it.
    #[inline(always)]
    pub(super) fn of(wi: Direction, wo: Direction) -> Half {
        let sum: Direction = std::array::from_fn(|k| wi[k] + wo[k]);
        let length = dot(sum, sum).sqrt();
        let slope = [sum[0] / sum[2], sum[1] / sum[2]];
        Half {
            wi,
            wo,
            cos_i: wi[2],
            cos_o: wo[2],
            cos_h: (sum[2] / length).min(1.0),
            cos_d: (0.5 * length).min(1.0),
            slope,
        }
    }
}
