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
use crate::basis::daubechies4::{COARSEST, CURVE, Daubechies4};
use crate::brdf::Quotient;
use crate::brdf::quotient::between;
use crate::error::{Error, Result};
use crate::sampling::frame;
use crate::scene::Points;
use crate::scene::rays::Tracer;
use crate::scene::surface::dot;
use crate::transport::entry::Channels;
use crate::transport::{GROUP, Rows16};

use super::pass::{Made, Pass, Shape, Take};
use super::visibility::{Looking, View, Visibility};

/// Texels along a face whose centres are looked at.
pub const CURVE_FACE: usize = 64;
/// Parts along the side of a texel, and how near to the highlight (radians of the half vector, at the texel's centre) it
/// must lie for them. A one-texel light under a roughness of 0.02 is then within 0.6 % of the largest response. Where a texel
/// is a twentieth of the way to the highlight, its centre stands for it.
const PARTS: [(usize, f64); 4] = [(8, 0.04), (4, 0.07), (2, 0.25), (1, f64::INFINITY)];

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

    /// The parts of a texel.
    fn of(&self, texel: usize) -> impl Iterator<Item = ([f64; 3], [f64; 3])> {
        let range = texel * self.side * self.side..(texel + 1) * self.side * self.side;
        let pairs = self.direction[range.clone()].iter().zip(&self.flux[range]);
        pairs.map(|(direction, flux)| (direction.map(f64::from), flux.map(f64::from)))
    }
}

/// The pass over the receivers of one material.
pub struct CurvePass {
    visibility: Visibility,
    /// Unit vectors to the eye, one a row.
    eyes: Vec<[f32; 3]>,
    quotient: Quotient,
    /// F_r at nodes evenly spaced over the cosine, one list a factor.
    factors: Vec<Vec<f64>>,
    parts: Vec<Parts>,
    shape: Shape,
}

/// Room for one bundle, kept by each thread.
pub struct Room {
    looking: Looking,
    /// Histograms of one row, factor after factor, each of three colours.
    bins: Vec<[[f64; CURVE]; 3]>,
    planes: [Vec<Rows16>; 3],
}

impl CurvePass {
    /// `light`: cubemaps of 1, 2, 4 and 8 times `CURVE_FACE` texels along a face. Refuses other sizes, eyes that are not one a
    /// row, factors without two nodes, and light or factors that are not finite.
    pub fn new(
        tracer: Arc<Tracer>,
        points: Arc<Points>,
        eyes: Vec<[f32; 3]>,
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
        Ok(CurvePass { visibility, eyes, quotient, factors, parts, shape })
    }

    /// The histograms of one row, `ray` of its bundle, in `bins`.
    fn row(&self, row: usize, ray: usize, view: &View, bins: &mut [[[f64; CURVE]; 3]]) {
        bins.iter_mut().for_each(|own| *own = [[0.0; CURVE]; 3]);
        let normal = self.visibility.points.normal[row].map(f64::from);
        let [tangent, bitangent] = frame(normal);
        let local = |direction: [f64; 3]| [tangent, bitangent, normal].map(|axis| dot(axis, direction));
        let wo = local(self.eyes[row].map(f64::from));
        let mut edges = view.edges.iter().filter(|edge| edge.rows >> ray & 1 == 1).peekable();
        for (texel, &open) in view.open.iter().enumerate() {
            let edge = edges.next_if(|edge| edge.texel as usize == texel);
            if open >> ray & 1 == 0 && edge.is_none() {
                continue;
            }
            let centre = local(self.visibility.texels.centre[texel].map(f64::from));
            // An edge's mean is of V cos over the texel: as much of each part is seen.
            let seen = edge.map_or(1.0, |edge| (f64::from(edge.mean[ray]) / centre[2]).min(1.0));
            let Some((share, colours)) = self.quotient.share(centre, wo) else { continue };
            let off = self.quotient.off_highlight(share.u);
            let near = PARTS.iter().position(|(_, within)| off < *within).unwrap_or(PARTS.len() - 1);
            for (direction, flux) in self.parts[near].of(texel) {
                let own = match self.parts[near].side {
                    _ if flux == [0.0; 3] => None,
                    1 => Some((share, colours)),
                    _ => self.quotient.share(local(direction), wo),
                };
                if let Some((share, quotient)) = own {
                    let light = std::array::from_fn(|k| seen * flux[k] * quotient[k]);
                    self.splat(share.u, share.cos_d, light, bins);
                }
            }
        }
    }

    /// Adds what one part of a texel sends to the two nodes around its place, for each factor.
    #[inline]
    fn splat(&self, u: f64, cos_d: f64, light: [f64; 3], bins: &mut [[[f64; CURVE]; 3]]) {
        let (node, rest) = between(u, CURVE);
        for (factor, bins) in self.factors.iter().zip(bins) {
            let (place, further) = between(cos_d, factor.len());
            let reflected = (1.0 - further) * factor[place] + further * factor[place + 1];
            for (bins, light) in bins.iter_mut().zip(light) {
                bins[node] += (1.0 - rest) * reflected * light;
                bins[node + 1] += rest * reflected * light;
            }
        }
    }

    /// The wavelets of a row's histograms, into its lane: band by band, in each factor after factor.
    fn transform(&self, lane: usize, bins: &[[[f64; CURVE]; 3]], planes: &mut [Vec<Rows16>; 3]) {
        for (factor, colours) in bins.iter().enumerate() {
            for (samples, plane) in colours.iter().zip(planes.iter_mut()) {
                let coefficients = Daubechies4::shared().forward(samples);
                for (number, value) in coefficients.iter().enumerate() {
                    plane[column_of(factor, number, bins.len())][lane] = *value as f32;
                }
            }
        }
    }
}

/// The column of a coefficient of a factor: in its band, behind those of the factors before.
pub fn column_of(factor: usize, coefficient: usize, factors: usize) -> usize {
    // Bands are as wide as all before them together.
    let start = if coefficient < COARSEST { 0 } else { 1 << coefficient.ilog2() };
    let width = start.max(COARSEST);
    start * factors + factor * width + coefficient - start
}

impl Pass for CurvePass {
    type Room = Room;

    fn shape(&self) -> &Shape {
        &self.shape
    }

    fn room(&self) -> Room {
        Room {
            looking: Looking::default(),
            bins: vec![[[0.0; CURVE]; 3]; self.factors.len()],
            planes: std::array::from_fn(|_| vec![[0.0; GROUP]; self.shape.bands.columns()]),
        }
    }

    fn bundle(&self, rows: Range<usize>, room: &mut Room, take: &mut Take) -> Result<Made> {
        let view = self.visibility.view(rows.clone(), &mut room.looking);
        for first in (0..rows.len()).step_by(GROUP) {
            room.planes.iter_mut().for_each(|plane| plane.fill([0.0; GROUP]));
            for lane in 0..GROUP.min(rows.len() - first) {
                self.row(rows.start + first + lane, first + lane, &view, &mut room.bins);
                self.transform(lane, &room.bins, &mut room.planes);
            }
            take(0, &room.planes.each_ref().map(Vec::as_slice), 0.0)?;
        }
        Ok(Made { rays: view.rays, seen: None })
    }
}
