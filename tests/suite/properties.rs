//! Random meshes under random options: nothing is torn, doubled or turned over that was whole before.

use crate::meshes::{Sketch, noise};
use drystone::base::Silent;
use drystone::job::{Manifest, Resume, WorkFolder};
use drystone::measure::{Check, Surface, check, compare_checks, compare_topology, weld_and_check};
use drystone::options::{MetricChoice, SimplifyOptions};
use drystone::passes::{PassOptions, SeamPolicy};
use drystone::pipeline::simplify_in_passes;
use drystone::read::{ScanOptions, scan};
use drystone::remesh::cvd;
use glam::{DVec2, DVec3};
use proptest::prelude::*;

/// What the command line would set, and clusters that it would call too small.
#[derive(Debug, Clone, Copy)]
struct Choice {
    ratio: f64,
    seams: SeamPolicy,
    lock_borders: bool,
    weld: bool,
    has_uv_metric: bool,
    metric: Option<MetricChoice>,
    max_error: Option<f64>,
    drop_pieces: bool,
    frees_topology: bool,
    remesh: bool,
    cluster_faces: u64,
    passes: usize,
    threads: usize,
}

fn choices() -> impl Strategy<Value = Choice> {
    let seams = prop_oneof![Just(SeamPolicy::Stitch), Just(SeamPolicy::Follow), Just(SeamPolicy::Lock)];
    let cluster_faces = prop_oneof![20u64..60, 60u64..300, Just(1_000_000)];
    let published = [MetricChoice::Oblique, MetricChoice::Curvature, MetricChoice::Terrain, MetricChoice::Sharpness];
    let metric = prop::option::weighted(0.4, prop::sample::select(published.to_vec()));
    let max_error = prop::option::weighted(0.2, 0.0..2.0f64);
    let what = (metric, max_error, any::<bool>(), prop::bool::weighted(0.2), prop::bool::weighted(0.2), any::<bool>());
    (0.0..1.0f64, seams, any::<bool>(), prop::bool::weighted(0.8), what, cluster_faces, 1usize..5, 1usize..4).prop_map(
        |(ratio, seams, lock_borders, weld, what, cluster_faces, passes, threads)| Choice {
            ratio: ratio * ratio,
            seams,
            lock_borders,
            weld,
            metric: what.0,
            max_error: what.1,
            has_uv_metric: what.2,
            // The command line refuses these with a bound.
            drop_pieces: what.3 && what.1.is_none(),
            frees_topology: what.5,
            remesh: what.4 && what.1.is_none(),
            cluster_faces,
            passes,
            threads,
        },
    )
}

/// A grid with bumps; some quads are missing, some triangles show their backs, some edges between bands of columns are seams.
///
/// ```text
///   +--+--+--+  +--+--+      bands: own texture chart (mirrored or not), own material,
///   | /| /| /|  | /|  |      own copies of the vertices along the cut, or not
///   +--+--+--+  +--+--+
///   | /|  | /|  | /| /|      holes
///   +--+--+--+  +--+--+
/// ```
fn grids() -> impl Strategy<Value = Sketch> {
    let sizes = (2usize..18, 2usize..18, 1usize..6);
    let turned = prop_oneof![Just(0.0), 0.0..1.0f64];
    let kinds = (any::<u64>(), 0.0..0.3f64, 0.0..2.0f64, any::<bool>(), any::<bool>(), 0usize..3, turned);
    (sizes, kinds).prop_map(|((columns, rows, bands), (seed, holes, bump, is_cut, has_uv, around, turned))| {
        let mut sketch = grid(columns, rows, bands, seed, holes, bump, is_cut, has_uv, around);
        let faces = sketch.faces.iter_mut().enumerate();
        faces.filter(|(i, _)| noise(*i, 7, seed) < turned).for_each(|(_, face)| face.swap(1, 2));
        sketch
    })
}

#[allow(clippy::too_many_arguments, reason = "one for each thing that is random")]
fn grid(
    columns: usize,
    rows: usize,
    bands: usize,
    seed: u64,
    holes: f64,
    bump: f64,
    is_cut: bool,
    has_uv: bool,
    around: usize,
) -> Sketch {
    let mut sketch = Sketch::default();
    let width = columns.div_ceil(bands);
    // Flat, a tube, or a tube that is closed where its ends meet.
    let place = |i: usize, j: usize| {
        let z = bump * (noise(i % columns, j, seed) - 0.5);
        let angle = std::f64::consts::TAU * i as f64 / columns as f64;
        match around {
            1 | 2 if columns > 2 => DVec3::new((6.0 + z) * angle.cos(), (6.0 + z) * angle.sin(), j as f64),
            _ => DVec3::new(i as f64, j as f64, bump * (noise(i, j, seed) - 0.5)),
        }
    };
    for band in 0..bands {
        let (first, last) = (band * width, ((band + 1) * width).min(columns));
        if first >= last {
            break;
        }
        let base = sketch.positions.len();
        let side = rows + 1;
        for i in first..=last {
            for j in 0..=rows {
                let wraps = i == columns && around > 0 && columns > 2;
                sketch.positions.push(place(if wraps { 0 } else { i }, j));
                let sign = if noise(band, 1, seed) < 0.3 { -1.0 } else { 1.0 };
                if has_uv {
                    sketch.texcoords.push(DVec2::new(sign * i as f64 + 40.0 * (band % 2) as f64, j as f64) / 64.0);
                }
            }
        }
        for i in 0..last - first {
            for j in 0..rows {
                if noise(first + i, j, seed ^ 5) < holes {
                    continue;
                }
                let [a, b, c, d] =
                    [i * side + j, (i + 1) * side + j, (i + 1) * side + j + 1, i * side + j + 1].map(|v| v + base);
                let faces =
                    if noise(first + i, j, seed ^ 6) < 0.5 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
                sketch.faces.extend(faces.map(|face| face.map(|v| (v, v))));
                sketch.materials.extend([band % 3; 2]);
            }
        }
    }
    if !is_cut {
        join_copies(&mut sketch);
    }
    sketch
}

/// Makes vertices at one place one, with the texture coordinates as they were.
fn join_copies(sketch: &mut Sketch) {
    let mut first = std::collections::BTreeMap::new();
    for face in &mut sketch.faces {
        for (v, _) in face {
            *v = *first.entry(crate::meshes::bits(sketch.positions[*v])).or_insert(*v);
        }
    }
}

/// Triangles between random vertices: fins, fans, doubled faces and worse.
fn soups() -> impl Strategy<Value = Sketch> {
    (3usize..40, any::<u64>(), any::<bool>()).prop_flat_map(|(vertex_count, seed, has_uv)| {
        let corner = (0..vertex_count, 0..vertex_count, 0..vertex_count);
        prop::collection::vec((corner, 0usize..3), 1..120).prop_map(move |faces| {
            let at = |k| (0..vertex_count).map(move |v| noise(v, k, seed) * 10.0);
            let positions = at(0).zip(at(1)).zip(at(2)).map(|((x, y), z)| DVec3::new(x, y, z)).collect();
            let texcoords = at(3).zip(at(4)).map(|(u, v)| DVec2::new(u, v) / 10.0);
            let texcoords = texcoords.take(if has_uv { vertex_count } else { 0 }).collect();
            let mut sketch = Sketch { positions, texcoords, ..Sketch::default() };
            // At least one face has an area, or there is nothing to simplify.
            for ((a, b, c), material) in std::iter::once(((0, 1, 2), 0)).chain(faces) {
                sketch.faces.push([(a, a), (b, b), (c, c)]);
                sketch.materials.push(material);
            }
            sketch
        })
    })
}

/// A bumpy torus whose faces are joined in pairs by tubes of three walls, beside triangles that occur twice, one side and the
/// other out. Without texture.
fn knots() -> impl Strategy<Value = Sketch> {
    let kinds = (3usize..24, 0.0..1.0f64, 0usize..60, 0.0..0.3f64, any::<u64>());
    kinds.prop_map(|(side, tubed, doubled, bump, seed)| {
        let mut sketch = Sketch::default();
        for (i, j) in (0..side).flat_map(|i| (0..side).map(move |j| (i, j))) {
            let bumps = [0, 1, 2].map(|axis| bump * (2.0 * noise(i * side + j, axis, seed) - 1.0));
            let [around, across] = [i, j].map(|k| std::f64::consts::TAU * k as f64 / side as f64);
            let out = side as f64 * (0.4 + 0.15 * across.cos());
            let place = DVec3::new(out * around.cos(), out * around.sin(), 0.15 * side as f64 * across.sin());
            sketch.positions.push(place + DVec3::from_array(bumps));
        }
        let at = |i: usize, j: usize| (i % side) * side + j % side;
        let mut faces: Vec<[usize; 3]> = (0..side * side)
            .map(|k| (k / side, k % side))
            .flat_map(|(i, j)| [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]])
            .collect();
        faces.sort_by(|a, b| noise(a[0], a[1] * 997 + a[2], seed).total_cmp(&noise(b[0], b[1] * 997 + b[2], seed)));
        // Faces without a vertex in common.
        let mut is_used = vec![false; side * side];
        let (apart, mut rest): (Vec<_>, Vec<_>) = faces.into_iter().partition(|face| {
            let is_apart = face.iter().all(|&vertex| !is_used[vertex]);
            face.iter().for_each(|&vertex| is_used[vertex] |= is_apart);
            is_apart
        });
        let pairs = (tubed * (apart.len() / 2) as f64) as usize;
        for pair in apart[..2 * pairs].chunks_exact(2) {
            let (a, [p, q, r]) = (pair[0], pair[1]);
            let b = [p, r, q];
            for k in 0..3 {
                let next = (k + 1) % 3;
                rest.extend([[a[k], a[next], b[next]], [a[k], b[next], b[k]]]);
            }
        }
        rest.extend_from_slice(&apart[2 * pairs..]);
        for i in 0..doubled {
            let base = sketch.positions.len();
            let corners =
                [DVec3::ZERO, DVec3::X, DVec3::Y].map(|corner| corner + DVec3::new(2.0 * i as f64, -9.0, 0.0));
            sketch.positions.extend(corners);
            rest.extend([[0, 1, 2], [0, 1, 2], [2, 1, 0]].map(|face| face.map(|corner| base + corner)));
        }
        sketch.faces = rest.into_iter().map(|face| face.map(|vertex| (vertex, vertex))).collect();
        sketch.materials = vec![0; sketch.faces.len()];
        sketch
    })
}

/// Cubes at some places of a block, each with all its walls: neighbours have a wall twice, others share an edge or a corner.
fn cubes() -> impl Strategy<Value = Sketch> {
    (2usize..5, 0.1..0.9f64, any::<u64>()).prop_map(|(side, filled, seed)| {
        let mut sketch = Sketch::default();
        let mut vertices = std::collections::BTreeMap::new();
        let place = |k: usize| [k / side / side, k / side % side, k % side];
        let is_filled = |k: &usize| *k == 0 || noise(*k, 0, seed) < filled;
        for (cube, axis, end) in
            (0..side.pow(3)).filter(is_filled).flat_map(|k| (0..6).map(move |wall| (place(k), wall / 2, wall % 2)))
        {
            let corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[across, up]| {
                let mut at = cube;
                at[axis] += end;
                at[(axis + 1) % 3] += across;
                at[(axis + 2) % 3] += up;
                *vertices.entry(at).or_insert_with(|| {
                    sketch.positions.push(DVec3::from_array(at.map(|x| x as f64)));
                    sketch.positions.len() - 1
                })
            });
            let [a, b, c, d] = if end == 1 { corners } else { [corners[3], corners[2], corners[1], corners[0]] };
            sketch.faces.extend([[a, b, c], [a, c, d]].map(|face| face.map(|vertex| (vertex, vertex))));
            sketch.materials.extend([0; 2]);
        }
        sketch
    })
}

/// Boxes that stand apart, each a component of its own.
fn boxes() -> impl Strategy<Value = Sketch> {
    (1usize..40, any::<u64>()).prop_map(|(count, seed)| {
        let mut sketch = Sketch::default();
        for k in 0..count {
            let base = sketch.positions.len();
            let size = DVec3::from_array([0, 1, 2].map(|axis| 0.05 + 1.5 * noise(k, axis, seed)));
            let place = DVec3::new(2.0 * (k % 6) as f64, 2.0 * (k / 6) as f64, noise(k, 3, seed));
            let corner = |i: usize| DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64);
            sketch.positions.extend((0..8).map(|i| place + size * corner(i)));
            let walls = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
            for [a, b, c, d] in walls.map(|wall| wall.map(|corner| (base + corner, base + corner))) {
                sketch.faces.extend([[a, b, c], [a, c, d]]);
                sketch.materials.extend([0; 2]);
            }
        }
        sketch
    })
}

/// Runs the passes and returns the mesh before and after.
fn run(sketch: &Sketch, choice: &Choice) -> (Surface, Surface) {
    // In memory where there is such a place: thousands of small jobs would wait for the disk.
    let folder = tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).unwrap();
    let input = folder.path().join("in.obj");
    std::fs::write(&input, sketch.text()).unwrap();
    let options = ScanOptions { chunks_in_flight: 1, ..Default::default() };
    let manifest = Manifest { passes: 1, ..Manifest::default() };
    let job = WorkFolder::open(&folder.path().join("work"), &manifest, Resume::Never).unwrap();
    let scanned = scan(&[input], job.path(), &options, &Silent).unwrap();
    let before = Surface::load(&scanned.mesh, &scanned.catalogue).unwrap();
    let has_uv = choice.has_uv_metric && scanned.catalogue.has_texcoords;
    let metric = SimplifyOptions { metric: choice.metric, uv_weight: 1.0, ..SimplifyOptions::default() };
    let options = PassOptions {
        max_error: choice.max_error,
        drop_pieces: choice.drop_pieces,
        one_by_one: false,
        drop_doubles: false,
        drop_texcoords: false,
        kept_steps: &[],
        frees_topology: choice.frees_topology,
        target: choice.max_error.map_or((scanned.triangles as f64 * choice.ratio).round() as u64, |_| 0),
        input: scanned.triangles,
        passes: choice.passes,
        cluster_faces: choice.cluster_faces,
        cost: metric.cost(has_uv).unwrap(),
        seams: choice.seams,
        lock_borders: choice.lock_borders,
        remesh: choice.remesh.then(cvd::CvdSettings::default),
        optimize: choice.has_uv_metric && choice.max_error.is_none(),
        weld: choice.weld,
        map: None,
        threads: choice.threads,
        work_bytes: 100 << 20,
    };
    let passes = simplify_in_passes(scanned.mesh.into(), &options, &scanned.catalogue, &job, &Silent).unwrap();
    let after = Surface::load(&passes.mesh, &scanned.catalogue).unwrap();
    assert_eq!(after.faces.len() as u64, passes.faces);
    (before, after)
}

/// Nothing is worse than before; a mesh that is not welded is counted as it is.
fn news(sketch: &Sketch, choice: &Choice) -> Result<(), TestCaseError> {
    news_but(None, sketch, choice)
}

/// Nothing but a count of this name is worse than before.
fn news_but(name: Option<&str>, sketch: &Sketch, choice: &Choice) -> Result<(), TestCaseError> {
    let (before, after) = run(sketch, choice);
    // Clusters of some dozens of faces are mostly rims, where what remeshing put into edges stays.
    let may_grow = choice.remesh && choice.cluster_faces < 1000;
    prop_assert!(after.faces.len() <= before.faces.len() || may_grow);
    let count = if choice.weld { weld_and_check } else { check };
    let (was, now) = (count(&before).unwrap(), count(&after).unwrap());
    // An edge that loses all but two of its faces is manifold, and may be left with two that run the same way.
    let faulty = |check: &Check| check.inconsistent_edges + check.non_manifold_edges;
    prop_assert!(faulty(&now) <= faulty(&was), "{was:?} {now:?}");
    let mut news = compare_checks(&was, &now);
    if !choice.frees_topology {
        news.extend(compare_topology(&was, &now));
    }
    news.retain(|regression| regression.what != "inconsistent edges");
    // Likewise two that lie on each other, and two whose texture triangles lie on one side of it: they are in one chart only
    // once nothing else meets there, and once they run against each other.
    let became_sound = faulty(&now) < faulty(&was) || now.non_manifold_edges < was.non_manifold_edges;
    let shows = |what: &str| what == "folded edges" || what == "folded texture triangles";
    news.retain(|regression| !shows(regression.what) || !became_sound);
    // Copies that are kept apart may leave each other along a straight border.
    news.retain(|regression| choice.weld || regression.what != "T-junctions");
    news.retain(|regression| name != Some(regression.what));
    prop_assert!(news.is_empty(), "{}", news.iter().map(|n| n.to_string()).collect::<Vec<_>>().join("; "));
    Ok(())
}

/// Points on a triangle: its corners, and others in rows between them.
fn points_on([a, b, c]: [DVec3; 3]) -> impl Iterator<Item = DVec3> {
    const ROWS: u32 = 7;
    let share = |i: u32| f64::from(i) / f64::from(ROWS);
    (0..=ROWS).flat_map(move |i| (0..=ROWS - i).map(move |j| a + (b - a) * share(i) + (c - a) * share(j)))
}

/// Distance of a point to a triangle: to its plane where the foot lies inside, else to the nearest side.
fn distance(p: DVec3, corners: [DVec3; 3]) -> f64 {
    let [a, b, c] = corners;
    let normal = (b - a).cross(c - a);
    let sides = [(a, b), (b, c), (c, a)];
    if normal.length_squared() > 0.0 && sides.iter().all(|&(q, r)| (r - q).cross(p - q).dot(normal) >= 0.0) {
        return (p - a).dot(normal).abs() / normal.length();
    }
    let to_side = |&(q, r): &(DVec3, DVec3)| {
        let along = r - q;
        let share = if along.length_squared() > 0.0 { (p - q).dot(along) / along.length_squared() } else { 0.0 };
        p.distance(q + along * share.clamp(0.0, 1.0))
    };
    sides.iter().map(to_side).fold(f64::INFINITY, f64::min)
}

/// Largest distance of points on one surface to the other; faces that repeat a vertex are no surface.
fn farthest(from: &Surface, to: &Surface) -> f64 {
    let triangles = |surface: &Surface| -> Vec<[DVec3; 3]> {
        let places = surface.faces.iter().map(|face| face.map(|v| surface.positions[v]));
        places.filter(|[a, b, c]| a != b && b != c && c != a).collect()
    };
    let targets = triangles(to);
    let nearest = |p: DVec3| targets.iter().map(|&corners| distance(p, corners)).fold(f64::INFINITY, f64::min);
    triangles(from).into_iter().flat_map(points_on).map(nearest).fold(0.0, f64::max)
}

/// No point of either surface is farther from the other than the bound, but for the rounding of numbers.
fn keeps_bound(sketch: &Sketch, choice: &Choice, most: f64) -> Result<(), TestCaseError> {
    let (before, after) = run(sketch, &Choice { max_error: Some(most), drop_pieces: false, remesh: false, ..*choice });
    let (forward, backward) = (farthest(&before, &after), farthest(&after, &before));
    prop_assert!(forward <= most + 1e-12 && backward <= most + 1e-12, "{forward} {backward} > {most}");
    Ok(())
}

/// Bounds from none at all to the size of the mesh.
fn bounds() -> impl Strategy<Value = f64> {
    prop_oneof![1 => Just(0.0), 8 => (-4.0..0.5f64).prop_map(|power| 10f64.powf(power))]
}

proptest! {
    #![proptest_config(crate::meshes::cases(64, 2000))]

    #[test]
    fn a_grid_comes_out_as_whole_as_it_was(sketch in grids(), choice in choices()) {
        news(&sketch, &choice)?;
    }

    #[test]
    fn a_soup_comes_out_no_worse_than_it_was(sketch in soups(), choice in choices()) {
        news(&sketch, &choice)?;
    }

    /// Many of its faces nearly lie on each other. Such a pair may close across a border between clusters, which neither
    /// of them sees, and in remeshing, whose faces are all new.
    #[test]
    fn a_knot_comes_out_no_worse_than_it_was(sketch in knots(), choice in choices()) {
        let may_fold = choice.remesh || choice.cluster_faces < 1_000_000;
        news_but(may_fold.then_some("folded edges"), &sketch, &choice)?;
    }

    #[test]
    fn cubes_come_out_no_worse_than_they_were(sketch in cubes(), choice in choices()) {
        news(&sketch, &choice)?;
    }

    #[test]
    fn no_point_of_a_grid_leaves_the_bound(sketch in grids(), choice in choices(), most in bounds()) {
        keeps_bound(&sketch, &choice, most)?;
    }

    #[test]
    fn no_point_of_a_soup_leaves_the_bound(sketch in soups(), choice in choices(), most in bounds()) {
        keeps_bound(&sketch, &choice, most)?;
    }
    #[test]
    fn no_point_of_a_box_leaves_the_bound(sketch in boxes(), choice in choices(), most in bounds()) {
        keeps_bound(&sketch, &choice, most)?;
    }
}
