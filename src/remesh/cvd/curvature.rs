//! k1² + k2² at each vertex: a quadratic height function fitted to the vertices nearby.
//!
//! # Source
//! Cazals, Pouget, "Estimating differential quantities using polynomial fitting of osculating jets", Computer Aided
//! Geometric Design 22(2), 2005: the jet of degree 2, z = b0 + b1 x + b2 y + b3 x² + b4 xy + b5 y², fitted by least
//! squares in a frame whose z axis is the normal; lengths are divided by the neighbourhood's radius first (their
//! preconditioning). Curvatures are those of the height function at the vertex.
//!
//! ```text
//!   E = 1 + b1²   F = b1 b2   G = 1 + b2²     e, f, g = 2 b3, b4, 2 b5 over √(1 + b1² + b2²)
//!   H = (eG - 2fF + gE) / 2(EG - F²)    K = (eg - f²) / (EG - F²)    k1² + k2² = 4H² - 2K
//! ```

use glam::DVec3;
use nalgebra::{Cholesky, SMatrix, SVector};

use crate::base::id::TiVec;
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::{FaceId, LocalVertex};
use crate::mesh::ring::Rings;

/// Coefficients of the jet.
const COEFFICIENTS: usize = 6;
/// Largest number of vertices in a neighbourhood: rings of vertices with a high valence are truncated.
const NEIGHBOURS_MAX: usize = 96;

/// Fits jets; holds only buffers.
#[derive(Debug, Default)]
pub struct JetFitter {
    near: Vec<LocalVertex>,
    seen: TiVec<LocalVertex, u32>,
    epoch: u32,
}

impl JetFitter {
    /// k1² + k2² at a vertex, in 1 / length², fitted to `ring_count` rings around it; 0 if there are too few vertices
    /// for a fit.
    pub fn squared_curvature(
        &mut self,
        mesh: &ClusterMesh,
        rings: &Rings,
        vertex: LocalVertex,
        ring_count: u32,
    ) -> f64 {
        self.gather(mesh, rings, vertex, ring_count);
        let Some(normal) = normal_at(mesh, rings, vertex) else { return 0.0 };
        let centre = mesh.positions[vertex];
        let points = self.near.iter().map(|&v| mesh.positions[v] - centre);
        fit(points, normal).unwrap_or(0.0)
    }

    /// Collects the vertices within `ring_count` rings, the centre first.
    fn gather(&mut self, mesh: &ClusterMesh, rings: &Rings, vertex: LocalVertex, ring_count: u32) {
        self.seen.resize(mesh.positions.len(), 0);
        self.epoch += 1;
        self.near.clear();
        self.near.push(vertex);
        self.seen[vertex] = self.epoch;
        let mut start = 0;
        for _ in 0..ring_count {
            let end = self.near.len();
            for at in start..end {
                for &corner in rings.of(self.near[at]) {
                    for v in mesh.others_of(corner) {
                        if self.near.len() >= NEIGHBOURS_MAX {
                            return;
                        }
                        if self.seen[v] != self.epoch {
                            self.seen[v] = self.epoch;
                            self.near.push(v);
                        }
                    }
                }
            }
            start = end;
        }
    }
}

/// Area-weighted normal of the faces around a vertex; `None` if it is zero.
fn normal_at(mesh: &ClusterMesh, rings: &Rings, vertex: LocalVertex) -> Option<DVec3> {
    let across = |face: FaceId| {
        let [a, b, c] = mesh.triangle(face);
        (b - a).cross(c - a)
    };
    rings.faces(mesh, vertex).map(across).sum::<DVec3>().try_normalize()
}

/// k1² + k2² at the origin, of the jet through points around it; `None` if the fit is singular.
fn fit(points: impl Iterator<Item = DVec3> + Clone, normal: DVec3) -> Option<f64> {
    let radius_sq = points.clone().map(|p| p.length_squared()).fold(0.0, f64::max);
    if radius_sq <= 0.0 {
        return None;
    }
    let scale = 1.0 / radius_sq.sqrt();
    let (x_axis, y_axis) = normal.any_orthonormal_pair();
    let mut matrix = SMatrix::<f64, COEFFICIENTS, COEFFICIENTS>::zeros();
    let mut right = SVector::<f64, COEFFICIENTS>::zeros();
    let mut count = 0;
    for point in points {
        let (x, y, z) = (point.dot(x_axis) * scale, point.dot(y_axis) * scale, point.dot(normal) * scale);
        let row = SVector::<f64, COEFFICIENTS>::from([1.0, x, y, x * x, x * y, y * y]);
        matrix.ger(1.0, &row, &row, 1.0);
        right.axpy(z, &row, 1.0);
        count += 1;
    }
    if count < COEFFICIENTS {
        return None;
    }
    let jet = Cholesky::new(matrix)?.solve(&right);
    let (fx, fy) = (jet[1], jet[2]);
    let (e, f, g) = (1.0 + fx * fx, fx * fy, 1.0 + fy * fy);
    let steepness = (1.0 + fx * fx + fy * fy).sqrt();
    let (l, m, n) = (2.0 * jet[3] / steepness, jet[4] / steepness, 2.0 * jet[5] / steepness);
    let area_sq = e * g - f * f;
    let mean = (l * g - 2.0 * m * f + n * e) / (2.0 * area_sq);
    let gauss = (l * n - m * m) / area_sq;
    let sum = (4.0 * mean * mean - 2.0 * gauss) * scale * scale;
    (sum.is_finite()).then_some(sum.max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::cluster::samples;

    fn curvature(mesh: &ClusterMesh, vertex: u32) -> f64 {
        let mut rings = Rings::default();
        rings.build(mesh);
        JetFitter::default().squared_curvature(mesh, &rings, LocalVertex::new(vertex), 2)
    }

    fn bent(height: impl Fn(f64, f64) -> f64) -> ClusterMesh {
        let mut mesh = samples::grid(6, 0.0);
        for p in &mut mesh.positions {
            *p = DVec3::new(p.x - 3.0, p.y - 3.0, 0.0) * 0.1;
            p.z = height(p.x, p.y);
        }
        mesh
    }

    #[test]
    fn a_plane_has_none_and_a_paraboloid_that_of_its_coefficients() {
        assert!(curvature(&samples::grid(6, 0.0), 24) < 1e-20);
        // z = x² - 3 y² has k1 = 2 and k2 = -6 at its saddle.
        let saddle = curvature(&bent(|x, y| x * x - 3.0 * y * y), 24);
        assert!((saddle - 40.0).abs() < 1e-9, "{saddle}");
    }

    #[test]
    fn a_sphere_has_two_over_its_squared_radius_and_a_cylinder_one() {
        let sphere = curvature(&bent(|x, y| (25.0 - x * x - y * y).sqrt()), 24);
        assert!((sphere * 25.0 / 2.0 - 1.0).abs() < 0.01, "{sphere}");
        let cylinder = curvature(&bent(|x, _| (25.0 - x * x).sqrt()), 24);
        assert!((cylinder * 25.0 - 1.0).abs() < 0.01, "{cylinder}");
    }

    #[test]
    fn it_scales_with_the_inverse_square_and_does_not_turn_with_the_mesh() {
        let mesh = bent(|x, y| x * x + 0.4 * x * y - 2.0 * y * y + x * x * x);
        let expected = curvature(&mesh, 24);
        let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 1.1, -2.0);
        let mut moved = mesh.clone();
        moved.positions.iter_mut().for_each(|p| *p = turn * *p * 7.0 + DVec3::splat(40.0));
        let found = curvature(&moved, 24) * 49.0;
        assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
    }

    #[test]
    fn a_corner_with_too_few_neighbours_has_none() {
        let mesh = samples::grid(1, 0.0);
        assert_eq!(curvature(&mesh, 0), 0.0);
    }
}
