//! Ids of what leaves the cell in which it is counted; first in its cell, then in the mesh.

use crate::base::id::ids;

ids! {
    /// A connected component, or the part of one in a cell.
    OpenComponent;
    /// A chart of the atlas, or the part of one in a cell.
    OpenChart;
    /// A border, or the part of one in a cell.
    OpenBorder;
}
