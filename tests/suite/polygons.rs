//! Polygons are cut the same way wherever a mesh is read: to be simplified, checked or inspected.

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use crate::meshes::{cases, noise};
use proptest::prelude::*;
use serde_json::Value;

/// A grid of quads, bent in space; where `merge` says so, two of them are one polygon of six corners. Corners begin
/// anywhere, and with `repeats` one of some polygons comes twice.
fn polygons(side: usize, bump: f64, merge: f64, repeats: bool, seed: u64) -> String {
    let mut text = String::new();
    for i in 0..=side {
        for j in 0..=side {
            let play = |stream| 0.45 * (noise(i, j, seed + stream) - 0.5);
            let (x, y, z) = (i as f64 + play(1), j as f64 + play(2), bump * noise(i, j, seed + 3));
            let _ = writeln!(text, "v {x:.6} {y:.6} {z:.6}");
        }
    }
    let at = |i: usize, j: usize| i * (side + 1) + j + 1;
    for i in 0..side {
        let mut j = 0;
        while j < side {
            let is_merged = j + 1 < side && noise(i, j, seed + 4) < merge;
            let mut corners = if is_merged {
                vec![at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i + 1, j + 2), at(i, j + 2), at(i, j + 1)]
            } else {
                vec![at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]
            };
            j += if is_merged { 2 } else { 1 };
            let first = (noise(i, j, seed + 5) * corners.len() as f64) as usize;
            corners.rotate_left(first);
            if repeats && noise(i, j, seed + 6) < 0.1 {
                corners.insert(2, corners[1]);
            }
            let words: Vec<String> = corners.iter().map(usize::to_string).collect();
            let _ = writeln!(text, "f {}", words.join(" "));
        }
    }
    text
}

fn drystone(folder: &Path, words: &[&str]) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_drystone")).args(words).current_dir(folder).output().unwrap();
    (output.status.code(), String::from_utf8(output.stdout).unwrap())
}

fn count(json: &str, name: &str) -> u64 {
    let all = serde_json::from_str::<Value>(json).unwrap();
    all.get("after").unwrap_or(&all)[name].as_u64().unwrap()
}

proptest! {
    #![proptest_config(cases(24, 24))]
    #[test]
    fn a_check_tells_nothing_new_of_a_mesh_that_only_passed_through(
        (side, bump, merge) in (1usize..12, 0.0f64..3.0, 0.0f64..0.6),
        repeats in any::<bool>(),
        seed in 0u64..1000,
    ) {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        std::fs::write(folder.join("in.obj"), polygons(side, bump, merge, repeats, seed)).unwrap();
        let (code, _) = drystone(folder, &["simplify", "in.obj", "-o", "out.obj", "--ratio", "1", "--quiet"]);
        prop_assert_eq!(code, Some(0));
        let (code, told) = drystone(folder, &["check", "out.obj", "--against", "in.obj"]);
        prop_assert_eq!(code, Some(0), "{}", told);
        let [before, after] = ["in.obj", "out.obj"].map(|name| drystone(folder, &["check", name, "--json"]).1);
        prop_assert_eq!(count(&before, "faces"), count(&after, "faces"));
        if !repeats {
            let inspected = drystone(folder, &["inspect", "in.obj", "--json"]).1;
            prop_assert_eq!(count(&inspected, "triangles"), count(&before, "faces"));
        }
    }
}
