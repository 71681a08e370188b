//! Builds a pyramid of tiles.
//!
//! ```text
//! files ── read ──▶ mesh ──▶ surface of the input, images ──▶ levels ──▶ tiles ──▶ tileset
//! ```

use std::io::ErrorKind;
use std::path::Path;
use std::time::Instant;

use glam::{DMat4, DVec3};

use super::admission::Admission;
use super::input;
use super::paths::{OutputKind, refused};
use super::preflight::Preflight;
use super::texturing::{Kept, Texturing};
use crate::bake::{BakePlace, Original};
use crate::base::{Error, Progress, Result, WorkLimits};
use crate::job::WorkFolder;
use crate::options::{GeoOrigin, TileOptions, UpAxis};
use crate::os::durable::make_folders;
use crate::os::system;
use crate::passes::PassOptions;
use crate::read::InputChoice;
use crate::report::TileReport;
use crate::tile::{Chain, Pyramid, TILESET, TilePlace, TileScene, TileSettings, last_faces, pass_count};

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
    let job = Preflight::check_output(input.into(), output, &simplify, OutputKind::Folder, options.fingerprint())?;
    let report = job.run(|work| run(&job, options, work, progress))?;
    Ok(TileReport { seconds: started.elapsed().as_secs_f64(), ..report })
}

fn run(
    job: &Preflight<'_>,
    options: &TileOptions,
    work: &mut WorkFolder,
    progress: &dyn Progress,
) -> Result<TileReport> {
    refuse_filled_folder(job.output, work.is_resumed() || options.job.force)?;
    let (input, mut start) = input::read(job, work, progress)?;
    make_folders(job.output)?;
    forget_tileset(job.output)?;
    let mut findings = input.findings.clone();
    let admission = Admission::admit(job, &input, &start, work)?;
    let limits = WorkLimits { threads: job.threads, work_bytes: admission.work_bytes };
    let texturing = Texturing::prepare(job, &input, &mut start, work, &admission, progress)?;
    let pass_options = admission.pass_options(job, texturing.catalogue(), input.triangles, None)?;
    let Some(Kept { surface, geometry }) = texturing.into_kept() else {
        return Err(Error::Usage("`textures`: expected `bake`".into()));
    };
    let place = BakePlace { work, limits, progress };
    let original = Original::open(surface, &input.catalogue, &place, &mut findings)?;

    let triangles = original.surface.face_count();
    if triangles == 0 {
        work.give_up();
        return Err(input::nothing_left(job, &input));
    }
    let scene = TileScene::new(original.surface.bounds, original.median_texel);
    let settings = TileSettings {
        faces: options.tile_faces,
        side: options.tile_side,
        format: options.image,
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
    let levels = chain.levels(start, &pass_options)?;
    let transform = transform(options, scene.origin);
    let pyramid = Pyramid { original: &original, scene: &scene, settings: &settings, transform, place };
    let levels = pyramid.build(&levels)?;
    Ok(TileReport {
        triangles: input.triangles,
        levels,
        seconds: 0.0,
        peak_resident: system::peak_resident_bytes(),
        warnings: findings.warnings(),
    })
}

/// Refuses a folder that holds anything, unless it may hold tiles.
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

/// From the scene, whose z points up, to the world.
fn transform(options: &TileOptions, scene_origin: DVec3) -> DMat4 {
    let turned = match options.up {
        UpAxis::Z => DMat4::IDENTITY,
        UpAxis::Y => DMat4::from_rotation_x(std::f64::consts::FRAC_PI_2),
    };
    let placed = options.origin.map_or(DMat4::IDENTITY, east_north_up);
    placed * turned * DMat4::from_translation(scene_origin)
}

/// From metres east, north and up of a place to earth-centred coordinates.
///
/// # Source
/// NIMA TR8350.2, World Geodetic System 1984.
fn east_north_up(place: GeoOrigin) -> DMat4 {
    const RADIUS: f64 = 6_378_137.0;
    const FLATTENING: f64 = 1.0 / 298.257_223_563;
    let eccentricity_sq = FLATTENING * (2.0 - FLATTENING);
    let (longitude, latitude) = (place.longitude.to_radians(), place.latitude.to_radians());
    let (sin_lon, cos_lon) = (libm::sin(longitude), libm::cos(longitude));
    let (sin_lat, cos_lat) = (libm::sin(latitude), libm::cos(latitude));
    let up = DVec3::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat);
    let east = DVec3::new(-sin_lon, cos_lon, 0.0);
    let north = up.cross(east);
    let normal = RADIUS / (1.0 - eccentricity_sq * sin_lat * sin_lat).sqrt();
    let flat = normal + place.height;
    let middle = DVec3::new(
        flat * cos_lat * cos_lon,
        flat * cos_lat * sin_lon,
        (normal * (1.0 - eccentricity_sq) + place.height) * sin_lat,
    );
    DMat4::from_cols(east.extend(0.0), north.extend(0.0), up.extend(0.0), middle.extend(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_on_earth_is_where_the_formulas_say() {
        let of = |longitude, latitude, height| east_north_up(GeoOrigin { longitude, latitude, height });
        let at = |transform: DMat4| transform.transform_point3(DVec3::ZERO);
        assert!((at(of(0.0, 0.0, 0.0)) - DVec3::new(6_378_137.0, 0.0, 0.0)).length() < 1e-6);
        assert!((at(of(0.0, 90.0, 10.0)) - DVec3::new(0.0, 0.0, 6_356_762.314_245)).length() < 1e-3);
        // PROJ 9: echo 118.9219 32.1038 20 | cct +proj=cart +ellps=WGS84
        let nanjing = of(118.9219, 32.1038, 20.0);
        let east = nanjing.transform_vector3(DVec3::X);
        assert!(east.z == 0.0 && (east.length() - 1.0).abs() < 1e-12);
        assert!(nanjing.transform_vector3(DVec3::Z).dot(at(nanjing)) > 6.3e6);
    }
}
