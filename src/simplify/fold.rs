//! Whether a collapse would fold two faces onto each other, back to back.
//!
//! ```text
//!      /\              /|
//!     /  \     ──▶    / |      No face turns over, and yet two that met at a roof's ridge lie on each other: a flap
//!    /____\          /__|      that hides what was between them.
//! ```

use glam::DVec3;

use super::legality::may_fold;
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::fold::are_folded;
use crate::mesh::ring::Rings;

/// A face around the vertices that move, which stays.
struct Moved {
    face: u32,
    /// The two vertices that stay, counter-clockwise.
    ends: [u32; 2],
    /// Where they are.
    at: [DVec3; 2],
    /// Where the corner was that moves.
    from: DVec3,
    /// Whether it turns so much that it may come to lie on a neighbour.
    turns: bool,
}

/// Whether, with all `moving` vertices at `position` and the `dying` faces gone, two faces that share an edge would be folded
/// onto each other that are not now. It need not be asked where no face turns much.
pub fn folds(mesh: &ClusterMesh, rings: &Rings, dying: &[u32], moving: &[u32], position: DVec3) -> bool {
    let corners = || moving.iter().flat_map(|&vertex| rings.of(vertex)).copied();
    let stays = |corner: &u32| mesh.living(*corner).is_some() && !dying.contains(&(corner / 3));
    let moved: Vec<Moved> = corners().filter(stays).map(|corner| Moved::of(mesh, corner, position)).collect();
    moved.iter().any(|one| one.turns && folds_outwards(mesh, rings, one, position)) || fold_together(&moved, position)
}

impl Moved {
    fn of(mesh: &ClusterMesh, corner: u32, position: DVec3) -> Self {
        let face = corner / 3;
        let (vertices, triangle) = (mesh.vertices(face), mesh.triangle(face));
        let [apex, first, second] = [0, 1, 2].map(|k| (corner as usize + k - 3 * face as usize) % 3);
        let (at, from) = ([triangle[first], triangle[second]], triangle[apex]);
        let [old, new] = [from, position].map(|corner| (at[1] - at[0]).cross(corner - at[0]));
        let turns = may_fold(old.dot(new), old.length_squared() * new.length_squared());
        Self { face, ends: [vertices[first], vertices[second]], at, from, turns }
    }
}

/// Whether a face folds onto the one across the side that does not move.
fn folds_outwards(mesh: &ClusterMesh, rings: &Rings, one: &Moved, position: DVec3) -> bool {
    let [a, b] = one.ends;
    let mut beside = rings.faces(mesh, a).filter(|&face| face != one.face && mesh.vertices(face).contains(&b));
    let (Some(other), None) = (beside.next(), beside.next()) else { return false };
    let Some(k) = mesh.vertices(other).iter().position(|&v| v != a && v != b) else { return false };
    let third = mesh.triangle(other)[k];
    are_folded(one.at, [position, third]) && !are_folded(one.at, [one.from, third])
}

/// Whether two of the faces that move fold onto each other.
fn fold_together(moved: &[Moved], position: DVec3) -> bool {
    moved.iter().any(|one| {
        let follows =
            |other: &&Moved| other.ends[0] == one.ends[1] && (one.turns || other.turns) && other.face != one.face;
        moved.iter().filter(follows).any(|other| {
            let ridge = one.at[1];
            are_folded([position, ridge], [one.at[0], other.at[1]])
                && !(one.from == other.from && are_folded([one.from, ridge], [one.at[0], other.at[1]]))
        })
    })
}
