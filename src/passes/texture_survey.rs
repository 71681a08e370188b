//! Measures the scale of texture coordinates and the density of seams before the first pass, while its sample is taken.
//!
//! The scale of a material is a ratio of two sums over its faces, which every fourth run of faces estimates well
//! enough. All of them are read only if that sample has too few faces of a material. Seams are counted in the clusters
//! that give patches to the sample.

use super::run::Run;
use super::sample;
use super::texture_traits::TextureTraits;
use crate::base::Result;
use crate::base::id::TiVec;
use crate::base::ordered::map_in_order;
use crate::mesh::ClusterMesh;
use crate::mesh::seam_density::SeamTally;
use crate::model::id::MaterialId;
use crate::partition::texture_scale::MaterialArea;
use crate::partition::{Partition, TextureScale, reading};

/// One in this many runs of faces is read.
const STEP: usize = 4;
/// Fewest faces by which a material is measured, unless it has fewer in the whole mesh.
const FACES_MIN: u64 = 256;

/// Areas of the materials that occur in a cluster.
type SparseAreas = Vec<(MaterialId, MaterialArea)>;

/// Sums over the clusters.
#[derive(Default)]
struct Measured {
    areas: TiVec<MaterialId, MaterialArea>,
    seams: SeamTally,
    sample: ClusterMesh,
}

impl Run<'_> {
    /// Measures the texture; also returns a sample of the clusters, empty if there is only one.
    pub(super) fn measure_texture(&self, partition: &Partition) -> Result<(TextureTraits, ClusterMesh)> {
        let is_raw = self.engine.wants_raw_texture();
        let mut measured = self.measure_clusters(STEP, partition)?;
        let mut named = self.catalogue.per_material(false);
        self.catalogue.parts.keys().for_each(|part| named[self.catalogue.material_of(part)] = true);
        let is_vague = measured.areas.iter().zip(named).any(|(area, is_named)| is_named && area.faces < FACES_MIN);
        if is_vague && !is_raw {
            measured = self.measure_clusters(1, partition)?;
        }
        let Measured { areas, seams, mut sample } = measured;
        let scale = if is_raw { TextureScale::none(self.catalogue) } else { TextureScale::new(&areas) };
        sample::scale_texture(&mut sample, |part| scale.of(self.catalogue, part));
        let kept = self.options.target as f64 / self.options.input.max(1) as f64;
        Ok((TextureTraits { scale, seam_density: seams.seam_density(kept) }, sample))
    }

    /// Sums over the clusters, in order. Areas per material come from one run of faces in `step`, and from all those of
    /// clusters that give a patch; seams come from the latter alone.
    fn measure_clusters(&self, step: usize, partition: &Partition) -> Result<Measured> {
        let none = || self.catalogue.per_material(MaterialArea::default());
        let mut measured = Measured { areas: none(), ..Measured::default() };
        let survey = self.first_survey(partition);
        map_in_order(
            partition.clusters(),
            self.options.threads,
            // A cluster that gives a patch takes many times as long as one that is only summed.
            self.options.threads * 16,
            |cluster| {
                if partition.weight(cluster).is_none() {
                    return Ok((Vec::new(), SeamTally::default(), None));
                }
                self.progress.check_stopped()?;
                let _permit = self.permits.take(self.cluster_bytes(partition, cluster) / 2);
                let is_wanted = survey.wants(cluster);
                let faces =
                    reading::read_one_in(if is_wanted { 1 } else { step }, partition, &self.state.mesh, cluster)?;
                let mut areas = none();
                faces.add_areas(self.catalogue, &mut areas);
                let sparse = areas.into_iter_enumerated().filter(|(_, area)| area.faces > 0);
                let seams = if is_wanted { faces.tally_seams(self.catalogue) } else { SeamTally::default() };
                let gives_patch = is_wanted && !partition.is_single();
                let patch = gives_patch.then(|| self.patch_of_faces(&survey, partition, faces));
                Ok((sparse.collect(), seams, patch))
            },
            |(sums, seams, patch): (SparseAreas, SeamTally, Option<ClusterMesh>)| {
                sums.into_iter().for_each(|(material, area)| measured.areas[material] += area);
                measured.seams += seams;
                patch.iter().for_each(|patch| sample::append(&mut measured.sample, patch));
                Ok(())
            },
        )?;
        Ok(measured)
    }
}
