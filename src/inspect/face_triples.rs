//! Counts the faces of a heavy cluster whose three vertices an earlier face has.
//!
//! In: its faces, block by block. Out: their number. Invariant: the number is that of
//! [`doubles`](crate::mesh::doubles::doubles) over all of them.
//!
//! # Memory
//! The buffers of a file of records, 12 MiB; 16 to 32 bytes for each different face of a bucket.
//!
//! # Files
//! `inspect-faces.buckets` (12 bytes a face), removed at the end.

use std::collections::HashSet;
use std::path::Path;

use bytemuck::{Pod, Zeroable};
use foldhash::fast::FixedState;

use crate::base::Result;
use crate::file::buckets::BucketWriter;
use crate::file::record::Verbatim;
use crate::partition::ClusterSource;

/// Faces of a bucket, if all faces differ and [`BUCKETS_MAX`] allows as many buckets.
const BUCKET_FACES: u64 = 128 << 10;
/// Maximum number of buckets.
const BUCKETS_MAX: u64 = 1024;

/// Vertices of a face in the partition, ascending.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Pod, Zeroable)]
#[repr(C)]
struct FaceTriple([u32; 3]);

impl Verbatim for FaceTriple {}

/// The faces of a cluster by a hash of their vertices.
pub(super) struct FaceTriples {
    faces: BucketWriter<FaceTriple>,
    buckets: u64,
    count: u64,
}

impl FaceTriples {
    /// Creates the file for about `faces` faces.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub(super) fn create(folder: &Path, faces: u64) -> Result<Self> {
        let buckets = faces.div_ceil(BUCKET_FACES).clamp(1, BUCKETS_MAX);
        let faces = BucketWriter::create(&folder.join("inspect-faces.buckets"), buckets as usize)?;
        Ok(Self { faces, buckets, count: 0 })
    }

    /// Adds faces.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub(super) fn add(&mut self, source: &ClusterSource) -> Result<()> {
        for vertices in &source.mesh.corner_vertices {
            let mut triple = vertices.map(|vertex| source.vertex_id(vertex).number());
            triple.sort_unstable();
            let mixed = triple
                .iter()
                .fold(0u64, |mixed, &id| (mixed ^ u64::from(id)).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29));
            self.faces.push(((mixed >> 20) % self.buckets) as usize, FaceTriple(triple))?;
            self.count += 1;
        }
        Ok(())
    }

    /// Number of faces whose vertices an earlier one has.
    ///
    /// # Errors
    /// On failed reads and writes.
    pub(super) fn doubled(self) -> Result<u64> {
        let (faces, mut different) = (self.faces.finish()?, 0);
        for bucket in 0..self.buckets as usize {
            let mut known: HashSet<FaceTriple, FixedState> = HashSet::default();
            faces.read(bucket, |block| {
                known.extend(block);
                Ok(())
            })?;
            different += known.len() as u64;
        }
        Ok(self.count - different)
    }
}
