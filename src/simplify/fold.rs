//! Whether a collapse would fold two faces onto each other, back to back.
//!
//! ```text
//!      /\              /|
//!     /  \     ──▶    / |      No face turns over, and yet two that met at a roof's ridge lie on each other: a flap
//!    /____\          /__|      that hides what was between them.
//! ```

use glam::DVec3;

use super::legality::Change;
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::fold::are_nearly_folded;
use crate::mesh::ring::Rings;

/// Where no face turns by more than about 10° (squared cosine), no two come to lie on each other.
const TURN_COSINE_SQ: f64 = 0.97;

/// Of two faces with opposite normals one leans away from the sum of both, and from that of more faces, by this much and
/// more (squared cosine of about 70°).
const LEAN_COSINE_SQ: f64 = 0.117;
/// Number of faces that says nothing of the surface around them.
const FEW_FACES: usize = 2;

/// Whether a normal leans away from a sum of normals.
#[inline]
fn leans(normal: DVec3, sum: DVec3) -> bool {
    let along = normal.dot(sum);
    along <= 0.0 || along * along < LEAN_COSINE_SQ * normal.length_squared() * sum.length_squared()
}

/// Whether a face turns so much that it may come to lie on a neighbour; from the dot product of its normals before and after,
/// and the product of their squared lengths.
#[inline(always)]
pub(super) fn may_fold(turn: f64, lengths_sq: f64) -> bool {
    turn < 0.0 || turn * turn <= TURN_COSINE_SQ * lengths_sq
}

/// The faces around vertices that join at one place; scratch space is kept from one move to the next.
#[derive(Debug, Default)]
pub(super) struct FoldCheck {
    /// The faces that change.
    changing: Vec<Changing>,
    /// Corners at these vertices whose faces may come to lie on others.
    turned: Vec<u32>,
    joined: Vec<Joined>,
}

/// A face that stays and changes.
#[derive(Debug)]
struct Changing {
    /// Its corner at one of the vertices.
    corner: u32,
    /// Its new normal, twice as long as its area.
    normal: DVec3,
    /// Whether it [may fold](may_fold).
    turns: bool,
}

/// A face around the vertices that join, which stays.
#[derive(Debug)]
struct Joined {
    /// Its corner at one of them.
    corner: u32,
    /// The two other vertices, counter-clockwise.
    ends: [u32; 2],
}

impl Joined {
    fn of(mesh: &ClusterMesh, corner: u32) -> Self {
        Self { corner, ends: ClusterMesh::following(corner).map(|corner| mesh.vertex_of(corner)) }
    }
}

impl FoldCheck {
    /// Begins a move.
    pub(super) fn clear(&mut self) {
        self.changing.clear();
    }

    /// Adds a face that stays and changes, by its corner at a vertex that moves.
    #[inline(always)]
    pub(super) fn push(&mut self, corner: u32, change: &Change) {
        self.changing.push(Changing { corner, normal: change.normal, turns: change.turns });
    }

    /// Chooses the faces that turn, and those that lean away from the others: they may have turned step by step.
    fn choose_turned(&mut self) {
        let sum: DVec3 = self.changing.iter().map(|face| face.normal).sum();
        // Few faces may all lean away from what is around them.
        let are_few = self.changing.len() <= FEW_FACES;
        let chosen = self.changing.iter().filter(|face| are_few || face.turns || leans(face.normal, sum));
        self.turned.clear();
        self.turned.extend(chosen.map(|face| face.corner));
    }

    /// Whether, with all `joining` vertices at `position` and the `dying` faces gone, two faces that share an edge would be
    /// folded onto each other that are not now. The faces that change must have been [pushed](FoldCheck::push).
    pub(super) fn finds(
        &mut self,
        mesh: &ClusterMesh,
        rings: &Rings,
        dying: &[u32],
        joining: &[u32],
        position: DVec3,
    ) -> bool {
        self.choose_turned();
        if self.turned.is_empty() {
            return false;
        }
        let corners = joining.iter().flat_map(|&vertex| rings.of(vertex)).copied();
        let staying = corners.filter(|corner| mesh.living(*corner).is_some() && !dying.contains(&(corner / 3)));
        self.joined.clear();
        self.joined.extend(staying.map(|corner| Joined::of(mesh, corner)));
        self.turned.iter().any(|&corner| {
            let one = Joined::of(mesh, corner);
            folds_outwards(mesh, rings, &one, position)
                || self.joined.iter().any(|other| {
                    (other.ends[0] == one.ends[1] && fold_together(mesh, [&one, other], position))
                        || (other.ends[1] == one.ends[0] && fold_together(mesh, [other, &one], position))
                })
        })
    }
}

/// Whether a face folds onto the one across the side that none of the vertices is an end of.
fn folds_outwards(mesh: &ClusterMesh, rings: &Rings, one: &Joined, position: DVec3) -> bool {
    let ([a, b], face) = (one.ends, one.corner / 3);
    let mut beside = rings.of(a).iter().filter_map(|&corner| {
        let far = ClusterMesh::following(corner);
        let at = far.iter().position(|&corner| mesh.vertex_of(corner) == b)?;
        (corner / 3 != face && mesh.living(corner).is_some()).then(|| mesh.vertex_of(far[1 - at]))
    });
    let (Some(third), None) = (beside.next(), beside.next()) else { return false };
    let [a, b, third, from] = [a, b, third, mesh.vertex_of(one.corner)].map(|v| mesh.positions[v as usize]);
    are_nearly_folded([a, b], [position, third]) && !are_nearly_folded([a, b], [from, third])
}

/// Whether two of the faces fold onto each other; the second begins where the first ends.
fn fold_together(mesh: &ClusterMesh, [one, other]: [&Joined; 2], position: DVec3) -> bool {
    if one.corner / 3 == other.corner / 3 {
        return false;
    }
    let [from, from_other] = [one, other].map(|joined| mesh.vertex_of(joined.corner));
    let [before, ridge, first, last] =
        [from, one.ends[1], one.ends[0], other.ends[1]].map(|v| mesh.positions[v as usize]);
    are_nearly_folded([position, ridge], [first, last])
        && !(from == from_other && are_nearly_folded([before, ridge], [first, last]))
}
