//! What a walk over a tile needs: moves in batches, the entries that they touch, and the sums that they change.

use std::ops::Range;

use crate::transport::entry::{GROUP, MAX_TILE_ROWS, group_of};
use crate::transport::tile::Tile;

/// The sums of a group of rows: `[colour][lane]`, six cache lines.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub struct Sums(pub [[f64; GROUP]; 3]);

impl Sums {
    /// No response at all: where sums start.
    pub const ZERO: Sums = Sums([[0.0; GROUP]; 3]);
}

/// A column of M to be added, times `change`, which includes the matrix's 2^quantum.
#[derive(Clone, Copy, Debug)]
pub struct Move {
    /// Its number, j.
    pub column: u32,
    /// What V~_j moves by, times 2^quantum, in red, green and blue.
    pub change: [f64; 3],
}

/// What a walk over a tile changes.
pub struct Target<'a> {
    /// One for each group of the tile.
    pub sums: &'a mut [Sums],
    /// The sums start from zero, whatever they hold.
    pub afresh: bool,
    /// Rows x 3, rounded once: given where the walk is the frame's last.
    pub out: Option<&'a mut [f32]>,
}

/// Moves that `Marks` takes at once: a bit each.
pub(super) const MARKED: usize = u64::BITS as usize;
/// So many entries for each group make a visit to the group worth it.
const ENOUGH: usize = 8;
/// Sorting goes on to so many, which with their integers still fit a core's cache.
const PLENTY: usize = 16;

/// Moves that are added in one walk over the groups of a tile.
pub struct Batch {
    /// Of the list of moves, those in this batch.
    pub moves: Range<usize>,
    pub(super) read: Read,
}

/// How a batch finds what its moves add to a group.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Read {
    /// By a bit for each column and group (`Marks`).
    Marked,
    /// By a list of entries in the order of groups (`Sorted`).
    Sorted,
    /// By the bits of texel columns.
    Texels,
}

/// Splits moves, by ascending column, into batches for one tile; there is always one, as the last one writes the rows.
pub fn batches(tile: &Tile, moves: &[Move]) -> Vec<Batch> {
    let entries = |moved: &Move| tile.entries(moved.column as usize).len();
    let stored = moves.partition_point(|moved| (moved.column as usize) < tile.columns());
    let mut batches = Vec::with_capacity(moves.len() / MARKED + 1);
    let mut start = 0;
    while start < stored {
        let mut end = stored.min(start + MARKED);
        let mut held: usize = moves[start..end].iter().map(entries).sum();
        let sorted = held < ENOUGH * tile.groups() && end < stored;
        while sorted && end < stored && held < PLENTY * tile.groups() {
            held += entries(&moves[end]);
            end += 1;
        }
        batches.push(Batch { moves: start..end, read: if sorted { Read::Sorted } else { Read::Marked } });
        start = end;
    }
    if stored < moves.len() {
        batches.push(Batch { moves: stored..moves.len(), read: Read::Texels });
    } else if batches.is_empty() {
        batches.push(Batch { moves: 0..0, read: Read::Marked });
    }
    batches
}

/// What walks over tiles need besides, kept between them.
#[derive(Default)]
pub struct Scratch {
    /// For batches whose columns are well filled.
    pub(super) marks: Marks,
    /// For batches whose columns are nearly empty.
    pub(super) sorted: Sorted,
}

/// Which moves of a batch touch each group of a tile, and how far each column has been read.
///
/// INVARIANT: between walks all marks are zero.
pub(super) struct Marks {
    /// One bit a move, for each group of the largest tile.
    pub groups: Vec<u64>,
    /// For each move the next entry to be read.
    pub cursors: [u32; MARKED],
    /// For each move what it is multiplied by.
    pub changes: [Spread; MARKED],
}

/// A change in red, green and blue, each four times: loaded, not broadcast in registers.
pub(super) type Spread = [[f64; 4]; 3];

impl Default for Marks {
    fn default() -> Self {
        let groups = vec![0; MAX_TILE_ROWS / GROUP];
        Marks { groups, cursors: [0; MARKED], changes: [[[0.0; 4]; 3]; MARKED] }
    }
}

impl Marks {
    /// Group numbers ascend inside a column, so that a cursor serves the second walk.
    #[inline(always)]
    pub fn set<T, const C: usize>(&mut self, columns: &Columns<'_, T, C>, moves: &[Move], fetch: impl Fn(usize)) {
        for (bit, moved) in moves.iter().enumerate() {
            let entries = columns.range(moved);
            self.cursors[bit] = entries.start as u32;
            self.changes[bit] = moved.change.map(|x| [x; 4]);
            if let Some(next) = moves.get(bit + 2) {
                fetch(columns.range(next).start);
            }
            for word in &columns.words[entries] {
                self.groups[group_of(*word)] |= 1 << bit;
            }
        }
    }
}

/// The entries of a batch in the order of their groups.
#[derive(Default)]
pub(super) struct Sorted {
    /// The items of group g are `items[ends[g - 1]..ends[g]]`.
    ends: Vec<u32>,
    /// In the order of the groups; the memory is kept between batches.
    pub items: Vec<Item>,
}

/// An entry and the move it belongs to.
#[derive(Clone, Copy, Default)]
pub(super) struct Item {
    /// Its place in the tile.
    pub entry: u32,
    /// The move's place in the batch.
    pub moved: u32,
}

impl Sorted {
    /// A counting sort.
    #[inline(always)]
    pub fn set<T, const C: usize>(&mut self, columns: &Columns<'_, T, C>, moves: &[Move]) {
        // Counts are kept one place further on, so that placing the items turns starts into ends.
        self.ends.clear();
        self.ends.resize(MAX_TILE_ROWS / GROUP + 1, 0);
        let mut held = 0;
        for moved in moves {
            let entries = columns.range(moved);
            held += entries.len();
            for word in &columns.words[entries] {
                self.ends[group_of(*word) + 1] += 1;
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
            for entry in columns.range(moved) {
                let place = &mut self.ends[group_of(columns.words[entry])];
                self.items[*place as usize] = Item { entry: entry as u32, moved: k as u32 };
                *place += 1;
            }
        }
    }

    /// The items of a group; groups are asked for in order, and `from` is where the last one ended.
    pub fn group(&self, group: usize, from: &mut usize) -> Range<usize> {
        let items = *from..self.ends[group] as usize;
        *from = items.end;
        items
    }
}

/// 2^shift.
pub(super) static POWERS: [f64; 64] = {
    let mut powers = [1.0; 64];
    let mut shift = 1;
    while shift < 64 {
        powers[shift] = 2.0 * powers[shift - 1];
        shift += 1;
    }
    powers
};

/// A tile's arrays, of one width of integers and one number of channels.
pub(super) struct Columns<'a, T, const C: usize> {
    /// Entries of column j are `starts[j]..starts[j + 1]`.
    pub starts: &'a [u32],
    /// Group number and shift of each entry.
    pub words: &'a [u16],
    /// The integers of each entry, channel by channel.
    pub entries: &'a [[[T; GROUP]; C]],
}

impl<T, const C: usize> Columns<'_, T, C> {
    /// The entries of the column that moves.
    pub fn range(&self, moved: &Move) -> Range<usize> {
        let column = moved.column as usize;
        self.starts[column] as usize..self.starts[column + 1] as usize
    }
}

/// A stored integer: eight or sixteen bits.
pub(super) trait Integer: Copy + Into<f64> {
    /// Four neighbouring lanes, from 0, 4, 8 or 12 on.
    #[cfg(target_arch = "x86_64")]
    unsafe fn four(lanes: &[Self; GROUP], first: usize) -> std::arch::x86_64::__m256d;
}

#[cfg(not(target_arch = "x86_64"))]
impl Integer for i8 {}
#[cfg(not(target_arch = "x86_64"))]
impl Integer for i16 {}
