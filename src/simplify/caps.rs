//! Closes small holes: short loops of border edges get new faces where that costs no more than a collapse.
//!
//! ```text
//!    a-------------b            a-------------b
//!     \   hole    /      ──▶     \`-.  cap   /     the rest of a rip whose two sides have different vertices
//!      c---d-----e                c---d-----e
//! ```
//! A cap has no counterpart in the input. Its cost is the distance of its points from the rim: area × squared height.

use super::rips::FACES_MAX;
use super::witness::area_of;
use crate::base::id::{TiSlice, TiVec};
use crate::mesh::class::Classes;
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::{Corner, LocalVertex, Wedge};
use crate::mesh::ring::{Rings, Spoke};
use crate::model::id::PartId;

/// Largest number of edges of a hole.
const EDGES_MAX: usize = 8;
/// Lowest cosine of the angle between the normals of a cap and of a face beside it.
const FOLD_MIN: f64 = -0.8;
/// Mean squared distance of a triangle's points to its longest side, relative to its squared height.
const MEAN_SQ: f64 = 1.0 / 6.0;

/// Holes that were closed.
#[derive(Debug, Default)]
pub struct Shut {
    /// Number of holes.
    pub count: u64,
    /// The vertices of their rims.
    pub vertices: Vec<LocalVertex>,
}

/// Closes holes that cost up to `most` each, as long as no two share a vertex and there is `room` for more faces. If
/// any was closed, the rings and the classes of the returned vertices must be recomputed.
pub fn shut(mesh: &mut ClusterMesh, rings: &Rings, classes: &Classes, most: f64, mut room: usize) -> Shut {
    let may_border = |v: LocalVertex| classes[v].may_border();
    let onwards: TiVec<LocalVertex, Onwards> =
        classes.keys().map(|v| if may_border(v) { Onwards::from(mesh, rings, v) } else { Onwards::Nowhere }).collect();
    let mut is_used = mesh.per_vertex(false);
    let mut shut = Shut::default();
    for start in classes.keys() {
        if is_used[start] || !may_return(&onwards, start) {
            continue;
        }
        let Some(hole) = Hole::at(mesh, rings, start) else { continue };
        let is_turned = hole.rim[0].is_turned;
        let is_free =
            |edge: &HoleEdge| !is_used[edge.from] && !mesh.is_shared(edge.from) && edge.is_turned == is_turned;
        if !hole.rim.iter().all(is_free) {
            continue;
        }
        let Some(ears) = hole.ears(mesh, rings, most).filter(|ears| ears.len() <= room) else { continue };
        room -= ears.len();
        for edge in &hole.rim {
            is_used[edge.from] = true;
            shut.vertices.push(edge.from);
        }
        hole.shut(mesh, &ears);
        shut.count += 1;
    }
    shut
}

/// A border edge of a hole, in the direction of a face that closes the hole.
#[derive(Debug, Clone, Copy)]
struct HoleEdge {
    from: LocalVertex,
    to: LocalVertex,
    /// Wedges of both ends in the face beside the edge.
    wedges: [Wedge; 2],
    part: PartId,
    /// Whether that face is turned over during processing.
    is_turned: bool,
    /// The third vertex of that face.
    beyond: LocalVertex,
    /// Wedge of `beyond` in that face.
    beyond_wedge: Wedge,
}

/// Border edges that continue from a vertex around a hole.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Onwards {
    Nowhere,
    To(LocalVertex),
    SeveralWays,
}

impl Onwards {
    fn from(mesh: &ClusterMesh, rings: &Rings, from: LocalVertex) -> Self {
        let mut corners = corners_before_rims(mesh, rings, from);
        match [corners.next(), corners.next()] {
            [None, _] => Self::Nowhere,
            [Some(corner), None] => Self::To(mesh.vertex_of(corner.previous())),
            _ => Self::SeveralWays,
        }
    }
}

/// Whether a walk along at most `EDGES_MAX` border edges may lead from a vertex back to it.
fn may_return(onwards: &TiSlice<LocalVertex, Onwards>, start: LocalVertex) -> bool {
    let mut at = start;
    for _ in 0..EDGES_MAX {
        at = match onwards[at] {
            Onwards::Nowhere => return false,
            Onwards::To(next) if next == start => return true,
            Onwards::To(next) => next,
            Onwards::SeveralWays => return true,
        };
    }
    false
}

/// Corners at a vertex whose face is the only one with the edge to the previous corner: along this edge the walk around
/// a hole continues.
fn corners_before_rims<'a>(
    mesh: &'a ClusterMesh,
    rings: &'a Rings,
    from: LocalVertex,
) -> impl Iterator<Item = Corner> + 'a {
    let corners = rings.of(from);
    let corners = if corners.len() > FACES_MAX { &[] } else { corners };
    let living = move || corners.iter().copied().filter(|&corner| mesh.living(corner).is_some());
    living().filter(move |&corner| {
        let before = mesh.vertex_of(corner.previous());
        living().all(|other| other == corner || !mesh.others_of(other).contains(&before))
    })
}

/// Border edges that continue from a vertex around a hole.
fn rims_from(mesh: &ClusterMesh, rings: &Rings, from: LocalVertex) -> Vec<HoleEdge> {
    let rim = |corner: Corner| {
        let spoke = Spoke::of(mesh, corner);
        let wedges = [spoke.wedge, spoke.previous_wedge];
        let (part, is_turned) = (mesh.parts[corner.face()], mesh.is_turned[corner.face()]);
        HoleEdge {
            from,
            to: spoke.previous,
            wedges,
            part,
            is_turned,
            beyond: spoke.next,
            beyond_wedge: spoke.next_wedge,
        }
    };
    corners_before_rims(mesh, rings, from).map(rim).collect()
}

/// A loop of border edges.
struct Hole {
    rim: Vec<HoleEdge>,
}

impl Hole {
    /// The shortest loop through a vertex; `None` if it has more than `EDGES_MAX` edges, or fewer than three.
    fn at(mesh: &ClusterMesh, rings: &Rings, start: LocalVertex) -> Option<Self> {
        let mut ways: Vec<Vec<HoleEdge>> = rims_from(mesh, rings, start).into_iter().map(|rim| vec![rim]).collect();
        for _ in 1..EDGES_MAX {
            let mut longer = Vec::new();
            for way in ways {
                let last = way.last()?.to;
                for rim in rims_from(mesh, rings, last) {
                    if way.iter().skip(1).any(|edge| edge.from == rim.to) {
                        continue;
                    }
                    let mut on = way.clone();
                    on.push(rim);
                    if rim.to == start {
                        return (on.len() > 2).then_some(Self { rim: on });
                    }
                    longer.push(on);
                }
            }
            ways = longer;
            ways.truncate(EDGES_MAX);
        }
        None
    }

    /// Triangles that close the hole, cheapest first, as indices of their corners in the rim. `None` if they cost more
    /// than `most`, fold, or would need an edge that exists already.
    fn ears(&self, mesh: &ClusterMesh, rings: &Rings, most: f64) -> Option<Vec<[usize; 3]>> {
        let place = |at: usize| mesh.positions[self.rim[at].from];
        let price = |ear: [usize; 3]| {
            let corners = ear.map(place);
            let longest_sq = (0..3).map(|k| corners[k].distance_squared(corners[(k + 1) % 3])).fold(0.0, f64::max);
            let area = area_of(corners);
            // Height² = (2 area)² / longest².
            MEAN_SQ * 4.0 * area * area * area / longest_sq.max(f64::MIN_POSITIVE)
        };
        let mut left: Vec<usize> = (0..self.rim.len()).collect();
        let (mut ears, mut cost) = (Vec::new(), 0.0);
        while left.len() > 2 {
            let n = left.len();
            let ear_at = |k: usize| [left[k], left[(k + 1) % n], left[(k + 2) % n]];
            let is_new = |[a, _, c]: [usize; 3]| {
                let [a, c] = [a, c].map(|at| self.rim[at].from);
                n == 3 || rings.faces(mesh, a).all(|face| !mesh.vertices(face).contains(&c))
            };
            let best = (0..if n == 3 { 1 } else { n }).filter(|&k| is_new(ear_at(k))).map(|k| (price(ear_at(k)), k));
            let (price, k) = best.min_by(|a, b| a.0.total_cmp(&b.0))?;
            cost += price;
            if cost > most || cost.is_nan() || self.folds(mesh, ear_at(k)) {
                return None;
            }
            ears.push(ear_at(k));
            left.remove((k + 1) % n);
        }
        Some(ears)
    }

    /// Whether a triangle lies back to back on a face beside the rim, as the back side of a single sheet would.
    fn folds(&self, mesh: &ClusterMesh, ear: [usize; 3]) -> bool {
        let vertex = |at: usize| self.rim[at].from;
        let normal = |corners: [LocalVertex; 3]| {
            let [a, b, c] = corners.map(|v| mesh.positions[v]);
            (b - a).cross(c - a).normalize_or_zero()
        };
        let own = normal(ear.map(vertex));
        (0..3).any(|k| {
            let edge = &self.rim[ear[k]];
            edge.to == vertex(ear[(k + 1) % 3]) && own.dot(normal([edge.to, edge.from, edge.beyond])) < FOLD_MIN
        })
    }

    /// Adds the triangles. Each shows the line of the texture along its longest side that has a face.
    fn shut(&self, mesh: &mut ClusterMesh, ears: &[[usize; 3]]) {
        let mut sides: Vec<HoleEdge> = self.rim.clone();
        for ear in ears {
            let vertices = ear.map(|at| self.rim[at].from);
            let length_sq = |side: &HoleEdge| mesh.positions[side.from].distance_squared(mesh.positions[side.to]);
            let side_at = |k: usize| {
                sides.iter().copied().find(|side| side.from == vertices[k] && side.to == vertices[(k + 1) % 3])
            };
            let longest = (0..3).filter_map(|k| side_at(k).map(|side| (k, side)));
            let Some((k, side)) = longest.max_by(|a, b| length_sq(&a.1).total_cmp(&length_sq(&b.1))) else { continue };
            let third = vertices[(k + 2) % 3];
            let own = sides.iter().find(|side| side.from == third).map(|side| side.wedges[0]);
            let own = own.or_else(|| sides.iter().find(|side| side.to == third).map(|side| side.wedges[1]));
            let Some(own) = own else { continue };
            let wedge = mesh.closing_wedge(side.wedges, side.beyond_wedge, own);
            let mut corners = [wedge; 3];
            (corners[k], corners[(k + 1) % 3]) = (side.wedges[0], side.wedges[1]);
            let face = mesh.push_face(corners, side.part);
            mesh.is_turned[face] = side.is_turned;
            for j in 0..3 {
                let [from, to, beyond] = [j, (j + 1) % 3, (j + 2) % 3];
                sides.push(HoleEdge {
                    from: vertices[to],
                    to: vertices[from],
                    wedges: [corners[to], corners[from]],
                    part: side.part,
                    is_turned: side.is_turned,
                    beyond: vertices[beyond],
                    beyond_wedge: corners[beyond],
                });
            }
        }
    }
}
