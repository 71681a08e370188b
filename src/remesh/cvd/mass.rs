//! Masses of vertices, and their mean over the whole mesh.
//!
//! ```text
//!   [13]  ρ = |P| (√(k1² + k2²))^λ      |P|: a third of the area of the faces around the vertex
//!   [12]  D_avg = Σ ρ / n               n: the number of cells wanted
//! ```
//! k1² + k2² is at least a share of its positive median, so that flat ground has a mass. One pass over the clusters
//! gives both median and sum: it counts vertices, and sums ρ and |P|, by the magnitude of k1² + k2².
//!
//! # Memory
//! 36 bytes for each magnitude that occurs, 64 per power of two.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::curvature::JetFitter;
use crate::base::id::TiVec;
use crate::cost::planes::plane_of;
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::LocalVertex;
use crate::mesh::ring::Rings;

/// Low bits of a double that a magnitude drops: 64 magnitudes per power of two remain.
const MAGNITUDE_SHIFT: u32 = 46;
/// A surface that turns by less than this (radians) over a vertex's part counts as flat: the rest is rounding error.
const FLAT_TURN: f64 = 1e-6;

/// A vertex's part of the surface, and its curvature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VertexPart {
    /// |P|, in units of length².
    pub area: f64,
    /// k1² + k2², in 1 / length².
    pub squared_curvature: f64,
}

impl VertexPart {
    /// ρ \[13\]; curvatures below the floor count as the floor.
    pub fn mass(&self, lambda: f64, floor: f64) -> f64 {
        self.area * libm::pow(self.squared_curvature.max(floor), 0.5 * lambda)
    }
}

/// The part of every vertex.
pub fn parts(mesh: &ClusterMesh, rings: &Rings, ring_count: u32) -> TiVec<LocalVertex, VertexPart> {
    let mut areas = mesh.per_vertex(0.0);
    for face in mesh.living_faces() {
        if let Some((_, area)) = plane_of(mesh.triangle(face)) {
            mesh.vertices(face).iter().for_each(|&v| areas[v] += area / 3.0);
        }
    }
    let mut fitter = JetFitter::default();
    let part = |(vertex, area): (LocalVertex, f64)| {
        let squared_curvature = fitter.squared_curvature(mesh, rings, vertex, ring_count);
        let is_flat = squared_curvature * area < FLAT_TURN * FLAT_TURN;
        VertexPart { area, squared_curvature: if is_flat { 0.0 } else { squared_curvature } }
    };
    areas.into_iter_enumerated().map(part).collect()
}

/// Sums over the vertices of one magnitude.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
struct Sum {
    count: u64,
    area: f64,
    mass: f64,
}

/// Sums over the mesh, by magnitude of k1² + k2².
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct MassSums {
    magnitudes: BTreeMap<u32, Sum>,
}

impl MassSums {
    /// Adds a vertex.
    pub fn add(&mut self, part: VertexPart, lambda: f64) {
        let magnitude = (part.squared_curvature.to_bits() >> MAGNITUDE_SHIFT) as u32;
        let sum = self.magnitudes.entry(magnitude).or_default();
        sum.count += 1;
        sum.area += part.area;
        sum.mass += part.mass(lambda, 0.0);
    }

    /// Adds the sums of another cluster. Clusters must come in order, because sums are rounded.
    pub fn merge(&mut self, other: &Self) {
        for (&magnitude, theirs) in &other.magnitudes {
            let ours = self.magnitudes.entry(magnitude).or_default();
            ours.count += theirs.count;
            ours.area += theirs.area;
            ours.mass += theirs.mass;
        }
    }

    /// Number of vertices.
    pub fn count(&self) -> u64 {
        self.magnitudes.values().map(|sum| sum.count).sum()
    }

    /// The floor of k1² + k2²: `share` times its positive median, at most 1/32 too low; 1 if no vertex has curvature.
    pub fn floor(&self, share: f64) -> f64 {
        let positive = || self.magnitudes.iter().filter(|&(&magnitude, _)| magnitude > 0);
        let half = positive().map(|(_, sum)| sum.count).sum::<u64>().div_ceil(2);
        let mut seen = 0;
        for (&magnitude, sum) in positive() {
            seen += sum.count;
            if seen >= half {
                let median = f64::from_bits(u64::from(magnitude) << MAGNITUDE_SHIFT);
                // Rounded down to the start of a magnitude, so that each magnitude lies on one side.
                return f64::from_bits((median * share).to_bits() >> MAGNITUDE_SHIFT << MAGNITUDE_SHIFT);
            }
        }
        1.0
    }

    /// Σ ρ; curvatures below the floor count as the floor.
    pub fn total(&self, lambda: f64, floor: f64) -> f64 {
        let first = (floor.to_bits() >> MAGNITUDE_SHIFT) as u32;
        let below = libm::pow(floor, 0.5 * lambda);
        let of = |(&magnitude, sum): (&u32, &Sum)| if magnitude < first { sum.area * below } else { sum.mass };
        self.magnitudes.iter().map(of).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_by_magnitude_are_those_of_the_parts() {
        let part = |i: u32| VertexPart { area: f64::from(i % 7 + 1), squared_curvature: f64::from(i * i % 53) * 0.37 };
        let mut sums = [MassSums::default(), MassSums::default()];
        (0..200).for_each(|i| sums[usize::from(i > 90)].add(part(i), 2.0));
        let mut whole = sums[0].clone();
        whole.merge(&sums[1]);
        let mut values: Vec<f64> = (0..200).map(|i| part(i).squared_curvature).filter(|&k| k > 0.0).collect();
        values.sort_by(f64::total_cmp);
        let floor = whole.floor(0.5);
        let wanted = 0.5 * values[values.len().div_ceil(2) - 1];
        assert!(floor <= wanted && floor > wanted * (1.0 - 1.0 / 32.0), "{floor} {wanted}");
        let expected: f64 = (0..200).map(|i| part(i).mass(2.0, floor)).sum();
        assert!((whole.total(2.0, floor) / expected - 1.0).abs() < 1e-12);
        assert_eq!(whole.count(), 200);
    }

    #[test]
    fn where_nothing_bends_mass_is_area() {
        let mut sums = MassSums::default();
        (1..=4).for_each(|i| sums.add(VertexPart { area: f64::from(i), squared_curvature: 0.0 }, 2.0));
        let floor = sums.floor(1e-3);
        assert_eq!((floor, sums.total(2.0, floor)), (1.0, 10.0));
    }
}
