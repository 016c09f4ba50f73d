//! Arrays that are owned, or views of a mapped file.

use std::ops::{Deref, Range};
use std::sync::Arc;

/// A slice that is either owned or a view of a mapped file, which it keeps alive.
#[derive(Clone)]
pub enum Slab<T: 'static> {
    /// Items in memory, shared by all copies.
    Owned(Arc<[T]>),
    /// INVARIANT: `len` items from byte `start` on lie inside the map and are aligned for T.
    Mapped {
        /// The file, which stays mapped, or a copy of it.
        map: Arc<memmap2::Mmap>,
        /// The first byte, counted from the start of the map.
        start: usize,
        /// Items, not bytes.
        len: usize,
    },
}

impl<T: bytemuck::Pod> Deref for Slab<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        match self {
            Slab::Owned(items) => items,
            Slab::Mapped { map, start, len } => {
                bytemuck::cast_slice(&map[*start..*start + *len * std::mem::size_of::<T>()])
            }
        }
    }
}

impl<T: bytemuck::Pod> Slab<T> {
    /// Some of the items; of a mapped file a view, else a copy.
    pub fn part(&self, range: Range<usize>) -> Slab<T> {
        match self {
            Slab::Owned(items) => Slab::Owned(items[range].into()),
            Slab::Mapped { map, start, len } => {
                assert!(range.start <= range.end && range.end <= *len);
                Slab::Mapped { map: map.clone(), start: start + range.start * size_of::<T>(), len: range.len() }
            }
        }
    }
}

impl<T> From<Vec<T>> for Slab<T> {
    fn from(items: Vec<T>) -> Self {
        Slab::Owned(items.into())
    }
}
