//! Builds a pyramid of tiles.
//!
//! ```text
//! files ── read ──▶ mesh ──▶ surface of the input, images ──▶ levels ──▶ tiles ──▶ tileset
//! ```

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::{DMat4, DVec3};

use super::admission::Admission;
use super::damage::report_damage;
use super::input;
use super::output::{remember, was_writing};
use super::paths::{OutputKind, refused};
use super::preflight::Preflight;
use super::texturing::{Kept, Texturing};
use crate::bake::{BakePlace, Original};
use crate::base::error::escape;
use crate::base::{Error, Progress, Result, WorkLimits};
use crate::geo::{Crs, EarthFrame, GeoPlace, east_north_up};
use crate::job::WorkFolder;
use crate::options::{TileCompression, TileOptions, UpAxis};
use crate::os::durable::make_folders;
use crate::os::system;
use crate::passes::PassOptions;
use crate::read::{InputChoice, MovePositions, typical_position};
use crate::report::TileReport;
use crate::tile::{Chain, EdgeLengths, Pyramid, TILESET, TilePlace, TileScene, TileSettings, last_faces, pass_count};

/// Builds a pyramid of tiles of meshes in files, or in all files below folders, in a folder.
///
/// # Errors
/// Those of [`simplify`](super::simplify). The tileset is written last; finished tiles are kept: the same call resumes.
pub fn tile(
    input: impl Into<InputChoice>,
    output: &Path,
    options: &TileOptions,
    progress: &dyn Progress,
) -> Result<TileReport> {
    let started = Instant::now();
    options.check()?;
    let simplify = options.simplify_options();
    let mut job = Preflight::check_output(input.into(), output, &simplify, OutputKind::Folder, options.fingerprint())?;
    let frame = earth_frame(options, &job.inputs)?;
    let place = frame.as_ref().map(|frame| frame.origin).or(options.origin);
    job.mover = frame.map(|frame| Box::new(frame) as Box<dyn MovePositions>);
    let report = job.run(progress, |work| run(&job, options, place, work, progress))?;
    Ok(TileReport { seconds: started.elapsed().as_secs_f64(), ..report })
}

fn run(
    job: &Preflight<'_>,
    options: &TileOptions,
    on_earth: Option<GeoPlace>,
    work: &mut WorkFolder,
    progress: &dyn Progress,
) -> Result<TileReport> {
    refuse_filled_folder(job.output, was_writing(work, job.output)? || options.job.force)?;
    let (input, mut start) = input::read(job, work, progress)?;
    make_folders(job.output)?;
    let mut findings = input.findings.clone();
    findings.merge(job.idle.clone());
    let admission = Admission::admit(job, &input, &start, work)?;
    let limits = WorkLimits { threads: job.threads, work_bytes: admission.work_bytes };
    let texturing = Texturing::prepare(job, &input, &mut start, work, &admission, progress)?;
    let pass_options = admission.pass_options(job, texturing.catalogue(), input.triangles, None)?;
    let Some(Kept { surface, images, geometry, findings: of_images }) = texturing.into_kept() else {
        return Err(Error::Usage("`textures`: expected `bake`".into()));
    };
    let place = BakePlace { work, limits, progress };
    findings.merge(of_images);
    let original = Original::open(surface, &images, &place, &mut findings)?;

    let triangles = original.surface.face_count();
    if triangles == 0 {
        work.give_up();
        return Err(input::nothing_left(job, &input));
    }
    let edges = EdgeLengths::of(&original.surface, progress)?;
    let scene = TileScene::new(original.surface.bounds, original.median_texel, edges);
    if let Some([size, step]) = scene.unfit_lengths() {
        work.give_up();
        let words = format!("the mesh is {size:.1e} long, in steps of {step:.1e}, which no viewer can show; scale it");
        return Err(Error::input(job.choice.name(), 0, words));
    }
    let settings = TileSettings {
        faces: options.tile_faces,
        side: options.tile_side,
        format: options.image,
        is_compressed: options.compress == TileCompression::Meshopt,
        error_factor: options.error_factor,
        has_colour: original.has_colour(),
    };
    let place = TilePlace { output: job.output, work, limits, progress };
    let pass_options = PassOptions {
        target: last_faces(triangles, settings.faces),
        passes: pass_count(triangles, settings.faces),
        input: triangles,
        ..pass_options
    };
    let chain = Chain { original: &original, scene: &scene, settings: &settings, catalogue: &geometry, place: &place };
    let levels = chain.levels(start, &pass_options);
    report_damage(work, progress);
    let levels = levels?;
    // An older pyramid stays whole until the first tile of the new one can be written.
    remember(work, job.output)?;
    forget_tileset(job.output)?;
    let transform = transform(options, on_earth, scene.origin);
    let is_moved = options.crs.is_some();
    let pyramid = Pyramid { original: &original, scene: &scene, settings: &settings, transform, is_moved, place };
    let levels = pyramid.build(&levels);
    report_damage(work, progress);
    let levels = levels?;
    if levels.iter().all(|level| level.faces == 0) {
        forget_tileset(job.output)?;
        work.give_up();
        let step = scene.lattice(0).step;
        let words =
            format!("of {triangles} triangles none is left on a lattice with steps of {step:.1e}; scale the mesh");
        return Err(Error::input(job.choice.name(), 0, words));
    }
    Ok(TileReport {
        triangles: input.triangles,
        origin: on_earth,
        levels,
        seconds: 0.0,
        peak_resident: system::peak_resident_bytes(),
        warnings: findings.warnings(),
    })
}

/// Refuses a folder that holds anything, unless it may hold tiles of this job, or tiles that may be replaced.
fn refuse_filled_folder(output: &Path, may_hold_tiles: bool) -> Result<()> {
    match std::fs::read_dir(output).map(|mut entries| entries.next().is_none()) {
        Ok(is_empty) if is_empty || may_hold_tiles => Ok(()),
        Ok(_) => Err(refused(output, "holds files; choose a new or empty folder, or `force`")),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
        Err(error) => Err(refused(output, &format!("the output is a folder for tiles: {error}"))),
    }
}

/// Removes an older tileset: a folder that holds one is complete.
fn forget_tileset(output: &Path) -> Result<()> {
    let path = output.join(TILESET);
    match std::fs::remove_file(&path) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(Error::io(&path, "remove", error)),
        _ => Ok(()),
    }
}

/// Coordinates of the input with z up.
fn z_up(up: UpAxis) -> DMat4 {
    match up {
        UpAxis::Z => DMat4::IDENTITY,
        UpAxis::Y => DMat4::from_rotation_x(std::f64::consts::FRAC_PI_2),
    }
}

/// From the scene to the world.
fn transform(options: &TileOptions, place: Option<GeoPlace>, scene_origin: DVec3) -> DMat4 {
    // A frame on earth has z up.
    let turned = if options.crs.is_some() { DMat4::IDENTITY } else { z_up(options.up) };
    place.map_or(DMat4::IDENTITY, east_north_up) * turned * DMat4::from_translation(scene_origin)
}

/// The frame on earth that the input is read into; `None` for local coordinates.
fn earth_frame(options: &TileOptions, inputs: &[PathBuf]) -> Result<Option<EarthFrame>> {
    let Some(name) = &options.crs else { return Ok(None) };
    let refused = |words: String| Error::Usage(format!("`crs: {}`: {words}", escape(name.as_bytes())));
    let crs = Crs::parse(name).map_err(refused)?;
    let to_crs = DMat4::from_translation(DVec3::from(options.offset)) * z_up(options.up);
    // A mesh without vertices is refused by whoever reads it.
    let Some(position) = typical_position(inputs)? else { return Ok(None) };
    EarthFrame::at(crs, to_crs, position).map(Some).map_err(refused)
}

impl MovePositions for EarthFrame {
    fn moved(&self, position: DVec3) -> Option<DVec3> {
        self.place(position)
    }
}
