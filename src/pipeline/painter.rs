//! Renderings of the mesh before and after.

use std::path::PathBuf;

use super::admission::{Admission, MAP_SIZE};
use super::preflight::Preflight;
use super::publish::FinalMesh;
use crate::base::{Error, Findings, Progress, Result};
use crate::job::WorkFolder;
use crate::model::{Catalogue, StoredMesh};
use crate::options::Drawing;
use crate::render::View;
use crate::report::gallery::{self, Shot, Viewpoints};
use crate::report::scene::DrawResources;
use crate::report::scene::StoredScene;

/// Renderings before and after, from the same viewpoints.
pub(super) type Shots = Option<[Vec<Shot>; 2]>;

/// Memory of drawing in bytes.
pub(super) fn peak_bytes(work_bytes: u64) -> u64 {
    gallery::peak_bytes(work_bytes)
}

/// Draws the meshes of a run. An error becomes a warning, since the result does not need the renderings; a stop ends a job
/// whose result is not complete.
pub(super) struct Painter<'a> {
    catalogue: &'a Catalogue,
    folder: PathBuf,
    resources: DrawResources,
    drawing: Drawing,
    progress: &'a dyn Progress,
    viewpoints: Option<Viewpoints>,
    before: Vec<Shot>,
    after: Option<Vec<Shot>>,
}

impl<'a> Painter<'a> {
    /// Prepares to draw what the options want.
    pub fn new(
        job: &Preflight<'_>,
        catalogue: &'a Catalogue,
        work: &WorkFolder,
        admission: &Admission,
        progress: &'a dyn Progress,
    ) -> Self {
        Self {
            catalogue,
            folder: work.path().to_owned(),
            resources: DrawResources { threads: job.threads, work_bytes: admission.work_bytes },
            drawing: job.options.notes.drawing,
            progress,
            viewpoints: None,
            before: Vec::new(),
            after: None,
        }
    }

    /// Draws the mesh as it was read, if it is still there.
    ///
    /// # Errors
    /// [`Error::Stopped`].
    pub fn draw_before(&mut self, mesh: Option<&StoredMesh>, findings: &mut Findings) -> Result<()> {
        if self.drawing == Drawing::Nothing {
            return Ok(());
        }
        let Some(mesh) = mesh else {
            findings.note("missing_renderings", || "the job resumed when the mesh that it read was gone".into());
            return Ok(());
        };
        let drawn = self.draw(mesh, self.catalogue, None, findings);
        if matches!(drawn, Err(Error::Stopped)) {
            return Err(Error::Stopped);
        }
        if let Some((viewpoints, shots)) = or_warning(drawn, findings) {
            self.viewpoints = Some(viewpoints);
            self.before = shots;
        }
        Ok(())
    }

    /// Draws the result from the same viewpoints. The result is complete: a job that is to stop goes without the drawing.
    pub fn draw_after(&mut self, result: &FinalMesh<'_>, findings: &mut Findings) {
        if let Some(viewpoints) = self.viewpoints.take() {
            let drawn = self.draw(result.mesh, result.catalogue, Some(viewpoints), findings);
            self.after = or_warning(drawn, findings).map(|(_, shots)| shots);
        }
    }

    /// Viewpoint of the maps of clusters; `None` if none are drawn.
    pub fn map(&self) -> Option<View> {
        self.viewpoints.as_ref().map(|viewpoints| viewpoints.map(MAP_SIZE))
    }

    /// Renderings before and after; `None` unless there are both.
    pub fn shots(self) -> Shots {
        Some([self.before, self.after?])
    }

    /// Renderings of a mesh from the given viewpoints or from its own, with the viewpoints; `None` if it has no extent.
    fn draw(
        &self,
        mesh: &StoredMesh,
        catalogue: &Catalogue,
        from: Option<Viewpoints>,
        findings: &mut Findings,
    ) -> Result<Option<(Viewpoints, Vec<Shot>)>> {
        self.progress.begin("draw", 0, "");
        let scene = StoredScene::new(mesh, catalogue, &self.folder, findings);
        let with_errors = self.drawing == Drawing::RenderingsAndErrors && from.is_some();
        let Some(from) = from.map_or_else(|| Viewpoints::of(&scene), |from| Ok(Some(from)))? else { return Ok(None) };
        let shots = gallery::draw(&scene, &from, with_errors, &self.resources, findings)?;
        Ok(Some((from, shots)))
    }
}

/// What was drawn; a warning for what was not.
fn or_warning<T>(drawn: Result<Option<T>>, findings: &mut Findings) -> Option<T> {
    drawn.unwrap_or_else(|error| {
        findings.note("missing_renderings", || error.to_string());
        None
    })
}
