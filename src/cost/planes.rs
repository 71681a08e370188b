//! Quadrics of planes that are not weighted by area, and placements by quadrics.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::metric::{EdgeCase, Placement};
use super::quadric::Quadric;
use crate::base::id::TiVec;
use crate::mesh::class::{Class, Classes};
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::edge::{EdgeKind, edge_kind};
use crate::mesh::id::{FaceId, LocalVertex, Wedge};
use crate::mesh::ring::Rings;

/// Stiffness of the spring that pulls a free placement to the middle of its edge, relative to the trace of A.
const SPRING: f64 = 1e-6;
/// A placement farther from the middle of the edge than this many edge lengths is rejected.
const REACH: f64 = 2.0;
/// Cost of a collapse on a flat patch, relative to the edge length raised to the cost's power of length: it orders
/// ties.
pub(super) const LENGTH_SHARE: f64 = 1e-7;

/// Placement of a collapse.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum PlacePolicy {
    /// At the minimum of the quadric.
    #[default]
    Optimal,
    /// At the best of both ends and the middle.
    BestOfThree,
}

impl PlacePolicy {
    /// Words of the parameter, in the order of its values.
    pub const WORDS: &[&str] = &["optimal", "three"];

    /// The policy for a value of the parameter.
    pub fn from_parameter(value: f64) -> Self {
        if value > 0.0 { Self::BestOfThree } else { Self::Optimal }
    }

    /// Position of least error under this policy.
    pub fn place(self, mesh: &ClusterMesh, edge: &EdgeCase<'_>, quadric: &Quadric) -> DVec3 {
        match self {
            Self::Optimal => best_place(mesh, edge, quadric),
            Self::BestOfThree => best_of_three(mesh, edge, quadric),
        }
    }
}

/// Unit normal and area of a triangle; `None` if it has no area.
pub fn plane_of(triangle: [DVec3; 3]) -> Option<(DVec3, f64)> {
    let across = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]);
    let length = across.length();
    (length > 0.0 && length.is_finite()).then(|| (across / length, 0.5 * length))
}

/// Area of a mesh.
pub fn area_of(mesh: &ClusterMesh) -> f64 {
    mesh.living_faces().filter_map(|face| plane_of(mesh.triangle(face))).map(|(_, area)| area).sum()
}

/// Extends the values of vertices or wedges to `count` of them, such as for copies made where a handle is cut. `from`
/// computes the values of all from an index on. The first values are moved, not copied: they may be most of a cluster's
/// memory.
pub fn extended<K, T>(mut values: TiVec<K, T>, count: usize, from: impl FnOnce(usize) -> Vec<T>) -> TiVec<K, T> {
    let known = values.len();
    if known >= count {
        return values;
    }
    let newcomers = from(known);
    if known == 0 {
        return newcomers.into();
    }
    values.reserve_exact(newcomers.len());
    values.extend(newcomers);
    values
}

/// For each vertex, the squared distance to the planes of the faces around it. With `border` > 0 it includes the planes
/// through border edges, perpendicular to their face, with weight `border`, and those through seam edges, on each side,
/// with half that weight.
pub fn unit_planes(mesh: &ClusterMesh, rings: &Rings, classes: &Classes, border: f64) -> TiVec<LocalVertex, Quadric> {
    let mut quadrics = mesh.per_vertex(Quadric::default());
    for face in mesh.living_faces() {
        let triangle = mesh.triangle(face);
        let Some((normal, _)) = plane_of(triangle) else { continue };
        let quadric = Quadric::plane(normal, -normal.dot(triangle[0]), 1.0);
        let vertices = mesh.vertices(face);
        for vertex in vertices {
            quadrics[vertex] += quadric;
        }
        if border <= 0.0 {
            continue;
        }
        each_chain_edge(mesh, rings, classes, face, |a, b, kind| {
            let (pa, pb) = (mesh.positions[a], mesh.positions[b]);
            let Some(upright) = (pb - pa).cross(normal).try_normalize() else { return };
            let weight = if kind == EdgeKind::Border { border } else { 0.5 * border };
            let quadric = Quadric::plane(upright, -upright.dot(pa), weight);
            quadrics[a] += quadric;
            quadrics[b] += quadric;
        });
    }
    quadrics
}

/// Calls `each` for the border and seam edges of a face. Leaves out edges between two complex or fixed vertices: faces
/// of another cluster may be missing there.
pub fn each_chain_edge(
    mesh: &ClusterMesh,
    rings: &Rings,
    classes: &Classes,
    face: FaceId,
    mut each: impl FnMut(LocalVertex, LocalVertex, EdgeKind),
) {
    let vertices = mesh.vertices(face);
    for k in 0..3 {
        let (a, b) = (vertices[k], vertices[(k + 1) % 3]);
        let ends = [classes[a], classes[b]];
        if ends.contains(&Class::Smooth) || ends.iter().all(|end| matches!(end, Class::Complex | Class::Fixed)) {
            continue;
        }
        match edge_kind(mesh, rings, a, b) {
            EdgeKind::Inner => {}
            kind => each(a, b, kind),
        }
    }
}

/// Position near an edge with the least error: the minimum of the quadric; or else the best of the middle and both
/// ends.
pub fn best_place(mesh: &ClusterMesh, edge: &EdgeCase<'_>, quadric: &Quadric) -> DVec3 {
    let (pa, pb) = ends(mesh, edge);
    if edge.onto {
        return pb;
    }
    let middle = 0.5 * (pa + pb);
    match quadric.minimum_near(middle, SPRING * quadric.diagonal.element_sum()) {
        Some(p) if p.distance_squared(middle) <= REACH * REACH * pa.distance_squared(pb) => p,
        _ => best_of_three(mesh, edge, quadric),
    }
}

/// The best of the middle and both ends of an edge; the end that stays if the collapse is `onto` it.
fn best_of_three(mesh: &ClusterMesh, edge: &EdgeCase<'_>, quadric: &Quadric) -> DVec3 {
    let (pa, pb) = ends(mesh, edge);
    if edge.onto { pb } else { least([0.5 * (pa + pb), pa, pb], |p| quadric.at(p)) }
}

/// The candidate of least value; the first of several.
pub fn least<T: Copy, const N: usize>(candidates: [T; N], value: impl Fn(T) -> f64) -> T {
    let mut best = (value(candidates[0]), candidates[0]);
    for candidate in &candidates[1..] {
        let found = value(*candidate);
        if found < best.0 {
            best = (found, *candidate);
        }
    }
    best.1
}

/// Appends the texture coordinate of each wedge pair, interpolated by `share` from the vertex that vanishes to the one
/// that stays.
pub fn texcoords_along(mesh: &ClusterMesh, edge: &EdgeCase<'_>, share: f64, out: &mut Vec<DVec2>) {
    let uv = |wedge: Wedge| mesh.wedge_uv[wedge];
    out.extend(edge.wedges.iter().map(|pair| uv(pair.from).lerp(uv(pair.to), share)));
}

/// Positions of the vertex that vanishes and of the one that stays.
pub fn ends(mesh: &ClusterMesh, edge: &EdgeCase<'_>) -> (DVec3, DVec3) {
    (mesh.positions[edge.from], mesh.positions[edge.to])
}

/// A placement whose cost (length²) is clamped at 0 and increased by a share of the squared edge length, which orders
/// ties.
pub fn priced(mesh: &ClusterMesh, edge: &EdgeCase<'_>, position: DVec3, cost: f64) -> Placement {
    let (pa, pb) = ends(mesh, edge);
    Placement { position, cost: cost.max(0.0) + LENGTH_SHARE * pa.distance_squared(pb) }
}
