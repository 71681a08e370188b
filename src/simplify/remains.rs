//! Counts of what is left of a cluster.

use super::Engine;
use crate::cost::Metric;
use crate::mesh::class::Class;
use crate::mesh::doubles::doubles;

impl<M: Metric> Engine<M> {
    /// Number of living vertices of each class, in the order of [`Class::ALL`].
    pub fn class_counts(&self) -> [u64; 8] {
        let mut counts = [0; 8];
        for vertex in 0..self.classes.len() {
            if !self.rings.of(vertex as u32).is_empty() {
                counts[self.classes[vertex] as usize] += 1;
            }
        }
        counts
    }

    /// Number of faces with three non-manifold vertices that have the vertices of another face: copies or back sides.
    pub fn doubles(&self) -> u64 {
        let is_fixed = |v: &u32| self.classes.get(*v as usize) == Some(&Class::Complex);
        let faces = self.mesh.corner_vertices.iter().zip(0u32..);
        let living = faces.filter(|&(_, face)| !self.mesh.is_dead(face)).map(|(vertices, _)| *vertices);
        let at_fixed: Vec<[u32; 3]> = living.filter(|vertices| vertices.iter().all(is_fixed)).collect();
        doubles(at_fixed.len(), |face| at_fixed[face as usize]).len() as u64
    }
}
