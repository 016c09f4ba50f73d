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
//! Several lights go through a tile together, all of its entries sorted by group (`together.rs`).
//! Tried and dropped: walks of 256 moves at once (their streams evict each other); images of bands
//! (`multiplying/response.rs`); four lights that share each entry of a batch of 64 columns, four rows at a time (7 to 14 %
//! of a batch's time: half of its entries lie in columns too empty for it).
//!
//! Texel columns have no entries: their walk makes them anew from bits and normals (`texels.rs`).
//!
//! All sums are exact (`multiplying/grid.rs`): order, batches, fused multiply-add or not, and the number of threads
//! leave the same bits.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod columns;
mod engine;
mod portable;
mod texels;
mod together;
pub(in crate::update::multiplying) mod transposed;

pub use columns::{Batch, Move, Scratch, Sums, Target, batches};
pub use engine::Engine;
pub use together::Lights;
