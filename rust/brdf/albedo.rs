//! Directional albedos: integrals of any model's values times the cosine, in coordinates in which its lobe is round, of
//! width 1, and ends at the horizon exactly. The radius is sinh(x): as fine as the lobe at its axis, as coarse as its tail
//! behind.

use std::f64::consts::{FRAC_PI_2, PI};

use super::direction::{Direction, above, reflected, unit};
use super::lobe::Polar;
use super::quadrature::integral;

/// Of a quarter of an albedo; an integral that it is made of is ten times as fine, or their noise would be halved for ever.
const TOLERANCE: f64 = 2.5e-7;

/// About an axis, in angles of `width`.
pub(super) fn about_axis(axis: Direction, width: f64, value: impl Fn(Direction) -> f64) -> f64 {
    let polar = Polar::about(axis);
    over_turns(|way| {
        let (low, high) = polar.above(way[1]);
        along(low / width, high.min(PI) / width, |radius| {
            let angle = width * radius;
            let wi = polar.direction(angle, way);
            value(wi) * wi[2].max(0.0) * angle.sin() * width
        })
    })
}

/// Over facets, in slopes of `widths` along x and y: however unequal these are, the lobe is round.
pub(super) fn over_facets(wo: Direction, widths: [f64; 2], value: impl Fn(Direction) -> f64) -> f64 {
    if !above(wo) {
        return 0.0;
    }
    let eye = [widths[0] * wo[0], widths[1] * wo[1]];
    let length = eye[0].hypot(eye[1]);
    let towards = if length > 0.0 { eye.map(|x| x / length) } else { [1.0, 0.0] };
    over_turns(|[across, along_eye]| {
        // The slope that is one unit of the radius.
        let slope = [
            widths[0] * (along_eye * towards[0] - across * towards[1]),
            widths[1] * (along_eye * towards[1] + across * towards[0]),
        ];
        // A facet tilted by t that way sends light up while cos(2 t - tilt) > 0.
        let steepness = slope[0].hypot(slope[1]);
        let tilt = ((slope[0] * wo[0] + slope[1] * wo[1]) / steepness).atan2(wo[2]);
        let highest = (0.5 * (FRAC_PI_2 + tilt)).tan() / steepness;
        along(0.0, highest, |radius| {
            let h = unit([radius * slope[0], radius * slope[1], 1.0]);
            // dw_i = 4 h.wo dw_h, and dw_h = cos³ of the area of slopes.
            let spread = 4.0 * (0..3).map(|k| h[k] * wo[k]).sum::<f64>() * h[2].powi(3);
            reflected(wo, h).map_or(0.0, |wi| value(wi) * wi[2] * spread * widths[0] * widths[1] * radius)
        })
    })
}

/// The integral over all ways (sine, cosine) from the axis. Where a lobe bends sharply it does so in the plane of incidence
/// or across it: at the ends of quarters, where points are dense.
fn over_turns(way: impl Fn([f64; 2]) -> f64) -> f64 {
    let mut turned = |turn: f64| way([turn.sin(), turn.cos()]);
    let quarter = |k: usize| k as f64 * FRAC_PI_2;
    (0..4).map(|k| integral(&mut turned, quarter(k), quarter(k + 1), TOLERANCE)).sum()
}

/// The integral from one radius to another, in x.
fn along(low: f64, high: f64, value: impl Fn(f64) -> f64) -> f64 {
    if low >= high {
        return 0.0;
    }
    let mut weighted = |x: f64| value(x.sinh()) * x.cosh();
    integral(&mut weighted, low.asinh(), high.asinh(), 0.1 * TOLERANCE)
}
