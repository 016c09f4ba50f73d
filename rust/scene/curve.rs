//! In which order points of surfaces are kept: neighbours in a list are near each other and face alike.

/// The place of a point of the normalised scene along a Morton curve, 21 bits an axis.
pub(super) fn along_curve(point: [f64; 3]) -> u64 {
    let cells = point.map(|x| (((x + 1.0) * 0.5).clamp(0.0, 1.0) * 2_097_151.0) as u64);
    (0..21).fold(0, |code, bit| (0..3).fold(code, |code, axis| code | (cells[axis] >> bit & 1) << (3 * bit + axis)))
}

/// Six ways to face: by the largest component of a normal.
pub(super) fn facing(normal: [f64; 3]) -> usize {
    let axis = (0..3).fold(0, |best, k| if normal[k].abs() > normal[best].abs() { k } else { best });
    2 * axis + usize::from(normal[axis] < 0.0)
}
