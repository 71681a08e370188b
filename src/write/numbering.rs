//! Collects the vertices and texture coordinates that faces use, and their numbers in the result.
//!
//! In: the faces of a stored mesh. Out: sets of used ids with the rank of each member. The result keeps the stored
//! order (shared vertices, then piece by piece), so the rank of an id is its number in the result, counted from 0.
//!
//! # Memory
//! 3/16 byte per vertex and texture coordinate, 8 bytes per part, and blocks of faces within the memory given.

use std::marker::PhantomData;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;

use super::face_sweep::{FaceRun, map_faces};
use crate::base::id::{Id, TiVec};
use crate::base::{Error, Result};
use crate::model::face::BLOCK_FACES;
use crate::model::id::{MeshVertex, PartId, PieceVertex, SharedVertex, Texcoord};
use crate::model::stored_mesh::PieceNumbering;
use crate::model::{Face, StoredMesh};

/// A set of ids that returns the rank of each member.
#[derive(Debug)]
pub(super) struct IdSet<I> {
    words: Vec<AtomicU64>,
    /// Number of members before each word; computed by [`rank_members`](IdSet::rank_members).
    before: Vec<u32>,
    count: u64,
    kind: PhantomData<I>,
}

impl<I: Id> IdSet<I> {
    /// Creates an empty set for the first `limit` ids.
    pub(super) fn new(limit: u64) -> Self {
        let count = limit.div_ceil(64) as usize;
        let words = std::iter::repeat_with(AtomicU64::default).take(count).collect();
        Self { words, before: Vec::with_capacity(count), count: 0, kind: PhantomData }
    }

    /// Adds an id; threads may do so at the same time.
    pub(super) fn insert(&self, id: I) {
        let (word, bit) = (&self.words[id.index() / 64], 1 << (id.number() % 64));
        // Most ids come several times, and a look is cheaper.
        if word.load(Relaxed) & bit == 0 {
            word.fetch_or(bit, Relaxed);
        }
    }

    /// Reports whether an id is a member.
    pub(super) fn contains(&self, id: I) -> bool {
        self.words[id.index() / 64].load(Relaxed) >> (id.number() % 64) & 1 != 0
    }

    /// Updates [`rank`](IdSet::rank) and [`len`](IdSet::len) to the current members.
    pub(super) fn rank_members(&mut self) {
        self.count = 0;
        self.before.clear();
        for word in &mut self.words {
            self.before.push(self.count as u32);
            self.count += u64::from(word.get_mut().count_ones());
        }
    }

    /// Number of members smaller than `id`.
    pub(super) fn rank(&self, id: I) -> u32 {
        let word = id.index() / 64;
        self.before[word] + (self.words[word].load(Relaxed) & ((1 << (id.number() % 64)) - 1)).count_ones()
    }

    /// Number of members at the last call of [`rank_members`](IdSet::rank_members).
    pub(super) fn len(&self) -> u64 {
        self.count
    }

    /// Memory in bytes.
    pub(super) fn memory_bytes(&self) -> u64 {
        (self.words.capacity() * 8 + self.before.capacity() * 4) as u64
    }
}

/// Ids that the faces of a mesh use.
#[derive(Debug)]
pub(super) struct Usage {
    /// Used vertices.
    pub(super) vertices: IdSet<MeshVertex>,
    /// Used texture coordinates.
    pub(super) texcoords: IdSet<Texcoord>,
    /// Number of faces of each part.
    pub(super) faces_per_part: TiVec<PartId, u64>,
    /// Number of corners at each shared vertex; empty unless asked for.
    pub(super) corners_per_shared: TiVec<SharedVertex, u64>,
}

/// What a block of faces adds to the counts.
struct BlockCounts {
    /// Parts of consecutive faces, and their number.
    parts: Vec<(PartId, u64)>,
    /// Shared vertices at corners, if they are counted.
    shared: Vec<SharedVertex>,
}

impl BlockCounts {
    /// Largest size in bytes.
    const BYTES_MAX: u64 = (BLOCK_FACES * (size_of::<(PartId, u64)>() + 3 * size_of::<SharedVertex>())) as u64;
}

impl Usage {
    /// Marks nothing yet, with room for all ids of a mesh.
    pub(super) fn none(mesh: &StoredMesh, part_count: usize, counts_shared_corners: bool) -> Self {
        let counted = if counts_shared_corners { mesh.shared_count() as usize } else { 0 };
        Self {
            vertices: IdSet::new(mesh.vertex_count()),
            texcoords: IdSet::new(mesh.texcoord_count()),
            faces_per_part: vec![0; part_count].into(),
            corners_per_shared: vec![0; counted].into(),
        }
    }

    /// Reads every face once, within `memory_bytes` of memory.
    ///
    /// # Errors
    /// [`Error::Damaged`] if a face refers to a vertex, texture coordinate or part that does not exist.
    pub(super) fn sweep(mut self, mesh: &StoredMesh, numbering: &[PieceNumbering], memory_bytes: u64) -> Result<Self> {
        let Self { vertices, texcoords, faces_per_part, corners_per_shared } = &mut self;
        let counts_corners = !corners_per_shared.is_empty();
        let part_count = faces_per_part.len();
        let (vertices_used, texcoords_used) = (&*vertices, &*texcoords);
        let mark = |run: FaceRun<'_>| {
            check_ids(mesh, &run, part_count)?;
            let FaceRun { ids, faces, .. } = run;
            for face in faces.iter().map(|face| ids.globalise(face)) {
                face.vertices.into_iter().for_each(|v| vertices_used.insert(v));
                face.named_texcoords().for_each(|t| texcoords_used.insert(t));
            }
            let of_part = |run: &[Face<PieceVertex>]| (run[0].part, run.len() as u64);
            let parts = faces.chunk_by(|a, b| a.part == b.part).map(of_part).collect();
            let corners = faces.iter().filter(|_| counts_corners).flat_map(|face| face.vertices);
            Ok(BlockCounts { parts, shared: corners.filter_map(|vertex| vertex.shared(ids.own)).collect() })
        };
        map_faces(mesh, numbering, memory_bytes, BlockCounts::BYTES_MAX, mark, |counts: BlockCounts| {
            counts.parts.into_iter().for_each(|(part, faces)| faces_per_part[part] += faces);
            counts.shared.into_iter().for_each(|vertex| corners_per_shared[vertex] += 1);
            Ok(())
        })?;
        vertices.rank_members();
        texcoords.rank_members();
        Ok(self)
    }

    /// Reports whether a face has texture coordinates.
    pub(super) fn has_texcoords(&self) -> bool {
        self.texcoords.len() > 0
    }

    /// Memory in bytes.
    pub(super) fn memory_bytes(&self) -> u64 {
        let counts = self.faces_per_part.capacity() + self.corners_per_shared.capacity();
        self.vertices.memory_bytes() + self.texcoords.memory_bytes() + 8 * counts as u64
    }
}

/// Refuses faces that refer to a vertex, texture coordinate or part that does not exist.
fn check_ids(mesh: &StoredMesh, FaceRun { piece, ids, faces }: &FaceRun<'_>, part_count: usize) -> Result<()> {
    let vertex_limit = u64::from(ids.own) + mesh.shared_count();
    let texcoord_limit = piece.texcoords.len();
    let is_wrong = |face: &&Face<PieceVertex>| {
        face.part.index() >= part_count
            || face.vertices.iter().any(|&v| u64::from(v.number()) >= vertex_limit)
            || face.named_texcoords().any(|t| u64::from(t.number()) >= texcoord_limit)
    };
    match faces.iter().find(is_wrong) {
        None => Ok(()),
        Some(face) => {
            let message = format!("a face names what the mesh does not have: {face:?}");
            Err(Error::Damaged { path: piece.faces.path().to_owned(), message })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rank_counts_the_smaller_members(ids in prop::collection::btree_set(0u32..3000, 0..500)) {
            let mut set = IdSet::<MeshVertex>::new(3000);
            ids.iter().for_each(|&id| set.insert(MeshVertex::new(id)));
            set.rank_members();
            prop_assert_eq!(set.len(), ids.len() as u64);
            for (rank, &id) in ids.iter().enumerate() {
                prop_assert_eq!(set.rank(MeshVertex::new(id)), rank as u32);
            }
            prop_assert!((0..3000).all(|id| set.contains(MeshVertex::new(id)) == ids.contains(&id)));
        }
    }
}
