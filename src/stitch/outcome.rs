//! What the passes did, and why they may have stopped short of the target.

use std::time::Duration;

use crate::base::Findings;
use crate::cost::Metric;
use crate::mesh::class::Class;
use crate::simplify::Engine;
use crate::simplify::legality::Refusal;
use crate::store::StoredMesh;

/// What one pass did.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub struct PassReport {
    /// Number of clusters with faces.
    pub clusters: u64,
    /// Faces before.
    pub faces_in: u64,
    /// Faces after.
    pub faces_out: u64,
    /// Highest cost of a collapse, in area × length².
    pub threshold: f64,
    /// Vertices that several clusters use; they were locked.
    pub border_vertices: u64,
    /// Vertices on seams.
    pub seam_vertices: u64,
}

/// Why no more faces could be removed: edges refused in the last pass and vertices that hold still, by cause.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub struct Floor {
    /// Vertices on open borders.
    pub border: u64,
    /// Vertices on seams and at their corners.
    pub seam: u64,
    /// Refusals by the link condition and by folds.
    pub topology: u64,
    /// Refusals that would have ended a piece.
    pub pieces: u64,
    /// Vertices at non-manifold places.
    pub non_manifold: u64,
}

/// The outcome of all passes.
#[derive(Debug)]
pub struct Passes {
    /// The simplified mesh.
    pub mesh: StoredMesh,
    /// Each pass.
    pub reports: Vec<PassReport>,
    /// What was repaired.
    pub findings: Findings,
    /// Time in partitioning, in the first pass, and in the passes after it.
    pub seconds: PassSeconds,
    /// Estimate of the root of the mean squared deviation, in units of length.
    pub rms_estimate: f64,
    /// Faces of the mesh.
    pub faces: u64,
    /// Whether the target was met.
    pub reached: bool,
    /// What stands in the way, if it was not.
    pub floor: Floor,
    /// Most bytes that the work folder held.
    pub scratch_peak: u64,
    /// Most bytes that clusters in work were granted at once.
    pub permit_peak: u64,
}

/// Time by phase.
#[derive(Debug, Clone, Copy, Default)]
pub struct PassSeconds {
    /// Partitioning.
    pub partition: Duration,
    /// Simplifying in the first pass.
    pub simplify: Duration,
    /// Simplifying in the passes after it.
    pub stitch: Duration,
}

impl Floor {
    /// Counts of a cluster after its last stage.
    pub(super) fn of<M: Metric>(engine: &Engine<M>) -> Self {
        let classes = engine.class_counts();
        let count = |class: Class| classes[class as usize];
        let refused = |refusal: Refusal| engine.refusals[refusal as usize];
        Self {
            border: count(Class::Border) + count(Class::BorderSeam) + count(Class::BorderCorner),
            seam: count(Class::Seam) + count(Class::Corner),
            topology: refused(Refusal::Topology) + refused(Refusal::Fold) + refused(Refusal::UvFold),
            pieces: refused(Refusal::Piece),
            non_manifold: count(Class::Fixed),
        }
    }

    /// Adds another cluster's counts.
    pub(super) fn add(&mut self, other: &Floor) {
        self.border += other.border;
        self.seam += other.seam;
        self.topology += other.topology;
        self.pieces += other.pieces;
        self.non_manifold += other.non_manifold;
    }
}
