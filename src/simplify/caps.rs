//! Closes small holes: short loops of border edges get new faces where that costs no more than a collapse.
//!
//! ```text
//!    a-------------b            a-------------b
//!     \   hole    /      ──▶     \`-.  cap   /     the rest of a rip whose two sides have different vertices
//!      c---d-----e                c---d-----e
//! ```
//! A cap has no counterpart in the input. Its cost is the distance of its points from the rim: area × squared height.

use super::rips::FACES_MAX;
use crate::geometry::triangle::{area, is_line};
use crate::mesh::class::{Class, Classes};
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::{Corner, LocalVertex, Wedge};
use crate::mesh::ring::{Rings, Spoke};
use crate::model::id::PartId;

/// Largest number of edges of a hole.
const EDGES_MAX: usize = 8;
/// Lowest cosine of the angle between the normals of a cap's triangle and of a face beside it: at least 37° between
/// their back sides, far more than the angle at which faces count as folded.
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
    let rims = Rims::of(mesh, rings, classes);
    let mut is_used = mesh.per_vertex(false);
    let mut shut = Shut::default();
    for start in classes.keys() {
        if is_used[start] || !rims.may_return(mesh, classes, start) {
            continue;
        }
        let Some(hole) = Hole::at(mesh, &rims, start) else { continue };
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

/// The border edges along which a walk around a hole continues from each vertex. Each is named by the corner of its
/// face at the vertex; the edge leads to the corner before it.
struct Rims {
    /// Where the edges of each vertex begin, and after the last vertex, where they end.
    starts: Vec<u32>,
    corners: Vec<Corner>,
}

impl Rims {
    fn of(mesh: &ClusterMesh, rings: &Rings, classes: &Classes) -> Self {
        let mut rims = Self { starts: Vec::with_capacity(classes.len() + 1), corners: Vec::new() };
        rims.starts.push(0);
        for vertex in classes.keys() {
            let class = classes[vertex];
            if class.may_border() || class == Class::Fixed {
                rims.add(mesh, rings.of(vertex));
            }
            rims.starts.push(rims.corners.len() as u32);
        }
        rims
    }

    /// Adds the corners at a vertex whose face is the only one with the edge to the previous corner.
    fn add(&mut self, mesh: &ClusterMesh, corners: &[Corner]) {
        if corners.len() > FACES_MAX {
            return;
        }
        let (mut spokes, mut count) = ([(Corner::NONE, [LocalVertex::NONE; 2]); FACES_MAX], 0);
        for &corner in corners.iter().filter(|&&corner| mesh.living(corner).is_some()) {
            spokes[count] = (corner, mesh.others_of(corner));
            count += 1;
        }
        let spokes = &spokes[..count];
        for &(corner, [_, before]) in spokes {
            if spokes.iter().all(|&(other, ends)| other == corner || !ends.contains(&before)) {
                self.corners.push(corner);
            }
        }
    }

    /// The edges that continue from a vertex.
    fn from(&self, vertex: LocalVertex) -> &[Corner] {
        &self.corners[self.starts[vertex.index()] as usize..self.starts[vertex.index() + 1] as usize]
    }

    /// Whether a walk along at most `EDGES_MAX` border edges may lead from a vertex back to it.
    fn may_return(&self, mesh: &ClusterMesh, classes: &Classes, start: LocalVertex) -> bool {
        let mut at = start;
        for _ in 0..EDGES_MAX {
            at = match self.from(at) {
                _ if !classes[at].may_border() => return false,
                [] => return false,
                &[corner] => mesh.vertex_of(corner.previous()),
                _ => return true,
            };
            if at == start {
                return true;
            }
        }
        false
    }
}

impl HoleEdge {
    /// The border edge from a corner to the one before it.
    fn before(mesh: &ClusterMesh, corner: Corner) -> Self {
        let spoke = Spoke::of(mesh, corner);
        Self {
            from: mesh.vertex_of(corner),
            to: spoke.previous,
            wedges: [spoke.wedge, spoke.previous_wedge],
            part: mesh.parts[corner.face()],
            is_turned: mesh.is_turned[corner.face()],
            beyond: spoke.next,
            beyond_wedge: spoke.next_wedge,
        }
    }
}

/// A walk along border edges.
#[derive(Debug, Clone, Copy)]
struct RimWalk {
    corners: [Corner; EDGES_MAX],
    count: usize,
}

impl RimWalk {
    /// The walk of one edge.
    fn along(corner: Corner) -> Self {
        Self { corners: [corner; EDGES_MAX], count: 1 }
    }

    fn corners(&self) -> &[Corner] {
        &self.corners[..self.count]
    }

    /// The walk with one more edge.
    fn and_along(mut self, corner: Corner) -> Self {
        self.corners[self.count] = corner;
        self.count += 1;
        self
    }
}

/// A loop of border edges.
struct Hole {
    rim: Vec<HoleEdge>,
}

impl Hole {
    /// The shortest loop through a vertex; `None` if it has more than `EDGES_MAX` edges, or fewer than three.
    fn at(mesh: &ClusterMesh, rims: &Rims, start: LocalVertex) -> Option<Self> {
        let end_of = |corner: Corner| mesh.vertex_of(corner.previous());
        let mut walks: Vec<RimWalk> = rims.from(start).iter().map(|&corner| RimWalk::along(corner)).collect();
        let mut longer = Vec::new();
        for _ in 1..EDGES_MAX {
            for walk in walks.drain(..) {
                let last = end_of(*walk.corners().last()?);
                for &corner in rims.from(last) {
                    let to = end_of(corner);
                    if walk.corners().iter().skip(1).any(|&edge| mesh.vertex_of(edge) == to) {
                        continue;
                    }
                    let on = walk.and_along(corner);
                    if to == start {
                        let edges = on.corners().iter().map(|&corner| HoleEdge::before(mesh, corner));
                        return (on.count > 2).then(|| Self { rim: edges.collect() });
                    }
                    longer.push(on);
                }
            }
            std::mem::swap(&mut walks, &mut longer);
            walks.truncate(EDGES_MAX);
        }
        None
    }

    /// Triangles that close the hole, cheapest first, as indices of their corners in the rim. `None` if they cost more
    /// than `most`, have no area, fold, or would need an edge that exists already.
    fn ears(&self, mesh: &ClusterMesh, rings: &Rings, most: f64) -> Option<Vec<[usize; 3]>> {
        let place = |at: usize| mesh.positions[self.rim[at].from];
        let price = |ear: [usize; 3]| {
            let corners = ear.map(place);
            let longest_sq = (0..3).map(|k| corners[k].distance_squared(corners[(k + 1) % 3])).fold(0.0, f64::max);
            let area = area(corners);
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
            if cost > most || cost.is_nan() || self.is_flat_or_folds(mesh, ear_at(k), &ears) {
                return None;
            }
            ears.push(ear_at(k));
            left.remove((k + 1) % n);
        }
        Some(ears)
    }

    /// Whether a triangle has no area, or lies back to back on a face beside the rim, as the back side of a single sheet
    /// would, or on one of the triangles before it.
    fn is_flat_or_folds(&self, mesh: &ClusterMesh, ear: [usize; 3], before: &[[usize; 3]]) -> bool {
        let vertex = |at: usize| self.rim[at].from;
        let normal = |corners: [LocalVertex; 3]| {
            let [a, b, c] = corners.map(|v| mesh.positions[v]);
            (b - a).cross(c - a).normalize_or_zero()
        };
        let own = normal(ear.map(vertex));
        let folds_onto = |corners: [LocalVertex; 3]| own.dot(normal(corners)) < FOLD_MIN;
        let folds_at = |k: usize| {
            let [from, to] = [ear[k], ear[(k + 1) % 3]];
            let edge = &self.rim[from];
            let is_beside = edge.to == vertex(to) && folds_onto([edge.to, edge.from, edge.beyond]);
            // An ear is cut off along the line between its first and its third corner.
            is_beside || before.iter().any(|&[a, b, c]| [a, c] == [from, to] && folds_onto([a, b, c].map(vertex)))
        };
        is_line(ear.map(|at| mesh.positions[vertex(at)])) || (0..3).any(folds_at)
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

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use glam::{DVec2, DVec3};
    use proptest::prelude::*;

    use super::*;
    use crate::base::id::TiVec;
    use crate::geometry::triangle::has_no_area;
    use crate::mesh::class::classify;
    use crate::mesh::cluster::samples;
    use crate::mesh::fold::are_folded;

    /// Faces around a hole with these corners; seen from above, the hole is on the left of its rim. The outer border has
    /// three times as many edges.
    fn around(rim: &[DVec3]) -> ClusterMesh {
        let n = rim.len() as u32;
        let outer = circle(3 * rim.len()).map(|at| (3.0 * at).extend(0.0));
        let vertices = rim.iter().copied().chain(outer).map(|position| (position, DVec2::ZERO));
        let of_corner = |k: u32| {
            let [a, b, c, d] = [0, 1, 2, 3].map(|i| n + (3 * k + i) % (3 * n));
            let next = (k + 1) % n;
            [[k, a, b], [k, b, c], [k, c, next], [next, c, d]]
        };
        samples::mesh_of(vertices, &(0..n).flat_map(of_corner).collect::<Vec<_>>())
    }

    fn shut_all(mesh: &mut ClusterMesh, most: f64) -> u64 {
        let (mut rings, mut classes) = (Rings::default(), TiVec::new());
        rings.build(mesh);
        classify(mesh, &rings, &mut classes);
        shut(mesh, &rings, &classes, most, usize::MAX).count
    }

    /// The third vertices of the faces at each edge, and the number of faces that run up along it.
    fn edges(mesh: &ClusterMesh) -> BTreeMap<[LocalVertex; 2], (Vec<LocalVertex>, usize)> {
        let mut edges = BTreeMap::<_, (Vec<_>, usize)>::new();
        for face in mesh.face_ids() {
            let corners = mesh.vertices(face);
            for k in 0..3 {
                let [from, to, third] = [k, (k + 1) % 3, (k + 2) % 3].map(|k| corners[k]);
                let edge = edges.entry([from.min(to), from.max(to)]).or_default();
                edge.0.push(third);
                edge.1 += usize::from(from < to);
            }
        }
        edges
    }

    /// Number of open edges; panics if two faces fold onto each other or run along an edge in the same direction.
    fn open_edges(mesh: &ClusterMesh) -> usize {
        let place = |v: LocalVertex| mesh.positions[v];
        let mut open = 0;
        for (edge, (thirds, up)) in edges(mesh) {
            match thirds[..] {
                [_] => open += 1,
                [one, other] => {
                    assert_eq!(up, 1, "{edge:?}");
                    assert!(!are_folded(edge.map(place), [one, other].map(place)), "{edge:?} of {one:?} and {other:?}");
                }
                _ => panic!("{edge:?} has {} faces", thirds.len()),
            }
        }
        open
    }

    fn circle(count: usize) -> impl Iterator<Item = DVec2> {
        (0..count).map(move |k| DVec2::from_angle(k as f64 * std::f64::consts::TAU / count as f64))
    }

    #[test]
    fn a_flat_hole_closes_if_it_is_small() {
        for corners in 3..=EDGES_MAX + 1 {
            let rim: Vec<DVec3> = circle(corners).map(|at| at.extend(0.0)).collect();
            let mut mesh = around(&rim);
            let is_small = corners <= EDGES_MAX;
            assert_eq!(shut_all(&mut mesh, 1.0), u64::from(is_small));
            assert_eq!(open_edges(&mesh), if is_small { 3 * corners } else { 4 * corners });
            assert_eq!(mesh.face_count, 4 * corners + if is_small { corners - 2 } else { 0 });
        }
    }

    proptest! {
        #[test]
        fn no_cap_is_flat_or_folds_onto_its_neighbours_or_itself(
            rim in prop::collection::vec((0.3f64..1.0, -1.0f64..1.0), 3..=EDGES_MAX),
        ) {
            let corners: Vec<DVec3> =
                circle(rim.len()).zip(&rim).map(|(at, &(out, up)): (DVec2, &(f64, f64))| (at * out).extend(up)).collect();
            let mut mesh = around(&corners);
            let before = mesh.corners.len();
            let count = shut_all(&mut mesh, 1e3) as usize;
            prop_assert_eq!(open_edges(&mesh), (4 - count) * rim.len());
            prop_assert_eq!(mesh.corners.len(), before + count * (rim.len() - 2));
            for face in mesh.face_ids().skip(before) {
                prop_assert!(!has_no_area(mesh.triangle(face), 1.0));
            }
        }
    }

    #[test]
    fn a_line_of_no_area_stays_open() {
        // The second corner of the rim lies on the line between its neighbours.
        let rim = [[-1.0, -1.0], [0.0, -1.0], [1.0, -1.0]].map(|[x, y]| DVec3::new(x, y, 0.0));
        let vertices = rim.into_iter().chain([DVec3::new(0.0, 1.0, 0.0), DVec3::new(0.0, -3.0, 0.0)]);
        let mut mesh =
            samples::mesh_of(vertices.map(|position| (position, DVec2::ZERO)), &[[0, 2, 3], [0, 4, 1], [1, 4, 2]]);
        assert_eq!(shut_all(&mut mesh, 1.0), 0);
        assert_eq!(mesh.corners.len(), 3);
    }
}
