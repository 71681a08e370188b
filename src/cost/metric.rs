//! The interface of a cost function: cost of an edge, placement of its vertex, and its own collapse rules.
//!
//! The engine is compiled once for each [`Metric`], so a hook that a metric does not override costs no time.

use std::borrow::Cow;

use glam::{DVec2, DVec3, Vec2};

use super::crease::near_folds;
use super::mesh_stats::MeshStats;
use crate::mesh::class::{Class, Classes, Rule};
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::edge::EdgeKind;
use crate::mesh::id::{End, LocalVertex, Wedge, WedgePair};
use crate::mesh::ring::Rings;

/// Collapses whose costs are computed together.
pub const LANES: usize = 4;

/// A collapse whose cost is to be computed.
#[derive(Debug, Clone, Copy)]
pub struct EdgeCase<'a> {
    /// The vertex that vanishes.
    pub from: LocalVertex,
    /// The vertex that stays.
    pub to: LocalVertex,
    /// Whether `to` keeps its texture coordinates.
    pub onto: bool,
    /// Whether `to` also keeps its position.
    pub stays: bool,
    /// Wedges of `from`, and the wedges of `to` that they become.
    pub wedges: &'a [WedgePair],
    /// Change of the texture coordinate of each pair's wedge of `to`, in units of length.
    pub insets: [Vec2; 2],
}

impl<'a> EdgeCase<'a> {
    /// A collapse inside a chart, onto a vertex that keeps its position.
    #[inline(always)]
    pub fn inside(from: LocalVertex, to: LocalVertex, wedges: &'a [WedgePair]) -> Self {
        Self { from, to, onto: true, stays: true, wedges, insets: [Vec2::ZERO; 2] }
    }
}

/// Placement of a collapse and its cost (area × length² in the default metric).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Position, relative to the cluster's origin.
    pub position: DVec3,
    /// Cost, at least 0.
    pub cost: f64,
}
/// A wedge of a vertex that is relocated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MovingWedge {
    /// The wedge.
    pub wedge: Wedge,
    /// Fixed change of its texture coordinate; `None` to choose the one of least error for the new position.
    pub slide: Option<DVec2>,
}

/// A cost function, with its state for one cluster.
pub trait Metric: Sized {
    /// Weights and normalisers: the same for all clusters of a job.
    type Settings: Clone + Sync;

    /// Bytes of state per vertex, in addition to the 80 of a quadric.
    const VERTEX_BYTES: u64 = 0;
    /// Bytes of state per wedge, in addition to the 72 of a texture quadric.
    const WEDGE_BYTES: u64 = 0;
    /// Whether it needs statistics of the whole mesh.
    const NEEDS_STATS: bool = false;

    /// Whether vertices collapse only onto edge ends, and are relocated by [`best_step`](Metric::best_step) at the end
    /// of a stage. If `false`, each collapse has its own placement.
    const ENDPOINTS: bool = false;

    /// Whether corners and the ends of seams may vanish along seams and borders. Charts that do not contain the edge
    /// then keep their wedges, which move to the vertex that stays.
    const CORNERS_VANISH: bool = false;

    /// A cost function without quadrics; [`refresh`](Metric::refresh) must follow.
    fn new(settings: &Self::Settings) -> Self;

    /// Whether it reads texture coordinates, so that their scale must be measured.
    fn reads_texture(_settings: &Self::Settings) -> bool {
        true
    }

    /// Whether it needs texture coordinates without the scale of their material.
    fn wants_raw_texture(_settings: &Self::Settings) -> bool {
        false
    }

    /// Adds a cluster's values to the statistics; vertices that another cluster shares are left out.
    fn count(
        _settings: &Self::Settings,
        _mesh: &ClusterMesh,
        _rings: &Rings,
        _classes: &Classes,
        _stats: &mut MeshStats,
    ) {
    }

    /// Sets the normalisers from the statistics of the whole mesh.
    fn normalise(_settings: &mut Self::Settings, _stats: &MeshStats) {}

    /// Sets the predicted share of the result's vertices that lie on seams; called if texture coordinates are read.
    fn learn_seam_density(_settings: &mut Self::Settings, _density: f64) {}

    /// Updates its state to the current mesh, at the start of a stage. O(faces).
    fn refresh(&mut self, mesh: &ClusterMesh, rings: &Rings, classes: &Classes);

    /// Cost and placement of a collapse.
    fn place(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>) -> Placement;

    /// Cost of collapsing the vertex of `from`, which has no other wedge, onto `to`: the same as from
    /// [`place`](Metric::place).
    #[inline(always)]
    fn cost_onto(&self, mesh: &ClusterMesh, from: End, to: End) -> f32 {
        let wedges = [WedgePair { from: from.wedge, to: to.wedge }];
        self.place(mesh, &EdgeCase::inside(from.vertex, to.vertex, &wedges)).cost as f32
    }

    /// Costs of collapsing the vertex of `from`, which has no other wedge, onto each of `ends`: the same as from
    /// [`place`](Metric::place), computed together.
    #[inline(always)]
    fn costs_onto(&self, mesh: &ClusterMesh, from: End, ends: &[End; LANES]) -> [f32; LANES] {
        ends.map(|to| self.cost_onto(mesh, from, to))
    }

    /// Asks for the memory of a vertex's state, which is used soon.
    #[inline(always)]
    fn prefetch(&self, _vertex: LocalVertex) {}

    /// Asks for the memory of a wedge's state, which is used soon.
    #[inline(always)]
    fn prefetch_wedge(&self, _wedge: Wedge) {}

    /// Adds the state of the vanished vertex and its wedges to those that stay. Called before the mesh changes.
    fn join(&mut self, mesh: &ClusterMesh, edge: &EdgeCase<'_>);

    /// Updates the state of a wedge of the vanished vertex that keeps its texture coordinate and moves to the vertex
    /// that stays. Called before the mesh changes.
    #[inline]
    fn bring(&mut self, _mesh: &ClusterMesh, _edge: &EdgeCase<'_>, _wedge: Wedge) {}

    /// Step of a vertex to its position of least error; `None` if it should stay. The texture coordinates of `wedges`
    /// take their own best values, except those with a fixed `slide`.
    #[inline]
    fn best_step(&self, _vertex: LocalVertex, _wedges: &[MovingWedge]) -> Option<DVec3> {
        None
    }

    /// Change of the texture coordinate of a wedge that has the least error when its vertex makes `step`.
    #[inline]
    fn best_slide(&self, _wedge: Wedge, _step: DVec3) -> DVec2 {
        DVec2::ZERO
    }

    /// Share of the overhang of a straightened seam or border beyond its chart by which the texture coordinates of the
    /// vertex that stays move into the chart, 0 to 1.
    #[inline]
    fn inset(&self) -> f64 {
        0.0
    }

    /// Vertices of faces that are close to folded onto each other. The mesh must be as at the last refresh.
    fn near_folds(&self, mesh: &ClusterMesh, rings: &Rings) -> Cow<'_, [LocalVertex]> {
        Cow::Owned(near_folds(mesh, rings))
    }

    /// Area of the mesh at the last refresh.
    fn area(&self) -> f64;

    /// Rule for an edge of this kind between two classes, before locks.
    #[inline]
    fn rule(&self, from: Class, to: Class, kind: EdgeKind) -> Rule {
        let leads_on = Self::CORNERS_VANISH && fits_corner(from, kind);
        if fits(from, kind) || leads_on || from == Class::Complex { from.rule(to) } else { Rule::Never }
    }

    /// Whether the engine refuses collapses that fold a face, make it a needle, or turn it over in the texture.
    #[inline]
    fn has_guards(&self) -> bool {
        true
    }

    /// Appends to `out` the texture coordinate of each wedge pair for a collapse to `position`. Returns `false`, and
    /// appends none, to take those of the old surface there.
    #[inline]
    fn texcoords(&self, _mesh: &ClusterMesh, _edge: &EdgeCase<'_>, _position: DVec3, _out: &mut Vec<DVec2>) -> bool {
        false
    }

    /// Updates the state after a round of collapses; `survivors` are the vertices that others collapsed onto. Appends
    /// to `changed` the vertices whose edges have a new cost; survivors may be left out.
    #[inline]
    fn follow(
        &mut self,
        _mesh: &ClusterMesh,
        _rings: &Rings,
        _survivors: &[LocalVertex],
        _changed: &mut Vec<LocalVertex>,
    ) {
    }
}

/// Whether a corner or the end of a seam may vanish along an edge of this kind.
#[inline]
fn fits_corner(from: Class, kind: EdgeKind) -> bool {
    match from {
        Class::Corner => kind == EdgeKind::Seam,
        Class::BorderSeam | Class::BorderCorner => kind == EdgeKind::Border,
        _ => false,
    }
}

/// Whether a smooth, seam or border vertex may vanish along an edge of this kind; `false` for all other classes.
#[inline]
pub fn fits(from: Class, kind: EdgeKind) -> bool {
    match from {
        Class::Smooth => kind == EdgeKind::Inner,
        Class::Seam => kind == EdgeKind::Seam,
        Class::Border => kind == EdgeKind::Border,
        _ => false,
    }
}
