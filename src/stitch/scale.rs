//! How much texture coordinates are scaled: measured before the first pass, while the sample for it is taken.
//!
//! The scale of a material is a ratio of two sums over its faces, for which one block of faces in four is as good as all;
//! only where that shows too few faces of a material, all blocks are read.

use super::pass::{Run, is_single};
use super::sample;
use crate::base::Result;
use crate::base::ordered::map_in_order;
use crate::cost::Metric;
use crate::mesh::ClusterMesh;
use crate::partition::cluster::{MaterialArea, material_index};
use crate::partition::{Partition, TextureScale, reading};
use crate::store::StoredMesh;

/// Of so many blocks of faces one is read.
const STEP: usize = 4;
/// Faces of a material, at least, by which it is measured; or all that it has.
const FACES_MIN: u64 = 256;

/// The areas of the materials that a cluster has.
type SparseAreas = Vec<(usize, MaterialArea)>;

impl<M: Metric> Run<'_, M> {
    /// Sums areas in space and in texture over the clusters, in order, for the scale of texture coordinates; returns a
    /// sample of the clusters with it.
    pub(super) fn measure_texture(
        &self,
        mesh: &StoredMesh,
        partition: &Partition,
    ) -> Result<(TextureScale, ClusterMesh)> {
        let mut sample = ClusterMesh::default();
        let is_raw = M::wants_raw_texture(&self.settings);
        let mut areas = self.sum_areas(STEP, mesh, partition, &mut sample)?;
        let mut named = vec![false; areas.len()];
        (0..self.catalogue.parts.len()).for_each(|part| named[material_index(self.catalogue, part as u32)] = true);
        let is_vague = areas.iter().zip(named).any(|(area, is_named)| is_named && area.faces < FACES_MIN);
        if is_vague && !is_raw {
            sample = ClusterMesh::default();
            areas = self.sum_areas(1, mesh, partition, &mut sample)?;
        }
        let scale = if is_raw { TextureScale::none(self.catalogue) } else { TextureScale::new(&areas) };
        sample::scale_texture(&mut sample, |part| scale.of(self.catalogue, part));
        Ok((scale, sample))
    }

    /// The areas of each material in one block in `step`, and in all blocks of the clusters that give the sample a patch.
    fn sum_areas(
        &self,
        step: usize,
        mesh: &StoredMesh,
        partition: &Partition,
        sample: &mut ClusterMesh,
    ) -> Result<Vec<MaterialArea>> {
        let none = || vec![MaterialArea::default(); self.catalogue.materials.len() + 1];
        let mut areas = none();
        let survey = self.first_survey(partition);
        map_in_order(
            0..partition.cluster_count(),
            self.options.threads,
            // A cluster that gives a patch takes many times as long as one that gives sums.
            self.options.threads * 16,
            |cluster| {
                if partition.weight(cluster).is_none() {
                    return Ok((Vec::new(), None));
                }
                self.progress.check_stopped()?;
                let _permit = self.permits.take(self.cluster_bytes(partition, cluster) / 2);
                let is_wanted = !is_single(partition) && survey.wants(cluster);
                let faces = reading::read_one_in(if is_wanted { 1 } else { step }, partition, mesh, cluster)?;
                let mut areas = none();
                faces.add_areas(self.catalogue, &mut areas);
                let sparse = areas.into_iter().enumerate().filter(|(_, area)| area.faces > 0);
                Ok((sparse.collect(), is_wanted.then(|| self.patch_of_faces(&survey, partition, faces))))
            },
            |(sums, patch): (SparseAreas, Option<ClusterMesh>)| {
                sums.into_iter().for_each(|(material, area)| areas[material] += area);
                patch.iter().for_each(|patch| sample::append(sample, patch));
                Ok(())
            },
        )?;
        Ok(areas)
    }
}
