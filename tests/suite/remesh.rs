//! The mesh made anew by centroidal Voronoi cells: sound, the same whatever the machine has, and dense where it bends.

use crate::meshes::{
    Run, Sketch, assert_sound, in_many_clusters, noise, ratio, read, rms_distance, simplify, simplify_text, terrain,
    torus, town,
};
use drystone::options::{Limits, MetricChoice, SimplifyOptions, Target};
use drystone::remesh::cvd::CvdSettings;
use glam::DVec2;

fn remeshed(settings: &str, options: SimplifyOptions) -> SimplifyOptions {
    SimplifyOptions { remesh: Some(settings.parse().unwrap()), ..options }
}

/// So many cells and nothing else.
fn cells(count: usize) -> SimplifyOptions {
    SimplifyOptions { target: Target::default(), ..remeshed(&format!("cvd:cells={count}"), ratio(1.0)) }
}

fn bytes(run: &Run) -> [Vec<u8>; 1] {
    [std::fs::read(&run.output).unwrap()]
}

#[test]
fn the_town_comes_out_sound_in_one_cluster_and_in_many() {
    let input = read(&town());
    for options in [ratio(0.3), in_many_clusters(ratio(0.3))] {
        let run = simplify(&town(), &remeshed("cvd", options));
        assert_eq!(run.report.remesh.len(), 1);
        assert_sound(&input, &run);
    }
}

#[test]
fn cells_alone_come_out_sound() {
    let input = read(&town());
    let run = simplify(&town(), &in_many_clusters(cells(5000)));
    assert!(run.report.faces.output < run.report.faces.input);
    assert_sound(&input, &run);
}

#[test]
fn threads_and_memory_leave_no_trace() {
    let options = in_many_clusters(remeshed("cvd", ratio(0.3)));
    let expected = bytes(&simplify(&town(), &options));
    for (threads, mebibytes) in [(1, 128), (4, 1024)] {
        let options = SimplifyOptions {
            limits: Limits { threads: Some(threads), memory: Some(mebibytes << 20) },
            ..options.clone()
        };
        assert!(bytes(&simplify(&town(), &options)) == expected, "{threads} threads, {mebibytes} MiB");
    }
}

#[test]
fn threads_and_memory_leave_no_trace_whatever_the_settings_and_what_follows() {
    let with = |metric, settings, options| SimplifyOptions { metric: Some(metric), ..remeshed(settings, options) };
    let optimized = SimplifyOptions { optimize: true, ..remeshed("cvd", ratio(0.3)) };
    let all = [
        cells(3000),
        remeshed("cvd:1,centroidal=1,spring=0.01", ratio(0.3)),
        remeshed("cvd:0,junctions=0,rings=1", ratio(0.5)),
        optimized.clone(),
        with(MetricChoice::Qem1997, "cvd", ratio(0.3)),
        with(MetricChoice::Oblique, "cvd", ratio(0.5)),
        with(MetricChoice::Curvature, "cvd", ratio(0.3)),
        with(MetricChoice::Terrain, "cvd:3", ratio(0.5)),
        SimplifyOptions { metric: Some(MetricChoice::Sharpness), ..optimized },
    ];
    for options in all.map(in_many_clusters) {
        let expected = bytes(&simplify(&town(), &options));
        for (threads, mebibytes) in [(1, 128), (4, 1024)] {
            let other = SimplifyOptions {
                limits: Limits { threads: Some(threads), memory: Some(mebibytes << 20) },
                ..options.clone()
            };
            assert!(bytes(&simplify(&town(), &other)) == expected, "{threads} threads, {mebibytes} MiB: {options:?}");
        }
    }
}

#[test]
fn a_closed_mesh_stays_closed_and_has_the_cells_asked_for() {
    let sketch = torus(160, 60);
    for options in [cells(1500), in_many_clusters(cells(1500))] {
        let run = simplify_text(&sketch.text(), &options);
        let check = run.mesh().check();
        assert_eq!((check.boundary_edges, check.non_manifold_edges, check.inconsistent_edges), (0, 0, 0));
        assert_eq!(check.euler, 0);
        let vertices = run.mesh().surface.positions.len() as f64;
        let most = if run.report.remesh[0].clusters > 1 { 1.25 } else { 1.1 };
        assert!(vertices > 0.9 * 1500.0 && vertices < most * 1500.0, "{vertices}");
    }
}

#[test]
fn many_clusters_err_no_more_than_one() {
    let [one, many] = [ratio(0.3), in_many_clusters(ratio(0.3))].map(|options| {
        let run = simplify(&town(), &remeshed("cvd", options));
        rms_distance(&town(), &run)
    });
    println!("{one} in one cluster, {many} in many: {}", many / one);
    assert!(many <= 1.10 * one, "{one} {many}");
}

/// A sheet whose right half is flat, with an affine picture.
fn half_flat(side: usize) -> Sketch {
    let mut sketch = terrain(side);
    for (i, p) in sketch.positions.iter_mut().enumerate() {
        p.z = if p.x < side as f64 / 2.0 { (0.9 * p.x).sin() * (0.8 * p.y).cos() + 0.1 * noise(i, 0, 9) } else { 0.0 };
    }
    sketch.texcoords = sketch.positions.iter().map(|p| DVec2::new(p.x, p.y) / (2 * side) as f64 + 0.1).collect();
    sketch
}

#[test]
fn flat_ground_holds_far_fewer_vertices_and_the_picture_stays() {
    let side = 60;
    let options = remeshed("cvd", SimplifyOptions { target: Target::ratio(1.0), ..ratio(1.0) });
    let run = simplify_text(&half_flat(side).text(), &options);
    let mesh = run.mesh();
    let inside = |p: &&glam::DVec3| p.x > 3.0 && p.x < side as f64 - 3.0 && p.y > 3.0 && p.y < side as f64 - 3.0;
    let counts = [true, false]
        .map(|left| mesh.surface.positions.iter().filter(inside).filter(|p| (p.x < side as f64 / 2.0) == left).count());
    println!("{counts:?} vertices where it bends and where it is flat");
    assert!(counts[0] > 4 * counts[1], "{counts:?}");
    for (face, texcoords) in mesh.surface.faces.iter().zip(&mesh.surface.face_texcoords) {
        for (v, t) in face.iter().zip(texcoords) {
            let p = mesh.surface.positions[*v];
            let expected = DVec2::new(p.x, p.y) / (2 * side) as f64 + 0.1;
            let uv = mesh.surface.texcoords[*t];
            assert!((uv - expected).length() < 2e-6, "{uv} at {p}");
        }
    }
}

#[test]
fn the_scale_of_the_mesh_changes_nothing() {
    let sketch = half_flat(30);
    let mut large = sketch.clone();
    large.positions.iter_mut().for_each(|p| *p *= 1024.0);
    // More decimals, so that both files say the same places.
    let text = |sketch: &Sketch| {
        let faces = sketch.text().lines().filter(|line| !line.starts_with("v ")).collect::<Vec<_>>().join("\n");
        let positions = sketch.positions.iter().map(|p| format!("v {} {} {}\n", p.x, p.y, p.z));
        positions.collect::<String>() + &faces + "\n"
    };
    let [one, other] = [&sketch, &large].map(|sketch| simplify_text(&text(sketch), &cells(400)).mesh());
    assert_eq!(one.surface.faces, other.surface.faces);
}

#[test]
fn a_turned_mesh_gets_as_many_cells() {
    let sketch = torus(120, 40);
    let mut turned = sketch.clone();
    let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -1.0, 2.2);
    turned.positions.iter_mut().for_each(|p| *p = turn * *p);
    let [one, other] =
        [sketch, turned].map(|sketch| simplify_text(&sketch.text(), &cells(800)).report.remesh.remove(0));
    assert!((one.cell_mass / other.cell_mass - 1.0).abs() < 1e-4, "{one:?} {other:?}");
    let (one, other) = (one.cells as f64, other.cells as f64);
    assert!((one / other - 1.0).abs() < 0.05, "{one} {other}");
}

#[test]
fn mistakes_are_named() {
    for (wrong, words) in [
        ("acvd", "expected cvd"),
        ("cvd:x", "lambda=x: expected 0 to"),
        ("cvd:2,size=4", "known are lambda, cells"),
        ("cvd:cells=-1", "expected 0 to"),
    ] {
        assert!(wrong.parse::<CvdSettings>().unwrap_err().contains(words), "{wrong}");
    }
    let one = "cvd:1,cells=7".parse::<CvdSettings>().unwrap();
    assert_eq!((one.lambda, one.cells), (1.0, Some(7)));
    assert_eq!("cvd".parse::<CvdSettings>().unwrap(), CvdSettings::default());
    assert!(SimplifyOptions { target: Target::ratio(0.1), ..cells(9) }.check().is_err(), "two targets");
    assert!(
        SimplifyOptions { target: remeshed("cvd", ratio(1.0)).target.within(0.1), ..remeshed("cvd", ratio(1.0)) }
            .check()
            .is_err()
    );
    let unbounded = SimplifyOptions { target: Target::max_error(0.1), ..remeshed("cvd", ratio(1.0)) };
    assert!(unbounded.check().is_err());
}
