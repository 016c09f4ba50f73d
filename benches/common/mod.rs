//! A transport with the sparsity of a real one: 512 x 512 receivers, haar:64, about 230 MB.

use _core::basis::ColumnSpace;
use _core::transport::{Channels, GROUP, Tile, TransportMatrix, Values};

/// The share of groups that a column of each band touches, coarse to fine, as measured on the plant.
const TOUCHED: [f64; 6] = [0.88, 0.70, 0.57, 0.25, 0.047, 0.002];

/// xorshift64*: enough for a benchmark.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    pub fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Groups come in runs, as the shadows of neighbouring receivers do.
pub fn matrix(rows: usize, tile_rows: usize) -> TransportMatrix {
    let space = ColumnSpace::haar(64).expect("a power of two");
    let bands = space.bands();
    let mut random = Random(7);
    let mut tiles = Vec::new();
    for first in (0..rows).step_by(tile_rows) {
        let tile_rows = tile_rows.min(rows - first);
        let (mut starts, mut words, mut values) = (vec![0u32], Vec::new(), Vec::new());
        for column in 0..bands.columns() {
            let touched = TOUCHED[bands.of(column)];
            // A chain with two states, in which runs of touched groups are eight long, or so.
            let leave = (1.0 / 8.0f64).min((1.0 - touched) / touched);
            let enter = leave * touched / (1.0 - touched);
            let mut inside = random.unit() < touched;
            for group in 0..tile_rows.div_ceil(GROUP) {
                if inside {
                    words.push(group as u16 | ((random.next() % 6) as u16) << 10);
                    for _ in 0..GROUP / 8 {
                        let bytes = random.next().to_le_bytes();
                        values.extend(bytes.map(|byte| (byte as i8).max(-127)));
                    }
                }
                inside = if inside { random.unit() >= leave } else { random.unit() < enter };
            }
            starts.push(words.len() as u32);
        }
        tiles.push(Tile {
            sight: None,
            rows: tile_rows,
            channels: Channels::One,
            quantum: -14,
            starts: starts.into(),
            words: words.into(),
            values: Values::I8(values.into()),
            kept: vec![0x4000; tile_rows * bands.count()].into(),
            dropped: vec![0x3c00; tile_rows * bands.count()].into(),
        });
    }
    TransportMatrix { space, bands, rows, channels: Channels::One, quantum: -14, tile_rows, tiles }
}

/// Columns of a frame: `counts[b]` of band b, anew each time.
pub fn columns(matrix: &TransportMatrix, counts: &[usize], random: &mut Random) -> Vec<u32> {
    let mut columns = Vec::new();
    for (band, &count) in counts.iter().enumerate() {
        let range = matrix.bands.range(band);
        let first = columns.len();
        while columns.len() < first + count {
            let column = (range.start + random.next() as usize % range.len()) as u32;
            if !columns[first..].contains(&column) {
                columns.push(column);
            }
        }
        columns[first..].sort_unstable();
    }
    columns
}
