//! The vertices that several cells use.
//!
//! # Memory
//! 2 bytes a member where few of the vertices are members, as along the borders of cells; a bit a vertex where many are.

use std::ops::Range;

use roaring::RoaringBitmap;
use serde::{Deserialize, Serialize};

/// A set of vertices, with the rank of each member.
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

    /// Whether no vertex is shared.
    pub fn is_empty(&self) -> bool {
        self.members.is_empty()
    }

    /// Whether a vertex is shared.
    #[inline]
    pub fn contains(&self, vertex: u32) -> bool {
        self.members.contains(vertex)
    }

    /// The members, ascending.
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
        for (rank, &v) in members.iter().enumerate() {
            assert!(shared.contains(v));
            assert_eq!(shared.rank(v), rank as u32);
        }
        assert_eq!((shared.rank(65), shared.len()), (4, 9));
        shared.insert_all(60..70);
        assert_eq!((shared.rank(700), shared.len()), (12, 17));
        assert!(shared.iter().eq([0, 3].into_iter().chain(60..70).chain([700, 4096, 4999, 1 << 17, u32::MAX - 1])));
    }
}
