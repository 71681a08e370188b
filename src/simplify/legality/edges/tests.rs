//! The rules of `edges`, restated over lists of faces, on small meshes of all kinds.

use std::collections::BTreeSet;

use glam::{DVec2, DVec3};
use proptest::prelude::*;

use super::*;
use crate::base::id::TiVec;
use crate::mesh::WedgePair;
use crate::mesh::fold::are_nearly_folded;
use crate::mesh::id::short::{v, w};
use crate::model::id::PartId;

/// Number of vertices of a mesh. Vertex v has the wedges v and v + `VERTICES`.
const VERTICES: u32 = 7;
/// The vanishing vertex.
const FROM: LocalVertex = v(0);
/// The staying vertex.
const TO: LocalVertex = v(1);

#[derive(Debug, Clone)]
struct Case {
    positions: TiVec<LocalVertex, DVec3>,
    uvs: TiVec<Wedge, DVec2>,
    /// Wedges of each face.
    faces: Vec<[Wedge; 3]>,
    are_turned: Vec<bool>,
    fan: VanishingFan,
    shape_rule: ShapeRule,
}

/// The vertex of a wedge.
fn vertex_of(wedge: Wedge) -> LocalVertex {
    v(wedge.number() % VERTICES)
}

impl Case {
    fn mesh(&self) -> (ClusterMesh, Rings) {
        let (mut mesh, mut rings) = (ClusterMesh::default(), Rings::default());
        for &position in &self.positions {
            mesh.push_vertex(position, 0);
        }
        for (wedge, &uv) in self.uvs.iter_enumerated() {
            mesh.push_wedge(vertex_of(wedge), uv);
        }
        for &face in &self.faces {
            mesh.push_face(face, PartId::new(0));
        }
        mesh.is_turned = self.are_turned.clone().into();
        mesh.link_wedges();
        rings.build(&mesh);
        (mesh, rings)
    }

    fn vertices(&self, face: usize) -> [LocalVertex; 3] {
        self.faces[face].map(vertex_of)
    }

    /// Indices of the faces that have all of these vertices.
    fn faces_with(&self, vertices: &[LocalVertex]) -> BTreeSet<usize> {
        (0..self.faces.len()).filter(|&face| vertices.iter().all(|v| self.vertices(face).contains(v))).collect()
    }

    /// Whether the second vertex follows the first in a face; the vanishing vertex counts as the staying one.
    fn leads_on(&self, face: usize, [first, second]: [LocalVertex; 2]) -> bool {
        let vertices = self.vertices(face).map(|vertex| if vertex == FROM { TO } else { vertex });
        (0..3).any(|k| vertices[k] == first && vertices[(k + 1) % 3] == second)
    }

    /// Texture coordinate of a face at a vertex after the pairs of wedges have merged.
    fn uv(&self, face: usize, vertex: LocalVertex, pairs: &[WedgePair]) -> DVec2 {
        let is_at = |wedge: &Wedge| vertex_of(*wedge) == vertex || (vertex == TO && vertex_of(*wedge) == FROM);
        let wedge = self.faces[face].into_iter().find(is_at).unwrap();
        self.uvs[pairs.iter().find(|pair| pair.from == wedge).map_or(wedge, |pair| pair.to)]
    }

    fn are_mirrored(&self, [one, other]: [usize; 2], edge: [LocalVertex; 2], pairs: &[WedgePair]) -> bool {
        let uv_area = |face: usize| doubled_uv_area(self.faces[face].map(|wedge| self.uvs[wedge]));
        self.leads_on(one, edge) == self.leads_on(other, [edge[1], edge[0]])
            && self.are_turned[one] == self.are_turned[other]
            && edge.iter().all(|&end| self.uv(one, end, pairs) == self.uv(other, end, pairs))
            && uv_area(one) * uv_area(other) < 0.0
    }
}

/// Outcome of a collapse.
#[derive(Debug, PartialEq)]
struct Outcome {
    dying: BTreeSet<usize>,
    stranded: Vec<Wedge>,
    joins: bool,
    /// Ascending.
    opposite: Vec<LocalVertex>,
    new_non_manifold_edges: i64,
    unsettled: BTreeSet<LocalVertex>,
}

fn outcome(star: &EdgeStar) -> Outcome {
    let mut opposite = star.opposite.clone();
    opposite.sort_unstable();
    Outcome {
        dying: star.dying.iter().map(|face| face.index()).collect(),
        stranded: star.stranded.clone(),
        joins: star.joins,
        opposite,
        new_non_manifold_edges: star.new_non_manifold_edges,
        unsettled: star.unsettled.iter().copied().collect(),
    }
}

/// A neighbour of the edge, with its faces at each end before, and its faces left afterwards.
struct Beside {
    vertex: LocalVertex,
    before: [usize; 2],
    left: Vec<usize>,
}

/// The verdict of the rules for given wedge pairs.
fn expected(case: &Case, pairs: &[WedgePair]) -> Result<Outcome, Refusal> {
    let fan = case.fan;
    let at_edge = case.faces_with(&[FROM, TO]);
    if at_edge.is_empty() != fan.is_rip || case.faces_with(&[TO]).is_empty() {
        return Err(Refusal::Topology);
    }
    let mut opposite: Vec<LocalVertex> = at_edge.iter().flat_map(|&face| case.vertices(face)).collect();
    opposite.retain(|vertex| ![FROM, TO].contains(vertex));
    let (mut dying, mut far_sides, mut last_double) = (at_edge.clone(), Vec::new(), None);
    for face in case.faces_with(&[FROM]) {
        let far: Vec<LocalVertex> = case.vertices(face).into_iter().filter(|&vertex| vertex != FROM).collect();
        let double = case.faces_with(&[TO, far[0], far[1]]).into_iter().find(|double| !dying.contains(double));
        if let Some(double) = double.filter(|_| !dying.contains(&face)) {
            let edge = [far[0], far[1]];
            far_sides.push(edge);
            dying.insert(face);
            if case.leads_on(face, edge) != case.leads_on(double, edge) {
                dying.insert(double);
                last_double = Some(double);
            }
        }
    }
    let at_ends = || (0..case.faces.len()).filter(|&f| case.vertices(f).iter().any(|v| [FROM, TO].contains(v)));
    let left: Vec<usize> = at_ends().filter(|face| !dying.contains(face)).collect();
    let around: BTreeSet<LocalVertex> = at_ends().flat_map(|face| case.vertices(face)).filter(|&v| v > TO).collect();
    let beside: Vec<Beside> = around
        .into_iter()
        .map(|vertex| Beside {
            vertex,
            before: [FROM, TO].map(|end| case.faces_with(&[end, vertex]).len()),
            left: left.iter().copied().filter(|&face| case.vertices(face).contains(&vertex)).collect(),
        })
        .collect();
    let is_left_at = |edge: &[LocalVertex; 2]| case.faces_with(edge).difference(&dying).next().is_some();
    let stays = !left.is_empty() || far_sides.iter().any(is_left_at);
    match last_double.filter(|_| !stays) {
        Some(double) => {
            dying.remove(&double);
        }
        None if !beside.iter().all(|beside| is_allowed(case, beside)) => return Err(Refusal::Topology),
        None if !stays && !fan.is_alone => return Err(Refusal::Piece),
        None => far_sides.iter().try_for_each(|&edge| check_far_side(case, edge, &dying, pairs))?,
    }
    let mut stranded = Vec::new();
    for &face in case.faces_with(&[FROM]).difference(&dying) {
        let wedge = case.faces[face].into_iter().find(|&wedge| vertex_of(wedge) == FROM).unwrap();
        match pairs.iter().filter(|pair| pair.from == wedge).count() {
            1 => {}
            0 if fan.strands || fan.is_rip => stranded.push(wedge),
            _ => return Err(Refusal::Seam),
        }
    }
    stranded = stranded
        .iter()
        .enumerate()
        .filter(|(i, wedge)| !stranded[..*i].contains(wedge))
        .map(|(_, &wedge)| wedge)
        .collect();
    let mut joins = false;
    for Beside { vertex, before: [at_from, at_to], left } in &beside {
        let becomes_plain = left.len() == 2 && (*at_from > 2 || *at_to > 2);
        let becomes_one = !opposite.contains(vertex) && *at_from > 0 && *at_to > 0;
        if becomes_plain || becomes_one {
            joins = true;
            opposite.extend((!opposite.contains(vertex)).then_some(*vertex));
        }
    }
    opposite.sort_unstable();
    let is_mirrored = |beside: &Beside| match beside.left[..] {
        [one, other] => case.are_mirrored([one, other], [beside.vertex, TO], pairs),
        _ => false,
    };
    if joins && beside.iter().any(is_mirrored) {
        return Err(Refusal::UvFold);
    }
    let complex = |count: usize| i64::from(count > 2);
    let before = |beside: &Beside| beside.before.into_iter().map(complex).sum::<i64>();
    let more: i64 = beside.iter().map(|beside| complex(beside.left.len()) - before(beside)).sum();
    let new_non_manifold_edges = more - complex(at_edge.len());
    if new_non_manifold_edges > fan.spare_edges.max(0) {
        return Err(Refusal::Topology);
    }
    let unsettled = beside.iter().map(|beside| beside.vertex).chain([TO]).collect();
    Ok(Outcome { dying, stranded, joins, opposite, new_non_manifold_edges, unsettled })
}

fn is_allowed(case: &Case, Beside { vertex, before: [at_from, at_to], left }: &Beside) -> bool {
    let becomes_border = left.len() == 1 && *at_from != 1 && *at_to != 1;
    let is_full = left.len() > 2 && left.len() > *at_from && left.len() > *at_to;
    let may_be_full = case.fan.spare_edges > 0 && left.len() <= 8;
    let fits = match left[..] {
        [one, other] if *at_from > 0 && *at_to > 0 && case.shape_rule != ShapeRule::MayTurn => {
            case.leads_on(one, [TO, *vertex]) != case.leads_on(other, [TO, *vertex])
                && case.are_turned[one] == case.are_turned[other]
        }
        _ => true,
    };
    !becomes_border && (!is_full || may_be_full) && fits
}

fn check_far_side(
    case: &Case,
    edge: [LocalVertex; 2],
    dying: &BTreeSet<usize>,
    pairs: &[WedgePair],
) -> Result<(), Refusal> {
    let left: Vec<usize> = case.faces_with(&edge).difference(dying).copied().collect();
    let third = |face: usize| case.vertices(face).into_iter().find(|vertex| !edge.contains(vertex)).unwrap();
    let place = |vertex: LocalVertex| case.positions[vertex];
    match left[..] {
        [_] => Err(Refusal::Topology),
        [one, other]
            if case.shape_rule == ShapeRule::Strict
                && are_nearly_folded(edge.map(place), [one, other].map(|face| place(third(face)))) =>
        {
            Err(Refusal::Fold)
        }
        [one, other] if case.are_mirrored([one, other], edge, pairs) => Err(Refusal::UvFold),
        _ => Ok(()),
    }
}

/// Texture coordinates from a small set, so that wedges often have equal ones.
fn uv() -> impl Strategy<Value = DVec2> {
    prop_oneof![
        8 => prop::array::uniform2(0..3i32).prop_map(|[x, y]| DVec2::new(x.into(), y.into())),
        1 => Just(DVec2::NAN),
    ]
}

/// A face at both ends, at one of them, or anywhere; most have the first wedges of their vertices.
fn face() -> impl Strategy<Value = [Wedge; 3]> {
    let vertices = prop_oneof![
        2 => Just(vec![FROM.number(), TO.number()]),
        4 => Just(vec![FROM.number()]),
        4 => Just(vec![TO.number()]),
        1 => Just(vec![]),
    ];
    (vertices, Just((2..VERTICES).collect::<Vec<u32>>()).prop_shuffle(), any::<bool>(), any::<[u8; 3]>()).prop_map(
        |(ends, others, is_reversed, seconds)| {
            let mut face: Vec<u32> = ends.into_iter().chain(others).take(3).collect();
            if is_reversed {
                face.reverse();
            }
            let wedge = |k: usize| w(face[k] + if seconds[k] < 32 { VERTICES } else { 0 });
            [0, 1, 2].map(wedge)
        },
    )
}

fn case() -> impl Strategy<Value = Case> {
    let fan = (any::<[bool; 3]>(), -1..3i64).prop_map(|([strands, is_alone, is_rip], spare_edges)| VanishingFan {
        strands,
        is_alone,
        is_rip,
        spare_edges,
        ..VanishingFan::default()
    });
    let position = prop_oneof![
        3 => prop::array::uniform2(0..9i32).prop_map(|[x, y]| DVec3::new(x.into(), y.into(), 0.0)),
        1 => prop::array::uniform3(0..9i32).prop_map(|place| DVec3::from(place.map(f64::from))),
    ];
    let count = VERTICES as usize;
    (
        prop::collection::vec(position, count),
        prop::collection::vec(uv(), 2 * count),
        prop::collection::vec((face(), prop::bool::weighted(0.1)), 1..18),
        fan,
        prop_oneof![2 => Just(ShapeRule::Strict), 1 => Just(ShapeRule::MayFold), 1 => Just(ShapeRule::MayTurn)],
    )
        .prop_map(|(positions, uvs, faces, mut fan, shape_rule)| {
            let (faces, are_turned) = faces.into_iter().unzip();
            let mut case = Case { positions: positions.into(), uvs: uvs.into(), faces, are_turned, fan, shape_rule };
            // Usually `is_rip` agrees with the mesh.
            fan.is_rip &= case.faces_with(&[FROM, TO]).is_empty();
            case.fan = fan;
            case
        })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    #[test]
    fn a_free_collapse_does_what_the_rules_say(case in case(), was_used in any::<bool>()) {
        let (mut mesh, rings) = case.mesh();
        let mut star = EdgeStar { shape_rule: case.shape_rule, ..EdgeStar::default() };
        star.reset(VERTICES as usize);
        if was_used {
            // An earlier edge must leave no trace.
            star.gather(&mesh, &rings, TO, FROM);
            let _ = star.check_edges(&mesh, &rings, TO, FROM, case.fan);
        }
        star.gather(&mesh, &rings, FROM, TO);
        let pairs = star.wedges.clone();
        // It must not matter whether the link condition was checked before.
        star.stranded.extend(was_used.then_some(w(VERTICES)));
        let verdict = star.check_edges(&mesh, &rings, FROM, TO, case.fan);
        let found = verdict.map(|()| outcome(&star));
        prop_assert_eq!(&found, &expected(&case, &pairs));
        if found.is_ok() {
            let full = |mesh: &ClusterMesh| {
                let mut edges = std::collections::BTreeMap::new();
                for [a, b, c] in mesh.living_faces().map(|face| mesh.vertices(face)) {
                    for [one, other] in [[a, b], [b, c], [c, a]] {
                        *edges.entry([one.min(other), one.max(other)]).or_insert(0) += 1;
                    }
                }
                edges.retain(|edge, count| *count > 2 && (edge.contains(&FROM) || edge.contains(&TO)));
                edges.len() as i64
            };
            let before = full(&mesh);
            star.apply(&mut mesh, &rings, FROM, TO);
            prop_assert_eq!(full(&mesh) - before, star.new_non_manifold_edges);
            mesh.compact_faces();
            prop_assert!(mesh.has_matching_corners());
        }
    }

    /// Where the topology may change, a collapse that the link condition refuses may be allowed, and non-manifold
    /// vertices are always checked edge by edge.
    #[test]
    fn the_link_condition_is_not_the_last_word_where_the_topology_may_change(case in case(), is_complex in any::<bool>()) {
        let (mesh, rings) = case.mesh();
        let begin = || {
            let mut star = EdgeStar { shape_rule: case.shape_rule, ..EdgeStar::default() };
            star.reset(VERTICES as usize);
            star.gather(&mesh, &rings, FROM, TO);
            star
        };
        let mut star = begin();
        let linked = star.check_link(&mesh, &rings, FROM, TO, case.fan);
        for is_free in [false, true] {
            let fan = VanishingFan { is_free, is_complex, ..case.fan };
            let mut star = begin();
            let pairs = star.wedges.clone();
            let verdict = star.check_topology(&mesh, &rings, FROM, TO, fan);
            match linked {
                Ok(()) if !is_free || !is_complex => prop_assert_eq!(verdict, Ok(())),
                Ok(()) | Err(Refusal::Topology | Refusal::Piece) if is_free => {
                    prop_assert_eq!(verdict.map(|()| outcome(&star)), expected(&case, &pairs));
                }
                refused => prop_assert_eq!(verdict, refused),
            }
        }
    }
}
