//! The transport directory: `FORMAT.md` is its specification, and comes first.

pub mod beside;
mod link;
pub mod manifest;
pub mod open;
mod receivers;
pub mod rewrite;
pub mod shard;
pub mod versions;
pub mod writer;

pub use beside::{Array, Beside, Numbers};
pub use open::{Audit, Opened, open};
pub use rewrite::{rewrite, survey};
pub use writer::{Description, Part, Writer};
