//! Has patches baked by other processes, and bakes them there.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::arithmetic;
pub use super::crew::BAKE;
use super::crew::PatchCrew;
use super::original::Original;
use super::painters::PAINTER_BYTES;
use super::patch::{BakedPatch, PatchBaker, PatchSettings};
use super::run::{painter_count, patch_bytes};
use crate::base::{Progress, Result, WorkLimits};
use crate::job::Recalled;
use crate::job::stage::{Stage, StageTask};
use crate::lend::{LentItem, LentResult, LentWork, details_of};
use crate::model::image_format::ImageFormat;
use crate::model::{Catalogue, StoredMesh, StoredPiece};
use crate::partition::{Partition, TextureScale};

/// What a process that does tasks of a stage needs.
#[derive(Deserialize)]
struct BakeDetails {
    original: Original,
    mesh: StoredMesh,
    partition: Partition,
    catalogue: Catalogue,
    /// Length of a texel, and what a surface that faces away counts as farther.
    lengths: [f64; 2],
    side: u32,
    format: ImageFormat,
    patch_faces: u64,
}

impl Recalled for BakeDetails {
    type Context<'a> = ();

    fn locate(&mut self, folder: &Path, (): &()) {
        self.original.locate(folder, &());
        self.mesh.locate(folder, &());
        self.partition.locate(folder);
    }

    fn is_sound(&self, (): &()) -> bool {
        self.original.is_sound(&())
            && self.partition.is_sound(&self.mesh, self.patch_faces)
            && (64..=16384).contains(&self.side)
            && self.lengths[0] > 0.0
            && self.lengths[1] >= 0.0
            && self.lengths.iter().all(|length| length.is_finite())
    }
}

impl LentResult for BakedPatch {
    fn add_piece(&mut self, piece: StoredPiece) {
        self.pieces.push(piece);
    }

    fn files(&self) -> Vec<PathBuf> {
        self.images.iter().map(|image| image.path.clone()).collect()
    }
}

/// Does a task of a stage of patches, within limits of memory and threads.
///
/// # Errors
/// [`Error::Changed`](crate::base::Error::Changed) on a machine that computes something else.
/// [`Error::Damaged`](crate::base::Error::Damaged) if the stage holds none; on a full disk, failed reads and writes, and
/// damaged files.
pub fn do_task(stage: &Stage, task: &StageTask, limits: WorkLimits, progress: &dyn Progress) -> Result<()> {
    let details: BakeDetails = details_of(stage)?;
    stage.check_arithmetic(arithmetic::checksum(details.format)?)?;
    let BakeDetails { original, mesh, partition, catalogue, lengths: [texel, away], side, format, .. } = &details;
    let painters = painter_count(*side, limits);
    let settings = PatchSettings { texel: *texel, away: *away, side: *side, painters };
    let scale = TextureScale::none(catalogue);
    let baker = PatchBaker::new(original, &settings, progress);
    let crew = PatchCrew { baker, partition, mesh, catalogue, scale: &scale, format: *format };
    let folder = stage.path().with_file_name("");
    let work = LentWork {
        items: LentItem::clusters_of(partition),
        has_pieces: true,
        bytes: &|cluster| patch_bytes(*side, partition, cluster),
        work: &|cluster| crew.bake(cluster, &folder).map(|(baked, content)| (baked, Some(content))),
    };
    let left = WorkLimits { work_bytes: limits.work_bytes.saturating_sub(painters as u64 * PAINTER_BYTES), ..limits };
    work.run(stage, task, left, progress)
}
