//! `drystone check TILES --against INPUT`: geometric errors that are too small are found.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::meshes::fixture;

fn drystone(folder: &Path, words: &[&str]) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_drystone")).args(words).current_dir(folder).output().unwrap();
    (output.status.code(), String::from_utf8([output.stdout, output.stderr].concat()).unwrap())
}

/// Changes the tileset of a folder.
fn change(folder: &Path, change: impl FnOnce(&mut Value)) {
    let path = folder.join("out/tileset.json");
    let mut document: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    change(&mut document);
    fs::write(&path, document.to_string()).unwrap();
}

#[test]
fn errors_that_say_too_little_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let input = fixture("town/town.obj");
    let input = input.to_str().unwrap();
    let made = drystone(folder, &["tile", input, "-o", "out", "--tile-faces", "1000", "--tile-side", "512", "--quiet"]);
    assert_eq!(made.0, Some(0), "{}", made.1);
    let check = |against: &str| drystone(folder, &["check", "out", "--against", against]);

    let (code, words) = check(input);
    assert_eq!(code, Some(0), "{words}");
    assert!(words.contains("tiles measured against the input"), "{words}");

    // Another mesh.
    let (code, words) = check(fixture("miniatures/closed_sphere.obj").to_str().unwrap());
    assert_eq!(code, Some(1), "{words}");

    // Errors that stand for a fifth of the distance.
    change(folder, |document| document["asset"]["extras"]["errorFactor"] = (5.0 * 16.0).into());
    let (code, words) = check(input);
    assert!(code == Some(1) && words.contains("farther from the input than its error says"), "{words}");

    // Tiles beside where they belong.
    change(folder, |document| {
        document["asset"]["extras"]["errorFactor"] = 16.into();
        let x = &mut document["asset"]["extras"]["origin"][0];
        *x = (x.as_f64().unwrap() + 3.0).into();
    });
    assert_eq!(check(input).0, Some(1));

    for extras in [Value::Null, serde_json::json!({ "errorFactor": 0, "origin": [0, 0, 0] })] {
        change(folder, |document| document["asset"]["extras"] = extras);
        let (code, words) = check(input);
        assert!(code == Some(2) && words.contains("does not say where its tiles lie"), "{code:?} {words}");
    }
}
