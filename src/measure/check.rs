//! Counts the cracks and topology faults of a mesh, and compares the counts with those of another mesh.
//!
//! Edges are undirected pairs of vertices. Faces that repeat a vertex are counted and then left out.
//!
//! ```text
//!   .----.        .---.---.       .       .            .---.          .
//!   |    |        | \ | / |       | \   / |           /|  /          /|\
//!   |  . |        |   +   |       |   *   |          / | /          / | \
//!   |    |        | / | \ |       | /   \ |         .--#--.        .--+--.
//!   '----'        '---'---'       '       '            a third      the upper faces have an edge, the lower ones
//!   boundary      inside          * has two fans       face at #    a vertex in its middle: a T-junction
//! ```

use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

use super::chart::{ChartCounts, count_charts};
use super::edges::{EdgeTable, HalfEdge, repeats_vertex, vertices_of};
use super::forest::DisjointSets;
use super::surface::Surface;
use super::tjunction::count_t_junctions;
use crate::base::pool::in_parallel;
use crate::geometry::boxtree::Bounds;
use crate::geometry::triangle::is_flat;
use crate::mesh::fold::are_folded;

/// Distance within which a boundary vertex lies on a boundary edge, as a share of the bounding box's diagonal.
pub const T_JUNCTION_TOLERANCE: f64 = 1e-6;
/// Counts of a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Check {
    /// Vertices that a face uses.
    pub vertices: u64,
    /// Faces, without the degenerate ones.
    pub faces: u64,
    /// Vertices that no face uses.
    pub unused_vertices: u64,
    /// Faces that repeat a vertex.
    pub degenerate_faces: u64,
    /// Faces of three different vertices without area: their height is below 10⁻⁹ of their longest side, or below four
    /// roundings of the largest coordinate.
    pub zero_area_faces: u64,
    /// Faces with the same three vertices as an earlier face, in any order.
    pub duplicate_faces: u64,
    /// Edges of exactly one face.
    pub boundary_edges: u64,
    /// Sets of boundary edges connected through vertices: borders that touch at a vertex count as one.
    pub boundary_loops: u64,
    /// Faces with three boundary edges: the remains of a component, or a stray face.
    pub single_faces: u64,
    /// Edges of three or more faces.
    pub non_manifold_edges: u64,
    /// Edges of two faces that run along it in the same direction.
    pub inconsistent_edges: u64,
    /// Edges of two faces that are folded onto each other, back to back: the angle between them is below
    /// [`FOLD_ANGLE`](crate::mesh::fold::FOLD_ANGLE). Faces without area do not count.
    pub folded_edges: u64,
    /// Vertices whose faces form more than one fan: the faces are not all connected over edges at the vertex.
    pub non_manifold_vertices: u64,
    /// Connected components: sets of faces connected over edges. Faces that share only a vertex are not connected.
    pub components: u64,
    /// Euler characteristic V - E + F over used vertices, edges and faces.
    pub euler: i64,
    /// Boundary vertices within [`T_JUNCTION_TOLERANCE`] of the inside of a boundary edge that they do not belong to.
    pub t_junctions: u64,
    /// Counts of the texture atlas.
    #[serde(flatten)]
    pub atlas: ChartCounts,
}

/// Counts of a [welded](Surface::welded) surface; O(n log n).
///
/// # Panics
/// If a face refers to a vertex or a texture coordinate that does not exist, or with more than 2³² / 3 faces.
pub fn check(surface: &Surface) -> Check {
    let faces = &surface.faces;
    let sound = |face: &[u32; 3]| !repeats_vertex(*face);
    let mut used = vec![false; surface.positions.len()];
    for &vertex in faces.iter().filter(|&face| sound(face)).flatten() {
        used[vertex as usize] = true;
    }
    let used_positions = || surface.positions.iter().zip(&used).filter(|&(_, &used)| used).map(|(&p, _)| p);
    let bounds = Bounds::around(used_positions());
    let largest = bounds.low.abs().max(bounds.high.abs()).max_element();
    let vertices = used.iter().filter(|&&used| used).count() as u64;
    let face_count = faces.iter().filter(|&face| sound(face)).count() as u64;

    let edges = EdgeTable::new(faces);
    let topology = count_topology(surface, &edges);
    let boundary = edges.boundary();
    let atlas = count_charts(surface, &edges);
    drop(edges);
    Check {
        vertices,
        faces: face_count,
        unused_vertices: surface.positions.len() as u64 - vertices,
        degenerate_faces: faces.len() as u64 - face_count,
        zero_area_faces: faces
            .iter()
            .filter(|&face| sound(face) && has_no_area(face.map(|v| surface.position(v)), largest))
            .count() as u64,
        duplicate_faces: count_duplicates(faces),
        boundary_edges: boundary.len() as u64,
        boundary_loops: count_loops(surface.positions.len(), &boundary),
        single_faces: topology.single_faces,
        non_manifold_edges: topology.non_manifold_edges,
        inconsistent_edges: topology.inconsistent_edges,
        folded_edges: topology.folded_edges,
        non_manifold_vertices: topology.non_manifold_vertices,
        components: topology.components,
        euler: vertices as i64 - topology.edges as i64 + face_count as i64,
        t_junctions: count_t_junctions(&surface.positions, &boundary, T_JUNCTION_TOLERANCE * bounds.diagonal()),
        atlas,
    }
}

/// Counts of a surface after welding it. Faces that repeat a position, which welding drops, count as degenerate.
///
/// # Panics
/// As [`check`].
pub fn weld_and_check(surface: &Surface) -> Check {
    let welded = surface.welded();
    let dropped = surface.faces.len() - welded.faces.len();
    Check { degenerate_faces: dropped as u64, ..check(&welded) }
}

fn has_no_area([a, b, c]: [DVec3; 3], largest: f64) -> bool {
    let longest_sq = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    is_flat((b - a).cross(c - a).length(), longest_sq, largest)
}

#[derive(Default)]
struct EdgeCounts {
    edges: u64,
    single_faces: u64,
    non_manifold_edges: u64,
    inconsistent_edges: u64,
    folded_edges: u64,
    non_manifold_vertices: u64,
    components: u64,
}

/// Whether the two faces of an edge are folded onto each other.
fn is_fold(surface: &Surface, [a, b]: [HalfEdge; 2]) -> bool {
    let third = |half: HalfEdge| surface.position(surface.faces[half.face()][(half.corner() + 2) % 3]);
    are_folded([a.low(), a.high()].map(|v| surface.position(v)), [third(a), third(b)])
}

fn count_topology(surface: &Surface, edges: &EdgeTable) -> EdgeCounts {
    let faces = &surface.faces;
    let mut topology = EdgeCounts::default();
    let mut corners = DisjointSets::new(faces.len() * 3);
    let mut pieces = DisjointSets::new(faces.len());
    let mut open_edges = vec![0u8; faces.len()];
    for edge in edges.iter() {
        topology.edges += 1;
        match edge {
            [a] => open_edges[a.face()] += 1,
            [a, b] => {
                topology.inconsistent_edges += u64::from(a.runs_up(faces) == b.runs_up(faces));
                topology.folded_edges += u64::from(is_fold(surface, [*a, *b]));
            }
            _ => topology.non_manifold_edges += 1,
        }
        let first = edge[0];
        for &other in &edge[1..] {
            pieces.join(first.face() as u32, other.face() as u32);
            for (a, b) in first.corners(faces).into_iter().zip(other.corners(faces)) {
                corners.join((first.face() * 3 + a) as u32, (other.face() * 3 + b) as u32);
            }
        }
    }
    topology.single_faces = open_edges.iter().filter(|&&count| count == 3).count() as u64;
    let mut has_fan = vec![false; surface.positions.len()];
    let mut has_two_fans = vec![false; surface.positions.len()];
    for (face, vertices) in faces.iter().enumerate().filter(|&(_, &vertices)| !repeats_vertex(vertices)) {
        topology.components += u64::from(pieces.is_root(face as u32));
        for (corner, &vertex) in vertices.iter().enumerate() {
            if corners.is_root((face * 3 + corner) as u32) {
                has_two_fans[vertex as usize] |= has_fan[vertex as usize];
                has_fan[vertex as usize] = true;
            }
        }
    }
    topology.non_manifold_vertices = has_two_fans.iter().filter(|&&two| two).count() as u64;
    topology
}

fn count_duplicates(faces: &[[u32; 3]]) -> u64 {
    let mut sets: Vec<[u32; 3]> = faces.iter().copied().filter(|&face| !repeats_vertex(face)).collect();
    sets.iter_mut().for_each(|set| set.sort_unstable());
    in_parallel(|| sets.par_sort_unstable());
    let before = sets.len();
    sets.dedup();
    (before - sets.len()) as u64
}

fn count_loops(vertex_count: usize, boundary: &[[u32; 2]]) -> u64 {
    let mut loops = DisjointSets::new(vertex_count);
    for &[a, b] in boundary {
        loops.join(a, b);
    }
    vertices_of(boundary).into_iter().filter(|&vertex| loops.is_root(vertex)).count() as u64
}

/// A count that is worse after than before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Regression {
    /// Name of the count: "T-junctions".
    pub what: &'static str,
    /// Number before.
    pub before: u64,
    /// Number after.
    pub after: u64,
}

impl std::fmt::Display for Regression {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {} before, {} after", self.what, self.before, self.after)
    }
}

/// Counts of `after` that are worse than those of `before`, in a fixed order.
///
/// Boundary edges count only if there were none: an open border may gain or lose edges, but a closed mesh must stay
/// closed. A single face is not a crack: it is what is left of a component. An edge of three or more faces that has two
/// faces left may show that these are folded, or run the same way.
pub fn compare_checks(before: &Check, after: &Check) -> Vec<Regression> {
    let open_edges = match before.boundary_edges {
        0 => after.boundary_edges - 3 * after.single_faces,
        _ => 0,
    };
    // A border that is closed along most of its length becomes several loops of fewer edges; a tear adds edges.
    let new_loops = match after.boundary_edges > before.boundary_edges {
        true => after.boundary_loops.saturating_sub(before.boundary_loops + after.single_faces),
        false => 0,
    };
    let resolved = before.non_manifold_edges.saturating_sub(after.non_manifold_edges);
    risen(&[
        ("open edges of a closed mesh", 0, open_edges),
        ("boundary loops of more edges", 0, new_loops),
        ("T-junctions", before.t_junctions, after.t_junctions),
        ("non-manifold edges", before.non_manifold_edges, after.non_manifold_edges),
        ("inconsistent edges", before.inconsistent_edges + resolved, after.inconsistent_edges),
        ("folded edges", before.folded_edges + resolved, after.folded_edges),
        ("degenerate faces", before.degenerate_faces, after.degenerate_faces),
        ("zero-area faces", before.zero_area_faces, after.zero_area_faces),
        ("duplicate faces", before.duplicate_faces, after.duplicate_faces),
        ("folded texture triangles", before.atlas.folded_uv + resolved, after.atlas.folded_uv),
    ])
}

/// Counts of `after` that are above those of `before`, and no fault where the topology may change. A border that was
/// welded along most of its length becomes several loops.
pub fn compare_topology(before: &Check, after: &Check) -> Vec<Regression> {
    risen(&[
        ("non-manifold vertices", before.non_manifold_vertices, after.non_manifold_vertices),
        ("components", before.components, after.components),
        ("boundary loops", before.boundary_loops + after.single_faces, after.boundary_loops),
    ])
}

/// Counts that are higher after than before.
fn risen(counts: &[(&'static str, u64, u64)]) -> Vec<Regression> {
    let higher = counts.iter().filter(|(_, before, after)| after > before);
    higher.map(|&(what, before, after)| Regression { what, before, after }).collect()
}

#[cfg(test)]
mod tests;
