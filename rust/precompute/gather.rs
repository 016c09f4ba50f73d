//! Rows of what receivers take from gather samples: through a lobe, a family's functions of it, or cosines.
//!
//! ```text
//!     T_kg(x) = V_g(x) A_g / m sum over q of b_k f_F cos_x(q) cos_g(q) / |x - q|^2       (Nguyen 2010, eq. 4 with X16's density)
//! ```
//!
//! q are m points of what g stands for: g itself, a disc of its area around it (the paper's), or points of its cell. Neither
//! the light nor what is hidden changes over them. Where a cell is not small beside a lobe, rays of the lobe take the place
//! of its points (`nearby.rs`). |x - q|² is not taken for less than A_g / m; then a row of cosines is scaled: its sum must be
//! the share of even light that x receives from surfaces, which rays count. Rows of lobes are not: the rays' noise would be
//! theirs.

use std::f64::consts::{FRAC_1_PI, PI, TAU};

use std::sync::Arc;

use rayon::prelude::*;

use crate::brdf::Brdf;
use crate::brdf::family::lookup::WIDE;
use crate::brdf::family::{Family, Lookup};
use crate::error::{Error, Result};
use crate::sampling::{cosine_directions, frame, jitter, mixed};
use crate::scene::rays::{Apex, FAN, Fan, LIFT, Segments, Tracer, Walk, fans};
use crate::scene::surface::dot;
use crate::scene::{GatherSamples, Point, Surfaces};
use crate::transport::{GROUP, Rows16};
use crate::twice::compiled_twice;

use super::nearby::Nearby;
use super::standing::{Lanes, Met, Receiver, Standing};

/// Rays along a side that say how closed the surroundings of a receiver are.
const CLOSED: usize = 16;
/// From half of a lobe's height to 1 / e of it.
const TO_E: f64 = 1.2;
/// Turns between points of a disc: the golden angle.
const GOLDEN: f64 = 0.381_966_011_250_105_1;

/// What rows are taken through.
#[derive(Clone)]
pub enum Kernel {
    /// Cosines: rows of D.
    Diffuse,
    /// A lobe as it is.
    Lobe(Arc<dyn Brdf>),
    /// The functions of a segment of a family.
    Family(Arc<Family>, usize),
}

/// The points that stand for what a sample stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SubArea {
    /// The sample.
    Centre,
    /// So many of a disc of its area.
    Disc(usize),
    /// So many of its cell.
    Cell(usize),
    /// Of its cell, the more the wider it is seen beside the lobe: 1, 4, 16 or 64. Of samples near by, rays.
    ByAngle,
}

/// What is gathered, and how.
#[derive(Clone, Copy)]
pub struct Gather<'a> {
    /// The scene.
    pub surfaces: Surfaces<'a>,
    /// Its samples.
    pub samples: &'a GatherSamples,
    /// Through what: one after the other, each of its own points.
    pub kernels: &'a [Kernel],
    /// By which points.
    pub sub_area: SubArea,
}

impl Kernel {
    /// Rows of each receiver.
    pub fn count(&self) -> usize {
        match self {
            Kernel::Diffuse | Kernel::Lobe(_) => 1,
            Kernel::Family(family, _) => family.live(),
        }
    }

    /// Radians from the axis to where the narrowest lobe has fallen to 1 / e, seen along the normal.
    fn width(&self) -> f64 {
        match self {
            Kernel::Diffuse => 1.0,
            Kernel::Lobe(lobe) => TO_E * lobe.half_width([0.0, 0.0, 1.0]),
            Kernel::Family(family, segment) => family.width(*segment),
        }
    }
}

/// A kernel ready for many pairs, and what a sample gives its rows: of each receiver, in groups of `WIDE` rows.
struct Through<'a> {
    shape: Shape,
    rows: usize,
    width: f64,
    /// Which samples are taken by rays.
    nearby: Option<Nearby<'a>>,
    /// The receivers that the sample that is looked at is near.
    near: u64,
    /// Those that some sample is.
    some_near: u64,
    sums: Vec<[[f32; WIDE]; FAN]>,
    /// What each receiver takes of even light through the same points, over all samples: of cosines.
    even: [f64; FAN],
}

enum Shape {
    Diffuse,
    Lobe(Arc<dyn Brdf>),
    Family(Lookup),
}

impl<'a> Through<'a> {
    fn new(kernel: &'a Kernel, sub_area: SubArea) -> Through<'a> {
        let shape = match kernel {
            Kernel::Diffuse => Shape::Diffuse,
            Kernel::Lobe(lobe) => Shape::Lobe(Arc::clone(lobe)),
            Kernel::Family(family, segment) => Shape::Family(family.lookup(*segment)),
        };
        let rows = kernel.count();
        let sums = vec![[[0.0; WIDE]; FAN]; rows.div_ceil(WIDE)];
        let width = kernel.width();
        let dense = match kernel {
            Kernel::Diffuse => None,
            Kernel::Lobe(lobe) => Some(std::slice::from_ref(lobe)),
            Kernel::Family(family, segment) => Some(family.dense(*segment)),
        };
        let nearby = dense.filter(|_| sub_area == SubArea::ByAngle).map(|lobes| Nearby::new(lobes, width));
        Through { shape, rows, width, nearby, near: 0, some_near: 0, sums, even: [0.0; FAN] }
    }

    /// Looks which receivers a sample is near.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "as in `standing.rs`: iterators would be calls")]
    fn look(&mut self, radius2: f32, squares: &Lanes) {
        self.near = 0;
        let Some(nearby) = &self.nearby else { return };
        for lane in 0..FAN {
            self.near |= u64::from(nearby.has(radius2, squares[lane])) << lane;
        }
        self.some_near |= self.near;
    }

    /// Adds what the receivers of `lanes` take through one point.
    #[inline(always)]
    fn add(&mut self, standing: &Standing, met: &Met, mut lanes: u64) {
        if matches!(self.shape, Shape::Diffuse) {
            for lane in 0..FAN {
                self.even[lane] += f64::from(met.share[lane]);
                self.sums[0][lane][0] += met.share[lane] * FRAC_1_PI as f32;
            }
            return;
        }
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let share = met.share[lane];
            if share <= 0.0 {
                continue;
            }
            match &self.shape {
                Shape::Diffuse => {}
                Shape::Lobe(lobe) => {
                    let [wi, wo, normal] = standing.directions(met, lane);
                    let [tangent, bitangent] = frame(normal);
                    let [wi, wo] = [wi, wo].map(|w| [tangent, bitangent, normal].map(|axis| dot(axis, w)));
                    self.sums[0][lane][0] += share * lobe.evaluate(wi, wo) as f32;
                }
                Shape::Family(lookup) => {
                    if !standing.is_seen(lane) {
                        continue;
                    }
                    let (fall, fixed) = lookup.fixed(&standing.angles(met, lane));
                    for group in 0..self.sums.len() {
                        lookup.add(group, fall, share * fixed, &mut self.sums[group][lane]);
                    }
                }
            }
        }
    }
}

impl SubArea {
    /// Refuses no points, and more than cells have.
    pub fn check(self) -> Result<SubArea> {
        match self {
            SubArea::Disc(points) | SubArea::Cell(points) if !(1..=64).contains(&points) => {
                Err(Error::input(format!("expected 1 to 64 points, got {points}")))
            }
            _ => Ok(self),
        }
    }

    /// How many points of a sample of a radius, over a lobe's width, at a distance whose square is given.
    #[inline(always)]
    fn count(self, radius: f32, square: f32) -> usize {
        match self {
            SubArea::Centre => 1,
            SubArea::Disc(points) | SubArea::Cell(points) => points,
            SubArea::ByAngle => match radius * radius / square {
                wide if wide < 0.1 * 0.1 => 1,
                wide if wide < 0.2 * 0.2 => 4,
                wide if wide < 0.4 * 0.4 => 16,
                _ => 64,
            },
        }
    }
}

/// The most points of any receiver.
#[inline(always)]
fn largest(counts: &[u8; FAN]) -> usize {
    let mut most = 0;
    for &count in counts {
        most = if count > most { count } else { most };
    }
    usize::from(most)
}

compiled_twice! {
    fn gathered(gather: &Gather<'_>, receivers: &[Receiver], segments: &mut Segments, out: &mut Vec<Rows16>)
        = Gather::rows_any;
}

impl Gather<'_> {
    /// Rows of each receiver, through all kernels.
    pub fn count(&self) -> usize {
        self.kernels.iter().map(Kernel::count).sum()
    }

    /// The rows of up to 64 receivers in groups of 16: `[row][group][sample]`, each the values of 16 receivers.
    pub fn rows(&self, receivers: &[Receiver], segments: &mut Segments, out: &mut Vec<Rows16>) {
        gathered(self, receivers, segments, out)
    }

    #[inline(always)]
    fn rows_any(&self, receivers: &[Receiver], segments: &mut Segments, out: &mut Vec<Rows16>) {
        debug_assert!(receivers.len() <= FAN);
        let (count, groups) = (self.samples.len(), receivers.len().div_ceil(GROUP));
        let (standing, mut met, mut squares) = (Standing::of(receivers), Met::default(), [0.0; FAN]);
        let ends: Vec<[f32; 3]> = receivers.iter().map(|receiver| receiver.origin).collect();
        out.clear();
        out.resize(self.count() * groups * count, [0.0; GROUP]);
        let mut through: Vec<Through> = self.kernels.iter().map(|kernel| Through::new(kernel, self.sub_area)).collect();
        let mut points = Vec::new();
        for (number, sample) in self.samples.points.iter().enumerate() {
            let (place, normal) = (sample.place.map(|x| x as f32), sample.normal.map(|x| x as f32));
            let facing = standing.facing(place, normal, &mut squares);
            through.iter_mut().for_each(|own| own.look(self.samples.radius2(number), &squares));
            if facing == 0 {
                continue;
            }
            let apex = Apex { origin: sample.origin.map(|x| x as f32), normal };
            let seen = segments.seen(self.surfaces.tracer, &apex, &ends, facing);
            if seen == 0 {
                continue;
            }
            let (mut row, area) = (0, self.samples.areas[number] as f32);
            for own in &mut through {
                let seen = seen & !own.near;
                let counts = self.counts(number, own.width, seen, &squares);
                let most = largest(&counts);
                self.points(number, most, &mut points);
                for (k, &point) in points.iter().enumerate() {
                    // Of a receiver that takes fewer points, as many as it takes that are as evenly spread.
                    let (mut parts, mut lanes) = ([0.0; FAN], 0);
                    let mut left = seen;
                    while left != 0 {
                        let lane = left.trailing_zeros() as usize;
                        left &= left - 1;
                        let own = usize::from(counts[lane]);
                        let every = most / own;
                        if every == 1 || k % every == every / 2 {
                            parts[lane] = area / own as f32;
                            lanes |= 1 << lane;
                        }
                    }
                    standing.meet(point, normal, &parts, &mut met);
                    own.add(&standing, &met, lanes);
                }
                for at in 0..own.rows {
                    let sums = &own.sums[at / WIDE];
                    for group in 0..groups {
                        let lanes = &mut out[((row + at) * groups + group) * count + number];
                        for lane in 0..GROUP {
                            lanes[lane] = sums[group * GROUP + lane][at % WIDE];
                        }
                    }
                }
                for sums in &mut own.sums {
                    *sums = [[0.0; WIDE]; FAN];
                }
                row += own.rows;
            }
        }
        let mut row = 0;
        for (own, kernel) in through.iter().zip(self.kernels) {
            self.add_nearby(own, kernel, receivers, |receiver, at, number, value| {
                out[((row + at) * groups + receiver / GROUP) * count + number][receiver % GROUP] += value as f32;
            });
            row += own.rows;
        }
        self.scale(receivers, &through, out);
    }

    /// What receivers take of samples near by, value by value: receiver, row of the kernel, sample.
    fn add_nearby(
        &self,
        own: &Through,
        kernel: &Kernel,
        receivers: &[Receiver],
        mut add: impl FnMut(usize, usize, usize, f64),
    ) {
        let Some(nearby) = &own.nearby else { return };
        for (number, receiver) in receivers.iter().enumerate().filter(|(number, _)| own.some_near >> number & 1 == 1) {
            nearby.each(self.surfaces, self.samples, receiver, |sample, [wi, wo], share| match kernel {
                Kernel::Diffuse => {}
                Kernel::Lobe(lobe) => add(number, 0, sample, share * lobe.evaluate(wi, wo)),
                Kernel::Family(family, segment) => {
                    let Some((fall, fixed)) = family.edited().fixed(wi, wo) else { return };
                    family
                        .basis(*segment, fall)
                        .enumerate()
                        .for_each(|(at, b)| add(number, at, sample, share * fixed * b));
                }
            });
        }
    }

    /// How many points each receiver that sees a sample takes of it: 0 of the others, else powers of two.
    #[inline(always)]
    fn counts(&self, number: usize, width: f64, seen: u64, squares: &Lanes) -> [u8; FAN] {
        let radius = (self.samples.areas[number] / PI).sqrt();
        let most = match self.sub_area {
            SubArea::Centre | SubArea::Disc(_) => usize::MAX,
            SubArea::Cell(_) | SubArea::ByAngle => 1 << self.samples.cell(number).len().ilog2(),
        };
        let (mut counts, mut left) = ([0; FAN], seen);
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            counts[lane] = self.sub_area.count((radius / width) as f32, squares[lane]).min(most) as u8;
        }
        counts
    }

    /// The rows of any number of receivers, `[receiver][row][sample]`. `advance` hears of every 64 and may stop it.
    pub fn matrix(&self, receivers: &[Receiver], advance: &(dyn Fn(u64) -> Result<()> + Sync)) -> Result<Vec<f32>> {
        let (count, rows) = (self.samples.len(), self.count());
        let of_bundle = |room: &mut (Segments, Vec<Rows16>), bundle: &[Receiver]| -> Result<Vec<f32>> {
            advance(bundle.len() as u64)?;
            self.rows(bundle, &mut room.0, &mut room.1);
            let groups = bundle.len().div_ceil(GROUP);
            let row = |(own, row): (usize, usize)| {
                let first = (row * groups + own / GROUP) * count;
                room.1[first..first + count].iter().map(move |lanes| lanes[own % GROUP])
            };
            Ok((0..bundle.len()).flat_map(|own| (0..rows).map(move |row| (own, row))).flat_map(row).collect())
        };
        let found = receivers.par_chunks(FAN).map_init(Default::default, of_bundle).collect::<Result<Vec<_>>>()?;
        Ok(found.into_iter().flatten().collect())
    }

    /// What all receivers gather of light at the samples, `[receiver][row]`. `advance` hears of every 64 and may stop it.
    pub fn light(
        &self,
        receivers: &[Receiver],
        light: &[[f64; 3]],
        advance: &(dyn Fn(u64) -> Result<()> + Sync),
    ) -> Result<Vec<[f64; 3]>> {
        let count = self.samples.len();
        if light.len() != count {
            return Err(Error::input(format!("expected the light of {count} samples, got that of {}", light.len())));
        }
        let times = |row: &[f32]| {
            row.iter()
                .zip(light)
                .filter(|(weight, _)| **weight != 0.0)
                .fold([0.0; 3], |sum, (&weight, light)| std::array::from_fn(|c| sum[c] + f64::from(weight) * light[c]))
        };
        let of_bundle = |bundle: &[Receiver]| -> Result<Vec<[f64; 3]>> {
            Ok(self.matrix(bundle, advance)?.chunks_exact(count).map(times).collect())
        };
        let found = receivers.par_chunks(FAN).map(of_bundle).collect::<Result<Vec<_>>>()?;
        Ok(found.into_iter().flatten().collect())
    }

    /// So many points of what a sample stands for.
    fn points(&self, number: usize, m: usize, points: &mut Vec<[f32; 3]>) {
        points.clear();
        let sample = &self.samples.points[number];
        let narrow = |point: [f64; 3]| point.map(|x| x as f32);
        match self.sub_area {
            SubArea::Centre => points.push(narrow(sample.place)),
            SubArea::Disc(_) => {
                let ([side, front], radius) = (frame(sample.normal), (self.samples.areas[number] / PI).sqrt());
                points.extend((0..m).map(|k| {
                    let (y, x) = (TAU * GOLDEN * k as f64).sin_cos();
                    let out = radius * ((k as f64 + 0.5) / m as f64).sqrt();
                    narrow(std::array::from_fn(|axis| sample.place[axis] + out * (x * side[axis] + y * front[axis])))
                }));
            }
            SubArea::Cell(_) | SubArea::ByAngle => {
                let cell = self.samples.cell(number);
                points.extend((0..m).map(|k| narrow(cell[(2 * k + 1) * cell.len() / (2 * m)])));
            }
        }
    }

    /// Mends rows of cosines that are too low or too high, by what their points take of even light.
    fn scale(&self, receivers: &[Receiver], through: &[Through], out: &mut [Rows16]) {
        let (count, groups) = (self.samples.len(), receivers.len().div_ceil(GROUP));
        let mut planes = out.chunks_exact_mut(count);
        for own in through {
            let planes = planes.by_ref().take(own.rows * groups);
            if !matches!(own.shape, Shape::Diffuse) {
                planes.for_each(drop);
                continue;
            }
            let mut scales = [[0.0f32; GROUP]; FAN / GROUP];
            for (number, receiver) in receivers.iter().enumerate() {
                let even = own.even[number] * FRAC_1_PI;
                if even > 0.0 {
                    scales[number / GROUP][number % GROUP] = (self.closed(receiver) / even) as f32;
                }
            }
            for (plane, scales) in planes.zip(&scales) {
                plane.iter_mut().for_each(|lanes| (0..GROUP).for_each(|lane| lanes[lane] *= scales[lane]));
            }
        }
    }

    /// The share of even light that a receiver would take from surfaces.
    fn closed(&self, receiver: &Receiver) -> f64 {
        let seed = receiver.origin.iter().fold(0, |seed, x| mixed(seed ^ u64::from(x.to_bits())));
        let directions = cosine_directions(receiver.normal.map(f64::from), CLOSED, seed);
        let rise = receiver.rise.map(f64::from);
        let directions: Vec<[f32; 3]> =
            directions.filter(|way| dot(rise, *way) > 0.0).map(|way| way.map(|x| x as f32)).collect();
        let (from, mut walk) = (Apex { origin: receiver.origin, normal: receiver.rise }, Walk::default());
        let mut met = |fan: &Fan| self.surfaces.tracer.blocked(&from, fan, fan.all(), &mut walk).count_ones();
        let met: u32 = fans(&directions).iter().map(|(fan, _)| met(fan)).sum();
        f64::from(met) / (CLOSED * CLOSED) as f64
    }
}

/// What `side` x `side` rays of a lobe meet, and what each stands for: the reference of what is gathered.
pub fn lobe_hits(surfaces: Surfaces, receiver: &Receiver, lobe: &dyn Brdf, side: usize) -> Vec<(Option<Point>, f64)> {
    let normal = receiver.normal.map(f64::from);
    let [tangent, bitangent] = frame(normal);
    let axes = [tangent, bitangent, normal];
    let wo = axes.map(|axis| dot(axis, receiver.eye));
    let count = side * side;
    let hit = |k: usize| {
        let [x, y] = jitter(mixed(k as u64));
        let at = [((k % side) as f64 + x) / side as f64, ((k / side) as f64 + y) / side as f64];
        let Some((wi, pdf)) = lobe.sample(wo, at) else { return (None, 0.0) };
        let direction = std::array::from_fn(|k| (0..3).map(|axis| wi[axis] * axes[axis][k]).sum());
        let share = lobe.evaluate(wi, wo) * wi[2] / pdf / count as f64;
        (surfaces.meet(receiver.origin, direction), share)
    };
    (0..count).map(hit).collect()
}

/// Which of up to 64 points of surfaces, one bit each, a point in space sees: they face it, and nothing lies between.
pub fn seen_from(
    tracer: &Tracer,
    from: [f32; 3],
    places: &[[f32; 3]],
    normals: &[[f32; 3]],
    segments: &mut Segments,
) -> u64 {
    let (mut facing, mut ends) = (0, [[0.0f32; 3]; FAN]);
    for (number, (place, normal)) in places.iter().zip(normals).enumerate() {
        ends[number] = std::array::from_fn(|k| place[k] + LIFT as f32 * normal[k]);
        let up: f32 = (0..3).map(|k| (from[k] - place[k]) * normal[k]).sum();
        facing |= u64::from(up > 0.0) << number;
    }
    segments.seen(tracer, &Apex { origin: from, normal: [0.0; 3] }, &ends[..places.len()], facing)
}
