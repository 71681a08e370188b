//! Measures how scattered over the file the texture coordinates of each cluster are.
//!
//! The texture coordinates are divided into stretches. The measure is the number of stretches that the faces of a
//! cluster refer to, summed over the clusters: the number of stretches read if each of them reads its own.
//!
//! # Memory
//! A pair of numbers per stretch of each cluster, up to [`READINGS_MAX`] times the stretches of the file; beyond that
//! the answer is known.

use std::collections::HashSet;

use foldhash::fast::RandomState;

use super::id::ClusterId;
use crate::model::id::Texcoord;

/// Texture coordinates per stretch: 64 KiB, so that reading one costs about as much as a random access.
const STRETCH_LEN: u32 = 4096;
/// Largest number of times that the whole column may be read, stretch by stretch, before sorting it by cluster is
/// cheaper.
const READINGS_MAX: u64 = 4;
/// Slots of the cache of recent stretches, indexed by the low bits of cluster and stretch.
const RECENT_COUNT: usize = 64;

/// A stretch that a face of a cluster refers to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ClusterStretch {
    /// The cluster.
    pub cluster: ClusterId,
    /// Index of the stretch.
    pub stretch: u32,
}

/// Stretches that some faces refer to; may contain repetitions.
#[derive(Debug)]
pub struct SeenStretches {
    recent: [ClusterStretch; RECENT_COUNT],
    /// In order of the faces.
    pub seen: Vec<ClusterStretch>,
}

impl SeenStretches {
    /// None so far.
    pub fn new() -> Self {
        let none = ClusterStretch { cluster: ClusterId::NONE, stretch: 0 };
        Self { recent: [none; RECENT_COUNT], seen: Vec::new() }
    }

    /// Records the texture coordinate of a corner, if it has one.
    #[inline]
    pub fn see(&mut self, cluster: ClusterId, texcoord: Texcoord) {
        let Some(texcoord) = texcoord.some() else { return };
        let stretch = ClusterStretch { cluster, stretch: texcoord.number() / STRETCH_LEN };
        let slot = &mut self.recent[(cluster.number() ^ stretch.stretch) as usize % RECENT_COUNT];
        if *slot != stretch {
            *slot = stretch;
            self.seen.push(stretch);
        }
    }
}

/// Distinct stretches that the faces of each cluster refer to, up to the number that decides.
#[derive(Debug, Default)]
pub struct NamedStretches {
    // NOTE: only its length is used, so the seed does not affect the result.
    named: HashSet<ClusterStretch, RandomState>,
    enough: u64,
}

impl NamedStretches {
    /// Creates an empty set for a mesh of `texcoord_count` texture coordinates.
    pub fn new(texcoord_count: u64) -> Self {
        Self { named: HashSet::default(), enough: READINGS_MAX * texcoord_count / u64::from(STRETCH_LEN) }
    }

    /// Adds recorded stretches.
    pub fn add(&mut self, seen: Vec<ClusterStretch>) {
        for stretch in seen {
            if self.are_scattered() {
                return;
            }
            self.named.insert(stretch);
        }
    }

    /// Reports whether the texture coordinates of clusters are scattered over the file.
    pub fn are_scattered(&self) -> bool {
        self.named.len() as u64 > self.enough
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stretches of corners, given by the numbers of cluster and texture coordinate.
    fn named(texcoord_count: u32, corners: impl Iterator<Item = [u32; 2]>) -> NamedStretches {
        let mut seen = SeenStretches::new();
        corners.for_each(|[cluster, texcoord]| seen.see(ClusterId::new(cluster), Texcoord::new(texcoord)));
        let mut named = NamedStretches::new(u64::from(texcoord_count));
        named.add(seen.seen);
        named
    }

    #[test]
    fn clusters_that_name_their_own_part_of_the_file_are_not_scattered() {
        let count = 100 * STRETCH_LEN;
        let own = named(count, (0..count).map(|t| [t / (2 * STRETCH_LEN), t]));
        assert_eq!(own.named.len(), 100);
        assert!(!own.are_scattered());
        assert!(!named(count, (0..count).map(|t| [t % 4, t])).are_scattered());
    }

    #[test]
    fn clusters_that_name_all_of_it_are_and_no_more_than_that_is_kept() {
        let count = 100 * STRETCH_LEN;
        let all = named(count, (0..count).map(|t| [t % 64, t]));
        assert!(all.are_scattered());
        assert_eq!(all.named.len(), 401);
    }

    #[test]
    fn corners_without_texture_name_nothing() {
        assert!(named(0, (0..100).map(|cluster| [cluster, Texcoord::NONE.number()])).named.is_empty());
    }
}
