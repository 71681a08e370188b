//! Local optimisation after the collapse: vertices next to slivers move to the middle of their one-ring.
//!
//! # Source
//! Li, Jiang, Tang, "High-quality simplified algorithm of texture model for detailed features preserving", Application
//! Research of Computers 37(1), 2020, doi 10.19734/j.issn.1001-3695.2018.04.0481; Lévy, Petitjean, Ray, Maillot, "Least
//! squares conformal maps for automatic texture atlas generation", SIGGRAPH 2002.
//!
//! | symbol | here |
//! | --- | --- |
//! | r = 4√3 · area / (l1² + l2² + l3²) \[8\] | [`regularity`], a sliver is below [`SLIVER`] |
//! | σ | `cost::sharpness`, flat enough below [`FLAT`] |
//! | the ring in the plane | `flatten` |
//! | barycentric coordinates averaged over all triangles of ring vertices around the new place \[9, 10\] | `lift` |
//!
//! ```text
//!   +-------+            +-------+
//!   | \   . |            | \   / |
//!   |  . v  |    ──▶     |   v   |      in the plane, then back in space
//!   | /   . |            | /   \ |
//!   +-------+            +-------+
//! ```
//!
//! # Where we differ
//! * The new position is the centroid of the ring's polygon: Voronoi cells can be unbounded.
//! * One sweep in the order of ids; a move takes effect at once, and only if the ring's smallest r rises.
//! * Texture coordinates use the same barycentric coordinates. Seam, border, locked and shared vertices stay, and a
//!   move that folds a face in space or in texture space, or onto another face, is not made.
//! * The two vertices of the ring that are farthest from each other are pinned.
//! * A ring of more than 24 vertices is left as it is: the number of triangles among them is cubic.

use glam::{DVec2, DVec3};
use nalgebra::{Cholesky, DMatrix, DVector};

use crate::base::id::TiVec;
use crate::cost::fan::Fan;
use crate::cost::sharpness::sharpness;
use crate::geometry::triangle::regularity;
use crate::mesh::class::{Class, classify};
use crate::mesh::cluster::{ClusterMesh, flag};
use crate::mesh::id::{Corner, LocalVertex};
use crate::mesh::ring::Rings;
use crate::simplify::fold::FoldCheck;
use crate::simplify::triangle_change::{change_of, uv_survives};

/// A face below this regularity is a sliver.
pub const SLIVER: f64 = 0.5;
/// Vertices of at least this sharpness (radians) stay.
pub const FLAT: f64 = 0.3;
/// Larger rings stay as they are: the number of triangles among their vertices is cubic.
const RING_MAX: usize = 24;

/// Moves each vertex at most once; returns the number of moved vertices.
pub fn relax(mesh: &mut ClusterMesh) -> u64 {
    mesh.compact_faces();
    mesh.unlink_unused_wedges();
    let (mut rings, mut classes, mut fan) = (Rings::default(), TiVec::new(), Fan::default());
    let mut folds = FoldCheck::default();
    rings.build(mesh);
    classify(mesh, &rings, &mut classes);
    let mut moved = 0;
    for vertex in mesh.vertex_ids() {
        if classes[vertex] != Class::Smooth || mesh.is_locked(vertex) || mesh.is_shared(vertex) {
            continue;
        }
        fan.gather(mesh, &rings, vertex);
        let worst = fan.spokes.iter().map(|spoke| regularity(mesh.triangle(spoke.face))).fold(1.0, f64::min);
        if worst >= SLIVER || !fan.is_closed || fan.spokes.len() > RING_MAX || sharpness(&fan) >= FLAT {
            continue;
        }
        if let Some((position, uv)) = middle(mesh, &fan, vertex) {
            let step = Move { vertex, position, uv };
            if step.raises(mesh, &fan, worst, &mut folds) && !folds.finds(mesh, &rings, &[], None, position) {
                step.make(mesh, &fan);
                moved += 1;
            }
        }
    }
    moved
}

/// The position in the middle of a vertex's ring, and its texture coordinate; `None` if the ring cannot be flattened.
fn middle(mesh: &ClusterMesh, fan: &Fan, vertex: LocalVertex) -> Option<(DVec3, DVec2)> {
    let plane = flatten(mesh, fan, vertex)?;
    let weights = lift(&plane, centroid(&plane)?)?;
    let (mut position, mut uv) = (DVec3::ZERO, DVec2::ZERO);
    for (spoke, weight) in fan.spokes.iter().zip(weights) {
        position += mesh.positions[spoke.next] * weight;
        uv += mesh.wedge_at(spoke.face, spoke.next).map_or(DVec2::NAN, |wedge| mesh.wedge_uv[wedge]) * weight;
    }
    position.is_finite().then_some((position, uv))
}

/// The ring's vertices in the plane, by the least squares conformal map of the faces around a vertex; `None` if a face
/// has no area or the system is singular.
fn flatten(mesh: &ClusterMesh, fan: &Fan, vertex: LocalVertex) -> Option<Vec<DVec2>> {
    let count = fan.spokes.len();
    let ring: Vec<DVec3> = fan.spokes.iter().map(|spoke| mesh.positions[spoke.next]).collect();
    let centre = mesh.positions[vertex];
    let (mut pins, mut farthest) = ((0, 1), -1.0);
    for a in 0..count {
        for b in a + 1..count {
            if ring[a].distance_squared(ring[b]) > farthest {
                pins = (a, b);
                farthest = ring[a].distance_squared(ring[b]);
            }
        }
    }
    // The last point is the centre. The unknowns are x and y of each point that is not pinned.
    let pinned = |point: usize| match point {
        _ if point == pins.0 => Some(DVec2::ZERO),
        _ if point == pins.1 => Some(DVec2::new(farthest.sqrt(), 0.0)),
        _ => None,
    };
    let column = |point: usize| point - usize::from(point > pins.0) - usize::from(point > pins.1);
    let mut matrix = DMatrix::<f64>::zeros(2 * count, 2 * (count - 1));
    let mut right = DVector::<f64>::zeros(2 * count);
    for i in 0..count {
        let (p, q) = (ring[i] - centre, ring[(i + 1) % count] - centre);
        let length = p.length();
        let double_area = p.cross(q).length();
        if length <= 0.0 || double_area <= 0.0 {
            return None;
        }
        // The face in its own plane: the centre at 0, p on the x axis.
        let corners = [DVec2::ZERO, DVec2::new(length, 0.0), DVec2::new(p.dot(q) / length, double_area / length)];
        for (k, point) in [count, i, (i + 1) % count].into_iter().enumerate() {
            let side = (corners[(k + 2) % 3] - corners[(k + 1) % 3]) / double_area.sqrt();
            match pinned(point) {
                Some(at) => {
                    right[2 * i] -= side.x * at.x - side.y * at.y;
                    right[2 * i + 1] -= side.y * at.x + side.x * at.y;
                }
                None => {
                    let column = 2 * column(point);
                    matrix[(2 * i, column)] += side.x;
                    matrix[(2 * i, column + 1)] -= side.y;
                    matrix[(2 * i + 1, column)] += side.y;
                    matrix[(2 * i + 1, column + 1)] += side.x;
                }
            }
        }
    }
    let solved = Cholesky::new(matrix.tr_mul(&matrix))?.solve(&matrix.tr_mul(&right));
    let at = |point: usize| {
        let column = |point| 2 * column(point);
        pinned(point).unwrap_or_else(|| DVec2::new(solved[column(point)], solved[column(point) + 1]))
    };
    let plane: Vec<DVec2> = (0..count).map(at).collect();
    plane.iter().all(|p| p.is_finite()).then_some(plane)
}

/// Centroid of the area of a polygon; `None` if it has no area.
fn centroid(polygon: &[DVec2]) -> Option<DVec2> {
    let (mut sum, mut area) = (DVec2::ZERO, 0.0);
    for (i, &a) in polygon.iter().enumerate() {
        let b = polygon[(i + 1) % polygon.len()];
        let across = a.perp_dot(b);
        area += across;
        sum += (a + b) * across;
    }
    let centroid = sum / (3.0 * area);
    centroid.is_finite().then_some(centroid)
}

/// Weight of each vertex of a polygon at a point: its barycentric coordinate, averaged over all triangles of the
/// polygon's vertices that contain the point. `None` if no triangle does.
fn lift(polygon: &[DVec2], at: DVec2) -> Option<Vec<f64>> {
    let mut weights = vec![0.0; polygon.len()];
    let mut triangles = 0.0;
    for a in 0..polygon.len() {
        for b in a + 1..polygon.len() {
            for c in b + 1..polygon.len() {
                let (p, q, r) = (polygon[a], polygon[b], polygon[c]);
                let whole = (q - p).perp_dot(r - p);
                let shares = [(q - at).perp_dot(r - at), (r - at).perp_dot(p - at), (p - at).perp_dot(q - at)];
                if whole == 0.0 || shares.iter().any(|share| share / whole < 0.0) {
                    continue;
                }
                for (vertex, share) in [a, b, c].into_iter().zip(shares) {
                    weights[vertex] += share / whole;
                }
                triangles += 1.0;
            }
        }
    }
    weights.iter_mut().for_each(|weight| *weight /= triangles);
    (triangles > 0.0).then_some(weights)
}

/// A move of a vertex, and with it of its texture coordinate.
struct Move {
    vertex: LocalVertex,
    position: DVec3,
    uv: DVec2,
}

impl Move {
    /// Whether it raises the ring's smallest regularity, `worst`, and turns no face over. Begins the check for folds.
    fn raises(&self, mesh: &ClusterMesh, fan: &Fan, worst: f64, folds: &mut FoldCheck) -> bool {
        folds.begin(true);
        fan.spokes.iter().all(|spoke| {
            let (before, uv_before) = (mesh.triangle(spoke.face), mesh.uv_triangle(spoke.face));
            let (mut after, mut uv_after) = (before, uv_before);
            let Some(k) = mesh.vertices(spoke.face).iter().position(|&v| v == self.vertex) else { return false };
            (after[k], uv_after[k]) = (self.position, self.uv);
            let Some(change) = change_of(before, after) else { return false };
            folds.push(Corner::at(spoke.face, k), &change);
            regularity(after) > worst && uv_survives(uv_before, uv_after, change.areas_sq)
        })
    }

    fn make(&self, mesh: &mut ClusterMesh, fan: &Fan) {
        mesh.positions[self.vertex] = self.position;
        mesh.flags[self.vertex] |= flag::MOVED;
        for spoke in &fan.spokes {
            if let Some(wedge) = mesh.wedge_at(spoke.face, self.vertex)
                && self.uv.is_finite()
            {
                mesh.wedge_uv[wedge] = self.uv;
                mesh.wedge_moved[wedge] = true;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::cluster::samples;
    use crate::mesh::id::short::{v, w};

    /// The grid of 2 × 2 squares with its middle vertex pushed towards an edge of its ring: this makes a sliver.
    fn skewed() -> ClusterMesh {
        let mut mesh = samples::grid(2, 0.0);
        mesh.positions[v(4)] = DVec3::new(1.7, 0.95, 0.0);
        mesh.wedge_uv[w(4)] = DVec2::new(0.17, 0.095);
        mesh
    }

    fn worst(mesh: &ClusterMesh) -> f64 {
        mesh.face_ids().map(|face| regularity(mesh.triangle(face))).fold(1.0, f64::min)
    }

    #[test]
    fn regularity_is_one_for_an_equilateral_triangle_and_half_the_root_of_three_for_half_a_square() {
        let top = DVec3::new(0.5, 0.75f64.sqrt(), 0.0);
        assert!((regularity([DVec3::ZERO, DVec3::X, top]) - 1.0).abs() < 1e-12);
        assert!((regularity([DVec3::ZERO, DVec3::X, DVec3::Y]) - 0.75f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn a_vertex_among_slivers_moves_to_the_middle_and_takes_its_texture_along() {
        let mut mesh = skewed();
        let before = worst(&mesh);
        assert_eq!(relax(&mut mesh), 1);
        assert!(worst(&mesh) > 2.0 * before, "{before} {}", worst(&mesh));
        let (p, uv) = (mesh.positions[v(4)], mesh.wedge_uv[w(4)]);
        assert!((DVec2::new(p.x, p.y) * 0.1 - uv).length() < 1e-9, "an affine texture mapping stays affine: {p} {uv}");
        assert!(p.z.abs() < 1e-12);
        assert_eq!(relax(&mut mesh), 0, "a relaxed vertex stays");
    }

    #[test]
    fn a_flat_ring_is_flattened_to_itself() {
        let mesh = skewed();
        let (mut rings, mut fan) = (Rings::default(), Fan::default());
        rings.build(&mesh);
        fan.gather(&mesh, &rings, v(4));
        let plane = flatten(&mesh, &fan, v(4)).unwrap();
        for (i, a) in fan.spokes.iter().enumerate() {
            for (j, b) in fan.spokes.iter().enumerate() {
                let wanted = mesh.positions[a.next].distance(mesh.positions[b.next]);
                assert!((plane[i].distance(plane[j]) - wanted).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn weights_reproduce_the_point_and_add_up_to_one() {
        let polygon =
            [DVec2::ZERO, DVec2::new(2.0, 0.1), DVec2::new(2.5, 1.5), DVec2::new(0.8, 2.2), DVec2::new(-0.4, 1.0)];
        let at = centroid(&polygon).unwrap();
        let weights = lift(&polygon, at).unwrap();
        let sum: DVec2 = polygon.iter().zip(&weights).map(|(p, w)| *p * *w).sum();
        assert!((sum - at).length() < 1e-12 && (weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert_eq!(lift(&polygon, DVec2::new(9.0, 9.0)), None);
    }

    #[test]
    fn sharp_locked_and_border_vertices_stay() {
        let mut locked = skewed();
        locked.flags[v(4)] |= flag::LOCKED;
        assert_eq!(relax(&mut locked), 0);
        let mut sharp = skewed();
        sharp.positions[v(4)].z = 2.0;
        assert_eq!(relax(&mut sharp), 0);
    }
}
