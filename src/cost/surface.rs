//! The default cost: squared distance to the planes of the surface, of its borders and seams, and, with texture,
//! squared texture drift, all weighted by area. Sharp edges are held like borders (`crease.rs`).
//!
//! # Source
//! Garland & Heckbert 1997 and 1998 ("Simplifying surfaces with color and texture using quadric error metrics"),
//! Hoppe 1999 for the form of the texture term; quadrics recomputed from the current mesh ("memoryless") by Lindstrom &
//! Turk 1998 and Hoppe 1999.
//!
//! # Where we differ
//! * Texture coordinates are scaled by √(Σ area / Σ texture area) of their material, so a drift of one unit of length
//!   costs as much as a distance of one.
//! * Vertices collapse onto others, which takes a tenth of the time of an optimal placement. The remaining vertices are
//!   relocated to their best positions at the end of each stage, before the quadrics are recomputed.
//! * A spring to the vertex's current position keeps the best position finite on flat and straight parts.
//!
//! # Memory
//! 40 bytes a vertex and, with texture, 36 bytes a wedge.

use std::borrow::Cow;

use glam::{DVec2, DVec3, Vec2, Vec3, Vec3A, Vec4};

use super::crease::{NormalSums, add_creases};
use super::local::{LocalQuadric, LocalWedge, Planes};
use super::metric::{EdgeCase, LANES, Metric, MovingWedge, Placement};
use super::weights::Weights;
use crate::base::cache::prefetch;
use crate::base::id::TiVec;
use crate::mesh::class::{Class, Classes};
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::edge::{EdgeKind, edge_kind, kind_among};
use crate::mesh::id::{Corner, End, LocalVertex, Wedge, WedgePair};
use crate::mesh::ring::{Rings, Spoke, VALENCE_MAX};

/// Stiffness of the spring that holds a vertex to its position, relative to the trace of A.
const SPRING: f64 = 1e-5;
/// A relocation must lower the error by at least this share.
const LEAST_GAIN: f64 = 0.02;
/// Cost of a collapse on a flat patch, relative to the fourth power of the edge length: it only orders ties.
const LENGTH_SHARE: f32 = 1e-6;

/// The cost function: a quadric for each vertex and wedge of a cluster.
#[derive(Debug, Default)]
pub struct SurfaceCost {
    weights: Weights,
    /// Weight of the squared distance to seams at their predicted density.
    seam_weight: f64,
    vertices: TiVec<LocalVertex, LocalQuadric>,
    wedges: TiVec<Wedge, LocalWedge>,
    area: f64,
    near_folds: Vec<LocalVertex>,
}

impl SurfaceCost {
    /// A cost function without quadrics; [`refresh`](SurfaceCost::refresh) must follow.
    pub fn new(weights: Weights) -> Self {
        Self { weights, seam_weight: weights.of_seams(), ..Self::default() }
    }

    fn has_texture(&self) -> bool {
        self.weights.uv > 0.0
    }

    /// Recomputes all quadrics from the current mesh. O(faces).
    pub fn refresh(&mut self, mesh: &ClusterMesh, rings: &Rings, classes: &Classes) {
        self.vertices.clear();
        self.vertices.resize(mesh.positions.len(), LocalQuadric::default());
        self.wedges.clear();
        if self.has_texture() {
            self.wedges.resize(mesh.wedge_vertex.len(), LocalWedge::default());
        }
        self.area = 0.0;
        for face in mesh.living_faces() {
            let [p0, p1, p2] = mesh.triangle(face);
            let edges = [p1 - p0, p2 - p0];
            let across = edges[0].cross(edges[1]);
            let double_area = across.length();
            if double_area <= 0.0 || !double_area.is_finite() {
                continue;
            }
            let normal = across / double_area;
            let area = 0.5 * double_area;
            self.area += area;
            let mut planes = Planes::default();
            planes.add(normal.as_vec3a(), area as f32);
            if self.has_texture() {
                let [t0, t1, t2] = mesh.uv_triangle(face);
                let gradients = texture_gradients(edges, [t1 - t0, t2 - t0], normal / double_area);
                if gradients.iter().all(|gradient| gradient.is_finite()) {
                    let weight = (area * self.weights.uv) as f32;
                    gradients.iter().for_each(|&gradient| planes.add(gradient, weight));
                    let gradient = gradients.map(|gradient| Vec3::from(gradient * weight));
                    let of_face = LocalWedge { gradient, weight, offset: Vec2::ZERO };
                    mesh.corners[face].into_iter().for_each(|wedge| self.wedges[wedge].add(&of_face));
                }
            }
            let mut of_face = NormalSums::of((0.5 * across).as_vec3(), area as f32);
            of_face.quadratic = planes.quadratic();
            mesh.vertices(face).into_iter().for_each(|vertex| self.vertices[vertex].add(&of_face));
        }
        add_creases(&mut self.vertices, mesh, rings, self.weights.border, &mut self.near_folds);
        let mut spokes = Vec::new();
        for vertex in mesh.vertex_ids().filter(|&vertex| classes[vertex] != Class::Smooth) {
            self.add_chain_edges(mesh, rings, classes, vertex, &mut spokes);
        }
    }

    /// Adds to the ends of the border and seam edges that start at a vertex the planes through them, perpendicular to
    /// each face.
    fn add_chain_edges(
        &mut self,
        mesh: &ClusterMesh,
        rings: &Rings,
        classes: &Classes,
        a: LocalVertex,
        spokes: &mut Vec<Spoke>,
    ) {
        let is_fixed = classes[a] == Class::Fixed;
        let is_chained = |class: Class| class != Class::Smooth && !(class == Class::Fixed && is_fixed);
        let end_of = |corner: Corner| mesh.vertex_of(corner.next());
        if !rings.of(a).iter().any(|&corner| is_chained(classes[end_of(corner)])) {
            return;
        }
        spokes.clear();
        let is_crowded = rings.of(a).len() > VALENCE_MAX;
        if !is_crowded {
            spokes.extend(rings.of(a).iter().map(|&corner| Spoke::of(mesh, corner)));
        }
        for (i, &corner) in rings.of(a).iter().enumerate() {
            let b = end_of(corner);
            if !is_chained(classes[b]) {
                continue;
            }
            // Finds most inner edges without a branch for each face: their other face has the same wedges.
            let own = spokes.get(i);
            let differs = |other: &Spoke, own: &Spoke| {
                (other.previous.number() ^ own.next.number())
                    | (other.wedge.number() ^ own.wedge.number())
                    | (other.previous_wedge.number() ^ own.next_wedge.number())
            };
            if own.is_some_and(|own| spokes.iter().fold(false, |found, other| found | (differs(other, own) == 0))) {
                continue;
            }
            let kind =
                if is_crowded { edge_kind(mesh, rings, a, b) } else { kind_among(spokes, spokes[i].pair_to_next(), b) };
            let weight = match kind {
                EdgeKind::Inner => continue,
                EdgeKind::Border => self.weights.border,
                EdgeKind::Seam => self.seam_weight,
            };
            let (pa, pb) = (mesh.positions[a], mesh.positions[b]);
            let triangle = mesh.triangle(corner.face());
            let across = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]);
            let Some(upright) = (pb - pa).cross(across).try_normalize() else { continue };
            let weight = (weight * (pb - pa).length_squared()) as f32;
            for end in [a, b] {
                self.vertices[end].add_plane(upright.as_vec3(), weight);
            }
        }
    }

    /// Cost of collapsing `from` onto `to`, with the position of `to`.
    #[inline(always)]
    pub fn place(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>) -> Placement {
        let d = shift(mesh, edge);
        let length_sq = d.length_squared();
        let cost = cost_of(self.moved(mesh, edge, d) + self.vertices[edge.to].constant, length_sq);
        Placement { position: mesh.positions[edge.to], cost: f64::from(cost) }
    }

    /// Error of `from` and its wedges at the position of `to` and its texture coordinates.
    #[inline(always)]
    fn moved(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>, d: Vec3) -> f32 {
        let mut error = self.vertices[edge.from].at(d.to_array());
        if self.has_texture() {
            for (&WedgePair { from: wa, to: wb }, inset) in edge.wedges.iter().zip(edge.insets) {
                let slide = slide(mesh, wa, wb) + inset;
                if !slide.is_nan() {
                    error += self.wedges[wa].at(d.to_array(), slide.to_array());
                    if inset != Vec2::ZERO {
                        error += self.wedges[wb].at([0.0; 3], inset.to_array());
                    }
                }
            }
        }
        error
    }

    /// Cost of a collapse inside a chart: the same as from [`place`](SurfaceCost::place).
    #[inline(always)]
    fn cost_onto(&self, mesh: &ClusterMesh, from: End, to: End) -> f32 {
        let d = (mesh.positions[to.vertex] - mesh.positions[from.vertex]).as_vec3();
        let mut error = self.vertices[from.vertex].at(d.to_array());
        if self.has_texture() {
            let slide = slide(mesh, from.wedge, to.wedge);
            error += if slide.is_nan() { 0.0 } else { self.wedges[from.wedge].at(d.to_array(), slide.to_array()) };
        }
        cost_of(error + self.vertices[to.vertex].constant, d.length_squared())
    }

    /// Costs of collapses inside a chart, in vector registers: the same as from [`place`](SurfaceCost::place).
    #[inline(always)]
    fn costs_onto(&self, mesh: &ClusterMesh, from: End, ends: &[End; LANES]) -> [f32; LANES] {
        // Lane by lane: `map` of an array is a call for each element.
        let [e0, e1, e2, e3] = *ends;
        let here = mesh.positions[from.vertex];
        let shift = |to: End| (mesh.positions[to.vertex] - here).as_vec3();
        let [d0, d1, d2, d3] = [shift(e0), shift(e1), shift(e2), shift(e3)];
        let d =
            [Vec4::new(d0.x, d1.x, d2.x, d3.x), Vec4::new(d0.y, d1.y, d2.y, d3.y), Vec4::new(d0.z, d1.z, d2.z, d3.z)];
        let mut error = self.vertices[from.vertex].at(d);
        if self.has_texture() {
            let uv = mesh.wedge_uv[from.wedge];
            let slide = |to: End| (mesh.wedge_uv[to.wedge] - uv).as_vec2();
            let [s0, s1, s2, s3] = [slide(e0), slide(e1), slide(e2), slide(e3)];
            let s = [Vec4::new(s0.x, s1.x, s2.x, s3.x), Vec4::new(s0.y, s1.y, s2.y, s3.y)];
            let is_mapped = s[0].cmpeq(s[0]) & s[1].cmpeq(s[1]);
            error += Vec4::select(is_mapped, self.wedges[from.wedge].at(d, s), Vec4::ZERO);
        }
        let kept = |to: End| self.vertices[to.vertex].constant;
        error += Vec4::new(kept(e0), kept(e1), kept(e2), kept(e3));
        let length_sq = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        let error = Vec4::select(error.cmplt(Vec4::ZERO), Vec4::ZERO, error);
        (error + length_sq * LENGTH_SHARE * length_sq).to_array()
    }

    /// Adds the quadrics of the vanished vertex and its wedges to those that stay.
    pub fn join(&mut self, mesh: &ClusterMesh, edge: &EdgeCase<'_>) {
        let d = shift(mesh, edge);
        let mut vanished = self.vertices[edge.from];
        let constant = self.moved(mesh, edge, d);
        vanished.linear += Vec3::from_array(vanished.apply(d.to_array()));
        vanished.constant = constant;
        if self.has_texture() {
            for (&WedgePair { from: wa, to: wb }, inset) in edge.wedges.iter().zip(edge.insets) {
                let slide = slide(mesh, wa, wb) + inset;
                if slide.is_nan() {
                    continue;
                }
                if inset != Vec2::ZERO {
                    let wedge = &mut self.wedges[wb];
                    vanished.linear -= wedge.gradient[0] * inset.x + wedge.gradient[1] * inset.y;
                    wedge.offset -= wedge.weight * inset;
                }
                let LocalWedge { gradient, weight, .. } = self.wedges[wa];
                vanished.linear -= gradient[0] * slide.x + gradient[1] * slide.y;
                let offset = Vec2::from_array(self.wedges[wa].mapped(d.to_array())) - weight * slide;
                self.wedges[wb].add(&LocalWedge { gradient, weight, offset });
            }
        }
        self.vertices[edge.to].add(&vanished);
    }

    /// Translates the quadric of a wedge to the vertex that stays; its texture coordinate is unchanged, and the cost of
    /// that is part of the vertex's quadric.
    pub fn bring(&mut self, mesh: &ClusterMesh, edge: &EdgeCase<'_>, wedge: Wedge) {
        if self.has_texture() {
            let wedge = &mut self.wedges[wedge];
            wedge.offset = Vec2::from_array(wedge.mapped(shift(mesh, edge).to_array()));
        }
    }

    /// Step of a vertex to its position of least error; `None` if the error falls by less than 2 %. Wedges take their
    /// best texture coordinates, except those with a fixed `slide`.
    pub fn best_step(&self, vertex: LocalVertex, wedges: &[MovingWedge]) -> Option<DVec3> {
        let quadric = self.vertices[vertex];
        let mut reduced = quadric.widened();
        let spring = SPRING * reduced.diagonal.element_sum();
        for &MovingWedge { wedge, slide } in wedges.iter().filter(|_| self.has_texture()) {
            let texture = self.wedges[wedge].widened();
            match slide {
                Some(slide) => texture.add_held(slide, &mut reduced),
                None => reduced += texture.eliminated(),
            }
        }
        let step = reduced.minimum_near(DVec3::ZERO, spring)?;
        let gains = reduced.at(step) < (1.0 - LEAST_GAIN) * f64::from(quadric.constant);
        gains.then_some(step)
    }

    /// Change of a wedge's texture coordinate that has the least error when its vertex makes `step`.
    pub fn best_slide(&self, wedge: Wedge, step: DVec3) -> DVec2 {
        match self.wedges.get(wedge) {
            Some(texture) if texture.weight > 0.0 => {
                let texture = texture.widened();
                texture.mapped(step) / texture.weight
            }
            _ => DVec2::ZERO,
        }
    }

    /// Area of the mesh at the last refresh.
    pub fn area(&self) -> f64 {
        self.area
    }
}

/// Cost of a collapse with this error along an edge of this squared length. NaN remains: it is not cheap.
#[inline(always)]
fn cost_of(error: f32, length_sq: f32) -> f32 {
    (if error < 0.0 { 0.0 } else { error }) + LENGTH_SHARE * length_sq * length_sq
}

/// Vector from the vertex that vanishes to the one that stays.
#[inline(always)]
fn shift(mesh: &ClusterMesh, edge: &EdgeCase<'_>) -> Vec3 {
    (mesh.positions[edge.to] - mesh.positions[edge.from]).as_vec3()
}

/// Difference of the texture coordinates of two wedges; NaN if one has none.
#[inline(always)]
fn slide(mesh: &ClusterMesh, from: Wedge, to: Wedge) -> Vec2 {
    (mesh.wedge_uv[to] - mesh.wedge_uv[from]).as_vec2()
}

/// Gradients of u and v in the plane of a triangle, from its edge vectors in space and in texture. `upright` is the
/// normal divided by twice the area. Not finite without texture.
///
/// NOTE: in double precision, because in a needle the difference of two long vectors is short.
#[inline(always)]
fn texture_gradients(edges: [DVec3; 2], texture: [DVec2; 2], upright: DVec3) -> [Vec3A; 2] {
    let across = [edges[1].cross(upright), upright.cross(edges[0])];
    let [d1, d2] = texture;
    [(across[0] * d1.x + across[1] * d2.x).as_vec3a(), (across[0] * d1.y + across[1] * d2.y).as_vec3a()]
}

impl Metric for SurfaceCost {
    type Settings = Weights;

    const ENDPOINTS: bool = true;
    const CORNERS_VANISH: bool = true;

    fn new(weights: &Weights) -> Self {
        Self::new(*weights)
    }

    fn reads_texture(weights: &Weights) -> bool {
        weights.uv > 0.0
    }

    fn learn_seam_density(weights: &mut Weights, seam_density: f64) {
        weights.seam_density = seam_density;
    }

    fn refresh(&mut self, mesh: &ClusterMesh, rings: &Rings, classes: &Classes) {
        self.refresh(mesh, rings, classes);
    }

    fn near_folds(&self, _mesh: &ClusterMesh, _rings: &Rings) -> Cow<'_, [LocalVertex]> {
        Cow::Borrowed(&self.near_folds)
    }

    #[inline(always)]
    fn place(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>) -> Placement {
        self.place(mesh, edge)
    }

    #[inline(always)]
    fn cost_onto(&self, mesh: &ClusterMesh, from: End, to: End) -> f32 {
        self.cost_onto(mesh, from, to)
    }

    #[inline(always)]
    fn costs_onto(&self, mesh: &ClusterMesh, from: End, ends: &[End; LANES]) -> [f32; LANES] {
        self.costs_onto(mesh, from, ends)
    }

    #[inline(always)]
    fn prefetch(&self, vertex: LocalVertex) {
        prefetch(&self.vertices[vertex]);
    }

    #[inline(always)]
    fn prefetch_wedge(&self, wedge: Wedge) {
        self.wedges.get(wedge).into_iter().for_each(prefetch);
    }

    fn join(&mut self, mesh: &ClusterMesh, edge: &EdgeCase<'_>) {
        self.join(mesh, edge);
    }

    fn bring(&mut self, mesh: &ClusterMesh, edge: &EdgeCase<'_>, wedge: Wedge) {
        self.bring(mesh, edge, wedge);
    }

    fn best_step(&self, vertex: LocalVertex, wedges: &[MovingWedge]) -> Option<DVec3> {
        self.best_step(vertex, wedges)
    }

    fn best_slide(&self, wedge: Wedge, step: DVec3) -> DVec2 {
        self.best_slide(wedge, step)
    }

    #[inline(always)]
    fn inset(&self) -> f64 {
        self.weights.inset
    }

    fn area(&self) -> f64 {
        self.area()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cost::quadric::WedgeQuadric;
    use crate::mesh::class::classify;
    use crate::mesh::cluster::samples;
    use crate::mesh::id::short::{pair, v, w};

    fn prepared(mesh: &ClusterMesh) -> SurfaceCost {
        let (mut rings, mut classes) = (Rings::default(), TiVec::new());
        rings.build(mesh);
        classify(mesh, &rings, &mut classes);
        let mut cost = SurfaceCost::new(Weights { uv: 1.0, ..Weights::default() });
        cost.refresh(mesh, &rings, &classes);
        cost
    }

    const EDGE: EdgeCase<'_> =
        EdgeCase { from: v(6), to: v(12), onto: true, stays: true, wedges: &[pair(6, 12)], insets: [Vec2::ZERO; 2] };

    /// Collapses one vertex onto another.
    fn join(cost: &mut SurfaceCost, mesh: &ClusterMesh, from: u32, to: u32) {
        cost.join(mesh, &EdgeCase { from: v(from), to: v(to), wedges: &[pair(from, to)], ..EDGE });
    }

    /// A bumpy grid with a curved texture mapping, so that quadrics of all kinds occur.
    fn hills() -> ClusterMesh {
        let mut mesh = samples::grid(6, 0.7);
        mesh.wedge_uv.iter_mut().for_each(|t| *t += DVec2::new(t.x * t.y, 0.3 * t.x) * 0.5);
        mesh
    }

    /// Sum of the squared distances to planes and the squared texture drift over the faces around a vertex, in double
    /// precision.
    fn plain_error(mesh: &ClusterMesh, vertex: LocalVertex, position: DVec3, uv: DVec2) -> f64 {
        let mut error = 0.0;
        for face in mesh.face_ids().filter(|&face| mesh.vertices(face).contains(&vertex)) {
            let triangle = mesh.triangle(face);
            let across = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]);
            let (area, normal) = (0.5 * across.length(), across.normalize());
            error += area * normal.dot(position - triangle[0]).powi(2);
            let (wedge, plane) = WedgeQuadric::of_face(triangle, mesh.uv_triangle(face), normal, area).unwrap();
            error += plane.at(position) + wedge.at(position, uv);
        }
        error
    }

    #[test]
    fn a_flat_patch_with_affine_texture_costs_no_more_than_its_tie_breaker() {
        let mesh = samples::grid(4, 0.0);
        let placement = prepared(&mesh).place(&mesh, &EDGE);
        assert!(placement.cost <= 4.1 * f64::from(LENGTH_SHARE), "{placement:?}");
        assert_eq!(placement.position, mesh.positions[v(12)]);
    }

    #[test]
    fn cost_grows_with_the_fourth_power_of_the_scale() {
        let mesh = samples::grid(4, 0.5);
        let mut large = mesh.clone();
        large.positions.iter_mut().for_each(|p| *p *= 3.0);
        large.wedge_uv.iter_mut().for_each(|t| *t *= 3.0);
        let (small, large) = (prepared(&mesh).place(&mesh, &EDGE).cost, prepared(&large).place(&large, &EDGE).cost);
        assert!((large / small - 81.0).abs() < 1e-3);
    }

    #[test]
    fn the_cost_is_the_plain_sum_over_the_ring_of_the_vertex_that_vanishes() {
        let mesh = hills();
        let cost = prepared(&mesh);
        for (from, to) in [(8, 9), (16, 24), (24, 16), (17, 10)] {
            let edge = EdgeCase { from: v(from), to: v(to), wedges: &[pair(from, to)], ..EDGE };
            let plain = plain_error(&mesh, v(from), mesh.positions[v(to)], mesh.wedge_uv[w(to)]);
            let judged = cost.place(&mesh, &edge).cost;
            assert!((judged / plain - 1.0).abs() < 1e-4, "{judged} {plain}");
        }
    }

    #[test]
    fn costs_of_many_collapses_are_those_of_each() {
        let mut mesh = hills();
        mesh.wedge_uv[w(9)] = DVec2::NAN;
        let cost = prepared(&mesh);
        let end = |number| End { vertex: v(number), wedge: w(number) };
        let ends: Vec<End> = (0..29).filter(|&number| number != 16).map(end).collect();
        for ends in ends.as_chunks().0 {
            for (&to, judged) in ends.iter().zip(cost.costs_onto(&mesh, end(16), ends)) {
                let wedges = [WedgePair { from: w(16), to: to.wedge }];
                let placed = cost.place(&mesh, &EdgeCase::inside(v(16), to.vertex, &wedges)).cost as f32;
                let alone = cost.cost_onto(&mesh, end(16), to);
                assert_eq!([judged, alone].map(f32::to_bits), [placed.to_bits(); 2], "{to:?}");
            }
        }
    }

    #[test]
    fn what_merges_is_remembered_at_the_new_place() {
        let mesh = hills();
        let mut cost = prepared(&mesh);
        join(&mut cost, &mesh, 16, 17);
        join(&mut cost, &mesh, 17, 18);
        let (place, uv) = (mesh.positions[v(25)], mesh.wedge_uv[w(25)]);
        let plain: f64 = [16, 17, 18].map(|from| plain_error(&mesh, v(from), place, uv)).iter().sum();
        let judged = cost.place(&mesh, &EdgeCase { from: v(18), to: v(25), wedges: &[pair(18, 25)], ..EDGE }).cost;
        assert!((judged / plain - 1.0).abs() < 1e-4, "{judged} {plain}");
    }

    #[test]
    fn a_rigid_motion_changes_no_cost() {
        let mesh = hills();
        let mut moved = mesh.clone();
        let turn = glam::DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7);
        moved.positions.iter_mut().for_each(|p| *p = turn * *p + DVec3::new(50.0, -20.0, 9.0));
        let (here, there) = (prepared(&mesh).place(&mesh, &EDGE).cost, prepared(&moved).place(&moved, &EDGE).cost);
        assert!((here / there - 1.0).abs() < 1e-3, "{here} {there}");
    }

    /// A cost function after collapses of 16 and 18 onto 17, and the summed error of the three after a step and a
    /// drift.
    fn joined() -> (SurfaceCost, impl Fn(DVec3, DVec2) -> f64) {
        let mesh = hills();
        let mut cost = prepared(&mesh);
        join(&mut cost, &mesh, 16, 17);
        join(&mut cost, &mesh, 18, 17);
        let (place, uv) = (mesh.positions[v(17)], mesh.wedge_uv[w(17)]);
        let error = move |step, slide| {
            [16, 17, 18].map(|from| plain_error(&mesh, v(from), place + step, uv + slide)).iter().sum()
        };
        (cost, error)
    }

    const STEPS: [DVec3; 6] = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z];

    #[test]
    fn the_best_step_has_less_error_than_any_near_it() {
        let (cost, error) = joined();
        for slide in [DVec2::ZERO, DVec2::new(0.05, -0.02)] {
            let best = cost.best_step(v(17), &[MovingWedge { wedge: w(17), slide: Some(slide) }]).unwrap();
            assert!(error(best, slide) < error(DVec3::ZERO, DVec2::ZERO));
            for step in STEPS {
                assert!(error(best, slide) < error(best + 0.05 * step, slide));
            }
        }
    }

    #[test]
    fn a_texture_coordinate_that_may_slide_finds_its_best_together_with_the_place() {
        let (cost, error) = joined();
        let held = cost.best_step(v(17), &[MovingWedge { wedge: w(17), slide: Some(DVec2::ZERO) }]).unwrap();
        let best = cost.best_step(v(17), &[MovingWedge { wedge: w(17), slide: None }]).unwrap();
        let slide = cost.best_slide(w(17), best);
        assert!(error(best, slide) < error(held, DVec2::ZERO));
        for step in STEPS {
            assert!(error(best, slide) < error(best + 0.05 * step, slide));
            assert!(error(best, slide) < error(best, slide + 0.05 * step.truncate()) || step.truncate() == DVec2::ZERO);
        }
    }
}
