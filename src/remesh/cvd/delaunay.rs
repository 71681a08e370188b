//! Makes the dual Delaunay where it is flat: an edge flips if the angles opposite to it add up to more than π.
//!
//! ```text
//!      c               c
//!     / \             /|\
//!    a---b    ──▶    a | b       both faces nearly keep their plane, and their side in texture space
//!     \ /             \|/
//!      d               d
//! ```
//! # Source
//! Lawson, "Software for C1 surface interpolation", 1977. As in Liu, Xu, Fan 2015, which the paper's dual is based on,
//! the triangulation is only Delaunay-like: where the surface bends, edges stay along the bends.

use glam::{DVec2, DVec3};

use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::{Corner, FaceId, LocalVertex, Wedge};
use crate::mesh::ring::Rings;
use crate::simplify::triangle_change::{triangle_survives, uv_survives};

/// Faces keep their edge if their normals differ by more than this (cosine of a tenth of a radian).
const FLAT_COSINE: f64 = 0.995;
/// An edge flips if the sum of the cotangents opposite to it is below this: a little below 0, so that no edge flips
/// back and forth.
const COTANGENT_MAX: f64 = -1e-6;
/// Largest number of sweeps over all edges.
const SWEEPS: u32 = 12;

/// Flips edges until no more can flip, in at most twelve sweeps; returns the number of flips.
pub fn flip(mesh: &mut ClusterMesh) -> u64 {
    mesh.compact_faces();
    let mut rings = Rings::default();
    // Last sweep in which the ring of each vertex changed.
    let mut touched = mesh.per_vertex(0);
    let mut flipped = 0;
    for sweep in 1..=SWEEPS {
        rings.build(mesh);
        let before = flipped;
        for face in mesh.face_ids() {
            for k in 0..3 {
                // After the first sweep only faces near changes matter.
                if mesh.vertices(face).iter().all(|&v| touched[v] + 1 < sweep) {
                    break;
                }
                let Some(hinge) = Hinge::at(mesh, &rings, face, k) else { continue };
                let vertices = hinge.wedges.map(|w| mesh.wedge_vertex[w]);
                if vertices.iter().all(|&v| touched[v] != sweep) && hinge.should_flip(mesh, &rings) {
                    hinge.flip(mesh);
                    vertices.iter().for_each(|&v| touched[v] = sweep);
                    flipped += 1;
                    break;
                }
            }
        }
        if flipped == before {
            break;
        }
    }
    flipped
}

/// Two faces (a, b, c) and (b, a, d), which have the same wedges at a and b.
#[derive(Debug, Clone, Copy)]
struct Hinge {
    faces: [FaceId; 2],
    /// a, b, c, d.
    wedges: [Wedge; 4],
}

impl Hinge {
    /// The hinge at an edge of a face; `None` unless the edge has exactly one other face, which must have the same
    /// wedges there and a higher id.
    fn at(mesh: &ClusterMesh, rings: &Rings, face: FaceId, k: usize) -> Option<Self> {
        let [a, b, c] = [k, k + 1, k + 2].map(|k| mesh.corners[face][k % 3]);
        let [va, vb] = [a, b].map(|w| mesh.wedge_vertex[w]);
        let (mut other, mut count) = (None, 0);
        let [searched, _] = rings.search_order([va, vb]);
        let at_a = |corner: &Corner| corner.face().corners().into_iter().find(|&c| mesh.vertex_of(c) == va);
        for corner in rings.of(searched).iter().filter_map(at_a) {
            let far = corner.others();
            if far.iter().any(|&corner| mesh.vertex_of(corner) == vb) {
                count += 1;
                if corner.face() != face && (mesh.wedge_of(corner), mesh.wedge_of(far[1])) == (a, b) {
                    other = Some((corner.face(), mesh.wedge_of(far[0])));
                }
            }
        }
        let (second, d) = other.filter(|&(second, _)| count == 2 && second > face)?;
        Some(Self { faces: [face, second], wedges: [a, b, c, d] })
    }

    fn should_flip(&self, mesh: &ClusterMesh, rings: &Rings) -> bool {
        let [a, b, c, d] = self.wedges.map(|w| mesh.wedge_vertex[w]);
        let is_rim = |x: LocalVertex, y: LocalVertex| mesh.is_shared(x) && mesh.is_shared(y);
        let [first, second] = self.faces.map(|face| mesh.parts[face]);
        if is_rim(a, b) || is_rim(c, d) || c == d || first != second {
            return false;
        }
        let [pa, pb, pc, pd] = [a, b, c, d].map(|v| mesh.positions[v]);
        let cotangent = |at: DVec3, x: DVec3, y: DVec3| (x - at).dot(y - at) / (x - at).cross(y - at).length();
        let opposite = cotangent(pc, pa, pb) + cotangent(pd, pa, pb);
        if opposite.is_nan() || opposite >= COTANGENT_MAX {
            return false;
        }
        let old = [[pa, pb, pc], [pb, pa, pd]];
        let new = [[pc, pa, pd], [pd, pb, pc]];
        let normal = |t: [DVec3; 3]| (t[1] - t[0]).cross(t[2] - t[0]).normalize_or_zero();
        let is_flat = |t: [DVec3; 3]| old.iter().all(|&u| normal(t).dot(normal(u)) > FLAT_COSINE);
        if !is_flat(old[0])
            || !new.into_iter().all(is_flat)
            || !new.iter().zip(old).all(|(&n, o)| triangle_survives(o, n))
        {
            return false;
        }
        let [ua, ub, uc, ud] = self.wedges.map(|w| mesh.wedge_uv[w]);
        let old_uv: [[DVec2; 3]; 2] = [[ua, ub, uc], [ub, ua, ud]];
        let new_uv = [[uc, ua, ud], [ud, ub, uc]];
        let area_sq = |t: [DVec3; 3]| (t[1] - t[0]).cross(t[2] - t[0]).length_squared();
        let keeps_texture = |i: usize, k: usize| uv_survives(old_uv[i], new_uv[k], [area_sq(old[i]), area_sq(new[k])]);
        let pairs = [(0, 0), (0, 1), (1, 0), (1, 1)];
        pairs.into_iter().all(|(i, k)| keeps_texture(i, k)) && !are_joined(mesh, rings, c, d)
    }

    fn flip(&self, mesh: &mut ClusterMesh) {
        let [a, b, c, d] = self.wedges;
        let deviation = self.faces.map(|face| mesh.deviations[face]).into_iter().fold(0.0, f32::max);
        for (face, corners) in self.faces.into_iter().zip([[c, a, d], [d, b, c]]) {
            mesh.corners[face] = corners;
            mesh.corner_vertices[face] = corners.map(|w| mesh.wedge_vertex[w]);
            mesh.deviations[face] = deviation;
        }
    }
}

fn are_joined(mesh: &ClusterMesh, rings: &Rings, a: LocalVertex, b: LocalVertex) -> bool {
    let [a, b] = rings.search_order([a, b]);
    rings.living(mesh, a).any(|corner| mesh.others_of(corner).contains(&b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::cluster::{flag, samples};
    use crate::mesh::id::short::{f, v, w};

    //  3-------2       a long diamond, split along the wrong diagonal
    //   \    / /
    //    0---1
    fn diamond(height: f64) -> ClusterMesh {
        let corners = [[-2.0, 0.0, 0.0], [0.0, -0.5, height], [2.0, 0.0, 0.0], [0.0, 0.5, 0.0]].map(DVec3::from);
        samples::mesh_of(corners.map(|corner| (corner, corner.truncate())), &[[0, 1, 2], [2, 3, 0]])
    }

    #[test]
    fn the_short_diagonal_replaces_the_long_one_once() {
        let mut mesh = diamond(0.0);
        assert_eq!(flip(&mut mesh), 1);
        assert!(mesh.corner_vertices.iter().all(|face| face.contains(&v(1)) && face.contains(&v(3))));
        for face in mesh.face_ids() {
            let [a, b, c] = mesh.triangle(face);
            assert!((b - a).cross(c - a).z > 0.0, "no face turns over");
        }
        assert_eq!(flip(&mut mesh), 0);
    }

    #[test]
    fn an_edge_stays_where_it_is_a_crease_a_seam_or_another_clusters() {
        assert_eq!(flip(&mut diamond(0.3)), 0);
        let mut seam = diamond(0.0);
        let wedge = seam.push_wedge(v(2), DVec2::new(9.0, 9.0));
        seam.corners[f(1)][0] = wedge;
        seam.link_wedges();
        assert_eq!(flip(&mut seam), 0);
        for pair in [[0, 2], [1, 3]] {
            let mut rim = diamond(0.0);
            pair.iter().for_each(|&at| rim.flags[v(at)] |= flag::SHARED);
            assert_eq!(flip(&mut rim), 0);
        }
    }

    #[test]
    fn an_edge_that_would_turn_the_texture_over_stays() {
        let mut mesh = diamond(0.0);
        mesh.wedge_uv[w(3)] = DVec2::new(-6.0, 0.5);
        assert_eq!(flip(&mut mesh), 0);
    }
}
