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
use super::texels::Texels;
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
    /// Refuses edge sampling that no texel needs, and texel columns where rows are glossy: those hold cosines.
    pub fn new(
        tracer: Arc<Tracer>,
        points: Arc<Points>,
        lobes: Arc<Lobes>,
        space: ColumnSpace,
        edge_side: usize,
    ) -> Result<Self> {
        if space.texels().is_some() && lobes.any() {
            return Err(Error::input(format!("expected columns without texels for glossy rows, got {space}")));
        }
        let projection = Projection::new(space)?;
        let rows = points.len();
        let visibility = Visibility::new(tracer, points, projection.size(), edge_side)?;
        let shape = Shape { rows, texels: space.texels(), bands: space.bands(), channels: Channels::One, factors: 1 };
        Ok(DirectPass { visibility, lobes, projection, shape })
    }

    /// The transport rows of 16 receivers of a bundle, as coefficients in `room.coefficients`.
    fn transform(&self, rows: Range<usize>, group: usize, view: &View, room: &mut Room) {
        let normals = Normals::new(&self.visibility.points.normal[rows.clone()]);
        let lanes = group * GROUP;
        let glossy = self.glossy(rows.start + lanes..rows.end.min(rows.start + lanes + GROUP));
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
                for own in &glossy {
                    let cosine = normals.cosine(self.visibility.texels.centre[texel], lanes + own.lane);
                    row[own.lane] = own.instead_of(row[own.lane], cosine, &self.visibility.texels, texel);
                }
                let factor = self.projection.factor(k);
                for value in row.iter_mut() {
                    *value *= factor;
                }
            }
            self.projection.face_done(face, &mut room.texels, &mut room.coefficients);
        }
    }
}

impl DirectPass {
    /// The lobes of a group's rows.
    fn glossy(&self, rows: Range<usize>) -> Vec<Glossy<'_>> {
        let (size, areas) = (self.projection.size(), self.projection.areas());
        let own = |(lane, row): (usize, usize)| {
            let lobe = self.lobes.of(row, self.visibility.points.normal[row])?;
            let sampled = lobe.is_narrow(size).then(|| lobe.sampled(&self.visibility.texels, areas, row as u64));
            Some(Glossy { lane, lobe, sampled })
        };
        rows.enumerate().filter_map(own).collect()
    }
}

/// A row with a lobe, in its group.
struct Glossy<'a> {
    lane: usize,
    lobe: Lobe<'a>,
    /// What each texel takes, where the lobe is much narrower than texels.
    sampled: Option<Vec<(u32, f32)>>,
}

impl Glossy<'_> {
    /// What the row takes from a texel, where a diffuse one takes `seen` of a `cosine`: as much of the lobe is seen.
    fn instead_of(&self, seen: f32, cosine: f32, texels: &Texels, texel: usize) -> f32 {
        if seen <= 0.0 {
            return 0.0;
        }
        let whole = match &self.sampled {
            None => self.lobe.mean(texels, texel),
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
        for group in 0..rows.len().div_ceil(GROUP) {
            self.transform(rows.clone(), group, &view, room);
            take(0, &[&room.coefficients])?;
        }
        let normals = || self.visibility.points.normal[rows].to_vec();
        let seen = self.shape.texels.map(|_| Seen { normals: normals(), open: view.open });
        Ok(Made { rays: view.rays, seen })
    }
}
