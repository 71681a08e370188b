//! The levels: whole meshes, each as coarse as its texels allow.
//!
//! ```text
//! level 0 = the input ── passes of about 1.7 : 1 ──▶ mesh 1 ──▶ mesh 2 ──▶ mesh 3 ──▶ …     each measured against the
//!                                                      │                    │               input, both ways
//!                                           the last within        the last within
//!                                          2 texels: level 1      4 texels: level 2
//! ```
//! Invariant: 99 % of a level's surface lies within a texel of the level from the input, and of the input from it. The last
//! level fits one tile, unless the passes cannot go on.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::scene::TileScene;
use super::settings::{TilePlace, TileSettings};
use super::steps::TileStep;
use crate::bake::Original;
use crate::base::{Error, Result};
use crate::image::textures::TextureImages;
use crate::job::{Recalled, Step, StepKey};
use crate::measure::compare::{DistanceFigures, SurfacePair};
use crate::model::Catalogue;
use crate::passes::steps::PassStep;
use crate::passes::{PassKind, PassOptions, ResumePoint, Run};
use crate::surface::cells::{SurfaceCells, SurfacePlace};

/// Share of its faces that a pass keeps, about.
const PASS_SHARE: f64 = 1.0 / 1.7;
/// Faces that the passes end at, unless that is more than half a tile.
const LAST_FACES: u64 = 500;
/// Points by area on each surface for its distance from the input: at first, and if these leave it open which level a mesh
/// is, or it is one.
const FIRST_SAMPLES: u64 = 10_000;
const SAMPLES: u64 = 100_000;
/// Factor by which the distance that the first points show is taken to be wrong at most.
const UNSURE: f64 = 1.25;
/// Levels at most.
pub(super) const LEVELS_MAX: u32 = 40;

/// A mesh after a pass.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PassMesh {
    /// Number of the pass, from 1; 0 for the input.
    pub pass: u32,
    /// Triangles.
    pub faces: u64,
    /// Area.
    pub area: f64,
    /// Distances to the input.
    pub to_input: DistanceFigures,
    /// Distances from the input.
    pub from_input: DistanceFigures,
    /// Points on each surface by which they are known.
    samples: u64,
}

impl PassMesh {
    /// Distance within which 99 % of both surfaces lie from the other one.
    pub fn deviation(&self) -> f64 {
        self.to_input.p99.max(self.from_input.p99)
    }
}

/// What is known after a pass.
#[derive(Debug, Serialize, Deserialize)]
struct MeasuredPass {
    surface: SurfaceCells,
    /// The mesh of each level so far, level 0 first, and the newest mesh.
    levels: Vec<PassMesh>,
    newest: PassMesh,
}

impl Recalled for MeasuredPass {
    type Context<'a> = ();

    fn locate(&mut self, folder: &Path, (): &()) {
        self.surface.locate(folder);
    }

    fn is_sound(&self, (): &()) -> bool {
        self.surface.is_sound() && !self.levels.is_empty()
    }
}

/// A level.
#[derive(Debug)]
pub struct Level {
    /// Its mesh.
    pub mesh: PassMesh,
    /// Its surface; `None` for that of the input.
    pub surface: Option<Arc<SurfaceCells>>,
}

/// What levels are made of.
pub struct Chain<'a> {
    /// The input.
    pub original: &'a Original,
    /// Where it lies.
    pub scene: &'a TileScene,
    /// How tiles are made.
    pub settings: &'a TileSettings,
    /// Parts and materials as the passes see them.
    pub catalogue: &'a Catalogue,
    /// Where it is built.
    pub place: &'a TilePlace<'a>,
}

/// Passes from an input of `faces` down to [`last_faces`].
pub fn pass_count(faces: u64, tile_faces: u64) -> usize {
    let share = last_faces(faces, tile_faces) as f64 / faces.max(1) as f64;
    (libm::log(share) / libm::log(PASS_SHARE)).ceil().max(1.0) as usize
}

/// Faces that the passes end at, for an input of `faces` and tiles of up to `tile_faces`.
pub fn last_faces(faces: u64, tile_faces: u64) -> u64 {
    LAST_FACES.min(faces).min(tile_faces / 2).max(1)
}

impl Chain<'_> {
    /// Simplifies until a level fits one tile.
    ///
    /// # Errors
    /// If the job was stopped; on a full disk, failed reads and writes, and damaged files.
    pub fn levels(&self, start: ResumePoint, options: &PassOptions) -> Result<Vec<Level>> {
        let Self { place, catalogue, .. } = *self;
        let mut run = Run::resume(start, options, catalogue, place.work, place.progress)?;
        let mut known = self.recall(run.passes_done() as u32)?;
        while !self.fits_one(&known.levels) {
            if known.newest.pass as usize == run.passes_done() {
                run.keep_steps([known.forget_others(), self.original.image_steps()].concat());
                if !self.pass(&mut run)? {
                    break;
                }
            }
            self.measure(&run, &mut known)?;
        }
        // If the passes have ended, the last mesh is that of all further levels.
        if !self.fits_one(&known.levels) {
            known.newest = self.measured_well(known.newest, &known.surfaces)?;
        }
        while !self.fits_one(&known.levels) && known.levels.len() < LEVELS_MAX as usize {
            known.levels.push(known.newest);
            if known.newest.faces > self.settings.limits().faces && self.fits_texels(&known.levels) {
                break;
            }
        }
        Ok(known.into_levels())
    }

    /// What an earlier process measured up to a pass.
    fn recall(&self, passes_done: u32) -> Result<KnownMeshes> {
        let recall = |pass| self.place.work.recall::<MeasuredPass>(&TileStep::Surface { pass }.key(), &());
        for pass in (1..=passes_done).rev() {
            let Some(MeasuredPass { surface, levels, newest }) = recall(pass)? else { continue };
            let mut surfaces = BTreeMap::from([(newest.pass, surface)]);
            for &PassMesh { pass, .. } in levels.iter().filter(|mesh| mesh.pass > 0 && mesh.pass != newest.pass) {
                let measured = recall(pass)?.ok_or_else(|| Error::Damaged {
                    path: self.place.work.path().to_owned(),
                    message: format!("the mesh after pass {pass} is gone; `resume: never` starts over"),
                })?;
                surfaces.insert(pass, measured.surface);
            }
            return Ok(KnownMeshes { levels, newest, surfaces });
        }
        let none = DistanceFigures::default();
        let (faces, area) = (self.original.surface.face_count(), self.original.surface.area());
        let newest = PassMesh { pass: 0, faces, area, to_input: none, from_input: none, samples: SAMPLES };
        Ok(KnownMeshes { levels: vec![newest], newest, surfaces: BTreeMap::new() })
    }

    /// Runs the next pass; returns whether there was one.
    fn pass(&self, run: &mut Run<'_>) -> Result<bool> {
        let Some(pass) = run.next_pass() else { return Ok(false) };
        let partition = run.partition(pass)?;
        if let PassKind::Collapse = pass.kind {
            let stops = run.choose_stops(pass, &partition)?;
            run.simplify_clusters(pass, &partition, &stops)?;
        }
        Ok(run.mesh().face_count() > 0)
    }

    /// Keeps the surface after a pass, measures it, and learns which levels the mesh before it is.
    fn measure(&self, run: &Run<'_>, known: &mut KnownMeshes) -> Result<()> {
        let Self { place, scene, .. } = *self;
        let pass = run.passes_done() as u32;
        let key = TileStep::Surface { pass }.key();
        let TilePlace { work, limits, progress, .. } = *place;
        let place = SurfacePlace { folder: work.path(), name: key.name(), limits, progress };
        let none = TextureImages::none(self.catalogue);
        let surface = SurfaceCells::make(run.mesh(), self.catalogue, &none, &place)?;
        progress.begin("measure", 0, "");
        let before = known.newest;
        known.newest = self.measured(pass, &surface, FIRST_SAMPLES)?;
        if self.is_unsure(&known.newest, known.levels.len()) {
            known.newest = self.measured(pass, &surface, SAMPLES)?;
        }
        let is_coarser = |levels: &[PassMesh]| known.newest.deviation() > scene.texel_of(levels.len() as u32);
        if is_coarser(&known.levels) {
            let before = self.measured_well(before, &known.surfaces)?;
            while is_coarser(&known.levels) && !self.fits_one(&known.levels) && known.levels.len() < LEVELS_MAX as usize
            {
                known.levels.push(before);
            }
        }
        let measured = MeasuredPass { surface, levels: known.levels.clone(), newest: known.newest };
        let step = Step::new(key).from([PassStep::mesh_after(pass as usize)]).of_size(known.newest.faces);
        work.keep(step, measured.surface.path(), &measured)?;
        known.surfaces.insert(pass, measured.surface);
        Ok(())
    }

    /// The mesh after a pass, measured at some points on its surface and on the input.
    fn measured(&self, pass: u32, surface: &SurfaceCells, samples: u64) -> Result<PassMesh> {
        let TilePlace { limits, progress, .. } = *self.place;
        let between = |from, to| SurfacePair { from, to }.distances(samples, limits, progress);
        let (to_input, from_input) =
            (between(surface, &self.original.surface)?, between(&self.original.surface, surface)?);
        Ok(PassMesh { pass, faces: surface.face_count(), area: surface.area(), to_input, from_input, samples })
    }

    /// A mesh that becomes a level, measured at as many points as those are.
    fn measured_well(&self, mesh: PassMesh, surfaces: &BTreeMap<u32, SurfaceCells>) -> Result<PassMesh> {
        match surfaces.get(&mesh.pass) {
            Some(surface) if mesh.samples < SAMPLES => self.measured(mesh.pass, surface, SAMPLES),
            _ => Ok(mesh),
        }
    }

    /// Whether a mesh may be coarser than one of the levels from `first` on, or not.
    fn is_unsure(&self, mesh: &PassMesh, first: usize) -> bool {
        let off = |level: u32| mesh.deviation() / self.scene.texel_of(level);
        (first as u32..=LEVELS_MAX).any(|level| (1.0 / UNSURE..=UNSURE).contains(&off(level)))
    }

    /// Whether the coarsest level fits one tile.
    fn fits_one(&self, levels: &[PassMesh]) -> bool {
        levels.last().is_some_and(|last| last.faces <= self.settings.limits().faces) && self.fits_texels(levels)
    }

    fn fits_texels(&self, levels: &[PassMesh]) -> bool {
        let texel = self.scene.texel_of(levels.len() as u32 - 1);
        levels.last().is_some_and(|last| last.area <= self.settings.limits().texels * texel * texel)
    }
}

/// The meshes so far.
struct KnownMeshes {
    /// That of each level, level 0 first.
    levels: Vec<PassMesh>,
    /// That after the last pass.
    newest: PassMesh,
    /// The surfaces of those that are no input, by pass.
    surfaces: BTreeMap<u32, SurfaceCells>,
}

impl KnownMeshes {
    /// Forgets the surfaces that are no level and not the newest; returns the steps that kept the others.
    fn forget_others(&mut self) -> Vec<StepKey> {
        let Self { levels, newest, surfaces } = self;
        surfaces.retain(|&pass, _| pass == newest.pass || levels.iter().any(|level| level.pass == pass));
        surfaces.keys().map(|&pass| TileStep::Surface { pass }.key()).collect()
    }

    fn into_levels(self) -> Vec<Level> {
        let Self { levels, surfaces, .. } = self;
        let surfaces: BTreeMap<u32, Arc<SurfaceCells>> =
            surfaces.into_iter().map(|(pass, surface)| (pass, Arc::new(surface))).collect();
        levels.into_iter().map(|mesh| Level { surface: surfaces.get(&mesh.pass).cloned(), mesh }).collect()
    }
}
