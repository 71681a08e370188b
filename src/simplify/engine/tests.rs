//! The engine on small meshes.

use glam::{DVec2, DVec3};

use super::*;
use crate::cost::{SurfaceCost, Weights};
use crate::mesh::cluster::{flag, samples};
use crate::mesh::id::Corner;
use crate::mesh::id::short::v;
use crate::model::id::PartId;
use crate::simplify::proposal::EdgeAt;

fn simplified(mesh: ClusterMesh, faces: usize) -> (ClusterMesh, StageResult) {
    let mut engine = Engine::<SurfaceCost>::new(mesh, &Weights::default());
    let result = engine.run(Stop::Faces(faces));
    (engine.finish(), result)
}

fn area(mesh: &ClusterMesh) -> f64 {
    let across = |t: [DVec3; 3]| (t[1] - t[0]).cross(t[2] - t[0]).length();
    mesh.face_ids().map(|face| 0.5 * across(mesh.triangle(face))).sum()
}

#[test]
fn a_flat_square_becomes_two_triangles_of_the_same_area() {
    let (mesh, result) = simplified(samples::grid(12, 0.0), 2);
    assert!(result.reached, "{result:?}");
    assert_eq!(mesh.corners.len(), 2);
    assert!((area(&mesh) - 144.0).abs() < 1e-3, "{}", area(&mesh));
}

/// A flat grid whose vertices are moved within the plane.
fn jittered(n: u32, seed: u32) -> ClusterMesh {
    let mut mesh = samples::grid(n, 0.0);
    let shift = |i: u32| f64::from((i ^ seed).wrapping_mul(0x9e37_79b9) >> 16) / 65_536.0 - 0.5;
    for (i, position) in (0..).zip(&mut mesh.positions) {
        *position += 0.48 * DVec3::new(shift(2 * i), shift(2 * i + 1), 0.0);
    }
    mesh
}

#[test]
fn no_face_of_a_flat_mesh_turns_over() {
    for seed in 0..20 {
        let whole = jittered(12, seed);
        for faces in [200, 100, 40, 10] {
            let (mesh, _) = simplified(whole.clone(), faces);
            let normals = mesh.face_ids().map(|face| {
                let [a, b, c] = mesh.triangle(face);
                (b - a).cross(c - a)
            });
            assert!(normals.clone().all(|normal| normal.z > 0.0), "seed {seed}, {faces} faces");
        }
    }
}

/// Adds a mast of 0.1 × 0.1 × `height`, closed at the top, with a ring of vertices every 0.25.
fn add_mast(mesh: &mut ClusterMesh, height: u32) {
    let first = mesh.positions.len() as u32;
    for ring in 0..=4 * height {
        for [x, y] in [[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]] {
            // Slightly bent, so that no ring may vanish at no cost.
            let bend = 0.01 * f64::from(ring * ring % 7);
            let vertex = mesh.push_vertex(DVec3::new(5.0 + x + bend, 5.0 + y, 0.25 * f64::from(ring)), 0);
            mesh.push_wedge(vertex, DVec2::ZERO);
        }
    }
    let mut faces = Vec::new();
    for ring in 0..4 * height {
        for side in 0..4 {
            let [a, b] = [side, (side + 1) % 4].map(|k| first + 4 * ring + k);
            faces.extend([[a, b, b + 4], [a, b + 4, a + 4]]);
        }
    }
    let top = first + 16 * height;
    faces.extend([[top, top + 1, top + 2], [top, top + 2, top + 3]]);
    samples::add_faces(mesh, &faces);
    mesh.link_wedges();
}

#[test]
fn a_mast_does_not_vanish_step_by_step() {
    for height in [2, 5, 10] {
        let mut mesh = samples::grid(30, 0.5);
        add_mast(&mut mesh, height);
        let mut engine = Engine::<SurfaceCost>::new(mesh, &Weights::default());
        for faces in [1200, 600, 300, 150] {
            engine.run(Stop::Faces(faces));
        }
        let mesh = engine.finish();
        let used = mesh.face_ids().flat_map(|face| mesh.triangle(face));
        let top = used.map(|position| position.z).fold(0.0, f64::max);
        assert!(top > 0.9 * f64::from(height), "{top} of {height}");
    }
}

#[test]
fn the_face_target_is_hit() {
    let (mesh, result) = simplified(samples::grid(40, 0.5), 801);
    assert!(result.reached);
    assert!((799..=801).contains(&mesh.corners.len()));
}

#[test]
fn a_locked_vertex_never_moves_and_never_vanishes() {
    let mut mesh = samples::grid(12, 0.3);
    let before = mesh.positions.clone();
    let locked = mesh.vertex_ids().step_by(5);
    for vertex in locked.clone() {
        mesh.flags[vertex] |= flag::LOCKED;
    }
    let (mesh, _) = simplified(mesh, 2);
    for vertex in locked {
        assert_eq!(mesh.positions[vertex], before[vertex]);
        assert!(mesh.corners.iter().flatten().any(|&w| mesh.wedge_vertex[w] == vertex));
    }
}

#[test]
fn a_seam_keeps_both_charts_on_their_sides() {
    let (mesh, result) = simplified(samples::two_charts(12), 4);
    assert!(result.reached, "{result:?}");
    assert!((area(&mesh) - 144.0).abs() < 1e-3, "{}", area(&mesh));
    for corners in &mesh.corners {
        let right = corners.iter().filter(|&&w| mesh.wedge_uv[w].x >= 6.99).count();
        let left = corners.iter().filter(|&&w| mesh.wedge_uv[w].x <= 0.601).count();
        assert!(right < 3 || left == 0, "a face spans both charts");
    }
}

#[test]
fn an_edge_that_only_its_upper_end_may_collapse_is_proposed_by_it() {
    // Vertex 4 is the only inner one; without border planes it may collapse onto a border vertex, but not the reverse.
    let settings = crate::cost::classic::ClassicSettings::from(
        crate::cost::classic::PARAMETERS.map(|parameter| parameter.default),
    );
    let mut engine = Engine::<crate::cost::ClassicCost>::new(samples::grid(2, 0.5), &settings);
    engine.prepare();
    engine.cost.refresh(&engine.mesh, &engine.rings, &engine.classes);
    let ahead = |&corner: &Corner| EdgeAt::ahead(&engine.mesh, corner);
    let edges: Vec<EdgeAt> = engine.rings.of(v(4)).iter().filter_map(ahead).collect();
    assert_eq!(edges.iter().filter(|edge| edge.other < v(4)).count(), 3);
    assert!(edges.iter().all(|edge| engine.propose(v(4), edge).cost.is_finite()));
    let inward = engine.rings.of(v(0)).iter().filter_map(ahead).find(|edge| edge.other == v(4)).unwrap();
    assert!(engine.propose(v(0), &inward).cost.is_infinite());
}

#[test]
fn locked_seams_stay_whole() {
    let mut engine = Engine::<SurfaceCost>::new(samples::two_charts(12), &Weights::default());
    engine.lock_seams = true;
    engine.run(Stop::Faces(4));
    let mesh = engine.finish();
    for y in 0..=12 {
        let vertex = v(y * 13 + 6);
        assert!(mesh.corners.iter().flatten().any(|&w| mesh.wedge_vertex[w] == vertex), "{vertex:?}");
    }
}

/// A flat square of 12 × 12 with texture coordinates equal to positions, cut into charts that lie 100 apart.
fn in_charts(chart: impl Fn(DVec3) -> u32) -> ClusterMesh {
    let grid = samples::grid(12, 0.0);
    let mut mesh = ClusterMesh::default();
    for &position in &grid.positions {
        mesh.push_vertex(position, 0);
    }
    let mut wedges = std::collections::BTreeMap::new();
    for face in grid.face_ids() {
        let centre = grid.triangle(face).into_iter().sum::<DVec3>() / 3.0;
        let chart = chart(centre);
        let corners = grid.vertices(face).map(|vertex| {
            let uv = grid.positions[vertex].truncate() + DVec2::splat(100.0 * f64::from(chart));
            *wedges.entry((vertex, chart)).or_insert_with(|| mesh.push_wedge(vertex, uv))
        });
        mesh.push_face(corners, PartId::new(0));
    }
    mesh.link_wedges();
    mesh
}

#[test]
fn a_corner_vanishes_along_a_seam_and_the_third_chart_follows_part_of_the_way() {
    let before = in_charts(|centre| if centre.x < 6.0 { 0 } else { 1 + u32::from(centre.y > 6.0) });
    let areas = [
        (DVec2::ZERO, DVec2::new(6.0, 12.0)),
        (DVec2::new(6.0, 0.0), DVec2::new(12.0, 6.0)),
        (DVec2::splat(6.0), DVec2::splat(12.0)),
    ];
    let (mesh, _) = simplified(before, 2);
    assert!(mesh.corner_vertices.iter().flatten().all(|&vertex| vertex != v(84)), "the corner is still there");
    for (corners, vertices) in mesh.corners.iter().zip(&mesh.corner_vertices) {
        let uv = corners.map(|w| mesh.wedge_uv[w]);
        let charts = uv.map(|uv| (uv.x / 100.0).round());
        assert!(charts.iter().all(|&chart| chart == charts[0]), "a face spans charts: {uv:?}");
        assert!((uv[1] - uv[0]).perp_dot(uv[2] - uv[0]) > 0.0, "a folded texture triangle: {uv:?}");
        let (low, high) = areas[charts[0] as usize];
        for (uv, vertex) in uv.into_iter().zip(vertices) {
            let outside = |place: DVec2| place.distance(place.clamp(low, high));
            let (place, surface) = (uv - 100.0 * charts[0], mesh.positions[*vertex].truncate());
            assert!(outside(place) <= 0.75 * outside(surface) + 1e-6, "{place} for {surface} in chart {}", charts[0]);
        }
        assert_eq!(corners.map(|w| mesh.wedge_vertex[w]), *vertices);
    }
}

/// Share of the texture that samples outside its chart, for charts left and right of a staircase.
fn outside_share(inset: f64) -> f64 {
    let is_left = |x: f64, y: f64| x < 6.0 + f64::from(y.rem_euclid(4.0) < 2.0);
    let mesh = in_charts(|centre| u32::from(!is_left(centre.x, centre.y)));
    let weights = Weights { inset, ..Weights::default() };
    let mut engine = Engine::<SurfaceCost>::new(mesh, &weights);
    engine.run(Stop::Faces(16));
    let (mut samples, mut outside) = (0, 0);
    let mesh = engine.finish();
    for face in mesh.face_ids() {
        let uv = mesh.uv_triangle(face);
        let chart = (uv[0].x / 100.0).round();
        for i in 0..20 {
            for j in 0..20 - i {
                let (a, b) = ((f64::from(i) + 0.33) / 20.0, (f64::from(j) + 0.33) / 20.0);
                let at = uv[0] + (uv[1] - uv[0]) * a + (uv[2] - uv[0]) * b - DVec2::splat(100.0 * chart);
                samples += 1;
                outside += u32::from(is_left(at.x, at.y) != (chart == 0.0));
            }
        }
    }
    f64::from(outside) / f64::from(samples)
}

#[test]
fn a_seam_whose_texture_moves_inwards_hardly_leaves_its_charts() {
    let (kept, moved) = (outside_share(0.0), outside_share(1.0));
    assert!(kept > 0.02 && moved < 0.25 * kept, "{kept} {moved}");
}

fn classic(guards: f64) -> crate::cost::classic::ClassicSettings {
    [0.0, 1.0, guards].into()
}

#[test]
fn without_guards_nothing_is_refused_for_its_shape() {
    let refused = |guards: f64| {
        let mut mesh = samples::grid(40, 0.0);
        for (number, position) in mesh.positions.iter_mut().enumerate() {
            position.z = 3.0 * crate::base::chance::unit(crate::base::chance::mixed(number as u64));
        }
        let mut engine = Engine::<crate::cost::ClassicCost>::new(mesh, &classic(guards));
        assert!(engine.run(Stop::Faces(300)).reached);
        [Refusal::Fold, Refusal::UvFold].map(|why| engine.refusals[why as usize])
    };
    let ([folds, uv_folds], without) = (refused(1.0), refused(0.0));
    assert!(folds > 0 && uv_folds > 0, "{folds} {uv_folds}");
    assert_eq!(without, [0; 2]);
}

#[test]
fn one_by_one_each_round_is_the_cheapest_collapse() {
    let mut engine = Engine::<crate::cost::ClassicCost>::new(samples::grid(16, 0.7), &classic(1.0));
    engine.one_by_one = true;
    engine.log = Some(Vec::new());
    assert!(engine.run(Stop::Faces(200)).reached);
    let log = engine.log.as_ref().unwrap();
    assert!(log.len() as u32 <= engine.round && engine.mesh.face_count >= 198);
    assert!(engine.round as usize <= log.len() + 4, "{} rounds for {} collapses", engine.round, log.len());
    // The first collapses are those at the top of a heap of all edges.
    let mut heap = Engine::<crate::cost::ClassicCost>::new(samples::grid(16, 0.7), &classic(1.0));
    heap.prepare();
    heap.cost.refresh(&heap.mesh, &heap.rings, &heap.classes);
    heap.begin_stage();
    heap.judge_all();
    let least = heap.proposals.iter().map(|proposal| proposal.cost).fold(f32::INFINITY, f32::min);
    assert_eq!(log[0].cost, least);
}

#[test]
fn a_vertex_of_many_faces_proposes_its_edges_in_the_order_of_cost() {
    let chance = |i: usize| crate::base::chance::unit(crate::base::chance::mixed(i as u64));
    let vertices = (0..30).map(|i| (DVec3::from_array([0, 1, 2].map(|k| chance(3 * i + k))), DVec2::ZERO));
    let faces: Vec<_> = (1..30u32).map(|i| [0, i, 1 + (7 * i + 3) % 29]).filter(|face| face[1] != face[2]).collect();
    let mut engine = Engine::<SurfaceCost>::new(samples::mesh_of(vertices, &faces), &Weights::default());
    engine.frees_topology = true;
    engine.prepare();
    engine.begin_stage();
    engine.cost.refresh(&engine.mesh, &engine.rings, &engine.classes);
    engine.judge_all();
    assert_eq!(engine.classes[v(0)], Class::Complex);
    let mut in_order = |next: fn(&mut Engine<SurfaceCost>, Bid)| {
        let mut after = Bid::LOWEST;
        std::iter::from_fn(|| {
            next(&mut engine, after);
            let proposal = engine.proposals[v(0)];
            after = proposal.key();
            (proposal.cost.is_finite() && proposal.second_best).then_some(after)
        })
        .collect::<Vec<_>>()
    };
    let expected = in_order(|engine, after| engine.judge(v(0), Some(after)));
    assert_eq!(expected.len(), 28);
    assert_eq!(in_order(|engine, after| engine.judge_after(v(0), after)), expected);
}

#[test]
fn a_component_vanishes_where_another_lies_within_the_bound_of_all_its_points() {
    // The tips of two tetrahedra, each of height 1, are 3 apart, and their bases 1.
    let tetrahedron = |base: f64, tip: f64| {
        let corners = [[0.0, 0.0, base], [1.0, 0.0, base], [0.0, 1.0, base], [0.0, 0.0, tip]];
        corners.map(|corner| (DVec3::from_array(corner), DVec2::NAN))
    };
    let vertices = tetrahedron(1.0, 2.0).into_iter().chain(tetrahedron(0.0, -1.0));
    let walls = [[0, 1, 2], [1, 0, 3], [2, 1, 3], [0, 2, 3]];
    let faces: Vec<[u32; 3]> = [0, 4].into_iter().flat_map(|first| walls.map(|wall| wall.map(|v| first + v))).collect();
    let mesh = samples::mesh_of(vertices, &faces);
    for (most, left) in [(0.5, 8), (0.9, 2), (4.0, 1), (100.0, 1)] {
        let mut engine = Engine::<SurfaceCost>::new(mesh.clone(), &Weights::default());
        engine.frees_topology = true;
        engine.bound_deviation(most);
        for _ in 0..8 {
            engine.run(Stop::Cost(f32::INFINITY, 0));
        }
        assert_eq!((engine.changes().pieces_dropped, engine.mesh.face_count), (2 - left.min(2) as u64, left), "{most}");
        assert!(engine.mesh.deviations.iter().all(|&bound| f64::from(bound) <= most));
    }
}

// Two cones over one rim: collapses onto a tip are refused, so they are neither proposed again nor tried in each round.
#[test]
fn a_hub_is_left_alone_when_its_rim_changes() {
    let count = 600;
    let mut mesh = samples::disc(count);
    mesh.positions[v(0)].z = 1.0;
    let tip = mesh.push_vertex(DVec3::NEG_Z, 0);
    let wedge = mesh.push_wedge(tip, DVec2::ZERO);
    let below: Vec<_> = (0..count).map(|at| [wedge.number(), 1 + (at + 1) % count, 1 + at]).collect();
    samples::add_faces(&mut mesh, &below);
    mesh.link_wedges();
    let mut engine = Engine::<SurfaceCost>::new(mesh, &Weights::default());
    engine.prepare();
    engine.begin_stage();
    engine.cost.refresh(&engine.mesh, &engine.rings, &engine.classes);
    engine.judge_all();
    engine.round = 1;
    let survivor = engine.rings.of(v(5))[0];
    let hub = survivor.face().corners().into_iter().find(|&corner| engine.mesh.vertex_of(corner) == v(0)).unwrap();
    engine.rejudge_neighbour(hub, survivor);
    assert_eq!(engine.stirred[v(0)], 0);
    let edge = EdgeAt { other: v(0), wedges: Default::default(), face_count: 2 };
    assert_eq!(engine.propose(v(5), &edge).cost, f32::INFINITY);
    assert!(engine.run(Stop::Faces(100)).reached);
}
