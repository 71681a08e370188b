//! Counts that travel from the clusters of a pass to the report.

use std::ops::AddAssign;

use serde::{Deserialize, Serialize};

use super::floor::Floor;
use crate::base::Findings;
use crate::simplify::Changes;

/// What a pass did to a cluster, or to several: counts that add up.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct Counters {
    /// Faces when the cluster was loaded.
    pub faces_in: u64,
    /// Faces left.
    pub faces_out: u64,
    /// Vertices on seams.
    pub seam_vertices: u64,
    /// Faces dropped because they repeat a vertex.
    pub degenerate_faces: u64,
    /// Faces dropped because an earlier face has the same vertices.
    pub dropped_doubles: u64,
    /// Small connected components dropped.
    pub dropped_pieces: u64,
    /// Their faces.
    pub dropped_piece_faces: u64,
    /// Vertices relocated beside slivers.
    pub optimized_vertices: u64,
    /// Faces of clusters that passed through.
    pub passed_through_faces: u64,
    /// Changes of topology.
    pub changes: Changes,
    /// What prevented further collapses.
    pub floor: Floor,
}

impl AddAssign<&Counters> for Counters {
    fn add_assign(&mut self, other: &Counters) {
        self.faces_in += other.faces_in;
        self.faces_out += other.faces_out;
        self.seam_vertices += other.seam_vertices;
        self.degenerate_faces += other.degenerate_faces;
        self.dropped_doubles += other.dropped_doubles;
        self.dropped_pieces += other.dropped_pieces;
        self.dropped_piece_faces += other.dropped_piece_faces;
        self.optimized_vertices += other.optimized_vertices;
        self.passed_through_faces += other.passed_through_faces;
        self.changes += other.changes;
        self.floor += &other.floor;
    }
}

impl Counters {
    /// Adds the counts of what was repaired and dropped to the findings.
    pub fn note_in(&self, findings: &mut Findings) {
        findings.count("degenerate_faces", self.degenerate_faces);
        findings.count("dropped_doubles", self.dropped_doubles);
        findings.count("dropped_pieces", self.dropped_pieces);
        findings.count("dropped_piece_faces", self.dropped_piece_faces);
        findings.count("optimized_vertices", self.optimized_vertices);
    }
}
