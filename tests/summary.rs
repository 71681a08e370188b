//! What `drystone simplify` prints for scripts: the summary, one JSON object, exit codes.

use std::path::Path;
use std::process::{Command, Output};

const TOWN: &str = "fixtures/town/town.obj";

fn drystone(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_drystone")).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn simplify(folder: &Path, input: &str, more: &[&str]) -> Output {
    let output = folder.join("out.obj");
    drystone(&[&["simplify", input, "-o", output.to_str().unwrap(), "--force"], more].concat())
}

#[test]
fn the_summary_has_the_status_also_in_quiet_runs() {
    let folder = tempfile::tempdir().unwrap();
    let run = simplify(folder.path(), TOWN, &["--ratio", "0.5", "--quiet"]);
    assert!(text(&run.stdout).starts_with("status: done\n"), "{}", text(&run.stdout));
    assert_eq!((run.status.code(), text(&run.stderr).as_str()), (Some(0), ""));
    let cube = "fixtures/miniatures/cube_24_vertices.obj";
    let run = simplify(folder.path(), cube, &["--faces", "1", "--quiet"]);
    assert_eq!(run.status.code(), Some(3));
    assert!(text(&run.stdout).starts_with("status: target-missed\n"), "{}", text(&run.stdout));
}

#[test]
fn a_failed_run_prints_one_json_object() {
    let folder = tempfile::tempdir().unwrap();
    let run = simplify(folder.path(), "not/there.obj", &["--ratio", "0.5", "--format", "json"]);
    let found: serde_json::Value = serde_json::from_slice(&run.stdout).unwrap();
    assert_eq!((run.status.code(), &found["exit_code"], &found["status"]), (Some(4), &4.into(), &"failed".into()));
    assert!(found["error"].as_str().unwrap().contains("not/there.obj"), "{found}");
    let run = simplify(folder.path(), TOWN, &["--ratio", "0.5", "--format", "json"]);
    let found: serde_json::Value = serde_json::from_slice(&run.stdout).unwrap();
    assert_eq!((run.status.code(), &found["status"]), (Some(0), &"done".into()));
}

#[test]
fn the_switch_of_other_commands_points_to_the_format() {
    let folder = tempfile::tempdir().unwrap();
    let run = simplify(folder.path(), TOWN, &["--ratio", "0.5", "--json"]);
    assert_eq!(run.status.code(), Some(2));
    assert!(text(&run.stderr).contains("--format json"), "{}", text(&run.stderr));
}

#[test]
fn the_report_has_every_option_that_was_given() {
    let folder = tempfile::tempdir().unwrap();
    let options = |more: &[&str]| {
        let run = simplify(folder.path(), TOWN, &[&["--ratio", "0.5", "--format", "json", "-q"], more].concat());
        serde_json::from_slice::<serde_json::Value>(&run.stdout).unwrap()["options"].clone()
    };
    let given = options(&["--measure", "--samples", "2000", "--seed", "7", "--exclude", "*_lod*"]);
    assert_eq!(given["measure"], true);
    assert_eq!((given["samples"].as_u64(), given["seed"].as_u64()), (Some(2000), Some(7)));
    assert_eq!(given["exclude"], serde_json::json!(["*_lod*"]));
    let plain = options(&[]);
    assert!(plain["measure"] == false && plain["samples"].is_null() && plain["seed"].is_null(), "{plain}");
}
