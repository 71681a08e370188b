//! How crowded with seams a mesh will be once it has fewer faces.

use std::ops::AddAssign;

/// What some of the clusters of a mesh have of faces and seams.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SeamTally {
    /// Number of faces.
    pub faces: u64,
    /// Their area.
    pub area: f64,
    /// Length of the seams between them.
    pub seams: f64,
}

impl SeamTally {
    /// Share of the vertices that would lie on seams if `kept` of the faces were left and all edges were equally long;
    /// above 1 where seams have bends for which there are not vertices enough.
    ///
    /// n equilateral faces of area A have n / 2 vertices and edges of √(4 A / √3 n), so that seams of length L take
    /// ⁴√3 L / √(A n) of the vertices.
    pub fn crowding(&self, kept: f64) -> f64 {
        match self.seams > 0.0 {
            true => 3f64.sqrt().sqrt() * self.seams / (self.area * self.faces as f64 * kept).sqrt(),
            false => 0.0,
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
        assert!((tally.crowding(1.0) - 1.0).abs() < 1e-9, "{}", tally.crowding(1.0));
        assert!((tally.crowding(0.25) - 2.0).abs() < 1e-9);
        assert_eq!(tally.crowding(0.0), f64::INFINITY);
        assert_eq!(SeamTally::default().crowding(0.1), 0.0);
    }
}
