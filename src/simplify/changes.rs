//! How often the topology changed, and where.

use serde::{Deserialize, Serialize};

/// Changes of the topology that were made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Changes {
    /// Holes that were closed, by a collapse or by faces of their own.
    pub holes_closed: u64,
    /// Handles and necks that were cut.
    pub handles_cut: u64,
    /// Pieces of the surface that vanished.
    pub pieces_dropped: u64,
    /// Area of their last triangles, in units of length².
    pub pieces_area: f64,
    /// Border vertices that were welded to those of another border, or of another part of their own.
    pub vertices_welded: u64,
    /// Vertices at non-manifold places that are no more, or are at such places no more.
    pub complex_resolved: u64,
}

impl std::ops::AddAssign for Changes {
    fn add_assign(&mut self, other: Self) {
        self.holes_closed += other.holes_closed;
        self.handles_cut += other.handles_cut;
        self.pieces_dropped += other.pieces_dropped;
        self.pieces_area += other.pieces_area;
        self.vertices_welded += other.vertices_welded;
        self.complex_resolved += other.complex_resolved;
    }
}
