//! The direct diffuse pass: T_p = V_p cos(theta_p) / pi * sqrt(dw_p) for every texel p, turned into Haar coefficients (or
//! into those of spherical harmonics: `projection.rs`).
//!
//! ```text
//!     B(x) = 1/pi Int L V cos dw = sum_p L_p sqrt(dw_p) * T_p        (Overbeck 2006, eq. 3.1; the albedo stays outside)
//! ```
//!
//! A receiver looks at a block of texels with one fan of rays. 64 neighbouring receivers go together, and what they see of
//! a texel is one bit each (`visibility.rs`).

use std::ops::Range;
use std::sync::Arc;

use crate::basis::ColumnSpace;
use crate::error::{Error, Result};
use crate::scene::Points;
use crate::scene::rays::Tracer;
use crate::transport::entry::Channels;
use crate::transport::sight::Seen;
use crate::transport::{GROUP, Rows16};

use super::lobes::{Lobe, Lobes};
use super::pass::{Made, Pass, Shape, Take};
use super::projection::{Projection, Scratch};
use super::visibility::{Looking, Normals, View, Visibility};

/// The direct pass over some receivers of a scene.
pub struct DirectPass {
    visibility: Visibility,
    lobes: Arc<Lobes>,
    projection: Projection,
    shape: Shape,
}

/// Room for one bundle and one group of 16 rows, kept by each thread.
pub struct Room {
    looking: Looking,
    texels: Scratch,
    coefficients: Vec<Rows16>,
}

impl DirectPass {
    /// Refuses edge sampling that no texel needs, and texel columns of factors and measured lobes.
    pub fn new(
        tracer: Arc<Tracer>,
        points: Arc<Points>,
        lobes: Arc<Lobes>,
        space: ColumnSpace,
        edge_side: usize,
    ) -> Result<Self> {
        let of_texels = space.texels().and_then(|_| lobes.of_texels());
        if space.texels().is_some() && lobes.any() && of_texels.is_none() {
            let message = format!("expected columns without texels for factors and measured lobes, got {space}");
            return Err(Error::input(message));
        }
        let projection = Projection::new(space)?;
        let rows = points.len();
        let visibility = Visibility::new(tracer, points, projection.size(), edge_side)?;
        let (texels, bands) = (space.texels(), space.bands());
        let shape = Shape { rows, texels, lobes: of_texels, bands, channels: Channels::One, factors: 1 };
        Ok(DirectPass { visibility, lobes, projection, shape })
    }

    /// The transport rows of 16 receivers of a bundle, as coefficients in `room.coefficients`; returns the glossy ones, with
    /// what they have in texel columns.
    fn transform(&self, rows: Range<usize>, group: usize, view: &View, room: &mut Room) -> Vec<Glossy<'_>> {
        let normals = Normals::new(&self.visibility.points.normal[rows.clone()]);
        let lanes = group * GROUP;
        let mut glossy = self.glossy(rows.start + lanes..rows.end.min(rows.start + lanes + GROUP));
        let per_face = self.visibility.texels.len() / 6;
        let mut edges = view.edges.iter().peekable();
        for face in 0..6 {
            for (k, row) in self.projection.face(face, &mut room.texels).iter_mut().enumerate() {
                let texel = face * per_face + k;
                let open = view.open[texel] >> lanes;
                normals.cosines(self.visibility.texels.centre[texel], lanes, row);
                for (lane, value) in row.iter_mut().enumerate() {
                    *value = if open >> lane & 1 == 1 { *value } else { 0.0 };
                }
                if let Some(edge) = edges.next_if(|edge| edge.texel as usize == texel) {
                    for (lane, value) in row.iter_mut().enumerate() {
                        if edge.rows >> (lanes + lane) & 1 == 1 {
                            *value = edge.mean[lanes + lane];
                        }
                    }
                }
                let factor = self.projection.factor(k);
                for own in &mut glossy {
                    let cosine = normals.cosine(self.visibility.texels.centre[texel], lanes + own.lane);
                    let centre = (cosine, open >> own.lane & 1 == 1);
                    row[own.lane] = own.instead_of(row[own.lane], centre, texel, factor);
                }
                for value in row.iter_mut() {
                    *value *= factor;
                }
            }
            self.projection.face_done(face, &mut room.texels, &mut room.coefficients);
        }
        glossy
    }
}

impl DirectPass {
    /// The lobes of a group's rows.
    fn glossy(&self, rows: Range<usize>) -> Vec<Glossy<'_>> {
        let (size, areas) = (self.projection.size(), self.projection.areas());
        let own = |(lane, row): (usize, usize)| {
            let lobe = self.lobes.of(row, self.visibility.points.normal[row])?;
            let sampled = lobe.is_narrow(size).then(|| lobe.sampled(&self.visibility.texels, areas, row as u64));
            let means = self.shape.texels.map(|_| vec![0.0; self.visibility.texels.len()]);
            Some(Glossy { lane, lobe, size, sampled, means, square: 0.0 })
        };
        rows.enumerate().filter_map(own).collect()
    }
}

/// A row with a lobe, in its group.
struct Glossy<'a> {
    lane: usize,
    lobe: Lobe<'a>,
    /// Texels along a face.
    size: usize,
    /// What each texel takes, where the lobe is much narrower than texels.
    sampled: Option<Vec<(u32, f32)>>,
    /// What it has for a cosine at every texel that it sees, where texels are columns, and the squared norm of those columns.
    means: Option<Vec<f32>>,
    square: f64,
}

impl Glossy<'_> {
    /// What the row takes from a texel, where a diffuse one takes `seen`, of a centre with a cosine, open or not: as much of
    /// the lobe is seen. `factor`: what that is multiplied by.
    fn instead_of(&mut self, seen: f32, (cosine, open): (f32, bool), texel: usize, factor: f32) -> f32 {
        let mut mean = None;
        if let Some(means) = self.means.as_mut().filter(|_| open) {
            means[texel] = self.lobe.mean(self.size, texel);
            self.square += f64::from(means[texel] * factor).powi(2);
            mean = Some(means[texel]);
        }
        if seen <= 0.0 {
            return 0.0;
        }
        let whole = match &self.sampled {
            None => mean.unwrap_or_else(|| self.lobe.mean(self.size, texel)),
            Some(hits) => match hits.binary_search_by_key(&(texel as u32), |hit| hit.0) {
                Ok(at) => hits[at].1,
                Err(_) => 0.0,
            },
        };
        whole * if cosine > seen { seen / cosine } else { 1.0 }
    }
}

impl Pass for DirectPass {
    type Room = Room;

    fn shape(&self) -> &Shape {
        &self.shape
    }

    fn room(&self) -> Room {
        Room {
            looking: Looking::default(),
            texels: self.projection.scratch(),
            coefficients: vec![[0.0; GROUP]; self.shape.bands.stored()],
        }
    }

    fn bundle(&self, rows: Range<usize>, room: &mut Room, take: &mut Take) -> Result<Made> {
        let view = self.visibility.view(rows.clone(), &mut room.looking);
        let mut means = Vec::new();
        for group in 0..rows.len().div_ceil(GROUP) {
            let glossy = self.transform(rows.clone(), group, &view, room);
            let longest = glossy.iter().fold(0.0f64, |most, own| most.max(own.square));
            take(0, &[&room.coefficients], longest.sqrt())?;
            means.extend(glossy.into_iter().filter_map(|own| Some((group * GROUP + own.lane, own.means?))));
        }
        let normals = || self.visibility.points.normal[rows].to_vec();
        let seen = self.shape.texels.map(|_| Seen { normals: normals(), open: view.open.clone(), means });
        Ok(Made { rays: view.rays, seen })
    }
}
