//! Lays a chart flat: each vertex where it is seen along the chart's normal, and then [moved](super::relax) so that the
//! triangles keep their shapes.
//!
//! The chart is then scaled so that it has the area of its surface, and turned so that its smallest box stands upright.

use std::collections::HashMap;

use foldhash::fast::FixedState;
use glam::{DVec2, DVec3};

use super::outline::{OutlineEdge, overlaps};
use super::relax::relax;
use super::types::Triangles;
use crate::base::Result;
use crate::geometry::triangle::area;
use crate::mesh::id::{FaceId, LocalVertex};

/// Largest factor by which a chart is scaled to make up for what its normal foreshortens.
const SCALE_MAX: f64 = 1.4;

/// A chart that was laid flat.
#[derive(Debug, Clone)]
pub struct FlatChart {
    /// Its triangles, each with the places of its corners in texels, above and to the right of 0.
    pub faces: Vec<(FaceId, [DVec2; 3])>,
    /// Width and height in texels.
    pub size: DVec2,
}

/// Lays triangles flat; `None` if they would overlap or be stretched too much. Their normals must lie within 90 degrees of `normal`; `texel` is the
/// length of a texel's side.
///
/// # Errors
/// [`Error::Stopped`](crate::base::Error::Stopped).
pub(super) fn lay_flat(mesh: Triangles<'_>, faces: &[FaceId], normal: DVec3, texel: f64) -> Result<Option<FlatChart>> {
    let axis = normal.normalize_or(DVec3::Z);
    let (across, along) = axis.any_orthonormal_pair();
    let mut number_of: HashMap<LocalVertex, usize, FixedState> =
        HashMap::with_capacity_and_hasher(faces.len() + 2, FixedState::default());
    let mut places = Vec::with_capacity(faces.len() + 2);
    let mut number = |vertex: LocalVertex| {
        *number_of.entry(vertex).or_insert_with(|| {
            let position = mesh.positions[vertex];
            places.push(DVec2::new(position.dot(across), position.dot(along)));
            places.len() - 1
        })
    };
    let triangles: Vec<_> =
        faces.iter().map(|&face| (mesh.vertices[face].map(&mut number), mesh.corners(face))).collect();
    let places = if faces.len() > 1 { relax(&triangles, places)? } else { Some(places) };
    Ok(places.and_then(|places| make_chart(mesh, faces, &triangles, &places, texel)))
}

/// The chart of triangles whose vertices were laid at these places, scaled and turned; `None` if they overlap.
fn make_chart(
    mesh: Triangles<'_>,
    faces: &[FaceId],
    triangles: &[([usize; 3], [DVec3; 3])],
    places: &[DVec2],
    texel: f64,
) -> Option<FlatChart> {
    let corners = triangles.iter().map(|(vertices, _)| vertices.map(|vertex| places[vertex]));
    let mut laid: Vec<(FaceId, [DVec2; 3])> = faces.iter().copied().zip(corners).collect();
    let doubled_area = |corners: &[DVec2; 3]| (corners[1] - corners[0]).perp_dot(corners[2] - corners[0]);
    if faces.len() > 1 && (winds_twice(mesh, &laid) || overlaps(outline(mesh, &laid)?)) {
        return None;
    }
    let flat_area = 0.5 * laid.iter().map(|(_, corners)| doubled_area(corners)).sum::<f64>();
    let true_area = faces.iter().map(|&face| area(mesh.corners(face))).sum::<f64>();
    let scale = (true_area / flat_area).sqrt();
    let scale = if scale.is_finite() { scale.clamp(1.0, SCALE_MAX) } else { 1.0 };
    // A chart without area is a point.
    let scale = if texel.is_normal() { scale / texel } else { 0.0 };
    let turn = upright(laid.iter().flat_map(|(_, corners)| *corners).collect()) * scale;
    laid.iter_mut().for_each(|(_, corners)| *corners = corners.map(|corner| turn.rotate(corner)));
    let all = || laid.iter().flat_map(|(_, corners)| *corners);
    let low = all().fold(DVec2::INFINITY, DVec2::min);
    let size = all().fold(DVec2::NEG_INFINITY, DVec2::max) - low;
    laid.iter_mut().for_each(|(_, corners)| *corners = corners.map(|corner| corner - low));
    Some(FlatChart { faces: laid, size })
}

/// Whether the triangles go more than once around a vertex.
fn winds_twice(mesh: Triangles<'_>, laid: &[(FaceId, [DVec2; 3])]) -> bool {
    let mut angles: HashMap<LocalVertex, f64, FixedState> =
        HashMap::with_capacity_and_hasher(laid.len(), FixedState::default());
    for (face, corners) in laid {
        for k in 0..3 {
            let [to, from] = [1, 2].map(|step| corners[(k + step) % 3] - corners[k]);
            *angles.entry(mesh.vertices[*face][k]).or_default() += libm::atan2(to.perp_dot(from), to.dot(from));
        }
    }
    angles.values().any(|&angle| angle > 1.5 * std::f64::consts::TAU)
}

/// The edges that one triangle alone has, in any order; `None` if two triangles have one in the same direction.
fn outline(mesh: Triangles<'_>, laid: &[(FaceId, [DVec2; 3])]) -> Option<Vec<OutlineEdge>> {
    let mut edges: HashMap<[LocalVertex; 2], [DVec2; 2], FixedState> =
        HashMap::with_capacity_and_hasher(3 * laid.len(), FixedState::default());
    for (face, corners) in laid {
        let vertices = mesh.vertices[*face];
        for k in 0..3 {
            let next = (k + 1) % 3;
            if edges.insert([vertices[k], vertices[next]], [corners[k], corners[next]]).is_some() {
                return None;
            }
        }
    }
    let is_alone = |ends: &[LocalVertex; 2]| !edges.contains_key(&[ends[1], ends[0]]);
    let alone: Vec<OutlineEdge> = edges
        .iter()
        .filter(|(vertices, _)| is_alone(vertices))
        .map(|(&vertices, &ends)| OutlineEdge { vertices, ends })
        .collect();
    Some(alone)
}

/// The turn, as a unit vector, that makes the smallest box around some points upright, its longer side vertical.
fn upright(mut points: Vec<DVec2>) -> DVec2 {
    let hull = convex_hull(&mut points);
    let box_of = |turn: DVec2| {
        let turned = || hull.iter().map(|&point| turn.rotate(point));
        turned().fold(DVec2::NEG_INFINITY, DVec2::max) - turned().fold(DVec2::INFINITY, DVec2::min)
    };
    let mut best = (f64::INFINITY, DVec2::X);
    for (at, &from) in hull.iter().enumerate() {
        let to = hull[(at + 1) % hull.len()];
        let Some(step) = (to - from).try_normalize() else { continue };
        // Turns the edge to lie along the first axis.
        let turn = DVec2::new(step.x, -step.y);
        let size = box_of(turn);
        if size.x * size.y < best.0 {
            best = (size.x * size.y, if size.x > size.y { DVec2::Y.rotate(turn) } else { turn });
        }
    }
    best.1
}

/// Corners of the convex hull, counter-clockwise.
///
/// # Source
/// Andrew 1979, "Another efficient algorithm for convex hulls in two dimensions".
fn convex_hull(points: &mut Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    let mut hull: Vec<DVec2> = Vec::new();
    let mut chain = |points: &mut dyn Iterator<Item = DVec2>| {
        let first = hull.len();
        for point in points {
            while hull.len() >= first + 2 {
                let [before, last] = [hull[hull.len() - 2], hull[hull.len() - 1]];
                if (last - before).perp_dot(point - before) > 0.0 {
                    break;
                }
                hull.pop();
            }
            hull.push(point);
        }
        hull.pop();
    };
    chain(&mut points.iter().copied());
    chain(&mut points.iter().rev().copied());
    if hull.is_empty() { points.clone() } else { hull }
}
