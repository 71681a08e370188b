//! Finds the rank of an id in an ascending list, in constant time if ids are evenly spread.
//!
//! ```text
//! ids     100 103 104 | 117 | 131 ...      a slot per 2^shift ids of the range, about as many slots as ids
//! starts  0             3     4
//! ```
//!
//! # Memory
//! 4 bytes per id.

use crate::base::id::{Id, TiSlice};

/// Largest slot that is searched linearly; larger ones are searched by bisection.
const FEW: u32 = 8;

/// Ranks of ids in an ascending list.
pub struct SortedIds<'a, R, I> {
    ids: &'a TiSlice<R, I>,
    /// Number of the first id.
    first: u32,
    /// Low bits of an id that do not select its slot.
    shift: u32,
    /// Rank of the first id of each slot, then the length of the list.
    starts: Vec<u32>,
    /// Whether no slot has more than [`FEW`] ids.
    are_few: bool,
}

impl<'a, R: Id, I: Id> SortedIds<'a, R, I> {
    /// Indexes an ascending list.
    pub fn new(ids: &'a TiSlice<R, I>) -> Self {
        let first = ids.first().map_or(0, |id| id.number());
        let span = ids.last().map_or(0, |id| id.number() - first);
        let shift = (0..u32::BITS - 1).find(|&shift| (span >> shift) as usize <= ids.len()).unwrap_or(u32::BITS - 1);
        let mut starts = vec![0; (span >> shift) as usize + 2];
        ids.iter().for_each(|id| starts[((id.number() - first) >> shift) as usize + 1] += 1);
        for slot in 1..starts.len() {
            starts[slot] += starts[slot - 1];
        }
        let are_few = starts.windows(2).all(|ends| ends[1] - ends[0] <= FEW);
        Self { ids, first, shift, starts, are_few }
    }

    /// Rank of an id in the list. For an id that is not in the list, some rank up to its length.
    #[inline]
    pub fn of(&self, id: I) -> R {
        let slot = (id.number().wrapping_sub(self.first) >> self.shift) as usize;
        let Some(&start) = self.starts.get(slot) else { return R::from(self.ids.len()) };
        let mut rank = start as usize;
        if !self.are_few {
            let end = self.starts.get(slot + 1).map_or(self.ids.len(), |&end| end as usize);
            rank += self.ids.raw[rank..end].partition_point(|&other| other < id);
        }
        while self.ids.raw.get(rank).is_some_and(|&other| other < id) {
            rank += 1;
        }
        R::from(rank)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::id::Texcoord;
    use crate::partition::id::ClusterTexcoord;

    #[test]
    fn every_id_is_found_where_it_stands() {
        let spread: Vec<u32> = (0..1000).map(|i| i * 4_000_000 + (i * i) % 7).collect();
        for ids in [vec![], vec![7], vec![5, 6, 7, 900, u32::MAX], vec![0, u32::MAX], spread] {
            let ids: Vec<Texcoord> = ids.into_iter().map(Texcoord::new).collect();
            let ranks = SortedIds::<ClusterTexcoord, Texcoord>::new(TiSlice::from_ref(&ids));
            assert!(ranks.starts.len() <= ids.len() + 3);
            for (place, &id) in ids.iter().enumerate() {
                assert_eq!(ranks.of(id).index(), place, "{id:?} in {ids:?}");
            }
            assert!(ranks.of(Texcoord::new(12_345)).index() <= ids.len());
        }
    }
}
