//! Meshes for the tests: where they lie, how they are made, and how a result is read again by tobj.

#![allow(dead_code, reason = "every test file takes what it needs")]

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicU64, Ordering};

use drystone::base::{Progress, Silent};
use drystone::measure::compare::{CompareOptions, Geometry, Resources, Spread, compare};
use drystone::measure::{Check, Surface, compare_checks, compare_topology, weld_and_check};
use drystone::model::id::{MaterialId, MeshVertex, Texcoord};
use drystone::options::{Limits, SimplifyOptions, Target, Topology};
use drystone::pipeline;
use drystone::read::ScanOptions;
use drystone::report::{Report, Status};
use glam::{DVec2, DVec3};
use proptest::prelude::ProptestConfig;
use proptest::test_runner::RngSeed;
use tempfile::TempDir;

/// Stops after a number of units of work.
pub struct StopAfter {
    left: AtomicU64,
}

impl StopAfter {
    /// Stops after this much work.
    pub fn units(units: u64) -> Self {
        Self { left: AtomicU64::new(units) }
    }
}

impl Progress for StopAfter {
    fn begin(&self, _: &'static str, _: u64, _: &'static str) {}

    fn advance(&self, _: u64) {
        let _ = self.left.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |left| left.checked_sub(1));
    }

    fn is_stopped(&self) -> bool {
        self.left.load(Ordering::SeqCst) == 0
    }
}

/// A file under `fixtures/`.
pub fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

/// The town: 18,218 triangles.
pub fn town() -> PathBuf {
    fixture("town/town.obj")
}

/// Copies the town with its library and textures into a new folder.
pub fn copy_town(folder: &Path) {
    std::fs::create_dir(folder).unwrap();
    for entry in std::fs::read_dir(town().parent().unwrap()).unwrap().flatten() {
        std::fs::copy(entry.path(), folder.join(entry.file_name())).unwrap();
    }
}

/// Paths of all files below a folder, from it.
pub fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![PathBuf::new()];
    while let Some(at) = folders.pop() {
        for entry in std::fs::read_dir(folder.join(&at)).into_iter().flatten().flatten() {
            if entry.file_type().unwrap().is_dir() {
                folders.push(at.join(entry.file_name()))
            } else {
                found.push(at.join(entry.file_name()))
            }
        }
    }
    found.sort();
    found
}

/// Paths of all files below a folder, from it, and their bytes.
pub fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    files(folder).into_iter().map(|path| (path.clone(), std::fs::read(folder.join(path)).unwrap())).collect()
}

/// The same cases in every run, so that a failure is the change's; PROPTEST_CASES=5000 tries so many new ones.
pub fn cases(cases: u32, max_shrink_iters: u32) -> ProptestConfig {
    let explored = ProptestConfig { failure_persistence: None, max_shrink_iters, ..ProptestConfig::default() };
    match std::env::var_os("PROPTEST_CASES") {
        Some(_) => explored,
        None => ProptestConfig { cases, rng_seed: RngSeed::Fixed(1), ..explored },
    }
}

/// Options with a ratio, 256 MiB and two threads.
pub fn ratio(ratio: f64) -> SimplifyOptions {
    SimplifyOptions {
        target: Target::ratio(ratio),
        limits: Limits { memory: Some(256 << 20), threads: Some(2) },
        ..SimplifyOptions::default()
    }
}

/// Many clusters: the smallest that the options allow.
pub fn in_many_clusters(options: SimplifyOptions) -> SimplifyOptions {
    SimplifyOptions { cluster_faces: 1000, ..options }
}

/// A finished run; its folder goes with it.
pub struct Run {
    /// What the program says.
    pub report: Report,
    /// The OBJ that it wrote.
    pub output: PathBuf,
    folder: TempDir,
}

/// Simplifies a file or a folder of files.
pub fn simplify(input: &Path, options: &SimplifyOptions) -> Run {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out.obj");
    let report = pipeline::simplify(input, &output, options, &Silent).unwrap();
    Run { report, output, folder }
}

/// Simplifies OBJ text.
pub fn simplify_text(text: &str, options: &SimplifyOptions) -> Run {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("in.obj");
    std::fs::write(&input, text).unwrap();
    simplify(&input, options)
}

/// Root mean square distance between an input and the result of a run, both ways.
pub fn rms_distance(input: &Path, run: &Run) -> f64 {
    geometry(input, run).symmetric.rms
}

/// Largest distance between an input and the result of a run, both ways.
pub fn max_distance(input: &Path, run: &Run) -> f64 {
    geometry(input, run).symmetric.max
}

fn geometry(input: &Path, run: &Run) -> Geometry {
    let folder = tempfile::tempdir().unwrap();
    let scan = ScanOptions { threads: 2, chunks_in_flight: 4, catalogue_bytes: 1 << 30 };
    let resources = Resources { threads: 2, work_bytes: 100 << 20, scan };
    let options = CompareOptions {
        spread: Spread::Area(50_000),
        seed: 1,
        texel: None,
        work: folder.path().join("work"),
        resources,
    };
    compare(input, &run.output, &options, &mut (), &Silent).unwrap().geometry
}

impl Run {
    /// The text of the result.
    pub fn text(&self) -> String {
        std::fs::read_to_string(&self.output).unwrap()
    }

    /// The result as tobj reads it.
    pub fn mesh(&self) -> Mesh {
        read(&self.output)
    }

    /// The folder of the result.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }
}

/// A mesh as tobj reads it, with vertices at bit-identical positions made one.
pub struct Mesh {
    /// Everything but colours and names.
    pub surface: Surface,
    /// Colour of each vertex, if the file has them.
    pub colours: Vec<DVec3>,
    /// Faces of each material in use, by name.
    pub materials: BTreeMap<String, u64>,
    /// Texture image of each material in use.
    pub textures: BTreeMap<String, String>,
    /// Whether each face shows an image.
    pub shows_image: Vec<bool>,
    /// Faces that have normals.
    pub faces_with_normals: usize,
}

/// Reads a mesh with tobj.
pub fn read(path: &Path) -> Mesh {
    let options = tobj::LoadOptions { triangulate: true, ..tobj::LoadOptions::default() };
    let (models, materials) = tobj::load_obj(path, &options).unwrap();
    let materials = materials.unwrap_or_default();
    let mut surface = Surface::default();
    let mut mesh = Mesh {
        surface: Surface::default(),
        colours: Vec::new(),
        materials: BTreeMap::new(),
        textures: BTreeMap::new(),
        shows_image: Vec::new(),
        faces_with_normals: 0,
    };
    let mut ids: BTreeMap<[u64; 3], MeshVertex> = BTreeMap::new();
    for model in &models {
        let part = &model.mesh;
        let mut local = Vec::new();
        for (i, p) in part.positions.chunks_exact(3).enumerate() {
            let position = DVec3::from_slice(p);
            let id = *ids.entry(position.to_array().map(|x| (x + 0.0).to_bits())).or_insert_with(|| {
                mesh.colours.extend(part.vertex_color.chunks_exact(3).nth(i).map(DVec3::from_slice));
                surface.positions.push_and_get_key(position)
            });
            local.push(id);
        }
        let first = Texcoord::from(surface.texcoords.len());
        surface.texcoords.extend(part.texcoords.chunks_exact(2).map(DVec2::from_slice));
        surface.faces.extend(part.indices.chunks_exact(3).map(|f| [0, 1, 2].map(|k| local[f[k] as usize])));
        let count = part.indices.len() / 3;
        if part.texcoord_indices.is_empty() {
            surface.face_texcoords.extend(vec![[Texcoord::NONE; 3]; count]);
        } else {
            let faces = part.texcoord_indices.chunks_exact(3);
            surface.face_texcoords.extend(faces.map(|f| [0, 1, 2].map(|k| first.plus(f[k]))));
        }
        let material = part.material_id.map_or(MaterialId::NONE, MaterialId::from);
        surface.face_materials.extend(vec![material; count]);
        let described = part.material_id.and_then(|id| materials.get(id));
        let shows_image = described.is_some_and(|material| material.diffuse_texture.is_some());
        mesh.shows_image.extend(vec![shows_image; count]);
        if let Some(material) = described {
            *mesh.materials.entry(material.name.clone()).or_default() += count as u64;
            let texture = material.diffuse_texture.clone();
            mesh.textures.extend(texture.map(|texture| (material.name.clone(), texture)));
        }
        mesh.faces_with_normals += part.normal_indices.len() / 3;
    }
    mesh.surface = surface;
    mesh
}

impl Mesh {
    /// Number of triangles.
    pub fn face_count(&self) -> u64 {
        self.surface.faces.len() as u64
    }

    /// Cracks, folds and the like.
    pub fn check(&self) -> Check {
        weld_and_check(&self.surface).unwrap()
    }

    /// Sum of the triangles' areas.
    pub fn area(&self) -> f64 {
        self.triangles().map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).sum()
    }

    /// Positions of the corners of each face.
    pub fn triangles(&self) -> impl Iterator<Item = [DVec3; 3]> {
        self.surface.faces.iter().map(|face| face.map(|v| self.surface.positions[v]))
    }

    /// Ends of the edges with exactly one face, as bits, the lower end first.
    pub fn border_edges(&self) -> BTreeSet<[[u64; 3]; 2]> {
        let mut uses: BTreeMap<[[u64; 3]; 2], u32> = BTreeMap::new();
        for face in &self.surface.faces {
            for k in 0..3 {
                let mut ends = [face[k], face[(k + 1) % 3]].map(|v| bits(self.surface.positions[v]));
                ends.sort_unstable();
                *uses.entry(ends).or_default() += 1;
            }
        }
        uses.into_iter().filter(|&(_, count)| count == 1).map(|(ends, _)| ends).collect()
    }

    /// Texture coordinates at each position.
    pub fn texcoords_by_position(&self) -> BTreeMap<[u64; 3], Vec<DVec2>> {
        let mut found: BTreeMap<[u64; 3], Vec<DVec2>> = BTreeMap::new();
        for (face, texcoords) in self.surface.faces.iter().zip(&self.surface.face_texcoords) {
            for (&v, &t) in face.iter().zip(texcoords) {
                if t != Texcoord::NONE {
                    let here = found.entry(bits(self.surface.positions[v])).or_default();
                    let uv = self.surface.texcoords[t];
                    if !here.contains(&uv) {
                        here.push(uv);
                    }
                }
            }
        }
        found
    }
}

/// A position as bits.
pub fn bits(position: DVec3) -> [u64; 3] {
    position.to_array().map(|x| (x + 0.0).to_bits())
}

/// Asserts what must hold of every result.
pub fn assert_sound(input: &Mesh, run: &Run) {
    let mesh = run.mesh();
    let text = run.text();
    let faces = &run.report.faces;
    assert_eq!(mesh.face_count(), faces.output, "the report counts what was written");
    let slack = (faces.target as f64 * 0.001).max(2.0);
    match run.report.status {
        Status::Done => assert!(faces.output.abs_diff(faces.target) as f64 <= slack, "{faces:?}"),
        Status::TargetMissed => assert!(faces.output > faces.target, "{faces:?}"),
    }
    assert_indices(&text);
    assert_materials(input, &mesh);
    let (before, after) = (input.check(), mesh.check());
    let mut news = compare_checks(&before, &after);
    if run.report.options.topology == Topology::Keep {
        news.extend(compare_topology(&before, &after));
    }
    assert!(news.is_empty(), "{}", news.iter().map(|n| n.to_string()).collect::<Vec<_>>().join("; "));
}

/// Asserts that no material is new, and that none is lost whose fair share of the faces is ten or more.
fn assert_materials(input: &Mesh, mesh: &Mesh) {
    assert!(mesh.materials.keys().all(|name| input.materials.contains_key(name)));
    let share = mesh.face_count() as f64 / input.face_count() as f64;
    for (name, &count) in &input.materials {
        let is_small = (count as f64) * share < 10.0;
        assert!(is_small || mesh.materials.contains_key(name), "{name} is lost, of {count} faces");
    }
}

/// Asserts that every index of OBJ text is in range, and that every `v`, `vt` and `vn` is used.
fn assert_indices(text: &str) {
    let mut counts = [0usize; 3];
    let mut used: [BTreeSet<usize>; 3] = Default::default();
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => counts[0] += 1,
            Some("vt") => counts[1] += 1,
            Some("vn") => counts[2] += 1,
            Some("f") => {
                for (slot, index) in words.flat_map(|corner| corner.split('/').enumerate()) {
                    if !index.is_empty() {
                        used[slot].insert(index.parse().unwrap());
                    }
                }
            }
            _ => {}
        }
    }
    for (used, count) in used.iter().zip(counts) {
        assert!(used.iter().copied().eq(1..=count), "{} of {count} are used, up to {:?}", used.len(), used.last());
    }
}

/// A mesh to write as OBJ text: positions, texture coordinates, and faces as pairs of both, with a material each.
#[derive(Debug, Clone, Default)]
pub struct Sketch {
    /// Positions.
    pub positions: Vec<DVec3>,
    /// Texture coordinates; none: faces are written without.
    pub texcoords: Vec<DVec2>,
    /// Corners: position and texture coordinate.
    pub faces: Vec<[(usize, usize); 3]>,
    /// Number of the material of each face; may be empty.
    pub materials: Vec<usize>,
}

impl Sketch {
    /// OBJ text; positions with six decimals.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for p in &self.positions {
            let _ = writeln!(text, "v {:.6} {:.6} {:.6}", p.x, p.y, p.z);
        }
        for t in &self.texcoords {
            let _ = writeln!(text, "vt {:.6} {:.6}", t.x, t.y);
        }
        let mut current = None;
        for (i, face) in self.faces.iter().enumerate() {
            let material = self.materials.get(i);
            if material != current {
                current = material;
                let _ = writeln!(text, "usemtl m{}", material.unwrap_or(&0));
            }
            let corners = face.map(|(v, t)| {
                let texcoord = if self.texcoords.is_empty() { String::new() } else { format!("/{}", t + 1) };
                format!("{}{texcoord}", v + 1)
            });
            let _ = writeln!(text, "f {}", corners.join(" "));
        }
        text
    }
}

/// Noise between 0 and 1 that depends on two numbers and a seed.
pub fn noise(i: usize, j: usize, seed: u64) -> f64 {
    let mut x = seed ^ (i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (j as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
    for _ in 0..2 {
        x = (x ^ (x >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    }
    (x >> 11) as f64 / (1u64 << 53) as f64
}

/// Hills and noise over a grid of `side` × `side` quads: 2 × `side`² triangles, one chart.
pub fn terrain(side: usize) -> Sketch {
    let mut sketch = Sketch::default();
    for j in 0..=side {
        for i in 0..=side {
            let (x, y) = (i as f64, j as f64);
            let hills = 6.0 * (x * 0.07).sin() * (y * 0.05).cos() + 1.5 * (x * 0.31 + y * 0.23).sin();
            let shift = DVec2::new(noise(i, j, 2) - 0.5, noise(i, j, 3) - 0.5) * 0.5;
            sketch.positions.push(DVec3::new(x + shift.x, y + shift.y, hills + 0.2 * noise(i, j, 1)));
            sketch.texcoords.push(DVec2::new(x, y) / side as f64);
        }
    }
    let at = |i: usize, j: usize| j * (side + 1) + i;
    for j in 0..side {
        for i in 0..side {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)].map(|v| (v, v));
            sketch.faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    sketch
}

/// A torus of radii 3 and 1: 2 × `around` × `across` triangles, closed, without texture.
pub fn torus(around: usize, across: usize) -> Sketch {
    let mut sketch = Sketch::default();
    for j in 0..across {
        for i in 0..around {
            let (s, t) = (i as f64 / around as f64, j as f64 / across as f64);
            let (s, t) = (s * std::f64::consts::TAU, t * std::f64::consts::TAU);
            let radius = 1.0 + 0.02 * noise(i, j, 1);
            let out = 3.0 + radius * t.cos();
            sketch.positions.push(DVec3::new(out * s.cos(), out * s.sin(), radius * t.sin()));
        }
    }
    let at = |i: usize, j: usize| (j % across * around + i % around, 0);
    for j in 0..across {
        for i in 0..around {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            sketch.faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    sketch
}

/// What `drystone status` tells of a work folder.
pub fn status(work: &Path) -> serde_json::Value {
    let mut command = Command::new(env!("CARGO_BIN_EXE_drystone"));
    let output = command.arg("status").arg(work).arg("--json").output().unwrap();
    serde_json::from_slice(&output.stdout).unwrap()
}
