//! Which pass it is, and what it does.

use crate::remesh::cvd::CvdSettings;

/// A pass over all clusters.
#[derive(Debug, Clone, Copy)]
pub struct Pass {
    /// Number of the pass, from 0.
    pub number: usize,
    /// Its index among the passes that collapse edges; 0 if it remeshes.
    pub turn: usize,
    /// What is done to each cluster.
    pub kind: PassKind,
}

/// What a pass does to each cluster.
#[derive(Debug, Clone, Copy)]
pub enum PassKind {
    /// Remeshes it by centroidal Voronoi cells.
    Remesh(CvdSettings),
    /// Collapses its edges.
    Collapse,
}

impl Pass {
    /// Whether it is the first that collapses edges.
    pub(super) fn is_first_turn(self) -> bool {
        self.turn == 0
    }
}
