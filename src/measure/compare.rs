//! What a simplification did to a mesh: everything that comparing a result with its original finds.
//!
//! ```text
//! original ◀──forward── result      forward: from points of the result to the closest point of the original
//! original ──backward──▶ result     backward: from points of the original; large where something was lost
//! ```
//! Names are those of the JSON that `docs/report.md` describes. Lengths are in the mesh's unit, angles in degrees,
//! colours on 0 to 255, shares between 0 and 1.

use std::path::PathBuf;

use serde::Serialize;

/// Version of the JSON's form.
pub const VERSION: u32 = 1;

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
    pub original: PathBuf,
    /// The result, as named.
    pub result: PathBuf,
    /// Points by area on each of the two surfaces.
    pub samples: u64,
    /// Seed of the points.
    pub seed: u64,
    /// Distances between the surfaces.
    pub geometry: Geometry,
    /// How the picture changed; nothing if one of the meshes has none.
    pub texture: Option<Texture>,
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
    /// Mean slide: from where the picture at a point of the result lies on the original to the closest point there.
    pub slide_mean: f64,
    /// Half of the surface slid by less.
    pub slide_median: f64,
    /// 95 % of the surface slid by less.
    pub slide_p95: f64,
    /// Half of the surface slid by less, in texels of the original's image.
    pub slide_texels_median: f64,
    /// 95 % of the surface slid by less, in texels of the original's image.
    pub slide_texels_p95: f64,
    /// Share of the result's textured surface that shows no chart of the original.
    pub outside_fraction: f64,
    /// Share of the result's surface that shows no image of the original.
    pub untextured_fraction: f64,
    /// Triangles of the result that run against the majority of their chart in texture space.
    pub folded_triangles: u64,
    /// Those of the original.
    pub folded_triangles_before: u64,
    /// Widest gap between the two sides of a seam of the result, in space; 0 if all seams are closed.
    pub seam_gap_max: f64,
    /// Images that were read.
    pub images: u64,
    /// Images that were too large for the memory budget and were read at a lower resolution.
    pub reduced_images: u64,
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
