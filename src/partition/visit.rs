//! Visits the clusters of a partition in order, several at a time; those that are too heavy to load block by block.

use super::cluster::{self, ClusterSource};
use super::{Partition, TextureScale, heavy};
use crate::base::ordered::map_within;
use crate::base::{Progress, Result};
use crate::model::{Catalogue, StoredMesh};

/// How clusters are visited.
#[derive(Clone, Copy)]
pub struct VisitOptions<'a> {
    /// Memory for clusters in work and for what waits to be taken, in bytes.
    pub work_bytes: u64,
    /// Memory that the visit of a cluster takes for each of its faces, in bytes.
    pub face_bytes: u64,
    /// Hears of each face.
    pub progress: &'a dyn Progress,
}

/// Passes each cluster to `work`, and what that makes of it to `take`: ordinary clusters in order, then the blocks of
/// heavy ones.
///
/// # Errors
/// If the job was stopped; on failed reads and damaged files; those of `work` and `take`.
pub fn visit<T: Send>(
    partition: &Partition,
    mesh: &StoredMesh,
    catalogue: &Catalogue,
    options: &VisitOptions<'_>,
    work: impl Fn(&ClusterSource) -> Result<T> + Sync,
    mut take: impl FnMut(T) -> Result<()>,
) -> Result<()> {
    let VisitOptions { work_bytes, face_bytes, progress } = *options;
    let scale = TextureScale::none(catalogue);
    let advance = |faces: u64| {
        progress.advance(faces);
        progress.check_stopped()
    };
    map_within(
        work_bytes,
        |&cluster| {
            let own = partition.weight(cluster).map_or(0, |weight| weight.bytes());
            own.max(partition.face_count(cluster) * face_bytes)
        },
        partition.clusters().filter(|&cluster| partition.weight(cluster).is_some()),
        |cluster| {
            let made = work(&cluster::load(partition, mesh, catalogue, &scale, cluster)?)?;
            Ok((partition.face_count(cluster), made))
        },
        |(faces, made)| {
            advance(faces)?;
            take(made)
        },
    )?;
    for cluster in partition.clusters().filter(|&cluster| partition.weight(cluster).is_none()) {
        heavy::load_in_blocks(partition, mesh, catalogue, &scale, cluster, |source| {
            advance(source.mesh.corners.len() as u64)?;
            take(work(&source)?)
        })?;
    }
    Ok(())
}
