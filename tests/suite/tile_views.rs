//! Tiles of different levels side by side, as a viewer shows them while it refines: no background shines through
//! between them.

use std::collections::BTreeMap;
use std::path::Path;

use drystone::options::TileOptions;
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
        let mut camera = Self { right, up: right.cross(forward), low: DVec2::ZERO, pixel: 1.0, size: [0; 2] };
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

    /// Marks the pixels whose middle a triangle covers.
    fn cover(&self, triangles: &[[DVec3; 3]], covered: &mut [bool]) {
        for triangle in triangles {
            let [a, b, c] = triangle.map(|corner| self.flat(corner));
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
                    let is_inside =
                        |p: DVec2, q: DVec2| (q - p).perp_dot(middle - p) * turn.signum() >= -1e-9 * turn.abs();
                    if is_inside(a, b) && is_inside(b, c) && is_inside(c, a) {
                        covered[row * self.size[0] + column] = true;
                    }
                }
            }
        }
    }

    fn nothing(&self) -> Vec<bool> {
        vec![false; self.size[0] * self.size[1]]
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

#[test]
fn no_background_shows_between_levels() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out");
    let options = TileOptions { tile_faces: 300, ..small() };
    pipeline::tile(town(), &output, &options, &Silent).unwrap();
    let tiles = read_tiles(&output);
    let points: Vec<DVec3> = tiles.values().flat_map(|tile| tile.triangles.iter().flatten().copied()).collect();
    let (mut seen, mut mixtures) = (0, 0);
    let coarsest = tiles.values().map(|tile| tile.level).max().unwrap();
    for (fine, coarse) in (0..coarsest).flat_map(|fine| [(fine, fine + 1), (fine, fine + 2)]) {
        let of_level = |level: usize| tiles.iter().filter(move |(_, tile)| tile.level == level);
        let coarse_names: Vec<&String> = of_level(coarse).map(|(name, _)| name).collect();
        if coarse_names.len() < 2 {
            continue;
        }
        mixtures += 1;
        // Every second tile of the coarser level is shown, and what refines the others.
        let is_shown = |name: &str| coarse_names.iter().position(|other| *other == name).unwrap().is_multiple_of(2);
        let shown: Vec<&ShownTile> = of_level(coarse)
            .filter(|(name, _)| is_shown(name))
            .chain(
                of_level(fine)
                    .filter(|(name, _)| ancestor(&tiles, name, coarse).is_some_and(|ancestor| !is_shown(&ancestor))),
            )
            .map(|(_, tile)| tile)
            .collect();
        for (height, turn) in HEIGHTS.iter().flat_map(|height| (0..AROUND).map(move |turn| (height, turn))) {
            let azimuth = (turn as f64 + 0.3) / AROUND as f64 * std::f64::consts::TAU;
            let camera = Camera::looking(azimuth, height.to_radians(), &points);
            let alone = [fine, coarse].map(|level| {
                let mut covered = camera.nothing();
                of_level(level).for_each(|(_, tile)| camera.cover(&tile.triangles[..tile.surface], &mut covered));
                covered
            });
            let mut together = camera.nothing();
            shown.iter().for_each(|tile| camera.cover(&tile.triangles, &mut together));
            let all = alone[0].iter().zip(&alone[1]).zip(&together);
            let holes = all.filter(|((fine, coarse), together)| **fine && **coarse && !**together).count();
            assert_eq!(holes, 0, "levels {fine} and {coarse}, from {azimuth} at {height} degrees");
            seen += together.iter().filter(|covered| **covered).count();
        }
    }
    assert!(mixtures >= 2 && seen > 1_000_000, "{mixtures} mixtures, {seen} pixels");
}
