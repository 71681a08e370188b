//! Counts of topology changes.

use serde::{Deserialize, Serialize};

/// Number of topology changes of each kind.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Changes {
    /// Holes closed by a collapse or by new faces.
    pub holes_closed: u64,
    /// Handles and necks cut.
    pub handles_cut: u64,
    /// Connected components removed.
    pub pieces_dropped: u64,
    /// Area of the last triangles of these components, in units of length².
    pub pieces_area: f64,
    /// Border vertices welded to another border, or to another part of their own.
    pub vertices_welded: u64,
    /// Non-manifold vertices that vanished or became manifold.
    pub complex_resolved: u64,
    /// Faces removed by collapses that may fold faces or turn them over, since the target was out of reach otherwise.
    pub faces_forced: u64,
}

impl std::ops::AddAssign for Changes {
    fn add_assign(&mut self, other: Self) {
        self.holes_closed += other.holes_closed;
        self.handles_cut += other.handles_cut;
        self.pieces_dropped += other.pieces_dropped;
        self.pieces_area += other.pieces_area;
        self.vertices_welded += other.vertices_welded;
        self.complex_resolved += other.complex_resolved;
        self.faces_forced += other.faces_forced;
    }
}
