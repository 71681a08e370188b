//! What a published system answers about a mesh: the cost of an edge, the place of its vertex, and the rules of its own.
//!
//! The engine is compiled once for each [`Metric`]; every hook that a metric leaves alone costs nothing.

use glam::{DVec2, DVec3};

use super::surface::{EdgeCase, EdgeKind, Placement};
use crate::mesh::class::{Class, Rule};
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::ring::Rings;

/// A cost function, with what it keeps for one cluster.
pub trait Metric: Sized {
    /// Weights and normalisers: the same for all clusters of a job.
    type Settings: Clone + Sync;

    /// Without a mesh yet.
    fn new(settings: &Self::Settings) -> Self;

    /// Prepares for a stage on the mesh as it stands. O(faces).
    fn refresh(&mut self, mesh: &ClusterMesh, rings: &Rings, classes: &[Class]);

    /// Cost of a collapse, and where its vertex goes.
    fn place(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>) -> Placement;

    /// Adds what is kept of the vanished vertex and its wedges to those that stay.
    fn join(&mut self, edge: &EdgeCase<'_>);

    /// Area of the mesh at the last refresh.
    fn area(&self) -> f64;

    /// What may become of an edge of this kind between two classes, whatever is locked.
    #[inline]
    fn rule(&self, from: Class, to: Class, kind: EdgeKind) -> Rule {
        let fits = match from {
            Class::Smooth => kind == EdgeKind::Inner,
            Class::Seam => kind == EdgeKind::Seam,
            Class::Border => kind == EdgeKind::Border,
            _ => false,
        };
        if fits { from.rule(to) } else { Rule::Never }
    }

    /// The metric's own texture coordinate for each wedge pair of a collapse to `position`, in `out`; false to take those
    /// of the old surface there.
    #[inline]
    fn texcoords(&self, _mesh: &ClusterMesh, _edge: &EdgeCase<'_>, _position: DVec3, _out: &mut Vec<DVec2>) -> bool {
        false
    }

    /// Follows the collapses of a round: `survivors` are the vertices that others collapsed into. Vertices whose edges
    /// cost something else now are added to `changed`; survivors need not be.
    #[inline]
    fn follow(&mut self, _mesh: &ClusterMesh, _rings: &Rings, _survivors: &[u32], _changed: &mut Vec<u32>) {}
}
