//! Whether an edge may collapse: topology, borders of the cluster, folds in space and in texture space.
//!
//! # Source
//! Dey, Edelsbrunner, Guha, Nekhayev, "Topology preserving edge contraction", 1999 (the link condition; an imaginary
//! vertex closes an open border).

use glam::{DVec2, DVec3};

use edges::Neighbour;

use super::fold::{FoldCheck, may_fold};
use crate::geometry::distance_sq;
use crate::mesh::class::VALENCE_MAX;
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::ring::Rings;

/// A face may turn by at most about 78° in one collapse (cosine).
const TURN_COSINE: f64 = 0.2;
/// A face below this regularity (4√3 · area / Σ length²; 1 is equilateral) may not become thinner.
const REGULARITY_MIN: f64 = 0.02;
/// A texture triangle must keep more than this share of its size, after allowing for any loss of the face's own area.
const UV_AREA_SHARE_MIN: f64 = 0.05;

/// A face whose area grows by more than this factor (squared here) must have old surface beneath its middle. A face
/// that is pulled out of a sliver, within the planes around it, costs nothing and may span empty space.
const GROWTH_SQ: f64 = 4.0 * 4.0;
/// Largest distance from the middle of such a face to the old surface, relative to the square root of its area.
const HOVER_SHARE: f64 = 0.05;
/// The same, as area × squared distance relative to the collapse's cost.
const HOVER_COST: f64 = 4.0;

/// Why an edge did not collapse.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Refusal {
    /// The surface would change its topology: pinch, close a hole, or double a face.
    Topology,
    /// The last face of a connected component or of a large part would vanish, or too many faces would die at once.
    Piece,
    /// A seam would be torn off its chart.
    Seam,
    /// The check needs faces that another cluster has.
    Rim,
    /// A face would fold over, become a needle, or span empty space.
    Fold,
    /// A texture triangle would change its sign or degenerate.
    UvFold,
    /// The surface would deviate from the input by more than allowed.
    Deviation,
}

impl Refusal {
    /// Number of kinds of refusals.
    pub const COUNT: usize = 7;
}

/// Properties of the faces around a vertex that is to vanish.
#[derive(Debug, Clone, Copy, Default)]
pub struct Fan {
    /// They form one closed fan, in which the vertex has one wedge.
    pub closed: bool,
    /// Wedges of the vertex may be left without a counterpart at the other end.
    pub strands: bool,
    /// The vertex is non-manifold.
    pub is_complex: bool,
    /// The vertex belongs to an isolated face, which may vanish.
    pub is_alone: bool,
    /// The topology may change.
    pub is_free: bool,
    /// The vertex has no edge with the one that it collapses onto.
    pub is_rip: bool,
    /// Number of edges that may get more than two faces: surfaces meet there.
    pub spare_edges: i64,
}

/// The one-ring of a vertex with one closed fan of 4 to 16 faces.
struct Ring {
    vertices: [u32; Self::LANES],
}

impl Ring {
    const LANES: usize = 16;

    fn of(mesh: &ClusterMesh, rings: &Rings, vertex: u32) -> Option<Self> {
        let (mut vertices, mut count) = ([u32::MAX; Self::LANES], 0);
        for &corner in rings.of(vertex).iter().filter(|&&corner| mesh.living(corner).is_some()) {
            *vertices.get_mut(count)? = mesh.vertex_of(ClusterMesh::following(corner)[0]);
            count += 1;
        }
        (count > 3).then_some(Self { vertices })
    }
}

/// Whether a vertex has too many faces for another to collapse onto it. Stops counting at the limit, because hubs are
/// checked often.
fn is_hub(mesh: &ClusterMesh, rings: &Rings, vertex: u32) -> bool {
    rings.of(vertex).len() > 2 * VALENCE_MAX && rings.faces(mesh, vertex).nth(2 * VALENCE_MAX).is_some()
}

/// Effects of a collapse on the faces around its edge; buffers are reused.
#[derive(Debug, Default)]
pub struct EdgeStar {
    /// Faces that vanish.
    pub dying: Vec<u32>,
    /// Pairs: wedge of the vanishing vertex → wedge of the staying one.
    pub wedges: Vec<(u32, u32)>,
    /// Wedges of the vanishing vertex, in living faces, that no face at the edge has.
    pub stranded: Vec<u32>,
    /// Vertices whose classes may change, where the topology changes.
    pub unsettled: Vec<u32>,
    /// Increase in the number of edges of more than two faces, where the topology changes.
    pub new_non_manifold_edges: i64,
    /// Whether faces become neighbours that no dying face lies between.
    joins: bool,
    /// A wedge of the staying vertex, if the ends have no face in common.
    beside: Option<u32>,
    /// Neighbours of the ends, where the topology changes.
    neighbours: Vec<Neighbour>,
    /// Sides of dying double faces that touch neither end.
    far_sides: Vec<[u32; 2]>,
    /// Both ends of the edge.
    ends: [u32; 2],
    opposite: Vec<u32>,
    mark: Vec<u32>,
    epoch: u32,
    folds: FoldCheck,
}

impl EdgeStar {
    /// Prepares for a mesh with `vertex_count` vertices; call before its first edge.
    pub fn reset(&mut self, vertex_count: usize) {
        self.mark.clear();
        self.mark.resize(vertex_count, 0);
        self.epoch = 0;
    }

    /// Collects the faces at the edge and the pairs of wedges.
    pub fn gather(&mut self, mesh: &ClusterMesh, rings: &Rings, from: u32, to: u32) {
        self.dying.clear();
        self.wedges.clear();
        self.opposite.clear();
        self.stranded.clear();
        self.unsettled.clear();
        self.new_non_manifold_edges = 0;
        self.joins = false;
        self.ends = [from, to];
        for &corner in rings.of(from) {
            let Some(wedge) = mesh.living(corner) else { continue };
            let far = ClusterMesh::following(corner);
            let Some(k) = far.iter().position(|&c| mesh.vertex_of(c) == to) else { continue };
            let pair = (wedge, mesh.wedge_of(far[k]));
            self.dying.push(corner / 3);
            self.opposite.push(mesh.vertex_of(far[1 - k]));
            if !self.wedges.contains(&pair) {
                self.wedges.push(pair);
            }
        }
        if self.dying.is_empty() {
            self.pair_alike(mesh, rings, from, to);
        }
    }

    /// Pairs the wedges of two vertices with equal texture coordinates, or with none.
    fn pair_alike(&mut self, mesh: &ClusterMesh, rings: &Rings, from: u32, to: u32) {
        let wedges_of = |vertex: u32| rings.of(vertex).iter().filter_map(|&corner| mesh.living(corner));
        let uv = |wedge: u32| mesh.wedge_uv[wedge as usize];
        for wedge in wedges_of(from) {
            let is_alike = |&other: &u32| uv(other) == uv(wedge) || (uv(other).is_nan() && uv(wedge).is_nan());
            if let Some(other) = wedges_of(to).find(is_alike)
                && !self.wedges.contains(&(wedge, other))
            {
                self.wedges.push((wedge, other));
            }
        }
        self.beside = wedges_of(to).next();
    }

    /// Checks everything but geometry; [`gather`](EdgeStar::gather) must have run for this edge.
    ///
    /// # Errors
    /// The first reason found against the collapse.
    pub fn check_topology(
        &mut self,
        mesh: &ClusterMesh,
        rings: &Rings,
        from: u32,
        to: u32,
        fan: Fan,
    ) -> Result<(), Refusal> {
        match self.check_link(mesh, rings, from, to, fan) {
            Err(Refusal::Topology | Refusal::Piece) if fan.is_free => self.check_edges(mesh, rings, from, to, fan),
            // Edges of three faces or more may become edges of two, whose directions must be checked.
            Ok(()) if fan.is_complex && fan.is_free => self.check_edges(mesh, rings, from, to, fan),
            checked => checked,
        }
    }

    fn check_link(
        &mut self,
        mesh: &ClusterMesh,
        rings: &Rings,
        from: u32,
        to: u32,
        Fan { closed, strands, .. }: Fan,
    ) -> Result<(), Refusal> {
        if self.dying.is_empty() || self.dying.len() > 2 || is_hub(mesh, rings, to) {
            return Err(Refusal::Topology);
        }
        let to_shared = mesh.is_shared(to);
        if closed
            && !to_shared
            && self.dying.len() == 2
            && let Some(ring) = Ring::of(mesh, rings, from)
        {
            return self.check_closed(&ring, mesh, rings, to);
        }
        self.epoch += 2;
        let (seen, common) = (self.epoch, self.epoch + 1);
        for &corner in rings.of(from) {
            let Some(wedge) = mesh.living(corner) else { continue };
            let ring = ClusterMesh::following(corner).map(|c| mesh.vertex_of(c));
            for v in ring {
                self.mark[v as usize] = seen;
            }
            if ring.contains(&to) {
                continue;
            }
            match self.wedges.iter().filter(|pair| pair.0 == wedge).count() {
                1 => {}
                0 if strands => {
                    if !self.stranded.contains(&wedge) {
                        self.stranded.push(wedge);
                    }
                }
                _ => return Err(Refusal::Seam),
            }
            if to_shared && ring.iter().any(|&v| mesh.is_shared(v) && !self.opposite.contains(&v)) {
                return Err(Refusal::Rim);
            }
            // The face would become `to` and the two opposite vertices; such a face may exist already.
            if ring.iter().all(|v| self.opposite.contains(v)) {
                if to_shared && ring.iter().all(|&v| mesh.is_shared(v)) {
                    return Err(Refusal::Rim);
                }
                if self.face_exists(mesh, rings, to) {
                    return Err(Refusal::Topology);
                }
            }
        }
        let mut common_count = 0;
        for &corner in rings.of(to).iter().filter(|&&corner| mesh.living(corner).is_some()) {
            for v in ClusterMesh::following(corner).map(|c| mesh.vertex_of(c)) {
                if self.mark[v as usize] == seen && v != from {
                    self.mark[v as usize] = common;
                    common_count += 1;
                }
            }
        }
        if common_count != self.dying.len() {
            return Err(Refusal::Topology);
        }
        self.check_piece(mesh, rings, from, to)
    }

    /// The link condition for a vertex with one closed fan and one wedge, if no other cluster uses `to`: its one-ring
    /// and that of `to` share the two opposite vertices and no others. Compares in lanes.
    fn check_closed(&self, ring: &Ring, mesh: &ClusterMesh, rings: &Rings, to: u32) -> Result<(), Refusal> {
        if self.wedges.len() != 1 {
            return Err(Refusal::Seam);
        }
        let mut found = [0u32; Ring::LANES];
        for &corner in rings.of(to).iter().filter(|&&corner| mesh.living(corner).is_some()) {
            let far = ClusterMesh::following(corner).map(|c| mesh.vertex_of(c));
            for (found, vertex) in found.iter_mut().zip(ring.vertices) {
                *found |= u32::from((vertex == far[0]) | (vertex == far[1]));
            }
        }
        if found.iter().sum::<u32>() == 2 { Ok(()) } else { Err(Refusal::Topology) }
    }

    /// Checks that no face folds over, in space or in texture space, when the `moving` vertices come to `position` and
    /// the wedges of each pair to one of `uvs`. Nor may a face span empty space: `cost` is that of the collapse, in
    /// area × squared distance; infinity disables this check. [`check_topology`](EdgeStar::check_topology) must have
    /// passed.
    ///
    /// # Errors
    /// The first reason found against the collapse.
    pub fn check_faces(
        &mut self,
        mesh: &ClusterMesh,
        rings: &Rings,
        moving: &[u32],
        position: DVec3,
        uvs: &[DVec2],
        cost: f64,
    ) -> Result<(), Refusal> {
        self.folds.begin(self.joins);
        for &vertex in moving {
            for &corner in rings.of(vertex) {
                let Some(wedge) = mesh.living(corner) else { continue };
                let (face, k) = (corner / 3, corner as usize % 3);
                if self.dying.contains(&face) {
                    continue;
                }
                let (before, uv_before) = (mesh.triangle(face), mesh.uv_triangle(face));
                let (mut after, mut uv_after) = (before, uv_before);
                after[k] = position;
                let mut pairs = self.wedges.iter().zip(uvs);
                if let Some((_, &uv)) = pairs.find(|((a, b), _)| *a == wedge || *b == wedge) {
                    uv_after[k] = uv;
                }
                let change = change_of(before, after).ok_or(Refusal::Fold)?;
                self.folds.push(corner, &change);
                let areas_sq = change.areas_sq;
                let grows = areas_sq[1] > GROWTH_SQ * areas_sq[0];
                if grows && hovers(mesh, rings, moving, after, areas_sq[1].sqrt(), cost) {
                    return Err(Refusal::Fold);
                }
                if !uv_survives(uv_before, uv_after, areas_sq) {
                    return Err(Refusal::UvFold);
                }
            }
        }
        let anchor = self.ends.into_iter().find(|end| !moving.contains(end)).map(|end| (end, &self.opposite[..]));
        let folds = self.folds.finds(mesh, rings, &self.dying, anchor, position);
        if folds { Err(Refusal::Fold) } else { Ok(()) }
    }

    /// Collapses the edge in the mesh: faces at the edge die, the others get `to` as a vertex and keep or change their
    /// wedges.
    pub fn apply(&self, mesh: &mut ClusterMesh, rings: &Rings, from: u32, to: u32) {
        for &face in &self.dying {
            mesh.kill(face);
        }
        for &corner in rings.of(from) {
            let Some(wedge) = mesh.living(corner) else { continue };
            if let Some(pair) = self.wedges.iter().find(|pair| pair.0 == wedge) {
                mesh.corners.as_flattened_mut()[corner as usize] = pair.1;
            }
            mesh.corner_vertices.as_flattened_mut()[corner as usize] = to;
        }
        if let Some(beside) = self.wedges.first().map(|pair| pair.1).or(self.beside) {
            self.stranded.iter().for_each(|&wedge| mesh.bring_wedge(wedge, beside));
        }
    }

    /// A face that shares no edge with another is a connected component of its own and must stay.
    fn check_piece(&self, mesh: &ClusterMesh, rings: &Rings, from: u32, to: u32) -> Result<(), Refusal> {
        let (&[_], &[opposite]) = (&self.dying[..], &self.opposite[..]) else { return Ok(()) };
        let faces_with = |v: u32| rings.faces(mesh, v).filter(|&face| mesh.vertices(face).contains(&opposite)).count();
        if faces_with(from) > 1 || faces_with(to) > 1 {
            return Ok(());
        }
        Err(if mesh.is_shared(to) && mesh.is_shared(opposite) { Refusal::Rim } else { Refusal::Piece })
    }

    /// Whether a surviving face has `to` and the opposite vertices as corners.
    fn face_exists(&self, mesh: &ClusterMesh, rings: &Rings, to: u32) -> bool {
        let is_between = |v: u32| v == to || self.opposite.contains(&v);
        rings.faces(mesh, to).any(|face| !self.dying.contains(&face) && mesh.vertices(face).into_iter().all(is_between))
    }
}

/// Whether the middle of a new face is farther from all faces around the moving vertices than its area and the
/// collapse's cost allow.
fn hovers(mesh: &ClusterMesh, rings: &Rings, moving: &[u32], [a, b, c]: [DVec3; 3], area: f64, cost: f64) -> bool {
    let middle = (a + b + c) / 3.0;
    let allowed_sq = (HOVER_SHARE * HOVER_SHARE * area).max(HOVER_COST * cost / area);
    let mut old = moving.iter().flat_map(|&vertex| rings.faces(mesh, vertex)).map(|face| mesh.triangle(face));
    old.all(|triangle| distance_sq(middle, triangle) > allowed_sq)
}

/// Whether a triangle keeps its side and shape when a corner moves.
#[inline]
pub fn triangle_survives(before: [DVec3; 3], after: [DVec3; 3]) -> bool {
    change_of(before, after).is_some()
}

/// How a triangle changes when a corner moves.
#[derive(Debug, Clone, Copy)]
pub struct Change {
    /// Squared areas before and after.
    pub areas_sq: [f64; 2],
    /// Whether it turns by more than about 10°, so that it may fold onto a neighbour.
    pub turns: bool,
    /// Its normal afterwards; the length is twice the area.
    pub normal: DVec3,
}

/// How a triangle changes when a corner moves; `None` if it does not keep its side and shape.
///
/// Uses no roots or divisions: checks of collapses spend most of their time here.
#[inline(always)]
pub fn change_of(before: [DVec3; 3], after: [DVec3; 3]) -> Option<Change> {
    let across = |t: [DVec3; 3]| (t[1] - t[0]).cross(t[2] - t[0]);
    let (old, new) = (across(before), across(after));
    let (old_sq, new_sq) = (old.length_squared(), new.length_squared());
    let turn = old.dot(new);
    if turn < 0.0 || turn * turn < TURN_COSINE * TURN_COSINE * (old_sq * new_sq) {
        return None;
    }
    // regularity = 4√3 · area / Σ length², area = √new_sq / 2
    let lengths =
        |t: [DVec3; 3]| t[0].distance_squared(t[1]) + t[1].distance_squared(t[2]) + t[2].distance_squared(t[0]);
    let now = lengths(after);
    let is_regular = 12.0 * new_sq >= (REGULARITY_MIN * now) * (REGULARITY_MIN * now);
    let survives = new_sq > 0.0
        && (is_regular || {
            let was = lengths(before);
            new_sq * was * was >= old_sq * now * now
        });
    let turns = may_fold(turn, old_sq * new_sq);
    survives.then_some(Change { areas_sq: [0.25 * old_sq, 0.25 * new_sq], turns, normal: new })
}

/// Twice the area of a texture triangle, negative if it is mirrored.
pub fn doubled_uv_area([a, b, c]: [DVec2; 3]) -> f64 {
    (b - a).perp_dot(c - a)
}

/// Whether a texture triangle keeps its sign and does not shrink too much in comparison with its face, whose squared
/// areas before and after are given. `true` if it had no texture or no area.
#[inline]
pub fn uv_survives(before: [DVec2; 3], after: [DVec2; 3], areas_sq: [f64; 2]) -> bool {
    let (old, new) = (doubled_uv_area(before), doubled_uv_area(after));
    if old.is_nan() || old == 0.0 {
        return true;
    }
    let [old_sq, new_sq] = if areas_sq[0] > 0.0 { areas_sq } else { [1.0; 2] };
    let (kept, least) = (new * old.signum(), UV_AREA_SHARE_MIN * old);
    kept > 0.0 && kept * kept * old_sq > least * least * new_sq.min(old_sq)
}

mod edges;
#[cfg(test)]
mod tests;
