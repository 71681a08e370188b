//! Ids in a partition.

use crate::base::id::ids;

ids! {
    /// A vertex in the numbering of the partition: cell by cell.
    CellVertex;
    /// A cell: the faces that are read together.
    CellId;
    /// A cluster: the cells that are simplified together.
    ClusterId;
}
