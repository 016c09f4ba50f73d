//! The inner loop of B = M V: adds a few columns of a tile to its running sums, group after group.
//!
//! For a batch of moves (column times change), a first walk over the columns' words marks, for each group of 16 rows,
//! which moves touch it. A second walk goes through the groups in order: the 16 x 3 sums of a group stay in twelve
//! registers while all its moves are added, so that sums are read and written once, and each column is read as one
//! ascending stream. All sums are exact (`update/grid.rs`): order, batches, fused multiply-add or not, and the number
//! of threads leave the same bits.

use crate::transport::tile::{GROUP, GROUP_BITS, MAX_TILE_ROWS, Tile, Values};

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

/// Moves for each machine word of a group's marks.
const WORD: usize = u64::BITS as usize;

/// What a walk over a tile changes.
pub struct Target<'a> {
    pub sums: &'a mut [Sums],
    /// The sums start from zero, whatever they hold.
    pub afresh: bool,
    /// Rows x 3, rounded once: given where the walk is the frame's last.
    pub out: Option<&'a mut [f32]>,
}

/// Which moves of a batch touch each group of a tile, and how far each column has been read.
///
/// A walk takes up to `WORDS` x 64 moves: more where columns are nearly empty, so that a visit to a group is worth it.
/// INVARIANT: between walks all marks are zero.
pub struct Marks<const WORDS: usize> {
    groups: Vec<[u64; WORDS]>,
    cursors: [[u32; WORD]; WORDS],
    /// The changes, four times each: a broadcast in memory is cheaper than one in registers.
    changes: Box<[[Spread; WORD]; WORDS]>,
}

/// A change in red, green and blue, each in four lanes.
type Spread = [[f64; 4]; 3];

impl<const WORDS: usize> Default for Marks<WORDS> {
    fn default() -> Self {
        Marks {
            groups: vec![[0; WORDS]; MAX_TILE_ROWS / GROUP],
            cursors: [[0; WORD]; WORDS],
            changes: Box::new([[[[0.0; 4]; 3]; WORD]; WORDS]),
        }
    }
}

impl<const WORDS: usize> Marks<WORDS> {
    /// How many moves a walk takes.
    pub const BATCH: usize = WORDS * WORD;

    /// The walk over the words. Group numbers ascend inside a column, so that a cursor serves the second walk.
    #[inline(always)]
    fn set(&mut self, starts: &[u32], words: &[u16], moves: &[Move], fetch: impl Fn(usize)) {
        for (k, moved) in moves.iter().enumerate() {
            let column = moved.column as usize;
            let (start, end) = (starts[column], starts[column + 1]);
            if let Some(next) = moves.get(k + 2) {
                fetch(starts[next.column as usize] as usize);
            }
            let (word, bit) = (k / WORD, k % WORD);
            self.cursors[word][bit] = start;
            self.changes[word][bit] = moved.change.map(|x| [x; 4]);
            for entry in &words[start as usize..end as usize] {
                self.groups[(entry & GROUP_MASK) as usize][word] |= 1 << bit;
            }
        }
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

/// Which code runs; both leave the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Engine {
    Portable,
    Avx2,
}

impl Engine {
    /// The fastest that this processor has.
    pub fn detect() -> Engine {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") && is_x86_feature_detected!("bmi1") {
            return Engine::Avx2;
        }
        Engine::Portable
    }

    /// Adds moves, at most a batch, to a tile's sums.
    pub fn walk<const WORDS: usize>(self, tile: &Tile, moves: &[Move], marks: &mut Marks<WORDS>, target: Target<'_>) {
        debug_assert!(moves.len() <= Marks::<WORDS>::BATCH && target.sums.len() == tile.groups());
        match &tile.values {
            Values::I8(values) => {
                self.walk_columns::<i8, WORDS>(tile, bytemuck::cast_slice(values), moves, marks, target)
            }
            Values::I16(values) => {
                self.walk_columns::<i16, WORDS>(tile, bytemuck::cast_slice(values), moves, marks, target)
            }
        }
    }

    fn walk_columns<T: Integer, const WORDS: usize>(
        self,
        tile: &Tile,
        lanes: &[[T; GROUP]],
        moves: &[Move],
        marks: &mut Marks<WORDS>,
        target: Target<'_>,
    ) {
        let columns = Columns { starts: &tile.starts, words: &tile.words, lanes };
        match self {
            Engine::Portable => portable::walk(&columns, moves, marks, target),
            // SAFETY: `detect` found the features; nothing else makes this variant where they may be missing.
            #[cfg(target_arch = "x86_64")]
            Engine::Avx2 => unsafe { avx2::walk(&columns, moves, marks, target) },
            #[cfg(not(target_arch = "x86_64"))]
            Engine::Avx2 => portable::walk(&columns, moves, marks, target),
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
