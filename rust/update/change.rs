//! What choosing tells multiplying: which bands start anew, and a short list of (column, change).

/// One column's change in red, green and blue: Delta V_j.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Term {
    pub column: u32,
    pub change: [f64; 3],
}

/// One frame's update. Bands in `resets` are set to zero first; then every term is added, so that the change of a
/// column in a reset band is its whole new value (Overbeck 2006, Fig. 6.1).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Update {
    /// Ascending.
    pub resets: Vec<usize>,
    /// Ascending by column, each column once.
    pub terms: Vec<Term>,
}

/// What a frame does: which bands start anew, and which candidates are sent.
pub(in crate::update) struct Choice {
    pub anew: Vec<bool>,
    pub sent: Vec<u32>,
}
