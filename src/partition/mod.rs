//! A stored mesh is cut into clusters of bounded size.
//!
//! ```text
//! positions ── cells: a kd-tree over a histogram
//!     │
//!     ├─ numbering: vertices in cell order, duplicates welded; old id → new id
//!     │
//! faces ── buckets: each face to the cell of most of its corners
//!     │
//!     ├─ texcoords: brought to the cells, if a cell's lie far apart
//!     ├─ weight: what a cluster takes in memory; one that is too heavy passes through
//!     └─ cluster: one bucket with its positions and texcoords, ready to be simplified
//! ```
//! In: a [`StoredMesh`]. Out: a [`Partition`], whose clusters load one by one. Invariant:
//! the cells depend on the mesh, the cluster size and the pass alone; all files are read and written in order,
//! whatever the order of the input.
//!
//! # Memory
//! A histogram of 8 MiB; 1.1 bits a vertex; a window of the numbering (4 bytes a vertex, at most a quarter of the work
//! memory at a time) or of texture coordinates (40 bytes each, at most a third of the work memory); buffers of the
//! buckets, 16 MiB; a cell of 92 bytes a vertex in each thread while duplicates are welded.

pub mod buckets;
pub mod cells;
pub mod cluster;
pub mod faces;
pub mod numbering;
pub mod scatter;
pub mod texcoords;
pub mod weight;

use std::path::Path;

use crate::base::ordered::map_in_order;
use crate::base::{Findings, Result};
use crate::store::{Catalogue, StoredMesh};

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
    /// Texture coordinates by cell, if they would be scattered otherwise.
    texcoords: Option<texcoords::CellTexcoords>,
    /// What each cluster takes in memory; nothing for those that pass through.
    weights: Vec<Option<weight::ClusterWeight>>,
    /// What was welded and dropped.
    pub findings: Findings,
}

/// Cuts a mesh; the files go to `folder`, their names begin with `name`.
///
/// # Errors
/// On a full disk, failed reads and writes, and damaged files.
pub fn partition(
    mesh: &StoredMesh,
    catalogue: &Catalogue,
    folder: &Path,
    name: &str,
    options: &PartitionOptions,
) -> Result<Partition> {
    let mut findings = Findings::default();
    let cells = cells::plan(mesh, options)?;
    let (numbering, ranks) = numbering::number(mesh, &cells, folder, name, options, &mut findings)?;
    let mut faces = faces::distribute(mesh, &numbering, &ranks, folder, name, options, &mut findings)?;
    drop(ranks);
    let weights = weigh(&numbering, &faces, catalogue, options)?;
    let heavy = (0..weights.len()).filter(|&cluster| weights[cluster].is_none());
    faces.share_all(heavy.map(|cluster| numbering.starts[cluster]..numbering.starts[cluster + 1]));
    let texcoords = match texcoords::are_scattered(mesh, &faces) {
        true => Some(texcoords::bring(mesh, &faces, folder, name, options)?),
        false => None,
    };
    Ok(Partition { numbering, faces, texcoords, weights, findings })
}

/// The weight of each cluster; none where it is beyond the limit.
fn weigh(
    numbering: &numbering::Numbering,
    faces: &faces::CellFaces,
    catalogue: &Catalogue,
    options: &PartitionOptions,
) -> Result<Vec<Option<weight::ClusterWeight>>> {
    let limit = weight::limit_bytes(options.cluster_faces);
    let mut weights = Vec::with_capacity(numbering.cell_count());
    map_in_order(
        0..numbering.cell_count(),
        options.threads,
        options.threads + 1,
        |cell| {
            let face_count = faces.buckets.len(cell);
            let own = u64::from(numbering.starts[cell + 1] - numbering.starts[cell]);
            let vertices = (own + faces.foreign_corners[cell]).min(3 * face_count);
            let most = weight::ClusterWeight { faces: face_count, vertices, wedges: 3 * face_count };
            let bare = weight::ClusterWeight { wedges: 0, ..most };
            if bare.bytes() > limit {
                return Ok(None);
            }
            let mut counter = weight::WedgeCounter::new(catalogue, most.wedges);
            faces.buckets.read_blocks(cell, |block| {
                counter.add(block);
                Ok(!counter.is_full())
            })?;
            let weight = weight::ClusterWeight { wedges: counter.count(), ..most };
            Ok((weight.bytes() <= limit).then_some(weight))
        },
        |weight| {
            weights.push(weight);
            Ok(())
        },
    )?;
    Ok(weights)
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

    /// What a cluster takes in memory; nothing if it is too heavy to be loaded and has to pass through.
    pub fn weight(&self, cluster: usize) -> Option<weight::ClusterWeight> {
        self.weights[cluster]
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
