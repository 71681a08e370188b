//! Pyramids of tiles: what is promised of borders, levels, errors and texels, whatever the input, and the same bytes
//! however the job ran.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;

use drystone::base::Progress;
use drystone::options::{ImageFormat, JobOptions, Limits, ResumeChoice, SimplifyOptions, TileCompression, TileOptions};
use drystone::read::InputChoice;
use drystone::report::TileReport;
use drystone::tile::check_tileset;
use drystone::{Error, ErrorKind, Result, Silent, pipeline};
use glam::{DVec2, DVec3};
use serde_json::Value;

use crate::glb_reader::{Glb, GlbTriangle};
use crate::meshes::{StopAfter, contents, copy_town, fixture, status, town};

/// Small tiles, so that the town has several levels.
pub fn small() -> TileOptions {
    TileOptions {
        tile_faces: 600,
        tile_side: 256,
        image: ImageFormat::Png,
        limits: Limits { threads: Some(2), memory: Some(256 << 20) },
        ..TileOptions::default()
    }
}

fn tile(input: &Path, output: &Path, options: &TileOptions) -> Result<TileReport> {
    pipeline::tile(input, output, options, &Silent)
}

/// The root of a tileset.
fn root_of(path: &Path) -> Value {
    let document: Value = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
    document["root"].clone()
}

/// All tiles with triangles of a tileset, each with its parent.
pub fn tiles_of(folder: &Path) -> Vec<(Value, Option<Value>)> {
    let mut all = Vec::new();
    let mut pending = vec![(root_of(&folder.join("tileset.json")), None)];
    while let Some((tile, parent)) = pending.pop() {
        if let Some(name) = tile["content"]["uri"].as_str().filter(|name| name.ends_with(".json")) {
            let root = root_of(&folder.join(name));
            pending.extend(root["children"].as_array().unwrap().iter().map(|child| (child.clone(), parent.clone())));
            continue;
        }
        for child in tile["children"].as_array().into_iter().flatten() {
            pending.push((child.clone(), Some(tile.clone())));
        }
        all.push((tile, parent));
    }
    all
}

#[test]
fn every_input_keeps_the_rules() {
    let inputs = [
        town(),
        fixture("miniatures/coloured_sphere.obj"),
        fixture("miniatures/two_materials_plane.obj"),
        fixture("miniatures/non_manifold_fin.obj"),
        fixture("miniatures/three_chart_corner.obj"),
        fixture("miniatures/normals_box.obj"),
    ];
    for input in inputs {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("out");
        let faces = if input == town() { 600 } else { 100 };
        let options = TileOptions { tile_faces: faces, ..small() };
        let report = tile(&input, &output, &options).unwrap();
        let check = check_tileset(&output, &Silent).unwrap();
        assert_eq!((check.fault_count, &check.faults), (0, &Vec::new()), "{input:?}");
        assert_eq!(report.levels.last().unwrap().tiles, 1, "{input:?}: a root");
        for (level, found) in report.levels.iter().zip(&check.levels) {
            assert_eq!(
                (level.tiles, level.faces, level.faces_max),
                (found.tiles, found.triangles, found.triangles_max)
            );
            assert!(level.faces_max <= options.tile_faces, "{input:?}: {level:?}");
            assert!(level.texels_max <= u64::from(options.tile_side).pow(2), "{input:?}: {level:?}");
            assert!(level.to_input_p99.max(level.from_input_p99) <= level.texel, "{input:?}: {level:?}");
            assert!(level.colourless == 0, "{input:?}: {level:?}");
        }
        assert!(!folder.path().join("out.work").exists());
    }
}

#[test]
fn levels_of_the_town_meet_along_equal_borders_and_grow_coarser() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out");
    let report = tile(&town(), &output, &small()).unwrap();
    let check = check_tileset(&output, &Silent).unwrap();
    assert!(report.levels.len() >= 3, "{report:?}");
    for (at, (level, found)) in report.levels.iter().zip(&check.levels).enumerate() {
        assert_eq!((found.border_edges > 0, found.unequal_edges), (level.tiles > 1, 0));
        assert_eq!(level.texel, report.levels[0].texel * f64::from(1 << at));
        assert!(level.colour_rms < 12.0, "{level:?}");
        let coarsest = report.levels[(at + 2).min(report.levels.len() - 1)].texel;
        assert!(found.longest_skirt <= 2.01 * coarsest, "{found:?}");
    }
    for pair in report.levels.windows(2) {
        assert!(pair[1].mesh_faces <= pair[0].mesh_faces && pair[1].tiles < pair[0].tiles, "{pair:?}");
    }
    let errors = |tile: &Value| tile["geometricError"].as_f64().unwrap();
    for (tile, parent) in tiles_of(&output) {
        let level: usize = tile["content"]["uri"].as_str().unwrap().split('/').next().unwrap().parse().unwrap();
        let least = if level == 0 { 0.0 } else { 16.0 * report.levels[level].texel };
        let most = report.levels[level].geometric_error;
        assert!((least..=most).contains(&errors(&tile)), "{tile}");
        assert!(parent.is_none_or(|parent| errors(&parent) >= errors(&tile)));
    }
}

/// A square of `side` × `side` pairs of triangles with these corners.
fn grid(text: &mut String, first: usize, side: usize, corner: impl Fn(usize, usize) -> DVec3) {
    for (y, x) in (0..=side).flat_map(|y| (0..=side).map(move |x| (y, x))) {
        let DVec3 { x, y, z } = corner(x, y);
        *text += &format!("v {x:.5} {y:.5} {z:.5}\n");
    }
    for (y, x) in (0..side).flat_map(|y| (0..side).map(move |x| (y, x))) {
        let [a, b] = [0, side + 1].map(|row| first + y * (side + 1) + x + row);
        *text += &format!("f {a} {} {}\nf {a} {} {b}\n", a + 1, b + 1, b + 1);
    }
}

#[test]
fn a_coarser_level_may_have_more_triangles_in_the_tile_of_a_finer_one() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("in.obj");
    // What no coarser level can take away, beside a plane that gives it another level.
    let noise = |at: usize| (drystone::base::chance::of_stream(1, at as u64, 0) - 0.5) * 0.6;
    let rough = |x: usize, y: usize| {
        let at = 3 * (25 * y + x);
        DVec3::new(x as f64 + noise(at), y as f64 + noise(at + 1), 4.0 * (noise(at + 2) / 0.6 + 0.5))
    };
    let mut text = String::new();
    grid(&mut text, 1, 24, rough);
    grid(&mut text, 1 + 25 * 25, 40, |x, y| DVec3::new(-5.0 + 0.03 * x as f64, 0.03 * y as f64, 0.0));
    fs::write(&input, text).unwrap();
    let mut oversized = 0;
    for tile_faces in (160..200).step_by(2) {
        let output = folder.path().join(format!("out-{tile_faces}"));
        let options = TileOptions { tile_faces, tile_side: 4096, ..small() };
        let report = tile(&input, &output, &options).unwrap();
        assert!(report.levels.len() > 1);
        for level in &report.levels {
            assert_eq!(level.oversized > 0, level.faces_max > tile_faces, "{level:?}");
            oversized += level.oversized;
        }
        let faults = check_tileset(&output, &Silent).unwrap().faults;
        assert!(faults.is_empty(), "{faults:?}");
    }
    assert!(oversized > 0);
}

#[test]
fn the_finest_level_shows_the_texels_of_the_input() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("in.obj");
    let image = image::RgbImage::from_fn(100, 60, |x, y| image::Rgb([2 * x as u8, 4 * y as u8, (x * y % 251) as u8]));
    image.save(folder.path().join("a.png")).unwrap();
    fs::write(folder.path().join("a.mtl"), "newmtl a\nmap_Kd a.png\n").unwrap();
    // A square of 10 x 6 quads, each with a part of the image; no texel is shown at its own size in the mesh.
    let mut text = "mtllib a.mtl\nusemtl a\n".to_owned();
    let corners = |x: usize, y: usize| [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]];
    for (number, (x, y)) in (0..6).flat_map(|y| (0..10).map(move |x| (x, y))).enumerate() {
        for [x, y] in corners(x, y) {
            text += &format!("v {x} {y} {}\nvt {} {}\n", (x * y % 3) as f64 * 0.1, x as f64 / 10.0, y as f64 / 6.0);
        }
        let at = |corner: usize| format!("{0}/{0}", 4 * number + corner);
        text += &format!("f {} {} {} {}\n", at(1), at(2), at(3), at(4));
    }
    fs::write(&input, text).unwrap();
    let output = folder.path().join("out");
    let report = tile(&input, &output, &TileOptions { tile_faces: 100, ..small() }).unwrap();
    assert!(report.levels[0].colour_rms < 0.5 && report.levels[0].reduced == 0, "{:?}", report.levels[0]);
    // All of the image, and no gutter.
    let covered = report.levels[0].fill * report.levels[0].texels as f64;
    assert!((covered / f64::from(100 * 60) - 1.0).abs() < 0.02, "{covered}");
    let root = &tiles_of(&output)[0].0["transform"];
    let origin = DVec3::from([12, 13, 14].map(|at| root[at].as_f64().unwrap()));
    let mut texels = 0;
    for file in fs::read_dir(output.join("0")).unwrap() {
        let glb = Glb::read(&file.unwrap().path());
        let own = image::load_from_memory(glb.image(0).0).unwrap().into_rgb8();
        for triangle in glb.triangles() {
            let middle = origin + triangle.positions.iter().sum::<DVec3>() / 3.0;
            let shown: DVec2 = triangle.texcoords.unwrap().iter().sum::<DVec2>() / 3.0;
            if triangle.texcoords.unwrap()[0] == triangle.texcoords.unwrap()[2] {
                continue; // a skirt
            }
            let pixel = |image: &image::RgbImage, u: f64, v: f64| {
                let [x, y] = [u * f64::from(image.width()), (1.0 - v) * f64::from(image.height())];
                (image.get_pixel(x as u32, y as u32).0, [x.fract(), y.fract()])
            };
            let (found, _) = pixel(&own, shown.x, shown.y);
            let (expected, place) = pixel(&image, middle.x / 10.0, middle.y / 6.0);
            // Not where rounding decides which texel it is.
            if place.iter().all(|share| (0.1..0.9).contains(share)) {
                assert_eq!(found, expected, "{middle}");
                texels += 1;
            }
        }
    }
    assert!(texels > 50, "{texels}");
}

#[test]
fn colours_of_vertices_come_before_that_of_their_material() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("in.obj");
    fs::write(folder.path().join("a.mtl"), "newmtl a\nKd 0.8 0.6 0.4\n").unwrap();
    // Two squares, the first with colours.
    let mut text = "mtllib a.mtl\nusemtl a\n".to_owned();
    for (left, colour) in [(0, "1 0 0"), (2, "")] {
        for [x, y] in [[0, 0], [1, 0], [1, 1], [0, 1]] {
            text += &format!("v {} {y} 0 {colour}\n", left + x);
        }
        text += "f -4 -3 -2 -1\n";
    }
    fs::write(&input, text).unwrap();
    let output = folder.path().join("out");
    tile(&input, &output, &small()).unwrap();
    let origin = tiles_of(&output)[0].0["transform"][12].as_f64().unwrap();
    let mut seen = [0; 2];
    for file in fs::read_dir(output.join("0")).unwrap() {
        let glb = Glb::read(&file.unwrap().path());
        let image = image::load_from_memory(glb.image(0).0).unwrap().into_rgb8();
        for triangle in glb.triangles() {
            let x = origin + triangle.positions.iter().sum::<DVec3>().x / 3.0;
            let shown: DVec2 = triangle.texcoords.unwrap().iter().sum::<DVec2>() / 3.0;
            let [u, v] = [shown.x * f64::from(image.width()), (1.0 - shown.y) * f64::from(image.height())];
            let square = usize::from(x > 1.5);
            assert_eq!(image.get_pixel(u as u32, v as u32).0, [[255, 0, 0], [204, 153, 102]][square], "{x}");
            seen[square] += 1;
        }
    }
    assert!(seen[0] > 1 && seen[1] > 1, "{seen:?}");
}

#[test]
fn the_bytes_depend_on_neither_threads_nor_memory_nor_stops() {
    let folder = tempfile::tempdir().unwrap();
    let run = |name: &str, threads: usize, memory: u64| {
        let options = TileOptions { limits: Limits { threads: Some(threads), memory: Some(memory) }, ..small() };
        tile(&town(), &folder.path().join(name), &options).unwrap();
        contents(&folder.path().join(name))
    };
    let whole = run("a", 1, 128 << 20);
    assert!(whole == run("b", 3, 1 << 30));
    let output = folder.path().join("c");
    let (mut stops, mut written) = (0, 0);
    let mut units = 5;
    loop {
        match pipeline::tile(town(), &output, &small(), &StopAfter::units(units)) {
            Err(Error::Stopped) => {
                stops += 1;
                assert!(!output.join("tileset.json").exists());
                units += 17;
                let level = &status(&folder.path().join("c.work"))["level"];
                let [tiles, done] = ["tiles", "tiles_done"].map(|name| level[name].as_u64().unwrap_or(0));
                assert!(done <= tiles, "{level}");
                written = written.max(done);
            }
            outcome => break outcome.map(drop).unwrap(),
        }
    }
    assert!(stops > 3 && written > 0, "{stops} stops, {written} tiles");
    assert!(whole == contents(&output), "after {stops} stops");
}

#[test]
fn a_job_that_stops_between_tiles_goes_on_with_the_next_one() {
    let folder = tempfile::tempdir().unwrap();
    tile(&town(), &folder.path().join("whole"), &small()).unwrap();
    let whole = contents(&folder.path().join("whole"));
    let output = folder.path().join("out");
    let mut seen: BTreeMap<PathBuf, std::time::SystemTime> = BTreeMap::new();
    for stop in [60, 90, 120, 150, 180, 210, 240] {
        match pipeline::tile(town(), &output, &small(), &StopAfter::units(stop)) {
            Err(Error::Stopped) => {}
            outcome => {
                outcome.unwrap();
                break;
            }
        }
        // What was written stays as it is.
        for (path, time) in &seen {
            assert_eq!(fs::metadata(path).unwrap().modified().unwrap(), *time, "{path:?}");
        }
        for path in contents(&output).into_keys().map(|name| output.join(name)) {
            let time = fs::metadata(&path).unwrap().modified().unwrap();
            seen.insert(path, time);
        }
    }
    if !output.join("tileset.json").exists() {
        tile(&town(), &output, &small()).unwrap();
    }
    assert!(whole == contents(&output));
}

/// Keeps what it is told.
#[derive(Default)]
struct Listener(Mutex<Vec<String>>);

impl Progress for Listener {
    fn begin(&self, _: &'static str, _: u64, _: &'static str) {}

    fn advance(&self, _: u64) {}

    fn tell(&self, message: &str) {
        self.0.lock().unwrap().push(message.to_owned());
    }
}

#[test]
fn damage_of_triangles_that_were_cut_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out");
    let stopped = pipeline::tile(town(), &output, &small(), &StopAfter::units(150)).unwrap_err();
    assert!(matches!(stopped, Error::Stopped), "{stopped}");
    let is_cut = |path: &PathBuf| {
        let name = path.file_name().unwrap().to_str().unwrap();
        name.starts_with("tile-cut-") && name.ends_with(".buckets")
    };
    let files = fs::read_dir(folder.path().join("out.work")).unwrap().map(|entry| entry.unwrap().path());
    let cut = files.filter(is_cut).min().unwrap();
    let mut bytes = fs::read(&cut).unwrap();
    bytes[100..104].iter_mut().for_each(|byte| *byte ^= 0xff);
    fs::write(&cut, bytes).unwrap();
    let listener = Listener::default();
    pipeline::tile(town(), &output, &small(), &listener).unwrap();
    let told = listener.0.into_inner().unwrap();
    assert!(told.iter().any(|line| line.contains("tile-cut-") && line.contains("damaged")), "{told:?}");
}

#[test]
fn a_pattern_that_excludes_nothing_is_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let input = InputChoice { exclude: vec!["zzz*".to_owned()], ..InputChoice::from(town()) };
    let options = TileOptions { tile_faces: 65_536, ..small() };
    let report = pipeline::tile(input, &folder.path().join("out"), &options, &Silent).unwrap();
    assert!(report.warnings.iter().any(|line| line.contains("'zzz*' leaves nothing out")), "{:?}", report.warnings);
}

#[test]
fn tilesets_that_name_each_other_are_read_once() {
    let folder = tempfile::tempdir().unwrap();
    let child =
        r#"{"boundingVolume":{"box":[0,0,0,1,0,0,0,1,0,0,0,1]},"geometricError":1,"content":{"uri":"tileset.json"}}"#;
    let root = child.replacen("\"content\":{\"uri\":\"tileset.json\"}", &format!("\"children\":[{child},{child}]"), 1);
    let root = root.replacen('{', "{\"refine\":\"REPLACE\",", 1);
    let text = format!(r#"{{"asset":{{"version":"1.1"}},"geometricError":1,"root":{root}}}"#);
    fs::write(folder.path().join("tileset.json"), text).unwrap();
    let check = check_tileset(folder.path(), &Silent).unwrap();
    assert_eq!((check.tiles, check.fault_count), (3, 2), "{:?}", check.faults);
}

#[test]
fn compressed_tiles_have_the_same_triangles() {
    let folder = tempfile::tempdir().unwrap();
    let run = |name: &str, compress: TileCompression, threads: usize| {
        let limits = Limits { threads: Some(threads), ..small().limits };
        let output = folder.path().join(name);
        tile(&town(), &output, &TileOptions { compress, limits, ..small() }).unwrap();
        let check = check_tileset(&output, &Silent).unwrap();
        assert_eq!(check.faults, Vec::<String>::new());
        (contents(&output), check)
    };
    let (plain, found_plain) = run("plain", TileCompression::None, 2);
    let (compressed, found) = run("compressed", TileCompression::Meshopt, 1);
    assert!(compressed == run("again", TileCompression::Meshopt, 3).0);
    assert!(plain.keys().eq(compressed.keys()));
    let bytes = |files: &BTreeMap<PathBuf, Vec<u8>>| files.values().map(Vec::len).sum::<usize>() as u64;
    let images: u64 = found.levels.iter().map(|level| level.image_bytes).sum();
    assert!(bytes(&compressed) - images < (bytes(&plain) - images) * 9 / 10);
    assert_eq!(found.levels, found_plain.levels);
    // Each triangle from its least corner on: those of the surface, and those of the skirt.
    let triangles = |name: &str, path: &Path| {
        let glb = Glb::read(&folder.path().join(name).join(path));
        let skirt = glb.document["meshes"][0]["extras"]["skirtTriangles"].as_u64().unwrap() as usize;
        let key = |triangle: GlbTriangle| {
            let texcoords = triangle.texcoords.unwrap_or_default();
            let bits = |at: usize| {
                let (position, texcoord) = (triangle.positions[at].to_array(), texcoords[at].to_array());
                (position.map(f64::to_bits), texcoord.map(f64::to_bits))
            };
            (0..3).map(|first| [0, 1, 2].map(|corner| bits((first + corner) % 3))).min().unwrap()
        };
        let mut all: Vec<_> = glb.triangles().into_iter().map(key).collect();
        let mut skirt = all.split_off(all.len() - skirt);
        all.sort_unstable();
        skirt.sort_unstable();
        (all, skirt)
    };
    for path in plain.keys().filter(|path| path.extension().is_some_and(|ending| ending == "glb")) {
        assert!(triangles("plain", path) == triangles("compressed", path), "{path:?}");
    }
}

#[test]
fn a_job_with_another_compression_is_another_job() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out");
    let stopped = pipeline::tile(town(), &output, &small(), &StopAfter::units(150)).unwrap_err();
    assert!(matches!(stopped, Error::Stopped), "{stopped}");
    let other = match small().compress {
        TileCompression::None => TileCompression::Meshopt,
        TileCompression::Meshopt => TileCompression::None,
    };
    let error = tile(&town(), &output, &TileOptions { compress: other, ..small() }).unwrap_err();
    assert!(matches!(error, Error::Changed(_)) && error.to_string().contains("`compress` was "), "{error}");
}

#[test]
fn nothing_of_the_user_is_touched() {
    let folder = tempfile::tempdir().unwrap();
    copy_town(&folder.path().join("in"));
    let input = folder.path().join("in/town.obj");
    let before = contents(&folder.path().join("in"));
    let refused = |output: &str, options: &TileOptions| {
        let error = tile(&input, &folder.path().join(output), options).unwrap_err();
        assert!(matches!(error, Error::Usage(_)), "{error}");
        error.to_string()
    };
    fs::create_dir(folder.path().join("mine")).unwrap();
    fs::write(folder.path().join("mine/notes.txt"), "mine").unwrap();
    assert!(refused("mine", &small()).contains("holds files"));
    assert!(refused("in", &small()).contains("holds the input"));
    assert!(refused("in/town.obj", &small()).contains("there is a file"));
    let work = Some(folder.path().join("out/work"));
    let inside = TileOptions { job: JobOptions { work, ..JobOptions::default() }, ..small() };
    assert!(refused("out", &inside).contains("work folder"));
    assert!(refused("out", &TileOptions { tile_side: 300, ..small() }).contains("a power of two"));
    assert!(refused("out", &TileOptions { tile_faces: 5, ..small() }).contains("expected 100"));
    assert!(refused("out", &TileOptions { error_factor: 0.0, ..small() }).contains("above 0"));
    for (image, feature, is_there) in [
        (ImageFormat::WebP(80), "--features webp", cfg!(feature = "webp")),
        (ImageFormat::Ktx2(80), "--features ktx2", cfg!(feature = "ktx2")),
    ] {
        assert!(is_there || refused("out", &TileOptions { image, ..small() }).contains(feature));
        let baked = SimplifyOptions { image, ..small().simplify_options() };
        assert!(baked.check().unwrap_err().to_string().contains("for tiles alone"));
    }
    // With `force` other files stay.
    let forced = TileOptions { job: JobOptions { force: true, ..JobOptions::default() }, ..small() };
    tile(&input, &folder.path().join("mine"), &forced).unwrap();
    assert_eq!(fs::read(folder.path().join("mine/notes.txt")).unwrap(), b"mine");
    assert!(before == contents(&folder.path().join("in")));
    // A job that is refused leaves an older pyramid as it is.
    let older = contents(&folder.path().join("mine"));
    fs::write(folder.path().join("flat.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 1\nf 3 3 2\n").unwrap();
    let error = tile(&folder.path().join("flat.obj"), &folder.path().join("mine"), &forced).unwrap_err();
    assert!(error.kind() == ErrorKind::Input && !error.to_string().contains("weld"), "{error}");
    assert!(older == contents(&folder.path().join("mine")));
    let required =
        TileOptions { job: JobOptions { resume: ResumeChoice::Require, ..JobOptions::default() }, ..small() };
    assert!(tile(&input, &folder.path().join("none"), &required).is_err());
}

#[test]
fn the_program_makes_tiles_and_finds_what_is_damaged() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out");
    let program = |arguments: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_drystone")).args(arguments).arg(&output).output().unwrap();
        (output.status.code(), String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap())
    };
    let town = town();
    let town = town.to_str().unwrap();
    let (code, text, _) = program(&["tile", town, "--tile-faces", "2k", "--origin", "5.66,51.97,10", "-o"]);
    assert!(code == Some(0) && text.contains("level") && text.contains("tiles: "), "{text}");
    let columns_of = |text: &str| {
        let lines = text.lines().filter(|line| line.starts_with(' ')).map(|line| line.replace("  ", "\t"));
        let cells = |line: String| line.split('\t').map(|cell| cell.trim().to_owned()).collect::<Vec<_>>();
        lines.map(|line| cells(line).into_iter().filter(|cell| !cell.is_empty()).collect()).collect::<Vec<Vec<_>>>()
    };
    let made = columns_of(&text);
    let root = &tiles_of(&output)[0].0;
    let transform: Vec<f64> = root["transform"].as_array().unwrap().iter().map(|at| at.as_f64().unwrap()).collect();
    // The first axis points east, and has the length of a metre.
    assert!(transform[2] == 0.0 && (DVec2::new(transform[0], transform[1]).length() - 1.0).abs() < 1e-9);
    let (code, text, _) = program(&["check"]);
    assert!(code == Some(0) && text.contains("faults: 0"), "{text}");
    // Levels, tiles, triangles of all and of the largest tile are written alike.
    for (made, found) in made.iter().zip(columns_of(&text)) {
        assert_eq!((&made[..1], &made[1..4]), (&found[..1], &found[2..5]), "{text}");
    }
    let tile = fs::read_dir(output.join("0")).unwrap().next().unwrap().unwrap().path();
    let whole = fs::read(&tile).unwrap();
    for (damage, words) in [(whole[..whole.len() - 8].to_vec(), "another length"), (Vec::new(), "no GLB")] {
        fs::write(&tile, damage).unwrap();
        let (code, text, _) = program(&["check"]);
        assert!(code == Some(1) && text.contains(words), "{text}");
    }
    fs::remove_file(&tile).unwrap();
    let (code, text, _) = program(&["check", "--json"]);
    let found: Value = serde_json::from_str(&text).unwrap();
    assert!(code == Some(1) && found["fault_count"].as_u64() > Some(0), "{text}");
    fs::remove_file(output.join("tileset.json")).unwrap();
    let (code, _, words) = program(&["check"]);
    assert!(code == Some(2) && words.contains("no tileset.json"), "{words}");
}
