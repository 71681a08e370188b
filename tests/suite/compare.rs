//! `drystone compare` and `drystone simplify --measure` as a user runs them.

use std::path::Path;
use std::process::{Command, Output};

use crate::meshes::town;
use serde_json::Value;

fn drystone(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_drystone")).args(arguments).output().unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// A tenth of the town, with its report.
fn simplified(folder: &Path) -> (std::path::PathBuf, Value) {
    let (output, report) = (folder.join("out.obj"), folder.join("report.json"));
    let town = town();
    let done = drystone(&[
        "simplify",
        text(&town),
        "-o",
        text(&output),
        "--ratio",
        "0.1",
        "--quiet",
        "--measure",
        "--samples",
        "20000",
        "--report",
        text(&report),
    ]);
    assert_eq!(done.status.code(), Some(0), "{}", String::from_utf8_lossy(&done.stderr));
    (output, json(&report))
}

/// A comparison without what differs from run to run.
fn compared(original: &Path, result: &Path, options: &[&str]) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("c.json");
    let mut arguments =
        vec!["compare", text(original), text(result), "--report", text(&file), "--samples", "20000", "-q"];
    arguments.extend(options);
    let done = drystone(&arguments);
    assert_eq!(done.status.code(), Some(0), "{}", String::from_utf8_lossy(&done.stderr));
    without_cost(json(&file))
}

fn without_cost(mut comparison: Value) -> Value {
    let fields = comparison.as_object_mut().unwrap();
    assert!(fields.remove("seconds").unwrap().as_f64().unwrap() > 0.0);
    assert!(fields.remove("peak_resident").unwrap().as_u64().is_some());
    comparison
}

#[test]
fn a_result_is_compared_in_the_names_that_the_page_promises() {
    let folder = tempfile::tempdir().unwrap();
    let (output, report) = simplified(folder.path());
    let found = compared(&town(), &output, &[]);
    let page = std::fs::read_to_string("docs/reference/comparison.md").unwrap();
    for part in ["geometry", "texture", "pinholes"] {
        for name in found[part].as_object().unwrap().keys() {
            assert!(page.contains(&format!("`{name}")), "docs/reference/comparison.md does not describe {part}.{name}");
        }
    }
    for part in ["topology", "quality"] {
        for name in found[part]["after"].as_object().unwrap().keys() {
            assert!(
                page.contains(&format!("`{name}`")),
                "docs/reference/comparison.md does not describe {part}.{name}"
            );
        }
    }
    for way in ["forward", "backward", "symmetric"] {
        for name in ["max", "mean", "rms", "p95", "p99"] {
            assert!(found["geometry"][way][name].as_f64().unwrap() > 0.0, "{way} {name}");
        }
    }
    for name in ["colour_mean", "colour_rms"] {
        assert!(found["texture"][name].as_f64().unwrap() > 0.0, "{name}");
    }
    // Its walls, roofs and streets show the same pictures over and over.
    for name in ["slide_p95", "outside_fraction"] {
        assert!(found["texture"][name].is_null(), "{name}");
    }
    assert_eq!(found["texture"]["repeated_fraction"], 1.0);
    assert_eq!(found["texture"]["folded_triangles"], 0);
    assert!(found["pinholes"]["ppm"].as_f64().unwrap() < 1000.0, "{}", found["pinholes"]);
    assert!(found["pinholes"]["pixels"].as_u64().unwrap() > 1_000_000);
    assert_eq!(found["topology"]["before"]["faces"], 18_218);
    assert_eq!(found["topology"]["after"]["non_manifold_edges"], 0);
    // the report of the run that made it says the same
    assert_eq!(without_cost(report["comparison"].clone())["geometry"], found["geometry"]);
}

#[test]
fn the_numbers_are_the_same_at_any_budget_and_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let (output, _) = simplified(folder.path());
    let found = compared(&town(), &output, &["--threads", "1", "--memory", "128MiB"]);
    for options in [["--threads", "4", "--memory", "1GiB"], ["--threads", "2", "--memory", "128MiB"]] {
        assert_eq!(compared(&town(), &output, &options), found);
    }
    assert_ne!(compared(&town(), &output, &["--seed", "2"])["geometry"], found["geometry"]);
}

#[test]
fn the_table_is_for_people_and_the_work_folder_goes() {
    let folder = tempfile::tempdir().unwrap();
    let work = folder.path().join("work");
    let town = town();
    let done = drystone(&["compare", text(&town), text(&town), "--samples", "5000", "--work", text(&work), "--quiet"]);
    let table = String::from_utf8(done.stdout).unwrap();
    assert!(table.contains("root mean square") && table.contains("18 218"), "{table}");
    assert!(!work.exists());
}

#[test]
fn impossible_options_are_refused() {
    let town = town();
    for options in [["--samples", "10"], ["--threads", "0"], ["--memory", "1MiB"], ["--texel", "0"], ["--texel", "inf"]]
    {
        let done = drystone(&["compare", text(&town), text(&town), options[0], options[1]]);
        assert_eq!(done.status.code(), Some(2), "{options:?}");
    }
}

#[test]
fn a_polygon_that_is_left_out_is_no_part_of_the_surface() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n";
    std::fs::write(path("square.obj"), square).unwrap();
    for polygon in ["5 6 5 5", "5 6 5", "5 5 6 6 5"] {
        std::fs::write(path("more.obj"), format!("{square}v 50 0 0\nv 50.001 0 0\nf {polygon}\n")).unwrap();
        for [original, result] in [["square.obj", "more.obj"], ["more.obj", "square.obj"]] {
            let found = crate::bake::compared(&path(original), &path(result));
            assert!(found.geometry.symmetric.max < 1e-9, "{polygon}: {:?}", found.geometry);
        }
    }
}
