//! What a simplification did to a mesh: everything that comparing a result with its original finds.
//!
//! ```text
//! original ◀──forward── result      forward: from points of the result to the closest point of the original
//! original ──backward──▶ result     backward: from points of the original; large where something was lost
//! ```
//! Names are those of the JSON that `docs/reference/comparison.md` describes. Lengths are in the mesh's unit, angles in degrees,
//! colours on 0 to 255, shares between 0 and 1.
//!
//! ```text
//! original ── cells ──┐                  ┌── distances, angles        ──▶ geometry
//!    │                ├── direction ─────┤
//! result ──── cells ──┘  both ways       └── pairs of texcoords ──┐
//!    │                                                            ├───▶ texture
//!    ├── seams: what both sides show ─────────────────────────────┘
//!    ├── pinholes: what is seen through                       ──▶ pinholes
//!    └── tally: edges, pieces, charts, shapes                         ──▶ topology, quality
//! ```
//! Invariant: the numbers depend on the meshes, the number of samples and the seed; on the memory budget only if an image
//! does not fit it, which is counted.
//!
//! # Memory
//! Whatever the size of the meshes, both are worked through in cells of 65,536 triangles: see the files of this folder.
//!
//! # Files
//! Two work folders, `original` and `result`, removed at the end.

pub mod cells;
pub mod closest;
pub mod colour;
mod contrast;
mod direction;
mod distribution;
pub mod pictures;
pub mod pinholes;
mod points;
mod search;
mod seams;
mod slide;
mod tally;
#[cfg(test)]
mod tests;
mod texture;
pub mod tilted;

use std::path::PathBuf;
use std::time::Instant;

use serde::Serialize;

use self::cells::MeasuredMesh;
use self::direction::Direction;
use self::distribution::Distribution;
use self::pinholes::Pinholes;
use self::points::Sampling;
pub use self::points::Spread;
use super::border::{BorderDeviation, border_deviation};
use crate::base::threads::make_pool;
use crate::base::{Error, Findings, Progress, Result, json_path};
use crate::os::system;
use crate::scan::{InputChoice, ScanOptions};

/// Version of the JSON's form.
pub const VERSION: u32 = 1;
/// Distances below this share of the original's diagonal are roundings.
pub const ROUNDING_SHARE: f64 = 1e-12;

/// A figure of the original and of the result.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct BeforeAfter<T> {
    /// Of the original.
    pub before: T,
    /// Of the result.
    pub after: T,
}

/// Everything that comparing two meshes finds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// [`VERSION`].
    pub version: u32,
    /// The original, as named.
    #[serde(serialize_with = "json_path::lossy")]
    pub original: PathBuf,
    /// The result, as named.
    #[serde(serialize_with = "json_path::lossy")]
    pub result: PathBuf,
    /// Points by area on each of the two surfaces; nothing if distances were taken at vertices.
    pub samples: Option<u64>,
    /// Seed of the points.
    pub seed: u64,
    /// Distances between the surfaces.
    pub geometry: Geometry,
    /// How the picture changed; nothing if one of the meshes has none, or none that can be read.
    pub texture: Option<Texture>,
    /// Where one sees through the result; nothing if the original has no extent.
    pub pinholes: Option<Pinholes>,
    /// Counts of edges and pieces, after welding.
    pub topology: BeforeAfter<Topology>,
    /// Shapes of triangles.
    pub quality: BeforeAfter<Quality>,
    /// Time in seconds.
    pub seconds: f64,
    /// Peak resident memory of the process so far, in bytes.
    pub peak_resident: u64,
    /// What was ignored or could not be measured, in words.
    pub warnings: Vec<String>,
}

/// Distances between the surfaces, and what follows from their shapes.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Geometry {
    /// Diagonal of the original's bounding box.
    pub diagonal: f64,
    /// From the result to the original.
    pub forward: Distances,
    /// From the original to the result.
    pub backward: Distances,
    /// Both ways together, with equal weight.
    pub symmetric: Distances,
    /// Angles between the normals of the result and of the original at its closest point.
    pub normals: Normals,
    /// Areas.
    pub area: BeforeAfter<f64>,
    /// Area of the result per area of the original.
    pub area_ratio: f64,
    /// Enclosed volumes; nothing for a mesh with open borders.
    pub volume: BeforeAfter<Option<f64>>,
    /// Volume of the result per volume of the original, if both are closed.
    pub volume_ratio: Option<f64>,
    /// How far the open borders of the result lie from those of the original; a seam that came apart inside the surface
    /// is far from them. Nothing if the original has no border, or a mesh more of it than fits the memory budget, or if one is
    /// a soup of triangles.
    pub border: Option<BorderDeviation>,
}

/// Distances in one direction.
///
/// `max` is over points by area, all vertices, and points on edges; everything else over points by area alone, so that
/// it is a mean over the surface.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Distances {
    /// Largest distance (one-sided Hausdorff distance).
    pub max: f64,
    /// Mean.
    pub mean: f64,
    /// Root of the mean square.
    pub rms: f64,
    /// Half of the surface is nearer.
    pub median: f64,
    /// 95 % of the surface is nearer.
    pub p95: f64,
    /// 99 % of the surface is nearer.
    pub p99: f64,
    /// The places of the largest distances, the largest first: at most one in each cell of the mesh, at most
    /// [`WORST_PLACES`].
    pub worst: Vec<Place>,
    /// How much of the surface is how far.
    pub histogram: Histogram,
    /// Points that were given up, where triangles lie across each other by the thousand. Others of them, near by, that were
    /// searched to the end speak for them in the means.
    pub cut_searches: u64,
    /// No point is farther than this: `max`, unless points were given up, which may lie between.
    pub max_bound: f64,
}

/// Number of places that are told, at most.
pub const WORST_PLACES: usize = 8;

/// A point of a surface and what is nearest to it on the other one.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Place {
    /// Distance.
    pub distance: f64,
    /// The point.
    pub position: [f64; 3],
    /// The closest point of the other surface.
    pub closest: [f64; 3],
}

/// Shares of the surface by distance.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Histogram {
    /// Distances, ascending: bin i reaches from edge i to edge i + 1. The first is 0, the next ones grow by a fixed factor.
    pub edges: Vec<f64>,
    /// Share of the surface in each bin; one less than there are edges.
    pub shares: Vec<f64>,
}

/// Angles between normals.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Normals {
    /// Mean, in degrees.
    pub mean: f64,
    /// 95 % of the surface is nearer, in degrees.
    pub p95: f64,
    /// Share of the surface that is turned by more than 90°.
    pub flipped: f64,
}

/// How the picture on the surface changed.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Texture {
    /// Mean difference of colour (mean over the channels) between a point of the result and the closest point of the original.
    pub colour_mean: f64,
    /// Root of the mean squared difference.
    pub colour_rms: f64,
    /// The same from points of the original to the result.
    pub colour_backward_mean: f64,
    /// Root of the mean squared difference from points of the original to the result.
    pub colour_backward_rms: f64,
    /// Mean slide: from where the picture at a point of the result lies on the original to the closest point there. Slides
    /// are measured on images that the original shows once; `None` if there are none.
    pub slide_mean: Option<f64>,
    /// Half of the surface slid by less.
    pub slide_median: Option<f64>,
    /// 95 % of the surface slid by less.
    pub slide_p95: Option<f64>,
    /// Half of the surface slid by less, in texels of the original's image.
    pub slide_texels_median: Option<f64>,
    /// 95 % of the surface slid by less, in texels of the original's image.
    pub slide_texels_p95: Option<f64>,
    /// Share of the result's surface whose image the original shows more than once, so that its drift is unknown.
    pub repeated_fraction: f64,
    /// Share of the result's other textured surface that shows no chart of the original.
    pub outside_fraction: Option<f64>,
    /// Share of the result's surface that shows no image of the original.
    pub untextured_fraction: f64,
    /// Triangles of the result that run against the majority of their chart in texture space.
    pub folded_triangles: u64,
    /// Those of the original.
    pub folded_triangles_before: u64,
    /// What meets along seams.
    pub seams: BeforeAfter<Seams>,
    /// Images that were read.
    pub images: u64,
    /// Images that were too large for the memory budget and were read at a lower resolution.
    pub reduced_images: u64,
}

/// What meets along the seams of a mesh: edges between two faces that show different places of images.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Seams {
    /// Length of all seams.
    pub length: f64,
    /// Mean difference of colour between the two sides.
    pub colour_mean: f64,
    /// Root of the mean squared difference.
    pub colour_rms: f64,
    /// How far apart the two texels lie on the original that meet at a point of a seam: half of the length by less. Gaps
    /// are measured on images that the original shows once; `None` if no seam has such an image.
    pub gap_median: Option<f64>,
    /// 95 % of the length by less.
    pub gap_p95: Option<f64>,
    /// The same as `gap_median` in texels of the image on one side.
    pub gap_texels_median: Option<f64>,
    /// The same as `gap_p95` in texels.
    pub gap_texels_p95: Option<f64>,
    /// Share of the length of which a side shows no chart of the original.
    pub outside_fraction: Option<f64>,
}

/// Counts after welding vertices at bit-identical positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Topology {
    /// Vertices that faces use.
    pub vertices: u64,
    /// Edges.
    pub edges: u64,
    /// Triangles, without those that repeat a vertex.
    pub faces: u64,
    /// Edges of one face.
    pub boundary_edges: u64,
    /// Sets of boundary edges that hang together over vertices.
    pub boundary_loops: u64,
    /// Edges of three or more faces.
    pub non_manifold_edges: u64,
    /// Edges of two faces that are folded onto each other, back to back.
    pub folded_edges: u64,
    /// Sets of faces that hang together over edges.
    pub components: u64,
    /// Vertices - edges + faces.
    pub euler: i64,
    /// Edges of two faces that differ there in texture coordinate or material.
    pub seam_edges: u64,
    /// Sets of textured faces that hang together over edges that are no seams.
    pub charts: u64,
    /// Faces that repeat a vertex.
    pub degenerate_faces: u64,
}

/// Open edges up to which a mesh of more of them than triangles is not a soup: a single square has more.
const SOUP_EDGES: u64 = 100_000;

impl Topology {
    /// Whether the mesh is a soup of triangles, most of which hang together with few others: its open edges are no border.
    fn is_soup(&self) -> bool {
        self.boundary_edges > SOUP_EDGES.max(self.faces)
    }
}

/// Shapes of triangles.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Quality {
    /// Mean of 4 √3 area / Σ side², which is 1 for an equilateral triangle and 0 for one without area.
    pub regularity_mean: f64,
    /// Share of triangles below a regularity of [`SLIVER_REGULARITY`].
    pub sliver_share: f64,
    /// Mean number of edges at a vertex.
    pub valence_mean: f64,
    /// Most edges at a vertex.
    pub valence_max: u64,
    /// Share of inner vertices with 5, 6 or 7 edges.
    pub valence_regular_share: f64,
}

/// A triangle is a sliver if its regularity is below this (as Li, Jiang and Tang 2020 count them): an isosceles one
/// lower than a quarter of its base, about.
pub const SLIVER_REGULARITY: f64 = 0.5;

/// How meshes are compared.
#[derive(Debug, Clone)]
pub struct CompareOptions {
    /// Where distances are taken on each surface.
    pub spread: Spread,
    /// Seed of the points.
    pub seed: u64,
    /// Folder for the two work folders.
    pub work: PathBuf,
    /// What the comparison may use.
    pub resources: Resources,
}

/// What a comparison may use; it does not change the numbers.
#[derive(Debug, Clone, Copy)]
pub struct Resources {
    /// Threads, at least 1.
    pub threads: usize,
    /// Memory in bytes.
    pub work_bytes: u64,
    /// How the meshes are read.
    pub scan: ScanOptions,
}

/// Triangles of a cell, about. Numbers that are measured depend on it by their last digits.
const CELL_FACES: u64 = 1 << 16;

/// Looks on while two meshes are compared, to draw them; it changes no number.
pub trait Onlooker {
    /// Both meshes are ready, and nothing else is in memory.
    ///
    /// # Errors
    /// End the comparison.
    fn see_meshes(&mut self, _before: &MeasuredMesh, _after: &MeasuredMesh) -> Result<()> {
        Ok(())
    }

    /// A point of the result by area, and its distance from the original; points come in their order.
    fn see_point(&mut self, _place: &Place) {}
}

/// Nobody looks on.
impl Onlooker for () {}

/// What the two meshes are called, and their folders in the work folder.
const NAMES: [&str; 2] = ["original", "result"];
/// Points by area on each surface, if not said otherwise.
pub const SAMPLES: u64 = 1_000_000;

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
    make_pool(options.resources.threads)?;
    // One with the folders of a comparison in it was left by a process that was killed.
    let is_own = !options.work.exists() || NAMES.iter().any(|name| options.work.join(name).exists());
    let found = compare_in_cells([&original.into(), &result.into()], options, CELL_FACES, onlooker, progress);
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
        if mesh.cells.is_empty() {
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
    let limit = before.bounds.with(after.bounds).diagonal();
    let measured = |from, to, seed, see_point: &mut dyn FnMut(&Place)| {
        let sampling = Sampling::new(from, options.spread, seed);
        direction::measure(from, to, &sampling, limit, &options.resources, see_point, progress)
    };
    let forward = measured(&after, &before, options.seed, &mut |place| onlooker.see_point(place))?;
    let backward = measured(&before, &after, options.seed ^ 1 << 63, &mut |_| {})?;
    let mut findings = Findings::default();
    let texture = texture::compare([&before, &after], [&forward, &backward], limit, options, &mut findings, progress)?;
    let pinholes = pinholes::find(&before, &after, options.resources.work_bytes, progress)?;
    let geometry = geometry(&before, &after, &forward, &backward);
    let topology = BeforeAfter { before: before.tallied.topology, after: after.tallied.topology };
    let quality = BeforeAfter { before: before.tallied.quality, after: after.tallied.quality };
    let mut warnings: Vec<String> = Vec::new();
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
    let mut worst: Vec<Place> = forward.worst.iter().chain(&backward.worst).copied().collect();
    worst.sort_by(|a, b| b.distance.total_cmp(&a.distance));
    worst.truncate(WORST_PLACES);
    let half = |a: f64, b: f64| 0.5 * (a + b);
    let [f, b] = [&forward.distances, &backward.distances];
    let symmetric = Distances {
        mean: half(f.mean(), b.mean()),
        rms: half(f.rms().powi(2), b.rms().powi(2)).sqrt(),
        ..distances(&both, worst, forward.cut + backward.cut, forward.bound.max(backward.bound))
    };
    let volume = |mesh: &MeasuredMesh| (mesh.tallied.topology.boundary_edges == 0).then_some(mesh.volume);
    let volume = BeforeAfter { before: volume(before), after: volume(after) };
    let has_borders = [before, after].iter().all(|mesh| !mesh.tallied.topology.is_soup());
    let border = match (&before.tallied.border, &after.tallied.border) {
        (Some(old), Some(new)) if !old.is_empty() && has_borders => Some(border_deviation(old, new)),
        _ => None,
    };
    Geometry {
        diagonal: before.bounds.diagonal(),
        forward: distances(&forward.distances, forward.worst.clone(), forward.cut, forward.bound),
        backward: distances(&backward.distances, backward.worst.clone(), backward.cut, backward.bound),
        symmetric,
        normals: Normals {
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

fn distances(distances: &Distribution, worst: Vec<Place>, cut_searches: u64, max_bound: f64) -> Distances {
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

fn share(part: u64, of: u64) -> f64 {
    if of == 0 { 0.0 } else { part as f64 / of as f64 }
}
