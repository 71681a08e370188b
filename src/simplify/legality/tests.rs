use std::collections::{BTreeMap, BTreeSet};

use proptest::prelude::*;

use super::super::triangle_change::triangle_survives;
use super::*;
use crate::base::chance::{mixed, unit};
use crate::mesh::FaceId;
use crate::mesh::cluster::{flag, samples};
use crate::mesh::fold::{are_folded, are_nearly_folded};
use crate::mesh::id::short::{f, pair, v, w};
use crate::mesh::ring::VALENCE_MAX;

//   4                       4 ........
//   |\   face 0-3-4,        | \        ........       vertex 0 goes to 1: face 0-3-4 becomes 1-3-4, which spans
//   3-0 ------------- 1     3 ------------------ 1    empty space; face 0-2-3 becomes 1-2-3, over the ground
//     \  ground  /            \   ground   /
//          2                        2
#[test]
fn no_face_is_pulled_out_over_empty_space() {
    let places = [[0.0, 0.0, 0.0], [29.0, 0.0, 0.0], [10.0, -10.0, 0.0], [-0.06, 0.0, 0.0], [0.0, 0.0, 6.0]];
    let (mut mesh, rings) = mesh_of(&places.map(DVec3::from), &[[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
    let mut star = EdgeStar::default();
    star.reset(5);
    star.gather(&mesh, &rings, v(0), v(1));
    let uvs = [DVec2::NAN];
    let mut at = |cost| star.check_faces(&mesh, &rings, &[v(0)], mesh.positions[v(1)], &uvs, cost);
    assert_eq!(at(0.0), Err(Refusal::Fold));
    assert_eq!(at(f64::INFINITY), Ok(()));
    // Without face 0-3-4 only the ground is left.
    mesh.kill(f(2));
    assert_eq!(star.check_faces(&mesh, &rings, &[v(0)], mesh.positions[v(1)], &uvs, 0.0), Ok(()));
}

//   0    3        A page 0-1-2 and a wall 3-2-1 at the spine 1-2. The page falls onto the wall, or through it to
//    \\  /         the other side, or its tip comes to lie on the spine.
//     12
#[test]
fn a_weaker_rule_for_shapes_lets_faces_fold_and_the_weakest_lets_them_turn_over() {
    let around = |degrees: f64| DVec3::new(0.5, degrees.to_radians().cos(), degrees.to_radians().sin());
    let (mesh, rings) = mesh_of(&[around(100.0), DVec3::ZERO, DVec3::X, around(30.0)], &[[0, 1, 2], [3, 2, 1]]);
    let verdicts = |position| {
        [ShapeRule::Strict, ShapeRule::MayFold, ShapeRule::MayTurn].map(|shape_rule| {
            let mut star = EdgeStar { shape_rule, ..EdgeStar::default() };
            star.check_faces(&mesh, &rings, &[v(0)], position, &[], 0.0)
        })
    };
    let refused = Err(Refusal::Fold);
    assert_eq!(verdicts(around(60.0)), [Ok(()); 3]);
    assert_eq!(verdicts(around(31.0)), [refused, Ok(()), Ok(())]);
    assert_eq!(verdicts(around(-60.0)), [refused, refused, Ok(())]);
    assert_eq!(verdicts(DVec3::new(0.5, 0.0, 0.0)), [refused; 3]);
}

//   4--5         A page of four faces around 0, which hardly turns and lies as the rest of the page does, and a wall
//   | 0|   3     3-2-1 at the spine 1-2.
//   1--2 --
#[test]
fn a_face_that_closes_slowly_is_seen_if_it_is_close_to_a_fold() {
    let around = |x: f64, length: f64, angle: f64| DVec3::new(x, length * angle.cos(), length * angle.sin());
    let page = |angle: f64| around(0.5, 1.0, angle);
    let places = [page(0.2), DVec3::ZERO, DVec3::X, page(0.0), around(0.0, 2.0, 0.2), around(1.0, 2.0, 0.2)];
    let (mut mesh, rings) = mesh_of(&places, &[[0, 1, 2], [0, 2, 5], [0, 5, 4], [0, 4, 1], [3, 2, 1]]);
    let mut star = EdgeStar::default();
    let mut at = |mesh: &ClusterMesh, angle| star.check_faces(mesh, &rings, &[v(0)], page(angle), &[], 0.0);
    assert_eq!(at(&mesh, 0.08), Ok(()));
    mesh.flags[v(0)] |= flag::FOLDS;
    assert_eq!([0.08, 0.18].map(|angle| at(&mesh, angle)), [Err(Refusal::Fold), Ok(())]);
}

/// A triangle over the edge from 0 to 1 on the x axis, with its apex at `height`, rotated about the edge by `angle`.
fn over_edge(height: f64, angle: f64) -> [DVec3; 3] {
    [DVec3::ZERO, DVec3::X, DVec3::new(0.3, height * angle.cos(), height * angle.sin())]
}

fn scaled(triangle: [DVec3; 3], scale: f64) -> [DVec3; 3] {
    triangle.map(|corner| corner * scale)
}

/// 4√3 · area / Σ length² of a triangle over the edge.
fn regularity(height: f64) -> f64 {
    4.0 * 3f64.sqrt() * (height / 2.0) / (1.58 + 2.0 * height * height)
}

/// A texture triangle of this doubled area.
fn uv_triangle_of(doubled_area: f64) -> [DVec2; 3] {
    [DVec2::new(3.0, 1.0), DVec2::new(4.0, 1.0), DVec2::new(3.0, 1.0 + doubled_area)]
}

proptest! {
    #[test]
    fn a_face_survives_a_turn_of_up_to_78_degrees(
        angle in prop_oneof![-3.2..3.2, 1.3..1.45, 1.7..1.85],
        scale in 1e-3..1e3,
    ) {
        let [before, after] = [0.0, angle].map(|angle| scaled(over_edge(0.8, angle), scale));
        prop_assume!((angle.cos() - 0.2).abs() > 1e-9);
        prop_assert_eq!(triangle_survives(before, after), angle.cos() > 0.2);
    }

    #[test]
    fn a_face_may_be_thin_only_if_it_was_thinner(
        before in 1e-3..0.03,
        after in 1e-3..0.03,
        scales in prop::array::uniform2(1e-3..1e3),
    ) {
        let [thin_before, thin_after] = [before, after].map(regularity);
        prop_assume!((thin_after - 0.02).abs() > 1e-9 && (thin_after - thin_before).abs() > 1e-9);
        let [old, new] = [(before, scales[0]), (after, scales[1])];
        let [old, new] = [old, new].map(|(height, scale)| scaled(over_edge(height, 0.0), scale));
        prop_assert_eq!(triangle_survives(old, new), thin_after > 0.02 || thin_after > thin_before);
        prop_assert!(triangle_survives(old, old));
    }

    #[test]
    fn a_face_that_turns_by_more_than_ten_degrees_may_fold(angle in prop_oneof![-1.3..1.3, 0.1..0.25], scale in 1e-3..1e3) {
        let [before, after] = [0.0, angle].map(|angle| scaled(over_edge(0.8, angle), scale));
        let limit = 0.97f64.sqrt().acos();
        prop_assume!((angle.abs() - limit).abs() > 1e-9);
        prop_assert_eq!(change_of(before, after).unwrap().turns, angle.abs() > limit);
    }

    #[test]
    fn the_areas_of_a_face_that_survives_are_given(before in 0.1..9.0, after in 0.1..9.0) {
        let [old_sq, new_sq] = change_of(over_edge(before, 0.0), over_edge(after, 0.1)).unwrap().areas_sq;
        prop_assert!((old_sq.sqrt() - before / 2.0).abs() < 1e-12 && (new_sq.sqrt() - after / 2.0).abs() < 1e-12);
    }

    #[test]
    fn a_texture_triangle_keeps_its_sign_and_a_twentieth_of_its_size_beside_the_face(
        before in prop_oneof![-2.0..-0.1, 0.1..2.0],
        share in prop_oneof![-1.0..1.0, 0.02..0.08],
        area_before in prop_oneof![Just(0.0), 0.1..4.0],
        area_share in 0.05..3.0,
    ) {
        let areas_sq = [area_before, area_before * area_share].map(|area: f64| area * area);
        let needed = 0.05 * if area_before > 0.0 { f64::min(area_share, 1.0) } else { 1.0 };
        prop_assume!(f64::abs(share - needed) > 1e-9);
        prop_assert_eq!(uv_survives(uv_triangle_of(before), uv_triangle_of(before * share), areas_sq), share > needed);
    }

    #[test]
    fn a_face_hovers_where_its_middle_is_above_what_its_area_and_the_cost_explain(
        height in 0.001..0.5,
        size in 0.2..2.0,
        cost in prop_oneof![Just(0.0), 1e-5..0.05],
    ) {
        let ground = [[-9.0, -9.0, 0.0], [9.0, -9.0, 0.0], [0.0, 9.0, 0.0]];
        let (mesh, rings) = mesh_of(&ground.map(DVec3::from), &[[0, 1, 2]]);
        let face = [[0.0, 0.0], [size, 0.0], [0.0, size]].map(|[x, y]| DVec3::new(x, y, height));
        let area = size * size / 2.0;
        let allowed = (0.05 * area.sqrt()).max((4.0 * cost / area).sqrt());
        prop_assume!((height - allowed).abs() > 1e-9);
        prop_assert_eq!(hovers(&mesh, &rings, &[v(0)], face, area, cost), height > allowed);
    }

    //        / g \       The apex of the only face moves to g: the middle of the new face, at g / 3, is above the old
    //       / /1\ \      face from 3 on, and too far above it from 3.6 on. Up to 4 times the area is allowed.
    //      /_/___\_\
    #[test]
    fn a_face_that_hovers_may_grow_to_four_times_its_area(
        growth in prop_oneof![Just(4.0), 3.7..4.3],
        scale in 1e-3..1e3,
    ) {
        prop_assume!(growth == 4.0 || f64::abs(growth - 4.0) > 1e-9);
        let corners = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]].map(|corner| DVec3::from(corner) * scale);
        let (mesh, rings) = mesh_of(&corners, &[[0, 1, 2]]);
        let outcome = EdgeStar::default().check_faces(&mesh, &rings, &[v(0)], corners[0] * growth, &[], 0.0);
        prop_assert_eq!(outcome, if growth > 4.0 { Err(Refusal::Fold) } else { Ok(()) });
    }

    #[test]
    fn a_collapse_is_legal_if_and_only_if_the_surface_keeps_its_topology(
        wraps in any::<[bool; 2]>(),
        picks in prop::collection::vec((any::<usize>(), 0..3usize), 1..80),
    ) {
        let mut faces = sheet(wraps);
        let positions = vec![DVec3::ZERO; SIDE * SIDE];
        let mut star = EdgeStar::default();
        star.reset(positions.len());
        for (pick, k) in picks {
            let face = faces[pick % faces.len()];
            let (from, to) = (face[k], face[(k + 1) % 3]);
            let (mesh, rings) = mesh_of(&positions, &faces);
            let borders = borders(&faces);
            // The classes rule out inner edges between border vertices.
            if borders.contains(&from) && borders.contains(&to) && sides(&faces)[&[from.min(to), from.max(to)]] == 2 {
                continue;
            }
            let mut after = faces.clone();
            after.iter_mut().flatten().filter(|v| **v == from).for_each(|v| *v = to);
            after.retain(|[a, b, c]| a != b && b != c && c != a);
            let keeps = is_surface(&after) && euler_number(&after) == euler_number(&faces);
            star.gather(&mesh, &rings, v(from), v(to));
            for closed in [false, !borders.contains(&from)] {
                let outcome = star.check_topology(&mesh, &rings, v(from), v(to), VanishingFan { closed, ..VanishingFan::default() });
                prop_assert_eq!(outcome.is_ok(), keeps, "{:?} from {} to {}: {:?}", &faces, from, to, outcome);
            }
            if keeps {
                faces = after;
            }
        }
    }

    #[test]
    fn a_hub_of_more_than_twice_the_valence_takes_no_vertex(more in 0..6usize, dead in 0..4u32) {
        // A fan around vertex 0, open between the first and the last spoke; its last faces are dead.
        let count = (2 * VALENCE_MAX - 1 + more) as u32;
        let faces: Vec<_> = (1..=count).map(|k| [0, k, k + 1]).collect();
        let (mut mesh, rings) = mesh_of(&vec![DVec3::ZERO; count as usize + 2], &faces);
        (count - dead..count).for_each(|face| mesh.kill(f(face)));
        let mut star = EdgeStar::default();
        star.reset(count as usize + 2);
        star.gather(&mesh, &rings, v(1), v(0));
        let outcome = star.check_topology(&mesh, &rings, v(1), v(0), VanishingFan::default());
        prop_assert_eq!(outcome, if (count - dead) as usize > 2 * VALENCE_MAX { Err(Refusal::Topology) } else { Ok(()) });
    }
}

#[test]
fn a_face_without_area_never_survives_and_an_unseen_texture_triangle_always_does() {
    assert!(!triangle_survives(over_edge(0.0, 0.0), over_edge(0.0, 0.0)));
    assert!(!triangle_survives(over_edge(1.0, 0.0), over_edge(0.0, 0.0)));
    // But it may get an area, and then lie anywhere.
    assert!(change_of(over_edge(0.0, 0.0), over_edge(1.0, 0.0)).is_some_and(|change| change.turns));
    assert!(uv_survives([DVec2::NAN; 3], [DVec2::NAN; 3], [1.0; 2]));
    assert!(uv_survives(uv_triangle_of(0.0), uv_triangle_of(-1.0), [1.0; 2]));
    assert!(!uv_survives(uv_triangle_of(1.0), uv_triangle_of(0.0), [1.0, 0.0]));
    assert!(uv_survives(uv_triangle_of(1.0), uv_triangle_of(0.5), [0.0, 1.0]));
}

/// Vertices along each side of a [`sheet`].
const SIDE: usize = 5;

/// Two triangles for each cell of a grid, which may be closed to a tube or a torus.
fn sheet(wraps: [bool; 2]) -> Vec<[u32; 3]> {
    let at = |x: usize, y: usize| (y % SIDE * SIDE + x % SIDE) as u32;
    let [width, height] = wraps.map(|wraps| if wraps { SIDE } else { SIDE - 1 });
    let cells = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let halves = |(x, y)| [[at(x, y), at(x + 1, y), at(x + 1, y + 1)], [at(x, y), at(x + 1, y + 1), at(x, y + 1)]];
    cells.flat_map(halves).collect()
}

fn mesh_of(positions: &[DVec3], faces: &[[u32; 3]]) -> (ClusterMesh, Rings) {
    let mesh = samples::mesh_of(positions.iter().map(|&position| (position, DVec2::NAN)), faces);
    let mut rings = Rings::default();
    rings.build(&mesh);
    (mesh, rings)
}

/// How many faces each edge has.
fn sides(faces: &[[u32; 3]]) -> BTreeMap<[u32; 2], usize> {
    let mut sides = BTreeMap::new();
    for [a, b, c] in faces {
        [[a, b], [b, c], [c, a]].iter().for_each(|[a, b]| *sides.entry([**a.min(b), **a.max(b)]).or_default() += 1);
    }
    sides
}

fn borders(faces: &[[u32; 3]]) -> BTreeSet<u32> {
    sides(faces).into_iter().filter(|(_, count)| *count == 1).flat_map(|(edge, _)| edge).collect()
}

fn euler_number(faces: &[[u32; 3]]) -> isize {
    let vertices: BTreeSet<_> = faces.iter().flatten().collect();
    (vertices.len() + faces.len()) as isize - sides(faces).len() as isize
}

/// Whether no face occurs twice, no edge has three faces, and the faces around each vertex form one fan.
fn is_surface(faces: &[[u32; 3]]) -> bool {
    let sorted: BTreeSet<_> = faces.iter().map(|&[a, b, c]| BTreeSet::from([a, b, c])).collect();
    let is_fan = |vertex: &u32| {
        let mut around: Vec<_> = faces.iter().filter(|face| face.contains(vertex)).collect();
        let mut fan: Vec<_> = around.pop().into_iter().collect();
        while let Some(next) = around
            .iter()
            .position(|face| fan.iter().any(|other| face.iter().filter(|v| other.contains(v)).count() == 2))
        {
            fan.push(around.remove(next));
        }
        around.is_empty()
    };
    sorted.len() == faces.len() && sides(faces).values().all(|&count| count <= 2) && faces.iter().flatten().all(is_fan)
}

/// A mesh of these faces whose `shared` vertices other clusters also use.
fn with_shared(count: u32, shared: &[u32], faces: &[[u32; 3]]) -> (ClusterMesh, Rings) {
    let (mut mesh, rings) = mesh_of(&vec![DVec3::ZERO; count as usize], faces);
    shared.iter().for_each(|&vertex| mesh.flags[v(vertex)] |= flag::SHARED);
    (mesh, rings)
}

/// The verdict on a collapse of 0 into 1.
fn verdict(mesh: &(ClusterMesh, Rings)) -> Result<(), Refusal> {
    verdict_of(mesh, VanishingFan::default())
}

fn verdict_of((mesh, rings): &(ClusterMesh, Rings), fan: VanishingFan) -> Result<(), Refusal> {
    let mut star = EdgeStar::default();
    star.reset(mesh.positions.len());
    star.gather(mesh, rings, v(0), v(1));
    star.check_topology(mesh, rings, v(0), v(1), fan)
}

#[test]
fn the_last_face_of_a_piece_stays_unless_another_cluster_may_have_more_of_it() {
    for (shared, refusal) in
        [(&[][..], Refusal::Piece), (&[1], Refusal::Piece), (&[2], Refusal::Piece), (&[1, 2], Refusal::Rim)]
    {
        assert_eq!(verdict(&with_shared(3, shared, &[[0, 1, 2]])), Err(refusal), "{shared:?}");
    }
}

/// A vertex moves to another, or both move to a position between them, on a crumpled sheet. Refused are faces that do
/// not survive, and two faces that nearly lie on each other afterwards, share an edge, and did not lie so before, if
/// one of them turns enough or both move: they may have approached each other in small steps.
#[test]
fn no_two_faces_fold_onto_each_other() {
    let faces = sheet([false; 2]);
    let mut hash = 5;
    let mut number = || {
        hash = mixed(hash);
        unit(hash)
    };
    let (mut folds, mut slow, mut allowed) = (0, 0, 0);
    let mut star = EdgeStar::default();
    for _ in 0..40_000 {
        // In pleats, most of them steep.
        let (width, height) = (0.05 + 0.5 * number(), 2.0 * number());
        let place = |v: usize| DVec3::new(width * (v % SIDE) as f64, (v / SIDE) as f64, height * (v % SIDE % 2) as f64);
        let crumple = |v: usize| place(v) + DVec3::new(width * number(), number(), number()) * 0.5;
        let positions: Vec<DVec3> = (0..SIDE * SIDE).map(crumple).collect();
        let face = faces[(number() * faces.len() as f64) as usize];
        let (from, to) = (face[0], face[1]);
        let borders = borders(&faces);
        if borders.contains(&from) || borders.contains(&to) {
            continue;
        }
        let (mut mesh, rings) = mesh_of(&positions, &faces);
        let goes_half_way = number() < 0.5;
        // From here on all ids are those of the mesh.
        let positions = mesh.positions.clone();
        let faces = mesh.corner_vertices.clone();
        let (from, to) = (v(from), v(to));
        let at_edge = |face: &FaceId| [from, to].iter().all(|end| faces[*face].contains(end));
        let gone = (number() < 0.3).then(|| f((number() * faces.len() as f64) as u32)).filter(|face| !at_edge(face));
        gone.into_iter().for_each(|face| mesh.kill(face));
        let [start, end] = [from, to].map(|v| positions[v]);
        // Often in the plane of a face beside a moving one.
        let beside = faces.iter().filter(|face| !face.contains(&from) && !face.contains(&to));
        let is_joined = |v: &LocalVertex| faces.iter().any(|face| face.contains(&from) && face.contains(v));
        let beside: Vec<_> = beside.filter(|face| face.iter().any(is_joined)).collect();
        let [a, b, c] = beside[(number() * beside.len() as f64) as usize].map(|v| positions[v]);
        let in_plane = a + (b - a) * number() + (c - a) * number();
        let position = match (goes_half_way, number() < 0.7) {
            (false, _) => end,
            (true, true) => in_plane,
            (true, false) => start.lerp(end, number()),
        };
        let moving = if goes_half_way { vec![from, to] } else { vec![from] };
        star.reset(positions.len());
        star.gather(&mesh, &rings, from, to);
        let outcome = star.check_faces(&mesh, &rings, &moving, position, &[DVec2::NAN], f64::INFINITY);

        let stays = |face: &FaceId| !at_edge(face) && gone != Some(*face);
        let moves = |face: &FaceId| faces[*face].iter().any(|v| moving.contains(v));
        let before = |face: FaceId| faces[face].map(|v| positions[v]);
        let place = |v: LocalVertex| if v == from || v == to { position } else { positions[v] };
        let joined = |v: LocalVertex| if v == from { to } else { v };
        let after = |face: FaceId| faces[face].map(place);
        let change = |face: FaceId| change_of(before(face), after(face));
        let staying: Vec<FaceId> = mesh.face_ids().filter(stays).collect();
        let survive = staying.iter().filter(|face| moves(face)).all(|&face| change(face).is_some());
        let turns = |face: FaceId| moves(&face) && change(face).is_some_and(|change| change.turns);
        let (mut is_fold, mut must_be_seen) = (false, false);
        for (i, &one) in staying.iter().enumerate() {
            for &other in &staying[i + 1..] {
                let [of_one, of_other] = [one, other].map(|face| faces[face].map(joined));
                let ends: Vec<LocalVertex> = of_one.into_iter().filter(|v| of_other.contains(v)).collect();
                let &[a, b] = &ends[..] else { continue };
                let third = |of: [LocalVertex; 3]| of.into_iter().find(|v| !ends.contains(v)).unwrap();
                let thirds = [of_one, of_other].map(third);
                let lie_on_each_other =
                    [are_nearly_folded, are_folded].map(|is_so| is_so([a, b].map(place), thirds.map(place)));
                let old_ends: Vec<LocalVertex> = faces[one].into_iter().filter(|v| faces[other].contains(v)).collect();
                let did_before = |is_so: fn([DVec3; 2], [DVec3; 2]) -> bool| {
                    let third = |face: FaceId| faces[face].into_iter().find(|v| !old_ends.contains(v)).unwrap();
                    let at = |v: LocalVertex| positions[v];
                    old_ends.len() == 2 && is_so([at(old_ends[0]), at(old_ends[1])], [one, other].map(third).map(at))
                };
                let [nearly, fully] = lie_on_each_other;
                let fold = (nearly && !did_before(are_nearly_folded)) || (fully && !did_before(are_folded));
                is_fold |= fold;
                must_be_seen |= fold && (turns(one) || turns(other) || (moves(&one) && moves(&other)));
                slow += usize::from(fold && survive && !turns(one) && !turns(other) && moves(&one) && moves(&other));
            }
        }
        if !survive || must_be_seen {
            assert!(outcome.is_err(), "{from:?} to {to:?} of {positions:?}");
        } else if !is_fold {
            assert_eq!(outcome, Ok(()), "{from:?} to {to:?} of {positions:?}");
        }
        folds += usize::from(survive && must_be_seen);
        allowed += usize::from(outcome.is_ok());
    }
    assert!(folds > 20 && slow > 0 && allowed > 1000, "{folds} {slow} {allowed}");
}

//    \           \  0                 The face at the edge turns about it, in small steps, towards the wall behind. Few
//  ---0-|   ──▶   ---|\|  wall        faces or many move with it: those on the left hardly turn.
#[test]
fn a_face_that_nears_a_wall_step_by_step_is_stopped() {
    let [edge, halves] = [vec![[0, 1, 2]], vec![[0, 1, 6], [0, 6, 2]]];
    let rest = [[0, 2, 3], [0, 3, 4], [0, 4, 1]];
    let [wall, wall_halves] = [vec![[2, 1, 5]], vec![[6, 1, 5], [2, 6, 5]]];
    for (turning, wall, rest, wall_degrees, scale) in [
        (&edge, &wall, &rest[..], 180.0, 1e-3),
        (&edge, &wall, &rest[..], 90.0, 1.0),
        (&edge, &wall, &rest[..], 90.0, 1e3),
        (&edge, &wall, &[], 90.0, 1e-3),
        (&edge, &wall, &[], 30.0, 1e3),
        (&halves, &wall_halves, &rest[..], 180.0, 1.0),
        (&halves, &wall_halves, &[], 30.0, 1.0),
    ] {
        let around = |degrees: f64| {
            let angle = degrees.to_radians();
            DVec3::new(-angle.cos(), 0.0, angle.sin()) * 0.3 * scale
        };
        let flat = [[0.0, -1.0], [0.0, 1.0], [-8.0, 8.0], [-8.0, -8.0]].map(|[x, y]| DVec3::new(x, y, 0.0) * scale);
        let positions = [&[around(0.0)], &flat[..], &[around(wall_degrees), DVec3::ZERO]].concat();
        let faces = [&turning[..], rest, wall].concat();
        let (mut mesh, rings) = mesh_of(&positions, &faces);
        let mut star = EdgeStar::default();
        let mut degrees = 0.0;
        loop {
            assert!(degrees < wall_degrees, "past the wall at {wall_degrees}: {faces:?}");
            let position = around(degrees + 2.0);
            if star.check_faces(&mesh, &rings, &[v(0)], position, &[], f64::INFINITY).is_err() {
                break;
            }
            mesh.positions[v(0)] = position;
            degrees += 2.0;
        }
        let left = wall_degrees - degrees;
        assert!((8.5..11.0).contains(&left), "{left} before the wall at {wall_degrees}: {faces:?}");
    }
}

//     0
//    /|\          The spine from 0 to 1 rises at 0, so that the pages to 2 and 3 close like a book.
//   2-1-3
#[test]
fn two_faces_that_close_step_by_step_are_stopped() {
    let tips = [[0.0, -1.0, 1.4], [-0.1, 0.0, 0.0], [0.1, 0.0, 0.0]].map(DVec3::from);
    let spine_end = |height: f64| DVec3::new(0.0, 1.0, height);
    let (mut mesh, rings) = mesh_of(&[&[spine_end(0.2)], &tips[..]].concat(), &[[1, 0, 2], [0, 1, 3]]);
    let mut star = EdgeStar::default();
    let mut height = 0.2;
    while star.check_faces(&mesh, &rings, &[v(0)], spine_end(height + 0.01), &[], f64::INFINITY).is_ok() {
        height += 0.01;
        mesh.positions[v(0)] = spine_end(height);
        assert!(height < 2.0);
    }
    let ways = [2, 3].map(|tip| {
        let spine = (mesh.positions[v(0)] - mesh.positions[v(1)]).normalize();
        let way = mesh.positions[v(tip)] - mesh.positions[v(1)];
        way - spine * way.dot(spine)
    });
    let degrees = ways[0].angle_between(ways[1]).to_degrees();
    assert!((8.5..9.0).contains(&degrees), "{degrees}");
}

//  If the wall exists twice, neither copy counts as the face across.
#[test]
fn a_face_may_come_near_an_edge_of_three_faces() {
    let corners = [[-0.4, 0.0, 0.9], [0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-0.1, 0.0, 1.0]];
    let outcome = |faces: &[[u32; 3]]| {
        let (mesh, rings) = mesh_of(&corners.map(DVec3::from), faces);
        let near = DVec3::new(-0.1, 0.0, 1.0);
        EdgeStar::default().check_faces(&mesh, &rings, &[v(0)], near, &[], f64::INFINITY)
    };
    assert_eq!(outcome(&[[0, 1, 2], [2, 1, 3]]), Err(Refusal::Fold));
    assert_eq!(outcome(&[[0, 1, 2], [2, 1, 3], [2, 1, 4]]), Ok(()));
}

#[test]
fn an_edge_has_one_face_or_two() {
    let book = [[0, 1, 2], [0, 1, 3], [0, 1, 4]];
    assert_eq!(verdict(&with_shared(5, &[], &book[..2])), Ok(()));
    assert_eq!(verdict(&with_shared(5, &[], &book)), Err(Refusal::Topology));
    let apart = [[0, 2, 3], [1, 4, 5]];
    assert_eq!(verdict(&with_shared(6, &[], &apart)), Err(Refusal::Topology));
}

//    3---2      Vertex 0 goes to 1, with 2 and 6 opposite. Where 1 and 4 are shared, another cluster
//   / \ / \     may have an edge between them.
//  4---0---1
//   \ / \ /
//    5---6
#[test]
fn no_edge_is_made_that_another_cluster_may_have() {
    let fan: Vec<[u32; 3]> = (1..7).map(|k| [0, k, k % 6 + 1]).collect();
    for (shared, expected) in [
        (&[][..], Ok(())),
        (&[1], Ok(())),
        (&[3, 4, 5], Ok(())),
        (&[1, 2, 6], Ok(())),
        (&[1, 4], Err(Refusal::Rim)),
        (&[1, 3], Err(Refusal::Rim)),
    ] {
        for closed in [false, true] {
            let verdict = verdict_of(&with_shared(7, shared, &fan), VanishingFan { closed, ..VanishingFan::default() });
            assert_eq!(verdict, expected, "{shared:?}");
        }
    }
}

//      3
//     /|\        Vertex 0 goes to 1: the face 1-2-3 is left, which another cluster may have if it uses all
//    / 0 \       three vertices, and this one has if the component is closed below.
//   /.' '.\
//  1-------2
#[test]
fn no_face_is_made_that_is_there_or_that_another_cluster_may_have() {
    let cap = [[0, 1, 2], [0, 2, 3], [0, 3, 1]];
    for (shared, expected) in [(&[][..], Ok(())), (&[1, 2], Ok(())), (&[2, 3], Ok(())), (&[1, 2, 3], Err(Refusal::Rim))]
    {
        let with_bottom = [cap[0], cap[1], cap[2], [1, 3, 2]];
        for closed in [false, true] {
            let verdict =
                |faces| verdict_of(&with_shared(4, shared, faces), VanishingFan { closed, ..VanishingFan::default() });
            assert_eq!(verdict(&cap), expected, "{shared:?}");
            assert_eq!(verdict(&with_bottom), expected.and(Err(Refusal::Topology)), "{shared:?}");
        }
    }
}

/// A mesh of a closed fan around vertex 0, with faces of wedges; the last wedge, number 7, is another one of `vertex`.
fn with_two_wedges(vertex: u32, faces: &[[u32; 3]]) -> (ClusterMesh, Rings) {
    let (mut mesh, mut rings) = mesh_of(&[DVec3::ZERO; 7], &[]);
    mesh.push_wedge(v(vertex), DVec2::NAN);
    samples::add_faces(&mut mesh, faces);
    mesh.link_wedges();
    rings.build(&mesh);
    (mesh, rings)
}

#[test]
fn a_wedge_that_would_become_two_holds_the_seam() {
    let mut fan: Vec<[u32; 3]> = (1..7).map(|k| [0, k, k % 6 + 1]).collect();
    // One of the two faces at the edge 0-1 has another wedge there.
    fan[0][1] = 7;
    for closed in [false, true] {
        let verdict = verdict_of(&with_two_wedges(1, &fan), VanishingFan { closed, ..VanishingFan::default() });
        assert_eq!(verdict, Err(Refusal::Seam));
    }
}

#[test]
fn a_wedge_without_counterpart_is_stranded_or_holds_the_seam() {
    let mut fan: Vec<[u32; 3]> = (1..7).map(|k| [0, k, k % 6 + 1]).collect();
    // Away from the edge 0-1 two faces have a wedge of their own, number 7.
    fan[2..4].iter_mut().for_each(|face| face[0] = 7);
    let (mesh, rings) = with_two_wedges(0, &fan);
    let mut star = EdgeStar::default();
    star.reset(7);
    for strands in [false, true] {
        star.gather(&mesh, &rings, v(0), v(1));
        let fan = VanishingFan { strands, ..VanishingFan::default() };
        let outcome = star.check_topology(&mesh, &rings, v(0), v(1), fan);
        assert_eq!(outcome, if strands { Ok(()) } else { Err(Refusal::Seam) });
        assert_eq!(star.stranded, if strands { vec![w(7)] } else { vec![] });
    }
}

#[test]
fn a_collapse_that_turns_a_texture_triangle_over_is_refused_at_either_end_of_the_edge() {
    let corners = [DVec3::ZERO, DVec3::X, DVec3::Y].map(|corner| (corner, corner.truncate()));
    let mesh = samples::mesh_of(corners, &[[0, 1, 2]]);
    let mut rings = Rings::default();
    rings.build(&mesh);
    let check = |wedges, uv| {
        let mut star = EdgeStar { wedges: vec![wedges], ..EdgeStar::default() };
        star.check_faces(&mesh, &rings, &[v(0)], DVec3::ZERO, &[uv], 0.0)
    };
    for wedges in [pair(0, 9), pair(9, 0)] {
        assert_eq!(check(wedges, DVec2::splat(0.1)), Ok(()));
        assert_eq!(check(wedges, DVec2::splat(0.9)), Err(Refusal::UvFold));
    }
    assert_eq!(check(pair(8, 9), DVec2::splat(0.9)), Ok(()));
}

/// The verdict on a free collapse of 0 into 1, and how often each edge is used afterwards.
fn free_collapse(faces: &[[u32; 3]]) -> (Result<(), Refusal>, BTreeMap<[u32; 2], usize>) {
    let positions: Vec<DVec3> = (0..9).map(|i| DVec3::new(f64::from(i), f64::from(i * i), 1.0)).collect();
    let (mut mesh, rings) = mesh_of(&positions, faces);
    let mut star = EdgeStar::default();
    star.reset(9);
    star.gather(&mesh, &rings, v(0), v(1));
    let fan = VanishingFan { is_free: true, ..VanishingFan::default() };
    let verdict = star.check_topology(&mesh, &rings, v(0), v(1), fan);
    if verdict.is_ok() {
        star.apply(&mut mesh, &rings, v(0), v(1));
        mesh.compact_faces();
    }
    let left: Vec<_> = mesh.corner_vertices.iter().map(|face| face.map(LocalVertex::number)).collect();
    (verdict, sides(&left))
}

//     4───2───5
//      ╲ ╱ ╲ ╱       the hole 0-1-2 closes: 2-1 then has the faces of 0-2 and of 1-2
//       0───1
//        ╲ ╱
//         3
#[test]
fn a_hole_of_three_edges_closes_where_the_topology_may_change() {
    let faces = [[0, 3, 1], [0, 2, 4], [1, 5, 2]];
    let (freely, sides) = free_collapse(&faces);
    assert_eq!(freely, Ok(()));
    assert_eq!(sides.get(&[1, 2]), Some(&2));
    assert_eq!(verdict(&mesh_of(&[DVec3::ZERO; 6], &faces)), Err(Refusal::Topology));
}

#[test]
fn no_hole_closes_that_would_leave_a_texture_triangle_mirrored_in_its_chart() {
    let faces = [[0, 3, 1], [0, 2, 4], [1, 5, 2]];
    let close = |apex: [f64; 2], has_seam: bool| {
        let (mut mesh, mut rings) = mesh_of(&[DVec3::ZERO; 6], &[]);
        let texture = [[0.0, 0.0], [1.0, 0.0], [0.5, 1.0], [0.5, -1.0], [-0.5, 1.0], apex];
        mesh.wedge_uv = texture.map(DVec2::from_array).to_vec().into();
        let mut faces = faces;
        if has_seam {
            faces[2][2] = mesh.push_wedge(v(2), DVec2::new(0.5, 1.5)).number();
        }
        samples::add_faces(&mut mesh, &faces);
        mesh.link_wedges();
        rings.build(&mesh);
        verdict_of(&(mesh, rings), VanishingFan { is_free: true, ..VanishingFan::default() })
    };
    assert_eq!(close([1.5, 1.0], false), Ok(()));
    assert_eq!(close([0.0, -1.0], false), Err(Refusal::UvFold));
    assert_eq!(close([0.0, -1.0], true), Ok(()));
}

#[test]
fn no_edge_gets_a_third_face_or_two_that_run_along_it_the_same_way() {
    let with_third = [[0, 3, 1], [0, 2, 4], [0, 6, 2], [1, 5, 2]];
    assert_eq!(free_collapse(&with_third).0, Err(Refusal::Topology));
    let turned = [[0, 3, 1], [0, 4, 2], [1, 5, 2]];
    assert_eq!(free_collapse(&turned).0, Err(Refusal::Topology));
}

#[test]
fn two_sides_that_come_to_lie_on_each_other_vanish_but_for_the_last_of_a_piece() {
    // A pocket 0-1-2-3 on a surface: 0-2-3 and 1-3-2 come to lie back to back and enclose nothing.
    let tetrahedron = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    let (verdict, sides) = free_collapse(&tetrahedron);
    assert_eq!(verdict, Ok(()));
    assert_eq!(sides.values().copied().collect::<Vec<_>>(), [1, 1, 1], "one face is left");
    let with_more = [&tetrahedron[..], &[[1, 4, 5]]].concat();
    let (verdict, sides) = free_collapse(&with_more);
    assert_eq!(verdict, Ok(()));
    assert_eq!(sides.keys().copied().collect::<Vec<_>>(), [[1, 4], [1, 5], [4, 5]], "only the other face is left");
}

#[test]
fn the_last_face_of_a_piece_goes_only_if_it_may() {
    assert_eq!(free_collapse(&[[0, 1, 2], [4, 5, 6]]).0, Err(Refusal::Piece));
}

#[test]
fn the_top_of_a_tetrahedron_does_not_go_onto_its_bottom() {
    let tetrahedron = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    let mesh = mesh_of(&[DVec3::ZERO; 4], &tetrahedron);
    let verdict = verdict_of(&mesh, VanishingFan { closed: true, ..VanishingFan::default() });
    assert_eq!(verdict, Err(Refusal::Topology));
}

#[test]
fn a_collapse_tells_nothing_of_the_one_before_it() {
    // There is a hole at 0-1; if it closes, the edge to 2 has four faces. There is none at 5-6.
    let faces = [[0, 3, 1], [0, 2, 4], [0, 7, 2], [1, 5, 2], [1, 2, 6], [5, 6, 8], [6, 5, 9], [5, 8, 9]];
    let (mesh, rings) = mesh_of(&[DVec3::ZERO; 10], &faces);
    let mut star = EdgeStar::default();
    star.reset(10);
    star.gather(&mesh, &rings, v(0), v(1));
    let fan = VanishingFan { is_free: true, spare_edges: 1, ..VanishingFan::default() };
    assert_eq!(star.check_topology(&mesh, &rings, v(0), v(1), fan), Ok(()));
    assert_eq!(star.new_non_manifold_edges, 1);
    assert!(star.joins && !star.unsettled.is_empty());
    star.gather(&mesh, &rings, v(3), v(0));
    assert_eq!(star.new_non_manifold_edges, 0);
    assert!(!star.joins && star.unsettled.is_empty());
}

#[test]
fn a_mesh_is_looked_at_as_if_there_had_been_none_before() {
    let open_fan: Vec<[u32; 3]> = (1..6).map(|k| [0, k, k + 1]).collect();
    let (mesh, rings) = mesh_of(&[DVec3::ZERO; 9], &open_fan);
    let (other, other_rings) = mesh_of(&[DVec3::ZERO; 9], &[[7, 1, 2], [7, 2, 8], [1, 3, 2], [2, 3, 4]]);
    let mut star = EdgeStar::default();
    let mut legal = |(mesh, rings): (&ClusterMesh, &Rings), from, to| {
        star.reset(9);
        star.gather(mesh, rings, from, to);
        star.check_topology(mesh, rings, from, to, VanishingFan::default())
    };
    assert_eq!(legal((&mesh, &rings), v(0), v(1)), Ok(()));
    assert_eq!(legal((&other, &other_rings), v(7), v(2)), Ok(()));
}

#[test]
fn wedges_of_vertices_that_have_no_edge_are_paired_where_their_textures_are_alike() {
    let uv = |x: f64| DVec2::new(x, 0.5);
    let (mut mesh, mut rings) = (ClusterMesh::default(), Rings::default());
    for vertex in 0..6 {
        mesh.push_vertex(DVec3::new(f64::from(vertex), 0.0, 0.0), 0);
    }
    // Wedges 6 to 8 are further wedges of 0, and 9 to 11 of 3.
    let own = (0..6).map(|vertex| (vertex, uv(f64::from(vertex))));
    let more = [(0, uv(9.0)), (0, DVec2::NAN), (0, uv(7.0)), (3, DVec2::NAN), (3, uv(9.0)), (3, uv(8.0))];
    own.chain(more).for_each(|(vertex, uv)| {
        mesh.push_wedge(v(vertex), uv);
    });
    let faces = [[6, 1, 2], [7, 2, 1], [8, 1, 2], [6, 2, 1], [9, 4, 5], [10, 4, 5], [11, 4, 5]];
    samples::add_faces(&mut mesh, &faces);
    mesh.link_wedges();
    rings.build(&mesh);
    let mut star = EdgeStar::default();
    star.reset(6);
    star.gather(&mesh, &rings, v(0), v(3));
    assert_eq!(star.wedges, [pair(6, 10), pair(7, 9)]);
    assert_eq!(star.beside, Some(w(9)));
}
