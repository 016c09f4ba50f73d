//! Holes: what of a triangle is not there, by its material's opacity at the point that a ray meets.
//!
//! ```text
//!     opacity    factor * picture(u, v) * mean of the corners' own
//!     cut out    there where it is at least the cutoff, and nowhere else
//!     thin       stops so large a share of all rays: hashed by the ray, so that one ray always finds the same
//! ```
//!
//! Source: Wyman and McGuire, Hashed Alpha Testing (2017), with the ray in the place of the point.

use super::tree::WideTree;
use crate::error::{Error, Result};
use crate::sampling::mixed;
use crate::scene::mesh::Mesh;

/// Above this a surface stops all rays, and below one minus it none: an 8-bit picture's last step counts.
const WHOLE: f32 = 0.999;

/// What lies outside a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrap {
    /// The picture again.
    Repeat,
    /// Its border.
    Clamp,
    /// Its mirror image.
    Mirror,
}

impl Wrap {
    /// A texel's number along an axis inside the picture.
    fn inside(self, texel: i64, size: usize) -> usize {
        let size = size as i64;
        (match self {
            Wrap::Repeat => texel.rem_euclid(size),
            Wrap::Clamp => texel.clamp(0, size - 1),
            Wrap::Mirror => {
                let at = texel.rem_euclid(2 * size);
                if at < size { at } else { 2 * size - 1 - at }
            }
        }) as usize
    }
}

/// A picture of opacity; row 0 is the top, and v runs upwards.
pub struct Picture {
    values: Vec<f32>,
    width: usize,
    height: usize,
    wrap: [Wrap; 2],
    nearest: bool,
}

impl Picture {
    /// Refuses what is empty or no opacity.
    pub fn new(values: Vec<f32>, width: usize, wrap: [Wrap; 2], nearest: bool) -> Result<Self> {
        if width == 0 || values.is_empty() || !values.len().is_multiple_of(width) {
            return Err(Error::input("expected a picture of opacity with pixels, got none"));
        }
        if !values.iter().all(|value| (0.0..=1.0).contains(value)) {
            return Err(Error::input("expected opacities from 0 to 1"));
        }
        let height = values.len() / width;
        Ok(Picture { values, width, height, wrap, nearest })
    }

    /// The place in texels, their middles at whole numbers.
    fn texels(&self, uv: [f32; 2]) -> [f64; 2] {
        let half = if self.nearest { 0.0 } else { 0.5 };
        [f64::from(uv[0]) * self.width as f64 - half, (1.0 - f64::from(uv[1])) * self.height as f64 - half]
    }

    fn value(&self, column: i64, row: i64) -> f32 {
        self.values[self.wrap[1].inside(row, self.height) * self.width + self.wrap[0].inside(column, self.width)]
    }

    fn at(&self, uv: [f32; 2]) -> f32 {
        let [x, y] = self.texels(uv);
        let (column, row) = (x.floor(), y.floor());
        let (column_number, row_number) = (column as i64, row as i64);
        if self.nearest {
            return self.value(column_number, row_number);
        }
        let (fx, fy) = ((x - column) as f32, (y - row) as f32);
        let line = |row| (1.0 - fx) * self.value(column_number, row) + fx * self.value(column_number + 1, row);
        (1.0 - fy) * line(row_number) + fy * line(row_number + 1)
    }

    /// The least and the greatest value that a triangle may meet.
    fn range(&self, uv: &[[f32; 2]; 3], whole: (f32, f32)) -> (f32, f32) {
        let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
        for at in uv.map(|uv| self.texels(uv)) {
            for axis in 0..2 {
                (low[axis], high[axis]) = (low[axis].min(at[axis]), high[axis].max(at[axis]));
            }
        }
        if high[0] - low[0] >= self.width as f64 || high[1] - low[1] >= self.height as f64 {
            return whole;
        }
        let mut range = (f32::MAX, f32::MIN);
        for row in low[1].floor() as i64..=high[1].floor() as i64 + 1 {
            for column in low[0].floor() as i64..=high[0].floor() as i64 + 1 {
                let value = self.value(column, row);
                range = (range.0.min(value), range.1.max(value));
            }
        }
        range
    }
}

/// How much of a material is there.
pub struct Opacity {
    /// Of all of it.
    pub factor: f32,
    /// What is less opaque is cut out; without it surfaces are thin.
    pub cutoff: Option<f32>,
    /// Of its parts.
    pub picture: Option<Picture>,
}

/// What a triangle is to rays.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Solid,
    /// None of it is there.
    Gone,
    /// Its place in the list of those with holes.
    Porous(u32),
}

struct Triangle {
    opacity: u32,
    uv: [[f32; 2]; 3],
    own: [f32; 3],
}

/// What a ray finds.
#[derive(Clone, Copy)]
pub(super) struct Found {
    pub stops: bool,
    /// Whether another ray there might have found otherwise.
    pub thin: bool,
}

/// The holes of a scene; empty where every triangle is solid.
#[derive(Default)]
pub struct Holes {
    opacities: Vec<Option<Opacity>>,
    kinds: Vec<Kind>,
    porous: Vec<Triangle>,
}

impl Holes {
    /// Of materials: `material` numbers them by the user's triangles, whose corners have places in pictures and opacities
    /// of their own.
    pub fn new(
        mesh: &Mesh,
        triangles: &[[u32; 3]],
        material: &[u32],
        opacities: Vec<Option<Opacity>>,
        uv: &[[f32; 2]],
        own: &[f32],
    ) -> Result<Self> {
        let vertices = uv.len();
        let fits = own.len() == vertices && triangles.as_flattened().iter().all(|&vertex| (vertex as usize) < vertices);
        if !fits || triangles.len() != material.len() || material.iter().any(|&own| own as usize >= opacities.len()) {
            return Err(Error::input("expected a place and an opacity of each vertex, and an entry of each material"));
        }
        let whole = |opacity: &Option<Opacity>| {
            let picture = opacity.as_ref().and_then(|opacity| opacity.picture.as_ref());
            picture.map_or((1.0, 1.0), |picture| {
                picture.values.iter().fold((1.0f32, 0.0f32), |(low, high), &x| (low.min(x), high.max(x)))
            })
        };
        let wholes: Vec<(f32, f32)> = opacities.iter().map(whole).collect();
        let mut holes = Holes { kinds: Vec::with_capacity(mesh.source.len()), ..Holes::default() };
        for &source in &mesh.source {
            let number = material[source as usize];
            let corners = triangles[source as usize].map(|vertex| vertex as usize);
            let triangle = Triangle { opacity: number, uv: corners.map(|k| uv[k]), own: corners.map(|k| own[k]) };
            let kind = match &opacities[number as usize] {
                None => Kind::Solid,
                Some(opacity) => kind(opacity, &triangle, wholes[number as usize], holes.porous.len() as u32),
            };
            if let Kind::Porous(_) = kind {
                holes.porous.push(triangle);
            }
            holes.kinds.push(kind);
        }
        if holes.kinds.iter().all(|kind| *kind == Kind::Solid) {
            return Ok(Holes::default());
        }
        holes.opacities = opacities;
        Ok(holes)
    }

    /// Of a triangle of the mesh.
    pub(super) fn kind(&self, triangle: usize) -> Kind {
        self.kinds.get(triangle).copied().unwrap_or(Kind::Solid)
    }

    /// Whether every triangle is solid.
    pub fn is_empty(&self) -> bool {
        self.kinds.is_empty()
    }

    /// What a ray finds that meets a porous triangle where corners 1 and 2 have these weights.
    pub(super) fn meet(&self, porous: u32, [b1, b2]: [f32; 2], ray: u64) -> Found {
        let triangle = &self.porous[porous as usize];
        let Some(opacity) = &self.opacities[triangle.opacity as usize] else {
            return Found { stops: true, thin: false };
        };
        let mixed_of = |of: [f32; 3]| (1.0 - b1 - b2) * of[0] + b1 * of[1] + b2 * of[2];
        let uv = [0, 1].map(|axis| mixed_of(triangle.uv.map(|uv| uv[axis])));
        let picture = opacity.picture.as_ref().map_or(1.0, |picture| picture.at(uv));
        let there = opacity.factor * picture * mixed_of(triangle.own);
        match opacity.cutoff {
            Some(cutoff) => Found { stops: there >= cutoff, thin: false },
            None => {
                let number = (mixed(ray ^ mixed(u64::from(porous))) >> 40) as f32 / (1u64 << 24) as f32;
                Found { stops: number < there, thin: (1.0 - WHOLE..WHOLE).contains(&there) }
            }
        }
    }
}

fn kind(opacity: &Opacity, triangle: &Triangle, whole: (f32, f32), place: u32) -> Kind {
    let picture = opacity.picture.as_ref();
    let (low, high) = picture.map_or((1.0, 1.0), |picture| picture.range(&triangle.uv, whole));
    let [least, most] = [f32::min, f32::max].map(|of| triangle.own.iter().copied().reduce(of).unwrap_or(1.0));
    let (low, high) = (opacity.factor * low * least, opacity.factor * high * most);
    let (solid, gone) = match opacity.cutoff {
        Some(cutoff) => (low >= cutoff, high < cutoff),
        None => (low >= WHOLE, high <= 1.0 - WHOLE),
    };
    match (solid, gone) {
        (true, _) => Kind::Solid,
        (_, true) => Kind::Gone,
        _ => Kind::Porous(place),
    }
}

/// A number of a ray, of its origin and two or three numbers of its direction.
pub(super) fn ray_number(origin: [f32; 3], direction: &[f32]) -> u64 {
    origin.iter().chain(direction).fold(0, |number, &x| mixed(number ^ u64::from(x.to_bits())))
}

/// Triangles with holes in a tree of their own.
#[derive(Default)]
pub(super) struct Porous {
    pub holes: Holes,
    pub wide: WideTree,
    /// Of each leaf the places of its triangles in the list of those with holes.
    pub numbers: Vec<[u32; 8]>,
}
