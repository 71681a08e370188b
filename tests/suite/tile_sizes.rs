//! Tiles of meshes of extreme sizes, and with extreme texture coordinates.

use std::fs;
use std::path::{Path, PathBuf};

use drystone::report::TileReport;
use drystone::tile::check_tileset;
use drystone::{Error, Result, Silent, pipeline};

use crate::tile::small;

/// A square with an image of 64 × 64 texels, and a corner of it that shows as many images as `repeats` says.
fn square(folder: &Path, side: f64, repeats: f64) -> PathBuf {
    image::RgbImage::from_fn(64, 64, |x, y| image::Rgb([4 * x as u8, 4 * y as u8, 9]))
        .save(folder.join("a.png"))
        .unwrap();
    fs::write(folder.join("a.mtl"), "newmtl a\nmap_Kd a.png\n").unwrap();
    let half = side / 2.0;
    let corners = [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]];
    let mut text = "mtllib a.mtl\nusemtl a\n".to_owned();
    corners.iter().for_each(|[x, y]| text += &format!("v {x:e} {y:e} 0\nvt {} {}\n", x / side, y / side));
    text += &format!("v {half:e} {half:e} {half:e}\nvt {repeats:e} {repeats:e}\n");
    text += &format!("vt {repeats:e} 0\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\nf 1/1 5/5 3/6\n");
    let path = folder.join("in.obj");
    fs::write(&path, text).unwrap();
    path
}

fn tile(folder: &Path, side: f64, repeats: f64) -> Result<TileReport> {
    pipeline::tile(square(folder, side, repeats), &folder.join("out"), &small(), &Silent)
}

#[test]
fn tiles_of_any_size_that_viewers_can_hold_keep_the_rules() {
    for side in [1e-30, 1e-12, 1.0, 1e12, 1e30] {
        let folder = tempfile::tempdir().unwrap();
        let report = tile(folder.path(), side, 1.0).unwrap();
        let check = check_tileset(&folder.path().join("out"), &Silent).unwrap();
        assert_eq!((check.fault_count, &check.faults), (0, &Vec::new()), "{side:e}");
        assert_eq!((report.levels[0].tiles, report.levels[0].mesh_faces), (1, 3), "{side:e}");
        let texel = report.levels[0].texel / side;
        assert!((0.5..2.0).contains(&(64.0 * texel)), "{side:e}: {texel}");
    }
}

#[test]
fn sizes_that_no_viewer_can_hold_are_refused() {
    for side in [1e-200, 1e-36, 1e38] {
        let folder = tempfile::tempdir().unwrap();
        let error = tile(folder.path(), side, 1.0).unwrap_err();
        assert!(matches!(&error, Error::Input { .. }), "{side:e}: {error}");
        assert!(error.to_string().contains("no viewer can show; scale it"), "{side:e}: {error}");
        assert!(!folder.path().join("out/tileset.json").exists());
    }
}

#[test]
fn a_triangle_that_would_show_too_many_texels_shows_no_image() {
    let folder = tempfile::tempdir().unwrap();
    let report = tile(folder.path(), 1.0, 1e30).unwrap();
    assert_eq!(report.levels[0].tiles, 1, "{report:?}");
    let warned = |line: &String| line.starts_with("repeated images") && line.contains("more than 2⁴⁰ texels");
    assert_eq!(report.warnings.iter().filter(|line| warned(line)).count(), 1, "{:?}", report.warnings);
    let check = check_tileset(&folder.path().join("out"), &Silent).unwrap();
    assert_eq!((check.fault_count, check.faults), (0, Vec::new()));
}

#[test]
fn more_texels_than_the_disk_holds_are_refused_before_tiles_are_made() {
    let folder = tempfile::tempdir().unwrap();
    let input = square(folder.path(), 1.0, 1.9e4);
    // A hundred triangles that each show almost as many texels as one may.
    let text = fs::read_to_string(&input).unwrap();
    fs::write(&input, text + &"v 1 0 1\nf 1/1 5/5 -1/6\n".repeat(100)).unwrap();
    let error = pipeline::tile(&input, &folder.path().join("out"), &small(), &Silent).unwrap_err();
    assert!(matches!(&error, Error::NoSpace { .. }), "{error}");
    assert!(error.to_string().contains("repeat images"), "{error}");
    assert!(!folder.path().join("out/0").exists());
}
