//! What an entry of M is made of: a word, 16 integers, and the numbers that hold for all of them.

use std::str::FromStr;

use crate::error::{Error, Result};

/// Rows in a group: the unit of truncation and of the kernels.
pub const GROUP: usize = 16;
/// The most rows of a tile (10 bits of group number).
pub const MAX_TILE_ROWS: usize = 1024 * GROUP;
/// Bits of an entry's word that hold the group number; the rest is the shift.
pub const GROUP_BITS: u32 = 10;

/// One column of a group: its coefficient in each of the 16 rows.
pub type Rows16 = [f32; GROUP];

/// The most bits from a row's unit to its norm with which sums with light stay exact (`update/multiplying/grid.rs`).
pub const MAX_SPAN: i32 = 27;
/// Stored values stay below 2^20, so that sums of them cannot overflow anything.
pub const MAX_EXPONENT: i32 = 20;
/// The least quantum, so that every intermediate value is an ordinary f32.
pub const MIN_QUANTUM: i32 = -64;

/// How many numbers an entry holds for each row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channels {
    /// One, which serves red, green and blue alike.
    One,
    /// Red, green and blue, each with its own.
    Three,
}

impl Channels {
    /// Numbers for each row and column.
    pub const fn count(self) -> usize {
        match self {
            Channels::One => 1,
            Channels::Three => 3,
        }
    }

    /// Which of them a colour uses.
    pub const fn of(self, colour: usize) -> usize {
        match self {
            Channels::One => 0,
            Channels::Three => colour,
        }
    }

    /// The channels that are so many.
    pub fn from_count(count: usize) -> Result<Self> {
        match count {
            1 => Ok(Channels::One),
            3 => Ok(Channels::Three),
            _ => Err(Error::input(format!("expected 1 or 3 channels, found {count}"))),
        }
    }
}

/// How wide the stored integers are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    /// Magnitudes up to 127.
    I8,
    /// Magnitudes up to 32,767.
    I16,
}

impl Width {
    /// The largest magnitude used; the most negative integer stays free so that -q is always there.
    pub fn max(self) -> i16 {
        match self {
            Width::I8 => i8::MAX as i16,
            Width::I16 => i16::MAX,
        }
    }

    /// The word for it, in files and in Python.
    pub fn name(self) -> &'static str {
        match self {
            Width::I8 => "i8",
            Width::I16 => "i16",
        }
    }
}

impl FromStr for Width {
    type Err = Error;

    /// Refuses all words but "i8" and "i16".
    fn from_str(word: &str) -> Result<Self> {
        match word {
            "i8" => Ok(Width::I8),
            "i16" => Ok(Width::I16),
            other => Err(Error::input(format!("expected the width \"i8\" or \"i16\", found {other:?}"))),
        }
    }
}

/// Bytes of an entry: its word, and the integers of 16 rows.
pub fn entry_bytes(width: Width, channels: Channels) -> usize {
    2 + GROUP * channels.count() * if width == Width::I8 { 1 } else { 2 }
}

/// Bits of the magnitude of a stored integer.
pub fn integer_bits(width: Width) -> i32 {
    match width {
        Width::I8 => 7,
        Width::I16 => 15,
    }
}

/// The largest exponent that quantum + shift may have at a width.
pub fn max_step(width: Width) -> i32 {
    MAX_EXPONENT - integer_bits(width)
}

/// Refuses quanta with which no value could be stored, or not exactly.
pub fn check_quantum(quantum: i32, width: Width) -> Result<()> {
    if (MIN_QUANTUM..=max_step(width)).contains(&quantum) {
        return Ok(());
    }
    let most = max_step(width);
    Err(Error::input(format!("expected a quantum (exponent of two) from {MIN_QUANTUM} to {most}, got {quantum}")))
}

/// The group's number in an entry's word.
pub fn group_of(word: u16) -> usize {
    usize::from(word & ((1 << GROUP_BITS) - 1))
}

/// The binary shift in an entry's word.
pub fn shift_of(word: u16) -> i32 {
    i32::from(word >> GROUP_BITS)
}

/// 2^exponent, for the exponents of normal f32 numbers: -126 to 127.
#[inline(always)]
pub fn power_of_two(exponent: i32) -> f32 {
    debug_assert!((-126..=127).contains(&exponent));
    f32::from_bits(((exponent + 127) as u32) << 23)
}

/// The nearest integer, ties to even, of a number below 2^51: adding 1.5 * 2^52 leaves no bits below one. Where processors
/// have no rounding instruction (baseline x86-64) this is ten times as fast as `round_ties_even`, which is then a call.
#[inline(always)]
pub fn nearest_integer(x: f64) -> f64 {
    const SHIFT: f64 = 1.5 * (1u64 << 52) as f64;
    (x + SHIFT) - SHIFT
}

/// The least bfloat16 that is not below a norm.
pub fn bf16_up(norm: f64) -> u16 {
    debug_assert!(norm >= 0.0);
    let mut single = norm as f32;
    if f64::from(single) < norm {
        single = single.next_up();
    }
    // The integer order of bit patterns is the order of positive floats: adding one steps to the next bfloat16.
    (single.to_bits().wrapping_add(0xffff) >> 16) as u16
}

/// What a stored norm says.
pub fn bf16(bits: u16) -> f32 {
    f32::from_bits(u32::from(bits) << 16)
}
