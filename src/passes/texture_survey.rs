//! Measures the scale of texture coordinates and the density of seams before the first pass, while its sample is taken.
//!
//! The scale of a material is a ratio of two sums over its faces, which every fourth run of faces estimates well
//! enough. The others are read only if that sample has too few faces of a material. Seams are counted in the clusters
//! that give patches to the sample.

use super::run::Run;
use super::sample::{self, Survey};
use super::texture_traits::TextureTraits;
use crate::base::Result;
use crate::base::id::TiVec;
use crate::base::ordered::map_in_order;
use crate::mesh::ClusterMesh;
use crate::mesh::seam_density::SeamTally;
use crate::model::id::MaterialId;
use crate::partition::reading::{self, ClusterFaces};
use crate::partition::texture_scale::MaterialArea;
use crate::partition::{ClusterId, Partition, TextureScale};

/// One in this many runs of faces is read.
const STEP: usize = 4;
/// Fewest faces by which a material is measured, unless it has fewer in the whole mesh.
const FACES_MIN: u64 = 256;

/// Areas of the materials that occur in a cluster.
type SparseAreas = Vec<(MaterialId, MaterialArea)>;

/// What was measured in a cluster.
#[derive(Default)]
struct MeasuredCluster {
    areas: SparseAreas,
    surveyed: Option<SurveyedCluster>,
}

/// What was measured in a cluster that gives a patch.
struct SurveyedCluster {
    seams: SeamTally,
    /// The patch; `None` if the mesh has no other cluster.
    patch: Option<ClusterMesh>,
}

/// Areas of each material.
type MaterialAreas = TiVec<MaterialId, MaterialArea>;

/// Sums over the clusters.
struct Measured {
    areas: MaterialAreas,
    /// Those of the clusters that give a patch.
    areas_of_surveyed: MaterialAreas,
    seams: SeamTally,
    sample: ClusterMesh,
}

impl Run<'_> {
    /// Measures the texture; also returns a sample of the clusters, empty if there is only one.
    pub(super) fn measure_texture(&self, partition: &Partition) -> Result<(TextureTraits, ClusterMesh)> {
        let survey = self.first_survey(partition);
        let Measured { mut areas, areas_of_surveyed, seams, mut sample } = self.measure_clusters(partition, &survey)?;
        let scale = if self.engine.wants_raw_texture() {
            TextureScale::none(self.catalogue)
        } else {
            if self.are_vague(&areas) {
                areas = self.with_all_others(partition, &survey, areas_of_surveyed)?;
            }
            TextureScale::new(&areas)
        };
        sample::scale_texture(&mut sample, |part| scale.of(self.catalogue, part));
        let kept = self.options.target as f64 / self.options.input.max(1) as f64;
        Ok((TextureTraits { scale, seam_density: seams.seam_density(kept) }, sample))
    }

    /// Reports whether a material that occurs was measured by too few faces.
    fn are_vague(&self, areas: &MaterialAreas) -> bool {
        let mut named = self.catalogue.per_material(false);
        self.catalogue.parts.keys().for_each(|part| named[self.catalogue.material_of(part)] = true);
        areas.iter().zip(named).any(|(area, is_named)| is_named && area.faces < FACES_MIN)
    }

    /// Sums over the clusters, in order. Areas come from all faces of the clusters that give a patch, and from one run
    /// of faces in [`STEP`] of the others; seams come from the former alone.
    fn measure_clusters(&self, partition: &Partition, survey: &Survey) -> Result<Measured> {
        let mut measured = Measured {
            areas: self.catalogue.per_material(MaterialArea::default()),
            areas_of_surveyed: self.catalogue.per_material(MaterialArea::default()),
            seams: SeamTally::default(),
            sample: ClusterMesh::default(),
        };
        map_in_order(
            partition.clusters(),
            self.options.threads,
            // A cluster that gives a patch takes many times as long as one that is only summed.
            self.options.threads * 16,
            |cluster| {
                if partition.weight(cluster).is_none() {
                    return Ok(MeasuredCluster::default());
                }
                if !survey.wants(cluster) {
                    let areas = self.measure_areas(partition, cluster, STEP)?;
                    return Ok(MeasuredCluster { areas, ..MeasuredCluster::default() });
                }
                self.progress.check_stopped()?;
                let _permit = self.permits.take(self.cluster_bytes(partition, cluster) / 2);
                let faces = reading::read(partition, &self.state.mesh, cluster)?;
                let (areas, seams) = (self.areas_of(&faces), faces.tally_seams(self.catalogue));
                let gives_patch = !partition.is_single();
                let patch = gives_patch.then(|| self.patch_of_faces(survey, partition, faces));
                Ok(MeasuredCluster { areas, surveyed: Some(SurveyedCluster { seams, patch }) })
            },
            |MeasuredCluster { areas, surveyed }| {
                add(&mut measured.areas, &areas);
                if let Some(SurveyedCluster { seams, patch }) = surveyed {
                    add(&mut measured.areas_of_surveyed, &areas);
                    measured.seams += seams;
                    patch.iter().for_each(|patch| sample::append(&mut measured.sample, patch));
                }
                Ok(())
            },
        )?;
        Ok(measured)
    }

    /// Adds to areas those of all faces of the clusters that give no patch.
    fn with_all_others(
        &self,
        partition: &Partition,
        survey: &Survey,
        mut areas: MaterialAreas,
    ) -> Result<MaterialAreas> {
        let threads = self.options.threads;
        let is_other = |&cluster: &ClusterId| partition.weight(cluster).is_some() && !survey.wants(cluster);
        let others = partition.clusters().filter(is_other);
        map_in_order(
            others,
            threads,
            threads + 1,
            |cluster| self.measure_areas(partition, cluster, 1),
            |other| {
                add(&mut areas, &other);
                Ok(())
            },
        )?;
        Ok(areas)
    }

    /// Measures one run of faces in `step` of a cluster.
    fn measure_areas(&self, partition: &Partition, cluster: ClusterId, step: usize) -> Result<SparseAreas> {
        self.progress.check_stopped()?;
        let _permit = self.permits.take(self.cluster_bytes(partition, cluster) / 2);
        Ok(self.areas_of(&reading::read_one_in(step, partition, &self.state.mesh, cluster)?))
    }

    fn areas_of(&self, faces: &ClusterFaces) -> SparseAreas {
        let mut areas = self.catalogue.per_material(MaterialArea::default());
        faces.add_areas(self.catalogue, &mut areas);
        areas.into_iter_enumerated().filter(|(_, area)| area.faces > 0).collect()
    }
}

fn add(areas: &mut MaterialAreas, cluster: &SparseAreas) {
    cluster.iter().for_each(|&(material, area)| areas[material] += area);
}
