//! Legality of collapses that may change the topology, by the number of faces at each edge around the collapse.

use glam::DVec2;

use crate::mesh::cluster::ClusterMesh;
use crate::mesh::fold::are_nearly_folded;
use crate::mesh::id::{FaceId, LocalVertex, Wedge};
use crate::mesh::ring::Rings;
use crate::simplify::edge_star::{EdgeStar, Neighbour, VanishingFan, is_hub};
use crate::simplify::fold::thirds_at;
use crate::simplify::refusal::Refusal;
use crate::simplify::shape_rule::ShapeRule;
use crate::simplify::triangle_change::doubled_uv_area;

/// Largest number of faces of an edge at which surfaces meet.
const FACES_MEETING_MAX: u32 = 8;

impl Neighbour {
    /// Whether the edge stays legal. It may have no more faces than it had at either end, or two; or up to
    /// [`FACES_MEETING_MAX`] where surfaces `may_meet`. Two faces that become neighbours there must run along it in
    /// opposite directions, now and in their input directions, unless faces `may_turn`. The edge must not become a
    /// border.
    fn is_plain(&self, may_meet: bool, may_turn: bool) -> bool {
        let [at_from, at_to] = self.before;
        let is_joined = at_from > 0 && at_to > 0 && self.after == 2;
        let opens = self.after == 1 && at_from != 1 && at_to != 1;
        let meets = may_meet && self.after <= FACES_MEETING_MAX;
        !opens
            && (self.after <= at_from.max(at_to).max(2) || meets)
            && (!is_joined || may_turn || (self.after_ahead == 1 && self.after_turned != 1))
    }

    /// Increase in the number of edges of more than two faces.
    fn new_non_manifold_edges(&self) -> i64 {
        let count = |faces: u32| i64::from(faces > 2);
        count(self.after) - self.before.into_iter().map(count).sum::<i64>()
    }
}

fn neighbour_of(neighbours: &mut Vec<Neighbour>, vertex: LocalVertex) -> &mut Neighbour {
    let at = neighbours.iter().position(|known| known.vertex == vertex).unwrap_or_else(|| {
        neighbours.push(Neighbour { vertex, before: [0; 2], after: 0, after_ahead: 0, after_turned: 0 });
        neighbours.len() - 1
    });
    &mut neighbours[at]
}

/// Whether a face has `first` directly after `second`, so that it faces the opposite way to one that has them in order.
fn goes_back(face: [LocalVertex; 3], [first, second]: [LocalVertex; 2]) -> bool {
    (0..3).any(|k| face[k] == second && face[(k + 1) % 3] == first)
}

impl EdgeStar {
    /// Checks everything but geometry where the topology may change. No edge may have more faces than before, or than
    /// two, unless surfaces may meet. Of faces with the same vertices one stays, or none if they face opposite ways and
    /// no longer enclose anything.
    ///
    /// ```text
    ///      x           x         the hole between a, b and x closes: ax and bx become one edge of two faces;
    ///     / \          |         if they had two faces each, it would have four
    ///    a---b   ──▶   b
    /// ```
    pub(super) fn check_edges(
        &mut self,
        mesh: &ClusterMesh,
        rings: &Rings,
        from: LocalVertex,
        to: LocalVertex,
        fan: VanishingFan,
    ) -> Result<(), Refusal> {
        if self.dying.is_empty() != fan.is_rip || is_hub(mesh, rings, to) || mesh.is_shared(to) {
            return Err(Refusal::Topology);
        }
        // The faces of the partner may have died in this round.
        if fan.is_rip && self.beside.is_none() {
            return Err(Refusal::Topology);
        }
        let at_edge = self.dying.len();
        let may_turn = self.shape_rule == ShapeRule::MayTurn;
        self.count_neighbours(mesh, rings);
        let last_double = self.drop_doubles(mesh, rings);
        let stays = |face: FaceId| !self.dying.contains(&face);
        let stays = [from, to].iter().any(|&end| rings.faces(mesh, end).any(stays))
            || self.far_sides.iter().any(|&edge| thirds_at(mesh, rings, edge).any(|(face, _)| stays(face)));
        // If only the two sides of a flat component are left, and nothing else meets their edges, one of them stays.
        if let Some(double) = last_double.filter(|_| !stays) {
            self.dying.retain(|&face| face != double);
        } else if !self.neighbours.iter().all(|neighbour| neighbour.is_plain(fan.spare_edges > 0, may_turn)) {
            return Err(Refusal::Topology);
        } else if !stays && !fan.is_alone {
            return Err(Refusal::Piece);
        } else {
            self.check_far_sides(mesh, rings)?;
        }
        self.strand(mesh, rings, from, fan)?;
        self.find_joined();
        if self.joins && self.joins_mirrored(mesh, rings) {
            return Err(Refusal::UvFold);
        }
        self.new_non_manifold_edges = self.neighbours.iter().map(Neighbour::new_non_manifold_edges).sum::<i64>();
        self.new_non_manifold_edges -= i64::from(at_edge > 2);
        if self.new_non_manifold_edges > fan.spare_edges.max(0) {
            return Err(Refusal::Topology);
        }
        self.unsettled.push(to);
        self.unsettled.extend(self.neighbours.iter().map(|neighbour| neighbour.vertex));
        Ok(())
    }

    /// Counts the faces at the edges to all neighbours, before the collapse, and without the faces at the collapsing
    /// edge.
    fn count_neighbours(&mut self, mesh: &ClusterMesh, rings: &Rings) {
        self.neighbours.clear();
        let [from, to] = self.ends;
        for end in [from, to] {
            for corner in rings.living(mesh, end) {
                let is_dying = self.dying.contains(&(corner.face()));
                let far = mesh.others_of(corner);
                for (place, vertex) in far.into_iter().enumerate().filter(|(_, v)| !self.ends.contains(v)) {
                    let neighbour = neighbour_of(&mut self.neighbours, vertex);
                    neighbour.before[usize::from(end == to)] += 1;
                    neighbour.after += u32::from(!is_dying);
                    neighbour.after_ahead += u32::from(!is_dying && place == 0);
                    neighbour.after_turned += u32::from(!is_dying && mesh.is_turned[corner.face()]);
                }
            }
        }
    }

    /// Adds double faces to the dying ones: of two faces that will have the same vertices, the one at the vanishing
    /// end, and also the other if it faces the opposite way. Returns the last such other face.
    fn drop_doubles(&mut self, mesh: &ClusterMesh, rings: &Rings) -> Option<FaceId> {
        self.far_sides.clear();
        let [from, to] = self.ends;
        let mut last_double = None;
        for corner in rings.living(mesh, from) {
            let face = corner.face();
            let far = mesh.others_of(corner);
            let is_double = |&other: &FaceId| {
                !self.dying.contains(&other) && far.iter().all(|vertex| mesh.vertices(other).contains(vertex))
            };
            if self.dying.contains(&face) {
                continue;
            }
            let Some(other) = rings.faces(mesh, to).find(is_double) else { continue };
            let goes_back = goes_back(mesh.vertices(other), far);
            self.far_sides.push(far);
            self.dying.push(face);
            if goes_back {
                self.dying.push(other);
                last_double = Some(other);
            }
            for (place, &vertex) in far.iter().enumerate() {
                let neighbour = neighbour_of(&mut self.neighbours, vertex);
                neighbour.after -= 1 + u32::from(goes_back);
                neighbour.after_ahead -= u32::from(place == 0 || goes_back);
                let is_turned = |face: FaceId| u32::from(mesh.is_turned[face]);
                neighbour.after_turned -= is_turned(face) + u32::from(goes_back) * is_turned(other);
            }
        }
        last_double
    }

    /// Checks the sides of dying double faces that touch neither end, and so do not move: none may become a border
    /// edge, and two faces that are left at one must neither be folded onto each other nor be mirrored in texture
    /// space.
    fn check_far_sides(&self, mesh: &ClusterMesh, rings: &Rings) -> Result<(), Refusal> {
        let place = |vertex: LocalVertex| mesh.positions[vertex];
        for &[a, b] in &self.far_sides {
            let mut left = thirds_at(mesh, rings, [a, b]).filter(|(face, _)| !self.dying.contains(face));
            match [left.next(), left.next(), left.next()] {
                [Some(_), None, _] => return Err(Refusal::Topology),
                [Some(one), Some(other), None] => {
                    let thirds = [one, other].map(|(_, third)| place(third));
                    if self.shape_rule == ShapeRule::Strict && are_nearly_folded([a, b].map(place), thirds) {
                        return Err(Refusal::Fold);
                    }
                    if self.are_mirrored(mesh, [one, other].map(|(face, _)| face), [a, b]) {
                        return Err(Refusal::UvFold);
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Finds the wedges of the vanishing end, in surviving faces, that are in no pair.
    ///
    /// # Errors
    /// [`Refusal::Seam`] if there are any and the collapse may not strand wedges, or if a wedge is in several pairs.
    fn strand(
        &mut self,
        mesh: &ClusterMesh,
        rings: &Rings,
        from: LocalVertex,
        fan: VanishingFan,
    ) -> Result<(), Refusal> {
        self.stranded.clear();
        for &corner in rings.of(from) {
            let Some(wedge) = mesh.living(corner) else { continue };
            if self.dying.contains(&(corner.face())) {
                continue;
            }
            match self.wedges.iter().filter(|pair| pair.from == wedge).count() {
                1 => {}
                0 if fan.strands || fan.is_rip => {
                    if !self.stranded.contains(&wedge) {
                        self.stranded.push(wedge);
                    }
                }
                _ => return Err(Refusal::Seam),
            }
        }
        Ok(())
    }

    /// Finds the neighbours at edges across which faces become neighbours: edges that merge, and edges of three faces
    /// or more that keep two.
    fn find_joined(&mut self) {
        for neighbour in &self.neighbours {
            let is_left_with_two = neighbour.after == 2 && neighbour.before.iter().any(|&count| count > 2);
            let is_new = !self.opposite.contains(&neighbour.vertex);
            if is_left_with_two || (is_new && neighbour.before.iter().all(|&count| count > 0)) {
                self.joins = true;
                if is_new {
                    self.opposite.push(neighbour.vertex);
                }
            }
        }
    }

    /// Whether faces that become neighbours at an edge form one chart there, with one texture triangle mirrored against
    /// the other.
    fn joins_mirrored(&self, mesh: &ClusterMesh, rings: &Rings) -> bool {
        let [from, to] = self.ends;
        self.neighbours.iter().filter(|neighbour| neighbour.after == 2).any(|&Neighbour { vertex, .. }| {
            let at_ends = [from, to].into_iter().flat_map(|end| rings.faces(mesh, end));
            let mut faces = at_ends.filter(|face| !self.dying.contains(face) && mesh.vertices(*face).contains(&vertex));
            let both = faces.next().zip(faces.next());
            both.is_some_and(|(one, other)| self.are_mirrored(mesh, [one, other], [vertex, to]))
        })
    }

    /// Whether two faces run along an edge in opposite directions with the same texture coordinates, while their
    /// texture triangles have opposite signs. The vanishing end counts as the staying one.
    fn are_mirrored(&self, mesh: &ClusterMesh, faces: [FaceId; 2], edge: [LocalVertex; 2]) -> bool {
        let [one, other] = faces.map(|face| self.side_of(mesh, face, edge));
        one.leads_on != other.leads_on
            && one.is_turned == other.is_turned
            && one.uvs == other.uvs
            && one.doubled_uv_area * other.doubled_uv_area < 0.0
    }

    /// The properties of a face at one of its edges.
    fn side_of(&self, mesh: &ClusterMesh, face: FaceId, edge: [LocalVertex; 2]) -> Side {
        let [from, to] = self.ends;
        let vertices = mesh.vertices(face).map(|vertex| if vertex == from { to } else { vertex });
        let ends = edge.map(|end| vertices.into_iter().position(|vertex| vertex == end).unwrap_or(0));
        let wedge_after =
            |wedge: Wedge| self.wedges.iter().find(|pair| pair.from == wedge).map_or(wedge, |pair| pair.to);
        Side {
            leads_on: (ends[0] + 1) % 3 == ends[1],
            is_turned: mesh.is_turned[face],
            uvs: ends.map(|k| mesh.wedge_uv[wedge_after(mesh.corners[face][k])]),
            doubled_uv_area: doubled_uv_area(mesh.uv_triangle(face)),
        }
    }
}

/// A face at an edge.
#[derive(Debug)]
struct Side {
    /// Whether the second end follows the first in the face.
    leads_on: bool,
    /// Whether the face is turned over during processing.
    is_turned: bool,
    /// Its texture coordinates at both ends.
    uvs: [DVec2; 2],
    doubled_uv_area: f64,
}

#[cfg(test)]
mod tests;
