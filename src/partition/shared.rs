//! The set of vertices used by several cells.
//!
//! # Memory
//! 2 bytes per member if few vertices are members, as along the borders of cells; a bit per vertex if many are.

use std::ops::Range;

use roaring::RoaringBitmap;
use serde::{Deserialize, Serialize};

/// A set of vertices that returns the rank of each member.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Shared {
    members: RoaringBitmap,
}

impl Shared {
    pub(super) fn insert(&mut self, vertex: u32) {
        self.members.insert(vertex);
    }

    pub(super) fn insert_all(&mut self, vertices: Range<u32>) {
        self.members.insert_range(vertices);
    }

    /// Number of members.
    pub fn len(&self) -> u32 {
        self.members.len() as u32
    }

    /// Reports whether no vertex is shared.
    pub fn is_empty(&self) -> bool {
        self.members.is_empty()
    }

    /// Reports for each of some ascending vertices whether it is shared.
    pub fn contains_each(&self, vertices: &[u32]) -> impl Iterator<Item = bool> {
        let mut members = self.members.iter();
        let mut next = members.next();
        vertices.iter().map(move |&vertex| {
            if next.is_some_and(|member| member < vertex) {
                members.advance_to(vertex);
                next = members.next();
            }
            next == Some(vertex)
        })
    }

    /// Reports whether all members are below `count`.
    pub fn is_within(&self, count: u32) -> bool {
        self.members.max().is_none_or(|last| last < count)
    }

    /// Members, ascending.
    pub fn iter(&self) -> impl Iterator<Item = u32> {
        self.members.iter()
    }

    /// Number of members below a vertex.
    pub fn rank(&self, vertex: u32) -> u32 {
        vertex.checked_sub(1).map_or(0, |below| self.members.rank(below)) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_count_the_members_below() {
        let mut shared = Shared::default();
        let members = [0, 3, 63, 64, 700, 4096, 4999, 1 << 17, u32::MAX - 1];
        members.iter().for_each(|&v| shared.insert(v));
        assert!(shared.contains_each(&members).all(|is_shared| is_shared));
        assert!(shared.contains_each(&[1, 3, 62, 4998, 4999, u32::MAX]).eq([false, true, false, false, true, false]));
        for (rank, &v) in members.iter().enumerate() {
            assert_eq!(shared.rank(v), rank as u32);
        }
        assert_eq!((shared.rank(65), shared.len()), (4, 9));
        shared.insert_all(60..70);
        assert_eq!((shared.rank(700), shared.len()), (12, 17));
        assert!(shared.iter().eq([0, 3].into_iter().chain(60..70).chain([700, 4096, 4999, 1 << 17, u32::MAX - 1])));
    }
}
