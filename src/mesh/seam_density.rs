//! Predicts the seam density of the simplified mesh.

use std::ops::AddAssign;

/// Faces, area and seam length, summed over clusters.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SeamTally {
    /// Number of faces.
    pub faces: u64,
    /// Total area of the faces.
    pub area: f64,
    /// Total length of the seams.
    pub seams: f64,
}

impl SeamTally {
    /// Predicted share of vertices on seams if the share `kept` of the faces is left and all edges have the same
    /// length. 0 without seams; above 1 if the bends of the seams need more vertices than there are.
    ///
    /// n equilateral faces of total area A have n / 2 vertices and edges of length √(4 A / √3 n), so seams of length L
    /// take ⁴√3 L / √(A n) of the vertices.
    pub fn seam_density(&self, kept: f64) -> f64 {
        if self.seams > 0.0 {
            3f64.sqrt().sqrt() * self.seams / (self.area * self.faces as f64 * kept).sqrt()
        } else {
            0.0
        }
    }
}

impl AddAssign for SeamTally {
    fn add_assign(&mut self, other: Self) {
        self.faces += other.faces;
        self.area += other.area;
        self.seams += other.seams;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seam_through_every_vertex_crowds_everything() {
        // 100 equilateral faces of area 1 have edges of 1.52; 50 of these make a seam.
        let tally = SeamTally { faces: 100, area: 100.0, seams: 50.0 * (4.0 / 3f64.sqrt()).sqrt() };
        assert!((tally.seam_density(1.0) - 1.0).abs() < 1e-9, "{}", tally.seam_density(1.0));
        assert!((tally.seam_density(0.25) - 2.0).abs() < 1e-9);
        assert_eq!(tally.seam_density(0.0), f64::INFINITY);
        assert_eq!(SeamTally::default().seam_density(0.1), 0.0);
    }
}
