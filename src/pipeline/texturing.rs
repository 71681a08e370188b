//! New textures for the result, if they are asked for: what is kept of the input, and the bake.

use super::admission::Admission;
use super::input::Input;
use super::original::find_images;
use super::paths::OutputKind;
use super::preflight::Preflight;
use crate::bake::{self, BakePlace, BakeSettings, BakeSize, OriginalSurface, Unbaked};
use crate::base::{Error, Findings, Progress, Result, WorkLimits, bytes};
use crate::image::textures::TextureImages;
use crate::job::{StepKey, WorkFolder};
use crate::model::{Catalogue, StoredMesh};
use crate::passes::{Passes, ResumePoint};
use crate::report::BakeFigures;

/// Deviation of a mesh of unknown origin, as a share of the diagonal.
const USUAL_DEVIATION: f64 = 1e-3;

/// The result with new textures.
pub(super) struct TexturedResult {
    pub mesh: StoredMesh,
    /// A part and a material for each image.
    pub catalogue: Catalogue,
    pub figures: BakeFigures,
    /// Expected memory of the work, in bytes.
    pub work_bytes: u64,
    /// What was lost.
    pub findings: Findings,
}

/// What a bake needs of the input.
pub(super) struct Kept {
    /// The surface.
    pub surface: OriginalSurface,
    /// Its images.
    pub images: TextureImages,
    /// What the passes see of the parts and materials.
    pub geometry: Catalogue,
    /// Images that are missing or refused.
    pub findings: Findings,
}

/// The bake of a job.
pub(super) struct Texturing<'a> {
    job: &'a Preflight<'a>,
    input: &'a Input,
    limits: WorkLimits,
    /// What is needed of the input; `None` if nothing is baked.
    kept: Option<Kept>,
}

impl<'a> Texturing<'a> {
    /// Keeps the surface of the input, and takes its texture away from the mesh that the passes begin with.
    ///
    /// # Errors
    /// [`Error::Budget`] if an image does not fit the memory; on a full disk, failed reads and writes.
    pub fn prepare(
        job: &'a Preflight<'a>,
        input: &'a Input,
        start: &mut ResumePoint,
        work: &WorkFolder,
        admission: &Admission,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let limits = WorkLimits { threads: job.threads, work_bytes: admission.work_bytes };
        if !job.options.bakes() {
            return Ok(Self { job, input, limits, kept: None });
        }
        let side = job.options.atlas;
        let needed = bake::image_bytes(side);
        if needed > limits.work_bytes {
            let needed = job.budget.bytes + needed - limits.work_bytes;
            let option = if job.kind == OutputKind::Folder { "tile_side" } else { "atlas" };
            let message = format!(
                "`memory: {}` cannot hold an image of {side} x {side} texels; give `memory: {}` or a smaller `{option}`",
                bytes::display(job.budget.bytes),
                bytes::display(needed),
            );
            return Err(Error::Budget { needed: Some(needed), message });
        }
        let mut findings = Findings::default();
        let mut images = find_images(job, &input.catalogue, &mut findings);
        let geometry = bake::geometry_catalogue(&input.catalogue, &images);
        images.add_plain_colours(&input.catalogue);
        let surface = match start.unsimplified() {
            Some(mesh) => {
                let place = BakePlace { work, limits, progress };
                OriginalSurface::prepare(mesh, &input.catalogue, &images, &place)?
            }
            None => OriginalSurface::recall(work)?.ok_or_else(|| Error::Damaged {
                path: work.path().to_owned(),
                message: "what was kept of the input's surface is gone".into(),
            })?,
        };
        start.state.mesh.drop_colours();
        Ok(Self { job, input, limits, kept: Some(Kept { surface, images, geometry, findings }) })
    }

    /// What is needed of the input; `None` if nothing is baked.
    pub fn into_kept(self) -> Option<Kept> {
        self.kept
    }

    /// Parts and materials as the passes see them.
    pub fn catalogue(&self) -> &Catalogue {
        self.kept.as_ref().map_or(&self.input.catalogue, |kept| &kept.geometry)
    }

    /// Bakes textures for the result of passes; `None` if it keeps its own.
    ///
    /// # Errors
    /// Those of [`bake::bake`].
    pub fn bake(self, passes: &Passes, work: &WorkFolder, progress: &dyn Progress) -> Result<Option<TexturedResult>> {
        let last = passes.reports.last().and_then(|pass| pass.stages.last());
        let estimate = last.map_or(0.0, |stage| stage.rms_estimate);
        self.bake_mesh(&passes.mesh, &passes.step, Some(estimate), work, progress)
    }

    /// Bakes textures for a mesh that a step recorded, and that deviates from the input by about `deviation`.
    ///
    /// # Errors
    /// Those of [`bake::bake`].
    pub fn bake_mesh(
        self,
        mesh: &StoredMesh,
        step: &StepKey,
        deviation: Option<f64>,
        work: &WorkFolder,
        progress: &dyn Progress,
    ) -> Result<Option<TexturedResult>> {
        let Some(Kept { surface, images, mut findings, .. }) = self.kept else { return Ok(None) };
        let options = self.job.options;
        let deviation = deviation.unwrap_or_else(|| USUAL_DEVIATION * surface.diagonal());
        let settings = BakeSettings {
            texels: options.texels,
            side: options.atlas,
            format: options.image,
            deviation: options.target.max_error.unwrap_or(deviation),
        };
        let catalogue = &self.input.catalogue;
        let result = Unbaked { mesh, catalogue, step };
        let place = BakePlace { work, limits: self.limits, progress };
        let baked = bake::bake(surface, &images, &result, &settings, &place)?;
        findings.merge(baked.findings);
        let figures = baked.figures;
        Ok(Some(TexturedResult {
            mesh: baked.mesh,
            catalogue: baked.catalogue,
            figures: BakeFigures {
                images: figures.images,
                texels: figures.texels,
                fill: figures.covered as f64 / (figures.texels as f64).max(1.0),
                colourless: figures.colourless,
                charts: figures.charts,
                texel: figures.texel,
            },
            work_bytes: {
                let size = BakeSize { texels: figures.texels, images: figures.images, faces: mesh.face_count() };
                size.expected_bytes(options.atlas, self.limits.threads).min(self.limits.work_bytes)
            },
            findings,
        }))
    }
}
