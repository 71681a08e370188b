//! Cuts a triangle at the planes of the tree.
//!
//! ```text
//!        ╱╲
//!       ╱  ╲            Where a plane meets an edge, both triangles at the edge get the same point: it is computed from
//!      ╱────╲ ─ plane   the ends of the part of the edge that is left, in an order that follows from the ends alone.
//!     ╱  │   ╲
//!    ╱───┼────╲         The cut along a plane is an edge of two polygons. A further plane that divides one of them gives
//!        plane          its point to the other one, too.
//! ```
//! In: corners, on the lattice of a level. Out: a polygon for each tile, whose corners neighbours share to the bit. The
//! exception is a triangle that goes, up to rounding, through a point in which planes of three axes meet: it may get two
//! corners there, which on the lattice are one or a step apart.

use std::cmp::Ordering;

use glam::{DVec2, DVec3};

use super::tree::{ROOT, TileId, TileNode, TileTree};
use crate::geometry::triangle::regularity;

/// What an edge of a polygon lies on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClipEdge {
    /// An edge of the triangle.
    Own,
    /// A cut of the triangle.
    Cut {
        /// Its number.
        number: u32,
        /// Axis that is normal to its plane.
        axis: u8,
    },
}

/// A corner of a polygon, and the edge that begins there.
#[derive(Debug, Clone, Copy)]
pub struct ClipCorner {
    /// Position relative to the origin of the scene.
    pub position: DVec3,
    /// Texture coordinate.
    pub texcoord: DVec2,
    /// The edge to the next corner.
    pub edge: ClipEdge,
}

/// The part of a triangle in a node: a convex polygon.
pub type Polygon = Vec<ClipCorner>;

/// Receives the parts of a triangle.
pub trait TakeParts {
    /// The part of the triangle in a node; returns whether its children are wanted, too.
    fn part(&mut self, node: TileId, polygon: &[ClipCorner]) -> bool;
}

/// Cuts triangles.
#[derive(Debug)]
pub struct Clipper<'a> {
    tree: &'a TileTree,
    /// Of each cut of the current triangle, the points that divide it.
    cuts: Vec<Vec<(DVec3, DVec2)>>,
    /// Polygons that are not needed any more: their memory is.
    spare: Vec<Polygon>,
}

impl<'a> Clipper<'a> {
    /// Cuts at the planes of a tree.
    pub fn new(tree: &'a TileTree) -> Self {
        Self { tree, cuts: Vec::new(), spare: Vec::new() }
    }

    /// Passes the parts of a triangle in all nodes to `take`, from the root downwards.
    pub fn cut(&mut self, corners: [(DVec3, DVec2); 3], take: &mut impl TakeParts) {
        self.cuts.clear();
        let own = |(position, texcoord)| ClipCorner { position, texcoord, edge: ClipEdge::Own };
        let mut polygon = self.empty();
        polygon.extend(corners.map(own));
        self.descend(ROOT, polygon, take);
    }

    fn empty(&mut self) -> Polygon {
        let mut polygon = self.spare.pop().unwrap_or_default();
        polygon.clear();
        polygon
    }

    fn descend(&mut self, mut node: TileId, mut polygon: Polygon, take: &mut impl TakeParts) {
        while take.part(node, &polygon) {
            let TileNode::Split { axis, plane, below } = self.tree.nodes[node] else { break };
            let axis = usize::from(axis);
            let coordinates = || polygon.iter().map(|corner| corner.position[axis]);
            if coordinates().all(|at| at <= plane) {
                node = below;
            } else if coordinates().all(|at| at >= plane) {
                node = below.plus(1);
            } else {
                let [lower, upper] = self.divide(&polygon, axis, plane);
                self.descend(below, lower, take);
                node = below.plus(1);
                self.spare.push(std::mem::replace(&mut polygon, upper));
            }
        }
        self.spare.push(polygon);
    }

    /// Divides a polygon that lies on both sides of a plane.
    fn divide(&mut self, polygon: &[ClipCorner], axis: usize, plane: f64) -> [Polygon; 2] {
        let cut = ClipEdge::Cut { number: self.cuts.len() as u32, axis: axis as u8 };
        self.cuts.push(Vec::new());
        let mut parts = [self.empty(), self.empty()];
        for (at, corner) in polygon.iter().enumerate() {
            let next = &polygon[(at + 1) % polygon.len()];
            let side = corner.position[axis].total_cmp(&plane);
            let next_side = next.position[axis].total_cmp(&plane);
            match side {
                Ordering::Less => parts[0].push(*corner),
                Ordering::Greater => parts[1].push(*corner),
                Ordering::Equal => {
                    // The cut begins here for the part that the edge leaves.
                    let edge = |goes_on: bool| if goes_on { corner.edge } else { cut };
                    parts[0].push(ClipCorner { edge: edge(next_side != Ordering::Greater), ..*corner });
                    parts[1].push(ClipCorner { edge: edge(next_side != Ordering::Less), ..*corner });
                }
            }
            if side.reverse() == next_side && side != Ordering::Equal {
                let (position, texcoord) = meeting(corner, next, axis, plane);
                if let ClipEdge::Cut { number: other, .. } = corner.edge {
                    self.cuts[other as usize].push((position, texcoord));
                }
                let (left, entered) = if side == Ordering::Less { (0, 1) } else { (1, 0) };
                parts[left].push(ClipCorner { position, texcoord, edge: cut });
                parts[entered].push(ClipCorner { position, texcoord, edge: corner.edge });
            }
        }
        parts
    }

    /// The corners of a part with the points that others gave to its cuts; only once all parts are cut.
    pub fn completed(&self, polygon: &[ClipCorner]) -> Polygon {
        let mut whole = Polygon::with_capacity(polygon.len());
        for (at, corner) in polygon.iter().enumerate() {
            whole.push(*corner);
            let ClipEdge::Cut { number: cut, .. } = corner.edge else { continue };
            let (start, end) = (corner.position, polygon[(at + 1) % polygon.len()].position);
            let along = (end - start).normalize_or_zero();
            let place = |point: DVec3| (point - start).dot(along);
            let inside = |(point, _): &(DVec3, DVec2)| {
                *point != start && *point != end && (0.0..=place(end)).contains(&place(*point))
            };
            let mut points: Vec<(DVec3, DVec2)> = self.cuts[cut as usize].iter().copied().filter(inside).collect();
            points.sort_by(|a, b| place(a.0).total_cmp(&place(b.0)));
            points.dedup_by_key(|point| point.0);
            let divided = |(position, texcoord)| ClipCorner { position, texcoord, edge: corner.edge };
            whole.extend(points.into_iter().map(divided));
        }
        whole
    }
}

/// Where an edge meets a plane: the same for both directions of the edge.
fn meeting(a: &ClipCorner, b: &ClipCorner, axis: usize, plane: f64) -> (DVec3, DVec2) {
    let order =
        |a: DVec3, b: DVec3| a.x.total_cmp(&b.x).then_with(|| a.y.total_cmp(&b.y)).then_with(|| a.z.total_cmp(&b.z));
    let (a, b) = if order(a.position, b.position) == Ordering::Greater { (b, a) } else { (a, b) };
    let share = (plane - a.position[axis]) / (b.position[axis] - a.position[axis]);
    let mut point = a.position + (b.position - a.position) * share;
    point[axis] = plane;
    (point, a.texcoord + (b.texcoord - a.texcoord) * share)
}

/// Divides a convex polygon, which may have corners on straight sides, into triangles by the indices of its corners: each
/// time the roundest triangle that leaves no flat rest.
pub fn triangulate(corners: &[DVec3]) -> Vec<[usize; 3]> {
    let mut left: Vec<usize> = (0..corners.len()).collect();
    let mut triangles = Vec::with_capacity(corners.len().saturating_sub(2));
    while left.len() > 3 {
        let count = left.len();
        let ear = |at: usize| [left[(at + count - 1) % count], left[at], left[(at + 1) % count]];
        let shape = |at: usize| {
            let rest: Vec<DVec3> = (1..count).map(|step| corners[left[(at + step) % count]]).collect();
            let own = regularity(ear(at).map(|corner| corners[corner]));
            let is_flat = rest.windows(2).skip(1).all(|side| regularity([rest[0], side[0], side[1]]) <= FLAT);
            if is_flat { -1.0 } else { own }
        };
        let best = (0..count).fold((0, f64::NEG_INFINITY), |best, at| {
            let shape = shape(at);
            if shape > best.1 { (at, shape) } else { best }
        });
        triangles.push(ear(best.0));
        left.remove(best.0);
    }
    if let [a, b, c] = left[..] {
        triangles.push([a, b, c]);
    }
    triangles
}

/// Regularity up to which a triangle counts as flat.
const FLAT: f64 = 1e-9;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::triangle::area;
    use proptest::prelude::*;

    /// Parts in the leaves of a tree.
    struct Leaves<'a> {
        tree: &'a TileTree,
        parts: Vec<(TileId, Polygon)>,
    }

    impl TakeParts for Leaves<'_> {
        fn part(&mut self, node: TileId, polygon: &[ClipCorner]) -> bool {
            if self.tree.children(node).is_none() {
                self.parts.push((node, polygon.to_vec()));
            }
            true
        }
    }

    /// A plane on each axis, and further ones on both sides of the first.
    fn tree() -> TileTree {
        let split = |axis, plane, below| TileNode::Split { axis, plane, below: TileId::new(below) };
        let nodes = vec![
            split(0, 0.5, 1),
            split(1, 0.5, 3),
            split(1, -0.5, 5),
            split(2, 1.5, 7),
            TileNode::Leaf,
            TileNode::Leaf,
            split(0, 2.5, 9),
            TileNode::Leaf,
            TileNode::Leaf,
            TileNode::Leaf,
            TileNode::Leaf,
        ];
        TileTree { nodes: nodes.into() }
    }

    fn parts_of(corners: [DVec3; 3]) -> Vec<(TileId, Polygon)> {
        let tree = tree();
        let mut clipper = Clipper::new(&tree);
        let mut leaves = Leaves { tree: &tree, parts: Vec::new() };
        clipper.cut(corners.map(|corner| (corner, corner.truncate())), &mut leaves);
        leaves.parts.iter().map(|(node, polygon)| (*node, clipper.completed(polygon))).collect()
    }

    fn corner() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-6i32..=6).prop_map(|at| DVec3::from(at.map(f64::from)))
    }

    proptest! {
        #[test]
        fn parts_fill_the_triangle_and_share_the_corners_of_their_cuts(corners in prop::array::uniform3(corner())) {
            prop_assume!(area(corners) > 0.0);
            let parts = parts_of(corners);
            let triangles = |polygon: &Polygon| {
                let positions: Vec<DVec3> = polygon.iter().map(|corner| corner.position).collect();
                triangulate(&positions).into_iter().map(|ids| area(ids.map(|id| positions[id]))).collect::<Vec<f64>>()
            };
            let sum: f64 = parts.iter().flat_map(|(_, polygon)| triangles(polygon)).sum();
            prop_assert!((sum / area(corners) - 1.0).abs() < 1e-9);
            let positions: Vec<DVec3> = parts.iter().flat_map(|(_, polygon)| polygon).map(|c| c.position).collect();
            let are_twins = |a: DVec3, b: DVec3| a != b && a.distance(b) < 1e-12;
            prop_assume!(!positions.iter().any(|&a| positions.iter().any(|&b| are_twins(a, b))));
            // Each edge along a cut is one of the polygon on the other side, turned around.
            let bits = |at: DVec3| at.to_array().map(f64::to_bits);
            let edges = |kind: fn(ClipEdge) -> bool| -> Vec<_> {
                let of_part = |polygon: &Polygon| -> Vec<_> {
                    let next = |at: usize| polygon[(at + 1) % polygon.len()].position;
                    let all = polygon.iter().enumerate().filter(|(_, corner)| kind(corner.edge));
                    all.map(|(at, corner)| [bits(corner.position), bits(next(at))]).collect()
                };
                parts.iter().flat_map(|(_, polygon)| of_part(polygon)).collect()
            };
            let cuts = edges(|kind| kind != ClipEdge::Own);
            for [start, end] in &cuts {
                prop_assert!(cuts.contains(&[*end, *start]), "{:?}", parts);
            }
        }

        #[test]
        fn both_triangles_at_an_edge_get_the_same_corners_there(corners in prop::array::uniform4(corner())) {
            let [a, b, c, d] = corners;
            prop_assume!(area([a, b, c]) > 0.0 && area([b, a, d]) > 0.0);
            let on_edge = |corners: [DVec3; 3]| {
                let mut points: Vec<[u64; 3]> = Vec::new();
                for (_, polygon) in parts_of(corners) {
                    let own = |at: usize| polygon[at].edge == ClipEdge::Own;
                    for at in 0..polygon.len() {
                        let ends = [polygon[at].position, polygon[(at + 1) % polygon.len()].position];
                        let is_near = |point: DVec3| (point - a).cross(b - a).length() < 1e-9 * (b - a).length();
                        if own(at) && ends.into_iter().all(is_near) {
                            points.extend(ends.map(|point| point.to_array().map(f64::to_bits)));
                        }
                    }
                }
                points.sort_unstable();
                points.dedup();
                points
            };
            prop_assert_eq!(on_edge([a, b, c]), on_edge([b, a, d]));
        }
    }

    #[test]
    fn corners_on_straight_sides_make_no_flat_triangle() {
        let corners = [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (2.0, 2.0), (0.0, 2.0)];
        let corners = corners.map(|(x, y)| DVec3::new(x, y, 0.0));
        let triangles = triangulate(&corners);
        assert_eq!(triangles.len(), 4);
        assert!(triangles.iter().all(|ids| area(ids.map(|id| corners[id])) > 0.0), "{triangles:?}");
    }
}
