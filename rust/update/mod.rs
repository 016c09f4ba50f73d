//! B = M V, frame after frame, for any V: choosing (approximation) is apart from multiplying (response).

pub mod change;

pub use change::{Term, Update};
