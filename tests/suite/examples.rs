//! The programs under `examples/` do what they say.

#[path = "../../examples/folder_of_tiles.rs"]
#[allow(dead_code, reason = "main is for people")]
mod folder_of_tiles;
#[path = "../../examples/levels_of_detail.rs"]
#[allow(dead_code, reason = "main is for people")]
mod levels_of_detail;
#[path = "../../examples/mesh_in_memory.rs"]
#[allow(dead_code, reason = "main is for people")]
mod mesh_in_memory;
#[path = "../../examples/new_texcoords.rs"]
#[allow(dead_code, reason = "main is for people")]
mod new_texcoords;
#[path = "../../examples/new_textures.rs"]
#[allow(dead_code, reason = "main is for people")]
mod new_textures;
#[path = "../../examples/one_file.rs"]
#[allow(dead_code, reason = "main is for people")]
mod one_file;
#[path = "../../examples/options_from_json.rs"]
#[allow(dead_code, reason = "main is for people")]
mod options_from_json;

use std::sync::atomic::Ordering;

use crate::meshes::{read, town};
use drystone::Mesh;

#[test]
fn one_file_leaves_a_tenth() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("town.obj");
    one_file::run(&town(), &output).unwrap();
    assert_eq!(read(&output).face_count(), 1821);
}

#[test]
fn a_folder_is_stopped_and_resumed() {
    let folder = tempfile::tempdir().unwrap();
    crate::meshes::copy_town(&folder.path().join("tiles"));
    let (tiles, output) = (folder.path().join("tiles"), folder.path().join("out/town.obj"));
    let log = folder_of_tiles::Log::default();
    log.stop.store(true, Ordering::Relaxed);
    folder_of_tiles::run(&tiles, &output, &log).unwrap();
    assert!(!output.exists());
    log.stop.store(false, Ordering::Relaxed);
    folder_of_tiles::run(&tiles, &output, &log).unwrap();
    assert!(read(&output).face_count() < 18_218);
}

#[test]
fn a_mesh_goes_through_memory() {
    let models = mesh_in_memory::run(&town()).unwrap();
    let faces: usize = models.iter().map(|model| model.mesh.indices.len() / 3).sum();
    assert!((998..=1000).contains(&faces), "{faces}");
}

#[test]
fn levels_have_a_quarter_each() {
    let options = tobj::LoadOptions { triangulate: true, ..tobj::LoadOptions::default() };
    let mesh = Mesh::from(tobj::load_obj(town(), &options).unwrap().0.as_slice());
    let levels = levels_of_detail::run(mesh).unwrap();
    assert!(levels.len() >= 4);
    for pair in levels.windows(2) {
        assert!(pair[1].faces.len().abs_diff(pair[0].faces.len() / 4) <= 2);
    }
}

#[test]
fn options_come_as_json() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("town.obj");
    let answer = |json: &str| options_from_json::run(&town(), &output, json);
    assert!(answer(r#"{"ratio": 0.2, "metric": "qem"}"#).starts_with("200: 364"));
    assert!(answer(r#"{"ratio": 2}"#).starts_with("400: `ratio: 2`"));
    assert!(answer(r#"{"metric": "best"}"#).starts_with("400: "));
    assert!(answer(r#"{"ratoi": 0.2}"#).starts_with("400: "));
}

#[test]
fn new_texcoords_are_those_of_images() {
    let unwrapped = new_texcoords::run(&town(), 0.1).unwrap();
    assert_eq!(unwrapped.faces.len(), 18_218);
    assert!(unwrapped.face_texcoords.iter().flatten().all(|&texcoord| texcoord != Mesh::NO_TEXCOORD));
    assert!(unwrapped.texcoords.iter().flatten().all(|at| (0.0..=1.0).contains(at)));
}

#[test]
fn new_textures_lie_on_a_mesh_of_another_program() {
    let folder = tempfile::tempdir().unwrap();
    let [coarse, output] = ["coarse.obj", "out/town.obj"].map(|name| folder.path().join(name));
    std::fs::write(&coarse, "v -32 -32 0\nv 32 -32 0\nv 32 32 0\nv -32 32 0\nf 1 2 3 4\n").unwrap();
    new_textures::run(&town(), &coarse, &output).unwrap();
    assert!(read(&output).face_count() == 2 && folder.path().join("out/town_textures").exists());
}
