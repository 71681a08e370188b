//! Renderings of the mesh before and after.

use std::path::Path;

use crate::base::{Findings, Progress, Result};
use crate::model::{Catalogue, StoredMesh};
use crate::report::gallery::{self, Shot, Viewpoints};
use crate::report::scene::DrawResources;
use crate::report::scene::StoredScene;

/// Width and height of a map of the clusters, in pixels.
pub(super) const MAP_SIZE: [usize; 2] = [600, 400];
/// Memory that a map takes, in bytes.
pub(super) const MAP_BYTES: u64 = (MAP_SIZE[0] * MAP_SIZE[1]) as u64 * 16;

/// Draws the meshes of a run. An error becomes a warning, since the result does not need the renderings.
pub(super) struct Painter<'a> {
    pub(super) catalogue: &'a Catalogue,
    pub(super) folder: &'a Path,
    pub(super) resources: DrawResources,
    /// Whether the result is to be coloured by error afterwards.
    pub(super) with_errors: bool,
    pub(super) progress: &'a dyn Progress,
}

impl Painter<'_> {
    /// Renderings of a mesh from the given viewpoints or from its own, with the viewpoints; `None`, and a warning, if
    /// it cannot be drawn.
    pub(super) fn draw(
        &self,
        mesh: &StoredMesh,
        from: Option<Viewpoints>,
        findings: &mut Findings,
    ) -> Option<(Viewpoints, Vec<Shot>)> {
        self.progress.begin("draw", 0, "");
        let drawn = self.try_draw(mesh, from, findings);
        drawn.unwrap_or_else(|error| {
            findings.note("missing_pictures", || error.to_string());
            None
        })
    }

    fn try_draw(
        &self,
        mesh: &StoredMesh,
        from: Option<Viewpoints>,
        findings: &mut Findings,
    ) -> Result<Option<(Viewpoints, Vec<Shot>)>> {
        let scene = StoredScene::new(mesh, self.catalogue, self.folder, findings);
        let with_errors = self.with_errors && from.is_some();
        let Some(from) = from.map_or_else(|| Viewpoints::of(&scene), |from| Ok(Some(from)))? else { return Ok(None) };
        let shots = gallery::draw(&scene, &from, with_errors, &self.resources, findings)?;
        Ok(Some((from, shots)))
    }
}
