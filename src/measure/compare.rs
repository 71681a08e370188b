//! Compares a simplified mesh with its original.
//!
//! ```text
//! original ◀──forward── result      forward: from points of the result to the closest point of the original
//! original ──backward──▶ result     backward: from points of the original; large where something was lost
//! ```
//! Names are those of the JSON that `docs/reference/comparison.md` describes. Lengths are in the mesh's unit, angles in
//! degrees, colours on 0 to 255, shares between 0 and 1.
//!
//! ```text
//! original ── cells ──┐                  ┌── distances, angles        ──▶ geometry
//!    │                ├── direction ─────┤
//! result ──── cells ──┘  both ways       └── pairs of texcoords ──┐
//!    │                                                            ├───▶ texture
//!    ├── seams: what both sides show ─────────────────────────────┘
//!    ├── pinholes: what is seen through                       ──▶ pinholes
//!    └── topology: edges, components, charts, shapes                     ──▶ topology, quality
//! ```
//! Invariant: the numbers depend on the meshes, the number of samples and the seed. They depend on the memory budget
//! only if an image does not fit it; such images are counted.
//!
//! # Memory
//! Independent of the size of the meshes: both are processed in cells of 65,536 triangles; see the files of this
//! folder.
//!
//! # Files
//! Two work folders, `original` and `result`, removed at the end.

mod between;
pub mod cells;
mod contrast;
mod direction;
mod distribution;
mod filter;
mod options;
pub mod pinholes;
mod points;
mod search;
mod seams;
mod slide;
#[cfg(test)]
mod tests;
mod texture;
mod texture_pair;

use std::time::Instant;

pub use self::between::{DistanceFigures, SurfacePair, distances_to};
use self::cells::MeasuredMesh;
use self::direction::{Direction, Way};
use self::distribution::Distribution;
use self::filter::TexelFilter;
pub use self::options::{CompareOptions, Resources, SAMPLES, Spread};
use self::points::Sampling;
use self::texture_pair::OriginalSide;
use super::border::border_deviation;
pub use super::figures::{
    BeforeAfter, Comparison, Distances, FarPoint, Geometry, Histogram, NormalAngles, Pinholes, Quality, ROUNDING_SHARE,
    SLIVER_REGULARITY, SeamFigures, Texture, TopologyCounts, VERSION, WORST_PLACES, WorstView,
};
use super::figures::{is_soup, share};
use crate::base::pool::{Durability, Pool};
use crate::base::{Error, Findings, Progress, Result};
use crate::os::system;
use crate::read::InputChoice;

/// Observer of a comparison, which may draw the meshes; it changes no number.
pub trait Onlooker {
    /// Called when both meshes are ready and nothing else is in memory.
    ///
    /// # Errors
    /// An error ends the comparison.
    fn see_meshes(&mut self, _before: &MeasuredMesh, _after: &MeasuredMesh) -> Result<()> {
        Ok(())
    }

    /// Called for each point of the result by area, in order, with its distance from the original.
    fn see_point(&mut self, _place: &FarPoint) {}
}

/// The observer that does nothing.
impl Onlooker for () {}

/// Approximate number of triangles of a cell.
const CELL_FACES: u64 = 1 << 16;
/// Names of the two meshes, and of their folders in the work folder.
const NAMES: [&str; 2] = ["original", "result"];

/// Compares a result with its original; each is an OBJ, or a folder of them.
///
/// # Errors
/// Those of the scan; [`Error::Input`] for a mesh without triangles; on a full disk, failed reads and writes.
pub fn compare(
    original: impl Into<InputChoice>,
    result: impl Into<InputChoice>,
    options: &CompareOptions,
    onlooker: &mut dyn Onlooker,
    progress: &dyn Progress,
) -> Result<Comparison> {
    let started = Instant::now();
    // A work folder that holds the folders of a comparison was left by a process that was killed.
    let is_own = !options.work.exists() || NAMES.iter().any(|name| options.work.join(name).exists());
    let meshes = [&original.into(), &result.into()];
    let found = Pool::with(options.resources.threads, Durability::None)?
        .run(progress, || compare_in_cells(meshes, options, CELL_FACES, onlooker, progress));
    if is_own {
        let _ = std::fs::remove_dir(&options.work);
    }
    let mut comparison = found?;
    comparison.seconds = started.elapsed().as_secs_f64();
    Ok(comparison)
}

/// Compares meshes in cells of about `cell_faces` triangles.
fn compare_in_cells(
    [original, result]: [&InputChoice; 2],
    options: &CompareOptions,
    cell_faces: u64,
    onlooker: &mut dyn Onlooker,
    progress: &dyn Progress,
) -> Result<Comparison> {
    let prepare = |input: &InputChoice, name: &str| {
        let mesh = MeasuredMesh::prepare(input, &options.work.join(name), cell_faces, &options.resources, progress)?;
        if mesh.surface.cells.is_empty() {
            return Err(Error::input(
                input.name(),
                0,
                "expected triangles, found none; nothing can be compared with it",
            ));
        }
        Ok(mesh)
    };
    let (before, after) = (prepare(original, NAMES[0])?, prepare(result, NAMES[1])?);
    onlooker.see_meshes(&before, &after)?;
    let limit = before.surface.bounds.with(after.surface.bounds).diagonal();
    let mut findings = Findings::default();
    let prepared = |texel| TexelFilter::prepare(&before, texel, &options.resources, &mut findings, progress);
    let have_images = [&before, &after].iter().all(|mesh| !mesh.images.files.is_empty());
    let filter = options.texel.filter(|_| have_images).map(prepared).transpose()?;
    let measured = |[from, to]: [&MeasuredMesh; 2], original, seed, see_point: &mut dyn FnMut(&FarPoint)| {
        let sampling = &Sampling::new(&from.surface, options.spread, seed);
        let way = Way { from, to, original, sampling, filter: filter.as_ref() };
        direction::measure(&way, limit, &options.resources, see_point, progress)
    };
    let (own, other) = (OriginalSide::Own, OriginalSide::Other);
    let forward = measured([&after, &before], other, options.seed, &mut |place| onlooker.see_point(place))?;
    let backward = measured([&before, &after], own, options.seed ^ 1 << 63, &mut |_| {})?;
    let texture = texture::compare([&before, &after], [&forward, &backward], limit, options, &mut findings, progress)?;
    let mut warnings: Vec<String> = Vec::new();
    let pinholes = pinholes::find(&before, &after, options.resources.work_bytes, &mut warnings, progress)?;
    let geometry = geometry(&before, &after, &forward, &backward);
    let topology = BeforeAfter { before: before.counts.topology, after: after.counts.topology };
    let quality = BeforeAfter { before: Quality::of(&before.counts), after: Quality::of(&after.counts) };
    for (name, mesh) in NAMES.into_iter().zip([&before, &after]) {
        warnings.extend(mesh.findings.warnings().into_iter().map(|words| format!("{name}: {words}")));
    }
    warnings.extend(findings.warnings());
    if forward.cut + backward.cut > 0 {
        let count = forward.cut + backward.cut;
        let bound = forward.bound.max(backward.bound);
        warnings.push(format!(
            "{count} points were given up, since triangles lie across each other by the thousand: means are of fewer points, and \
             the largest distance may be up to {bound}"
        ));
    }
    Ok(Comparison {
        version: VERSION,
        original: original.name().to_owned(),
        result: result.name().to_owned(),
        samples: options.spread.by_area(),
        texel: options.texel,
        seed: options.seed,
        geometry,
        texture,
        pinholes,
        topology,
        quality,
        seconds: 0.0,
        peak_resident: system::peak_resident_bytes(),
        warnings,
    })
}

fn geometry(before: &MeasuredMesh, after: &MeasuredMesh, forward: &Direction, backward: &Direction) -> Geometry {
    let mut both = forward.distances.clone();
    both.merge(&backward.distances);
    let mut worst: Vec<FarPoint> = forward.worst.iter().chain(&backward.worst).copied().collect();
    worst.sort_by(|a, b| b.distance.total_cmp(&a.distance));
    worst.truncate(WORST_PLACES);
    let half = |a: f64, b: f64| 0.5 * (a + b);
    let [f, b] = [&forward.distances, &backward.distances];
    let symmetric = Distances {
        mean: half(f.mean(), b.mean()),
        rms: half(f.rms().powi(2), b.rms().powi(2)).sqrt(),
        ..distances(&both, worst, forward.cut + backward.cut, forward.bound.max(backward.bound))
    };
    let volume = |mesh: &MeasuredMesh| (mesh.counts.topology.boundary_edges == 0).then_some(mesh.volume);
    let volume = BeforeAfter { before: volume(before), after: volume(after) };
    let has_borders = [before, after].iter().all(|mesh| !is_soup(&mesh.counts.topology));
    let border = match (&before.border, &after.border) {
        (Some(old), Some(new)) if !old.is_empty() && has_borders => Some(border_deviation(old, new)),
        _ => None,
    };
    Geometry {
        diagonal: before.surface.bounds.diagonal(),
        forward: distances(&forward.distances, forward.worst.clone(), forward.cut, forward.bound),
        backward: distances(&backward.distances, backward.worst.clone(), backward.cut, backward.bound),
        symmetric,
        normals: NormalAngles {
            mean: forward.angles.mean(),
            p95: forward.angles.quantile(0.95),
            flipped: share(forward.flipped, forward.angles.count()),
        },
        area: BeforeAfter { before: before.area, after: after.area },
        area_ratio: if before.area > 0.0 { after.area / before.area } else { 0.0 },
        volume,
        volume_ratio: volume.before.zip(volume.after).filter(|(old, _)| *old != 0.0).map(|(old, new)| new / old),
        border,
    }
}

fn distances(distances: &Distribution, worst: Vec<FarPoint>, cut_searches: u64, max_bound: f64) -> Distances {
    Distances {
        max: worst.first().map_or(0.0, |place| place.distance),
        mean: distances.mean(),
        rms: distances.rms(),
        median: distances.quantile(0.5),
        p95: distances.quantile(0.95),
        p99: distances.quantile(0.99),
        worst,
        histogram: distances.histogram(),
        cut_searches,
        max_bound,
    }
}
