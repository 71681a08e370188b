//! The figures of a comparison, named as in the JSON that `docs/reference/comparison.md` describes.
//!
//! Lengths are in the mesh's unit, angles in degrees, colours on 0 to 255, shares between 0 and 1.

use std::path::PathBuf;

use serde::Serialize;

use crate::base::json_path;
use crate::measure::border::BorderDeviation;
pub use crate::topology::counts::{MeshCounts, SLIVER_REGULARITY, TopologyCounts};

/// Version of the JSON format.
pub const VERSION: u32 = 1;
/// Distances below this share of the original's diagonal count as rounding.
pub const ROUNDING_SHARE: f64 = 1e-12;

/// A figure of the original and of the result.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct BeforeAfter<T> {
    /// Of the original.
    pub before: T,
    /// Of the result.
    pub after: T,
}

/// Result of comparing two meshes.
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
    /// Points by area on each of the two surfaces; `None` if distances were taken at vertices.
    pub samples: Option<u64>,
    /// Seed of the points.
    pub seed: u64,
    /// Length of the texels as which the original's colours were compared; `None`: at points.
    pub texel: Option<f64>,
    /// Distances between the surfaces.
    pub geometry: Geometry,
    /// How the texture changed; `None` if one of the meshes has no texture image, or none that can be read.
    pub texture: Option<Texture>,
    /// Pinholes of the result; `None` if the original has no extent.
    pub pinholes: Option<Pinholes>,
    /// Counts of edges and components, after welding.
    pub topology: BeforeAfter<TopologyCounts>,
    /// Shapes of triangles.
    pub quality: BeforeAfter<Quality>,
    /// Time in seconds.
    pub seconds: f64,
    /// Peak resident memory of the process so far, in bytes; `None` if it [is not the job's
    /// alone](crate::claim_process).
    pub peak_resident: Option<u64>,
    /// Messages about what was ignored or could not be measured.
    pub warnings: Vec<String>,
}

/// Distances between the surfaces, and differences of their shapes.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Geometry {
    /// Diagonal of the original's bounding box.
    pub diagonal: f64,
    /// From the result to the original.
    pub forward: Distances,
    /// From the original to the result.
    pub backward: Distances,
    /// Both directions together, with equal weight.
    pub symmetric: Distances,
    /// Angles between the normals of the result and of the original at its closest point.
    pub normals: NormalAngles,
    /// Areas.
    pub area: BeforeAfter<f64>,
    /// Area of the result per area of the original.
    pub area_ratio: f64,
    /// Enclosed volumes; `None` for a mesh with open borders.
    pub volume: BeforeAfter<Option<f64>>,
    /// Volume of the result per volume of the original, if both are closed.
    pub volume_ratio: Option<f64>,
    /// Distance from the open borders of the result to those of the original; a seam that came apart inside the surface
    /// is far from them. `None` if the original has no border, if the border of a mesh does not fit the memory budget,
    /// or if a mesh is a triangle soup.
    pub border: Option<BorderDeviation>,
}

/// Distances in one direction.
///
/// `max` is over points by area, all vertices, and points on edges. Everything else is over points by area alone, so
/// that it is a mean over the surface.
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
    /// Positions of the largest distances, the largest first: at most one in each cell of the mesh, at most
    /// [`WORST_PLACES`].
    pub worst: Vec<FarPoint>,
    /// Shares of the surface by distance.
    pub histogram: Histogram,
    /// Number of points whose search was abandoned because thousands of triangles overlap there. In the means and
    /// percentiles each of them is represented by a nearby point that was searched to the end.
    pub cut_searches: u64,
    /// Upper bound of all distances: `max`, unless searches were abandoned; those points may lie between `max` and
    /// this.
    pub max_bound: f64,
}

/// Maximum number of reported positions of largest distances.
pub const WORST_PLACES: usize = 8;

/// A point of a surface and the closest point of the other one.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct FarPoint {
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
    /// Distances, ascending: bin i spans edge i to edge i + 1. The first edge is 0; the others grow by a fixed factor.
    pub edges: Vec<f64>,
    /// Share of the surface in each bin; one fewer than `edges`.
    pub shares: Vec<f64>,
}

/// Angles between normals.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct NormalAngles {
    /// Mean, in degrees.
    pub mean: f64,
    /// Angle that 95 % of the surface stays below, in degrees.
    pub p95: f64,
    /// Share of the surface whose normal is turned by more than 90°.
    pub flipped: f64,
}

/// How the texture on the surface changed.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Texture {
    /// Mean colour difference (mean over the channels) between a point of the result and the closest point of the
    /// original.
    pub colour_mean: f64,
    /// Root of the mean squared difference.
    pub colour_rms: f64,
    /// The same from points of the original to the result.
    pub colour_backward_mean: f64,
    /// Root of the mean squared difference from points of the original to the result.
    pub colour_backward_rms: f64,
    /// Mean texture drift: distance on the original from where the texel at a point of the result lies to the point
    /// closest to that point. Measured on images that the original shows once; `None` if there are none.
    pub slide_mean: Option<f64>,
    /// Texture drift that half of the surface stays below.
    pub slide_median: Option<f64>,
    /// Texture drift that 95 % of the surface stays below.
    pub slide_p95: Option<f64>,
    /// Texture drift that half of the surface stays below, in texels of the original's image.
    pub slide_texels_median: Option<f64>,
    /// Texture drift that 95 % of the surface stays below, in texels of the original's image.
    pub slide_texels_p95: Option<f64>,
    /// Share of the result's surface whose image the original shows more than once, so that its drift is unknown.
    pub repeated_fraction: f64,
    /// Share of the result's other textured surface that shows no chart of the original.
    pub outside_fraction: Option<f64>,
    /// Share of the result's surface that shows no image of the original.
    pub untextured_fraction: f64,
    /// Triangles of the result that run against the majority of their chart in texture space.
    pub folded_triangles: u64,
    /// Number of such triangles of the original.
    pub folded_triangles_before: u64,
    /// Colours and gaps along seams.
    pub seams: BeforeAfter<SeamFigures>,
    /// Number of images read.
    pub images: u64,
    /// Number of images read at a lower resolution because they do not fit the memory budget.
    pub reduced_images: u64,
}

/// Colours and gaps along the seams of a mesh: edges between two faces that show different parts of images.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct SeamFigures {
    /// Length of all seams.
    pub length: f64,
    /// Mean difference of colour between the two sides.
    pub colour_mean: f64,
    /// Root of the mean squared difference.
    pub colour_rms: f64,
    /// Gap that half of the seam length stays below: distance on the original between the two texels that meet at a
    /// point of a seam. Measured on images that the original shows once; `None` if no seam has such an image.
    pub gap_median: Option<f64>,
    /// Gap that 95 % of the seam length stays below.
    pub gap_p95: Option<f64>,
    /// The same as `gap_median` in texels of the image on one side.
    pub gap_texels_median: Option<f64>,
    /// The same as `gap_p95` in texels.
    pub gap_texels_p95: Option<f64>,
    /// Share of the seam length on which a side shows no chart of the original.
    pub outside_fraction: Option<f64>,
}

/// A mesh with at most this many open edges is not a soup, even if it has more open edges than triangles, as a square
/// has.
#[cfg(feature = "images")]
const SOUP_EDGES: u64 = 100_000;

/// Whether a mesh is a triangle soup: most triangles are connected to few others, so its open edges are no border.
#[cfg(feature = "images")]
pub(super) fn is_soup(topology: &TopologyCounts) -> bool {
    topology.boundary_edges > SOUP_EDGES.max(topology.faces)
}

/// Pinholes, in pixels per million of those inside the original's outline.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Pinholes {
    /// Pixels that show the background.
    pub ppm: f64,
    /// Pixels that show a surface more than a hundredth of the diagonal behind the original's.
    pub behind_ppm: f64,
    /// Pixels inside the original's outline, over all views.
    pub pixels: u64,
    /// The view with the largest share of pinholes.
    pub worst: WorstView,
}

/// A view, and its pinholes.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct WorstView {
    /// Direction, in degrees around the vertical: 0 looks north, and the angle grows towards the west.
    pub turn: f64,
    /// Degrees above the horizon.
    pub tilt: f64,
    /// Pixels that show the background.
    pub ppm: f64,
    /// Pixels that show a surface far behind the original's.
    pub behind_ppm: f64,
    /// The result as a JPEG, with pinholes in red and surfaces far behind in orange; empty if there are none.
    #[serde(skip)]
    pub rendering: Vec<u8>,
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

#[cfg(feature = "images")]
impl Quality {
    /// Means and shares of a whole mesh's counts.
    pub(super) fn of(counts: &MeshCounts) -> Self {
        let MeshCounts { topology, .. } = counts;
        let share = |part: f64, of: u64| if of == 0 { 0.0 } else { part / of as f64 };
        Self {
            regularity_mean: share(counts.regularity_sum, topology.faces),
            sliver_share: share(counts.slivers as f64, topology.faces),
            valence_mean: share(2.0 * topology.edges as f64, topology.vertices),
            valence_max: counts.valence_max,
            valence_regular_share: share(counts.regular_vertices as f64, counts.inner_vertices),
        }
    }
}

/// `part` of `of`, as a share; 0 if `of` is 0.
#[cfg(feature = "images")]
pub(super) fn share(part: u64, of: u64) -> f64 {
    if of == 0 { 0.0 } else { part as f64 / of as f64 }
}
