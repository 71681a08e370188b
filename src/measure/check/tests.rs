use std::collections::BTreeSet;

use super::super::surface::tests::bare;
use super::*;
use crate::base::pool::Pool;
use crate::base::{Error, Progress};
use crate::model::id::{MaterialId, Texcoord};
use proptest::prelude::*;

//       3
//      /|\
//     / | \
//    0--|--2
//     \ | /
//       1
const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
const TETRAHEDRON_POSITIONS: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

#[test]
fn a_tetrahedron_is_closed() {
    let counts = check(&bare(&TETRAHEDRON_POSITIONS, &TETRAHEDRON)).unwrap();
    assert_eq!(counts, Check { vertices: 4, faces: 4, components: 1, euler: 2, ..Check::default() });
}

#[test]
fn a_hole_is_one_loop() {
    let counts = check(&bare(&TETRAHEDRON_POSITIONS, &TETRAHEDRON[1..])).unwrap();
    assert_eq!((counts.boundary_edges, counts.boundary_loops, counts.euler), (3, 1, 1));
}

#[test]
fn a_vertex_in_the_middle_of_an_edge_is_a_t_junction() {
    // 3 --------- 2
    // |      .    |
    // 0 --- 4 --- 1      0 1 is an edge above, 0 4 and 4 1 are edges below
    //  \  . | .  /
    //   5       6
    let positions = [
        [0.0, 0.0, 0.0],
        [2.0, 0.0, 0.0],
        [2.0, 1.0, 0.0],
        [0.0, 1.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.5, -1.0, 0.0],
        [1.5, -1.0, 0.0],
    ];
    let counts = check(&bare(&positions, &[[0, 1, 2], [0, 2, 3], [0, 5, 4], [4, 6, 1]])).unwrap();
    assert_eq!((counts.t_junctions, counts.boundary_loops), (1, 1));
    // without 4 the two sides fit
    let counts = check(&bare(&positions, &[[0, 1, 2], [0, 2, 3], [0, 5, 1]])).unwrap();
    assert_eq!((counts.t_junctions, counts.unused_vertices), (0, 2));
}

#[test]
fn a_bow_tie_has_two_fans_at_its_knot() {
    // 0       3
    // | \   / |
    // |   2   |
    // | /   \ |
    // 1       4
    let positions = [[0.0, 2.0, 0.0], [0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [2.0, 2.0, 0.0], [2.0, 0.0, 0.0]];
    let counts = check(&bare(&positions, &[[0, 1, 2], [2, 4, 3]])).unwrap();
    assert_eq!((counts.non_manifold_vertices, counts.components, counts.boundary_loops), (1, 2, 1));
}

#[test]
fn three_faces_on_an_edge_are_non_manifold() {
    //    2  3
    //    |/            three pages of a book with the spine 0 1
    //  4-0 (1 behind)
    let positions = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 0.0, 0.0]];
    let counts = check(&bare(&positions, &[[0, 1, 2], [1, 0, 3], [0, 1, 4]])).unwrap();
    assert_eq!((counts.non_manifold_edges, counts.non_manifold_vertices, counts.components), (1, 0, 1));
    assert_eq!((counts.boundary_edges, counts.inconsistent_edges), (6, 0));
}

#[test]
fn a_moebius_strip_has_an_inconsistent_edge() {
    // 1 - 3 - 5 . . 0      the right end is glued to the left one upside down
    // | \ | \ | \ . |
    // 0 - 2 - 4 . . 1
    let positions = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0].map(|x: f64| [x, x * x, x * x * x]);
    let faces = [[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5], [4, 1, 5], [5, 1, 0]];
    let counts = check(&bare(&positions, &faces)).unwrap();
    assert_eq!((counts.boundary_edges, counts.boundary_loops, counts.euler), (6, 1, 0));
    assert_eq!((counts.non_manifold_edges, counts.inconsistent_edges), (0, 1));
}

#[test]
fn a_cube_of_24_vertices_is_closed_after_welding() {
    //   6 - 7
    //  /|  /|     every side has four corners of its own
    // 4 - 5 |
    // | 2 | 3
    // |/  |/
    // 0 - 1
    let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let (mut positions, mut faces) = (Vec::new(), Vec::new());
    for side in sides {
        let first = positions.len() as u32;
        positions.extend(side.map(|v: u32| [f64::from(v & 1), f64::from(v >> 1 & 1), f64::from(v >> 2)]));
        faces.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    let cube = bare(&positions, &faces);
    let counts = check(&cube).unwrap();
    assert_eq!((counts.boundary_edges, counts.boundary_loops, counts.components), (24, 6, 6));
    let counts = weld_and_check(&cube).unwrap();
    assert_eq!(counts, Check { vertices: 8, faces: 12, components: 1, euler: 2, ..Check::default() });
}

#[test]
fn faces_without_three_places_or_without_area_are_counted() {
    let positions = [[0.0; 3], [0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let counts = weld_and_check(&bare(&positions, &[[0, 1, 2], [0, 2, 3], [0, 2, 4], [4, 1, 2]])).unwrap();
    assert_eq!((counts.faces, counts.degenerate_faces, counts.zero_area_faces, counts.duplicate_faces), (3, 1, 1, 1));
}

#[test]
fn a_line_far_from_the_origin_has_no_area() {
    // in decimals the three lie on a line; their nearest binary numbers at this distance do not
    let positions = [[500_000.1, 5_600_000.1, 0.0], [500_000.2, 5_600_000.2, 0.0], [500_000.4, 5_600_000.4, 0.0]];
    assert_eq!(check(&bare(&positions, &[[0, 1, 2]])).unwrap().zero_area_faces, 1);
}

#[test]
fn only_what_is_worse_is_new() {
    let closed = check(&bare(&TETRAHEDRON_POSITIONS, &TETRAHEDRON)).unwrap();
    let open = check(&bare(&TETRAHEDRON_POSITIONS, &TETRAHEDRON[1..])).unwrap();
    assert_eq!(compare_checks(&closed, &closed), []);
    assert_eq!(compare_checks(&open, &closed), []);
    let new: Vec<String> = compare_checks(&closed, &open).iter().map(Regression::to_string).collect();
    assert_eq!(
        new,
        ["open edges of a closed mesh: 0 before, 3 after", "boundary loops of more edges: 0 before, 1 after"]
    );
    let holes: Vec<String> = compare_topology(&closed, &open).iter().map(Regression::to_string).collect();
    assert_eq!(holes, ["boundary loops: 0 before, 1 after"]);
    let apart = Check { components: 2, ..closed };
    let changed: Vec<String> = compare_topology(&closed, &apart).iter().map(Regression::to_string).collect();
    assert_eq!(changed, ["components: 1 before, 2 after"]);
    let more_open_edges = Check { boundary_edges: 5, ..open };
    let folded = Check { folded_edges: 2, ..closed };
    assert_eq!(compare_checks(&folded, &folded), []);
    assert_eq!(compare_checks(&closed, &folded).len(), 1);
    assert_eq!(compare_checks(&open, &more_open_edges), []);
    // What is left of a component is no crack, and an edge that lost a face may show a fold.
    let single = check(&bare(&TETRAHEDRON_POSITIONS, &TETRAHEDRON[..1])).unwrap();
    assert_eq!((single.single_faces, compare_checks(&closed, &single)), (1, vec![]));
    assert_eq!(compare_checks(&Check { non_manifold_edges: 2, ..closed }, &folded), []);
}

/// Counts by looking at everything for everything.
fn brute_force(faces: &[[u32; 3]]) -> Check {
    let faces: Vec<_> = faces.iter().copied().filter(|face| !repeats_vertex(*face)).collect();
    let sides = |[a, b, c]: [u32; 3]| [[a, b], [b, c], [c, a]];
    let undirected = |[a, b]: [u32; 2]| [a.min(b), a.max(b)];
    let vertices: BTreeSet<u32> = faces.iter().flatten().copied().collect();
    let edges: BTreeSet<[u32; 2]> = faces.iter().flat_map(|&face| sides(face)).map(undirected).collect();
    let mut counts = Check { vertices: vertices.len() as u64, faces: faces.len() as u64, ..Check::default() };
    counts.euler = vertices.len() as i64 - edges.len() as i64 + faces.len() as i64;
    let mut boundary = Vec::new();
    for &edge in &edges {
        let along: Vec<[u32; 2]> = faces.iter().flat_map(|&f| sides(f)).filter(|&s| undirected(s) == edge).collect();
        match along[..] {
            [_] => boundary.push(edge),
            [a, b] => counts.inconsistent_edges += u64::from(a == b),
            _ => counts.non_manifold_edges += 1,
        }
    }
    counts.boundary_edges = boundary.len() as u64;
    counts.boundary_loops = flood(&boundary, |a, b| a.iter().any(|v| b.contains(v)));
    let meet = |a: &[u32; 3], b: &[u32; 3]| a.iter().filter(|v| b.contains(v)).count() >= 2;
    counts.components = flood(&faces, meet);
    for &vertex in &vertices {
        let around: Vec<_> = faces.iter().copied().filter(|face| face.contains(&vertex)).collect();
        counts.non_manifold_vertices += u64::from(flood(&around, meet) > 1);
    }
    counts
}

/// Number of connected sets of items.
fn flood<T>(items: &[T], meet: impl Fn(&T, &T) -> bool) -> u64 {
    let (mut seen, mut sets) = (vec![false; items.len()], 0);
    for start in 0..items.len() {
        sets += u64::from(!seen[start]);
        let mut pending = vec![start];
        while let Some(i) = pending.pop() {
            if !std::mem::replace(&mut seen[i], true) {
                pending.extend((0..items.len()).filter(|&j| !seen[j] && meet(&items[i], &items[j])));
            }
        }
    }
    sets
}

proptest! {
    #[test]
    fn counts_on_a_soup_are_those_of_a_plain_search(
        positions in prop::collection::vec(prop::array::uniform3(-3i8..3), 9),
        faces in prop::collection::vec(prop::array::uniform3(0u32..9), 0..24),
        texcoords in prop::collection::vec(prop::array::uniform3(prop_oneof![0u32..5, Just(u32::MAX)]), 24),
    ) {
        let positions: Vec<_> = positions.into_iter().map(|p| p.map(f64::from)).collect();
        let mut surface = bare(&positions, &faces);
        surface.texcoords = (0..5).map(|i| glam::DVec2::new(f64::from(i % 2), f64::from(i / 2))).collect();
        surface.face_texcoords = texcoords[..faces.len()].iter().map(|face| face.map(Texcoord::new)).collect();
        for surface in [surface.welded().unwrap(), surface] {
            let counts = check(&surface).unwrap();
            let faces: Vec<_> = surface.faces.iter().map(|face| face.map(MeshVertex::number)).collect();
            let expected = brute_force(&faces);
            let topology_of = |c: &Check| Check {
                vertices: c.vertices,
                faces: c.faces,
                boundary_edges: c.boundary_edges,
                boundary_loops: c.boundary_loops,
                non_manifold_edges: c.non_manifold_edges,
                inconsistent_edges: c.inconsistent_edges,
                non_manifold_vertices: c.non_manifold_vertices,
                components: c.components,
                euler: c.euler,
                ..Check::default()
            };
            prop_assert_eq!(topology_of(&counts), expected);
            prop_assert!(border_is_its_own(&surface));
        }
    }
}

fn border_is_its_own(surface: &Surface) -> bool {
    let border = super::super::border::border_of(surface);
    super::super::border::border_deviation(&border, &border).max < 1e-9
}

//  3 lies almost on 2, on the other side of the edge 0 - 1
#[test]
fn faces_that_lie_on_each_other_are_folded() {
    let folded = |height: f64, y: f64| {
        let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 1.0, 0.0], [0.5, y, height]];
        check(&bare(&positions, &[[0, 1, 2], [1, 0, 3]])).unwrap().folded_edges
    };
    assert_eq!([folded(0.05, 1.0), folded(0.2, 1.0), folded(0.0, 0.3), folded(0.0, -1.0)], [1, 0, 1, 0]);
}

/// A strip of two faces with the given texture coordinates.
fn strip(texcoords: &[[f64; 2]], face_texcoords: [[u32; 3]; 2], face_materials: [u32; 2]) -> Check {
    // 2 - 3
    // | \ |
    // 0 - 1
    let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
    let mut surface = bare(&positions, &[[0, 1, 2], [2, 1, 3]]);
    surface.texcoords = texcoords.iter().map(|&t| t.into()).collect();
    surface.face_texcoords = face_texcoords.iter().map(|face| face.map(Texcoord::new)).collect();
    surface.face_materials = face_materials.iter().copied().map(MaterialId::new).collect();
    check(&surface).unwrap()
}

const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];

#[test]
fn a_flat_chart_has_no_fold() {
    let counts = strip(&SQUARE, [[0, 1, 2], [2, 1, 3]], [0, 0]);
    assert_eq!((counts.charts, counts.seam_edges), (1, 0));
    assert_eq!(counts.uv, UvCounts { uv_positive: 2, ..UvCounts::default() });
}

#[test]
fn a_triangle_turned_over_in_its_chart_is_folded() {
    // the last corner lies on the near side of the diagonal: the second triangle covers part of the first one
    // 2
    // |'.\
    // | 3 \
    // 0 - - 1
    let texcoords = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.3, 0.3]];
    let counts = strip(&texcoords, [[0, 1, 2], [2, 1, 3]], [0, 0]);
    assert_eq!((counts.charts, counts.uv.folded_uv, counts.uv.uv_negative), (1, 1, 1));
}

#[test]
fn a_mirrored_chart_is_not_folded() {
    // the second face has its own texture coordinates, in which left and right are exchanged
    let texcoords = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [2.0, 0.0], [3.0, 1.0], [2.0, 1.0]];
    let counts = strip(&texcoords, [[0, 1, 2], [3, 5, 4]], [0, 0]);
    assert_eq!((counts.charts, counts.seam_edges, counts.uv.folded_uv), (2, 1, 0));
    assert_eq!((counts.uv.uv_positive, counts.uv.uv_negative), (1, 1));
}

#[test]
fn a_triangle_that_shows_its_back_is_in_a_chart_of_its_own() {
    let mut surface =
        bare(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]], &[[0, 1, 2], [1, 2, 3]]);
    surface.texcoords = SQUARE.iter().map(|&t| t.into()).collect();
    surface.face_texcoords = surface.faces.iter().map(|face| face.map(|v| Texcoord::new(v.number()))).collect();
    let counts = check(&surface).unwrap();
    assert_eq!((counts.charts, counts.seam_edges, counts.uv.folded_uv), (2, 0, 0));
    assert_eq!((counts.uv.uv_positive, counts.uv.uv_negative), (1, 1));
}

#[test]
fn texture_coordinates_are_compared_by_value() {
    let texcoords = [SQUARE[0], SQUARE[1], SQUARE[2], SQUARE[3], SQUARE[2], SQUARE[1]];
    let counts = strip(&texcoords, [[0, 1, 2], [4, 5, 3]], [0, 0]);
    assert_eq!((counts.charts, counts.seam_edges), (1, 0));
}

#[test]
fn a_material_border_is_a_seam() {
    let counts = strip(&SQUARE, [[0, 1, 2], [2, 1, 3]], [0, 1]);
    assert_eq!((counts.charts, counts.seam_edges), (2, 1));
}

#[test]
fn faces_without_texture_are_in_no_chart() {
    let counts = strip(&SQUARE, [[0, 1, 2], [u32::MAX; 3]], [0, 0]);
    assert_eq!((counts.charts, counts.seam_edges, counts.uv.uv_positive), (1, 1, 1));
}

#[test]
fn a_triangle_on_a_line_of_texture_space_is_degenerate() {
    let texcoords = [[0.1, 0.1], [0.2, 0.2], [0.7, 0.7], [0.9, 0.3]];
    let counts = strip(&texcoords, [[0, 1, 2], [2, 1, 3]], [0, 0]);
    assert_eq!((counts.uv.uv_degenerate, counts.uv.folded_uv), (1, 0));
}

/// Asks the job to stop.
struct Stopping;

impl Progress for Stopping {
    fn begin(&self, _phase: &'static str, _total: u64, _unit: &'static str) {}

    fn advance(&self, _units: u64) {}

    fn is_stopped(&self) -> bool {
        true
    }
}

#[test]
fn each_step_of_a_check_looks_whether_it_is_to_stop() {
    let surface = bare(&TETRAHEDRON_POSITIONS, &TETRAHEDRON[1..]);
    let edges = EdgeTable::new(&surface.faces);
    let boundary = edges.boundary();
    let steps: [(&str, &(dyn Fn() -> Result<()> + Sync)); 8] = [
        ("weld", &|| surface.welded().map(drop)),
        ("edge table", &|| EdgeTable::of_whole(&surface.faces).map(drop)),
        ("edges", &|| edges.try_for_each(|_| {})),
        ("count", &|| count(&surface, &edges, |_, _| {}).map(drop)),
        ("fans", &|| count_non_manifold_vertices(&surface, &edges).map(drop)),
        ("single faces", &|| count_single_faces(&surface.faces, &edges).map(drop)),
        ("duplicates", &|| count_duplicates(&surface.faces).map(drop)),
        ("T-junctions", &|| count_t_junctions(&surface.positions, &boundary, 1e-6).map(drop)),
    ];
    for (name, step) in steps {
        assert!(step().is_ok(), "{name}");
        let stopped = Pool::new(1).unwrap().run(&Stopping, step);
        assert!(matches!(stopped, Err(Error::Stopped)), "{name}");
    }
}
