//! What choosing tells multiplying, and the copy of V that both go by.

use std::ops::Range;

use crate::basis::Bands;

/// One column's change in red, green and blue: Delta V_j.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Term {
    /// Its number, j.
    pub column: u32,
    /// What V~_j moves by, in red, green and blue.
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
    /// The same as it is multiplied: what every column moves by, resets included, ascending. Whoever multiplies needs no
    /// copy of V for it.
    pub moves: Vec<Term>,
    /// All that was applied is reset: sums start from zero, and nothing has to be taken out of them.
    pub afresh: bool,
}

/// What a frame does: which bands start anew, and which candidates are sent.
pub(in crate::update) struct Choice {
    /// One a band: whether it is set to zero first.
    pub anew: Vec<bool>,
    /// Numbers of candidates, each once.
    pub sent: Vec<u32>,
}

/// V~: the copy of V that has been applied so far.
#[derive(Clone)]
pub struct Applied {
    /// INVARIANT: finite, and where a column was sent equal to that frame's V bit for bit.
    values: Vec<[f64; 3]>,
    /// Whether a band may hold anything. INVARIANT: true wherever one does.
    held: Vec<bool>,
}

impl Applied {
    /// Nothing yet.
    pub fn new(bands: &Bands) -> Self {
        Applied { values: vec![[0.0; 3]; bands.columns()], held: vec![false; bands.count()] }
    }

    /// V~, a colour for each column.
    pub fn values(&self) -> &[[f64; 3]] {
        &self.values
    }

    /// Takes `values` for what has been applied.
    pub fn set(&mut self, bands: &Bands, values: &[[f64; 3]]) {
        self.values.copy_from_slice(values);
        self.held = (0..bands.count()).map(|band| self.holds(bands, band)).collect();
    }

    fn holds(&self, bands: &Bands, band: usize) -> bool {
        self.values[bands.range(band)].iter().any(|value| *value != [0.0; 3])
    }

    /// Lines 6 to 19 of Fig. 6.1 without the images: sets the bands that start `anew` to zero, then the colours of the
    /// columns in `sent` (ascending) to `target`, and tells what that changes. A band that holds nothing needs no reset.
    pub fn send(
        &mut self,
        bands: &Bands,
        anew: &[bool],
        sent: impl Iterator<Item = (usize, Range<usize>)>,
        target: &[[f64; 3]],
    ) -> Update {
        for (band, &anew) in anew.iter().enumerate() {
            self.held[band] = self.held[band] && (!anew || self.holds(bands, band));
        }
        let resets: Vec<usize> = (0..bands.count()).filter(|&band| anew[band] && self.held[band]).collect();
        let afresh = (0..bands.count()).all(|band| anew[band] || !self.held[band]);
        // What a reset takes out, unless all sums start from zero.
        let taken: Vec<Vec<[f64; 3]>> = match afresh {
            true => resets.iter().map(|_| Vec::new()).collect(),
            false => resets.iter().map(|&band| self.values[bands.range(band)].to_vec()).collect(),
        };
        for &band in &resets {
            self.values[bands.range(band)].fill([0.0; 3]);
            self.held[band] = false;
        }

        let terms = self.set_columns(sent, target);
        let moves = self.moves(bands, &resets, &taken, &terms);
        // An update of nothing is no new start.
        let afresh = afresh && !(resets.is_empty() && terms.is_empty());
        Update { resets, terms, moves, afresh }
    }

    fn set_columns(&mut self, sent: impl Iterator<Item = (usize, Range<usize>)>, target: &[[f64; 3]]) -> Vec<Term> {
        let mut terms: Vec<Term> = Vec::with_capacity(sent.size_hint().0);
        for (column, colours) in sent {
            if terms.last().is_none_or(|term| term.column as usize != column) {
                terms.push(Term { column: column as u32, change: [0.0; 3] });
            }
            let term = terms.last_mut().expect("one was just pushed");
            for colour in colours {
                term.change[colour] = target[column][colour] - self.values[column][colour];
                self.values[column][colour] = target[column][colour];
            }
        }
        terms
    }

    /// Band by band: the terms, or all that a reset band held and holds now.
    fn moves(&mut self, bands: &Bands, resets: &[usize], taken: &[Vec<[f64; 3]>], mut terms: &[Term]) -> Vec<Term> {
        let mut moves = Vec::with_capacity(terms.len());
        for band in 0..bands.count() {
            let columns = bands.range(band);
            let (mine, rest) = terms.split_at(terms.partition_point(|term| (term.column as usize) < columns.end));
            terms = rest;
            self.held[band] |= !mine.is_empty();
            match resets.binary_search(&band) {
                Ok(at) if !taken[at].is_empty() => {
                    let both = self.values[columns.clone()].iter().zip(&taken[at]);
                    moves.extend(columns.zip(both).filter(|(_, (new, old))| new != old).map(|(column, (new, old))| {
                        Term { column: column as u32, change: std::array::from_fn(|k| new[k] - old[k]) }
                    }));
                }
                _ => moves.extend_from_slice(mine),
            }
        }
        moves
    }
}

/// The update that takes `before` to `after`.
pub fn between(before: &[[f64; 3]], after: &[[f64; 3]]) -> Update {
    let moved = before.iter().zip(after).enumerate().filter(|(_, (old, new))| old != new);
    let change = |old: &[f64; 3], new: &[f64; 3]| std::array::from_fn(|c| new[c] - old[c]);
    let moves = moved.map(|(column, (old, new))| Term { column: column as u32, change: change(old, new) });
    Update { moves: moves.collect(), ..Update::default() }
}

/// The update that takes black to `values`.
pub fn whole(values: &[[f64; 3]]) -> Update {
    let lit = values.iter().enumerate().filter(|(_, value)| **value != [0.0; 3]);
    let terms: Vec<Term> = lit.map(|(column, &change)| Term { column: column as u32, change }).collect();
    Update { resets: Vec::new(), moves: terms.clone(), terms, afresh: true }
}
