//! The inner loop of B = M V: adds a few columns of a tile to its running sums, group after group.
//!
//! Columns are read batch by batch. A first walk over the words of a batch's columns finds which of them touch each
//! group of 16 rows; a second walk goes through the groups in order, and the 16 x 3 sums of a group stay in twelve
//! registers while all its moves are added. So sums are read and written once a batch, and columns are ascending streams.
//! The first walk leaves one bit for each column and group (`Marks`), or, where columns are nearly empty and a batch
//! needs thousands of them to fill the groups, a list of entries sorted by group (`Sorted`).
//!
//! Measured beside the f32 AVX2 prototype, which adds entry by entry into sums in cache, interleaved on one machine
//! (`benches/multiply.rs`): 1.2 to 1.4 times its time for a frame, 1.2 to 1.6 times for the whole product.
//! Tried and dropped: walks of 256 moves at once (their streams evict each other); images of bands (`response.rs`).
//!
//! All sums are exact (`update/grid.rs`): order, batches, fused multiply-add or not, and the number of threads leave
//! the same bits.

use std::ops::Range;

use crate::transport::entry::{GROUP, GROUP_BITS, MAX_TILE_ROWS};
use crate::transport::tile::{Tile, Values};

#[cfg(target_arch = "x86_64")]
mod avx2;
mod portable;

/// The sums of a group of rows: `[colour][lane]`, six cache lines.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub struct Sums(pub [[f64; GROUP]; 3]);

impl Sums {
    pub const ZERO: Sums = Sums([[0.0; GROUP]; 3]);
}

/// A column of M to be added, times `change`, which includes the matrix's 2^quantum.
#[derive(Clone, Copy, Debug)]
pub struct Move {
    pub column: u32,
    pub change: [f64; 3],
}

/// What a walk over a tile changes.
pub struct Target<'a> {
    pub sums: &'a mut [Sums],
    /// The sums start from zero, whatever they hold.
    pub afresh: bool,
    /// Rows x 3, rounded once: given where the walk is the frame's last.
    pub out: Option<&'a mut [f32]>,
}

/// Moves that `Marks` takes at once: a bit each.
const MARKED: usize = u64::BITS as usize;
/// So many entries for each group make a visit to the group worth it.
const ENOUGH: usize = 8;
/// Sorting goes on to so many, which with their integers still fit a core's cache.
const PLENTY: usize = 16;

/// Moves that are added in one walk over the groups of a tile.
pub struct Batch {
    pub moves: Range<usize>,
    sorted: bool,
}

/// Splits moves, by ascending column, into batches for one tile; there is always one, as the last one writes the rows.
pub fn batches(tile: &Tile, moves: &[Move]) -> Vec<Batch> {
    let entries = |moved: &Move| {
        let column = moved.column as usize;
        (tile.starts[column + 1] - tile.starts[column]) as usize
    };
    let mut batches = Vec::with_capacity(moves.len() / MARKED + 1);
    let mut start = 0;
    loop {
        let mut end = moves.len().min(start + MARKED);
        let mut held: usize = moves[start..end].iter().map(entries).sum();
        let sorted = held < ENOUGH * tile.groups() && end < moves.len();
        while sorted && end < moves.len() && held < PLENTY * tile.groups() {
            held += entries(&moves[end]);
            end += 1;
        }
        batches.push(Batch { moves: start..end, sorted });
        start = end;
        if start == moves.len() {
            return batches;
        }
    }
}

/// What walks over tiles need besides, kept between them.
#[derive(Default)]
pub struct Scratch {
    marks: Marks,
    sorted: Sorted,
}

/// Which moves of a batch touch each group of a tile, and how far each column has been read.
///
/// INVARIANT: between walks all marks are zero.
struct Marks {
    groups: Vec<u64>,
    cursors: [u32; MARKED],
    changes: [Spread; MARKED],
}

/// A change in red, green and blue, each four times: loaded, not broadcast in registers.
type Spread = [[f64; 4]; 3];

impl Default for Marks {
    fn default() -> Self {
        let groups = vec![0; MAX_TILE_ROWS / GROUP];
        Marks { groups, cursors: [0; MARKED], changes: [[[0.0; 4]; 3]; MARKED] }
    }
}

impl Marks {
    /// Group numbers ascend inside a column, so that a cursor serves the second walk.
    #[inline(always)]
    fn set<T>(&mut self, columns: &Columns<'_, T>, moves: &[Move], fetch: impl Fn(usize)) {
        for (bit, moved) in moves.iter().enumerate() {
            let entries = columns.entries(moved);
            self.cursors[bit] = entries.start as u32;
            self.changes[bit] = moved.change.map(|x| [x; 4]);
            if let Some(next) = moves.get(bit + 2) {
                fetch(columns.entries(next).start);
            }
            for word in &columns.words[entries] {
                self.groups[(word & GROUP_MASK) as usize] |= 1 << bit;
            }
        }
    }
}

/// The entries of a batch in the order of their groups.
#[derive(Default)]
struct Sorted {
    /// The items of group g are `items[ends[g - 1]..ends[g]]`.
    ends: Vec<u32>,
    items: Vec<Item>,
}

/// An entry and the move it belongs to.
#[derive(Clone, Copy, Default)]
struct Item {
    entry: u32,
    moved: u32,
}

impl Sorted {
    /// A counting sort.
    #[inline(always)]
    fn set<T>(&mut self, columns: &Columns<'_, T>, moves: &[Move]) {
        // Counts are kept one place further on, so that placing the items turns starts into ends.
        self.ends.clear();
        self.ends.resize(MAX_TILE_ROWS / GROUP + 1, 0);
        let mut held = 0;
        for moved in moves {
            let entries = columns.entries(moved);
            held += entries.len();
            for word in &columns.words[entries] {
                self.ends[(word & GROUP_MASK) as usize + 1] += 1;
            }
        }
        let mut start = 0;
        for end in &mut self.ends {
            start += *end;
            *end = start;
        }

        if self.items.len() < held {
            self.items.resize(held, Item::default());
        }
        for (k, moved) in moves.iter().enumerate() {
            for entry in columns.entries(moved) {
                let place = &mut self.ends[(columns.words[entry] & GROUP_MASK) as usize];
                self.items[*place as usize] = Item { entry: entry as u32, moved: k as u32 };
                *place += 1;
            }
        }
    }

    /// The items of a group; groups are asked for in order, and `from` is where the last one ended.
    fn group(&self, group: usize, from: &mut usize) -> Range<usize> {
        let items = *from..self.ends[group] as usize;
        *from = items.end;
        items
    }
}

const GROUP_MASK: u16 = (1 << GROUP_BITS) - 1;

/// 2^shift.
static POWERS: [f64; 64] = {
    let mut powers = [1.0; 64];
    let mut shift = 1;
    while shift < 64 {
        powers[shift] = 2.0 * powers[shift - 1];
        shift += 1;
    }
    powers
};

/// A tile's arrays, of one width of integers.
struct Columns<'a, T> {
    starts: &'a [u32],
    words: &'a [u16],
    /// The integers of each entry.
    lanes: &'a [[T; GROUP]],
}

impl<T> Columns<'_, T> {
    fn entries(&self, moved: &Move) -> Range<usize> {
        let column = moved.column as usize;
        self.starts[column] as usize..self.starts[column + 1] as usize
    }
}

/// Which code runs; both leave the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Engine {
    /// Plain Rust, for any processor.
    Portable,
    /// The fastest that this processor has.
    Native,
}

impl Engine {
    /// Adds one batch of moves to a tile's sums.
    pub fn walk(self, tile: &Tile, batch: &Batch, moves: &[Move], scratch: &mut Scratch, target: Target<'_>) {
        debug_assert!(target.sums.len() == tile.groups());
        let moves = &moves[batch.moves.clone()];
        match &tile.values {
            Values::I8(values) => {
                self.walk_columns::<i8>(tile, bytemuck::cast_slice(values), batch.sorted, moves, scratch, target)
            }
            Values::I16(values) => {
                self.walk_columns::<i16>(tile, bytemuck::cast_slice(values), batch.sorted, moves, scratch, target)
            }
        }
    }

    fn walk_columns<T: Integer>(
        self,
        tile: &Tile,
        lanes: &[[T; GROUP]],
        sorted: bool,
        moves: &[Move],
        scratch: &mut Scratch,
        target: Target<'_>,
    ) {
        let columns = Columns { starts: &tile.starts, words: &tile.words, lanes };
        #[cfg(target_arch = "x86_64")]
        if self == Engine::Native && avx2::available() {
            // SAFETY: the processor has what the code needs.
            return match sorted {
                false => unsafe { avx2::walk_marked(&columns, moves, &mut scratch.marks, target) },
                true => unsafe { avx2::walk_sorted(&columns, moves, &mut scratch.sorted, target) },
            };
        }
        match sorted {
            false => portable::walk_marked(&columns, moves, &mut scratch.marks, target),
            true => portable::walk_sorted(&columns, moves, &mut scratch.sorted, target),
        }
    }
}

/// A stored integer: eight or sixteen bits.
trait Integer: Copy + Into<f64> {
    /// Four neighbouring lanes, from 0, 4, 8 or 12 on.
    #[cfg(target_arch = "x86_64")]
    unsafe fn four(lanes: &[Self; GROUP], first: usize) -> std::arch::x86_64::__m256d;
}

#[cfg(not(target_arch = "x86_64"))]
impl Integer for i8 {}
#[cfg(not(target_arch = "x86_64"))]
impl Integer for i16 {}
