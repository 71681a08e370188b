//! Splits edges of a mesh at given points; its surface and parametrisation stay as they are.
//!
//! ```text
//!        c                     c
//!       / \                   /|\
//!      /   \        ──▶      / | \        every point lies on its edge, and takes the texture
//!     /     \               /  |  \       coordinate that the edge has there
//!    a-------b             a---p---b
//! ```
//! A face with several points on its edges is retriangulated so that its thinnest triangle is as regular as possible.

use glam::DVec3;

use super::cluster::{ClusterMesh, flag};
use super::id::{LocalVertex, Wedge};
use crate::geometry::triangle::regularity;

/// A point on an edge whose ends have the same wedges in all of its faces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgePoint {
    /// The end vertices, the lower id first.
    pub ends: [LocalVertex; 2],
    /// Position along the edge, from 0 at the first end to 1 at the second, both excluded.
    pub share: f64,
}

impl EdgePoint {
    /// Position of the point, relative to the cluster's origin.
    pub fn position(&self, mesh: &ClusterMesh) -> DVec3 {
        let [a, b] = self.ends.map(|end| mesh.positions[end]);
        a.lerp(b, self.share)
    }
}

/// Inserts a vertex at each point. `points` must be sorted by ends, then by share. New vertices have consecutive ids in
/// the order of the points.
pub fn split_edges(mesh: &mut ClusterMesh, points: &[EdgePoint]) {
    let before = mesh.positions.len();
    for point in points {
        mesh.push_vertex(point.position(mesh), flag::MOVED);
    }
    // Wedge of each point, set when the first face at its edge is visited.
    let mut wedges = vec![Wedge::NONE; points.len()];
    let mut scratch = SplitBuffers::default();
    for face in mesh.face_ids() {
        if mesh.is_dead(face) {
            continue;
        }
        let vertices = mesh.vertices(face);
        let on_edge = [0, 1, 2].map(|k| {
            let (a, b) = (vertices[k], vertices[(k + 1) % 3]);
            let ends = [a.min(b), a.max(b)];
            let start = points.partition_point(|point| point.ends < ends);
            start..start + points[start..].partition_point(|point| point.ends == ends)
        });
        if on_edge.iter().all(|range| range.is_empty()) {
            continue;
        }
        scratch.outline.clear();
        for (k, range) in on_edge.into_iter().enumerate() {
            let corners = [mesh.corners[face][k], mesh.corners[face][(k + 1) % 3]];
            scratch.outline.push(corners[0]);
            let forwards = vertices[k] < vertices[(k + 1) % 3];
            for step in 0..range.len() {
                let at = if forwards { range.start + step } else { range.end - 1 - step };
                if wedges[at] == Wedge::NONE {
                    let [low, high] = if forwards { corners } else { [corners[1], corners[0]] };
                    wedges[at] = new_wedge(mesh, LocalVertex::from(before + at), [low, high], points[at].share);
                }
                scratch.outline.push(wedges[at]);
            }
        }
        scratch.triangulate(mesh);
        let (part, deviation, is_turned) = (mesh.parts[face], mesh.deviations[face], mesh.is_turned[face]);
        for (number, &corners) in scratch.triangles.iter().enumerate() {
            if number == 0 {
                mesh.corners[face] = corners;
                mesh.corner_vertices[face] = corners.map(|w| mesh.wedge_vertex[w]);
            } else {
                let added = mesh.push_face(corners, part);
                mesh.deviations[added] = deviation;
                mesh.is_turned[added] = is_turned;
            }
        }
    }
}

/// Adds the only wedge of a new vertex, with a texture coordinate interpolated between two wedges; returns its id.
fn new_wedge(mesh: &mut ClusterMesh, vertex: LocalVertex, ends: [Wedge; 2], share: f64) -> Wedge {
    let [a, b] = ends.map(|wedge| mesh.wedge_uv[wedge]);
    let wedge = mesh.push_wedge(vertex, a.lerp(b, share));
    mesh.wedge_next.push(wedge);
    mesh.wedge_moved.push(true);
    wedge
}

/// Buffers for one face.
#[derive(Debug, Default)]
struct SplitBuffers {
    /// Wedges around the face, counter-clockwise.
    outline: Vec<Wedge>,
    triangles: Vec<[Wedge; 3]>,
    /// For each pair of outline corners: the lowest regularity on the far side of the chord, and the corner chosen
    /// there.
    best: Vec<(f64, usize)>,
}

impl SplitBuffers {
    /// Triangulates the outline, which is convex, so that the lowest regularity is as high as possible. O(corners³).
    fn triangulate(&mut self, mesh: &ClusterMesh) {
        let Self { outline, triangles, best } = self;
        let count = outline.len();
        let at = |i: usize| mesh.positions[mesh.wedge_vertex[outline[i]]];
        best.clear();
        best.resize(count * count, (f64::INFINITY, 0));
        for span in 2..count {
            for i in 0..count - span {
                let j = i + span;
                let mut chosen = (f64::NEG_INFINITY, i + 1);
                for k in i + 1..j {
                    let roundness = regularity([at(i), at(k), at(j)]);
                    let worst = roundness.min(best[i * count + k].0).min(best[k * count + j].0);
                    if worst > chosen.0 {
                        chosen = (worst, k);
                    }
                }
                best[i * count + j] = chosen;
            }
        }
        triangles.clear();
        let mut open = vec![(0, count - 1)];
        while let Some((i, j)) = open.pop() {
            if j - i < 2 {
                continue;
            }
            let k = best[i * count + j].1;
            triangles.push([outline[i], outline[k], outline[j]]);
            open.extend([(i, k), (k, j)]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::cluster::samples;
    use super::super::ring::Rings;
    use super::super::{Class, class};
    use super::*;
    use crate::base::id::TiVec;
    use crate::mesh::id::short::v;

    fn area(mesh: &ClusterMesh) -> f64 {
        mesh.face_ids()
            .map(|face| {
                let [a, b, c] = mesh.triangle(face);
                0.5 * (b - a).cross(c - a).z
            })
            .sum()
    }

    //  6--7--8
    //  | /| /|      points on 0-4 (two), 4-8 and 3-4
    //  3--4--5
    //  | /| /|
    //  0--1--2
    #[test]
    fn surface_and_texture_stay_and_new_vertices_are_smooth() {
        let mut mesh = samples::grid(2, 0.0);
        let points = [([0, 4], 0.25), ([0, 4], 0.5), ([3, 4], 0.5), ([4, 8], 0.75)];
        let points = points.map(|(ends, share)| EdgePoint { ends: ends.map(v), share });
        split_edges(&mut mesh, &points);
        assert_eq!((mesh.positions.len(), mesh.face_count), (13, 8 + 2 * 4));
        assert!((area(&mesh) - 4.0).abs() < 1e-12);
        assert_eq!(mesh.positions[v(9)], DVec3::new(0.25, 0.25, 0.0));
        for face in mesh.face_ids() {
            assert!(regularity(mesh.triangle(face)) > 0.1, "{:?}", mesh.triangle(face));
            for (p, uv) in mesh.triangle(face).iter().zip(mesh.uv_triangle(face)) {
                assert!((p.truncate() * 0.1 - uv).length() < 1e-12);
            }
        }
        let (mut rings, mut classes) = (Rings::default(), TiVec::new());
        rings.build(&mesh);
        class::classify(&mesh, &rings, &mut classes);
        assert!((9..13).all(|at| classes[v(at)] == Class::Smooth));
    }
}
