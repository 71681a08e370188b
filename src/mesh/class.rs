//! Vertex classes, and the table of placement rules for collapses between them.
//!
//! # Source
//! Classes and rules after Wang et al. 2024 ("Lightweight algorithm for preventing texture distortion in oblique
//! photogrammetry model simplification"): a vertex is smooth, seam or corner by its number of texture coordinates, and
//! lies inside the surface or on an open border.
//!
//! # Where we differ
//! * A seam vertex may also collapse onto a corner or a locked vertex, which stays (the paper forbids it).
//! * An inner vertex may collapse onto a border vertex, which stays (the paper forbids it).
//! * A seam, corner or border vertex that others collapse onto keeps its texture coordinates, but is relocated to fit
//!   the surface (in the paper it stays).
//! * A vertex with one texture coordinate at which a seam ends is a corner.
//! * If the metric allows it, a corner may collapse along one of its seams, and the end of a seam along the border (the
//!   paper forbids both). Charts that do not contain the edge keep their texture coordinates: their texture is
//!   stretched, but does not leave the chart.

use super::cluster::ClusterMesh;
use super::id::LocalVertex;
use super::ring::{Rings, Spoke, VALENCE_MAX};
use crate::base::id::{TiSlice, TiVec};

/// Class of a vertex, by the charts and borders that meet there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Class {
    /// Inside a chart.
    Smooth,
    /// Where two charts meet along a line.
    Seam,
    /// Where seams end, meet or cross.
    Corner,
    /// On an open border, inside a chart.
    Border,
    /// On an open border, at the end of one seam.
    BorderSeam,
    /// On an open border, where several seams end.
    BorderCorner,
    /// Non-manifold: on an edge of three faces or more, or where several fans meet.
    Complex,
    /// Never vanishes or moves: above [`VALENCE_MAX`], without faces, or used by other clusters.
    Fixed,
}

/// The class of each vertex.
pub type Classes = TiSlice<LocalVertex, Class>;

/// Placement rule of an edge collapse.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// The edge does not collapse.
    Never,
    /// To the best placement.
    Free,
    /// To the edge's second end, which keeps its texture coordinates and, if locked or fixed, its position.
    Onto,
    /// To the best placement near the chain; only along an edge of the seam or border that both ends lie on.
    Chain,
    /// As `Onto`, but only along an edge of the seam or border.
    ChainOnto,
}

impl Class {
    /// All classes, in the order of the table.
    pub const ALL: [Class; 8] = [
        Class::Smooth,
        Class::Seam,
        Class::Corner,
        Class::Border,
        Class::BorderSeam,
        Class::BorderCorner,
        Class::Complex,
        Class::Fixed,
    ];

    /// Rule for an edge from a vertex of this class, which vanishes, to one of class `to`.
    #[inline]
    pub fn rule(self, to: Class) -> Rule {
        RULES[self as usize][to as usize]
    }

    /// Whether charts meet at the vertex in another way than along one line inside the surface.
    #[inline]
    pub fn is_corner(self) -> bool {
        matches!(self, Class::Corner | Class::BorderSeam | Class::BorderCorner)
    }

    /// Whether a vertex of this class may have border edges that change: those of fixed vertices do not.
    pub fn may_border(self) -> bool {
        self.is_border() || self == Self::Complex
    }

    /// Whether the vertex lies on an open border.
    #[inline]
    pub fn is_border(self) -> bool {
        matches!(self, Class::Border | Class::BorderSeam | Class::BorderCorner)
    }
}

/// Rows: the vertex that vanishes. Columns: the vertex that stays.
const RULES: [[Rule; 8]; 8] = {
    use Rule::{Chain, ChainOnto as Along, Free, Never, Onto};
    [
        // Smooth Seam   Corner Border BSeam  BCorner Complex Fixed
        [Free, Onto, Onto, Onto, Onto, Onto, Onto, Onto], // Smooth
        [Never, Chain, Along, Never, Along, Along, Along, Along], // Seam
        [Never, Along, Along, Never, Along, Along, Along, Along], // Corner
        [Never, Never, Never, Chain, Along, Along, Along, Along], // Border
        [Never, Never, Never, Along, Along, Along, Along, Along], // BorderSeam
        [Never, Never, Never, Along, Along, Along, Along, Along], // BorderCorner
        [Onto, Onto, Onto, Onto, Onto, Onto, Onto, Onto], // Complex
        [Never, Never, Never, Never, Never, Never, Never, Never], // Fixed
    ]
};

/// Writes the class of every vertex; vertices without faces are [`Class::Fixed`]. Returns whether the two faces of some
/// edge run along it in the same direction, which [`orient`](super::orient) repairs.
pub fn classify(mesh: &ClusterMesh, rings: &Rings, classes: &mut TiVec<LocalVertex, Class>) -> bool {
    classes.clear();
    classes.resize(mesh.positions.len(), Class::Fixed);
    reclassify_all(mesh, rings, classes)
}

/// Recomputes the classes after legal collapses: vertices that were [`Class::Smooth`] stay so. Returns the same as
/// [`classify`].
pub fn reclassify_all(mesh: &ClusterMesh, rings: &Rings, classes: &mut Classes) -> bool {
    let mut fan = Classifier::of(mesh);
    for (vertex, class) in classes.iter_mut_enumerated().filter(|(_, class)| **class != Class::Smooth) {
        *class = fan.class(mesh, rings, vertex);
    }
    fan.shows_back
}

/// Recomputes the classes of the given vertices, whatever they were.
pub fn reclassify(mesh: &ClusterMesh, rings: &Rings, classes: &mut Classes, vertices: &[LocalVertex]) {
    let mut fan = Classifier::of(mesh);
    for &vertex in vertices {
        classes[vertex] = fan.class(mesh, rings, vertex);
    }
}

/// What the spokes around the vertex that was classified last have to do with a vertex.
#[derive(Debug, Clone, Copy, Default)]
struct SpokeMark {
    /// Number of the fan that this is about; 0 for none.
    fan: u32,
    /// The last spoke that begins at the vertex.
    spoke: u32,
    /// Number of spokes that begin there.
    begins: u32,
    /// Number of spokes that end there.
    ends: u32,
}

/// The faces around one vertex, and buffers to classify it.
///
/// The spoke that begins where another one ends is looked up by their common vertex.
#[derive(Debug, Default)]
struct Classifier {
    spokes: Vec<Spoke>,
    marks: TiVec<LocalVertex, SpokeMark>,
    /// Number of the fan, from 1.
    fan: u32,
    /// For each spoke, the spoke that begins where it ends.
    followers: Vec<u32>,
    /// Whether, in any fan so far, the two faces of some edge ran along it in the same direction.
    shows_back: bool,
}

impl Classifier {
    /// A classifier for the vertices of a mesh.
    fn of(mesh: &ClusterMesh) -> Self {
        Self { marks: mesh.per_vertex(SpokeMark::default()), ..Self::default() }
    }

    fn class(&mut self, mesh: &ClusterMesh, rings: &Rings, vertex: LocalVertex) -> Class {
        let corners = rings.of(vertex);
        if corners.is_empty() || corners.len() > VALENCE_MAX {
            return Class::Fixed;
        }
        self.spokes.clear();
        self.spokes.extend(corners.iter().map(|&corner| Spoke::of(mesh, corner)));
        self.mark_beginnings();
        if self.is_smooth() { Class::Smooth } else { self.walk() }
    }

    /// The mark of a vertex in this fan.
    #[inline(always)]
    fn mark(&mut self, vertex: LocalVertex) -> &mut SpokeMark {
        let mark = &mut self.marks[vertex];
        if mark.fan != self.fan {
            *mark = SpokeMark { fan: self.fan, ..SpokeMark::default() };
        }
        mark
    }

    fn mark_beginnings(&mut self) {
        self.fan += 1;
        for at in 0..self.spokes.len() {
            let mark = self.mark(self.spokes[at].next);
            mark.spoke = at as u32;
            mark.begins += 1;
        }
    }

    /// Index of the spoke that begins at a vertex; `None` if there is not exactly one.
    #[inline(always)]
    fn beginning_at(&self, vertex: LocalVertex) -> Option<u32> {
        let mark = self.marks[vertex];
        (mark.fan == self.fan && mark.begins == 1).then_some(mark.spoke)
    }

    /// Whether one walk over edges that have the same wedges on both sides visits all spokes and closes.
    fn is_smooth(&mut self) -> bool {
        self.followers.clear();
        // All followers first: a walk would wait for each in turn.
        for at in 0..self.spokes.len() {
            let spoke = self.spokes[at];
            let Some(next) = self.beginning_at(spoke.previous) else { return false };
            let follower = &self.spokes[next as usize];
            if follower.wedge != spoke.wedge || follower.next_wedge != spoke.previous_wedge {
                return false;
            }
            self.followers.push(next);
        }
        let mut at = 0;
        for visited in 1..=self.spokes.len() {
            at = self.followers[at] as usize;
            if at == 0 {
                return visited == self.spokes.len();
            }
        }
        false
    }

    /// Class of the fan, found by walking it counter-clockwise from each spoke to the one that begins where it ends.
    fn walk(&mut self) -> Class {
        for at in 0..self.spokes.len() {
            self.mark(self.spokes[at].previous).ends += 1;
        }
        let mut start = None;
        for (i, spoke) in self.spokes.iter().enumerate() {
            let [next, previous] = [spoke.next, spoke.previous].map(|vertex| self.marks[vertex]);
            if next.begins > 1 || previous.ends > 1 {
                self.shows_back |= next.begins == 2 && next.ends == 0 || previous.ends == 2 && previous.begins == 0;
                return Class::Complex;
            }
            if next.ends == 0 {
                start = Some(i);
            }
        }
        let is_open = start.is_some();
        let mut at = start.unwrap_or(0);
        let (mut visited, mut seams, mut changes) = (1, 0, 0);
        loop {
            let spoke = self.spokes[at];
            let Some(next) = self.beginning_at(spoke.previous) else { break };
            let next = next as usize;
            let follower = &self.spokes[next];
            let differs = follower.wedge != spoke.wedge;
            changes += usize::from(differs);
            seams += usize::from(differs || follower.next_wedge != spoke.previous_wedge);
            if next == start.unwrap_or(0) {
                break;
            }
            at = next;
            visited += 1;
        }
        if visited != self.spokes.len() {
            return Class::Complex;
        }
        match (is_open, seams, changes) {
            (false, 0, _) => Class::Smooth,
            (false, 2, 2) => Class::Seam,
            (false, ..) => Class::Corner,
            (true, 0, _) => Class::Border,
            (true, 1, 1) => Class::BorderSeam,
            (true, ..) => Class::BorderCorner,
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::cluster::samples;
    use super::*;
    use crate::mesh::id::short::v;
    use glam::{DVec2, DVec3};

    /// Two faces run along their edge 0-1 in the same direction; the fans of both ends detect it.
    #[test]
    fn a_face_that_shows_its_back_is_seen_from_either_end_of_the_edge() {
        let mesh = samples::mesh_of([(DVec3::ZERO, DVec2::NAN); 4], &[[0, 1, 2], [0, 1, 3]]);
        let mut rings = Rings::default();
        rings.build(&mesh);
        for (vertex, expected) in [(0, true), (1, true), (2, false), (3, false)] {
            let mut fan = Classifier::of(&mesh);
            fan.class(&mesh, &rings, v(vertex));
            assert_eq!(fan.shows_back, expected, "{vertex}");
        }
    }

    fn classes_of(mesh: &ClusterMesh) -> TiVec<LocalVertex, Class> {
        let (mut rings, mut classes) = (Rings::default(), TiVec::new());
        rings.build(mesh);
        classify(mesh, &rings, &mut classes);
        classes
    }

    // One test per cell would repeat the table; these state each rule in words.
    #[test]
    fn a_smooth_vertex_may_go_anywhere_and_moves_only_smooth_ones() {
        for to in Class::ALL {
            let expected = if to == Class::Smooth { Rule::Free } else { Rule::Onto };
            assert_eq!(Class::Smooth.rule(to), expected, "{to:?}");
        }
    }

    #[test]
    fn a_seam_vertex_stays_on_its_seam() {
        for to in Class::ALL {
            let expected = match to {
                Class::Seam => Rule::Chain,
                Class::Smooth | Class::Border => Rule::Never,
                Class::Corner | Class::BorderSeam | Class::BorderCorner | Class::Complex | Class::Fixed => {
                    Rule::ChainOnto
                }
            };
            assert_eq!(Class::Seam.rule(to), expected, "{to:?}");
        }
    }

    #[test]
    fn a_border_vertex_stays_on_its_border() {
        for to in Class::ALL {
            let expected = match to {
                Class::Border => Rule::Chain,
                Class::Smooth | Class::Seam | Class::Corner => Rule::Never,
                Class::BorderSeam | Class::BorderCorner | Class::Complex | Class::Fixed => Rule::ChainOnto,
            };
            assert_eq!(Class::Border.rule(to), expected, "{to:?}");
        }
    }

    #[test]
    fn a_complex_vertex_may_go_anywhere() {
        assert!(Class::ALL.into_iter().all(|to| Class::Complex.rule(to) == Rule::Onto));
    }

    #[test]
    fn a_fixed_vertex_never_vanishes() {
        for to in Class::ALL {
            assert_eq!(Class::Fixed.rule(to), Rule::Never, "{to:?}");
        }
    }

    #[test]
    fn a_corner_stays_on_one_of_its_seams_and_moves_nobody() {
        for to in Class::ALL {
            let expected = if matches!(to, Class::Smooth | Class::Border) { Rule::Never } else { Rule::ChainOnto };
            assert_eq!(Class::Corner.rule(to), expected, "{to:?}");
        }
    }

    #[test]
    fn the_end_of_a_seam_stays_on_its_border_and_moves_nobody() {
        for from in [Class::BorderSeam, Class::BorderCorner] {
            for to in Class::ALL {
                let is_inside = matches!(to, Class::Smooth | Class::Seam | Class::Corner);
                assert_eq!(from.rule(to), if is_inside { Rule::Never } else { Rule::ChainOnto }, "{from:?} {to:?}");
            }
        }
    }

    //  6--7--8
    //  | /| /|      one chart: 4 is smooth, the rest border
    //  3--4--5
    //  | /| /|
    //  0--1--2
    #[test]
    fn a_grid_is_smooth_inside_and_border_outside() {
        let classes = classes_of(&samples::grid(2, 0.0));
        for (vertex, class) in classes.iter_enumerated() {
            assert_eq!(*class, if vertex == v(4) { Class::Smooth } else { Class::Border });
        }
    }

    //  +--+--s--+--+
    //  |  |  s  |  |     s: two charts meet
    //  +--+--s--+--+
    #[test]
    fn a_line_between_two_charts_is_a_seam_that_ends_at_the_border() {
        let classes = classes_of(&samples::two_charts(4));
        assert_eq!([7, 12].map(|at| classes[v(at)]), [Class::Seam; 2]);
        assert_eq!([2, 22].map(|at| classes[v(at)]), [Class::BorderSeam; 2]);
        assert_eq!(classes[v(6)], Class::Smooth);
    }

    //   \ | /
    //    \|/        three faces on one edge
    //     |
    #[test]
    fn both_ends_of_a_non_manifold_edge_are_complex_and_nothing_else() {
        let mut mesh = samples::grid(4, 0.0);
        let top = mesh.push_vertex(DVec3::new(1.5, 1.5, 1.0), 0);
        let wedge = mesh.push_wedge(top, DVec2::ZERO);
        samples::add_faces(&mut mesh, &[[6, 7, wedge.number()]]);
        mesh.link_wedges();
        let classes = classes_of(&mesh);
        let complex: Vec<_> = mesh.vertex_ids().filter(|&v| classes[v] == Class::Complex).collect();
        assert_eq!(complex, [6, 7].map(v));
    }

    #[test]
    fn classes_after_collapses_are_those_of_the_mesh_as_it_stands() {
        let mesh = samples::two_charts(8);
        let (mut rings, mut classes) = (Rings::default(), TiVec::new());
        rings.build(&mesh);
        classify(&mesh, &rings, &mut classes);
        let before = classes.clone();
        classes.iter_mut().filter(|class| **class == Class::Seam).for_each(|class| *class = Class::Fixed);
        reclassify_all(&mesh, &rings, &mut classes);
        assert_eq!(classes, before);
    }

    //  two triangles that share only a vertex
    #[test]
    fn a_bow_tie_vertex_is_complex() {
        let mesh = samples::mesh_of([(DVec3::ZERO, DVec2::NAN); 5], &[[0, 1, 2], [0, 3, 4]]);
        assert_eq!(classes_of(&mesh)[v(0)], Class::Complex);
        assert_eq!(classes_of(&mesh)[v(1)], Class::Border);
    }

    /// A face around vertex 0: its other two vertices, and the number of the wedge at each of the three.
    #[derive(Debug, Clone, Copy)]
    struct Around {
        ends: [u32; 2],
        wedges: [u32; 3],
    }

    /// Closed and open fans, some of one chart, and pairs of closed ones; some have one face reversed, or one
    /// additional face anywhere.
    fn fan() -> impl Strategy<Value = Vec<Around>> {
        let wedges = prop::array::uniform3(prop_oneof![3 => Just(0u32), 1 => 1u32..3]);
        let face = ((1u32..8, 1u32..7), wedges.clone());
        let wild = face.prop_map(|((a, step), wedges)| Around { ends: [a, (a + step - 1) % 7 + 1], wedges });
        let change = prop_oneof![
            4 => Just(None),
            1 => any::<prop::sample::Index>().prop_map(|at| Some((at, None))),
            1 => (any::<prop::sample::Index>(), wild).prop_map(|(at, face)| Some((at, Some(face)))),
        ];
        let kind = prop_oneof![Just([true, false]), Just([false, false]), Just([false, true])];
        let fan = (prop::collection::vec(wedges, 1..8), any::<bool>(), kind, change);
        fan.prop_map(|(wedges, is_one_chart, [is_open, is_pair], change)| {
            let count = wedges.len() as u32;
            let ring = if is_open || count < 3 { 8 } else { count };
            let around = |(at, wedges)| Around {
                ends: [at % ring + 1, (at + 1) % ring + 1],
                wedges: if is_one_chart { [0; 3] } else { wedges },
            };
            let mut faces: Vec<_> = (0..count).zip(wedges).map(around).collect();
            if is_pair && count >= 6 {
                faces[2].ends[1] = 1;
                faces[count as usize - 1].ends[1] = 4;
            }
            match change {
                None => {}
                Some((at, None)) => at.get_mut(&mut faces[..]).ends.reverse(),
                Some((at, Some(face))) => faces.insert(at.index(faces.len()), face),
            }
            faces.retain(|face| face.ends[0] != face.ends[1]);
            faces
        })
    }

    /// The class of vertex 0, computed edge by edge.
    fn expected_class(faces: &[Around]) -> Class {
        let at = |k: usize, vertex: u32| -> Vec<usize> {
            (0..faces.len()).filter(|&face| faces[face].ends[k] == vertex).collect()
        };
        let (mut seams, mut changes, mut ends) = (0, 0, 0);
        let mut group: Vec<usize> = (0..faces.len()).collect();
        for vertex in 1..9 {
            match (&at(0, vertex)[..], &at(1, vertex)[..]) {
                ([], []) => {}
                ([_], []) | ([], [_]) => ends += 1,
                (&[after], &[before]) => {
                    let (before_wedges, after_wedges) = (faces[before].wedges, faces[after].wedges);
                    let (own, outer) = (before_wedges[0] != after_wedges[0], before_wedges[2] != after_wedges[1]);
                    changes += usize::from(own);
                    seams += usize::from(own || outer);
                    let [one, other] = [group[before], group[after]];
                    group.iter_mut().filter(|group| **group == one).for_each(|group| *group = other);
                }
                _ => return Class::Complex,
            }
        }
        if faces.is_empty() {
            return Class::Fixed;
        }
        if group.iter().any(|&other| other != group[0]) {
            return Class::Complex;
        }
        match (ends, seams, changes) {
            (0, 0, _) => Class::Smooth,
            (0, 2, 2) => Class::Seam,
            (0, ..) => Class::Corner,
            (_, 0, _) => Class::Border,
            (_, 1, 1) => Class::BorderSeam,
            _ => Class::BorderCorner,
        }
    }

    /// Whether the two faces of some edge run along it in the same direction; `None` if more than one edge is
    /// inconsistent.
    fn expected_back(faces: &[Around]) -> Option<bool> {
        let mut runs = std::collections::BTreeMap::new();
        for &Around { ends: [a, b], .. } in faces {
            for [from, to] in [[0, a], [a, b], [b, 0]] {
                runs.entry([from.min(to), from.max(to)]).or_insert([0, 0])[usize::from(from < to)] += 1;
            }
        }
        let bad: Vec<_> = runs.values().filter(|run| run.iter().any(|&count| count > 1)).collect();
        match bad[..] {
            [] => Some(false),
            [&run] => Some(run == [2, 0] || run == [0, 2]),
            _ => None,
        }
    }

    /// Whether some edge of a vertex has one face.
    fn has_border(faces: &[Around], vertex: LocalVertex) -> bool {
        let mut counts = std::collections::BTreeMap::new();
        for &Around { ends: [a, b], .. } in faces {
            for [one, other] in [[0, a], [a, b], [b, 0]].map(|edge| edge.map(v)) {
                *counts.entry([one.min(other), one.max(other)]).or_insert(0) += 1;
            }
        }
        counts.iter().any(|(edge, &count)| count == 1 && edge.contains(&vertex))
    }

    /// A mesh of faces around vertex 0.
    fn mesh_around(faces: &[Around]) -> ClusterMesh {
        let mut mesh = ClusterMesh::default();
        for _ in 0..9 {
            let vertex = mesh.push_vertex(DVec3::ZERO, 0);
            (0..3).for_each(|_| _ = mesh.push_wedge(vertex, DVec2::NAN));
        }
        for &Around { ends: [a, b], wedges: [own, of_a, of_b] } in faces {
            samples::add_faces(&mut mesh, &[[own, 3 * a + of_a, 3 * b + of_b]]);
        }
        mesh.link_wedges();
        mesh
    }

    #[test]
    fn a_vertex_is_not_smooth_if_all_edges_around_it_are_seams() {
        let differ_at_the_vertex = [0, 1, 2].map(|own| [own, 0, 0]);
        let differ_at_the_far_ends = [[0, 0, 1]; 3];
        for wedges in [differ_at_the_vertex, differ_at_the_far_ends] {
            let faces: Vec<Around> =
                (0..3).map(|at| Around { ends: [at + 1, (at + 1) % 3 + 1], wedges: wedges[at as usize] }).collect();
            assert_eq!(classes_of(&mesh_around(&faces))[v(0)], Class::Corner, "{wedges:?}");
        }
    }

    proptest! {
        #[test]
        fn the_class_is_that_of_the_edges_around_a_vertex(fans in prop::collection::vec(fan(), 1..3)) {
            let (mut rings, mut classes) = (Rings::default(), TiVec::new());
            for faces in fans {
                let mesh = mesh_around(&faces);
                rings.build(&mesh);
                let shows_back = classify(&mesh, &rings, &mut classes);
                prop_assert_eq!(classes[v(0)], expected_class(&faces), "{:?}", faces);
                for (vertex, class) in classes.iter_enumerated() {
                    let is_known = ![Class::Complex, Class::Fixed].contains(class);
                    prop_assert!(!is_known || class.may_border() == has_border(&faces, vertex), "{vertex:?} {faces:?}");
                }
                prop_assert!(expected_back(&faces).is_none_or(|expected| shows_back == expected), "{:?}", faces);
            }
        }
    }

    #[test]
    fn a_fan_of_too_many_faces_is_fixed() {
        for (count, expected) in [(VALENCE_MAX, Class::Smooth), (VALENCE_MAX + 1, Class::Fixed)] {
            let ring = count as u32;
            let faces: Vec<_> = (0..ring).map(|at| [0, at + 1, (at + 1) % ring + 1]).collect();
            let mesh = samples::mesh_of(vec![(DVec3::ZERO, DVec2::NAN); count + 1], &faces);
            assert_eq!(classes_of(&mesh)[v(0)], expected);
        }
    }
}
