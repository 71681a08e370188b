//! Pyramids of meshes that are far from a city: loose triangles, palettes, faces without area, wide scenes.

use std::fs;
use std::path::{Path, PathBuf};

use drystone::options::{JobOptions, TileOptions};
use drystone::tile::check_tileset;
use drystone::{Error, Silent, job, pipeline};
use glam::{DVec2, DVec3};
use serde_json::Value;

use crate::glb_reader::Glb;
use crate::meshes::{StopAfter, town};
use crate::tile::{small, tiles_of};

/// Writes an OBJ with its MTL, and a palette of 16 × 16 colours.
fn write_mesh(folder: &Path, name: &str, text: &str) -> PathBuf {
    let colour = |x: u32, y: u32| image::Rgb([(16 * x) as u8, (16 * y) as u8, 100]);
    image::RgbImage::from_fn(16, 16, colour).save(folder.join("palette.png")).unwrap();
    fs::write(folder.join("a.mtl"), "newmtl a\nmap_Kd palette.png\nnewmtl b\nKd 0.5 0.5 0.5\n").unwrap();
    let path = folder.join(name);
    fs::write(&path, format!("mtllib a.mtl\nusemtl a\n{text}")).unwrap();
    path
}

/// Tiles of a mesh, and faults that the check finds.
fn tiles(input: &Path, output: &Path, options: &TileOptions) -> Vec<(Value, Option<Value>)> {
    pipeline::tile(input, output, options, &Silent).unwrap();
    let check = check_tileset(output, &Silent).unwrap();
    assert_eq!(check.faults, Vec::<String>::new(), "{}", input.display());
    tiles_of(output)
}

/// A grid of squares whose texture coordinates cover the image, with heights.
fn grid(side: usize) -> String {
    let mut text = String::new();
    for (y, x) in (0..=side).flat_map(|y| (0..=side).map(move |x| (y, x))) {
        let share = |at: usize| at as f64 / side as f64;
        text += &format!("v {} {} {}\nvt {} {}\n", x, y, (x * y % 7) as f64 * 0.1, share(x), share(y));
    }
    for (y, x) in (0..side).flat_map(|y| (0..side).map(move |x| (y, x))) {
        let at = |x: usize, y: usize| format!("{0}/{0}", y * (side + 1) + x + 1);
        text += &format!("f {} {} {} {}\n", at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1));
    }
    text
}

/// Loose triangles far from each other, each with one colour of the palette.
fn loose(count: usize) -> String {
    let mut text = String::new();
    for number in 0..count {
        let [x, y] = [number % 60, number / 60].map(|at| 3.0 * at as f64);
        let [u, v] = [number % 16, number / 16 % 16].map(|at| (at as f64 + 0.5) / 16.0);
        text += &format!("v {x} {y} 0\nv {} {y} 0\nv {x} {} 0.5\nvt {u} {v}\n", x + 1.0, y + 1.0);
        let (corner, shown) = (3 * number + 1, number + 1);
        text += &format!("f {corner}/{shown} {}/{shown} {}/{shown}\n", corner + 1, corner + 2);
    }
    text
}

#[test]
fn more_charts_than_an_image_holds_keep_their_colours() {
    let folder = tempfile::tempdir().unwrap();
    let input = write_mesh(folder.path(), "loose.obj", &loose(3000));
    let output = folder.path().join("out");
    let options = TileOptions { tile_faces: 16_000, ..small() };
    let all = tiles(&input, &output, &options);
    let origin = DVec3::from([12, 13, 14].map(|at| all[0].0["transform"][at].as_f64().unwrap()));
    let mut triangles = 0;
    for (tile, _) in all.iter().filter(|(tile, _)| !tile["content"].is_null()) {
        let glb = Glb::read(&output.join(tile["content"]["uri"].as_str().unwrap()));
        let image = image::load_from_memory(glb.image(0).0).unwrap().into_rgb8();
        assert!(image.width() <= 256 && image.height() <= 256);
        for triangle in glb.triangles() {
            let place = origin + triangle.positions.iter().sum::<DVec3>() / 3.0;
            let number = (place.x / 3.0) as usize + 60 * (place.y / 3.0) as usize;
            let expected = [16 * (number % 16) as i32, 16 * (15 - number / 16 % 16) as i32, 100];
            let shown: DVec2 = triangle.texcoords.unwrap().iter().sum::<DVec2>() / 3.0;
            let [x, y] =
                [(shown.x, image.width()), (1.0 - shown.y, image.height())].map(|(at, side)| at * f64::from(side));
            let found = image.get_pixel(x as u32, y as u32).0;
            let most = expected.iter().zip(found).map(|(a, b)| (a - i32::from(b)).abs()).max().unwrap();
            assert!(most <= 8, "{number}: {expected:?}, {found:?}");
            triangles += 1;
        }
    }
    assert!(triangles >= 3000);
}

#[test]
fn a_root_without_content_has_an_error() {
    let folder = tempfile::tempdir().unwrap();
    // Each square shows all of the image: many charts for few triangles.
    let mut text = String::from("vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n");
    for number in 0..400 {
        let [x, y] = [number % 20, number / 20].map(|at| 2 * at);
        text += &format!("v {x} {y} 0\nv {} {y} 0\nv {} {} 1\nv {x} {} 1\n", x + 1, x + 1, y + 1, y + 1);
        let at = |corner: usize| format!("{}/{corner}", 4 * number + corner);
        text += &format!("f {} {} {} {}\n", at(1), at(2), at(3), at(4));
    }
    let input = write_mesh(folder.path(), "charts.obj", &text);
    let output = folder.path().join("out");
    let all = tiles(&input, &output, &small());
    assert!(all.len() > 2, "{}", all.len());
    for (tile, _) in all.iter().filter(|(tile, _)| tile["content"].is_null()) {
        assert!(tile["geometricError"].as_f64().unwrap() > 0.0, "{tile}");
    }
}

#[test]
fn a_face_without_area_divides_no_tile() {
    let folder = tempfile::tempdir().unwrap();
    let count = |name: &str, text: &str| {
        let input = write_mesh(folder.path(), name, text);
        tiles(&input, &folder.path().join(name.replace(".obj", "")), &small()).len()
    };
    let plain = grid(16);
    let line = "v 3 3 0.9\nv 4 4 0.9\nv 5 5 0.9\nvt 0 0\nvt 1 0\nvt 0 1\nf -3/-3 -2/-2 -1/-1\n";
    assert_eq!(count("plain.obj", &plain), count("line.obj", &format!("{plain}{line}")));
}

#[test]
fn triangles_smaller_than_a_texel_stay() {
    let folder = tempfile::tempdir().unwrap();
    let mut text = String::from("vt 0.03 0.03\nvt 0.0300001 0.03\nvt 0.03 0.0300001\n");
    text += &grid(12).lines().filter(|line| line.starts_with("v ")).map(|line| format!("{line}\n")).collect::<String>();
    for (y, x) in (0..12).flat_map(|y| (0..12).map(move |x| (y, x))) {
        let at = |x: usize, y: usize| y * 13 + x + 1;
        text += &format!("f {}/1 {}/2 {}/3\n", at(x, y), at(x + 1, y), at(x + 1, y + 1));
        text += &format!("f {}/1 {}/2 {}/3\n", at(x, y), at(x + 1, y + 1), at(x, y + 1));
    }
    let input = write_mesh(folder.path(), "one_texel.obj", &text);
    let report = pipeline::tile(&input, &folder.path().join("out"), &small(), &Silent).unwrap();
    assert!(report.levels[0].faces >= 2 * 144, "{:?}", report.levels[0]);
    assert_eq!(check_tileset(&folder.path().join("out"), &Silent).unwrap().faults, Vec::<String>::new());
}

#[test]
fn a_stray_triangle_far_away_leaves_the_others_in_place() {
    let folder = tempfile::tempdir().unwrap();
    for far in [5e4, 6e6] {
        let stray =
            format!("v {far} 0 0\nv {} 1 0\nv {far} 2 1\nvt 0 0\nvt 1 0\nvt 0 1\nf -3/-3 -2/-2 -1/-1\n", far + 1.0);
        let bridge = format!("v 0 0 5\nv {far} 7 5\nv {far} 9 5\nf -3 -2 -1\n");
        let small_grid = grid(16).replace("v ", "v 0.");
        let input = write_mesh(folder.path(), "far.obj", &format!("{small_grid}{stray}{bridge}"));
        let output = folder.path().join(format!("out{far}"));
        let report = pipeline::tile(&input, &output, &small(), &Silent).unwrap();
        assert!(report.levels[0].mesh_faces > 500, "{far}: {:?}", report.levels[0]);
        let faults = check_tileset(&output, &Silent).unwrap().faults;
        assert!(faults.iter().all(|fault| fault.contains("border")), "{far}: {faults:?}");
    }
}

#[test]
fn a_kept_job_fills_no_folder_of_others() {
    let folder = tempfile::tempdir().unwrap();
    let options = TileOptions {
        job: JobOptions { work: Some(folder.path().join("work")), keep_work: true, ..JobOptions::default() },
        ..small()
    };
    pipeline::tile(town(), &folder.path().join("a"), &options, &Silent).unwrap();
    fs::create_dir(folder.path().join("b")).unwrap();
    fs::write(folder.path().join("b/tileset.json"), "mine").unwrap();
    let error = pipeline::tile(town(), &folder.path().join("b"), &options, &Silent).unwrap_err();
    assert!(matches!(error, Error::Usage(_)), "{error}");
    assert_eq!(fs::read(folder.path().join("b/tileset.json")).unwrap(), b"mine");
    // Its own folder, and an empty one, it fills.
    pipeline::tile(town(), &folder.path().join("a"), &options, &Silent).unwrap();
    pipeline::tile(town(), &folder.path().join("c"), &options, &Silent).unwrap();
}

#[test]
fn what_a_killed_process_was_writing_is_removed() {
    let folder = tempfile::tempdir().unwrap();
    let (output, work) = (folder.path().join("out"), folder.path().join("work"));
    let options = TileOptions { job: JobOptions { work: Some(work.clone()), ..JobOptions::default() }, ..small() };
    let stopped = (40..).step_by(20).find(|&units| {
        let _ = pipeline::tile(town(), &output, &options, &StopAfter::units(units)).unwrap_err();
        output.join("0").is_dir()
    });
    assert!(stopped.is_some());
    let number = job::look(&work).unwrap().manifest.job;
    let left = ["", "0"].map(|level| output.join(level).join(format!("drystone-{number:016x}-{:016x}.tmp", 7)));
    left.iter().for_each(|path| fs::write(path, "half of a tile").unwrap());
    pipeline::tile(town(), &output, &options, &Silent).unwrap();
    assert_eq!(left.map(|path| path.exists()), [false; 2]);
}
