//! The bytes of results change on purpose only: the hashes of these runs are kept in `results.txt`.
//!
//! A change that is meant to give other results renews them:
//! `DRYSTONE_RENEW_RESULTS=1 cargo test --test suite results:: -- --test-threads 1`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use crate::meshes::{
    Sketch, contents, fixture, in_many_clusters, noise, ratio, simplify, simplify_text, terrain, torus, town,
};
use drystone::options::{
    Borders, Doubles, MetricChoice, Normals, Pieces, Seams, SimplifyOptions, Target, TextureFiles, Weld,
};
use glam::DVec3;
use xxhash_rust::xxh3::Xxh3;

/// The hashes that are kept, by the name of the run.
fn kept() -> BTreeMap<String, String> {
    let text = std::fs::read_to_string(path()).unwrap_or_default();
    text.lines().filter_map(|line| line.split_once(' ')).map(|(hash, run)| (run.to_owned(), hash.to_owned())).collect()
}

fn path() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/results.txt")
}

/// The hash of all files of a run.
fn hash_of(run: &crate::meshes::Run) -> String {
    let mut hash = Xxh3::new();
    for (path, content) in contents(run.folder()) {
        let name = path.file_name().unwrap_or_default();
        hash.update(name.as_encoded_bytes());
        hash.update(&content);
    }
    format!("{:016x}", hash.digest())
}

/// Compares runs with what is kept of them, or keeps them.
fn compare(runs: Vec<(String, crate::meshes::Run)>) {
    let mut kept = kept();
    if std::env::var_os("DRYSTONE_RENEW_RESULTS").is_some() {
        kept.extend(runs.iter().map(|(name, run)| (name.clone(), hash_of(run))));
        let text = kept.iter().fold(String::new(), |mut text, (name, hash)| {
            let _ = writeln!(text, "{hash} {name}");
            text
        });
        std::fs::write(path(), text).unwrap();
        return;
    }
    let others = runs.iter().filter(|(name, run)| kept.get(name) != Some(&hash_of(run)));
    let others: Vec<&str> = others.map(|(name, _)| name.as_str()).collect();
    assert!(others.is_empty(), "other bytes than before: {}", others.join(", "));
}

/// Runs on one OBJ text.
fn on_text(mesh: &str, text: &str, runs: &[(&str, SimplifyOptions)]) {
    compare(runs.iter().map(|(name, options)| (format!("{mesh}, {name}"), simplify_text(text, options))).collect());
}

/// Runs on the town.
fn on_town(runs: &[(&str, SimplifyOptions)]) {
    compare(runs.iter().map(|(name, options)| (format!("town, {name}"), simplify(&town(), options))).collect());
}

fn bound(distance: f64) -> SimplifyOptions {
    SimplifyOptions { target: Target::max_error(distance), ..ratio(0.5) }
}

fn metric(metric: MetricChoice, parameters: &[&str], share: f64) -> SimplifyOptions {
    let metric_option = parameters.iter().map(|&parameter| parameter.to_owned()).collect();
    SimplifyOptions { metric: Some(metric), metric_option, ..ratio(share) }
}

fn remesh(settings: &str, share: f64) -> SimplifyOptions {
    SimplifyOptions { remesh: Some(settings.parse().unwrap()), ..ratio(share) }
}

/// Triangles of any size and place, some of which meet at their corners, some edges with three faces.
fn soup() -> Sketch {
    let mut sketch = Sketch::default();
    for i in 0..700 {
        let at = |k: u64| noise(i, 1, k) * 10.0;
        sketch.positions.push(DVec3::new(at(1), at(2), at(3) * 0.2));
    }
    for i in 0..2500 {
        let first = (noise(i, 2, 4) * 690.0) as usize;
        let corner = |k: u64| (first + (noise(i, 3, k) * 10.0) as usize, 0);
        let face = [corner(5), corner(6), corner(7)];
        sketch.faces.push(face);
        if i % 50 == 0 {
            sketch.faces.push([face[0], face[2], face[1]]);
        }
    }
    sketch
}

/// Hills of three materials: some faces are turned, some have no texture coordinates, a slit without thickness runs across,
/// and beyond it the edges are half as long.
fn patchwork() -> String {
    let mut sketch = terrain(32);
    let is_beyond = |face: &[(usize, usize); 3]| face[0].0 / 33 >= 16;
    sketch.faces.retain(is_beyond);
    let coarse = terrain(16);
    let first = sketch.positions.len();
    sketch.positions.extend(coarse.positions.iter().map(|p| DVec3::new(2.0 * p.x, 2.0 * p.y, p.z)));
    sketch.texcoords.extend(&coarse.texcoords);
    let near = coarse.faces.iter().filter(|face| face[0].0 / 17 < 8);
    sketch.faces.extend(near.map(|face| face.map(|(v, t)| (first + v, first + t))));
    sketch.materials = (0..sketch.faces.len()).map(|face| face / 150 % 3).collect();
    for (i, face) in sketch.faces.iter_mut().enumerate().filter(|(i, _)| i % 11 == 0 || i / 60 % 5 == 0) {
        face.swap(i % 2, 2);
    }
    let bare = |(i, line): (usize, &str)| {
        let is_bare = line.starts_with("f ") && i / 40 % 4 == 0;
        let words = line.split(' ').map(|word| if is_bare { word.split('/').next().unwrap_or(word) } else { word });
        words.collect::<Vec<_>>().join(" ") + "\n"
    };
    sketch.text().lines().enumerate().map(bare).collect()
}

#[test]
fn of_a_patchwork() {
    let runs = [
        ("half", ratio(0.5)),
        ("a tenth in clusters", in_many_clusters(ratio(0.1))),
        ("bound", in_many_clusters(bound(0.3))),
        ("not welded", SimplifyOptions { weld: Weld::Off, seams: Some(Seams::Follow), ..ratio(0.2) }),
        ("oblique", metric(MetricChoice::Oblique, &[], 0.2)),
        ("sharpness", metric(MetricChoice::Sharpness, &[], 0.2)),
        ("optimized", SimplifyOptions { optimize: true, ..in_many_clusters(ratio(0.3)) }),
        ("remeshed", in_many_clusters(remesh("cvd", 0.2))),
    ];
    on_text("patchwork", &patchwork(), &runs);
}

#[test]
fn of_the_town_at_any_target() {
    on_town(&[
        ("half", ratio(0.5)),
        ("a tenth", ratio(0.1)),
        ("a fiftieth", ratio(0.02)),
        ("a tenth in clusters", in_many_clusters(ratio(0.1))),
        ("a fiftieth in clusters", in_many_clusters(ratio(0.02))),
        ("300 faces", SimplifyOptions { target: Target::faces(300), ..ratio(0.5) }),
    ]);
}

#[test]
fn of_the_town_within_a_bound() {
    on_town(&[("nothing changed", bound(0.0)), ("0.02", bound(0.02)), ("0.3", bound(0.3))]);
}

#[test]
fn of_the_town_within_a_bound_in_clusters() {
    on_town(&[
        ("0.1 in clusters", in_many_clusters(bound(0.1))),
        (
            "0.1 or a tenth",
            SimplifyOptions { target: in_many_clusters(ratio(0.1)).target.within(0.1), ..in_many_clusters(ratio(0.1)) },
        ),
    ]);
}

#[test]
fn of_the_town_with_each_treatment_of_seams_and_borders() {
    let seams = |seams| SimplifyOptions { seams: Some(seams), ..in_many_clusters(ratio(0.2)) };
    on_town(&[
        ("seams stitched", seams(Seams::Stitch)),
        ("seams followed", seams(Seams::Follow)),
        ("seams locked", seams(Seams::Lock)),
        ("borders locked", SimplifyOptions { borders: Borders::Lock, ..ratio(0.2) }),
        ("no drift counts", SimplifyOptions { uv_weight: 0.0, ..ratio(0.2) }),
        ("drift counts much", SimplifyOptions { uv_weight: 50.0, ..in_many_clusters(ratio(0.2)) }),
    ]);
}

#[test]
fn of_the_town_with_other_options() {
    on_town(&[
        ("not welded", SimplifyOptions { weld: Weld::Off, ..ratio(0.3) }),
        ("small pieces dropped", SimplifyOptions { pieces: Pieces::Drop, ..in_many_clusters(ratio(0.05)) }),
        ("doubles dropped", SimplifyOptions { doubles: Doubles::Drop, ..ratio(0.3) }),
        ("textures linked", SimplifyOptions { textures: TextureFiles::Link, ..ratio(0.3) }),
        ("one pass", SimplifyOptions { passes: 1, ..in_many_clusters(ratio(0.3)) }),
        ("five passes", SimplifyOptions { passes: 5, ..in_many_clusters(ratio(0.3)) }),
        ("optimized", SimplifyOptions { optimize: true, ..in_many_clusters(ratio(0.3)) }),
    ]);
}

#[test]
fn of_the_town_with_each_metric() {
    on_town(&[
        ("distance", metric(MetricChoice::Qem, &[], 0.2)),
        ("planes", metric(MetricChoice::Qem1997, &[], 0.2)),
        ("oblique", in_many_clusters(metric(MetricChoice::Oblique, &[], 0.2))),
        ("curvature", in_many_clusters(metric(MetricChoice::Curvature, &[], 0.2))),
        ("terrain", in_many_clusters(metric(MetricChoice::Terrain, &[], 0.2))),
        ("sharpness", in_many_clusters(metric(MetricChoice::Sharpness, &[], 0.2))),
    ]);
}

#[test]
fn of_a_remeshed_town() {
    let cells = SimplifyOptions { target: Target::default(), ..remesh("cvd:cells=1500", 0.5) };
    on_town(&[("remeshed", in_many_clusters(remesh("cvd", 0.2))), ("1500 cells", cells)]);
}

#[test]
fn of_hills() {
    let runs = [
        ("a tenth in clusters", in_many_clusters(ratio(0.1))),
        ("a hundredth", ratio(0.01)),
        ("bound", in_many_clusters(bound(0.2))),
        ("large bound", bound(3.0)),
        ("planes", metric(MetricChoice::Qem1997, &["border=3"], 0.1)),
        ("oblique", metric(MetricChoice::Oblique, &[], 0.1)),
        ("curvature", metric(MetricChoice::Curvature, &[], 0.1)),
        ("terrain", metric(MetricChoice::Terrain, &[], 0.1)),
        ("sharpness", metric(MetricChoice::Sharpness, &[], 0.1)),
    ];
    on_text("hills", &terrain(50).text(), &runs);
}

#[test]
fn of_a_ring() {
    let runs = [
        ("a twentieth in clusters", in_many_clusters(ratio(0.05))),
        ("bound", bound(0.05)),
        ("oblique", metric(MetricChoice::Oblique, &[], 0.1)),
        ("curvature in clusters", in_many_clusters(metric(MetricChoice::Curvature, &[], 0.1))),
        ("sharpness", SimplifyOptions { optimize: true, ..metric(MetricChoice::Sharpness, &[], 0.1) }),
        ("remeshed", remesh("cvd", 0.1)),
        ("remeshed by curvature", in_many_clusters(remesh("cvd:2", 0.1))),
    ];
    on_text("ring", &torus(60, 40).text(), &runs);
}

#[test]
fn of_a_soup() {
    let runs = [
        ("half", ratio(0.5)),
        ("a tenth in clusters", in_many_clusters(ratio(0.1))),
        ("doubles dropped", SimplifyOptions { doubles: Doubles::Drop, ..ratio(0.3) }),
        ("small pieces dropped", SimplifyOptions { pieces: Pieces::Drop, ..ratio(0.3) }),
        ("bound", bound(0.3)),
        ("remeshed", remesh("cvd", 0.3)),
    ];
    on_text("soup", &soup().text(), &runs);
}

#[test]
fn of_the_miniatures() {
    let mut runs = Vec::new();
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(fixture("miniatures")).unwrap().map(|f| f.unwrap().path()).collect();
    files.sort();
    for file in files.into_iter().filter(|file| file.extension().is_some_and(|e| e == "obj")) {
        let name = file.file_stem().unwrap().to_string_lossy().into_owned();
        runs.push((format!("{name}, a third"), simplify(&file, &ratio(0.34))));
        runs.push((format!("{name}, bound"), simplify(&file, &bound(0.05))));
        let options = SimplifyOptions { normals: Normals::Drop, borders: Borders::Lock, ..ratio(0.5) };
        runs.push((format!("{name}, half without normals"), simplify(&file, &options)));
        runs.push((format!("{name}, remeshed"), simplify(&file, &remesh("cvd", 0.5))));
    }
    compare(runs);
}
