//! How a mesh is cut into clusters.

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
