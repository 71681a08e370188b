//! Counts of what is left of a cluster.

use super::Engine;
use crate::cost::Metric;
use crate::mesh::class::Class;
use crate::mesh::doubles::doubles;
use crate::mesh::id::LocalVertex;

impl<M: Metric> Engine<M> {
    /// Number of living vertices of each class, in the order of [`Class::ALL`].
    pub fn class_counts(&self) -> [u64; 8] {
        let mut counts = [0; 8];
        for (vertex, &class) in self.classes.iter_enumerated() {
            if !self.rings.of(vertex).is_empty() {
                counts[class as usize] += 1;
            }
        }
        counts
    }

    /// Number of faces with three non-manifold vertices that have the vertices of another face: copies or back sides.
    pub fn doubles(&self) -> u64 {
        let is_complex = |v: &LocalVertex| self.classes.get(*v) == Some(&Class::Complex);
        let living = self.mesh.living_faces().map(|face| self.mesh.vertices(face));
        doubles(living.filter(|vertices| vertices.iter().all(is_complex))).len() as u64
    }
}
