//! How a mesh is cut into clusters.

/// How a mesh is to be cut.
#[derive(Debug, Clone, Copy)]
pub struct PartitionOptions {
    /// Faces of a cell, about.
    pub cluster_faces: u64,
    /// Number of the pass; it shifts the cells.
    pub pass: usize,
    /// Whether vertices at bit-identical positions become one.
    pub weld: bool,
    /// Whether of faces with the same three vertices the first alone is kept.
    pub drop_doubles: bool,
    /// Threads.
    pub threads: usize,
    /// Bytes that windows and buffers may take.
    pub work_bytes: u64,
}
