//! Ids in a partition, and the road of a vertex and of a texture coordinate from one mesh to the next.
//!
//! ```text
//! of              vertices                         texture coordinates
//!
//! piece           PieceVertex                      PieceTexcoord
//!                  │ PieceNumbering::vertex         │ PieceNumbering::texcoord
//! stored mesh     MeshVertex                       Texcoord
//!                  │ VertexRanks                    ┆
//! partition       PartitionVertex                  Texcoord
//!                  │ reading: rank in the cluster   │ rank in the cluster
//! loaded cluster  LocalVertex                      ClusterTexcoord
//!                  │ simplification                 │ wedges
//! result          LocalVertex                      Wedge
//!                  │ save: own ones by rank,        │ save: by first use
//!                  │ shared ones by Shared::rank    │
//! next piece      PieceVertex                      PieceTexcoord
//! ```
//! A mesh in memory is a loaded cluster whose partition ids are those of its caller.

use crate::base::id::ids;
use crate::mesh::id::LocalVertex;
use crate::model::id::{FaceVertex, Texcoord};

ids! {
    /// A vertex in the numbering of the partition: cell by cell.
    PartitionVertex;
    /// A cluster. Its *cell* is a box of space; the cluster is what is loaded and simplified together: the faces of the
    /// cell, all of their vertices, and the texture coordinates that they name.
    ClusterId;
    /// A window: consecutive vertices or texture coordinates of the mesh that are looked up together.
    WindowId;
    /// A texture coordinate of a cluster, by its rank among those that the faces name.
    ClusterTexcoord;
}

impl FaceVertex for PartitionVertex {
    type Texcoord = Texcoord;
}

impl FaceVertex for LocalVertex {
    type Texcoord = Texcoord;
}
