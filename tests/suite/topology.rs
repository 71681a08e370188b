//! What `--topology` promises: with `simplify` any target is met, and nothing tears; with `keep` the surface stays what
//! it was.

use crate::meshes::{
    Sketch, assert_sound, in_many_clusters, noise, ratio, read, simplify, simplify_text, terrain, torus,
};
use drystone::options::{Limits, SimplifyOptions, Target, Topology};
use drystone::report::{Report, Status};
use glam::DVec3;
use proptest::prelude::*;

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

/// Rooms of `side` × `side` squares a wall: some walls are missing, some there twice, one side or the other out, some of half
/// as many vertices along a side, so that those of their neighbours lie on their edges.
fn rooms(storeys: usize, side: usize, seed: u64) -> Sketch {
    let mut sketch = Sketch::default();
    let mut vertices = std::collections::BTreeMap::new();
    let axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    for wall in 0..storeys * 27 {
        let (origin, turn) = ([wall / 3 % 3, wall / 9 % 3, wall / 27], wall % 3);
        let (across, up) = (axes[turn], axes[(turn + 1) % 3]);
        let kind = noise(wall, turn, seed);
        let step = if kind < 0.2 { 2 } else { 1 };
        let mut vertex = |i: usize, j: usize| {
            let at = [0, 1, 2].map(|axis| side * origin[axis] + i * across[axis] + j * up[axis]);
            let number = *vertices.entry(at).or_insert_with(|| {
                let rough = [0, 1, 2].map(|axis| 0.2 * noise(at[0] * 1000 + at[1], at[2] * 3 + axis, seed));
                sketch.positions.push(DVec3::from_array([0, 1, 2].map(|axis| at[axis] as f64 + rough[axis])));
                sketch.positions.len() - 1
            });
            (number, number)
        };
        for (i, j) in (0..side).step_by(step).flat_map(|i| (0..side).step_by(step).map(move |j| (i, j))) {
            let [a, b, c, d] = [(0, 0), (step, 0), (step, step), (0, step)].map(|(x, y)| vertex(i + x, j + y));
            let front = [[a, b, c], [a, c, d]];
            let back = [[c, b, a], [d, c, a]];
            match kind {
                ..0.2 | 0.5..0.9 => sketch.faces.extend(front),
                0.2..0.35 => sketch.faces.extend(front.into_iter().chain(back)),
                0.35..0.5 => sketch.faces.extend(back),
                _ => {}
            }
        }
    }
    sketch
}

/// A block of `side`³ cubes with all their walls, dented: four walls meet at every inner edge.
fn cells(side: usize, seed: u64) -> Sketch {
    let mut sketch = Sketch::default();
    let mut vertices = std::collections::BTreeMap::new();
    let mut vertex = |at: [usize; 3], sketch: &mut Sketch| {
        *vertices.entry(at).or_insert_with(|| {
            let dent = |axis: usize| 0.2 * noise(at[0] * 100 + at[1], at[2] * 3 + axis, seed);
            sketch.positions.push(DVec3::from_array([0, 1, 2].map(|axis| at[axis] as f64 + dent(axis))));
            sketch.positions.len() - 1
        })
    };
    for wall in 0..3 * side * side * (side + 1) {
        let (turn, x, y, z) = (wall % 3, wall / 3 % side, wall / 3 / side % side, wall / 3 / side / side);
        let [a, b, c, d] = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(i, j)| {
            let mut at = [x + i, y + j, z];
            at.rotate_right(turn);
            let number = vertex(at, &mut sketch);
            (number, number)
        });
        sketch.faces.extend([[a, b, c], [a, c, d]]);
    }
    sketch
}

/// Two sheets of `side` × `side` squares beside each other, with vertices of their own along the gap between them.
fn torn(side: usize, gap: f64, seed: u64) -> Sketch {
    let mut sketch = Sketch::default();
    for sheet in 0..2 {
        let first = sketch.positions.len();
        for (i, j) in (0..=side).flat_map(|j| (0..=side).map(move |i| (i, j))) {
            let along = j as f64 + 0.3 * (noise(i, j + 1000 * sheet, seed) - 0.5);
            let across = i as f64 + sheet as f64 * (side as f64 + gap);
            sketch.positions.push(DVec3::new(across, along, (0.2 * across).sin() + (0.3 * along).cos()));
        }
        for (i, j) in (0..side).flat_map(|j| (0..side).map(move |i| (i, j))) {
            let v = |i: usize, j: usize| (first + j * (side + 1) + i, 0);
            let [a, b, c, d] = [v(i, j), v(i + 1, j), v(i + 1, j + 1), v(i, j + 1)];
            sketch.faces.extend([[a, b, c], [a, c, d]].map(|face| face.map(|(v, _)| (v, v))));
        }
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
    let run = simplify_text(&text, &SimplifyOptions { target: Target::faces(4), ..ratio(1.0) });
    assert_eq!(run.report.status, Status::Done);
    let check = run.mesh().check();
    assert_eq!((check.non_manifold_edges, check.boundary_edges - 3 * check.single_faces), (0, 0), "{check:?}");
    let kept = simplify_text(&text, &SimplifyOptions { target: Target::faces(4), ..keep(1.0) });
    assert_eq!((kept.report.status, kept.mesh().check().euler), (Status::TargetMissed, 0));
}

/// Some blocks of cubes get down to four triangles only if faces fold; all get to two hundred without.
#[test]
fn a_target_is_forced_where_no_other_collapse_is_left() {
    let mut forced = 0;
    for seed in 0..8 {
        let text = cells(4, seed).text();
        let run = |faces| simplify_text(&text, &SimplifyOptions { target: Target::faces(faces), ..ratio(1.0) });
        let [near, far] = [run(200), run(4)];
        for (run, faces) in [(&near, 200), (&far, 4)] {
            let output = run.report.faces.output;
            assert!(output + 2 >= faces && output <= faces.max(12), "{output} of {faces}");
        }
        assert_eq!(near.mesh().check().boundary_edges, 0);
        assert_eq!((near.report.topology.faces_forced, near.report.target_lines().len()), (0, 0));
        let Report { status, topology, faces, .. } = &far.report;
        if topology.faces_forced == 0 {
            assert_eq!(far.mesh().check().folded_edges, 0);
        } else if *status == Status::Done {
            let least = (faces.output + topology.faces_forced) as f64 / faces.input as f64;
            let lines = far.report.target_lines();
            assert!(lines.len() == 1 && lines[0].ends_with(&format!("--ratio {least:.4}")), "{lines:?}");
            forced += 1;
        }
    }
    assert!(forced > 0);
}

#[test]
fn the_same_bytes_come_out_whatever_the_threads_and_the_memory() {
    let text = sieve().text();
    let run = |threads, memory| {
        let options = SimplifyOptions {
            limits: Limits { threads: Some(threads), memory: Some(memory) },
            ..in_many_clusters(ratio(0.01))
        };
        simplify_text(&text, &options).text()
    };
    let one = run(1, 128 << 20);
    assert!(run(3, 512 << 20) == one && run(2, 256 << 20) == one);
}

#[test]
fn far_targets_of_the_town_are_met_and_nothing_tears() {
    let town = crate::meshes::town();
    for faces in [1000, 300, 100, 20, 2] {
        for options in [ratio(1.0), in_many_clusters(ratio(1.0))] {
            let run = simplify(&town, &SimplifyOptions { target: Target::faces(faces), ..options });
            assert_eq!(run.report.status, Status::Done, "{faces}");
            assert_sound(&read(&town), &run);
        }
    }
}

proptest! {
    #![proptest_config(crate::meshes::cases(24, 60))]

    /// Where walls are doubled, a collapse removes up to six faces.
    #[test]
    fn clusters_meet_their_target_together(
        seed in any::<u64>(),
        doubled in 0.0..0.3f64,
        share in 0.2..0.7f64,
        side in 7usize..12,
        cluster_faces in 1_000u64..4_000,
    ) {
        let mut sketch = cells(side, seed);
        for i in (0..sketch.faces.len()).filter(|&i| noise(i, 0, seed) < doubled) {
            let [a, b, c] = sketch.faces[i];
            sketch.faces.push([c, b, a]);
        }
        let run = simplify_text(&sketch.text(), &SimplifyOptions { cluster_faces, ..ratio(share) });
        let (target, output) = (run.report.faces.target, run.report.faces.output);
        prop_assert!(output <= target && output + (target / 1000).max(2) >= target, "{output} of {target}");
    }

    #[test]
    fn a_rip_closes_and_two_sheets_become_one(
        side in 20usize..50,
        gap in 0.01..0.3f64,
        seed in any::<u64>(),
        share in 0.03..0.12f64,
        cluster_faces in prop_oneof![Just(1_000u64), Just(50_000)],
    ) {
        let text = torn(side, gap, seed).text();
        let run = simplify_text(&text, &SimplifyOptions { cluster_faces, ..ratio(share) });
        let check = run.mesh().check();
        prop_assert_eq!(check.components, 1);
        // The outline, and perhaps a hole or two in the rip.
        prop_assert!(check.boundary_loops <= 3, "{:?}", check);
        prop_assert_eq!(simplify_text(&text, &keep(share)).mesh().check().components, 2);
    }

    #[test]
    fn no_result_has_more_non_manifold_or_border_edges(
        storeys in 1usize..4,
        half in 1usize..6,
        seed in any::<u64>(),
        power in -2.5..-0.2f64,
        cluster_faces in prop_oneof![Just(1_000u64), Just(50_000)],
    ) {
        let sketch = rooms(storeys, 2 * half, seed);
        let options = SimplifyOptions { limits: Limits { threads: Some(2), ..ratio(10f64.powf(power)).limits }, cluster_faces, ..ratio(10f64.powf(power)) };
        let run = simplify_text(&sketch.text(), &options);
        let whole = simplify_text(&sketch.text(), &SimplifyOptions { topology: Topology::Keep, ..ratio(1.0) });
        let (before, after) = (whole.mesh().check(), run.mesh().check());
        prop_assert!(after.non_manifold_edges <= before.non_manifold_edges, "{before:?} {after:?}");
        prop_assert!(after.boundary_edges <= before.boundary_edges, "{before:?} {after:?}");
        let (output, target) = (run.report.faces.output, run.report.faces.target);
        let slack = (target / 1000).max(2);
        prop_assert!(output <= target && output + slack >= target, "{output} of {target}");
    }
}
