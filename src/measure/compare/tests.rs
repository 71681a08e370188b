use std::fs;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::super::Surface;
use super::*;
use crate::base::Silent;
use crate::geometry::closest_point;
use crate::geometry::triangle;
use crate::read::ScanOptions;
use crate::topology::count;
use crate::topology::edges::EdgeTable;

const RESOURCES: Resources = Resources {
    threads: 2,
    work_bytes: 100 << 20,
    scan: ScanOptions { threads: 2, chunks_in_flight: 4, catalogue_bytes: 1 << 30 },
};

/// A folder with OBJ files.
struct Bench(tempfile::TempDir);

impl Bench {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, positions: &[DVec3], faces: &[[usize; 3]]) -> PathBuf {
        let mut text = String::new();
        positions.iter().for_each(|p| text += &format!("v {:?} {:?} {:?}\n", p.x, p.y, p.z));
        faces.iter().for_each(|[a, b, c]| text += &format!("f {} {} {}\n", a + 1, b + 1, c + 1));
        fs::write(self.path(name), text).unwrap();
        self.path(name)
    }

    fn compare(&self, original: &Path, result: &Path, cell_faces: u64) -> Comparison {
        self.compare_at(Spread::Area(20_000), original, result, cell_faces)
    }

    fn compare_at(&self, spread: Spread, original: &Path, result: &Path, cell_faces: u64) -> Comparison {
        let options = CompareOptions { spread, seed: 7, texel: None, work: self.path("work"), resources: RESOURCES };
        compare_in_cells([&original.into(), &result.into()], &options, cell_faces, &mut (), &Silent).unwrap()
    }
}

fn near(found: f64, expected: f64, share: f64) -> bool {
    (found - expected).abs() <= share * expected.abs()
}

/// A square of ten by ten units, cut into `side` by `side` squares of two triangles.
fn plane(side: usize, height: impl Fn(f64, f64) -> f64) -> (Vec<DVec3>, Vec<[usize; 3]>) {
    let step = 10.0 / side as f64;
    let at = |i: usize| [(i % (side + 1)) as f64 * step, (i / (side + 1)) as f64 * step];
    let positions = (0..(side + 1).pow(2)).map(at).map(|[x, y]| DVec3::new(x, y, height(x, y))).collect();
    let corners = (0..side * side).map(|i| i / side * (side + 1) + i % side);
    let faces = corners.flat_map(|a| [[a, a + 1, a + side + 2], [a, a + side + 2, a + side + 1]]).collect();
    (positions, faces)
}

/// An icosahedron whose triangles were cut into four `levels` times, with all vertices at a distance from the origin.
fn sphere(levels: usize, radius: f64) -> (Vec<DVec3>, Vec<[usize; 3]>) {
    let t = (1.0 + 5.0f64.sqrt()) / 2.0;
    let mut positions = Vec::new();
    for (a, b) in [(-1.0, t), (1.0, t), (-1.0, -t), (1.0, -t)] {
        positions.extend([DVec3::new(a, b, 0.0), DVec3::new(0.0, a, b), DVec3::new(b, 0.0, a)]);
    }
    let mut faces = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                let [p, q, r]: [DVec3; 3] = [a, b, c].map(|v| positions[v]);
                if [p.distance(q), q.distance(r), r.distance(p)].into_iter().all(|side| side < 2.1) {
                    let is_outward = (q - p).cross(r - p).dot(p + q + r) > 0.0;
                    faces.push(if is_outward { [a, b, c] } else { [a, c, b] });
                }
            }
        }
    }
    for _ in 0..levels {
        let mut middles = std::collections::HashMap::new();
        let mut finer = Vec::with_capacity(4 * faces.len());
        for [a, b, c] in faces {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(u, v)| {
                *middles.entry((u.min(v), u.max(v))).or_insert_with(|| {
                    positions.push((positions[u] + positions[v]) * 0.5);
                    positions.len() - 1
                })
            });
            finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        faces = finer;
    }
    (positions.into_iter().map(|p| p.normalize() * radius).collect(), faces)
}

#[test]
fn parallel_planes_are_as_far_apart_as_they_are() {
    let bench = Bench::new();
    let (positions, faces) = plane(20, |_, _| 0.0);
    let original = bench.write("a.obj", &positions, &faces);
    let (positions, faces) = plane(3, |_, _| 0.25);
    let result = bench.write("b.obj", &positions, &faces);
    let Comparison { geometry, topology, .. } = bench.compare(&original, &result, 100);
    for way in [&geometry.forward, &geometry.backward, &geometry.symmetric] {
        for exact in [way.max, way.mean, way.rms] {
            assert!(near(exact, 0.25, 1e-12), "{exact}");
        }
        for percentile in [way.median, way.p95, way.p99] {
            assert!(near(percentile, 0.25, 1e-3), "{percentile}");
        }
    }
    assert!(geometry.normals.mean < 1e-5 && geometry.normals.flipped == 0.0);
    assert!(near(geometry.area_ratio, 1.0, 1e-12) && near(geometry.diagonal, 200f64.sqrt(), 1e-12));
    assert!(near(geometry.border.unwrap().max, 0.25, 1e-9));
    assert_eq!((topology.before.euler, topology.after.boundary_edges), (1, 12));
    assert_eq!(geometry.volume_ratio, None);
}

#[test]
fn a_mesh_lies_on_itself() {
    let bench = Bench::new();
    let (positions, faces) = plane(40, |x, y| (x * 3.0).sin() + (y * 2.0).cos());
    let original = bench.write("a.obj", &positions, &faces);
    let Comparison { geometry, topology, quality, .. } = bench.compare(&original, &original, 300);
    assert!(geometry.symmetric.max < 1e-12 && geometry.normals.mean < 1e-5);
    assert_eq!((topology.before, quality.before), (topology.after, quality.after));
}

#[test]
fn a_sphere_and_its_refinement_differ_by_the_height_of_their_caps() {
    let bench = Bench::new();
    let (positions, faces) = sphere(2, 1.0);
    let fine = sphere(6, 1.0);
    let (original, result) = (bench.write("a.obj", &fine.0, &fine.1), bench.write("b.obj", &positions, &faces));
    let Comparison { geometry, .. } = bench.compare(&original, &result, 10_000);
    // how far each coarse triangle lies below the sphere: at most at its middle, in the mean by many small parts
    let (mut deepest, mut sum, mut area) = (0.0f64, 0.0, 0.0);
    for face in faces {
        let [a, b, c] = face.map(|v| positions[v]);
        let part = triangle::area([a, b, c]);
        let mut mean = 0.0;
        for i in 0..30 {
            for j in 0..30 - i {
                let (u, v) = ((f64::from(i) + 1.0 / 3.0) / 30.0, (f64::from(j) + 1.0 / 3.0) / 30.0);
                let depth = 1.0 - (a * (1.0 - u - v) + b * u + c * v).length();
                deepest = deepest.max(depth);
                mean += depth / 465.0;
            }
        }
        sum += mean * part;
        area += part;
    }
    assert!(near(geometry.forward.max, deepest, 0.01), "{} {deepest}", geometry.forward.max);
    assert!(near(geometry.forward.mean, sum / area, 0.02), "{} {}", geometry.forward.mean, sum / area);
    assert!(near(geometry.backward.mean, geometry.forward.mean, 0.03));
    assert!(geometry.volume_ratio.is_some_and(|ratio| ratio < 1.0 && ratio > 0.9));
}

#[test]
fn a_grown_sphere_is_as_far_as_it_has_grown() {
    let bench = Bench::new();
    let [old, new] = [sphere(5, 1.0), sphere(5, 1.1)];
    let (original, result) = (bench.write("a.obj", &old.0, &old.1), bench.write("b.obj", &new.0, &new.1));
    let Comparison { geometry, topology, quality, .. } = bench.compare(&original, &result, 3000);
    for way in [&geometry.forward, &geometry.backward] {
        assert!([way.max, way.mean, way.rms, way.p95].into_iter().all(|length| near(length, 0.1, 2e-3)));
    }
    assert!(near(geometry.volume_ratio.unwrap(), 1.1f64.powi(3), 1e-9));
    assert!(near(geometry.area_ratio, 1.21, 1e-9));
    assert!(near(geometry.volume.before.unwrap(), std::f64::consts::PI * 4.0 / 3.0, 2e-3));
    assert_eq!((topology.before.euler, topology.before.components, topology.before.boundary_edges), (2, 1, 0));
    assert_eq!((quality.before.valence_max, quality.before.valence_regular_share), (6, 1.0));
    assert!(quality.before.regularity_mean > 0.97 && quality.before.sliver_share == 0.0);
}

#[test]
fn a_lost_piece_is_where_the_largest_distance_is() {
    let bench = Bench::new();
    let (mut positions, mut faces) = sphere(2, 1.0);
    let result = bench.write("b.obj", &positions, &faces);
    let count = positions.len();
    positions.extend(sphere(2, 0.5).0.into_iter().map(|p| p + DVec3::X * 5.0));
    faces.extend(faces.clone().into_iter().map(|face| face.map(|v| v + count)));
    let original = bench.write("a.obj", &positions, &faces);
    let Comparison { geometry, topology, .. } = bench.compare(&original, &result, 100);
    assert_eq!((topology.before.components, topology.after.components), (2, 1));
    assert!(geometry.forward.max < 1e-12 && near(geometry.backward.max, 4.5, 0.01));
    let place = geometry.backward.worst[0];
    assert!(place.position[0] > 5.4 && place.closest[0] < 1.0, "{place:?}");
}

#[test]
fn the_numbers_do_not_depend_on_threads_and_hardly_on_cells() {
    let bench = Bench::new();
    let (positions, faces) = plane(60, |x, y| (x * 3.0).sin() * (y * 2.0).cos());
    let original = bench.write("a.obj", &positions, &faces);
    let (positions, faces) = plane(11, |x, y| (x * 3.0).sin() * (y * 2.0).cos());
    let result = bench.write("b.obj", &positions, &faces);
    let measured = |threads: usize, cell_faces: u64| {
        let resources = Resources { threads, ..RESOURCES };
        let options =
            CompareOptions { spread: Spread::Area(30_000), seed: 1, texel: None, work: bench.path("work"), resources };
        compare_in_cells([&(&original).into(), &(&result).into()], &options, cell_faces, &mut (), &Silent).unwrap()
    };
    let (one, many) = (measured(1, 400), measured(3, 400));
    assert_eq!(one, many);
    let whole = measured(2, 100_000);
    assert_eq!(one.topology, whole.topology);
    let pairs = [&one, &whole].map(|c| [c.geometry.forward.rms, c.geometry.backward.rms, c.geometry.normals.flipped]);
    assert!(pairs[0].iter().zip(pairs[1]).all(|(&a, b)| near(a, b, 0.02)), "{pairs:?}");
}

#[test]
fn cells_count_what_the_whole_counts() {
    let bench = Bench::new();
    for name in fs::read_dir("fixtures/miniatures").unwrap().map(|entry| entry.unwrap().path()) {
        if name.extension().is_none_or(|extension| extension != "obj") {
            continue;
        }
        let inputs = crate::read::find_inputs(&(&name).into()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let found = crate::read::scan(&inputs, folder.path(), &RESOURCES.scan, &Silent).unwrap();
        let loaded = Surface::load(&found.mesh, &found.catalogue).unwrap();
        let surface = loaded.welded().unwrap();
        let edges = EdgeTable::of_whole(&surface.faces).unwrap();
        let mut whole = count(&surface, &edges, |_, _| {}).unwrap().counts.finished();
        whole.topology.degenerate_faces = (loaded.faces.len() - surface.faces.len()) as u64;
        for cell_faces in [20, 300, 100_000] {
            let mesh =
                MeasuredMesh::prepare(&(&name).into(), &bench.path("work"), cell_faces, &RESOURCES, &Silent).unwrap();
            assert_eq!(mesh.counts.topology, whole.topology, "{} in cells of {cell_faces}", name.display());
            assert_eq!(mesh.counts.uv, whole.uv, "{}", name.display());
        }
    }
}

/// Fins of two triangles each that stand on a line, every second one closed up, so that cells are cut between them.
#[test]
fn folds_are_counted_within_cells_and_between_them() {
    let bench = Bench::new();
    let path = bench.path("fins.obj");
    let mut text = String::new();
    for i in 0..60 {
        let width = if i % 2 == 0 { 0.04 } else { 0.2 };
        let x = f64::from(i);
        text += &format!("v {x} 0 0\nv {} 0 0\nv {x} 1 {width}\nv {x} 1 -{width}\nf -4 -3 -2\nf -3 -4 -1\n", x + 1.0);
    }
    fs::write(&path, text).unwrap();
    for cell_faces in [3, 10, 1000] {
        let mesh =
            MeasuredMesh::prepare(&(&path).into(), &bench.path("work"), cell_faces, &RESOURCES, &Silent).unwrap();
        assert_eq!(mesh.counts.topology.folded_edges, 30, "cells of {cell_faces}");
    }
}

/// A square of ten by ten units with a grey ramp on it; texture coordinates are moved by `shift`.
fn ramp(bench: &Bench, name: &str, shift: f64) -> PathBuf {
    let image = image::RgbImage::from_fn(256, 256, |x, _| image::Rgb([x as u8; 3]));
    image.save(bench.path("ramp.png")).unwrap();
    fs::write(bench.path("ramp.mtl"), "newmtl ramp\nmap_Kd ramp.png\n").unwrap();
    let mut text = String::from("mtllib ramp.mtl\nusemtl ramp\n");
    for (x, y) in [(0, 0), (10, 0), (10, 10), (0, 10)] {
        let u = 0.25 + f64::from(x) / 20.0 + shift;
        text += &format!("v {x} {y} 0\nvt {u} {}\n", 0.25 + f64::from(y) / 20.0);
    }
    fs::write(bench.path(name), text + "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n").unwrap();
    bench.path(name)
}

#[test]
fn a_moved_image_slides_and_changes_its_colours() {
    let bench = Bench::new();
    let original = ramp(&bench, "a.obj", 0.0);
    let texture = bench.compare(&original, &original, 100).texture.unwrap();
    assert_eq!((texture.colour_mean, texture.outside_fraction, texture.images), (0.0, Some(0.0), 1));
    // half a texel of the grid: 10 / 1024 units, along each axis
    assert!(texture.slide_p95.unwrap() < 0.5f64.sqrt() * 10.0 / 1024.0);

    // a twentieth of the image is a unit of length and 12.8 of its texels
    let result = ramp(&bench, "b.obj", 0.05);
    let texture = bench.compare(&original, &result, 100).texture.unwrap();
    assert!(
        near(texture.slide_median.unwrap(), 1.0, 0.01) && near(texture.slide_p95.unwrap(), 1.0, 0.01),
        "{texture:?}"
    );
    assert!(near(texture.slide_texels_median.unwrap(), 12.8, 0.01));
    assert!(near(texture.colour_mean, 12.8, 0.01) && near(texture.colour_rms, 12.8, 0.01));
    assert!(near(texture.colour_backward_rms, 12.8, 0.01));
    // a tenth of the square shows what lies right of the chart
    assert!(near(texture.outside_fraction.unwrap(), 0.1, 0.05));
    assert_eq!((texture.untextured_fraction, texture.folded_triangles), (0.0, 0));
}

/// The square of [`ramp`] with an image of 256 pixels a side.
fn square_with(bench: &Bench, name: &str, pixel: impl Fn(u32) -> u8) -> PathBuf {
    let image = image::RgbImage::from_fn(256, 256, |x, _| image::Rgb([pixel(x); 3]));
    image.save(bench.path(&format!("{name}.png"))).unwrap();
    fs::write(bench.path(&format!("{name}.mtl")), format!("newmtl {name}\nmap_Kd {name}.png\n")).unwrap();
    let text = fs::read_to_string(ramp(bench, "ramp.obj", 0.0)).unwrap();
    let path = bench.path(&format!("{name}.obj"));
    fs::write(&path, text.replace("ramp", name)).unwrap();
    path
}

#[test]
fn the_original_is_filtered_as_coarse_texels_show_it() {
    let bench = Bench::new();
    let original = square_with(&bench, "stripes", |x| if x % 2 == 0 { 0 } else { 200 });
    let result = square_with(&bench, "grey", |_| 100);
    // Ten units of length show 128 pixels.
    let pixel = 10.0 / 128.0;
    let colours = |texel: Option<f64>, [a, b]: [&Path; 2]| {
        let options = CompareOptions {
            spread: Spread::Area(20_000),
            seed: 7,
            texel,
            work: bench.path("work"),
            resources: RESOURCES,
        };
        let found = compare_in_cells([&a.into(), &b.into()], &options, 100, &mut (), &Silent).unwrap();
        let texture = found.texture.unwrap();
        [texture.colour_mean, texture.colour_backward_mean]
    };
    let pair = [&*original, &*result];
    // Between the middles of pixels, colours run evenly from 0 to 200.
    for texel in [None, Some(1e-3 * pixel)] {
        assert!(colours(texel, pair).into_iter().all(|mean| near(mean, 50.0, 0.02)), "{texel:?}");
    }
    // Two and four pixels have grey as their mean, but for texels across the square's edge.
    for texel in [2.0 * pixel, 4.0 * pixel] {
        assert!(colours(Some(texel), pair).into_iter().all(|mean| mean < 2.0), "{:?}", colours(Some(texel), pair));
    }
    // The result is not filtered.
    assert!(colours(Some(4.0 * pixel), [&*result, &*original]).into_iter().all(|mean| near(mean, 50.0, 0.02)));
}

/// Two squares side by side, each with a chart of its own of the ramp; that of the right one is moved by `shift`.
///
/// ```text
///   +------+------+      u runs from 0.1 to 0.4 on the left, from 0.5 to 0.8 on the right
///   | left | right|      v runs from 0.25 to 0.75 on both
///   +------+------+
///   0     10     20
/// ```
fn two_charts(bench: &Bench, name: &str, shift: f64) -> PathBuf {
    ramp(bench, "ramp.obj", 0.0);
    let mut text = String::from("mtllib ramp.mtl\nusemtl ramp\n");
    for x in [0, 10, 20] {
        text += &format!("v {x} 0 0\nv {x} 10 0\n");
    }
    for u in [0.1, 0.4, 0.5 + shift, 0.8 + shift] {
        text += &format!("vt {u} 0.25\nvt {u} 0.75\n");
    }
    text += "f 1/1 3/3 4/4\nf 1/1 4/4 2/2\nf 3/5 5/7 6/8\nf 3/5 6/8 4/6\n";
    fs::write(bench.path(name), text).unwrap();
    bench.path(name)
}

#[test]
fn a_seam_gapes_as_far_as_one_of_its_charts_was_moved() {
    let bench = Bench::new();
    let (original, result) = (two_charts(&bench, "a.obj", 0.0), two_charts(&bench, "b.obj", 0.06));
    for cell_faces in [2, 100] {
        let SeamFigures { length, colour_mean, colour_rms, gap_p95, .. } =
            bench.compare(&original, &result, cell_faces).texture.unwrap().seams.before;
        assert_eq!(length, 10.0);
        // a tenth of the image lies between the charts, which is 25.6 steps of the ramp
        assert!(near(colour_mean, 25.6, 1e-3) && near(colour_rms, 25.6, 1e-3), "{colour_mean} {colour_rms}");
        // no farther than the texels of the grid are large: 10 / (0.3 * 2048) units across the seam
        assert!(gap_p95.unwrap() < 10.0 / (0.3 * 2048.0), "{gap_p95:?}");

        let seams = bench.compare(&original, &result, cell_faces).texture.unwrap().seams.after;
        assert!(near(seams.colour_mean, 0.16 * 256.0, 1e-3), "{seams:?}");
        // 0.06 of the image are a fifth of the right square; 12.8 texels along the seam are a unit of length
        assert!(near(seams.gap_median.unwrap(), 2.0, 0.01) && near(seams.gap_p95.unwrap(), 2.0, 0.01), "{seams:?}");
        assert!(near(seams.gap_texels_median.unwrap(), 25.6, 0.01), "{seams:?}");
        assert_eq!(seams.outside_fraction, Some(0.0));
    }
    // an edge inside a chart is no seam
    let whole = ramp(&bench, "c.obj", 0.0);
    let seams = bench.compare(&whole, &whole, 100).texture.unwrap().seams;
    assert_eq!((seams.before, seams.after), (SeamFigures::default(), SeamFigures::default()));
}

#[test]
fn a_image_that_cannot_be_read_is_a_warning() {
    let bench = Bench::new();
    let original = ramp(&bench, "a.obj", 0.0);
    fs::write(bench.path("ramp.png"), "no image").unwrap();
    let found = bench.compare(&original, &original, 100);
    assert!(found.texture.is_none());
    assert!(found.warnings.iter().any(|words| words.contains("unreadable image")), "{:?}", found.warnings);
    fs::remove_file(bench.path("ramp.png")).unwrap();
    let found = bench.compare(&original, &original, 100);
    assert!(found.texture.is_none() && found.warnings.iter().any(|words| words.contains("missing image")));
}

#[test]
fn a_mesh_of_nothing_but_points_and_lines_is_refused() {
    let bench = Bench::new();
    let (positions, faces) = plane(2, |_, _| 0.0);
    let (original, empty) = (bench.write("a.obj", &positions, &faces), bench.write("b.obj", &positions, &[[0, 0, 1]]));
    let options = CompareOptions {
        spread: Spread::Area(1000),
        seed: 1,
        texel: None,
        work: bench.path("work"),
        resources: RESOURCES,
    };
    let error = compare(&original, &empty, &options, &mut (), &Silent).unwrap_err();
    assert!(error.to_string().contains("no faces"), "{error}");
    assert!(!bench.path("work").exists());
}

/// Long triangles between random points of a cube, `size` times as wide as one unit.
fn tangle(count: usize, size: f64) -> (Vec<DVec3>, Vec<[usize; 3]>) {
    let mut state = 1u64;
    let mut unit = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let positions = (0..3 * count).map(|_| DVec3::new(unit(), unit(), unit()) * size).collect();
    (positions, (0..count).map(|face| [3 * face, 3 * face + 1, 3 * face + 2]).collect())
}

#[test]
fn points_that_are_given_up_are_counted_and_spoken_for() {
    let bench = Bench::new();
    let (positions, faces) = tangle(6000, 10.0);
    let original = bench.write("original.obj", &positions, &faces);
    let moved: Vec<DVec3> = positions.iter().map(|p| *p + DVec3::splat(0.01)).collect();
    let result = bench.write("result.obj", &moved, &faces);
    let found = bench.compare_at(Spread::Area(5000), &original, &result, CELL_FACES);
    let Geometry { forward, backward, symmetric, .. } = &found.geometry;
    assert_eq!(symmetric.cut_searches, forward.cut_searches + backward.cut_searches);
    assert!(symmetric.cut_searches > 2500, "{} points were given up", symmetric.cut_searches);
    assert!(found.warnings.iter().any(|words| words.contains("were given up")), "{:?}", found.warnings);

    // checked against every triangle for some points of the moved mesh: the mean is of few points, so it varies
    let triangle = |face: usize| faces[face].map(|vertex| positions[vertex]);
    let mut state = 7u64;
    let mut unit = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let areas: Vec<f64> = (0..faces.len()).map(|face| triangle::area(triangle(face))).collect();
    let total: f64 = areas.iter().sum();
    let (mut sum, mut most) = (0.0, 0.0f64);
    for _ in 0..400 {
        let mut place = unit() * total;
        let face = areas.iter().position(|area| {
            place -= area;
            place < 0.0
        });
        let [a, b, c] = triangle(face.unwrap_or(0));
        let (root, along) = (unit().sqrt(), unit());
        let point = a * (1.0 - root) + b * (root * (1.0 - along)) + c * (root * along) + DVec3::splat(0.01);
        let nearest = (0..faces.len()).map(|face| closest_point(point, triangle(face)).distance(point));
        let nearest = nearest.fold(f64::INFINITY, f64::min);
        sum += nearest;
        most = most.max(nearest);
    }
    assert!(near(forward.mean, sum / 400.0, 0.35), "{} {}", forward.mean, sum / 400.0);
    assert!(forward.max <= 0.01 * 3f64.sqrt() * (1.0 + 1e-9), "nothing moved farther than {}", forward.max);
    assert!(forward.max > 0.3 * most && forward.max <= forward.max_bound, "{} {most}", forward.max);
}

#[test]
fn sheets_by_the_hundred_are_not_drawn() {
    let bench = Bench::new();
    let stack = |sheets: usize| {
        let corners = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]];
        let sheet = |at: usize| corners.map(|[x, y]| DVec3::new(x, y, 10.0 * at as f64 / sheets as f64));
        let positions: Vec<DVec3> = (0..sheets).flat_map(sheet).collect();
        let faces: Vec<[usize; 3]> =
            (0..sheets).flat_map(|at| [[0, 1, 2], [0, 2, 3]].map(|f| f.map(|k| k + 4 * at))).collect();
        bench.write(&format!("{sheets}.obj"), &positions, &faces)
    };
    let (few, many) = (stack(50), stack(3000));
    let looks =
        |found: &Comparison| (found.pinholes.is_some(), found.warnings.iter().any(|w| w.contains("no pinholes")));
    assert_eq!(looks(&bench.compare(&few, &few, CELL_FACES)), (true, false));
    for pair in [[&few, &many], [&many, &few]] {
        assert_eq!(looks(&bench.compare(pair[0], pair[1], CELL_FACES)), (false, true));
    }
}

#[test]
fn what_is_uneven_and_far_away_is_searched_to_the_end() {
    // waves against a plane far below them: many triangles are about as near
    let bench = Bench::new();
    let (positions, faces) = plane(150, |x, y| 3.0 + 0.2 * ((7.0 * x).sin() + (11.0 * y).cos()));
    let original = bench.write("original.obj", &positions, &faces);
    let (positions, faces) = plane(40, |_, _| 0.0);
    let result = bench.write("result.obj", &positions, &faces);
    let found = bench.compare(&original, &result, CELL_FACES);
    let Distances { cut_searches, max, max_bound, .. } = found.geometry.symmetric;
    assert_eq!((cut_searches, max_bound), (0, max));
    assert!(found.warnings.is_empty(), "{:?}", found.warnings);
}

#[test]
fn a_soup_of_triangles_has_no_border() {
    let bench = Bench::new();
    let (positions, faces) = plane(140, |x, y| (x + y).sin());
    let corners: Vec<DVec3> = faces.iter().flatten().map(|&v| positions[v]).collect();
    // every triangle a little smaller, so that none shares a vertex
    let middle = |face: usize| (corners[3 * face] + corners[3 * face + 1] + corners[3 * face + 2]) / 3.0;
    let apart: Vec<DVec3> = corners.iter().enumerate().map(|(i, p)| p.lerp(middle(i / 3), 0.1)).collect();
    let soup: Vec<[usize; 3]> = (0..faces.len()).map(|face| [3 * face, 3 * face + 1, 3 * face + 2]).collect();
    let (whole, broken) = (bench.write("a.obj", &positions, &faces), bench.write("b.obj", &apart, &soup));
    assert!(bench.compare(&whole, &whole, CELL_FACES).geometry.border.is_some());
    let found = bench.compare(&whole, &broken, CELL_FACES);
    assert_eq!(found.topology.after.boundary_edges, 3 * faces.len() as u64);
    assert_eq!(found.geometry.border, None);
}

#[test]
fn what_a_gap_shows_is_its_share_of_the_surface() {
    let bench = Bench::new();
    // 200 × 200 squares of 0.05 units; four in the middle are missing in the result.
    let (positions, faces) = plane(200, |x, y| 0.3 * (x * 0.6).sin() * y.cos());
    let original = bench.write("whole.obj", &positions, &faces);
    let is_kept = |face: &&[usize; 3]| {
        let [x, y] = [0, 1].map(|axis| face.iter().map(|&v| positions[v][axis]).sum::<f64>() / 3.0);
        (x - 5.0).abs() > 0.05 || (y - 5.0).abs() > 0.05
    };
    let left: Vec<[usize; 3]> = faces.iter().filter(is_kept).copied().collect();
    assert_eq!(faces.len() - left.len(), 8);
    let holed = bench.write("holed.obj", &positions, &left);
    let found = bench.compare(&original, &holed, 10_000).pinholes.unwrap();
    // 4 of 40,000 squares; the rim of the outline does not count.
    assert!((80.0..150.0).contains(&found.ppm) && found.behind_ppm < 20.0, "{found:?}");
    assert!(found.worst.ppm >= found.ppm && !found.worst.rendering.is_empty());
    let same = bench.compare(&original, &original, 3_000).pinholes.unwrap();
    assert_eq!((same.ppm, same.behind_ppm, same.worst.rendering.len()), (0.0, 0.0, 0));
    // A hole that closes is no pinhole.
    assert_eq!(bench.compare(&holed, &original, 10_000).pinholes.unwrap().ppm, 0.0);
}

/// A sheet whose middle vertex rises by 1 has distance 1 / n at its n vertices, whatever the area around it; in the
/// other direction only the surface beneath the peak is near.
#[test]
fn at_vertices_every_vertex_counts_the_same() {
    let bench = Bench::new();
    let (flat, faces) = plane(4, |_, _| 0.0);
    let mut peak = flat.clone();
    peak[12].z = 1.0;
    let (original, result) = (bench.write("flat.obj", &flat, &faces), bench.write("peak.obj", &peak, &faces));
    let found = bench.compare_at(Spread::Vertices, &original, &result, 1 << 16);
    let Distances { max, mean, rms, median, .. } = found.geometry.forward;
    assert_eq!([max, mean, rms], [1.0, 1.0 / 25.0, 1.0 / 5.0]);
    assert!(median < 1e-15, "{median}");
    let backward = &found.geometry.backward;
    assert!(backward.max > 0.5 && near(backward.mean, backward.max / 25.0, 1e-12), "{backward:?}");
    assert_eq!(found.samples, None);
    let by_area = bench.compare(&original, &result, 1 << 16).geometry.forward;
    assert!(by_area.mean > 1.5 * mean && by_area.max == 1.0, "{by_area:?}");
}

/// Drift is unknown on an image that the original shows more than once, since a texel may have drifted from any of its
/// positions; on other images it is measured as before.
#[test]
fn the_drift_of_an_image_that_is_shown_twice_is_unknown() {
    let bench = Bench::new();
    let once = ramp(&bench, "once.obj", 0.0);
    let both = |name: &str| {
        let mut text = fs::read_to_string(&once).unwrap() + "usemtl bricks\n";
        for z in [5, 10] {
            for (x, y) in [(0, 0), (10, 0), (10, 10), (0, 10)] {
                text += &format!("v {x} {y} {z}\nvt {} {}\n", x / 10, y / 10);
            }
            text += "f -4/-4 -3/-3 -2/-2\nf -4/-4 -2/-2 -1/-1\n";
        }
        fs::write(bench.path(name), text).unwrap();
        bench.path(name)
    };
    let (before, after) = (both("a.obj"), both("b.obj"));
    let alone = bench.compare(&once, &once, 100).texture.unwrap();
    image::RgbImage::new(64, 64).save(bench.path("bricks.png")).unwrap();
    let materials = fs::read_to_string(bench.path("ramp.mtl")).unwrap() + "newmtl bricks\nmap_Kd bricks.png\n";
    fs::write(bench.path("ramp.mtl"), materials).unwrap();
    for cell_faces in [2, 100] {
        let texture = bench.compare(&before, &after, cell_faces).texture.unwrap();
        assert!(near(texture.repeated_fraction, 2.0 / 3.0, 0.01), "{texture:?}");
        assert_eq!(texture.outside_fraction, Some(0.0));
        assert!(near(texture.slide_p95.unwrap(), alone.slide_p95.unwrap(), 0.1), "{texture:?}");
    }
    let text = fs::read_to_string(&before).unwrap().replace("usemtl ramp", "usemtl bricks");
    fs::write(bench.path("bricks.obj"), text).unwrap();
    let texture = bench.compare(&bench.path("bricks.obj"), &bench.path("bricks.obj"), 100).texture.unwrap();
    assert_eq!((texture.slide_mean, texture.slide_p95, texture.outside_fraction), (None, None, None));
    assert_eq!((texture.repeated_fraction, texture.colour_rms), (1.0, 0.0));
}
