//! Memory of a cluster while it is simplified, and the limit above which it is not loaded.
//!
//! # Memory
//! ```text
//! face     56 bytes   corners, part, ring entries, candidates
//! vertex  150 bytes   position, flags, quadric, class, marks, ring start, candidates, partition id
//! wedge   110 bytes   texture coordinate, links, quadric, texcoord index
//! ```
//! About 200 bytes per face of an ordinary textured mesh (half a vertex and 0.65 wedges per face), up to 836 in a
//! triangle soup.

use std::collections::HashSet;
use std::hash::{BuildHasherDefault, Hasher};

use serde::{Deserialize, Serialize};

use super::id::PartitionVertex;
use crate::model::id::{PartId, Texcoord};
use crate::model::{Catalogue, Face};

const FACE_BYTES: u64 = 56;
const VERTEX_BYTES: u64 = 150;
const WEDGE_BYTES: u64 = 110;
/// Approximate bytes per face of an ordinary mesh.
pub const ORDINARY_BYTES: u64 = 200;
/// A cluster passes through unchanged if it weighs more than this many times an ordinary cluster of the target size.
///
/// NOTE: it shapes the result, so it depends on the cluster size alone and not on the memory budget.
const LIMIT_FACTOR: u64 = 2;
/// Slots of the cache of recent wedges; most corners hit it.
const RECENT: usize = 4096;

/// Counts from which the memory of a cluster is computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct ClusterWeight {
    /// Faces.
    pub faces: u64,
    /// Upper bound on the vertices, including those of other cells.
    pub vertices: u64,
    /// Upper bound on the wedges.
    pub wedges: u64,
}

impl ClusterWeight {
    /// Memory of the cluster while it is simplified, in bytes.
    pub fn bytes(&self) -> u64 {
        self.faces * FACE_BYTES + self.vertices * VERTEX_BYTES + self.wedges * WEDGE_BYTES
    }
}

/// Heaviest cluster that is loaded, in bytes, if clusters should have `cluster_faces` faces.
pub fn limit_bytes(cluster_faces: u64) -> u64 {
    LIMIT_FACTOR * ORDINARY_BYTES * cluster_faces
}

/// Counts the wedges of the faces of a cluster.
pub struct WedgeCounter<'a> {
    catalogue: &'a Catalogue,
    known: HashSet<u64, BuildHasherDefault<Mixed>>,
    recent: Vec<u64>,
}

impl<'a> WedgeCounter<'a> {
    /// Creates a counter for `faces` faces.
    pub fn new(catalogue: &'a Catalogue, faces: u64) -> Self {
        let known = HashSet::with_capacity_and_hasher(faces as usize, BuildHasherDefault::default());
        Self { catalogue, known, recent: vec![0; RECENT] }
    }

    /// Counts the wedges of further faces.
    pub fn add(&mut self, faces: &[Face<PartitionVertex>]) {
        for face in faces {
            let material = self.catalogue.material_of(face.part).number();
            for (vertex, texcoord) in face.vertices.into_iter().zip(face.texcoords) {
                let key = mix(u64::from(vertex.number()) << 32 | u64::from(texcoord.number()));
                let key = mix(key ^ u64::from(material));
                let recent = &mut self.recent[key as usize % RECENT];
                if *recent != key {
                    *recent = key;
                    self.known.insert(key);
                }
            }
        }
    }

    /// Number of wedges so far.
    pub fn count(&self) -> u64 {
        self.known.len() as u64
    }
}

/// A wedge as faces on disk show it, or a part of one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct StoredWedge {
    vertex: PartitionVertex,
    texcoord: Texcoord,
    part: PartId,
}

/// Cache of the wedges seen last in a sweep over faces.
pub struct RecentWedges {
    slots: Vec<StoredWedge>,
}

impl Default for RecentWedges {
    fn default() -> Self {
        let none = StoredWedge { vertex: PartitionVertex::NONE, texcoord: Texcoord::NONE, part: PartId::NONE };
        Self { slots: vec![none; RECENT] }
    }
}

impl RecentWedges {
    /// Number of corners of a face whose wedges are not in the cache. The sum over the faces of a cell is at least the
    /// number of its wedges, and only slightly more in any order that keeps adjacent faces together.
    #[inline]
    pub fn count_new(&mut self, face: &Face<PartitionVertex>) -> u32 {
        let mut count = 0;
        for (vertex, texcoord) in face.vertices.into_iter().zip(face.texcoords) {
            let wedge = StoredWedge { vertex, texcoord, part: face.part };
            let mixed = texcoord.number().wrapping_mul(0x9e37_79b1) >> 16;
            let slot = &mut self.slots[(vertex.number() ^ mixed) as usize % RECENT];
            count += u32::from(*slot != wedge);
            *slot = wedge;
        }
        count
    }
}

/// Hasher for keys that are already mixed: a tenth of the cost of the standard one, whose seed is not needed.
#[derive(Debug, Default)]
struct Mixed(u64);

impl Hasher for Mixed {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = mix(self.0 ^ u64::from(byte));
        }
    }

    fn write_u64(&mut self, key: u64) {
        self.0 = key;
    }
}

/// Spreads the bits of a number over all bits, bijectively (Stafford's variant 13 of the MurmurHash3 finaliser).
fn mix(mut x: u64) -> u64 {
    x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ x >> 31
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_ordinary_cluster_is_well_below_the_limit_and_a_soup_above() {
        let ordinary = ClusterWeight { faces: 1000, vertices: 520, wedges: 700 };
        let soup = ClusterWeight { faces: 1000, vertices: 3000, wedges: 3000 };
        assert!(ordinary.bytes() * 3 < limit_bytes(1000) * 2);
        assert!(soup.bytes() > limit_bytes(1000));
    }
}
