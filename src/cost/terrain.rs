//! Terrain: quadrics of position, texture and normal in eight dimensions; all border edges are kept.
//!
//! # Source
//! Li, Shi, Zhu, "Simplification approach for 3D terrain with multi-constraints consideration", Geomatics and
//! Information Science of Wuhan University 43(2), 2018, doi 10.13203/j.whugis20160431.
//!
//! | symbol | here |
//! | --- | --- |
//! | (a, b, c) = N = Σ α n / Σ α, not renormalised \[4\] | `normals`; α is the corner's angle |
//! | v = (x, y, z, u, v, a, b, c) \[5\] | `point` |
//! | e1, e2 \[6, 7\]; D², A, b, c \[8\] to \[12\] | [`WideQuadric`], one for each wedge |
//! | interior, general, border edges: none, one, both ends on the border | `class_weight` |
//!
//! The placement is the minimum. The paper repeats its steps "for the edges at the end of the collapsed one", which may
//! mean the costs alone or also the quadrics. Here the quadrics of both ends add, and each round recomputes normals and
//! costs at the new vertices; with `carry=0` it also recomputes the quadrics around them.
//!
//! # Where we differ
//! * Borders are locked: in the paper's table all 566 border edges survive. `border-weights=1` multiplies costs by 1,
//!   `general` and `border` instead.
//! * u and v are scaled to lengths, and N by `normal` times the mean edge length. `box-scale=1` scales N by the
//!   diagonal of the bounding box instead, so that the result depends on the extent.
//! * `raw=1` takes positions, texture coordinates and unit normals unscaled, in whatever units they have.
//! * Without texture u = v = 0.
//! * Collapses are made in rounds, not from a heap: see [`engine`](crate::simplify::engine).
//! * Along a seam the placement is the best of the middle and both ends, on both sides of the seam.
//! * If the minimum is more than two edge lengths away, the best of the middle and both ends is taken.
//!
//! # Memory
//! 40 bytes a vertex, 360 a wedge.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::around::Around;
use super::fan::Fan;
use super::mesh_stats::MeshStats;
use super::metric::{EdgeCase, Metric, Placement, fits};
use super::parameter::{Parameter, factor, switch};
use super::planes::{area_of, ends, extended, least, plane_of, priced, texcoords_along};
use super::wide::WideQuadric;
use crate::base::id::TiVec;
use crate::mesh::class::{Class, Classes, Rule};
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::edge::EdgeKind;
use crate::mesh::id::{FaceId, LocalVertex, Wedge, WedgePair};
use crate::mesh::ring::Rings;

/// A placement farther from the middle of the edge than this many edge lengths is rejected.
const REACH: f64 = 2.0;

/// Parameters.
pub const PARAMETERS: [Parameter; 7] = [
    factor("normal", 0.1, "weight of the normal, in mean edge lengths (box diagonals with box-scale)"),
    switch("box-scale", 0.0, "1 scales the normal by the diagonal of the box"),
    switch("border-weights", 0.0, "1 weights edges by class instead of locking borders"),
    factor("general", 10.0, "weight of an edge with one end on the border"),
    factor("border", 1e6, "weight of an edge with both ends on the border"),
    switch("raw", 0.0, "1 takes texture coordinates and unit normals as they are"),
    switch("carry", 1.0, "0 recomputes the quadrics around new vertices instead of adding them"),
];

/// Settings, in the order of [`PARAMETERS`], and the frozen scale.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TerrainSettings {
    normal: f64,
    has_box_scale: bool,
    has_weights: bool,
    general: f64,
    border: f64,
    is_raw: bool,
    carries: bool,
    /// Length that a unit normal is scaled to.
    normal_scale: f64,
}

impl From<[f64; 7]> for TerrainSettings {
    fn from([normal, box_scale, weights, general, border, raw, carry]: [f64; 7]) -> Self {
        Self {
            normal,
            has_box_scale: box_scale > 0.0,
            has_weights: weights > 0.0,
            general,
            border,
            is_raw: raw > 0.0,
            carries: carry > 0.0,
            normal_scale: 0.0,
        }
    }
}

type TerrainQuadric = WideQuadric<8, 36>;

/// The cost function: a quadric per wedge and a normal per vertex of a cluster.
#[derive(Debug)]
pub struct TerrainCost {
    settings: TerrainSettings,
    quadrics: TiVec<Wedge, TerrainQuadric>,
    /// Scaled normals.
    normals: TiVec<LocalVertex, DVec3>,
    is_border: TiVec<LocalVertex, bool>,
    around: Around,
    fan: Fan,
    area: f64,
}

impl TerrainCost {
    /// Quadric of each wedge from `first` on: the sum over the triangles around it.
    fn sum_quadrics(&self, mesh: &ClusterMesh, first: usize) -> Vec<TerrainQuadric> {
        let mut quadrics = vec![TerrainQuadric::default(); mesh.wedge_vertex.len() - first];
        for face in mesh.living_faces() {
            let Some(quadric) = self.of_face(mesh, face) else { continue };
            for at in mesh.corners[face].into_iter().filter_map(|wedge| wedge.index().checked_sub(first)) {
                quadrics[at] += quadric;
            }
        }
        quadrics
    }

    /// The squared distance to a face; `None` if the face has no area.
    fn of_face(&self, mesh: &ClusterMesh, face: FaceId) -> Option<TerrainQuadric> {
        plane_of(mesh.triangle(face))?;
        TerrainQuadric::of_triangle(mesh.corners[face].map(|wedge| self.point(mesh, wedge)))
    }

    /// Recomputes the quadrics of a vertex's wedges.
    fn sum_around(&mut self, mesh: &ClusterMesh, rings: &Rings, vertex: LocalVertex) {
        let corners = || rings.of(vertex).iter().filter_map(|&corner| Some((corner, mesh.living(corner)?)));
        corners().for_each(|(_, wedge)| self.quadrics[wedge] = TerrainQuadric::default());
        for (corner, wedge) in corners() {
            if let Some(quadric) = self.of_face(mesh, corner.face()) {
                self.quadrics[wedge] += quadric;
            }
        }
    }

    fn point(&self, mesh: &ClusterMesh, wedge: Wedge) -> [f64; 8] {
        let vertex = mesh.wedge_vertex[wedge];
        let (p, n, uv) = (mesh.positions[vertex], self.normals[vertex], mesh.wedge_uv[wedge]);
        let uv = if uv.is_finite() { uv } else { DVec2::ZERO };
        [p.x, p.y, p.z, uv.x, uv.y, n.x, n.y, n.z]
    }

    fn find_normal(&mut self, mesh: &ClusterMesh, rings: &Rings, vertex: LocalVertex) {
        self.fan.collect(mesh, rings, vertex);
        self.normals[vertex] = mean_normal(&self.fan) * self.settings.normal_scale;
    }

    fn class_weight(&self, edge: &EdgeCase<'_>) -> f64 {
        match (self.is_border[edge.from], self.is_border[edge.to]) {
            _ if !self.settings.has_weights => 1.0,
            (false, false) => 1.0,
            (true, true) => self.settings.border,
            _ => self.settings.general,
        }
    }

    /// Placement of a free edge in eight dimensions, and its cost; `None` if the edge has no wedge pair.
    fn solve(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>) -> Option<([f64; 8], f64)> {
        let (pa, pb) = ends(mesh, edge);
        let &WedgePair { from: wa, to: wb } = edge.wedges.first()?;
        let sum = self.quadrics[wa] + self.quadrics[wb];
        let is_near = |v: &[f64; 8]| {
            let p = DVec3::new(v[0], v[1], v[2]);
            p.distance_squared(0.5 * (pa + pb)) <= REACH * REACH * pa.distance_squared(pb)
        };
        let best = sum.minimum().filter(is_near).unwrap_or_else(|| {
            let (a, b) = (self.point(mesh, wa), self.point(mesh, wb));
            least([between(&a, &b, 0.5), a, b], |v| sum.at(&v))
        });
        Some((best, sum.at(&best)))
    }

    /// Cost of the position `share` along an edge, summed over all sides of the edge.
    fn cost_at(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>, share: f64) -> f64 {
        let cost = |&WedgePair { from: wa, to: wb }: &WedgePair| {
            let v = between(&self.point(mesh, wa), &self.point(mesh, wb), share);
            (self.quadrics[wa] + self.quadrics[wb]).at(&v)
        };
        edge.wedges.iter().map(cost).sum()
    }

    fn seam_share(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>) -> f64 {
        least([0.5, 0.0, 1.0], |share| self.cost_at(mesh, edge, share))
    }

    /// Cost of the wedges of the vertex that stays that are in no wedge pair of the edge.
    fn cost_beside(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>) -> f64 {
        let Some(&WedgePair { to: first, .. }) = edge.wedges.first() else { return 0.0 };
        let (mut cost, mut wedge) = (0.0, mesh.wedge_next[first]);
        while wedge != first {
            if !edge.wedges.iter().any(|pair| pair.to == wedge) {
                cost += self.quadrics[wedge].at(&self.point(mesh, wedge));
            }
            wedge = mesh.wedge_next[wedge];
        }
        cost
    }
}

#[cfg(test)]
impl TerrainCost {
    /// The scaled normal of a vertex.
    pub(super) fn normal(&self, vertex: LocalVertex) -> DVec3 {
        self.normals[vertex]
    }
}

/// N of a vertex: the mean of its faces' normals by angle, shorter than 1 at sharp vertices.
fn mean_normal(fan: &Fan) -> DVec3 {
    let (mut sum, mut angles) = (DVec3::ZERO, 0.0);
    for spoke in fan.spokes.iter().filter(|spoke| spoke.area > 0.0) {
        sum += spoke.normal * spoke.angle;
        angles += spoke.angle;
    }
    if angles > 0.0 { sum / angles } else { DVec3::ZERO }
}

fn between(a: &[f64; 8], b: &[f64; 8], share: f64) -> [f64; 8] {
    std::array::from_fn(|i| a[i] + share * (b[i] - a[i]))
}

impl Metric for TerrainCost {
    type Settings = TerrainSettings;

    const WEDGE_BYTES: u64 = 288;
    const NEEDS_STATS: bool = true;

    fn new(settings: &TerrainSettings) -> Self {
        Self {
            settings: *settings,
            quadrics: TiVec::new(),
            normals: TiVec::new(),
            is_border: TiVec::new(),
            around: Around::default(),
            fan: Fan::default(),
            area: 0.0,
        }
    }

    fn wants_raw_texture(settings: &TerrainSettings) -> bool {
        settings.is_raw
    }

    /// Counts the edges of every face. Inner edges count twice, wherever the clusters' borders are.
    fn count(_: &TerrainSettings, mesh: &ClusterMesh, _: &Rings, _: &Classes, stats: &mut MeshStats) {
        for face in mesh.living_faces() {
            let [a, b, c] = mesh.triangle(face);
            [a.distance(b), b.distance(c), c.distance(a)].into_iter().for_each(|length| stats.add(length));
        }
    }

    fn normalise(settings: &mut TerrainSettings, stats: &MeshStats) {
        let length = if settings.has_box_scale { stats.diagonal() } else { stats.mean().unwrap_or(0.0) };
        settings.normal_scale = if settings.is_raw { 1.0 } else { settings.normal * length };
    }

    fn refresh(&mut self, mesh: &ClusterMesh, rings: &Rings, classes: &Classes) {
        self.area = area_of(mesh);
        self.normals.resize(mesh.positions.len(), DVec3::ZERO);
        self.around.resize(mesh.positions.len());
        for vertex in mesh.vertex_ids() {
            self.find_normal(mesh, rings, vertex);
        }
        self.is_border = classes.iter().map(|class| class.is_border()).collect();
        let kept = std::mem::take(&mut self.quadrics);
        self.quadrics = extended(kept, mesh.wedge_vertex.len(), |first| self.sum_quadrics(mesh, first));
    }

    fn place(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>) -> Placement {
        let (pa, pb) = ends(mesh, edge);
        let (position, cost) = if edge.onto {
            (pb, self.cost_at(mesh, edge, 1.0) + self.cost_beside(mesh, edge))
        } else if edge.wedges.len() > 1 {
            let share = self.seam_share(mesh, edge);
            (pa.lerp(pb, share), self.cost_at(mesh, edge, share))
        } else {
            match self.solve(mesh, edge) {
                Some((v, cost)) => (DVec3::new(v[0], v[1], v[2]), cost),
                None => (pb, 0.0),
            }
        };
        priced(mesh, edge, position, cost.max(0.0) * self.class_weight(edge))
    }

    fn join(&mut self, _mesh: &ClusterMesh, edge: &EdgeCase<'_>) {
        for pair in edge.wedges {
            let vanished = self.quadrics[pair.from];
            self.quadrics[pair.to] += vanished;
        }
    }

    fn area(&self) -> f64 {
        self.area
    }

    fn rule(&self, from: Class, to: Class, kind: EdgeKind) -> Rule {
        let is_allowed = self.settings.has_weights || !from.is_border();
        if is_allowed && fits(from, kind) { from.rule(to) } else { Rule::Never }
    }

    fn texcoords(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>, _position: DVec3, out: &mut Vec<DVec2>) -> bool {
        let uv = |wedge: Wedge| mesh.wedge_uv[wedge];
        if edge.wedges.len() > 1 {
            texcoords_along(mesh, edge, self.seam_share(mesh, edge), out);
            return true;
        }
        let has_uv = edge.wedges.iter().all(|pair| uv(pair.from).is_finite() && uv(pair.to).is_finite());
        let solved = self.solve(mesh, edge).filter(|_| has_uv).map_or(DVec2::NAN, |(v, _)| DVec2::new(v[3], v[4]));
        out.extend(edge.wedges.iter().map(|_| solved));
        true
    }

    fn follow(&mut self, mesh: &ClusterMesh, rings: &Rings, survivors: &[LocalVertex], changed: &mut Vec<LocalVertex>) {
        if self.settings.carries {
            survivors.iter().for_each(|&vertex| self.find_normal(mesh, rings, vertex));
            return;
        }
        let start = changed.len();
        self.around.collect(mesh, rings, survivors, changed);
        changed[start..].iter().for_each(|&vertex| self.find_normal(mesh, rings, vertex));
        changed[start..].iter().for_each(|&vertex| self.sum_around(mesh, rings, vertex));
    }
}
