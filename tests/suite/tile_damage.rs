//! Tilesets that are damaged in one way each: `check` says what is wrong.

use std::fs;
use std::path::{Path, PathBuf};

use drystone::tile::check_tileset;
use drystone::{Silent, pipeline};
use serde_json::{Value, json};

use crate::meshes::town;
use crate::tile::small;

type Change<'a> = &'a dyn Fn(&mut Value);

/// Changes the JSON of a tileset; returns what is found then.
fn faults_of(folder: &Path, change: impl FnOnce(&mut Value)) -> Vec<String> {
    let path = folder.join("tileset.json");
    let whole = fs::read(&path).unwrap();
    let mut document: Value = serde_json::from_slice(&whole).unwrap();
    change(&mut document);
    fs::write(&path, document.to_string()).unwrap();
    let faults = check_tileset(folder, &Silent).unwrap().faults;
    fs::write(&path, whole).unwrap();
    faults
}

fn tiled(folder: &Path) -> PathBuf {
    let output = folder.join("out");
    pipeline::tile(town(), &output, &small(), &Silent).unwrap();
    assert_eq!(check_tileset(&output, &Silent).unwrap().faults, Vec::<String>::new());
    output
}

#[test]
fn a_tileset_that_places_its_tiles_elsewhere_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let output = tiled(folder.path());
    let moved = json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 3, 0, 0, 1]);
    let scaled = json!([2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1]);
    let changes: [(&str, Change<'_>); 6] = [
        ("transform: ", &|document| document["root"]["children"][0]["transform"] = moved.clone()),
        ("transform: ", &|document| document["root"]["transform"] = scaled.clone()),
        ("refine: ", &|document| document["root"]["refine"] = "ADD".into()),
        ("refine: ", &|document| document["root"]["children"][0]["refine"] = "ADD".into()),
        ("refine: ", &|document| _ = document["root"].as_object_mut().unwrap().remove("refine")),
        ("geometric error: ", &|document| document["asset"]["extras"]["errorFactor"] = 1.into()),
    ];
    for (kind, change) in changes {
        let faults = faults_of(&output, change);
        assert!(!faults.is_empty() && faults.iter().all(|fault| fault.starts_with(kind)), "{faults:?}");
    }
    assert_eq!(faults_of(&output, |document| document["root"]["transform"] = moved), Vec::<String>::new());
}

#[test]
fn a_tile_with_a_damaged_image_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let output = tiled(folder.path());
    let tile = fs::read_dir(output.join("0")).unwrap().next().unwrap().unwrap().path();
    let mut bytes = fs::read(&tile).unwrap();
    let end = bytes.windows(4).rposition(|four| four == b"IDAT").unwrap() + 100;
    bytes[end] ^= 0x55;
    fs::write(&tile, &bytes).unwrap();
    let faults = check_tileset(&output, &Silent).unwrap().faults;
    let name = tile.file_name().unwrap().to_str().unwrap();
    assert!(faults.len() == 1 && faults[0].starts_with("image: ") && faults[0].contains(name), "{faults:?}");
}
