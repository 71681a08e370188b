//! Whether an edge may collapse: topology, borders of the cluster, folds in space and in texture space.
//!
//! # Source
//! Dey, Edelsbrunner, Guha, Nekhayev, "Topology preserving edge contraction", 1999 (the link condition; an imaginary
//! vertex closes an open border).

use glam::{DVec2, DVec3};

use super::edge_star::{EdgeStar, VanishingFan, is_hub};
use super::refusal::Refusal;
use super::shape_rule::ShapeRule;
use super::triangle_change::{any_change_of, change_of, uv_survives};
use crate::geometry::distance_sq;
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::LocalVertex;
use crate::mesh::ring::Rings;

/// In a closed fan of up to this many faces, the one across from an edge may have all its corners around that edge.
const FEW_FACES: usize = 3;
/// A face whose area grows by more than this factor (squared here) must have old surface beneath its middle. A face
/// that is pulled out of a sliver, within the planes around it, costs nothing and may span empty space.
const GROWTH_SQ: f64 = 4.0 * 4.0;
/// Largest distance from the middle of such a face to the old surface, relative to the square root of its area.
const HOVER_SHARE: f64 = 0.05;
/// The same, as area × squared distance relative to the collapse's cost.
const HOVER_COST: f64 = 4.0;

impl EdgeStar {
    /// Checks everything but geometry; [`gather`](EdgeStar::gather) must have run for this edge.
    ///
    /// # Errors
    /// The first reason found against the collapse.
    pub fn check_topology(
        &mut self,
        mesh: &ClusterMesh,
        rings: &Rings,
        from: LocalVertex,
        to: LocalVertex,
        fan: VanishingFan,
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
        from: LocalVertex,
        to: LocalVertex,
        VanishingFan { closed, strands, .. }: VanishingFan,
    ) -> Result<(), Refusal> {
        if self.dying.is_empty() || self.dying.len() > 2 || is_hub(mesh, rings, to) {
            return Err(Refusal::Topology);
        }
        let to_shared = mesh.is_shared(to);
        self.epoch += 1;
        if closed && !to_shared && self.dying.len() == 2 && rings.living(mesh, from).nth(FEW_FACES).is_some() {
            return self.check_closed(mesh, rings, from, to);
        }
        let seen = self.epoch;
        for &corner in rings.of(from) {
            let Some(wedge) = mesh.living(corner) else { continue };
            let ring = mesh.others_of(corner);
            for v in ring {
                self.mark[v] = seen;
            }
            if ring.contains(&to) {
                continue;
            }
            match self.wedges.iter().filter(|pair| pair.from == wedge).count() {
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
        if self.count_common(mesh, rings, to) != self.dying.len() {
            return Err(Refusal::Topology);
        }
        self.check_piece(mesh, rings, from, to)
    }

    /// The link condition for a vertex with one closed fan of more than three faces and one wedge, if no other cluster
    /// uses `to`: its one-ring and that of `to` share the two opposite vertices and no others.
    fn check_closed(
        &mut self,
        mesh: &ClusterMesh,
        rings: &Rings,
        from: LocalVertex,
        to: LocalVertex,
    ) -> Result<(), Refusal> {
        if self.wedges.len() != 1 {
            return Err(Refusal::Seam);
        }
        let seen = self.epoch;
        for corner in rings.living(mesh, from) {
            self.mark[mesh.vertex_of(corner.next())] = seen;
        }
        if self.count_common(mesh, rings, to) == 2 { Ok(()) } else { Err(Refusal::Topology) }
    }

    /// Number of vertices that share a face with `to` and were marked with the current epoch; takes their marks off.
    fn count_common(&mut self, mesh: &ClusterMesh, rings: &Rings, to: LocalVertex) -> usize {
        let mut count = 0;
        for corner in rings.living(mesh, to) {
            for vertex in mesh.others_of(corner) {
                let mark = &mut self.mark[vertex];
                let is_common = *mark == self.epoch;
                // No branch: which neighbours are common cannot be predicted.
                *mark = if is_common { 0 } else { *mark };
                count += usize::from(is_common);
            }
        }
        count
    }

    /// Checks that no face folds over, in space or in texture space, when the `moving` vertices come to `position` and
    /// the wedges of each pair to one of `uvs`. Nor may a face span empty space: `cost` is that of the collapse, in
    /// area × squared distance; infinity disables this check. A weaker [`ShapeRule`] allows some of it.
    /// [`check_topology`](EdgeStar::check_topology) must have passed.
    ///
    /// # Errors
    /// The first reason found against the collapse.
    pub fn check_faces(
        &mut self,
        mesh: &ClusterMesh,
        rings: &Rings,
        moving: &[LocalVertex],
        position: DVec3,
        uvs: &[DVec2],
        cost: f64,
    ) -> Result<(), Refusal> {
        let is_strict = self.shape_rule == ShapeRule::Strict;
        self.folds.begin(self.joins || moving.iter().any(|&vertex| mesh.is_near_fold(vertex)));
        for &vertex in moving {
            for &corner in rings.of(vertex) {
                let Some(wedge) = mesh.living(corner) else { continue };
                let (face, k) = (corner.face(), corner.index_in_face());
                if self.dying.contains(&face) {
                    continue;
                }
                let (before, uv_before) = (mesh.triangle(face), mesh.uv_triangle(face));
                let (mut after, mut uv_after) = (before, uv_before);
                after[k] = position;
                let mut pairs = self.wedges.iter().zip(uvs);
                if let Some((_, &uv)) = pairs.find(|(pair, _)| pair.from == wedge || pair.to == wedge) {
                    uv_after[k] = uv;
                }
                let may_turn = self.shape_rule == ShapeRule::MayTurn;
                let change = if may_turn { any_change_of(before, after) } else { change_of(before, after) };
                let change = change.ok_or(Refusal::Fold)?;
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
        let folds = is_strict && self.folds.finds(mesh, rings, &self.dying, anchor, position);
        if folds { Err(Refusal::Fold) } else { Ok(()) }
    }

    /// Collapses the edge in the mesh: faces at the edge die, the others get `to` as a vertex and keep or change their
    /// wedges.
    pub fn apply(&self, mesh: &mut ClusterMesh, rings: &Rings, from: LocalVertex, to: LocalVertex) {
        for &face in &self.dying {
            mesh.kill(face);
        }
        for &corner in rings.of(from) {
            let Some(wedge) = mesh.living(corner) else { continue };
            if let Some(pair) = self.wedges.iter().find(|pair| pair.from == wedge) {
                mesh.set_wedge(corner, pair.to);
            }
            mesh.set_vertex(corner, to);
        }
        if let Some(beside) = self.wedges.first().map(|pair| pair.to).or(self.beside) {
            self.stranded.iter().for_each(|&wedge| mesh.bring_wedge(wedge, beside));
        }
    }

    /// A face that shares no edge with another is a connected component of its own and must stay.
    fn check_piece(
        &self,
        mesh: &ClusterMesh,
        rings: &Rings,
        from: LocalVertex,
        to: LocalVertex,
    ) -> Result<(), Refusal> {
        let (&[_], &[opposite]) = (&self.dying[..], &self.opposite[..]) else { return Ok(()) };
        let faces_with =
            |v: LocalVertex| rings.faces(mesh, v).filter(|&face| mesh.vertices(face).contains(&opposite)).count();
        if faces_with(from) > 1 || faces_with(to) > 1 {
            return Ok(());
        }
        Err(if mesh.is_shared(to) && mesh.is_shared(opposite) { Refusal::Rim } else { Refusal::Piece })
    }

    /// Whether a surviving face has `to` and the opposite vertices as corners.
    fn face_exists(&self, mesh: &ClusterMesh, rings: &Rings, to: LocalVertex) -> bool {
        let is_between = |v: LocalVertex| v == to || self.opposite.contains(&v);
        rings.faces(mesh, to).any(|face| !self.dying.contains(&face) && mesh.vertices(face).into_iter().all(is_between))
    }
}

/// Whether the middle of a new face is farther from all faces around the moving vertices than its area and the
/// collapse's cost allow.
fn hovers(
    mesh: &ClusterMesh,
    rings: &Rings,
    moving: &[LocalVertex],
    [a, b, c]: [DVec3; 3],
    area: f64,
    cost: f64,
) -> bool {
    let middle = (a + b + c) / 3.0;
    let allowed_sq = (HOVER_SHARE * HOVER_SHARE * area).max(HOVER_COST * cost / area);
    let mut old = moving.iter().flat_map(|&vertex| rings.faces(mesh, vertex)).map(|face| mesh.triangle(face));
    old.all(|triangle| distance_sq(middle, triangle) > allowed_sq)
}

mod edges;
#[cfg(test)]
mod tests;
