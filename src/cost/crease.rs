//! Planes through sharp edges, perpendicular to both of their faces: they hold the rims of thin sheets.
//!
//! The planes of two faces that lie back to back are nearly the same. Quadrics of these planes alone let the rim move
//! inwards at no cost, so leaves, fences and railings shrink. A sharp edge is therefore held like an open border, with
//! a weight that grows with its turn:
//!
//! ```text
//!      ______________        turn 180°: four times the weight of a border
//!     <______________        turn  90°: a quarter of it
//! ```
//!
//! # Source
//! Constraint planes as in Garland & Heckbert 1997, §6, which has them for open borders only.

use glam::{DVec3, Vec3};

use super::local::LocalQuadric;
use crate::base::id::TiSlice;
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::{Corner, LocalVertex};
use crate::mesh::ring::{Rings, VALENCE_MAX};

/// A vertex may have sharp edges if the mean normal of its faces is shorter than this.
const MEAN_NORMAL_MAX: f32 = 0.9;
/// The weight is sin²(turn / 2) to this power.
const POWER: i32 = 4;

/// Sums of normals and areas around vertices, stored in those parts of their quadrics that are 0 until vertices move.
#[derive(Debug)]
pub struct NormalSums;

impl NormalSums {
    /// What a face adds to a vertex; `weighted_normal` is its unit normal times its area.
    #[inline(always)]
    pub fn of(weighted_normal: Vec3, area: f32) -> LocalQuadric {
        LocalQuadric { linear: weighted_normal, constant: area, ..LocalQuadric::default() }
    }

    fn are_spread(vertex: &LocalQuadric) -> bool {
        vertex.linear.length() < MEAN_NORMAL_MAX * vertex.constant
    }

    fn clear(vertices: &mut TiSlice<LocalVertex, LocalQuadric>) {
        for vertex in vertices {
            (vertex.linear, vertex.constant) = (Vec3::ZERO, 0.0);
        }
    }
}

/// Weight of each of the two planes of an edge that turns by 180°, relative to that of a border.
const STIFFNESS: f64 = 2.0;

/// Share of the full weight above which two faces are close to folded onto each other: the angle between them is below
/// about 0.5 rad.
const NEAR_FOLD_SHARE: f64 = 0.78;

/// Adds the planes of all sharp edges to the quadrics of their ends, and clears the sums of normals. `weight` is that
/// of an open border per squared length. `near_folds` becomes the vertices of faces that are close to folded onto each
/// other.
pub fn add_creases(
    vertices: &mut TiSlice<LocalVertex, LocalQuadric>,
    mesh: &ClusterMesh,
    rings: &Rings,
    weight: f64,
    near_folds: &mut Vec<LocalVertex>,
) {
    near_folds.clear();
    for a in mesh.vertex_ids() {
        if !NormalSums::are_spread(&vertices[a]) {
            continue;
        }
        for &corner in rings.of(a) {
            let [next, previous] = corner.others();
            let b = mesh.vertex_of(next);
            if b < a || !NormalSums::are_spread(&vertices[b]) {
                continue;
            }
            let place = |v: LocalVertex| mesh.positions[v] - mesh.positions[a];
            let third = |corner: Corner| place(mesh.vertex_of(corner));
            // Where more than two faces meet, the flattest turn counts as the continuation of the surface.
            let turns = corners_back(mesh, rings, [a, b]).map(|other| {
                let thirds = [previous, other.next()];
                let turn = crease(place(b), thirds.map(third)).unwrap_or_default();
                if turn.1 > NEAR_FOLD_SHARE {
                    near_folds.extend([a, b]);
                    near_folds.extend(thirds.map(|corner| mesh.vertex_of(corner)));
                }
                turn
            });
            let Some((uprights, share)) = turns.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|turn| turn.1 > 0.0) else {
                continue;
            };
            let weight = (STIFFNESS * weight * share * place(b).length_squared()) as f32;
            for upright in uprights {
                for end in [a, b] {
                    vertices[end].add_plane(upright.as_vec3(), weight);
                }
            }
        }
    }
    NormalSums::clear(vertices);
}

/// Vertices of faces that are close to folded onto each other, any number of times each.
pub fn near_folds(mesh: &ClusterMesh, rings: &Rings) -> Vec<LocalVertex> {
    let mut found = Vec::new();
    for corner in mesh.living_faces().flat_map(|face| [0, 1, 2].map(|index| Corner::at(face, index))) {
        let [a, b, third] = [corner, corner.next(), corner.previous()].map(|corner| mesh.vertex_of(corner));
        for other in corners_back(mesh, rings, [a, b]).filter(|&other| mesh.living(other).is_some()) {
            let across = mesh.vertex_of(other.next());
            let [edge, left, right] = [b, third, across].map(|v| mesh.positions[v] - mesh.positions[a]);
            if crease(edge, [left, right]).is_some_and(|(_, share)| share > NEAR_FOLD_SHARE) {
                found.extend([a, b, third, across]);
            }
        }
    }
    found
}

/// The corners at `a` of the faces that run along an edge from `b` to `a`. None if both ends have more than twice the
/// largest valence of a vertex that may move: every face at such an edge would meet every other one.
fn corners_back<'a>(
    mesh: &'a ClusterMesh,
    rings: &'a Rings,
    [a, b]: [LocalVertex; 2],
) -> impl Iterator<Item = Corner> + 'a {
    let [searched, _] = rings.search_order([a, b]);
    let corners = rings.of(searched);
    let corners = if corners.len() > 2 * VALENCE_MAX { &[] } else { corners };
    let at_a = move |&corner: &Corner| if searched == a { corner } else { corner.next() };
    corners.iter().map(at_a).filter(move |&c| mesh.vertex_of(c) == a && mesh.vertex_of(c.previous()) == b)
}

/// Unit normals of the planes through an edge that starts at the origin, perpendicular to its left and its right face,
/// and their share of the full weight. `None` if the edge turns by 90° or less.
fn crease(edge: DVec3, [left, right]: [DVec3; 2]) -> Option<([DVec3; 2], f64)> {
    let across = [edge.cross(left), right.cross(edge)];
    let cosine = across[0].dot(across[1]) / (across[0].length() * across[1].length());
    // NaN: a face has no area.
    if cosine >= 0.0 || cosine.is_nan() {
        return None;
    }
    let uprights = across.map(|normal| edge.cross(normal).normalize_or_zero());
    Some((uprights, (0.5 * (1.0 - cosine)).powi(POWER)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::id::TiVec;
    use crate::mesh::Wedge;
    use crate::mesh::cluster::samples;
    use crate::mesh::id::short::v;
    use crate::model::id::PartId;

    #[test]
    fn a_sharp_edge_weighs_the_more_the_sharper_it_is() {
        let share = |degrees: f64| {
            let turn = degrees.to_radians();
            crease(DVec3::X, [DVec3::Y, DVec3::new(0.0, -turn.cos(), -turn.sin())]).map(|(_, share)| share)
        };
        assert_eq!(share(45.0), None);
        assert!((share(90.001).unwrap() - 1.0 / 16.0).abs() < 1e-4);
        assert!(share(120.0).unwrap() < share(150.0).unwrap());
        assert!((share(180.0).unwrap() - 1.0).abs() < 1e-12);
    }

    /// Two square sheets of 4 × 4 squares, `gap` apart inside and joined at their rims.
    fn cushion(gap: f64) -> ClusterMesh {
        let top = samples::grid(4, 0.0);
        let mut mesh = top.clone();
        let below: TiVec<Wedge, Wedge> = top
            .wedge_vertex
            .iter_enumerated()
            .map(|(wedge, &vertex)| {
                if samples::is_on_rim(4, vertex) {
                    return wedge;
                }
                let vertex = mesh.push_vertex(top.positions[vertex] - gap * DVec3::Z, 0);
                mesh.push_wedge(vertex, top.wedge_uv[wedge])
            })
            .collect();
        for corners in &top.corners {
            let [a, b, c] = corners.map(|wedge| below[wedge]);
            mesh.push_face([a, c, b], PartId::new(0));
        }
        mesh.link_wedges();
        mesh
    }

    fn normal_sums(mesh: &ClusterMesh) -> TiVec<LocalVertex, LocalQuadric> {
        let mut vertices = mesh.per_vertex(LocalQuadric::default());
        for face in mesh.face_ids() {
            let [a, b, c] = mesh.triangle(face);
            let across = 0.5 * (b - a).cross(c - a);
            for vertex in mesh.vertices(face) {
                vertices[vertex].add(&NormalSums::of(across.as_vec3(), across.length() as f32));
            }
        }
        vertices
    }

    // The rim of a cushion and the vertices across it are close to folds if its two sheets are close.
    #[test]
    fn what_is_close_to_a_fold_is_found_alike_with_and_without_sums_of_normals() {
        for (gap, found) in [(1e-3, true), (0.3, true), (3.0, false)] {
            let mesh = cushion(gap);
            let mut rings = Rings::default();
            rings.build(&mesh);
            let (mut all, mut beside) = (near_folds(&mesh, &rings), Vec::new());
            add_creases(&mut normal_sums(&mesh), &mesh, &rings, 1.0, &mut beside);
            for vertices in [&mut all, &mut beside] {
                vertices.sort_unstable();
                vertices.dedup();
            }
            assert_eq!(all, beside);
            assert_eq!(all.contains(&v(2)), found, "{gap}: {all:?}");
            assert!(!all.contains(&v(12)));
        }
    }

    #[test]
    fn the_rim_of_a_thin_sheet_is_held_and_its_inside_is_not() {
        let mesh = cushion(1e-3);
        let mut rings = Rings::default();
        rings.build(&mesh);
        let mut vertices = normal_sums(&mesh);
        add_creases(&mut vertices, &mesh, &rings, 1.0, &mut Vec::new());
        let inwards = |at: u32| vertices[v(at)].at([0.0, 0.1, 0.0]);
        // Two edges of length 1 meet in vertex 2, each with two planes.
        assert!(inwards(2) > 0.06 && inwards(2) < 0.18, "{}", inwards(2));
        assert_eq!(inwards(12), 0.0);
        assert!(vertices.iter().all(|vertex| vertex.linear == Vec3::ZERO && vertex.constant == 0.0));
    }

    // Ends of an edge of very many faces do not move; all pairs of 100,000 faces would take minutes.
    #[test]
    fn an_edge_of_very_many_faces_has_no_folds() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y].map(|corner| (corner, glam::DVec2::NAN));
        let found = |copies: usize| {
            let mesh = samples::mesh_of(corners, &[[0, 1, 2], [0, 2, 1]].repeat(copies));
            let mut rings = Rings::default();
            rings.build(&mesh);
            let mut beside = Vec::new();
            add_creases(&mut normal_sums(&mesh), &mesh, &rings, 1.0, &mut beside);
            [near_folds(&mesh, &rings), beside].map(|vertices| !vertices.is_empty())
        };
        assert_eq!([1, VALENCE_MAX, 50_000].map(found), [[true; 2], [true; 2], [false; 2]]);
    }
}
