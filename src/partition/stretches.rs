//! Measures how scattered over the file the texture coordinates of each cell are.
//!
//! The texture coordinates are divided into stretches. The measure is the number of stretches that the faces of a cell
//! refer to, summed over the cells: the number of stretches read if each cell reads its own.
//!
//! # Memory
//! A pair of numbers per stretch of each cell, up to [`READINGS_MAX`] times the stretches of the file; beyond that the
//! answer is known.

use std::collections::HashSet;

use foldhash::fast::RandomState;

use crate::model::NO_TEXCOORD;

/// Texture coordinates per stretch: 64 KiB, so that reading one costs about as much as a random access.
const STRETCH_LEN: u32 = 4096;
/// Largest number of times that the whole column may be read, stretch by stretch, before sorting it by cell is cheaper.
const READINGS_MAX: u64 = 4;
/// Slots of the cache of recent stretches, indexed by the low bits of cell and stretch.
const RECENT_COUNT: usize = 64;

/// A cell, and a stretch that one of its faces refers to.
pub type CellStretch = (u32, u32);

/// Stretches that some faces refer to; may contain repetitions.
#[derive(Debug)]
pub struct SeenStretches {
    recent: [CellStretch; RECENT_COUNT],
    /// In order of the faces.
    pub seen: Vec<CellStretch>,
}

impl SeenStretches {
    /// None so far.
    pub fn new() -> Self {
        Self { recent: [(u32::MAX, 0); RECENT_COUNT], seen: Vec::new() }
    }

    /// Records the texture coordinate of a corner, unless it is [`NO_TEXCOORD`].
    #[inline]
    pub fn see(&mut self, cell: u32, texcoord: u32) {
        if texcoord == NO_TEXCOORD {
            return;
        }
        let stretch = (cell, texcoord / STRETCH_LEN);
        let slot = &mut self.recent[(stretch.0 ^ stretch.1) as usize % RECENT_COUNT];
        if *slot != stretch {
            *slot = stretch;
            self.seen.push(stretch);
        }
    }
}

/// Distinct stretches that the faces of each cell refer to, up to the number that decides.
#[derive(Debug, Default)]
pub struct NamedStretches {
    // NOTE: only its length is used, so the seed does not affect the result.
    named: HashSet<CellStretch, RandomState>,
    enough: u64,
}

impl NamedStretches {
    /// Creates an empty set for a mesh of `texcoord_count` texture coordinates.
    pub fn new(texcoord_count: u64) -> Self {
        Self { named: HashSet::default(), enough: READINGS_MAX * texcoord_count / u64::from(STRETCH_LEN) }
    }

    /// Adds recorded stretches.
    pub fn add(&mut self, seen: Vec<CellStretch>) {
        for stretch in seen {
            if self.are_scattered() {
                return;
            }
            self.named.insert(stretch);
        }
    }

    /// Reports whether the texture coordinates of cells are scattered over the file.
    pub fn are_scattered(&self) -> bool {
        self.named.len() as u64 > self.enough
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(texcoord_count: u32, corners: impl Iterator<Item = (u32, u32)>) -> NamedStretches {
        let mut seen = SeenStretches::new();
        corners.for_each(|(cell, texcoord)| seen.see(cell, texcoord));
        let mut named = NamedStretches::new(u64::from(texcoord_count));
        named.add(seen.seen);
        named
    }

    #[test]
    fn cells_that_name_their_own_part_of_the_file_are_not_scattered() {
        let count = 100 * STRETCH_LEN;
        let own = named(count, (0..count).map(|t| (t / (2 * STRETCH_LEN), t)));
        assert_eq!(own.named.len(), 100);
        assert!(!own.are_scattered());
        assert!(!named(count, (0..count).map(|t| (t % 4, t))).are_scattered());
    }

    #[test]
    fn cells_that_name_all_of_it_are_and_no_more_than_that_is_kept() {
        let count = 100 * STRETCH_LEN;
        let all = named(count, (0..count).map(|t| (t % 64, t)));
        assert!(all.are_scattered());
        assert_eq!(all.named.len(), 401);
    }

    #[test]
    fn corners_without_texture_name_nothing() {
        assert!(named(0, (0..100).map(|cell| (cell, NO_TEXCOORD))).named.is_empty());
    }
}
