//! What prevents further collapses.

use std::ops::AddAssign;

use crate::cost::Metric;
use crate::mesh::class::Class;
use crate::simplify::Engine;
use crate::simplify::refusal::Refusal;

/// Why no more faces could be removed: counts of refused edges and of locked vertices in the last pass, by cause.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub struct Floor {
    /// Vertices on open borders.
    pub border: u64,
    /// Vertices on seams and at their corners.
    pub seam: u64,
    /// Collapses refused by the link condition or because they fold the surface or its texture.
    pub topology: u64,
    /// Collapses refused because they would remove a connected component.
    pub pieces: u64,
    /// Non-manifold vertices, and fixed ones: of too high a valence, without faces, or shared with other clusters.
    pub non_manifold: u64,
    /// Faces with the same three vertices as another face: copies or back sides.
    pub doubles: u64,
}

impl Floor {
    /// Counts the causes in a cluster after its last stage.
    pub(super) fn of<M: Metric>(engine: &Engine<M>) -> Self {
        let classes = engine.class_counts();
        let count = |class: Class| classes[class as usize];
        let refused = |refusal: Refusal| engine.refusals[refusal as usize];
        Self {
            border: count(Class::Border) + count(Class::BorderSeam) + count(Class::BorderCorner),
            seam: count(Class::Seam) + count(Class::Corner),
            topology: refused(Refusal::Topology) + refused(Refusal::Fold) + refused(Refusal::UvFold),
            pieces: refused(Refusal::Piece),
            non_manifold: count(Class::Complex) + count(Class::Fixed),
            doubles: engine.doubles(),
        }
    }
}

impl AddAssign<&Floor> for Floor {
    fn add_assign(&mut self, other: &Floor) {
        self.border += other.border;
        self.seam += other.seam;
        self.topology += other.topology;
        self.pieces += other.pieces;
        self.non_manifold += other.non_manifold;
        self.doubles += other.doubles;
    }
}
