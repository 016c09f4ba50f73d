//! Receivers: what the rows of M are.

use super::lobes::Lobes;
use super::slab::Slab;

/// The rows of M: surface points, and what they stand for.
#[derive(Clone)]
pub struct ReceiverTable {
    /// Diffuse reflectance, `[row][rgb]`.
    pub albedo: Slab<f32>,
    /// World coordinates, `[row][xyz]`.
    pub position: Slab<f32>,
    /// Unit normals in the same axes, `[row][xyz]`.
    pub normal: Slab<f32>,
    /// The number of each row's material, where the scene has them.
    pub material: Option<Slab<u16>>,
    /// Lobes of rows, where texel columns are made of them.
    pub lobes: Option<Lobes>,
    /// What the points stand for, with what that takes.
    pub kind: ReceiverKind,
}

/// What the points stand for.
#[derive(Clone)]
pub enum ReceiverKind {
    /// Samples of a camera's pixels.
    Pixels {
        /// [height, width]
        image: [usize; 2],
        /// The pixel that a row adds to, row-major.
        pixel: Slab<u32>,
        /// What share of the pixel the row is.
        weight: Slab<f32>,
        /// What share of each pixel sees no surface.
        background: Slab<f32>,
    },
    /// Vertices of a mesh.
    Vertices {
        /// The number of each row's vertex.
        vertex: Slab<u32>,
        /// 1 where the vertex lies inside something and sees nothing.
        buried: Slab<u8>,
    },
    /// Samples of surfaces, in the order of their tree.
    Gather {
        /// Of the surface that each stands for.
        area: Slab<f32>,
    },
}

impl ReceiverKind {
    /// The word for it in a manifest.
    pub fn name(&self) -> &'static str {
        match self {
            ReceiverKind::Pixels { .. } => "pixels",
            ReceiverKind::Vertices { .. } => "vertices",
            ReceiverKind::Gather { .. } => "gather",
        }
    }
}

/// `N` numbers a row, in another order of the rows.
fn gathered<T: bytemuck::Pod, const N: usize>(items: &[T], order: &[u32]) -> Slab<T> {
    let rows = items.as_chunks::<N>().0;
    order.iter().flat_map(|&row| rows[row as usize]).collect::<Vec<T>>().into()
}

type Check = std::result::Result<(), String>;

fn check_length(what: &str, found: usize, expected: usize) -> Check {
    if found == expected { Ok(()) } else { Err(format!("expected {expected} numbers of {what}, found {found}")) }
}

/// Finite and not negative.
fn check_shares(what: &str, items: &[f32]) -> Check {
    match items.iter().find(|item| !(item.is_finite() && **item >= 0.0)) {
        Some(item) => Err(format!("expected finite {what} values >= 0, found {item}")),
        None => Ok(()),
    }
}

fn check_finite(what: &str, items: &[f32]) -> Check {
    match items.iter().find(|item| !item.is_finite()) {
        Some(item) => Err(format!("expected finite {what} values, found {item}")),
        None => Ok(()),
    }
}

impl ReceiverTable {
    /// Whether there is one item a row and a pixel, pixels exist, and all numbers are finite, shares not negative.
    pub fn check(&self, rows: usize) -> Check {
        check_length("albedo", self.albedo.len(), 3 * rows)?;
        check_length("position", self.position.len(), 3 * rows)?;
        check_length("normal", self.normal.len(), 3 * rows)?;
        check_length("material", self.material.as_ref().map_or(rows, |items| items.len()), rows)?;
        check_shares("albedo", &self.albedo)?;
        check_finite("position", &self.position)?;
        check_finite("normal", &self.normal)?;
        if let Some(lobes) = &self.lobes {
            check_length("lobe", lobes.model.len(), rows)?;
            lobes.check(&self.normal)?;
        }
        match &self.kind {
            ReceiverKind::Pixels { image, pixel, weight, background } => {
                let pixels = image[0].checked_mul(image[1]).ok_or("expected an image of at most 2^28 pixels")?;
                check_length("pixel", pixel.len(), rows)?;
                check_length("weight", weight.len(), rows)?;
                check_length("background", background.len(), pixels)?;
                check_shares("weight", weight)?;
                check_shares("background", background)?;
                match pixel.iter().find(|&&pixel| pixel as usize >= pixels) {
                    Some(pixel) => Err(format!("expected pixels below {pixels}, found {pixel}")),
                    None => Ok(()),
                }
            }
            ReceiverKind::Vertices { vertex, buried } => {
                check_length("vertex", vertex.len(), rows)?;
                check_length("buried", buried.len(), rows)?;
                match buried.iter().find(|&&flag| flag > 1) {
                    Some(flag) => Err(format!("expected buried to be 0 or 1, found {flag}")),
                    None => Ok(()),
                }
            }
            ReceiverKind::Gather { area } => {
                check_length("area", area.len(), rows)?;
                check_shares("area", area)
            }
        }
    }

    /// The same points in another order: row k is what row `order[k]` was. Panics where there is no such row.
    pub fn permuted(&self, order: &[u32]) -> ReceiverTable {
        ReceiverTable {
            albedo: gathered::<f32, 3>(&self.albedo, order),
            position: gathered::<f32, 3>(&self.position, order),
            normal: gathered::<f32, 3>(&self.normal, order),
            material: self.material.as_ref().map(|material| gathered::<u16, 1>(material, order)),
            lobes: self.lobes.as_ref().map(|lobes| lobes.picked(order.iter().map(|&row| row as usize))),
            kind: match &self.kind {
                ReceiverKind::Pixels { image, pixel, weight, background } => ReceiverKind::Pixels {
                    image: *image,
                    pixel: gathered::<u32, 1>(pixel, order),
                    weight: gathered::<f32, 1>(weight, order),
                    background: background.clone(),
                },
                ReceiverKind::Vertices { vertex, buried } => ReceiverKind::Vertices {
                    vertex: gathered::<u32, 1>(vertex, order),
                    buried: gathered::<u8, 1>(buried, order),
                },
                ReceiverKind::Gather { area } => ReceiverKind::Gather { area: gathered::<f32, 1>(area, order) },
            },
        }
    }

    /// Bytes of all arrays.
    pub fn nbytes(&self) -> usize {
        let floats = self.albedo.len() + self.position.len() + self.normal.len();
        let own = match &self.kind {
            ReceiverKind::Pixels { pixel, weight, background, .. } => {
                4 * (pixel.len() + weight.len() + background.len())
            }
            ReceiverKind::Vertices { vertex, buried } => 4 * vertex.len() + buried.len(),
            ReceiverKind::Gather { area } => 4 * area.len(),
        };
        let lobes = self.lobes.as_ref().map_or(0, Lobes::nbytes);
        4 * floats + lobes + 2 * self.material.as_ref().map_or(0, |material| material.len()) + own
    }
}
