//! How a mesh is cut into clusters.

use crate::base::WorkLimits;

/// How to partition a mesh.
#[derive(Debug, Clone, Copy)]
pub struct PartitionOptions {
    /// Target number of faces per cell.
    pub cluster_faces: u64,
    /// Index of the pass; it shifts the cells.
    pub pass: usize,
    /// Whether vertices at equal positions are merged.
    pub weld: bool,
    /// Whether only the first of several faces with the same three vertices is kept.
    pub drop_doubles: bool,
    /// Whether faces lose their texture coordinates.
    pub drop_texcoords: bool,
    /// Worker threads.
    pub threads: usize,
    /// Memory in bytes for windows and buffers.
    pub work_bytes: u64,
}

impl PartitionOptions {
    /// To cut a mesh as it was read into cells that keep all it shows.
    pub fn as_read(cluster_faces: u64, limits: WorkLimits) -> Self {
        let WorkLimits { threads, work_bytes } = limits;
        Self { cluster_faces, pass: 0, weld: true, drop_doubles: false, drop_texcoords: false, threads, work_bytes }
    }
}
