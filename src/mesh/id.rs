//! Ids in the mesh of one cluster.

use crate::base::id::ids;

ids! {
    /// A vertex: one position.
    LocalVertex;
    /// A wedge: all corners of a vertex with the same texture coordinate and material.
    Wedge;
    /// A corner of a face: 3 × the face + its index in the face.
    Corner;
    /// A face.
    FaceId;
}
