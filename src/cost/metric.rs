//! What a published system answers about a mesh: the cost of an edge, the place of its vertex, and the rules of its own.
//!
//! The engine is compiled once for each [`Metric`]; every hook that a metric leaves alone costs nothing.

use glam::{DVec2, DVec3, Vec2};

use super::census::Census;
use crate::mesh::class::{Class, Rule};
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::edge::EdgeKind;
use crate::mesh::ring::Rings;

/// An edge whose collapse is to be judged.
#[derive(Debug, Clone, Copy)]
pub struct EdgeCase<'a> {
    /// The vertex that vanishes.
    pub from: u32,
    /// The vertex that stays.
    pub to: u32,
    /// Whether `to` keeps its texture coordinates.
    pub onto: bool,
    /// Whether `to` keeps its place, too.
    pub stays: bool,
    /// Which wedge of `from` becomes which wedge of `to`.
    pub wedges: &'a [(u32, u32)],
    /// How far the texture coordinate of each pair's wedge of `to` moves.
    pub insets: [Vec2; 2],
}

impl<'a> EdgeCase<'a> {
    /// Inside a chart, onto a vertex that keeps its place.
    #[inline(always)]
    pub fn inside(from: u32, to: u32, wedges: &'a [(u32, u32)]) -> Self {
        Self { from, to, onto: true, stays: true, wedges, insets: [Vec2::ZERO; 2] }
    }
}

/// Where the vertex goes and what that costs (area × length²).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Position, relative to the cluster's origin.
    pub position: DVec3,
    /// Cost, at least 0.
    pub cost: f64,
}

/// A wedge of a vertex that moves to its best place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SettlingWedge {
    /// The wedge.
    pub wedge: u32,
    /// What is added to its texture coordinate, if that does not depend on the place.
    pub slide: Option<DVec2>,
}

/// A cost function, with what it keeps for one cluster.
pub trait Metric: Sized {
    /// Weights and normalisers: the same for all clusters of a job.
    type Settings: Clone + Sync;

    /// Bytes that it keeps for a vertex, beyond the 80 of a quadric.
    const VERTEX_BYTES: u64 = 0;
    /// Bytes that it keeps for a wedge, beyond the 72 of a texture quadric.
    const WEDGE_BYTES: u64 = 0;
    /// Whether it needs numbers of the whole mesh.
    const HAS_CENSUS: bool = false;

    /// Whether vertices only collapse onto others, and move to their [best place](Metric::best_step) at the end of a
    /// stage; else every collapse is placed by itself.
    const ENDPOINTS: bool = false;

    /// Whether corners and the ends of seams may vanish along seams and borders. Charts that the edge does not belong to
    /// then keep their wedges, which come to the vertex that stays.
    const CORNERS_VANISH: bool = false;

    /// Without a mesh yet.
    fn new(settings: &Self::Settings) -> Self;

    /// Whether it reads texture coordinates, so that their scale is needed.
    fn reads_texture(_settings: &Self::Settings) -> bool {
        true
    }

    /// Whether texture coordinates are wanted as they came, without the scale of their material.
    fn wants_raw_texture(_settings: &Self::Settings) -> bool {
        false
    }

    /// Adds a cluster's numbers; those of vertices whose faces are not all here are left out.
    fn count(
        _settings: &Self::Settings,
        _mesh: &ClusterMesh,
        _rings: &Rings,
        _classes: &[Class],
        _census: &mut Census,
    ) {
    }

    /// Freezes the normalisers.
    fn settle(_settings: &mut Self::Settings, _census: &Census) {}

    /// Learns which share of the result's vertices seams would take, if texture coordinates are read.
    fn learn_crowding(_settings: &mut Self::Settings, _crowding: f64) {}

    /// Prepares for a stage on the mesh as it stands. O(faces).
    fn refresh(&mut self, mesh: &ClusterMesh, rings: &Rings, classes: &[Class]);

    /// Cost of a collapse, and where its vertex goes.
    fn place(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>) -> Placement;

    /// Costs of collapsing `from`, whose only wedge is `wedge`, onto each of some vertices and their wedges: those of
    /// [`place`](Metric::place), all at once.
    #[inline]
    fn costs_onto(&self, mesh: &ClusterMesh, from: u32, wedge: u32, ends: &[(u32, u32)], costs: &mut Vec<f32>) {
        costs.extend(ends.iter().map(|&(to, end_wedge)| {
            let wedges = [(wedge, end_wedge)];
            self.place(mesh, &EdgeCase::inside(from, to, &wedges)).cost as f32
        }));
    }

    /// Adds what is kept of the vanished vertex and its wedges to those that stay; the mesh is as it was before the collapse.
    fn join(&mut self, mesh: &ClusterMesh, edge: &EdgeCase<'_>);

    /// Follows a wedge of the vanished vertex that keeps its texture coordinate and comes to the vertex that stays; the
    /// mesh is as it was before the collapse.
    #[inline]
    fn bring(&mut self, _mesh: &ClusterMesh, _edge: &EdgeCase<'_>, _wedge: u32) {}

    /// Step that takes a vertex that others collapsed onto to its least error; nothing if it had better stay. Texture
    /// coordinates of its `wedges` move along as best they can, but for those that slide as told.
    #[inline]
    fn best_step(&self, _vertex: u32, _wedges: &[SettlingWedge]) -> Option<DVec3> {
        None
    }

    /// What to add to the texture coordinate of a wedge whose vertex makes a step.
    #[inline]
    fn best_slide(&self, _wedge: u32, _step: DVec3) -> DVec2 {
        DVec2::ZERO
    }

    /// Share of what a seam or border would leave its chart by, where it cuts across a bend, that the vertex that stays
    /// moves into the chart.
    #[inline]
    fn inset(&self) -> f64 {
        0.0
    }

    /// Area of the mesh at the last refresh.
    fn area(&self) -> f64;

    /// What may become of an edge of this kind between two classes, whatever is locked.
    #[inline]
    fn rule(&self, from: Class, to: Class, kind: EdgeKind) -> Rule {
        let leads_on = Self::CORNERS_VANISH && fits_corner(from, kind);
        if fits(from, kind) || leads_on || from == Class::Complex { from.rule(to) } else { Rule::Never }
    }

    /// Whether collapses are refused that fold a face, make it a needle, or turn it over in the texture.
    #[inline]
    fn has_guards(&self) -> bool {
        true
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

/// Whether a corner or the end of a seam may vanish along an edge of this kind.
#[inline]
fn fits_corner(from: Class, kind: EdgeKind) -> bool {
    match from {
        Class::Corner => kind == EdgeKind::Seam,
        Class::BorderSeam | Class::BorderCorner => kind == EdgeKind::Border,
        _ => false,
    }
}

/// Whether a vertex of this class may vanish along an edge of this kind at all.
#[inline]
pub fn fits(from: Class, kind: EdgeKind) -> bool {
    match from {
        Class::Smooth => kind == EdgeKind::Inner,
        Class::Seam => kind == EdgeKind::Seam,
        Class::Border => kind == EdgeKind::Border,
        _ => false,
    }
}
