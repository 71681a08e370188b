//! Ids in a stored mesh.

use crate::base::id::ids;

ids! {
    /// A vertex of a piece: its own ones come first, the shared ones of the mesh after them.
    PieceVertex;
    /// A vertex that several pieces share, by its rank among those of the mesh.
    SharedVertex;
    /// A texture coordinate of the mesh, or of a piece.
    Texcoord;
    /// A part of the catalogue: file, object, group and material.
    PartId;
    /// A material of the catalogue.
    MaterialId;
}
