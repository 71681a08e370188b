//! Whether a collapse would fold two faces onto each other, back to back.
//!
//! ```text
//!      /\              /|
//!     /  \     ──▶    / |      No face turns over, yet two faces that met at a ridge now lie on each other: a flap
//!    /____\          /__|      that hides what was between them.
//! ```

use glam::DVec3;

use super::triangle_change::Change;
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::fold::{are_folded, are_nearly_folded};
use crate::mesh::id::{Corner, FaceId, LocalVertex};
use crate::mesh::ring::Rings;

/// A face whose normal is more than about 70° from the sum of the normals (squared cosine) may have turned in small
/// steps.
const LEAN_COSINE_SQ: f64 = 0.117;
/// Of two faces folded onto each other, one has a normal at least 85.7° from any direction: half the angle between
/// their normals (squared cosine of 85.6°).
const OPPOSED_COSINE_SQ: f64 = 0.0059;
/// Up to this many changing faces, the sum of their normals says nothing about the surface around them.
const FEW_FACES: usize = 2;

/// The check of one collapse or relocation; buffers are reused.
#[derive(Debug, Default)]
pub struct FoldCheck {
    /// The faces that change and stay.
    changing: Vec<Changing>,
    /// Sum of their normals.
    sum: DVec3,
    /// Whether any two faces may fold onto each other, even if neither turns or leans.
    looks_at_all: bool,
    /// Corners of changing faces that may fold onto a face that does not change.
    turned: Vec<Corner>,
    /// Indices of the changing faces that may fold onto another changing face; all are turned.
    opposed: Vec<usize>,
    /// The changing faces again, in their order, once there is an opposed one.
    joined: Vec<Joined>,
}

/// A face that stays and changes.
#[derive(Debug)]
struct Changing {
    /// Its corner at a moving vertex.
    corner: Corner,
    /// Its new normal; the length is twice the new area.
    normal: DVec3,
    /// Whether it may fold.
    turns: bool,
}

/// A changing face at the merged vertex.
#[derive(Debug)]
struct Joined {
    /// Its corner at a moving vertex.
    corner: Corner,
    /// The two other vertices, counter-clockwise.
    ends: [LocalVertex; 2],
}

impl Joined {
    fn of(mesh: &ClusterMesh, corner: Corner) -> Self {
        Self { corner, ends: mesh.others_of(corner) }
    }
}

impl FoldCheck {
    /// Begins a check. `looks_at_all` is needed if faces become neighbours that were not, or may run along an edge in
    /// the same direction: such faces have the same normal when they lie on each other. It is also needed if a moving
    /// vertex [is near a fold](ClusterMesh::is_near_fold): that fold may close by less than it takes to turn.
    pub fn begin(&mut self, looks_at_all: bool) {
        self.changing.clear();
        self.sum = DVec3::ZERO;
        self.looks_at_all = looks_at_all;
    }

    /// Adds a face that stays and changes, by its corner at a moving vertex.
    #[inline(always)]
    pub fn push(&mut self, corner: Corner, change: &Change) {
        self.sum += change.normal;
        self.changing.push(Changing { corner, normal: change.normal, turns: change.turns });
    }

    /// Selects the faces that turn, and those that lean away from the others.
    fn choose(&mut self) {
        let (sum, sum_sq) = (self.sum, self.sum.length_squared());
        // If there are few faces, all may lean away from the surface around them.
        let are_few = self.looks_at_all || self.changing.len() <= FEW_FACES;
        self.turned.clear();
        self.opposed.clear();
        for (place, &Changing { corner, normal, turns }) in self.changing.iter().enumerate() {
            let along = normal.dot(sum);
            let [along_sq, lengths_sq] = [along * along, normal.length_squared() * sum_sq];
            let leans = |cosine_sq: f64| (along <= 0.0) | (along_sq < cosine_sq * lengths_sq);
            if are_few | turns | leans(LEAN_COSINE_SQ) {
                self.turned.push(corner);
                if self.looks_at_all | leans(OPPOSED_COSINE_SQ) {
                    self.opposed.push(place);
                }
            }
        }
    }

    /// Whether two faces that share an edge become folded onto each other once the moving vertices are at `position`
    /// and the `dying` faces are gone. Pairs that are folded as much already do not count. All changing faces must have
    /// been [pushed](FoldCheck::push). If one vertex at `position` stays as it is, `anchor` holds this vertex and the
    /// vertices that are neighbours of both ends.
    pub fn finds(
        &mut self,
        mesh: &ClusterMesh,
        rings: &Rings,
        dying: &[FaceId],
        anchor: Option<(LocalVertex, &[LocalVertex])>,
        position: DVec3,
    ) -> bool {
        self.choose();
        let folds_now = |&corner: &Corner| {
            let one = Joined::of(mesh, corner);
            folds_outwards(mesh, rings, &one, position)
                || anchor.is_some_and(|anchor| folds_at_anchor(mesh, rings, dying, &one, anchor, position))
        };
        if self.turned.iter().any(folds_now) {
            return true;
        }
        if self.opposed.is_empty() {
            return false;
        }
        self.joined.clear();
        self.joined.extend(self.changing.iter().map(|face| Joined::of(mesh, face.corner)));
        self.opposed.iter().any(|&place| {
            let one = &self.joined[place];
            // Where all faces are opposed, each pair is looked at once.
            let others = if self.looks_at_all { &self.joined[place + 1..] } else { &self.joined[..] };
            others.iter().any(|other| other.corner != one.corner && fold_together(mesh, [one, other], position))
        })
    }
}

/// Whether a face folds onto the one across its side that has no moving vertex.
fn folds_outwards(mesh: &ClusterMesh, rings: &Rings, one: &Joined, position: DVec3) -> bool {
    let [a, b] = one.ends;
    let Some(third) = third_across(mesh, rings, one) else { return false };
    let place = |v: LocalVertex| mesh.positions[v];
    let (edge, third, from) = ([place(a), place(b)], place(third), place(mesh.vertex_of(one.corner)));
    become_folded([edge; 2], [[from, third], [position, third]])
}

/// The third vertex of the face across the side of a face that has no moving vertex; `None` if there is no such face,
/// or several.
#[inline(always)]
fn third_across(mesh: &ClusterMesh, rings: &Rings, one: &Joined) -> Option<LocalVertex> {
    let ([a, b], own) = (rings.search_order(one.ends), one.corner.face());
    let (mut across, mut third, mut count) = (own, a, 0u32);
    for corner in rings.of(a) {
        let face = corner.face();
        let (has_edge, last) = third_of(mesh.vertices(face), [a, b]);
        let is_across = has_edge & (face != own);
        (across, third) = if is_across { (face, last) } else { (across, third) };
        count += u32::from(is_across);
    }
    match count {
        0 => None,
        1 => (!mesh.is_dead(across)).then_some(third),
        // Some of them may be dead.
        _ => {
            let mut others = thirds_at(mesh, rings, [a, b]).filter(|&(face, _)| face != own);
            others.next().filter(|_| others.next().is_none()).map(|(_, third)| third)
        }
    }
}

/// Whether a face folds onto an unchanged face, at an edge from the `anchor` to a vertex in `common`.
fn folds_at_anchor(
    mesh: &ClusterMesh,
    rings: &Rings,
    dying: &[FaceId],
    one: &Joined,
    (anchor, common): (LocalVertex, &[LocalVertex]),
    position: DVec3,
) -> bool {
    let [a, b] = one.ends;
    [[a, b], [b, a]].into_iter().filter(|[end, _]| common.contains(end)).any(|[end, last]| {
        let mut thirds = thirds_at(mesh, rings, [anchor, end]).filter(|(beside, _)| !dying.contains(beside));
        thirds.any(|(_, third)| {
            let place = |v: LocalVertex| mesh.positions[v];
            are_nearly_folded([position, place(end)], [place(last), place(third)])
        })
    })
}

/// The living faces that have both vertices, and the third vertex of each.
#[inline(always)]
pub(super) fn thirds_at<'a>(
    mesh: &'a ClusterMesh,
    rings: &'a Rings,
    edge: [LocalVertex; 2],
) -> impl Iterator<Item = (FaceId, LocalVertex)> + 'a {
    let [a, b] = rings.search_order(edge);
    rings.of(a).iter().filter_map(move |corner| {
        let face = corner.face();
        let (has_edge, third) = third_of(mesh.vertices(face), [a, b]);
        (has_edge && !mesh.is_dead(face)).then_some((face, third))
    })
}

/// Whether a face around `a` also has `b`, and if so, its third vertex.
#[inline(always)]
fn third_of(vertices: [LocalVertex; 3], [a, b]: [LocalVertex; 2]) -> (bool, LocalVertex) {
    // No branch for each vertex: where the edge stands in the face is unpredictable.
    let has_edge = (vertices[0] == b) | (vertices[1] == b) | (vertices[2] == b);
    let third = vertices.into_iter().fold(a.number() ^ b.number(), |rest, vertex| rest ^ vertex.number());
    (has_edge, LocalVertex::new(third))
}

/// Whether two changing faces share an edge at `position`, and fold onto each other there.
#[inline(always)]
fn fold_together(mesh: &ClusterMesh, [one, other]: [&Joined; 2], position: DVec3) -> bool {
    // Usually one begins where the other ends; not if both run along the edge in the same direction.
    for [i, j] in [[0, 1], [1, 0], [0, 0], [1, 1]] {
        if one.ends[i] == other.ends[j] && fold_at_edge(mesh, [one, other], [i, j], position) {
            return true;
        }
    }
    false
}

/// Whether they fold onto each other at the edge that leads to `one.ends[i]` = `other.ends[j]`.
fn fold_at_edge(mesh: &ClusterMesh, [one, other]: [&Joined; 2], [i, j]: [usize; 2], position: DVec3) -> bool {
    let place = |v: LocalVertex| mesh.positions[v];
    let (ridge, thirds) = (place(one.ends[i]), [place(one.ends[1 - i]), place(other.ends[1 - j])]);
    let from = mesh.vertex_of(one.corner);
    if from != mesh.vertex_of(other.corner) {
        return are_nearly_folded([position, ridge], thirds);
    }
    become_folded([[place(from), ridge], [position, ridge]], [thirds; 2])
}

/// Whether two faces become nearly folded, or folded; each is given by its edge and third corners before and after.
fn become_folded(edges: [[DVec3; 2]; 2], thirds: [[DVec3; 2]; 2]) -> bool {
    // What is folded is nearly folded.
    are_nearly_folded(edges[1], thirds[1])
        && (!are_nearly_folded(edges[0], thirds[0])
            || (are_folded(edges[1], thirds[1]) && !are_folded(edges[0], thirds[0])))
}
