//! Targets of open and broken meshes: a result is never below its target by more than one collapse, and above it only where
//! the report says so.

use crate::meshes::{Sketch, noise, ratio, rms_distance, simplify, simplify_text, town};
use drystone::options::{FaceTarget, Limits, Pieces, SimplifyOptions, Target, Topology};
use drystone::report::Status;
use glam::DVec3;
use proptest::prelude::*;

/// A grid of columns × rows squares; `bump` is the height of its hills, `turn` bends it around an axis.
fn grid(columns: usize, rows: usize, bump: f64, turn: f64, seed: u64) -> Sketch {
    let mut sketch = Sketch::default();
    for j in 0..=rows {
        for i in 0..=columns {
            let angle = turn * i as f64 / columns as f64;
            let radius = 10.0 + j as f64;
            let flat = DVec3::new(i as f64, j as f64, bump * noise(i, j, seed));
            let bent = DVec3::new(radius * angle.cos(), radius * angle.sin(), flat.z);
            sketch.positions.push(if turn > 0.0 { bent } else { flat });
        }
    }
    for j in 0..rows {
        for i in 0..columns {
            let v = j * (columns + 1) + i;
            let [a, b, c, d] = [v, v + 1, v + columns + 2, v + columns + 1];
            sketch.faces.extend([[a, b, c], [a, c, d]].map(|face| face.map(|v| (v, v))));
        }
    }
    sketch
}

/// Triangles that hang on nothing, and triangles between few vertices.
fn soup(faces: usize, vertices: usize, seed: u64) -> Sketch {
    let mut sketch = Sketch::default();
    for v in 0..vertices.max(3) {
        sketch.positions.push(DVec3::new(noise(v, 0, seed), noise(v, 1, seed), noise(v, 2, seed)) * 10.0);
    }
    for face in 0..faces {
        let first = (noise(face, 3, seed) * vertices as f64) as usize;
        let corner = |k: usize| (first + k * (1 + face % 3)) % vertices.max(3);
        let corners = if vertices < 7 { [0, 1, 2] } else { [corner(0), corner(1), corner(2)] };
        sketch.faces.push(corners.map(|v| (v, v)));
    }
    sketch
}

/// Planes, terrains, strips, discs with a hole, soups: up to some thousands of triangles.
fn open_meshes() -> impl Strategy<Value = Sketch> {
    let sheet = (1usize..60, 1usize..60, prop_oneof![Just(0.0), 0.0..2.0f64], any::<u64>())
        .prop_map(|(columns, rows, bump, seed)| grid(columns, rows, bump, 0.0, seed));
    let strip = (1usize..2000, 1usize..3, 0.0..1.0f64, any::<u64>())
        .prop_map(|(columns, rows, bump, seed)| grid(columns, rows, bump, 0.0, seed));
    let disc = (3usize..60, 1usize..30, 0.0..1.0f64, 1.0..6.2f64, any::<u64>())
        .prop_map(|(columns, rows, bump, turn, seed)| grid(columns, rows, bump, turn, seed));
    let soup =
        (1usize..1500, 7usize..600, any::<u64>()).prop_map(|(faces, vertices, seed)| soup(faces, vertices, seed));
    let islands = (1usize..60, 1usize..8, any::<u64>()).prop_map(|(count, side, seed)| islands(count, side, seed));
    prop_oneof![3 => sheet, 2 => strip, 2 => disc, 1 => soup, 1 => islands]
}

/// Planes and terrains of 20,000 to 100,000 triangles.
fn large_meshes() -> impl Strategy<Value = Sketch> {
    (
        100usize..220,
        100usize..227,
        prop_oneof![Just(0.0), 0.0..2.0f64],
        prop_oneof![Just(0.0), 1.0..6.2f64],
        any::<u64>(),
    )
        .prop_map(|(columns, rows, bump, turn, seed)| grid(columns, rows, bump, turn, seed))
}

/// Adds a copy of a part, scaled and then moved.
fn add(sketch: &mut Sketch, part: &Sketch, size: f64, place: DVec3) {
    let first = sketch.positions.len();
    sketch.positions.extend(part.positions.iter().map(|position| place + size * position));
    sketch.faces.extend(part.faces.iter().map(|face| face.map(|(v, t)| (v + first, t + first))));
}

/// Sheets of up to side × side squares that hang on nothing, of all sizes.
fn islands(count: usize, side: usize, seed: u64) -> Sketch {
    let mut sketch = Sketch::default();
    for island in 0..count {
        let squares = 1 + (noise(island, 0, seed) * side as f64) as usize;
        let part = grid(squares, squares, 1.0, 0.0, seed ^ island as u64);
        let corner = DVec3::new(noise(island, 2, seed), noise(island, 3, seed), 0.0) * 500.0;
        add(&mut sketch, &part, noise(island, 1, seed), corner);
    }
    sketch
}

/// Runs, and tells where the result is below its target, or above it with a report that says otherwise.
fn check_target(sketch: &Sketch, options: &SimplifyOptions) -> Result<(), TestCaseError> {
    let run = simplify_text(&sketch.text(), options);
    let (left, target) = (run.mesh().face_count() as f64, run.report.faces.target as f64);
    let tolerance = (0.001 * target).max(2.0);
    prop_assert!(left >= target - tolerance, "{left} of {target}");
    let is_met = matches!(run.report.status, Status::Done);
    prop_assert_eq!(is_met, left <= target, "{} of {}, {:?}", left, target, run.report.status);
    Ok(())
}

proptest! {
    #![proptest_config(crate::meshes::cases(64, 300))]

    #[test]
    fn no_result_is_below_its_target_by_more_than_one_collapse(
        sketch in open_meshes(),
        power in -5.0..-0.3f64,
        in_many_clusters in any::<bool>(),
        drop_pieces in any::<bool>(),
        keep_topology in any::<bool>(),
        passes in 1usize..8,
    ) {
        let options = SimplifyOptions {
            target: Target::ratio(10f64.powf(power)),
            limits: Limits { memory: Some(256 << 20), threads: Some(1) },
            cluster_faces: if in_many_clusters { 1000 } else { 50_000 },
            pieces: if drop_pieces { Pieces::Drop } else { Pieces::Keep },
            topology: if keep_topology { Topology::Keep } else { Topology::Simplify },
            passes,
            ..SimplifyOptions::default()
        };
        check_target(&sketch, &options)?;
    }
}

proptest! {
    #![proptest_config(crate::meshes::cases(3, 20))]

    #[test]
    fn no_large_result_is_below_its_target(sketch in large_meshes(), power in -5.0..-0.3f64, cluster_faces in 5_000u64..120_000) {
        let target = Target::ratio(10f64.powf(power));
        let limits = Limits { threads: Some(2), ..Limits::default() };
        check_target(&sketch, &SimplifyOptions { target, limits, cluster_faces, ..SimplifyOptions::default() })?;
    }
}

// A hill of 128 triangles and 100 sheets of two, of which a pass drops more than its collapses remove
#[test]
fn dropped_pieces_count_as_faces_that_a_pass_removes() {
    let mut sketch = grid(8, 8, 2.0, 0.0, 3);
    for sheet in 0..100 {
        let place = DVec3::new(50.0 + 3.0 * f64::from(sheet), 0.0, 0.0);
        add(&mut sketch, &grid(1, 1, 0.0, 0.0, 0), 0.1, place);
    }
    for (target, passes) in [(100, 5), (60, 4), (60, 6), (40, 4), (20, 5)] {
        let options = SimplifyOptions {
            target: Target::faces(target),
            topology: Topology::Keep,
            pieces: Pieces::Drop,
            passes,
            ..SimplifyOptions::default()
        };
        check_target(&sketch, &options).unwrap_or_else(|fault| panic!("{target} in {passes} passes: {fault}"));
    }
}

// A terrain of 12,800 triangles in many clusters, and 2,500 sheets of two, as small as its squares and smaller: a cluster
// that a trim leaves as it is drops none of them
#[test]
fn dropped_pieces_of_a_trim_count_as_well() {
    let mut sketch = grid(80, 80, 1.0, 0.0, 3);
    for sheet in 0..2500 {
        let place = DVec3::new(noise(sheet, 0, 5) * 80.0, noise(sheet, 1, 5) * 80.0, 3.0);
        add(&mut sketch, &grid(1, 1, 0.0, 0.0, 0), 0.02 * 40f64.powf(noise(sheet, 2, 5)), place);
    }
    for target in [4400, 4600, 4800, 5000, 5200, 5400] {
        let options = SimplifyOptions {
            target: Target::faces(target),
            topology: Topology::Keep,
            pieces: Pieces::Drop,
            cluster_faces: 1000,
            ..SimplifyOptions::default()
        };
        check_target(&sketch, &options).unwrap_or_else(|fault| panic!("{target}: {fault}"));
    }
}

// 20,000 triangles, as flat as can be: the exact result has two
#[test]
fn a_flat_plane_keeps_its_area_at_any_target() {
    for faces in [2, 5, 60, 400] {
        let options = SimplifyOptions {
            target: Target::faces(faces),
            limits: Limits { threads: Some(2), ..Limits::default() },
            ..SimplifyOptions::default()
        };
        let run = simplify_text(&grid(100, 100, 0.0, 0.0, 1).text(), &options);
        let mesh = run.mesh();
        assert!(mesh.face_count() + 1 >= faces && mesh.face_count() <= faces, "{} of {faces}", mesh.face_count());
        assert!((mesh.area() - 10_000.0).abs() < 1e-3, "{} at {faces} faces", mesh.area());
    }
}

#[test]
fn a_target_and_a_bound_end_a_run_whichever_comes_first() {
    let text = grid(60, 60, 1.0, 0.0, 7).text();
    let run = |faces: Option<u64>, max_error: Option<f64>, cluster_faces: u64| {
        let threads = Some(2);
        let options = SimplifyOptions {
            target: Target { faces: faces.map(FaceTarget::Count), max_error },
            limits: Limits { threads, ..Limits::default() },
            cluster_faces,
            ..SimplifyOptions::default()
        };
        let run = simplify_text(&text, &options);
        assert_eq!(run.report.status, Status::Done);
        run.mesh().face_count()
    };
    for cluster_faces in [1000, 50_000] {
        let bounded = run(None, Some(0.05), cluster_faces);
        assert!((2000..7200).contains(&bounded), "{bounded}");
        let both = run(Some(100), Some(0.05), cluster_faces);
        assert!((bounded as f64 * 0.9..bounded as f64 * 1.1).contains(&(both as f64)), "{both} for {bounded}");
        assert!((998..=1000).contains(&run(Some(1000), Some(100.0), cluster_faces)));
    }
}

/// Whoever also asks for a number of faces gets it if the bound alone allows it, and else what the bound allows.
#[test]
fn a_target_beside_a_bound_costs_no_faces() {
    for (cluster_faces, bound) in [(50_000, 0.2), (50_000, 1.0), (2_000, 0.2), (2_000, 1.0)] {
        let run = |target: Target| {
            let options = SimplifyOptions { target, cluster_faces, ..SimplifyOptions::default() };
            let run = simplify(&town(), &options);
            assert_eq!(run.report.status, Status::Done);
            run.report.faces.output as f64
        };
        let alone = run(Target::max_error(bound));
        for share in [0.05, 0.5, 0.9, 1.1, 1.5, 2.0, 3.0] {
            let target = (alone * share) as u64;
            let both = run(Target::faces(target).within(bound));
            let most = (target as f64).max(1.1 * alone);
            assert!(both <= most, "{both} triangles of {target}, by the bound of {bound} alone {alone}");
            let spare = (target as f64 / 1000.0).max(2.0);
            assert!(both >= target as f64 - spare, "{both} triangles of {target}");
        }
    }
}

/// Who asks for the impossible gets what they would have got for asking for as much as is possible.
#[test]
fn a_missed_target_ruins_nothing() {
    for share in [0.002, 0.0005] {
        let keep = SimplifyOptions { topology: Topology::Keep, ..ratio(share) };
        let missed = simplify(&town(), &keep);
        assert_eq!(missed.report.status, Status::TargetMissed);
        let asked = SimplifyOptions { target: Target::faces(missed.report.faces.output), ..keep };
        let asked = simplify(&town(), &asked);
        let [missed, asked] = [missed, asked].map(|run| rms_distance(&town(), &run));
        assert!(missed < 1.3 * asked, "{missed} at a ratio of {share}, asked for as many faces {asked}");
    }
}
