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

use rayon::prelude::*;
use serde::Serialize;

use super::surface::Surface;
use super::tjunction::count_t_junctions;
use crate::base::Result;
use crate::base::id::{TiSlice, TiVec, ids};
use crate::base::pool::{blocks_until_stopped, check_stopped, in_parallel};
use crate::geometry::boxtree::Bounds;
use crate::geometry::triangle::has_no_area;
use crate::mesh::forest::DisjointSets;
use crate::mesh::id::FaceId;
use crate::model::face::repeats_vertex;
use crate::model::id::MeshVertex;
use crate::topology::atlas::UvCounts;
use crate::topology::count;
use crate::topology::edges::EdgeTable;

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
    /// Triangles in texture space.
    #[serde(flatten)]
    pub uv: UvCounts,
    /// Sets of textured faces connected over edges that are no seams. An edge connects only if its two faces run along
    /// it in opposite directions: otherwise one of them shows its back, and their signs cannot be compared.
    pub charts: u64,
    /// Edges of two faces whose texture coordinates (by value) or materials differ there.
    pub seam_edges: u64,
}

/// Counts of a [welded](Surface::welded) surface; O(n log n).
///
/// # Errors
/// [`Error::Stopped`](crate::base::Error::Stopped).
///
/// # Panics
/// If a face refers to a vertex or a texture coordinate that does not exist, or with more than 2³² / 3 faces.
pub fn check(surface: &Surface) -> Result<Check> {
    let edges = EdgeTable::of_whole(&surface.faces)?;
    let counted = count(surface, &edges, |_, _| {})?;
    let counts = counted.counts.finished();
    let used = surface.positions.iter().zip(&counted.vertices).filter(|(_, at)| at.is_used());
    let bounds = Bounds::around(used.map(|(&position, _)| position));
    drop(counted);
    check_stopped()?;
    let boundary = edges.boundary();
    let non_manifold_vertices = count_non_manifold_vertices(surface, &edges)?;
    let single_faces = count_single_faces(&surface.faces, &edges)?;
    drop(edges);
    check_stopped()?;

    let largest = bounds.low.abs().max(bounds.high.abs()).max_element();
    let mut zero_area_faces = 0;
    for block in blocks_until_stopped(surface.faces.len()) {
        let sound = surface.faces.raw[block?].iter().filter(|face| !repeats_vertex(**face));
        let flat = sound.filter(|face| has_no_area(face.map(|vertex| surface.positions[vertex]), largest));
        zero_area_faces += flat.count() as u64;
    }
    let topology = counts.topology;
    Ok(Check {
        vertices: topology.vertices,
        faces: topology.faces,
        unused_vertices: surface.positions.len() as u64 - topology.vertices,
        degenerate_faces: surface.faces.len() as u64 - topology.faces,
        zero_area_faces,
        duplicate_faces: count_duplicates(&surface.faces)?,
        boundary_edges: topology.boundary_edges,
        boundary_loops: topology.boundary_loops,
        single_faces,
        non_manifold_edges: topology.non_manifold_edges,
        inconsistent_edges: topology.inconsistent_edges,
        folded_edges: topology.folded_edges,
        non_manifold_vertices,
        components: topology.components,
        euler: topology.euler,
        t_junctions: count_t_junctions(&surface.positions, &boundary, T_JUNCTION_TOLERANCE * bounds.diagonal())?,
        uv: counts.uv,
        charts: topology.charts,
        seam_edges: topology.seam_edges,
    })
}

/// Counts of a surface after welding it. Faces that repeat a position, which welding drops, count as degenerate.
///
/// # Errors
/// As [`check`].
///
/// # Panics
/// As [`check`].
pub fn weld_and_check(surface: &Surface) -> Result<Check> {
    let welded = surface.welded()?;
    let dropped = surface.faces.len() - welded.faces.len();
    Ok(Check { degenerate_faces: dropped as u64, ..check(&welded)? })
}

ids! {
    /// A corner of a surface's face: 3 × the face + its index in the face.
    SurfaceCorner;
}

impl SurfaceCorner {
    fn at(face: FaceId, index: usize) -> Self {
        Self::new(3 * face.number() + index as u32)
    }
}

/// Vertices whose faces are not all connected over edges at the vertex.
fn count_non_manifold_vertices(surface: &Surface, edges: &EdgeTable<MeshVertex>) -> Result<u64> {
    let faces = &surface.faces;
    let mut fans = DisjointSets::new(faces.len() * 3);
    edges.try_for_each(|edge| {
        let at_ends = |at: usize| edge[at].corners(faces).map(|corner| SurfaceCorner::at(edge[at].face(), corner));
        for other in 1..edge.len() {
            at_ends(0).into_iter().zip(at_ends(other)).for_each(|(a, b)| fans.join(a, b));
        }
    })?;
    let mut fans_at: TiVec<MeshVertex, u8> = vec![0; surface.positions.len()].into();
    for block in blocks_until_stopped(faces.len()) {
        let numbered = block?.map(|face| (FaceId::from(face), &faces.raw[face]));
        for (face, vertices) in numbered.filter(|(_, vertices)| !repeats_vertex(**vertices)) {
            for (_, &vertex) in vertices.iter().enumerate().filter(|&(at, _)| fans.is_root(SurfaceCorner::at(face, at)))
            {
                fans_at[vertex] = fans_at[vertex].saturating_add(1);
            }
        }
    }
    Ok(fans_at.iter().filter(|&&fans| fans > 1).count() as u64)
}

/// Faces without neighbours.
fn count_single_faces(faces: &TiSlice<FaceId, [MeshVertex; 3]>, edges: &EdgeTable<MeshVertex>) -> Result<u64> {
    let mut open_edges: TiVec<FaceId, u8> = vec![0; faces.len()].into();
    edges.try_for_each(|edge| {
        if let [half] = edge {
            open_edges[half.face()] += 1;
        }
    })?;
    Ok(open_edges.iter().filter(|&&count| count == 3).count() as u64)
}

/// Faces that have the vertices of an earlier one; those that repeat a vertex do not count.
fn count_duplicates(faces: &TiSlice<FaceId, [MeshVertex; 3]>) -> Result<u64> {
    let mut sorted = Vec::with_capacity(faces.len());
    for block in blocks_until_stopped(faces.len()) {
        let sound = faces.raw[block?].iter().filter(|face| !repeats_vertex(**face));
        sorted.extend(sound.map(|&[a, b, c]| {
            let mut face = [a, b, c];
            face.sort_unstable();
            face
        }));
    }
    check_stopped()?;
    in_parallel(|| sorted.par_sort_unstable());
    let before = sorted.len();
    sorted.dedup();
    Ok((before - sorted.len()) as u64)
}

impl Check {
    /// Counts that are faults of any mesh, those above 0, with their names in the singular.
    ///
    /// Zero-area faces, folded and inconsistent edges are not among them: scans have them by the thousand. They count if
    /// they are [new](compare_checks).
    pub fn faults(&self) -> Vec<(&'static str, u64)> {
        let counts = [
            ("degenerate face", self.degenerate_faces),
            ("duplicate face", self.duplicate_faces),
            ("non-manifold edge", self.non_manifold_edges),
            ("T-junction", self.t_junctions),
            ("folded texture triangle", self.uv.folded_uv),
        ];
        counts.into_iter().filter(|(_, count)| *count > 0).collect()
    }
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
    let new_loops = if after.boundary_edges > before.boundary_edges {
        after.boundary_loops.saturating_sub(before.boundary_loops + after.single_faces)
    } else {
        0
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
        ("folded texture triangles", before.uv.folded_uv + resolved, after.uv.folded_uv),
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
