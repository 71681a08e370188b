//! Finds the index of an id in an ascending list, in constant time if ids are evenly spread.
//!
//! ```text
//! ids     100 103 104 | 117 | 131 ...      a slot per 2^shift ids of the range, about as many slots as ids
//! starts  0             3     4
//! ```
//!
//! # Memory
//! 4 bytes per id.

/// Largest slot that is searched linearly; larger ones are searched by bisection.
const FEW: usize = 8;

/// Indices of ids in an ascending list.
#[derive(Debug)]
pub struct SortedIds<'a> {
    ids: &'a [u32],
    /// Low bits of an id that do not select its slot.
    shift: u32,
    /// Index in the list of the first id of each slot, then the length of the list.
    starts: Vec<u32>,
}

impl<'a> SortedIds<'a> {
    /// Indexes an ascending list.
    pub fn new(ids: &'a [u32]) -> Self {
        let span = ids.last().zip(ids.first()).map_or(0, |(last, first)| last - first);
        let shift = (0..u32::BITS - 1).find(|&shift| (span >> shift) as usize <= ids.len()).unwrap_or(u32::BITS - 1);
        let first = ids.first().copied().unwrap_or(0);
        let mut starts = vec![0; (span >> shift) as usize + 2];
        ids.iter().for_each(|id| starts[((id - first) >> shift) as usize + 1] += 1);
        for slot in 1..starts.len() {
            starts[slot] += starts[slot - 1];
        }
        Self { ids, shift, starts }
    }

    /// Index of an id in the list. For an id that is not in the list, some index up to its length.
    #[inline]
    pub fn of(&self, id: u32) -> u32 {
        let slot = (id.wrapping_sub(self.ids.first().copied().unwrap_or(0)) >> self.shift) as usize;
        let (Some(&start), Some(&end)) = (self.starts.get(slot), self.starts.get(slot + 1)) else {
            return self.ids.len() as u32;
        };
        let ids = &self.ids[start as usize..end as usize];
        let below = match ids.len() {
            0..=FEW => ids.iter().map(|&other| usize::from(other < id)).sum(),
            _ => ids.partition_point(|&other| other < id),
        };
        start + below as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_id_is_found_where_it_stands() {
        let spread: Vec<u32> = (0..1000).map(|i| i * 4_000_000 + (i * i) % 7).collect();
        for ids in [vec![], vec![7], vec![5, 6, 7, 900, u32::MAX], vec![0, u32::MAX], spread] {
            let ranks = SortedIds::new(&ids);
            assert!(ranks.starts.len() <= ids.len() + 3);
            for (place, &id) in ids.iter().enumerate() {
                assert_eq!(ranks.of(id), place as u32, "{id} in {ids:?}");
            }
            assert!(ranks.of(12_345) <= ids.len() as u32);
        }
    }
}
