//! Oblique photogrammetry: quadrics of position and texture, weighted so that rough ground collapses first and dense
//! texture last.
//!
//! # Source
//! Wang, Zhang, Li, Chen, Li, "Lightweight algorithm for preventing texture distortion in oblique photogrammetry model
//! simplification", Foreign Electronic Measurement Technology 43(3), 2024, doi 10.19652/j.cnki.femt.2305585.
//!
//! | symbol | here |
//! | --- | --- |
//! | A, b, c, Q over (x, y, z, u, v) \[4\] to \[7\] | [`WideQuadric`], one for each wedge |
//! | v̄ = -(ΣA)⁻¹(Σb) \[8\]; singular: best of middle, v1, v2 \[3\] | `solve` |
//! | N_i = normalised Σ θ S n over the ring's faces \[10\] | `Place::normal` |
//! | LRS_i = (1/m) Σ angle(N_i, N_j) / \|v_i - v_j\| \[9\] | `Place::fluctuation` |
//! | Ā_i, mean area of the ring's faces \[12\] | `Place::mean_area` |
//! | den(v) = (1/n) Σ S_tex / S \[13\] | `Place::density` |
//! | α: 1.0 smooth, 1.5 seam, 1.2 corner | `alpha-…` |
//! | tex_ij = \|v_i - v_j\| (α_i den_i + α_j den_j) \[13\] | `stretch` |
//! | cost = v̄ᵀ (Ā_i Q_i / LRS_i + Ā_j Q_j / LRS_j) v̄ · tex_ij \[14\] | `place` |
//!
//! The paper's collapse rules: two smooth vertices merge at v̄ with the texture coordinates of v̄; a seam vertex or
//! corner stays where it is when a smooth one collapses onto it; two seam vertices merge at the middle of an edge of
//! their seam, with the mean texture coordinates of each side; all other collapses are forbidden. Both ends or neither
//! lie on the border.
//!
//! The cost is length⁶ times a density, so it is no error bound. Q is accumulated unweighted; the factors are those of
//! the current mesh, recomputed over two rings after each round.
//!
//! # Where we differ
//! * Border vertices also have planes through their border edges, because otherwise a flat corner of the border would
//!   cost nothing, and on even ground the minimum of two border vertices may lie anywhere in the plane, also past the
//!   border. `border=0` is the paper's version.
//! * Two border vertices also need a border edge between them: a chord would pinch the surface.
//! * u and v are scaled to lengths, so den is relative to the mean density of the material, and textures of different
//!   sizes count alike. `unit-bbox=1` takes the paper's literal unit box and unscaled texture coordinates.
//! * LRS is at least `floor` times the median of its positive values in the mesh: on flat ground it is 0.
//! * If the minimum is more than two edge lengths away, the best of the middle and both ends is taken.
//!   `placement=three` always takes the latter, as \[3\] does where the systems are singular.
//! * Collapses are made in rounds, not from a heap, and factors are recomputed between rounds: see
//!   [`engine`](crate::simplify::engine).
//! * A vertex may collapse onto a locked or a non-manifold vertex, which stays.
//! * Without texture, S_tex = S.
//!
//! # Memory
//! 72 bytes a vertex, 168 a wedge.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::around::Around;
use super::fan::{Fan, angle_between};
use super::mesh_stats::MeshStats;
use super::metric::{EdgeCase, Metric, Placement};
use super::parameter::{Parameter, choice, factor, switch};
use super::planes::{LENGTH_SHARE, PlacePolicy, area_of, each_chain_edge, ends, extended, least, plane_of};
use super::wide::WideQuadric;
use crate::base::id::TiVec;
use crate::mesh::class::{Class, Classes, Rule};
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::edge::EdgeKind;
use crate::mesh::id::{LocalVertex, Wedge, WedgePair};
use crate::mesh::ring::Rings;

/// A placement farther from the middle of the edge than this many edge lengths is rejected.
const REACH: f64 = 2.0;

/// Parameters.
pub const PARAMETERS: [Parameter; 10] = [
    factor("border", 1.0, "weight of the planes through border edges; 0 is the paper's"),
    factor("floor", 1e-3, "least fluctuation, in medians of its positive values"),
    factor("alpha-smooth", 1.0, "weight of a smooth vertex's texture density"),
    factor("alpha-seam", 1.5, "weight of a seam vertex's texture density"),
    factor("alpha-corner", 1.2, "weight of a corner's texture density"),
    switch("lrs", 1.0, "0 leaves the fluctuation factor out"),
    switch("mean-area", 1.0, "0 leaves the mean area out"),
    switch("tex", 1.0, "0 leaves the texture deformation factor out"),
    switch("unit-bbox", 0.0, "1 scales positions to the unit box instead of texture coordinates to lengths"),
    choice("placement", PlacePolicy::WORDS, "three places smooth vertices at the best of both ends and the middle"),
];

/// Settings, in the order of [`PARAMETERS`], and the frozen normalisers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ObliqueSettings {
    border: f64,
    floor_share: f64,
    alphas: [f64; 3],
    has_fluctuation: bool,
    has_area: bool,
    has_stretch: bool,
    has_unit_box: bool,
    placement: PlacePolicy,
    /// Least LRS, in 1 / length.
    floor: f64,
    /// Length of a unit of u and v, as they are in the mesh.
    uv_scale: f64,
}

impl From<[f64; 10]> for ObliqueSettings {
    fn from([border, floor_share, smooth, seam, corner, lrs, area, tex, unit, placement]: [f64; 10]) -> Self {
        Self {
            border,
            floor_share,
            alphas: [smooth, seam, corner],
            has_fluctuation: lrs > 0.0,
            has_area: area > 0.0,
            has_stretch: tex > 0.0,
            has_unit_box: unit > 0.0,
            placement: PlacePolicy::from_parameter(placement),
            floor: f64::MIN_POSITIVE,
            uv_scale: 1.0,
        }
    }
}

/// The factors of a vertex.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Place {
    normal: DVec3,
    mean_area: f64,
    /// α times the density.
    density: f64,
    fluctuation: f64,
}

type ObliqueQuadric = WideQuadric<5, 15>;

/// The cost function: a quadric per wedge and factors per vertex of a cluster.
#[derive(Debug)]
pub struct ObliqueCost {
    settings: ObliqueSettings,
    quadrics: TiVec<Wedge, ObliqueQuadric>,
    places: TiVec<LocalVertex, Place>,
    alphas: TiVec<LocalVertex, f32>,
    around: Around,
    fan: Fan,
    neighbours: Vec<LocalVertex>,
    area: f64,
}

impl ObliqueCost {
    fn point(&self, mesh: &ClusterMesh, wedge: Wedge) -> [f64; 5] {
        let uv = mesh.wedge_uv[wedge];
        join(
            mesh.positions[mesh.wedge_vertex[wedge]],
            if uv.is_finite() { uv * self.settings.uv_scale } else { DVec2::ZERO },
        )
    }

    /// Quadric of each wedge from `first` on: the triangles around it, and the planes through border edges.
    fn sum_quadrics(&self, mesh: &ClusterMesh, rings: &Rings, classes: &Classes, first: usize) -> Vec<ObliqueQuadric> {
        let mut quadrics = vec![ObliqueQuadric::default(); mesh.wedge_vertex.len() - first];
        let mut add = |wedge: Wedge, quadric| {
            if let Some(place) = wedge.index().checked_sub(first) {
                quadrics[place] += quadric;
            }
        };
        for face in mesh.living_faces() {
            let wedges = mesh.corners[face];
            let Some((normal, _)) = plane_of(mesh.triangle(face)) else { continue };
            let Some(quadric) = ObliqueQuadric::of_triangle(wedges.map(|wedge| self.point(mesh, wedge))) else {
                continue;
            };
            wedges.into_iter().for_each(|wedge| add(wedge, quadric));
            if self.settings.border <= 0.0 {
                continue;
            }
            each_chain_edge(mesh, rings, classes, face, |a, b, kind| {
                let (pa, pb) = (mesh.positions[a], mesh.positions[b]);
                let Some(upright) = (pb - pa).cross(normal).try_normalize() else { return };
                if kind == EdgeKind::Border {
                    let quadric = ObliqueQuadric::of_plane(upright, -upright.dot(pa), self.settings.border);
                    let ends = [a, b].into_iter().filter_map(|vertex| mesh.wedge_at(face, vertex));
                    ends.for_each(|wedge| add(wedge, quadric));
                }
            });
        }
        quadrics
    }

    /// Computes normal, mean area and density of a vertex.
    fn survey(&mut self, mesh: &ClusterMesh, rings: &Rings, vertex: LocalVertex) {
        self.fan.collect(mesh, rings, vertex);
        let place = &mut self.places[vertex];
        let (mut normal, mut area, mut density, mut count) = (DVec3::ZERO, 0.0, 0.0, 0.0);
        for spoke in self.fan.spokes.iter().filter(|spoke| spoke.area > 0.0) {
            normal += spoke.normal * (spoke.angle * spoke.area);
            area += spoke.area;
            let uv = mesh.uv_triangle(spoke.face);
            let texture = 0.5 * (uv[1] - uv[0]).perp_dot(uv[2] - uv[0]).abs();
            density += if texture.is_finite() { texture / spoke.area } else { 1.0 };
            count += 1.0;
        }
        let count = f64::max(count, 1.0);
        place.normal = normal.normalize_or_zero();
        place.mean_area = area / count;
        place.density = f64::from(self.alphas[vertex]) * density / count;
    }

    /// Computes LRS of a vertex from its neighbours' normals.
    fn measure(&mut self, mesh: &ClusterMesh, rings: &Rings, vertex: LocalVertex) {
        self.neighbours.clear();
        self.neighbours.extend(rings.living(mesh, vertex).flat_map(|corner| mesh.others_of(corner)));
        self.neighbours.sort_unstable();
        self.neighbours.dedup();
        let (centre, normal) = (mesh.positions[vertex], self.places[vertex].normal);
        let (mut sum, mut count) = (0.0, 0.0);
        for &neighbour in &self.neighbours {
            let length = mesh.positions[neighbour].distance(centre);
            if length > 0.0 {
                sum += angle_between(normal, self.places[neighbour].normal) / length;
                count += 1.0;
            }
        }
        self.places[vertex].fluctuation = if count > 0.0 { sum / count } else { 0.0 };
    }

    /// Ā, α times den, and LRS of a vertex.
    #[cfg(test)]
    pub(super) fn factors(&self, vertex: LocalVertex) -> (f64, f64, f64) {
        let place = &self.places[vertex];
        (place.mean_area, place.density, place.fluctuation)
    }

    /// Weight Ā / LRS of a vertex's quadrics.
    fn weight(&self, vertex: LocalVertex) -> f64 {
        let place = &self.places[vertex];
        let area = if self.settings.has_area { place.mean_area } else { 1.0 };
        let fluctuation = if self.settings.has_fluctuation { place.fluctuation.max(self.settings.floor) } else { 1.0 };
        area / fluctuation
    }

    /// tex_ij of an edge of this length.
    fn stretch(&self, edge: &EdgeCase<'_>, length: f64) -> f64 {
        let density = |vertex: LocalVertex| self.places[vertex].density;
        if self.settings.has_stretch { length * (density(edge.from) + density(edge.to)) } else { 1.0 }
    }

    /// v̄ of an edge with free placement: position and texture coordinate.
    fn solve(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>) -> [f64; 5] {
        let (pa, pb) = ends(mesh, edge);
        let Some(&WedgePair { from: wa, to: wb }) = edge.wedges.first() else { return join(pb, DVec2::ZERO) };
        let sum = self.quadrics[wa] + self.quadrics[wb];
        let (a, b) = (self.point(mesh, wa), self.point(mesh, wb));
        let middle: [f64; 5] = std::array::from_fn(|i| 0.5 * (a[i] + b[i]));
        let is_near = |v: &[f64; 5]| {
            let p = DVec3::new(v[0], v[1], v[2]);
            p.distance_squared(0.5 * (pa + pb)) <= REACH * REACH * pa.distance_squared(pb)
        };
        let minimum = match self.settings.placement {
            PlacePolicy::Optimal => sum.minimum().filter(is_near),
            PlacePolicy::BestOfThree => None,
        };
        minimum.unwrap_or_else(|| least([middle, a, b], |v| sum.at(&v)))
    }

    /// Sum of the weighted quadrics if every wedge of `to` keeps its texture coordinate.
    fn cost_onto(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>) -> f64 {
        let Some(&WedgePair { to: first, .. }) = edge.wedges.first() else { return 0.0 };
        let (from_weight, to_weight) = (self.weight(edge.from), self.weight(edge.to));
        let (mut cost, mut wedge) = (0.0, first);
        loop {
            let point = self.point(mesh, wedge);
            cost += to_weight * self.quadrics[wedge].at(&point).max(0.0);
            for pair in edge.wedges.iter().filter(|pair| pair.to == wedge) {
                cost += from_weight * self.quadrics[pair.from].at(&point).max(0.0);
            }
            wedge = mesh.wedge_next[wedge];
            if wedge == first {
                return cost;
            }
        }
    }

    /// Whether both ends lie on a seam, so that the placement is the middle.
    fn is_seam(edge: &EdgeCase<'_>) -> bool {
        edge.wedges.len() > 1
    }
}

fn join(p: DVec3, uv: DVec2) -> [f64; 5] {
    [p.x, p.y, p.z, uv.x, uv.y]
}

impl Metric for ObliqueCost {
    type Settings = ObliqueSettings;

    const WEDGE_BYTES: u64 = 96;
    const NEEDS_STATS: bool = true;

    fn new(settings: &ObliqueSettings) -> Self {
        Self {
            settings: *settings,
            quadrics: TiVec::new(),
            places: TiVec::new(),
            alphas: TiVec::new(),
            around: Around::default(),
            fan: Fan::default(),
            neighbours: Vec::new(),
            area: 0.0,
        }
    }

    fn wants_raw_texture(settings: &ObliqueSettings) -> bool {
        settings.has_unit_box
    }

    fn count(settings: &ObliqueSettings, mesh: &ClusterMesh, rings: &Rings, classes: &Classes, stats: &mut MeshStats) {
        let mut cost = Self::new(settings);
        cost.refresh_factors(mesh, rings, classes);
        for vertex in mesh.vertex_ids().filter(|&vertex| !mesh.is_shared(vertex)) {
            stats.add(cost.places[vertex].fluctuation);
        }
    }

    fn normalise(settings: &mut ObliqueSettings, stats: &MeshStats) {
        settings.floor = stats
            .median()
            .map_or(1.0 / stats.diagonal(), |median| settings.floor_share * median)
            .max(f64::MIN_POSITIVE);
        settings.uv_scale = if settings.has_unit_box { stats.diagonal() } else { 1.0 };
    }

    fn refresh(&mut self, mesh: &ClusterMesh, rings: &Rings, classes: &Classes) {
        self.area = area_of(mesh);
        let kept = std::mem::take(&mut self.quadrics);
        let from = |first| self.sum_quadrics(mesh, rings, classes, first);
        self.quadrics = extended(kept, mesh.wedge_vertex.len(), from);
        self.refresh_factors(mesh, rings, classes);
    }

    fn place(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>) -> Placement {
        let (pa, pb) = ends(mesh, edge);
        let length = pa.distance(pb);
        let (from_weight, to_weight) = (self.weight(edge.from), self.weight(edge.to));
        let at = |pair: &WedgePair, v: &[f64; 5]| {
            from_weight * self.quadrics[pair.from].at(v).max(0.0) + to_weight * self.quadrics[pair.to].at(v).max(0.0)
        };
        let (position, cost) = if edge.onto {
            (pb, self.cost_onto(mesh, edge))
        } else if Self::is_seam(edge) {
            let middle = |pair: &WedgePair| {
                let (a, b) = (self.point(mesh, pair.from), self.point(mesh, pair.to));
                std::array::from_fn(|i| 0.5 * (a[i] + b[i]))
            };
            (0.5 * (pa + pb), edge.wedges.iter().map(|pair| at(pair, &middle(pair))).sum())
        } else {
            let v = self.solve(mesh, edge);
            let cost = edge.wedges.first().map_or(0.0, |pair| at(pair, &v));
            (DVec3::new(v[0], v[1], v[2]), cost)
        };
        let tie = LENGTH_SHARE * length.powi(6);
        Placement { position, cost: cost * self.stretch(edge, length) + tie }
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
        use Class::{Border, BorderCorner, BorderSeam, Corner, Fixed, Seam, Smooth};
        match (from, to, kind) {
            (Smooth, Smooth, EdgeKind::Inner) => Rule::Free,
            (Smooth, Seam | Corner | Fixed, EdgeKind::Inner) => Rule::Onto,
            (Seam, Seam, EdgeKind::Seam) | (Border, Border, EdgeKind::Border) => Rule::Chain,
            (Seam, Fixed, EdgeKind::Seam) | (Border, BorderSeam | BorderCorner | Fixed, EdgeKind::Border) => {
                Rule::ChainOnto
            }
            _ => Rule::Never,
        }
    }

    fn texcoords(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>, _position: DVec3, out: &mut Vec<DVec2>) -> bool {
        let uv = |wedge: Wedge| mesh.wedge_uv[wedge];
        if Self::is_seam(edge) {
            out.extend(edge.wedges.iter().map(|pair| 0.5 * (uv(pair.from) + uv(pair.to))));
        } else {
            let has_uv = edge.wedges.iter().all(|pair| uv(pair.from).is_finite() && uv(pair.to).is_finite());
            let [.., u, v] = self.solve(mesh, edge);
            let solved = if has_uv { DVec2::new(u, v) / self.settings.uv_scale } else { DVec2::NAN };
            out.extend(edge.wedges.iter().map(|_| solved));
        }
        true
    }

    fn follow(&mut self, mesh: &ClusterMesh, rings: &Rings, survivors: &[LocalVertex], changed: &mut Vec<LocalVertex>) {
        let start = changed.len();
        self.around.collect(mesh, rings, survivors, changed);
        for &vertex in &changed[start..] {
            self.survey(mesh, rings, vertex);
        }
        let first = changed[start..].to_vec();
        changed.truncate(start);
        self.around.collect(mesh, rings, &first, changed);
        for &vertex in &changed[start..] {
            self.measure(mesh, rings, vertex);
        }
    }
}

impl ObliqueCost {
    fn refresh_factors(&mut self, mesh: &ClusterMesh, rings: &Rings, classes: &Classes) {
        let [smooth, seam, corner] = self.settings.alphas;
        let alpha = |class: &Class| match class {
            Class::Smooth | Class::Border => smooth,
            Class::Seam | Class::BorderSeam => seam,
            Class::Corner | Class::BorderCorner | Class::Complex | Class::Fixed => corner,
        };
        self.alphas = classes.iter().map(|class| alpha(class) as f32).collect();
        self.places.resize(mesh.positions.len(), Place::default());
        self.around.resize(mesh.positions.len());
        for vertex in mesh.vertex_ids() {
            self.survey(mesh, rings, vertex);
        }
        for vertex in mesh.vertex_ids() {
            self.measure(mesh, rings, vertex);
        }
    }
}
