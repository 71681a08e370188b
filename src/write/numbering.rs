//! Collects the vertices and texture coordinates that faces use, and their numbers in the result.
//!
//! In: the faces of a stored mesh. Out: sets of used ids with the rank of each member. The result keeps the stored
//! order (shared vertices, then piece by piece), so the rank of an id is its number in the result, counted from 0.
//!
//! # Memory
//! 3/16 byte per vertex and texture coordinate, 8 bytes per part, and one block of faces.

use std::marker::PhantomData;

use crate::base::id::{Id, TiVec};
use crate::base::{Error, Result};
use crate::model::StoredMesh;
use crate::model::corners::FaceReader;
use crate::model::id::{MeshVertex, PartId, SharedVertex, Texcoord};
use crate::model::stored_mesh::PieceNumbering;

/// A set of ids that returns the rank of each member.
#[derive(Debug)]
pub(super) struct IdSet<I> {
    words: Vec<u64>,
    /// Number of members before each word; computed by [`rank_members`](IdSet::rank_members).
    before: Vec<u32>,
    count: u64,
    kind: PhantomData<I>,
}

impl<I: Id> IdSet<I> {
    /// Creates an empty set for the first `limit` ids.
    pub(super) fn new(limit: u64) -> Self {
        Self { words: vec![0; limit.div_ceil(64) as usize], before: Vec::new(), count: 0, kind: PhantomData }
    }

    /// Adds an id.
    pub(super) fn insert(&mut self, id: I) {
        self.words[id.index() / 64] |= 1 << (id.number() % 64);
    }

    /// Reports whether an id is a member.
    pub(super) fn contains(&self, id: I) -> bool {
        self.words[id.index() / 64] >> (id.number() % 64) & 1 != 0
    }

    /// Updates [`rank`](IdSet::rank) and [`len`](IdSet::len) to the current members.
    pub(super) fn rank_members(&mut self) {
        self.count = 0;
        self.before.clear();
        for word in &self.words {
            self.before.push(self.count as u32);
            self.count += u64::from(word.count_ones());
        }
    }

    /// Number of members smaller than `id`.
    pub(super) fn rank(&self, id: I) -> u32 {
        let word = id.index() / 64;
        self.before[word] + (self.words[word] & ((1 << (id.number() % 64)) - 1)).count_ones()
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

impl Usage {
    /// Reads every face once.
    ///
    /// # Errors
    /// [`Error::Damaged`] if a face refers to a vertex, texture coordinate or part that does not exist.
    pub(super) fn sweep(
        mesh: &StoredMesh,
        numbering: &[PieceNumbering],
        part_count: usize,
        count_shared_corners: bool,
    ) -> Result<Self> {
        let shared_count = mesh.shared_count();
        let mut usage = Self {
            vertices: IdSet::new(mesh.vertex_count()),
            texcoords: IdSet::new(mesh.texcoord_count()),
            faces_per_part: vec![0; part_count].into(),
            corners_per_shared: vec![0; if count_shared_corners { shared_count as usize } else { 0 }].into(),
        };
        let mut reader = FaceReader::default();
        for (piece, ids) in mesh.pieces.iter().zip(numbering) {
            let vertex_limit = u64::from(ids.own) + shared_count;
            let texcoord_limit = piece.texcoords.len();
            reader.each_block(piece, |faces| {
                for face in faces {
                    let vertices_exist = face.vertices.iter().all(|&v| u64::from(v.number()) < vertex_limit);
                    let texcoords_exist = face.named_texcoords().all(|t| u64::from(t.number()) < texcoord_limit);
                    let part = usage.faces_per_part.get_mut(face.part);
                    let Some(part) = part.filter(|_| vertices_exist && texcoords_exist) else {
                        let message = format!("a face names what the mesh does not have: {face:?}");
                        return Err(Error::Damaged { path: piece.faces.path().to_owned(), message });
                    };
                    *part += 1;
                    if count_shared_corners {
                        for vertex in face.vertices.into_iter().filter_map(|v| v.shared(ids.own)) {
                            usage.corners_per_shared[vertex] += 1;
                        }
                    }
                    let face = ids.globalise(face);
                    face.vertices.into_iter().for_each(|v| usage.vertices.insert(v));
                    face.named_texcoords().for_each(|t| usage.texcoords.insert(t));
                }
                Ok(())
            })?;
        }
        usage.vertices.rank_members();
        usage.texcoords.rank_members();
        Ok(usage)
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
