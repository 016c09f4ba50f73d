//! How narrow a lobe is, by its values.

use std::f64::consts::FRAC_PI_2;

use super::direction::Direction;

/// Halvings of the range of logarithms in which a half width is looked for: to 1 %.
const HALVINGS: usize = 11;
/// The narrowest that is looked for: the narrowest lobe allowed has this at 0.002 degrees above the horizon.
const NARROWEST: f64 = 1e-7;

/// Polar coordinates about a unit axis.
pub(super) struct Polar {
    axis: Direction,
    /// To the normal, or x where the axis is the normal itself.
    up: Direction,
    side: Direction,
}

impl Polar {
    pub fn about(axis: Direction) -> Polar {
        let [x, y, z] = axis;
        let sine = x.hypot(y);
        let (cosine, turn) = if sine > 0.0 { (x / sine, y / sine) } else { (-1.0, 0.0) };
        Polar { axis, up: [-z * cosine, -z * turn, sine], side: [turn, -cosine, 0.0] }
    }

    /// At an angle to the axis, towards `right` side + `forward` up.
    pub fn direction(&self, angle: f64, [right, forward]: [f64; 2]) -> Direction {
        let (sine, cosine) = angle.sin_cos();
        std::array::from_fn(|k| cosine * self.axis[k] + sine * (right * self.side[k] + forward * self.up[k]))
    }

    /// The angles to the axis between which directions that way are above the horizon.
    pub fn above(&self, forward: f64) -> (f64, f64) {
        let middle = (self.up[2] * forward).atan2(self.axis[2]);
        ((middle - FRAC_PI_2).max(0.0), middle + FRAC_PI_2)
    }
}

/// The least angle, to either side or upwards, at which the values are half of what they are at the axis.
pub(super) fn half_width(axis: Direction, value: impl Fn(Direction) -> f64) -> f64 {
    let (polar, half) = (Polar::about(axis), 0.5 * value(axis));
    let ways = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0]];
    let width = |way: [f64; 2]| {
        let high = |logarithm: f64| value(polar.direction(logarithm.exp(), way)) >= half;
        let (mut inside, mut outside) = (NARROWEST.ln(), FRAC_PI_2.ln());
        for _ in 0..HALVINGS {
            let middle = 0.5 * (inside + outside);
            *(if high(middle) { &mut inside } else { &mut outside }) = middle;
        }
        (0.5 * (inside + outside)).exp()
    };
    ways.map(width).into_iter().fold(FRAC_PI_2, f64::min)
}
