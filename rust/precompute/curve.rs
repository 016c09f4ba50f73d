//! Rows of BRDF curves: what a receiver shows of a light that stands still, for every curve that its material may take.
//!
//! ```text
//!     H_ri = sum over sub-texels s of L_s dw_s V_s q_s F_r(theta_d,s) hat_i(u_s)        T' = H W^T        B = T' (f (x) c)
//! ```
//!
//! (Overbeck 2006, eq. 3.8; c in 256 nodes over u, `brdf/curve.rs`.) A row is a histogram over u, one for each function F_r
//! that Fresnel's reflectance is a sum of, and then one wavelet transform: no wavelet is ever evaluated at a texel.
//!
//! The light is taken at its own resolution: around the highlight a texel that is seen falls into 2 x 2, 4 x 4 or 8 x 8
//! parts, each with the radiance of a cubemap as fine. Nothing is skipped for being dark beside what came before, so a row
//! does not depend on any order.

use std::ops::Range;
use std::sync::Arc;

use crate::basis::ColumnSpace;
use crate::basis::cubemap::{solid_angles, texel_direction};
use crate::basis::daubechies4::{CURVE, Daubechies4};
use crate::brdf::Quotient;
use crate::brdf::quotient::{Shares, between};
use crate::error::{Error, Result};
use crate::scene::Points;
use crate::scene::rays::Tracer;
use crate::scene::surface::dot;
use crate::transport::entry::Channels;
use crate::transport::{GROUP, Rows16};

use super::lobes::{Lobes, Local};
use super::pass::{Made, Pass, Rays, Shape, Take};
use super::visibility::{Looking, View, Visibility};

/// Texels along a face whose centres are looked at.
pub const CURVE_FACE: usize = 64;
/// Parts along the side of a texel, and how near to the highlight (radians of the half vector, at the texel's centre) it
/// must lie for them. A one-texel light under a roughness of 0.02 is then within 0.6 % of the largest response. Where a texel
/// is a twentieth of the way to the highlight, its centre stands for it.
const PARTS: [(usize, f64); 4] = [(8, 0.04), (4, 0.07), (2, 0.25), (1, f64::INFINITY)];
/// From so many parts along a side on, each of them has a ray of its own where an edge runs through the texel.
const SHARP: usize = 4;
/// No texel above the horizon has a cosine like this.
const SMALL: f64 = 1e-30;

/// Light on a cubemap as fine as the texels that are looked at, or finer: the parts of each texel, one texel after the other.
struct Parts {
    side: usize,
    direction: Vec<[f32; 3]>,
    /// Radiance times solid angle.
    flux: Vec<[f32; 3]>,
}

impl Parts {
    fn new(side: usize, light: &[[f32; 3]]) -> Parts {
        let fine = CURVE_FACE * side;
        let areas = solid_angles(fine);
        let mut parts =
            Parts { side, direction: Vec::with_capacity(light.len()), flux: Vec::with_capacity(light.len()) };
        for number in 0..light.len() {
            let (texel, part) = (number / (side * side), number % (side * side));
            let (face, place) = (texel / (CURVE_FACE * CURVE_FACE), texel % (CURVE_FACE * CURVE_FACE));
            let row = place / CURVE_FACE * side + part / side;
            let column = place % CURVE_FACE * side + part % side;
            let in_face = row * fine + column;
            parts.direction.push(texel_direction(fine, face, row, column).map(|x| x as f32));
            parts.flux.push(light[face * fine * fine + in_face].map(|own| (f64::from(own) * areas[in_face]) as f32));
        }
        parts
    }

    /// The parts of a texel: their directions and fluxes.
    fn of(&self, texel: usize) -> (&[[f32; 3]], &[[f32; 3]]) {
        let range = texel * self.side * self.side..(texel + 1) * self.side * self.side;
        (&self.direction[range.clone()], &self.flux[range])
    }
}

/// Directions to the light that are looked up together, so that one loop without branches runs over all.
const TOGETHER: usize = 512;

/// Directions, what is known of each, and what they take of the curve.
struct Batch<T> {
    wi: [Vec<f64>; 3],
    own: Vec<T>,
    shares: Shares,
}

impl<T> Batch<T> {
    fn new() -> Self {
        let empty = || Vec::with_capacity(TOGETHER);
        Batch { wi: std::array::from_fn(|_| empty()), own: Vec::with_capacity(TOGETHER), shares: Shares::default() }
    }

    fn clear(&mut self) {
        self.wi.iter_mut().for_each(Vec::clear);
        self.own.clear();
    }

    /// Whether so many more are too many.
    fn is_full(&self, more: usize) -> bool {
        self.own.len() + more > TOGETHER
    }

    #[inline(always)]
    fn push(&mut self, direction: [f32; 3], own: T) {
        self.wi.iter_mut().zip(direction).for_each(|(axis, x)| axis.push(f64::from(x)));
        self.own.push(own);
    }

    /// Looks all up, in the frame of a surface.
    fn look(&mut self, quotient: &Quotient, [tangent, bitangent, normal]: [[f64; 3]; 3], wo: [f64; 3]) {
        let [x, y, z] = &mut self.wi;
        for ((x, y), z) in x.iter_mut().zip(y).zip(z) {
            let world = [*x, *y, *z];
            [*x, *y, *z] = [dot(tangent, world), dot(bitangent, world), dot(normal, world)];
        }
        quotient.shares(self.wi.each_ref().map(Vec::as_slice), wo, &mut self.shares);
    }
}

/// The pass over the receivers of one material.
pub struct CurvePass {
    visibility: Visibility,
    /// Unit vectors to the eye, one a row.
    eyes: Vec<[f32; 3]>,
    /// Whose tangents anisotropic curves lie along.
    lobes: Arc<Lobes>,
    quotient: Quotient,
    /// F_r at nodes evenly spaced over the cosine, one list a factor.
    factors: Vec<Vec<f64>>,
    parts: Vec<Parts>,
    /// Of each factor's coefficients.
    columns: Vec<[usize; CURVE]>,
    shape: Shape,
}

/// Room for one bundle, kept by each thread.
pub struct Room {
    looking: Looking,
    integrating: Integrating,
    planes: [Vec<Rows16>; 3],
}

/// A texel of which a row sees something.
#[derive(Clone, Copy)]
struct Seen {
    texel: u32,
    /// How much.
    share: f32,
    /// Whether an edge runs through it.
    edge: bool,
}

/// A row in the making.
struct Integrating {
    /// Its number, the axes of its surface, and the eye along them.
    row: usize,
    axes: [[f64; 3]; 3],
    wo: [f64; 3],
    /// Rays to parts of texels.
    rays: u64,
    /// Centres of texels that are seen.
    centres: Batch<Seen>,
    /// Parts of texels around the highlight, and their light.
    parts: Batch<[f32; 3]>,
    /// Histograms, factor after factor: at each node three colours.
    bins: Vec<[[f64; 3]; CURVE]>,
}

impl CurvePass {
    /// `light`: cubemaps of 1, 2, 4 and 8 times `CURVE_FACE` texels along a face. Refuses other sizes, eyes that are not one a
    /// row, factors without two nodes, and light or factors that are not finite.
    pub fn new(
        tracer: Arc<Tracer>,
        points: Arc<Points>,
        (eyes, lobes): (Vec<[f32; 3]>, Arc<Lobes>),
        quotient: Quotient,
        factors: Vec<Vec<f64>>,
        light: [&[[f32; 3]]; 4],
        edge_side: usize,
    ) -> Result<Self> {
        let space = ColumnSpace::daubechies4(factors.len())?;
        if factors.iter().any(|own| own.len() < 2 || own.iter().any(|value| !value.is_finite())) {
            return Err(Error::input("expected factors of finite values at two nodes or more"));
        }
        if eyes.len() != points.len() {
            return Err(Error::input(format!("expected an eye for each of {} rows, got {}", points.len(), eyes.len())));
        }
        let sides = PARTS.map(|(side, _)| side);
        for (side, own) in sides.iter().rev().zip(light) {
            let expected = 6 * (CURVE_FACE * side).pow(2);
            if own.len() != expected || own.as_flattened().iter().any(|x| !x.is_finite()) {
                return Err(Error::input(format!("expected finite light in {expected} texels, got {}", own.len())));
            }
        }
        let parts = sides.iter().zip(light.iter().rev()).map(|(&side, light)| Parts::new(side, light)).collect();
        let shape = Shape {
            rows: points.len(),
            texels: None,
            lobes: None,
            bands: space.bands(),
            channels: Channels::Three,
            factors: 1,
        };
        let visibility = Visibility::new(tracer, points, CURVE_FACE, edge_side)?;
        let columns = columns_of(factors.len())?;
        Ok(CurvePass { visibility, eyes, lobes, quotient, factors, parts, columns, shape })
    }

    /// The histograms of one row, `ray` of its bundle.
    fn row(&self, row: usize, ray: usize, view: &View, room: &mut Integrating, looking: &mut Looking) {
        room.bins.iter_mut().for_each(|own| *own = [[0.0; 3]; CURVE]);
        room.axes = Local::new(self.visibility.points.normal[row], self.lobes.turn(row)).axes();
        let normal = room.axes[2];
        room.row = row;
        room.wo = room.axes.map(|axis| dot(axis, self.eyes[row].map(f64::from)));
        let mut edges = view.edges.iter().filter(|edge| edge.rows >> ray & 1 == 1).peekable();
        for (texel, &open) in view.open.iter().enumerate() {
            let edge = edges.next_if(|edge| edge.texel as usize == texel);
            if open >> ray & 1 == 0 && edge.is_none() {
                continue;
            }
            let centre = self.visibility.texels.centre[texel];
            // An edge's mean is of V cos over the texel.
            let cosine = || dot(normal, centre.map(f64::from)).max(SMALL) as f32;
            let share = edge.map_or(1.0, |edge| (edge.mean[ray] / cosine()).min(1.0));
            room.centres.push(centre, Seen { texel: texel as u32, share, edge: edge.is_some() });
            if room.centres.is_full(1) {
                self.add_texels(room, looking);
            }
        }
        self.add_texels(room, looking);
        self.add_parts(room);
    }

    /// Adds texels: by their centres far from the highlight, and what is nearer as parts.
    fn add_texels(&self, room: &mut Integrating, looking: &mut Looking) {
        room.centres.look(&self.quotient, room.axes, room.wo);
        for k in 0..room.centres.own.len() {
            let (Shares { u, cos_d, colours }, own) = (&room.centres.shares, room.centres.own[k]);
            let off = self.quotient.off_highlight(u[k]);
            let near = PARTS.iter().position(|(_, within)| off < *within).unwrap_or(PARTS.len() - 1);
            let (parts, texel) = (&self.parts[near], own.texel as usize);
            if parts.side == 1 {
                let taken = std::array::from_fn(|c| f64::from(own.share * parts.flux[texel][c]) * colours[c][k]);
                self.splat(u[k], cos_d[k], taken, &mut room.bins);
                continue;
            }
            if room.parts.is_full(parts.side * parts.side) {
                self.add_parts(room);
            }
            let (directions, fluxes) = parts.of(texel);
            // Where the highlight is, an edge is taken where it lies; elsewhere as much of each part is seen.
            let open = (own.edge && parts.side >= SHARP).then(|| {
                room.rays += directions.len() as u64;
                self.visibility.open(room.row, directions, looking)
            });
            for (part, (&direction, flux)) in directions.iter().zip(fluxes).enumerate() {
                let share = open.map_or(own.share, |open| (open >> part & 1) as f32);
                room.parts.push(direction, flux.map(|flux| share * flux));
            }
        }
        room.centres.clear();
    }

    /// Adds parts of texels.
    fn add_parts(&self, room: &mut Integrating) {
        room.parts.look(&self.quotient, room.axes, room.wo);
        let Shares { u, cos_d, colours } = &room.parts.shares;
        for (k, light) in room.parts.own.iter().enumerate() {
            let taken = std::array::from_fn(|c| f64::from(light[c]) * colours[c][k]);
            self.splat(u[k], cos_d[k], taken, &mut room.bins);
        }
        room.parts.clear();
    }

    /// Adds light to the two nodes around its place, for each factor.
    #[inline]
    fn splat(&self, u: f64, cos_d: f64, light: [f64; 3], bins: &mut [[[f64; 3]; CURVE]]) {
        let (node, rest) = between(u, CURVE);
        for (factor, bins) in self.factors.iter().zip(bins) {
            let (place, further) = between(cos_d, factor.len());
            let reflected = (1.0 - further) * factor[place] + further * factor[place + 1];
            for (node, share) in [(node, 1.0 - rest), (node + 1, rest)] {
                for (bin, light) in bins[node].iter_mut().zip(light) {
                    *bin += share * reflected * light;
                }
            }
        }
    }

    /// The wavelets of a row's histograms, into its lane: band by band, in each factor after factor.
    fn transform(&self, lane: usize, bins: &[[[f64; 3]; CURVE]], planes: &mut [Vec<Rows16>; 3]) {
        for (factor, nodes) in bins.iter().enumerate() {
            for (colour, plane) in planes.iter_mut().enumerate() {
                let coefficients = Daubechies4::shared().forward(&nodes.map(|node| node[colour]));
                for (&column, value) in self.columns[factor].iter().zip(coefficients) {
                    plane[column][lane] = value as f32;
                }
            }
        }
    }
}

/// The columns of each factor's coefficients: in their bands, behind those of the factors before.
pub fn columns_of(factors: usize) -> Result<Vec<[usize; CURVE]>> {
    let one = ColumnSpace::daubechies4(1)?.bands();
    let column = |factor: usize, coefficient: usize| {
        let band = one.range(one.of(coefficient));
        band.start * factors + factor * band.len() + coefficient - band.start
    };
    Ok((0..factors).map(|factor| std::array::from_fn(|coefficient| column(factor, coefficient))).collect())
}

impl Pass for CurvePass {
    type Room = Room;

    fn shape(&self) -> &Shape {
        &self.shape
    }

    fn room(&self) -> Room {
        Room {
            looking: Looking::default(),
            integrating: Integrating {
                row: 0,
                axes: [[0.0; 3]; 3],
                wo: [0.0; 3],
                rays: 0,
                centres: Batch::new(),
                parts: Batch::new(),
                bins: vec![[[0.0; 3]; CURVE]; self.factors.len()],
            },
            planes: std::array::from_fn(|_| vec![[0.0; GROUP]; self.shape.bands.columns()]),
        }
    }

    fn bundle(&self, rows: Range<usize>, room: &mut Room, take: &mut Take) -> Result<Made> {
        let Room { looking, integrating, planes } = room;
        let view = self.visibility.view(rows.clone(), looking);
        integrating.rays = 0;
        for first in (0..rows.len()).step_by(GROUP) {
            planes.iter_mut().for_each(|plane| plane.fill([0.0; GROUP]));
            for lane in 0..GROUP.min(rows.len() - first) {
                self.row(rows.start + first + lane, first + lane, &view, integrating, looking);
                self.transform(lane, &integrating.bins, planes);
            }
            take(0, &planes.each_ref().map(Vec::as_slice), 0.0)?;
        }
        let rays = view.rays.plus(Rays { edge: integrating.rays, ..Rays::default() });
        Ok(Made { rays, seen: None })
    }
}
