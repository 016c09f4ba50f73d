//! Segments from one point to others, as fans: what a lamp or a gather sample sees of some points.

use super::cone::Apex;
use super::fan::{FAN, Fan, Octant};
use super::tracer::Tracer;
use super::walk::Walk;

/// Room for the fans of one point, kept between calls: one an octant, with the numbers of its rays' ends.
#[derive(Default)]
pub struct Segments {
    fans: Vec<(Octant, Fan, Vec<u32>)>,
    walk: Walk,
}

impl Segments {
    /// Which of up to 64 ends, one bit each, nothing hides from the apex; only the `wanted` ones are looked at. Ends lie off
    /// their surfaces, and where the apex has a normal, above its plane.
    pub fn seen(&mut self, tracer: &Tracer, from: &Apex, ends: &[[f32; 3]], wanted: u64) -> u64 {
        debug_assert!(ends.len() <= FAN);
        self.fans.iter_mut().for_each(|(_, fan, numbers)| {
            fan.clear();
            numbers.clear();
        });
        let mut seen = wanted;
        let mut left = wanted;
        while left != 0 {
            let number = left.trailing_zeros();
            left &= left - 1;
            let way: [f32; 3] = std::array::from_fn(|k| ends[number as usize][k] - from.origin[k]);
            if way != [0.0; 3] {
                self.push(way, number);
            }
        }
        for (_, fan, numbers) in self.fans.iter().filter(|(_, fan, _)| !fan.is_empty()) {
            let mut blocked = tracer.blocked(from, fan, fan.all(), &mut self.walk);
            while blocked != 0 {
                seen &= !(1 << numbers[blocked.trailing_zeros() as usize]);
                blocked &= blocked - 1;
            }
        }
        seen
    }

    fn push(&mut self, way: [f32; 3], number: u32) {
        let octant = Octant::of(way);
        let own = self.fans.iter().position(|(known, ..)| *known == octant).unwrap_or_else(|| {
            self.fans.push((octant, Fan::new(octant), Vec::new()));
            self.fans.len() - 1
        });
        let (_, fan, numbers) = &mut self.fans[own];
        fan.push_segment(octant.slopes(way), way[octant.axes[2]].abs());
        numbers.push(number);
    }
}
