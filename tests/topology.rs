//! What `--topology` promises: with `simplify` any target is met, and nothing tears; with `keep` the surface stays what
//! it was.

mod meshes;

use drystone::options::{SimplifyOptions, Topology};
use drystone::report::Status;
use glam::DVec3;
use meshes::{Sketch, assert_sound, in_many_clusters, ratio, read, simplify, simplify_text, terrain, torus};

/// Hills with a hole of two triangles in every tenth row and column.
fn sieve() -> Sketch {
    let mut sketch = terrain(60);
    let is_hole = |cell: usize| (cell % 60) % 10 == 5 && (cell / 60) % 10 == 5;
    let mut face = 0;
    sketch.faces.retain(|_| {
        face += 1;
        !is_hole((face - 1) / 2)
    });
    sketch
}

/// Closed tetrahedra of different sizes, side by side.
fn crowd(count: usize) -> Sketch {
    let mut sketch = Sketch::default();
    for i in 0..count {
        let (at, size) = (DVec3::new((i % 20) as f64, (i / 20) as f64, 0.0) * 3.0, 0.2 + (i % 7) as f64 * 0.2);
        let base = sketch.positions.len();
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        sketch.positions.extend(corners.map(|corner| at + corner * size));
        let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        sketch.faces.extend(faces.map(|face| face.map(|corner| (base + corner, base + corner))));
    }
    sketch
}

fn keep(share: f64) -> SimplifyOptions {
    SimplifyOptions { topology: Topology::Keep, ..ratio(share) }
}

#[test]
fn holes_close_when_little_is_left_and_stay_where_the_topology_does() {
    let text = sieve().text();
    for of in [ratio as fn(f64) -> SimplifyOptions, keep] {
        for options in [of(0.004), in_many_clusters(of(0.004))] {
            let run = simplify_text(&text, &options);
            let check = run.mesh().check();
            match options.topology {
                Topology::Simplify => {
                    assert_eq!(run.report.status, Status::Done);
                    assert!(check.boundary_loops < 36, "{check:?}");
                }
                Topology::Keep => assert_eq!(check.boundary_loops, 37, "{check:?}"),
            }
        }
    }
}

#[test]
fn pieces_vanish_smallest_first() {
    let text = crowd(300).text();
    for options in [ratio(0.05), in_many_clusters(ratio(0.05))] {
        let run = simplify_text(&text, &options);
        assert_eq!((run.report.status, run.report.faces.output), (Status::Done, 60));
        let mesh = run.mesh();
        let largest = |text: &Sketch| text.positions.iter().fold(0.0f64, |most, p| most.max(p.z));
        let highest = mesh.surface.positions.iter().fold(0.0f64, |most, p| most.max(p.z));
        assert!(highest > 0.3 * largest(&crowd(300)), "{highest}");
    }
    let kept = simplify_text(&text, &keep(0.05));
    assert_eq!((kept.report.status, kept.report.faces.output), (Status::TargetMissed, 1200));
}

#[test]
fn a_handle_is_cut_where_nothing_else_is_left() {
    let text = torus(60, 30).text();
    let run = simplify_text(&text, &SimplifyOptions { ratio: None, faces: Some(4), ..ratio(1.0) });
    assert_eq!(run.report.status, Status::Done);
    let check = run.mesh().check();
    assert_eq!((check.non_manifold_edges, check.boundary_edges - 3 * check.single_faces), (0, 0), "{check:?}");
    let kept = simplify_text(&text, &SimplifyOptions { ratio: None, faces: Some(4), ..keep(1.0) });
    assert_eq!((kept.report.status, kept.mesh().check().euler), (Status::TargetMissed, 0));
}

#[test]
fn the_same_bytes_come_out_whatever_the_threads_and_the_memory() {
    let text = sieve().text();
    let run = |threads, memory| {
        let options = SimplifyOptions { threads: Some(threads), memory: Some(memory), ..in_many_clusters(ratio(0.01)) };
        simplify_text(&text, &options).text()
    };
    let one = run(1, 128 << 20);
    assert!(run(3, 512 << 20) == one && run(2, 256 << 20) == one);
}

#[test]
fn far_targets_of_the_town_are_met_and_nothing_tears() {
    let town = meshes::town();
    for faces in [1000, 300, 100, 20, 2] {
        for options in [ratio(1.0), in_many_clusters(ratio(1.0))] {
            let run = simplify(&town, &SimplifyOptions { ratio: None, faces: Some(faces), ..options });
            assert_eq!(run.report.status, Status::Done, "{faces}");
            assert_sound(&read(&town), &run);
        }
    }
}
