//! T-junctions: boundary vertices that touch the inside of a boundary edge they do not belong to.
//!
//! ```text
//!   d---------c
//!   | .     . |
//!   |   . .   |
//!   a----p----b      above p the edge a b runs through; below p it is two edges
//!   |  . | .  |
//!   e----f----g
//! ```
//! Such a vertex is a crack that opens as soon as either side moves.

use glam::DVec3;
use rayon::prelude::*;

use crate::base::Result;
use crate::base::id::TiSlice;
use crate::base::pool::{check_stopped, in_parallel};
use crate::geometry::boxtree::{Bounds, BoxTree};
use crate::model::id::MeshVertex;
use crate::topology::edges::vertices_of;

/// Edges that a thread takes at a time.
const EDGES_AT_ONCE: usize = 4096;
/// Factor by which the searched boxes are wider than the tolerance, so that rounding loses no candidate.
const SEARCH_MARGIN: f64 = 1.01;

/// Number of vertices of the boundary edges that lie within `tolerance` (a length) of another boundary edge and, along
/// it, farther than that from both of its ends. About O(n log n).
///
/// # Errors
/// [`Error::Stopped`](crate::base::Error::Stopped).
pub fn count_t_junctions(
    positions: &TiSlice<MeshVertex, DVec3>,
    boundary: &[[MeshVertex; 2]],
    tolerance: f64,
) -> Result<u64> {
    let vertices = vertices_of(boundary);
    let tree = BoxTree::new(vertices.len(), |item| Bounds::around([positions[vertices[item as usize]]]));
    let search = |edges: &[[MeshVertex; 2]]| {
        let mut found = Vec::new();
        check_stopped()?;
        for &[a, b] in edges {
            let ends = [positions[a], positions[b]];
            if ends[0].distance(ends[1]) <= 2.0 * tolerance {
                continue; // too short to have an inside
            }
            tree.near_segment(ends, tolerance * SEARCH_MARGIN, |item| {
                let vertex = vertices[item as usize];
                if vertex != a && vertex != b && touches_inside(positions[vertex], ends, tolerance) {
                    found.push(item);
                }
            });
        }
        Ok(found)
    };
    let found: Vec<Vec<u32>> = in_parallel(|| boundary.par_chunks(EDGES_AT_ONCE).map(search).collect::<Result<_>>())?;
    let mut touching = found.concat();
    in_parallel(|| touching.par_sort_unstable());
    touching.dedup();
    Ok(touching.len() as u64)
}

fn touches_inside(point: DVec3, [from, to]: [DVec3; 2], tolerance: f64) -> bool {
    let (step, offset) = (to - from, point - from);
    let length_sq = step.dot(step);
    let length = length_sq.sqrt();
    let along = offset.dot(step) / length_sq;
    let off = offset - step * along;
    along * length > tolerance && (1.0 - along) * length > tolerance && off.dot(off) <= tolerance * tolerance
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::id::TiVec;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn counts_are_those_of_a_plain_search(
            positions in prop::collection::vec(prop::array::uniform3(0i8..5), 20),
            edges in prop::collection::vec(prop::array::uniform2(0u32..20), 0..40),
        ) {
            let positions: TiVec<_, _> = positions.into_iter().map(|p| DVec3::from(p.map(f64::from))).collect();
            let edges: Vec<_> = edges.into_iter().map(|edge| edge.map(MeshVertex::new)).collect();
            let expected = vertices_of(&edges).into_iter().filter(|&v| {
                edges.iter().any(|&edge| {
                    let ends = edge.map(|end| positions[end]);
                    !edge.contains(&v) && touches_inside(positions[v], ends, 1e-6)
                })
            });
            prop_assert_eq!(count_t_junctions(&positions, &edges, 1e-6).unwrap(), expected.count() as u64);
        }
    }

    #[test]
    fn one_long_edge_past_many_short_ones_is_found_quickly() {
        // a comb of short edges; each begins at distance 0 of the long edge at the bottom
        // | | | | | |
        // -----------
        let count = 20_000u32;
        let mut positions = TiVec::from(vec![DVec3::ZERO, DVec3::X * f64::from(count + 1)]);
        let mut boundary = vec![[0, 1].map(MeshVertex::new)];
        for i in 1..=count {
            positions.raw.extend([DVec3::new(f64::from(i), 0.0, 0.0), DVec3::new(f64::from(i), 0.5, 0.0)]);
            boundary.push([2 * i, 2 * i + 1].map(MeshVertex::new));
        }
        assert_eq!(count_t_junctions(&positions, &boundary, 1e-6).unwrap(), u64::from(count));
    }

    #[test]
    fn a_vertex_near_the_end_of_an_edge_is_none() {
        let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1e-7, 0.0, 0.0], [0.0, 1.0, 0.0]].map(DVec3::from);
        let boundary = [[0, 1], [2, 3]].map(|edge| edge.map(MeshVertex::new));
        assert_eq!(count_t_junctions(TiSlice::from_ref(&positions), &boundary, 1e-6).unwrap(), 0);
    }
}
