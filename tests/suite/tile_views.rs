//! Tiles of different levels side by side, as a viewer shows them while it refines: no background shines through
//! between them.

use std::collections::BTreeMap;
use std::path::Path;

use drystone::options::TileOptions;
use drystone::report::TileReport;
use drystone::{Silent, pipeline};
use glam::{DVec2, DVec3};
use serde_json::Value;

use crate::glb_reader::Glb;
use crate::meshes::town;
use crate::tile::{small, tiles_of};

/// Directions around the scene, at each of two heights.
const AROUND: usize = 12;
/// Height of the camera above the ground as seen from the scene, in degrees.
const HEIGHTS: [f64; 2] = [25.0, 60.0];
/// Two levels show the same surface at a pixel if their depths there differ by less than this many texels.
const SAME_TEXELS: f64 = 5.0;
/// Pixels along the longer side of a view.
const PIXELS: f64 = 900.0;

/// A tile: its triangles, those of the skirt last.
struct ShownTile {
    level: usize,
    parent: Option<String>,
    triangles: Vec<[DVec3; 3]>,
    surface: usize,
}

fn uri(tile: &Value) -> String {
    tile["content"]["uri"].as_str().unwrap().to_owned()
}

fn read_tiles(folder: &Path) -> BTreeMap<String, ShownTile> {
    let mut all = BTreeMap::new();
    for (tile, parent) in tiles_of(folder) {
        let name = uri(&tile);
        let glb = Glb::read(&folder.join(&name));
        let skirt = glb.document["meshes"][0]["extras"]["skirtTriangles"].as_u64().unwrap() as usize;
        let triangles: Vec<[DVec3; 3]> = glb.triangles().iter().map(|triangle| triangle.positions).collect();
        let level = name.split('/').next().unwrap().parse().unwrap();
        let shown = ShownTile { level, parent: parent.as_ref().map(uri), surface: triangles.len() - skirt, triangles };
        all.insert(name, shown);
    }
    all
}

/// An orthographic camera.
struct Camera {
    forward: DVec3,
    right: DVec3,
    up: DVec3,
    low: DVec2,
    pixel: f64,
    size: [usize; 2],
}

impl Camera {
    fn looking(azimuth: f64, height: f64, points: &[DVec3]) -> Self {
        let right = DVec3::new(-azimuth.sin(), azimuth.cos(), 0.0);
        let forward = DVec3::new(-azimuth.cos() * height.cos(), -azimuth.sin() * height.cos(), -height.sin());
        let up = right.cross(forward);
        let mut camera = Self { forward, right, up, low: DVec2::ZERO, pixel: 1.0, size: [0; 2] };
        let flat = || points.iter().map(|&point| camera.flat(point));
        let low = flat().fold(DVec2::INFINITY, DVec2::min);
        let high = flat().fold(DVec2::NEG_INFINITY, DVec2::max);
        let pixel = (high - low).max_element() / PIXELS;
        (camera.low, camera.pixel) = (low, pixel);
        camera.size = [(high.x - low.x) / pixel, (high.y - low.y) / pixel].map(|side| side.ceil() as usize + 1);
        camera
    }

    fn flat(&self, point: DVec3) -> DVec2 {
        (DVec2::new(self.right.dot(point), self.up.dot(point)) - self.low) / self.pixel
    }

    /// Keeps the depth of the nearest triangle at the middle of each pixel.
    fn cover(&self, triangles: &[[DVec3; 3]], depths: &mut [f64]) {
        for triangle in triangles {
            let [a, b, c] = triangle.map(|corner| self.flat(corner));
            let depths_of = triangle.map(|corner| self.forward.dot(corner));
            let turn = (b - a).perp_dot(c - a);
            if turn == 0.0 {
                continue;
            }
            let range = |axis: usize| {
                let (low, high) = (a.min(b).min(c)[axis], a.max(b).max(c)[axis]);
                (low - 0.5).ceil().max(0.0) as usize..((high - 0.5).floor() + 1.0).max(0.0) as usize
            };
            for row in range(1) {
                for column in range(0) {
                    let middle = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
                    let share = |p: DVec2, q: DVec2| (q - p).perp_dot(middle - p) / turn;
                    let shares = [share(b, c), share(c, a), share(a, b)];
                    if shares.iter().all(|&share| share >= -1e-9) {
                        let depth = depths_of.iter().zip(shares).map(|(depth, share)| depth * share).sum();
                        let nearest = &mut depths[row * self.size[0] + column];
                        *nearest = f64::min(*nearest, depth);
                    }
                }
            }
        }
    }

    fn nothing(&self) -> Vec<f64> {
        vec![f64::INFINITY; self.size[0] * self.size[1]]
    }
}

/// The ancestor of a tile in a coarser level.
fn ancestor(tiles: &BTreeMap<String, ShownTile>, name: &str, level: usize) -> Option<String> {
    let mut name = name.to_owned();
    while tiles[&name].level < level {
        name = tiles[&name].parent.clone()?;
    }
    (tiles[&name].level == level).then_some(name)
}

/// Pixels where background shows though both of two mixed levels show the same surface, in words; and all pixels seen.
pub fn holes_between_levels(output: &Path, report: &TileReport) -> (Vec<String>, usize) {
    let tiles = read_tiles(output);
    let points: Vec<DVec3> = tiles.values().flat_map(|tile| tile.triangles.iter().flatten().copied()).collect();
    let (mut holes, mut seen) = (Vec::new(), 0);
    let coarsest = tiles.values().map(|tile| tile.level).max().unwrap();
    for (fine, coarse) in (0..coarsest).flat_map(|fine| [(fine, fine + 1), (fine, fine + 2)]) {
        let of_level = |level: usize| tiles.iter().filter(move |(_, tile)| tile.level == level);
        let coarse_names: Vec<&String> = of_level(coarse).map(|(name, _)| name).collect();
        if coarse_names.len() < 2 {
            continue;
        }
        // Every second tile of the coarser level is shown, and what refines the others.
        let is_shown = |name: &str| coarse_names.iter().position(|other| *other == name).unwrap().is_multiple_of(2);
        let is_refined = |name: &str| ancestor(&tiles, name, coarse).is_none_or(|ancestor| !is_shown(&ancestor));
        let kept = of_level(coarse).filter(|(name, _)| is_shown(name));
        let shown: Vec<&ShownTile> =
            kept.chain(of_level(fine).filter(|(name, _)| is_refined(name))).map(|(_, tile)| tile).collect();
        for (height, turn) in HEIGHTS.iter().flat_map(|height| (0..AROUND).map(move |turn| (height, turn))) {
            let azimuth = (turn as f64 + 0.3) / AROUND as f64 * std::f64::consts::TAU;
            let camera = Camera::looking(azimuth, height.to_radians(), &points);
            let alone = [fine, coarse].map(|level| {
                let mut depths = camera.nothing();
                of_level(level).for_each(|(_, tile)| camera.cover(&tile.triangles[..tile.surface], &mut depths));
                depths
            });
            let mut together = camera.nothing();
            shown.iter().for_each(|tile| camera.cover(&tile.triangles, &mut together));
            // Where both levels show the same surface, one of them must be seen.
            let is_same = |a: f64, b: f64| (a - b).abs() < SAME_TEXELS * report.levels[coarse].texel;
            let all = alone[0].iter().zip(&alone[1]).zip(&together).enumerate();
            let own = all.filter(|(_, ((a, b), together))| is_same(**a, **b) && together.is_infinite());
            let words = |pixel| format!("levels {fine}, {coarse}, turn {turn}, height {height}: pixel {pixel}");
            holes.extend(own.map(|(pixel, _)| words(pixel)));
            seen += together.iter().filter(|depth| depth.is_finite()).count();
        }
    }
    (holes, seen)
}

#[test]
fn no_background_shows_between_levels() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out");
    let options = TileOptions { tile_faces: 300, ..small() };
    let report = pipeline::tile(town(), &output, &options, &Silent).unwrap();
    let (holes, seen) = holes_between_levels(&output, &report);
    assert!(seen > 10_000_000, "{seen} pixels");
    // NOTE: 1 % of a level may be farther from the next one than skirts are long.
    assert!(holes.len() <= seen / 10_000_000, "of {seen}: {holes:?}");
}
