//! Partitions a stored mesh into clusters of bounded size.
//!
//! ```text
//! positions ── cells: a kd-tree over a histogram
//!     │
//!     ├─ numbering: vertices in cell order, duplicates welded; old id → new id
//!     │
//! faces ── faces: each goes to the cluster of the cell of most of its corners
//!     │        shared: the vertices used by several clusters
//!     │        stretches: how scattered over the file the texture coordinates of a cluster are
//!     │
//!     ├─ texcoords: copied to the clusters, if those of one are scattered
//!     ├─ weight: memory that a cluster takes; one that is too heavy passes through
//!     └─ reading, cluster: its faces with positions and texcoords, ready to be simplified
//!          ├─ save: the result as a piece of the next mesh
//!          └─ heavy: the same block by block, for clusters that pass through
//! ```
//! In: a [`StoredMesh`]. Out: a [`Partition`], whose clusters are loaded one by one; [`id`] tells how vertices are
//! numbered on the way. Invariant: the cells depend on the
//! mesh, the cluster size and the pass alone. All files are read and written sequentially, whatever the order of the
//! input.
//!
//! # Memory
//! A histogram of 8 MiB and its filled cells, at most twice that; 2 bytes per shared vertex; the numbering (4 bytes per
//! vertex) or two windows of it, 16 MiB or a quarter of the work memory; a window of texture coordinates, half of that;
//! buffers of records by cell, 12 MiB, or 24 MiB for texture coordinates; 92 bytes per vertex of a cell in each thread
//! while duplicates are welded.

pub mod id;
mod options;
mod file_names;
pub mod cells;
pub mod numbering;
mod shared;
mod stretches;
pub mod faces;
mod texcoord_ids;
pub mod texcoords;
pub mod weight;
mod ranks;
pub mod reading;
mod seams;
pub mod texture_scale;
mod wedges;
pub mod cluster;
mod rounding;
mod save;
mod interface;
pub mod heavy;
mod visit;

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::base::id::TiVec;
use crate::base::ordered::map_in_order;
use crate::base::{Findings, Result};
use crate::file::Segment;
use crate::job::folder_bytes;
use crate::model::{Catalogue, StoredMesh};

pub use cluster::ClusterSource;
pub use id::ClusterId;
pub use interface::write_shared;
pub use options::PartitionOptions;
pub use save::PieceContent;
pub use shared::Shared;
pub use texture_scale::TextureScale;
pub use visit::{VisitOptions, visit};

/// A mesh partitioned into clusters.
#[derive(Debug, Serialize, Deserialize)]
pub struct Partition {
    /// Vertices in cell order.
    pub numbering: numbering::Numbering,
    /// Faces by cluster.
    pub faces: faces::ClusteredFaces,
    /// Texture coordinates by cluster, if they are scattered over the mesh's files.
    texcoords: Option<texcoords::ClusteredTexcoords>,
    /// Weight of each cluster; `None` for those that pass through.
    weights: TiVec<ClusterId, Option<weight::ClusterWeight>>,
    /// Whether clusters are loaded without repeated faces.
    drops_doubles: bool,
    /// What was welded and dropped.
    pub findings: Findings,
    /// Largest size of the folder meanwhile, in bytes.
    #[serde(skip)]
    pub scratch_peak: u64,
}

/// Partitions a mesh. Writes files to `folder`, with names that begin with `name`.
///
/// # Errors
/// If the job is to stop; on a full disk, failed reads and writes, and damaged files.
pub fn partition(
    mesh: &StoredMesh,
    catalogue: &Catalogue,
    folder: &Path,
    name: &str,
    options: &PartitionOptions,
) -> Result<Partition> {
    let mut findings = Findings::default();
    let names = file_names::FileNames { folder, prefix: name };
    let cells = cells::plan(mesh, options)?;
    let number = if mesh.has_colours() {
        numbering::number::<numbering::ColouredRecord>
    } else {
        numbering::number::<numbering::PlainRecord>
    };
    let (numbering, ranks, numbering_bytes) = number(mesh, &cells, names, options, &mut findings)?;
    let mut faces = faces::distribute(mesh, &numbering, &ranks, names, options, &mut findings)?;
    let mut scratch_peak = numbering_bytes.max(folder_bytes(folder));
    drop(ranks);
    let weights = weigh(&numbering, &faces, catalogue, options)?;
    let heavy = weights.keys().filter(|&cluster| weights[cluster].is_none());
    faces.share_all(heavy.map(|cluster| numbering.vertices_of(cluster)));
    let texcoords =
        if faces.stretches.are_scattered() { Some(texcoords::bring(mesh, &faces, names, options)?) } else { None };
    scratch_peak = scratch_peak.max(folder_bytes(folder));
    let drops_doubles = options.drop_doubles;
    Ok(Partition { numbering, faces, texcoords, weights, drops_doubles, findings, scratch_peak })
}

/// Weighs each cluster; `None` where it exceeds the limit.
fn weigh(
    numbering: &numbering::Numbering,
    faces: &faces::ClusteredFaces,
    catalogue: &Catalogue,
    options: &PartitionOptions,
) -> Result<TiVec<ClusterId, Option<weight::ClusterWeight>>> {
    let limit = weight::limit_bytes(options.cluster_faces);
    let mut weights = TiVec::with_capacity(numbering.cell_count());
    map_in_order(
        ClusterId::first(numbering.cell_count()),
        options.threads,
        options.threads + 1,
        |cluster| {
            let face_count = faces.by_cluster.len(cluster);
            let own = numbering.vertices_of(cluster);
            let vertices = own.end.since(own.start) as u64 + faces.foreign_corners[cluster];
            let vertices = vertices.min(3 * face_count);
            let most = weight::ClusterWeight { faces: face_count, vertices, wedges: 3 * face_count };
            let met = weight::ClusterWeight { wedges: faces.wedges[cluster], ..most };
            if met.bytes() <= limit {
                return Ok(Some(met));
            }
            let bare = weight::ClusterWeight { wedges: 0, ..most };
            if bare.bytes() > limit {
                return Ok(None);
            }
            let mut counter = weight::WedgeCounter::new(catalogue, face_count);
            faces.by_cluster.read(cluster, |block| {
                counter.add(block);
                Ok(())
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

    /// All clusters, ascending; some may be empty.
    pub fn clusters(&self) -> impl DoubleEndedIterator<Item = ClusterId> + ExactSizeIterator + Clone + use<> {
        ClusterId::first(self.cluster_count())
    }

    /// Whether a cluster has faces and is not too heavy to load.
    pub fn is_loadable(&self, cluster: ClusterId) -> bool {
        self.face_count(cluster) > 0 && self.weight(cluster).is_some()
    }

    /// Number of clusters that have faces.
    pub fn filled_count(&self) -> u64 {
        self.clusters().filter(|&cluster| self.face_count(cluster) > 0).count() as u64
    }

    /// Whether at most one cluster has faces.
    pub fn is_single(&self) -> bool {
        self.filled_count() <= 1
    }

    /// Number of faces of a cluster.
    pub fn face_count(&self, cluster: ClusterId) -> u64 {
        self.faces.by_cluster.len(cluster)
    }

    /// Number of faces of each cluster.
    pub fn face_counts(&self) -> TiVec<ClusterId, u64> {
        self.clusters().map(|cluster| self.face_count(cluster)).collect()
    }

    /// Weight of a cluster; `None` if it is too heavy to load and has to pass through.
    pub fn weight(&self, cluster: ClusterId) -> Option<weight::ClusterWeight> {
        self.weights[cluster]
    }

    /// Number of faces of all clusters.
    pub fn total_faces(&self) -> u64 {
        self.clusters().map(|cluster| self.face_count(cluster)).sum()
    }

    /// Sets the folder of the files of a recalled value.
    pub fn locate(&mut self, folder: &Path) {
        self.numbering.positions.locate(folder);
        self.numbering.colours.iter_mut().for_each(|segment| segment.locate(folder));
        self.faces.by_cluster.locate(folder);
        self.texcoords.iter_mut().for_each(|texcoords| texcoords.answers.locate(folder));
    }

    /// Reports whether the tables and files of a recalled and located value are consistent, whether the required files
    /// of the mesh exist, and whether its clusters are no heavier than `cluster_faces` allows.
    pub fn is_sound(&self, mesh: &StoredMesh, cluster_faces: u64) -> bool {
        let (faces, numbering, count) = (&self.faces, &self.numbering, self.weights.len());
        let limit = weight::limit_bytes(cluster_faces);
        let can_be_loaded = |(cluster, weight): (ClusterId, &Option<weight::ClusterWeight>)| {
            let faces = self.face_count(cluster);
            let texcoords = self.texcoords.as_ref().map_or(0, |texcoords| texcoords.answers.len(cluster));
            weight.is_none_or(|weight| {
                weight.faces == faces
                    && weight.vertices.max(weight.wedges).max(texcoords) <= 3 * faces
                    && weight.bytes() <= limit
            })
        };
        (!self.needs_texcoords_of_mesh() || mesh.has_sound_texcoords())
            && faces.by_cluster.is_sound()
            && self.texcoords.iter().all(|texcoords| texcoords.answers.is_sound())
            && numbering.is_sound()
            && numbering.cell_count() == count
            && faces.by_cluster.cell_count() == count
            && self.texcoords.iter().all(|texcoords| texcoords.answers.cell_count() == count)
            && faces.shared.is_within(numbering.positions.len())
            && self.weights.iter_enumerated().all(can_be_loaded)
    }

    /// Paths of its files.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        let colours = self.numbering.colours.iter().map(Segment::path);
        let texcoords = self.texcoords.iter().map(|texcoords| texcoords.answers.path());
        [self.numbering.positions.path(), self.faces.by_cluster.path()].into_iter().chain(colours).chain(texcoords)
    }

    /// Paths of the mesh's files that its clusters still need.
    pub fn files_of<'a>(&self, mesh: &'a StoredMesh) -> impl Iterator<Item = &'a Path> + use<'a> {
        let needs_texcoords = self.needs_texcoords_of_mesh();
        mesh.texcoord_files().filter(move |_| needs_texcoords)
    }

    /// Reports whether texture coordinates are read from the mesh. Clusters that pass through read them there even if
    /// they were copied to the clusters.
    fn needs_texcoords_of_mesh(&self) -> bool {
        self.texcoords.is_none() || self.weights.iter().any(Option::is_none)
    }
}
