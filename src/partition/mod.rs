//! A stored mesh is cut into clusters of bounded size.
//!
//! ```text
//! positions ── cells: a kd-tree over a histogram
//!     │
//!     ├─ numbering: vertices in cell order, duplicates welded; old id → new id
//!     │
//! faces ── buckets: each face to the cell of most of its corners
//!     │
//!     └─ cluster: one bucket with its positions and texcoords, ready to be simplified
//! ```
//! In: a [`StoredMesh`]. Out: a [`Partition`], whose clusters load one by one. Invariant:
//! the cells depend on the mesh, the cluster size and the pass alone; all files are read and written in order,
//! whatever the order of the input.
//!
//! # Memory
//! A histogram of 8 MiB; 1 bit a vertex; a window of the numbering (4 bytes a vertex, at most a quarter of the work
//! memory at a time); buffers of the buckets, 16 MiB.

pub mod buckets;
pub mod cells;
pub mod cluster;
pub mod faces;
pub mod numbering;
pub mod scatter;

use std::path::Path;

use crate::base::{Findings, Result};
use crate::store::StoredMesh;

pub use cluster::{ClusterSource, TextureScale};
pub use faces::Shared;

/// How a mesh is to be cut.
#[derive(Debug, Clone, Copy)]
pub struct PartitionOptions {
    /// Faces of a cell, about.
    pub cluster_faces: u64,
    /// Number of the pass; it shifts the cells.
    pub pass: usize,
    /// Whether vertices at bit-identical positions become one.
    pub weld: bool,
    /// Threads.
    pub threads: usize,
    /// Bytes that windows and buffers may take.
    pub work_bytes: u64,
}

/// A mesh cut into clusters.
#[derive(Debug)]
pub struct Partition {
    /// Vertices in cell order.
    pub numbering: numbering::Numbering,
    /// Faces by cell.
    pub faces: faces::CellFaces,
    /// What was welded and dropped.
    pub findings: Findings,
}

/// Cuts a mesh; the files go to `folder`, their names begin with `name`.
///
/// # Errors
/// On a full disk, failed reads and writes, and damaged files.
pub fn partition(mesh: &StoredMesh, folder: &Path, name: &str, options: &PartitionOptions) -> Result<Partition> {
    let mut findings = Findings::default();
    let cells = cells::plan(mesh, options)?;
    let (numbering, ranks) = numbering::number(mesh, &cells, folder, name, options, &mut findings)?;
    let faces = faces::distribute(mesh, &numbering, &ranks, folder, name, options, &mut findings)?;
    Ok(Partition { numbering, faces, findings })
}

impl Partition {
    /// Number of clusters; some may be empty.
    pub fn cluster_count(&self) -> usize {
        self.numbering.cell_count()
    }

    /// Number of faces of a cluster.
    pub fn face_count(&self, cluster: usize) -> u64 {
        self.faces.buckets.len(cluster)
    }

    /// Number of faces of all clusters.
    pub fn total_faces(&self) -> u64 {
        (0..self.cluster_count()).map(|cluster| self.face_count(cluster)).sum()
    }

    /// Removes the files.
    pub fn remove(self) {
        let _ = std::fs::remove_file(self.numbering.positions.path());
        if let Some(colours) = &self.numbering.colours {
            let _ = std::fs::remove_file(colours.path());
        }
        let _ = std::fs::remove_file(self.faces.buckets.path());
    }
}
