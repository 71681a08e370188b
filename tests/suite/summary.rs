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
    let run = simplify(folder.path(), cube, &["--faces", "1", "--topology", "keep", "--quiet"]);
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

#[test]
fn a_mesh_without_area_has_no_deviation_and_the_summary_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("in.obj");
    std::fs::write(&input, "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n").unwrap();
    let run = simplify(folder.path(), input.to_str().unwrap(), &["--ratio", "1", "-q"]);
    assert!(text(&run.stdout).contains("\ndeviation: not measured: the mesh has no area, or"), "{}", text(&run.stdout));
}

#[test]
fn an_option_without_effect_is_refused_in_words_and_as_json() {
    let folder = tempfile::tempdir().unwrap();
    let run = simplify(folder.path(), TOWN, &["--ratio", "0.5", "--atlas", "512", "--format", "json"]);
    let words = "--atlas has no effect without --textures bake";
    assert!(run.status.code() == Some(2) && text(&run.stderr).contains(words), "{}", text(&run.stderr));
    let found: serde_json::Value = serde_json::from_slice(&run.stdout).unwrap();
    assert_eq!((&found["exit_code"], &found["error"]), (&2.into(), &words.into()));
}

#[test]
fn every_command_tells_the_version() {
    for command in [&["--version"][..], &["simplify", "--version"], &["compare", "-V"]] {
        let run = drystone(command);
        assert!(run.status.success() && text(&run.stdout).contains(env!("CARGO_PKG_VERSION")), "{command:?}");
    }
}

#[test]
fn a_folder_without_a_job_may_be_that_of_one_that_is_done() {
    let folder = tempfile::tempdir().unwrap();
    let work = folder.path().join("scratch");
    let work = work.to_str().unwrap();
    assert!(simplify(folder.path(), TOWN, &["--ratio", "0.5", "--work", work]).status.success());
    let status = drystone(&["status", work]);
    assert_eq!(status.status.code(), Some(2));
    assert!(text(&status.stderr).contains("or it is done"), "{}", text(&status.stderr));
}

#[test]
fn a_comment_behind_a_library_names_no_library() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let mesh = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n";
    std::fs::write(path("my mesh.mtl"), "newmtl red\nKd 1 0 0\n").unwrap();
    std::fs::write(path("#1.mtl"), "newmtl red\nKd 1 0 0\n").unwrap();
    for library in ["my mesh.mtl # exported at noon", "gone.mtl #1.mtl", "my\\ mesh.mtl #x"] {
        let input = path("in.obj");
        std::fs::write(&input, format!("mtllib {library}\n{mesh}")).unwrap();
        let run = simplify(folder.path(), input.to_str().unwrap(), &["--ratio", "1", "--format", "json", "-q"]);
        let found: serde_json::Value = serde_json::from_slice(&run.stdout).unwrap();
        assert!(found["repairs"].get("undefined_material").is_none(), "{library}: {}", found["warnings"]);
        let missing = if library.starts_with("gone") { 1 } else { 0 };
        assert_eq!(found["repairs"]["missing_mtl"].as_u64().unwrap_or(0), missing, "{library}: {}", found["warnings"]);
    }
}
