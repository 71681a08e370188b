//! The deviation that every run measures: near what a comparison finds, in one cluster and in many, and zero only where
//! nothing moved.

use crate::meshes::{Sketch, in_many_clusters, ratio, rms_distance, simplify, simplify_text, terrain, torus, town};
use drystone::options::{SimplifyOptions, Target};
use drystone::report::Report;

fn measured(report: &Report) -> f64 {
    report.error.measured.expect("a result with faces is measured").rms
}

fn check(text: &str, options: &SimplifyOptions) {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("in.obj");
    std::fs::write(&input, text).unwrap();
    let run = simplify(&input, options);
    let (gauge, comparison) = (measured(&run.report), rms_distance(&input, &run));
    assert!((0.88..1.12).contains(&(gauge / comparison)), "{gauge} measured, {comparison} by comparison");
}

#[test]
fn it_is_near_what_a_comparison_finds() {
    for sketch in [terrain(150), torus(150, 60)] {
        for share in [0.5, 0.1, 0.02] {
            check(&sketch.text(), &ratio(share));
            check(&sketch.text(), &in_many_clusters(ratio(share)));
        }
    }
    for share in [0.5, 0.1, 0.02] {
        let run = simplify(&town(), &in_many_clusters(ratio(share)));
        let quotient = measured(&run.report) / rms_distance(&town(), &run);
        // Few points tell of a mesh as small as this where a few triangles make most of the error.
        assert!((0.8..1.25).contains(&quotient), "{share}: {quotient}");
    }
}

#[test]
fn a_mesh_that_stays_as_it_is_does_not_deviate() {
    assert_eq!(measured(&simplify(&town(), &ratio(1.0)).report), 0.0);
}

#[test]
fn a_mesh_made_anew_is_measured_against_the_input() {
    for (remesh, target) in [("cvd", Target::ratio(0.3)), ("cvd:cells=2000", Target::default())] {
        let options = SimplifyOptions { target, remesh: Some(remesh.parse().unwrap()), ..ratio(0.3) };
        for options in [in_many_clusters(options.clone()), options] {
            check(&torus(150, 60).text(), &options);
        }
    }
}

/// A flat square of 10 × 10 squares of which a triangle is left: half of it is gone.
#[test]
fn half_of_a_square_that_is_gone_is_seen() {
    let mut sketch = Sketch::default();
    for i in 0..11 {
        for j in 0..11 {
            sketch.positions.push(glam::DVec3::new(f64::from(i), f64::from(j), 0.0));
        }
    }
    for i in 0..10 {
        for j in 0..10 {
            let at = |i: usize, j: usize| (i * 11 + j, 0);
            sketch.faces.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            sketch.faces.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    for faces in [1, 2, 100] {
        let options = SimplifyOptions { target: Target::faces(faces), ..SimplifyOptions::default() };
        let run = simplify_text(&sketch.text(), &options);
        let is_whole = (run.mesh().area() - 100.0).abs() < 1e-9;
        assert_eq!(measured(&run.report) == 0.0, is_whole, "{faces} faces: {}", measured(&run.report));
    }
}

/// A flat square in which one vertex is raised: a handful of its 20,000 faces are all that a comparison finds changed.
#[test]
fn one_raised_vertex_that_is_gone_is_seen() {
    const SIDE: usize = 101;
    let mut sketch = Sketch::default();
    for i in 0..SIDE {
        for j in 0..SIDE {
            let height = if (i, j) == (88, 45) { 0.5 } else { 0.0 };
            sketch.positions.push(glam::DVec3::new(i as f64, j as f64, height));
        }
    }
    for i in 0..SIDE - 1 {
        for j in 0..SIDE - 1 {
            let at = |i: usize, j: usize| (i * SIDE + j, 0);
            sketch.faces.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            sketch.faces.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    let options = SimplifyOptions { target: Target::faces(2), ..SimplifyOptions::default() };
    for options in [in_many_clusters(options.clone()), options] {
        let folder = tempfile::tempdir().unwrap();
        let input = folder.path().join("in.obj");
        std::fs::write(&input, sketch.text()).unwrap();
        let run = simplify(&input, &options);
        let (gauge, comparison) = (measured(&run.report), rms_distance(&input, &run));
        assert!((0.5..2.0).contains(&(gauge / comparison)), "{gauge} measured, {comparison} by comparison");
    }
}

#[test]
fn the_seconds_of_the_phases_add_up() {
    let seconds = simplify(&town(), &ratio(0.3)).report.seconds;
    let phases = [seconds.scan, seconds.partition, seconds.simplify, seconds.stitch, seconds.write, seconds.measure];
    let sum: f64 = phases.iter().sum();
    assert!(
        seconds.measure > 0.0 && sum <= seconds.total && sum > 0.8 * seconds.total,
        "{phases:?} of {}",
        seconds.total
    );
}
