//! The texel columns of M: what every row sees of every texel, as bits.
//!
//! Under a sun a truncated wavelet row is wrong by whatever its truncated cosine is wrong by where the sun stands, and all
//! rows of a floor are wrong alike. The brightest light is therefore taken out of the wavelets and multiplied by columns
//! that are not truncated, one a texel, in the texels' own orthonormal basis:
//!
//! ```text
//!     N_ij = open_ij max(n_i . d_j, 0) / pi * sqrt(dw_j),    B = M V_soft + N V_peak
//! ```
//!
//! A row keeps its normal and one bit a texel, which the first ray to the texel has answered; the cosine is made anew, on
//! the grid 2^quantum of all of M, from numbers and operations that are the same on every machine. A glossy row has the mean
//! of its lobe over the texel in the place of the cosine over pi (`lobes.rs`); a group that a narrow lobe takes beyond what
//! sums hold exactly has a coarser unit, which its entries share (`truncate.rs`).
//!
//! Bits come in masks of 64 neighbouring rows. A block of 8 x 8 texels that all rows see, or none, costs four bytes.
//! Others are streams: a byte that says which of a mask's eight bytes differ from the mask before, then those bytes; rows
//! that have the texel below their horizon repeat the bit before, as their cosine is zero anyway. Each 4 x 4 texels start
//! anew, so that a mask is found in a few steps. (Measured, plant 512x512: 57 MB, where plain masks of what is neither all
//! open nor all closed take 120; masks of 16 rows instead take as much.)

use std::sync::OnceLock;

use crate::basis::cubemap::{curve_place, solid_angles, texel_direction};

use super::entry::{GROUP, Rows16, bf16_up, nearest_integer, power_of_two};
use super::lobes::Lobes;
use super::slab::Slab;

/// Rows of a mask.
pub const BUNDLE: usize = 64;
/// Texels of a block, and of the squares that start anew.
const BLOCK: usize = 64;
const SQUARE: usize = 16;
/// Bytes before a block's masks: where each of its four squares ends.
const HEADER: usize = 8;
/// In place of where a block begins: no row sees any of its texels; every row sees what is above its horizon.
const CLOSED: u32 = u32::MAX;
const OPEN: u32 = u32::MAX - 1;

/// What a texel's column is made of, besides the rows' bits and normals.
#[derive(Clone, Copy, Debug)]
pub struct TexelColumn {
    /// The unit direction of its centre.
    pub direction: [f32; 3],
    /// The root of its solid angle over pi: what a cosine is multiplied by.
    pub factor: f32,
}

/// The columns of all 6 `size`^2 texels, row-major, face after face; made once for each size, a power of two up to
/// `ColumnSpace::MAX_HAAR`.
pub fn texel_columns(size: usize) -> &'static [TexelColumn] {
    static MADE: [OnceLock<Vec<TexelColumn>>; 10] = [const { OnceLock::new() }; 10];
    MADE[size.trailing_zeros() as usize].get_or_init(|| {
        let areas = solid_angles(size);
        let column = |texel: usize| {
            let (face, at) = (texel / (size * size), texel % (size * size));
            TexelColumn {
                direction: texel_direction(size, face, at / size, at % size).map(|x| x as f32),
                factor: (areas[at].sqrt() / std::f64::consts::PI) as f32,
            }
        };
        (0..6 * size * size).map(column).collect()
    })
}

impl TexelColumn {
    /// The same in units of 2^quantum.
    pub fn in_units(self, quantum: i32) -> Self {
        TexelColumn { factor: self.factor * power_of_two(-quantum), ..self }
    }

    /// What rows that see the texel hold, before it is rounded to the grid: `normals[axis][lane]`.
    #[inline(always)]
    pub fn values<const N: usize>(&self, normals: &[[f32; N]; 3]) -> [f32; N] {
        let [x, y, z] = self.direction;
        let mut values = [0.0; N];
        for (lane, value) in values.iter_mut().enumerate() {
            let cosine = normals[0][lane] * x + normals[1][lane] * y + normals[2][lane] * z;
            *value = if cosine > 0.0 { cosine * self.factor } else { 0.0 };
        }
        values
    }
}

/// The nearest integer to a value in units.
#[inline(always)]
pub fn whole(value: f32) -> f64 {
    nearest_integer(f64::from(value))
}

/// What the rows of one bundle see, as a pass finds it.
#[derive(Clone, Debug)]
pub struct Seen {
    /// Of each of its rows, at most `BUNDLE`.
    pub normals: Vec<[f32; 3]>,
    /// For each texel the rows that see it, one bit each.
    pub open: Vec<u64>,
    /// Of each glossy row its number, and what it has for a cosine at every texel that it sees.
    pub means: Vec<(usize, Vec<f32>)>,
}

/// Texel bits of a tile.
#[derive(Clone)]
pub struct Sight {
    /// Texels along a face.
    pub size: usize,
    /// Values are rounded to integers times 2^quantum: that of the matrix.
    pub quantum: i32,
    /// Unit normals, `[row][xyz]`.
    pub normals: Slab<f32>,
    /// Lobes of the rows, where any is glossy.
    pub lobes: Option<Lobes>,
    /// Of each group: its values are integers times 2^(quantum + shift). Empty, and 0, where no row is glossy.
    pub shifts: Slab<u8>,
    /// For each bundle and block where its stream begins, or `CLOSED` or `OPEN`.
    pub blocks: Slab<u32>,
    /// Masks, block after block.
    pub stream: Slab<u8>,
}

/// What a bundle's part of a `Sight` is made of.
#[derive(Clone, Debug)]
pub struct Encoded {
    normals: Vec<[f32; 3]>,
    shifts: Vec<u8>,
    blocks: Vec<u32>,
    stream: Vec<u8>,
    /// For each row the squared norm of its texel columns on the grid, and of what rounding took.
    squares: Vec<[f64; 2]>,
}

/// Blocks of all six faces.
pub fn blocks_of(size: usize) -> usize {
    (6 * size * size).div_ceil(texels_of_block(size))
}

fn texels_of_block(size: usize) -> usize {
    (size * size).min(BLOCK)
}

/// The block of a texel, and its place along the block's Morton curve.
fn place(size: usize, texel: usize) -> (usize, usize) {
    let side = size.min(8);
    let (face, row, column) = (texel / (size * size), texel / size % size, texel % size);
    let along = size / side;
    let block = (face * along + row / side) * along + column / side;
    (block, curve_place(column % side, row % side))
}

/// Texels in the order in which their masks are stored.
pub struct Texels(Vec<Texel>);

/// Where a texel's masks stand, and its number in the list that was asked for.
struct Texel {
    block: usize,
    at: usize,
    number: usize,
}

impl Texels {
    /// Of a list without repetitions.
    pub fn new(size: usize, texels: impl IntoIterator<Item = usize>) -> Self {
        let of = |(number, texel): (usize, usize)| {
            let (block, at) = place(size, texel);
            Texel { block, at, number }
        };
        let mut places: Vec<Texel> = texels.into_iter().enumerate().map(of).collect();
        places.sort_by_key(|texel| (texel.block, texel.at));
        Texels(places)
    }
}

impl Encoded {
    /// Of one bundle, in units of 2^(quantum + shift), one shift a group.
    pub fn new(seen: &Seen, size: usize, quantum: i32, shifts: Vec<u8>) -> Self {
        let columns = texel_columns(size);
        let lanes: [[f32; BUNDLE]; 3] =
            std::array::from_fn(|axis| std::array::from_fn(|row| seen.normals.get(row).map_or(0.0, |n| n[axis])));
        let unit = f64::from(power_of_two(quantum));
        let steps: Vec<f32> = shifts.iter().map(|&shift| power_of_two(i32::from(shift))).collect();
        let mut squares = vec![[0.0; 2]; seen.normals.len()];
        // By block and place: the rows that see a texel, and those above whose horizon it lies.
        let mut masks = vec![[0u64; 2]; columns.len()];
        for (texel, (column, &open)) in columns.iter().zip(&seen.open).enumerate() {
            let column = column.in_units(quantum);
            let mut values = column.values(&lanes);
            let above = (0..BUNDLE).fold(0, |above, row| above | u64::from(values[row] > 0.0) << row);
            for (row, means) in &seen.means {
                values[*row] = if above >> row & 1 == 1 { means[texel] * column.factor } else { 0.0 };
            }
            for (row, squares) in squares.iter_mut().enumerate() {
                if open >> row & 1 == 1 {
                    let step = steps[row / GROUP];
                    let stored = whole(values[row] / step) * f64::from(step);
                    squares[0] += stored * stored;
                    squares[1] += (f64::from(values[row]) - stored).powi(2);
                }
            }
            let (block, at) = place(size, texel);
            masks[block * texels_of_block(size) + at] = [open & above, above];
        }
        squares.iter_mut().flatten().for_each(|square| *square *= unit * unit);
        let mut encoded =
            Encoded { normals: seen.normals.clone(), shifts, blocks: Vec::new(), stream: Vec::new(), squares };
        masks.chunks(texels_of_block(size)).for_each(|block| encoded.push(block));
        encoded
    }

    /// Bytes that it takes in a tile.
    pub fn nbytes(&self) -> usize {
        4 * self.blocks.len() + self.stream.len()
    }

    /// For each row the norm of its texel columns, and of what rounding took from them: bfloat16, never below the truth.
    pub fn norms(&self) -> impl Iterator<Item = [u16; 2]> {
        // For the roundings of sums.
        const MARGIN: f64 = 1.0 + 1.0 / 65536.0;
        self.squares.iter().map(|squares| squares.map(|square| bf16_up(square.sqrt() * MARGIN)))
    }

    fn push(&mut self, block: &[[u64; 2]]) {
        if let Some(word) = alike(block) {
            self.blocks.push(word);
            return;
        }
        let start = self.stream.len();
        self.blocks.push(start as u32);
        self.stream.extend([0; HEADER]);
        for (number, square) in block.chunks(SQUARE).enumerate() {
            match alike(square) {
                Some(CLOSED) => {}
                Some(_) => self.stream.push(0xff),
                None => self.push_square(square),
            }
            let end = (self.stream.len() - start - HEADER) as u16;
            // The squares that a small face lacks end where the last one does.
            for k in number..HEADER / 2 {
                self.stream[start + 2 * k..start + 2 * k + 2].copy_from_slice(&end.to_le_bytes());
            }
        }
    }

    fn push_square(&mut self, square: &[[u64; 2]]) {
        let mut before = 0u64;
        for &[open, above] in square {
            let mask = open | before & !above;
            let (bytes, last) = (mask.to_le_bytes(), before.to_le_bytes());
            let flags = (0..8).fold(0u8, |flags, k| flags | u8::from(bytes[k] != last[k]) << k);
            self.stream.push(flags);
            self.stream.extend((0..8).filter(|k| flags >> k & 1 == 1).map(|k| bytes[k]));
            before = mask;
        }
    }
}

/// The word for texels that no row sees, or that all rows see; none for others.
fn alike(texels: &[[u64; 2]]) -> Option<u32> {
    if texels.iter().all(|&[open, _]| open == 0) {
        Some(CLOSED)
    } else {
        texels.iter().all(|&[open, above]| open == above).then_some(OPEN)
    }
}

impl Sight {
    /// Bundles one below the other, with the lobes of their rows.
    pub fn join(size: usize, quantum: i32, lobes: Option<Lobes>, parts: &[Encoded]) -> Sight {
        let (mut blocks, mut stream) = (Vec::new(), Vec::new());
        for part in parts {
            let before = stream.len() as u32;
            blocks.extend(part.blocks.iter().map(|&block| if block >= OPEN { block } else { block + before }));
            stream.extend_from_slice(&part.stream);
        }
        let normals: Vec<f32> = parts.iter().flat_map(|part| part.normals.iter().flatten().copied()).collect();
        let shifts: Vec<u8> = parts.iter().filter(|_| lobes.is_some()).flat_map(|part| part.shifts.clone()).collect();
        let (blocks, stream) = (blocks.into(), stream.into());
        Sight { size, quantum, normals: normals.into(), lobes, shifts: shifts.into(), blocks, stream }
    }

    /// Masks of 64 rows that each texel has.
    pub fn bundles(&self) -> usize {
        (self.normals.len() / 3).div_ceil(BUNDLE)
    }

    /// Bytes of the bits; normals and lobes are those of the receivers.
    pub fn nbytes(&self) -> usize {
        4 * self.blocks.len() + self.stream.len() + self.shifts.len()
    }

    /// The shift of a group.
    pub fn shift(&self, group: usize) -> i32 {
        self.shifts.get(group).copied().unwrap_or(0).into()
    }

    /// For each of some texels the rows of a bundle that see it, one bit each; rows that have it below their horizon may say
    /// anything. Texels of one square are read in one go.
    pub fn masks(&self, bundle: usize, texels: &Texels, masks: &mut [u64]) {
        let blocks = &self.blocks[bundle * blocks_of(self.size)..];
        for square in texels.0.chunk_by(|a, b| a.block == b.block && a.at / SQUARE == b.at / SQUARE) {
            let start = blocks[square[0].block];
            match start {
                CLOSED => square.iter().for_each(|texel| masks[texel.number] = 0),
                OPEN => square.iter().for_each(|texel| masks[texel.number] = u64::MAX),
                _ => self.read(start as usize, square, masks),
            }
        }
    }

    /// Texels of one square, ascending.
    fn read(&self, start: usize, texels: &[Texel], masks: &mut [u64]) {
        let stream = &self.stream[start..];
        let end = |square: usize| usize::from(u16::from_le_bytes([stream[2 * square], stream[2 * square + 1]]));
        let square = texels[0].at / SQUARE;
        let first = if square == 0 { 0 } else { end(square - 1) };
        let alike = match end(square) - first {
            0 => Some(0),
            1 => Some(u64::MAX),
            _ => None,
        };
        if let Some(mask) = alike {
            texels.iter().for_each(|texel| masks[texel.number] = mask);
            return;
        }
        let (mut next, mut mask, mut done) = (HEADER + first, 0u64, 0);
        for texel in texels {
            while done <= texel.at % SQUARE {
                let mut flags = stream[next];
                next += 1;
                while flags != 0 {
                    let shift = 8 * flags.trailing_zeros();
                    flags &= flags - 1;
                    mask = mask & !(0xff << shift) | u64::from(stream[next]) << shift;
                    next += 1;
                }
                done += 1;
            }
            masks[texel.number] = mask;
        }
    }

    /// Whether every mask can be read: afterwards `masks` never leaves the stream.
    pub fn check(&self) -> std::result::Result<(), String> {
        for (number, &start) in self.blocks.iter().enumerate() {
            if start < OPEN && !self.readable(start as usize) {
                return Err(format!("expected whole masks of texels, found block {number} damaged"));
            }
        }
        Ok(())
    }

    fn readable(&self, start: usize) -> bool {
        let Some(stream) = self.stream.get(start..).filter(|stream| stream.len() >= HEADER) else { return false };
        let texels = texels_of_block(self.size);
        let mut first = 0;
        for square in 0..texels.div_ceil(SQUARE) {
            let end = usize::from(u16::from_le_bytes([stream[2 * square], stream[2 * square + 1]]));
            let Some(masks) = stream.get(HEADER + first..HEADER + end) else { return false };
            if masks.len() > 1 {
                let mut at = 0;
                for _ in 0..SQUARE.min(texels - SQUARE * square) {
                    let Some(flags) = masks.get(at) else { return false };
                    at += 1 + flags.count_ones() as usize;
                }
                if at != masks.len() {
                    return false;
                }
            }
            first = end;
        }
        true
    }

    /// Calls `visit(group, place in the list, open rows)` for each group of which some row sees a texel of the list, bundle
    /// after bundle, and down each texel group after group.
    pub fn for_each_open(&self, texels: &Texels, mut visit: impl FnMut(usize, usize, u16)) {
        let groups = (self.normals.len() / 3).div_ceil(GROUP);
        let mut masks = vec![0; texels.0.len()];
        for bundle in 0..self.bundles() {
            self.masks(bundle, texels, &mut masks);
            let first = bundle * BUNDLE / GROUP;
            for group in first..groups.min(first + BUNDLE / GROUP) {
                for (place, mask) in masks.iter().enumerate() {
                    let open = (mask >> ((group - first) * GROUP)) as u16;
                    if open != 0 {
                        visit(group, place, open);
                    }
                }
            }
        }
    }

    /// The norm of each row over all texels, from its bits and its normal.
    pub fn row_norms(&self) -> Vec<f64> {
        let rows = self.normals.len() / 3;
        let mut squares = vec![[0.0; GROUP]; rows.div_ceil(GROUP)];
        self.for_each_open(&Texels::new(self.size, 0..texel_columns(self.size).len()), |group, texel, open| {
            let lanes = self.lanes(group, open, texel);
            squares[group].iter_mut().zip(lanes).for_each(|(sum, lane)| *sum += f64::from(lane) * f64::from(lane));
        });
        squares.into_iter().flatten().take(rows).map(f64::sqrt).collect()
    }

    /// The normals of a group, axis by axis; those of rows that pad it are zero.
    #[inline(always)]
    pub fn group_normals(&self, group: usize) -> [Rows16; 3] {
        let mut lanes = [[0.0; GROUP]; 3];
        let own = self.normals.len().min((group + 1) * 3 * GROUP);
        for (lane, normal) in self.normals[group * 3 * GROUP..own].chunks_exact(3).enumerate() {
            (0..3).for_each(|axis| lanes[axis][lane] = normal[axis]);
        }
        lanes
    }

    /// A texel's column in a group of rows of which some see it, exactly as it is multiplied.
    pub fn lanes(&self, group: usize, open: u16, texel: usize) -> Rows16 {
        let step = f64::from(power_of_two(self.quantum));
        let mut lanes = [0.0; GROUP];
        self.integers(group, &[(texel, open)], std::slice::from_mut(&mut lanes));
        lanes.map(|integer| (integer * step) as f32)
    }

    /// The columns of some texels in a group of rows of which some see them, `open`, in whole numbers of 2^quantum.
    #[inline(always)]
    pub fn integers(&self, group: usize, texels: &[(usize, u16)], integers: &mut [[f64; GROUP]]) {
        let (columns, normals) = (texel_columns(self.size), self.group_normals(group));
        let (unit, step) = (self.quantum + self.shift(group), f64::from(power_of_two(self.shift(group))));
        for (&(texel, open), integers) in texels.iter().zip(integers.iter_mut()) {
            let values = columns[texel].in_units(unit).values(&normals);
            for lane in 0..GROUP {
                let seen = if open & 1 << lane != 0 { values[lane] } else { 0.0 };
                integers[lane] = whole(seen) * step;
            }
        }
        if let Some(lobes) = &self.lobes {
            for lane in 0..GROUP {
                let normal = normals.map(|axis| axis[lane]);
                let Some(lobe) = lobes.of(group * GROUP + lane, normal) else { continue };
                // Whatever a lobe does below it, a row sees nothing of a texel whose centre is not above its horizon.
                let above = |texel: usize| columns[texel].values(&normal.map(|x| [x]))[0] > 0.0;
                let seen = |&at: &usize| texels[at].1 >> lane & 1 == 1 && above(texels[at].0);
                let places: Vec<usize> = (0..texels.len()).filter(seen).collect();
                let asked: Vec<usize> = places.iter().map(|&at| texels[at].0).collect();
                let mut means = vec![0.0; asked.len()];
                lobes.models.means(&lobe, self.size, &asked, &mut means);
                for (at, mean) in places.into_iter().zip(means) {
                    integers[at][lane] = whole(mean * columns[texels[at].0].in_units(unit).factor) * step;
                }
            }
        }
    }
}
