//! Bakes patches, each with what it becomes: images in a folder, and a piece of the textured mesh.

use std::path::{Path, PathBuf};

use super::patch::{BakedPatch, PatchBaker, TexturedPatch};
use super::steps::BakeStep;
use crate::base::Result;
use crate::model::image_format::ImageFormat;
use crate::model::{Catalogue, StoredMesh};
use crate::partition::{ClusterId, ClusterSource, Partition, PieceContent, TextureScale, cluster, heavy};

/// Kind of the stages whose tasks bake patches.
pub const BAKE: &str = "bake";

/// What patches are baked with.
pub(super) struct PatchCrew<'a> {
    pub baker: PatchBaker<'a>,
    /// The result, cut into patches.
    pub partition: &'a Partition,
    pub mesh: &'a StoredMesh,
    /// With the decimals of the input, and no part.
    pub catalogue: &'a Catalogue,
    pub scale: &'a TextureScale,
    pub format: ImageFormat,
}

impl PatchCrew<'_> {
    /// Bakes a patch; its images lie in `folder`. The parts of its faces are numbers of its own images.
    ///
    /// # Errors
    /// If the job was stopped; on a full disk, failed reads and writes.
    pub fn bake(&self, cluster: ClusterId, folder: &Path) -> Result<(BakedPatch, PieceContent)> {
        let source = cluster::load(self.partition, self.mesh, self.catalogue, self.scale, cluster)?;
        let patch = self.baker.bake(source, self.format, folder, BakeStep::Patch(cluster).key().name())?;
        let content = self.content_of(&patch)?;
        Ok((patch.baked, content))
    }

    /// Bakes a patch that is too heavy to load at once, and writes its pieces.
    ///
    /// # Errors
    /// As [`bake`](PatchCrew::bake).
    pub fn bake_in_blocks(&self, cluster: ClusterId, folder: &Path) -> Result<BakedPatch> {
        let mut baked = BakedPatch::default();
        let mut take = |source: ClusterSource| {
            let name = format!("{}-{}", BakeStep::Patch(cluster).key().name(), baked.pieces.len());
            let mut patch = self.baker.bake(source, self.format, folder, &name)?;
            let first_image = baked.images.len() as u32;
            patch.mesh.parts.iter_mut().for_each(|part| *part = part.plus(first_image));
            let path = piece_path(folder, cluster, baked.pieces.len());
            baked.pieces.push(self.content_of(&patch)?.write(&path)?.commit()?);
            baked.add(patch.baked);
            Ok(())
        };
        heavy::load_in_blocks(self.partition, self.mesh, self.catalogue, self.scale, cluster, &mut take)?;
        Ok(baked)
    }

    fn content_of(&self, patch: &TexturedPatch) -> Result<PieceContent> {
        patch.source.piece_of(&patch.mesh, self.partition, self.catalogue, self.scale, None)
    }
}

/// Path of a piece of a patch.
pub(super) fn piece_path(folder: &Path, cluster: ClusterId, number: usize) -> PathBuf {
    folder.join(format!("{}-{number}.piece", BakeStep::Patch(cluster).key().name()))
}
