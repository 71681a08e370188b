//! The set of vertices used by several cells.
//!
//! # Memory
//! 2 bytes per member if few vertices are members, as along the borders of cells; a bit per vertex if many are. 4 bytes
//! for 65,536 vertices for the ranks.

use std::ops::Range;
use std::sync::OnceLock;

use roaring::RoaringBitmap;
use serde::{Deserialize, Serialize};

use super::id::PartitionVertex;
use crate::base::id::numbers;
use crate::model::id::SharedVertex;

/// Vertices for each of the counts that ranks begin with, as a power of two: as many as in a part of the bitmap.
const BLOCK_BITS: u32 = 16;

/// A set of vertices that returns the rank of each member.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Shared {
    members: RoaringBitmap,
    /// Members below each block of vertices; counted at the first rank.
    #[serde(skip)]
    before: OnceLock<Vec<u32>>,
}

impl Shared {
    pub(super) fn insert(&mut self, vertex: PartitionVertex) {
        self.before.take();
        self.members.insert(vertex.number());
    }

    pub(super) fn insert_all(&mut self, vertices: Range<PartitionVertex>) {
        self.before.take();
        self.members.insert_range(vertices.start.number()..vertices.end.number());
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
    pub fn contains_each(&self, vertices: &[PartitionVertex]) -> impl Iterator<Item = bool> {
        let mut members = self.members.iter();
        let mut next = members.next();
        numbers(vertices).iter().map(move |&vertex| {
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
    pub fn iter(&self) -> impl Iterator<Item = PartitionVertex> {
        self.members.iter().map(PartitionVertex::new)
    }

    /// A member by its rank among them: in the next mesh, the members are its shared vertices.
    pub fn rank(&self, vertex: PartitionVertex) -> SharedVertex {
        let block = vertex.number() >> BLOCK_BITS;
        let before = self.before.get_or_init(|| self.count_blocks());
        let within = self.members.range_cardinality(block << BLOCK_BITS..vertex.number()) as u32;
        SharedVertex::new(before.get(block as usize).map_or(self.len(), |before| before + within))
    }

    /// Counts the members below each block, up to the block of the last member.
    fn count_blocks(&self) -> Vec<u32> {
        let mut sum = 0;
        let blocks = 0..self.members.max().map_or(0, |last| (last >> BLOCK_BITS) + 1);
        let below = blocks.map(|block| {
            let before = sum;
            let first = block << BLOCK_BITS;
            sum += self.members.range_cardinality(first..=first | ((1 << BLOCK_BITS) - 1)) as u32;
            before
        });
        below.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_count_the_members_below() {
        let mut shared = Shared::default();
        let members = [0, 3, 63, 64, 700, 4096, 4999, 1 << 17, u32::MAX - 1];
        let vertex = PartitionVertex::new;
        let rank = |shared: &Shared, number| shared.rank(vertex(number)).number();
        members.iter().for_each(|&number| shared.insert(vertex(number)));
        assert!(shared.contains_each(&members.map(vertex)).all(|is_shared| is_shared));
        let some = [1, 3, 62, 4998, 4999, u32::MAX].map(vertex);
        assert!(shared.contains_each(&some).eq([false, true, false, false, true, false]));
        for (place, &number) in (0..).zip(&members) {
            assert_eq!(rank(&shared, number), place);
        }
        assert_eq!((rank(&shared, 65), shared.len()), (4, 9));
        assert_eq!((rank(&shared, 1 << 18), rank(&shared, u32::MAX)), (8, 9));
        assert_eq!((rank(&Shared::default(), 7), rank(&Shared::default(), 1 << 20)), (0, 0));
        shared.insert_all(vertex(60)..vertex(70));
        assert_eq!((rank(&shared, 700), shared.len()), (12, 17));
        let all = [0, 3].into_iter().chain(60..70).chain([700, 4096, 4999, 1 << 17, u32::MAX - 1]);
        assert!(shared.iter().eq(all.map(vertex)));
    }
}
