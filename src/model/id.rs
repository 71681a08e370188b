//! Ids in a stored mesh; a [`PieceNumbering`](super::stored_mesh::PieceNumbering) turns those of a piece into those of
//! the mesh.
//!
//! ```text
//! vertices of the mesh     │ shared ones    │ own ones of piece 0 │ own ones of piece 1 │ …
//! vertices of piece 1      │ own ones of piece 1 │ shared ones    │
//! texcoords of the mesh    │ those of piece 0    │ those of piece 1    │ …
//! ```

use crate::base::id::{Id, ids};

ids! {
    /// A vertex of a piece: its own ones come first, the shared ones of the mesh after them. An input file is a piece
    /// without shared ones.
    PieceVertex;
    /// A vertex that several pieces share, by its rank among those of the mesh.
    SharedVertex;
    /// A vertex of the mesh: the shared ones come first, then the own ones of the pieces, piece by piece.
    MeshVertex;
    /// A texture coordinate of a piece.
    PieceTexcoord;
    /// A texture coordinate of the mesh, piece by piece.
    Texcoord;
    /// A corner of a piece: 3 × its face + its index in the face.
    PieceCorner;
    /// A part of the catalogue: file, object, group and material.
    PartId;
    /// A material of the catalogue; that after the last stands for none where a value for each of them is kept.
    MaterialId;
    /// A texture image of a mesh.
    ImageId;
    /// The name of an object or group in the catalogue.
    NameId;
    /// An input file, in the order in which they are read.
    FileId;
}

/// What numbers the vertices of faces; their texture coordinates are numbered alike.
pub trait FaceVertex: Id {
    /// What numbers the texture coordinates of these faces.
    type Texcoord: Id;
}

impl FaceVertex for PieceVertex {
    type Texcoord = PieceTexcoord;
}

impl FaceVertex for MeshVertex {
    type Texcoord = Texcoord;
}

impl PieceVertex {
    /// The shared vertex that it is; `None` for one of the `own` vertices of the piece.
    #[inline]
    pub fn shared(self, own: u32) -> Option<SharedVertex> {
        self.number().checked_sub(own).map(SharedVertex::new)
    }

    /// A shared vertex as one of a piece with `own` vertices of its own.
    #[inline]
    pub fn of_shared(vertex: SharedVertex, own: u32) -> Self {
        Self::new(own + vertex.number())
    }
}

impl PieceCorner {
    /// Index of its face.
    #[inline]
    pub fn face(self) -> usize {
        self.index() / 3
    }
}

impl From<SharedVertex> for MeshVertex {
    #[inline]
    fn from(vertex: SharedVertex) -> Self {
        Self::new(vertex.number())
    }
}
