//! Tests that read results back with an independent reader.

use std::fs;

use glam::{DVec2, DVec3};

use super::*;
use crate::base::ErrorKind;
use crate::base::Silent;
use crate::base::pool::Pool;
use crate::file::{ColumnWriter, PackedWriter};
use crate::model::catalogue::{MaterialDefinition, TextureStatement};
use crate::model::id::{FileId, MaterialId, NameId, PartId, PieceTexcoord, PieceVertex};
use crate::model::{Face, FaceWriter, Material, Part, StoredPiece};
use crate::os::durable::{waiting_place, witness};

const NONE: u32 = PieceTexcoord::NONE.number();
const BARE: [u32; 3] = [NONE; 3];

fn options() -> WriteOptions {
    WriteOptions {
        textures: Textures::Copy,
        brings_outside: false,
        normals: false,
        turns_z_up: false,
        force: false,
        replaces_own: false,
        work_bytes: 32 * MIB,
        sources: Sources::default(),
        job: 1,
    }
}

fn face(vertices: [u32; 3], texcoords: [u32; 3], part: u32) -> Face<PieceVertex> {
    let (vertices, texcoords) = (vertices.map(PieceVertex::new), texcoords.map(PieceTexcoord::new));
    Face { vertices, texcoords, part: PartId::new(part), ..Face::default() }
}

#[derive(Default)]
struct Piece {
    positions: Vec<DVec3>,
    colours: Option<Vec<[f32; 3]>>,
    texcoords: Vec<DVec2>,
    faces: Vec<Face<PieceVertex>>,
}

fn store(folder: &Path, shared: &[DVec3], pieces: &[Piece]) -> StoredMesh {
    let column = |name: String, positions: &[DVec3]| {
        let mut column = PackedWriter::create(&folder.join(name), *b"position").unwrap();
        column.append(positions).unwrap();
        column.finish().unwrap()
    };
    let pieces = pieces.iter().enumerate().map(|(i, piece)| {
        let mut texcoords = PackedWriter::create(&folder.join(format!("{i}.t")), *b"texcoord").unwrap();
        texcoords.append(&piece.texcoords).unwrap();
        let mut faces = FaceWriter::create(&folder.join(format!("{i}.f"))).unwrap();
        faces.append(&piece.faces).unwrap();
        let colours = piece.colours.as_ref().map(|colours| {
            let mut column = ColumnWriter::create(&folder.join(format!("{i}.c")), *b"colours ").unwrap();
            column.append(colours).unwrap();
            column.finish().unwrap()
        });
        StoredPiece {
            positions: column(format!("{i}.v"), &piece.positions),
            colours,
            texcoords: texcoords.finish().unwrap(),
            faces: faces.finish().unwrap(),
        }
    });
    StoredMesh {
        pieces: pieces.collect(),
        shared_positions: (!shared.is_empty()).then(|| column("shared.v".into(), shared)),
        shared_colours: None,
    }
}

fn material(name: &str, folder: &Path, texture: &str) -> Material {
    let statement = TextureStatement { key_and_options: b"map_Kd -s 1 1 1".into(), name: texture.into() };
    Material {
        name: name.into(),
        output_name: name.into(),
        definition: Some(MaterialDefinition {
            folder: folder.to_owned(),
            statements: vec![b"Kd 0.5 0.5 0.5".into(), b"illum 2".into()],
            textures: vec![statement],
        }),
    }
}

fn part(object: Option<u32>, group: Option<u32>, material: Option<u32>) -> Part {
    let (object, group) = (object.map(NameId::new), group.map(NameId::new));
    Part { file: FileId::new(0), object, group, material: material.map(MaterialId::new) }
}

fn one_part() -> Catalogue {
    Catalogue { parts: vec![part(None, None, None)].into(), ..Catalogue::default() }
}

/// Two squares that share an edge, one per piece; vertex 1 of the first piece and texcoord 4 of the second are unused.
///
/// ```text
///  v3 ---- s1 ---- v2
///  |  \   |   \    |
///  v0 ---- s0 ---- v0
/// ```
fn two_squares(folder: &Path) -> StoredMesh {
    let v = |x: f64, y: f64| DVec3::new(452_000.25 + x, 5_411_000.5 + y, 31.0);
    let corners = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
    let left = Piece {
        positions: vec![v(0.0, 0.0), v(9.0, 9.0), v(0.0, 1.0)],
        colours: Some(vec![[0.5, 1.0, 0.0], [1.0; 3], [f32::NAN; 3]]),
        texcoords: corners.to_vec(),
        faces: vec![face([0, 3, 2], [0, 1, 3], 0), face([3, 4, 2], [1, 2, 3], 1)],
    };
    let right = Piece {
        positions: vec![v(2.0, 0.0), v(2.0, 1.0)],
        texcoords: [&corners[..], &[DVec2::splat(0.3)]].concat(),
        faces: vec![face([2, 0, 3], [0, 1, 3], 1), face([0, 1, 3], [1, 2, NONE], 0)],
        ..Piece::default()
    };
    store(folder, &[v(1.0, 0.0), v(1.0, 1.0)], &[left, right])
}

fn two_materials(folder: &Path) -> Catalogue {
    Catalogue {
        names: vec![b"house".into()].into(),
        materials: vec![
            material("brick", folder, "brick.png"),
            material("never used", folder, "none.png"),
            material("tile", folder, "gone.png"),
        ]
        .into(),
        parts: vec![part(Some(0), None, Some(0)), part(Some(0), None, Some(2))].into(),
        ..Catalogue::default()
    }
}

struct Fixture {
    root: tempfile::TempDir,
}

impl Fixture {
    fn new() -> Self {
        let root = tempfile::tempdir().unwrap();
        for name in ["in", "work", "out"] {
            fs::create_dir(root.path().join(name)).unwrap();
        }
        fs::write(root.path().join("in/brick.png"), "pixels").unwrap();
        Self { root }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.root.path().join(name)
    }

    fn write(&self, mesh: &StoredMesh, catalogue: &Catalogue, options: &WriteOptions) -> Result<Written> {
        write(mesh, catalogue, &self.path("out/city.obj"), &self.path("work"), options, &Silent)
    }

    fn obj(&self) -> String {
        fs::read_to_string(self.path("out/city.obj")).unwrap()
    }

    fn names(&self, folder: &str) -> Vec<String> {
        let entries = fs::read_dir(self.path(folder)).unwrap();
        let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

#[test]
fn two_pieces_become_one_file() {
    let fixture = Fixture::new();
    let mesh = two_squares(&fixture.path("in"));
    let written = fixture.write(&mesh, &two_materials(&fixture.path("in")), &options()).unwrap();
    assert_eq!((written.vertices, written.texcoords, written.faces), (6, 8, 4));
    assert_eq!(written.findings.get("missing_texture"), 1);
    let obj = fixture.obj();
    assert_eq!(written.content.bytes, obj.len() as u64);
    let expected = [
        "mtllib city.mtl",
        "v 452001.25 5411000.5 31",
        "v 452001.25 5411001.5 31",
        "v 452000.25 5411000.5 31 0.5 1 0",
        "v 452000.25 5411001.5 31",
        "v 452002.25 5411000.5 31",
        "v 452002.25 5411001.5 31",
        "vt 0 0",
        "vt 1 0",
        "vt 1 1",
        "vt 0 1",
        "vt 0 0",
        "vt 1 0",
        "vt 1 1",
        "vt 0 1",
        "o house",
        "usemtl brick",
        "f 3/1 1/2 4/4",
        "f 5/6 6/7 2",
        "usemtl tile",
        "f 1/2 2/3 4/4",
        "f 1/5 5/6 2/8",
    ];
    assert!(obj.starts_with("# drystone "));
    assert_eq!(obj.lines().skip(1).collect::<Vec<_>>(), expected);
}

#[test]
fn materials_and_textures_arrive_with_the_faces() {
    let fixture = Fixture::new();
    let mut mesh = two_squares(&fixture.path("in"));
    // NOTE: tobj accepts colours for all vertices or for none.
    mesh.pieces[0].colours = None;
    fixture.write(&mesh, &two_materials(&fixture.path("in")), &options()).unwrap();
    let (models, materials) = tobj::load_obj(fixture.path("out/city.obj"), &tobj::LoadOptions::default()).unwrap();
    let materials = materials.unwrap();
    assert_eq!(materials.iter().map(|m| m.name.as_str()).collect::<Vec<_>>(), ["brick", "tile"]);
    assert!(materials[0].diffuse_texture.as_deref().unwrap().ends_with("city_textures/brick.png"));
    assert_eq!(models.iter().map(|m| m.mesh.indices.len()).collect::<Vec<_>>(), [6, 6]);
    assert_eq!(models.iter().map(|m| m.mesh.material_id).collect::<Vec<_>>(), [Some(0), Some(1)]);
    assert_eq!(fixture.names("out"), ["city.mtl", "city.obj", "city_textures"]);
    assert_eq!(fixture.names("work"), [""; 0]);
    assert_eq!(fs::read(fixture.path("out/city_textures/brick.png")).unwrap(), b"pixels");
    let mtl = fs::read_to_string(fixture.path("out/city.mtl")).unwrap();
    assert!(mtl.ends_with(
        "\nnewmtl brick\nKd 0.5 0.5 0.5\nillum 2\nmap_Kd -s 1 1 1 city_textures/brick.png\n\
         \nnewmtl tile\nKd 0.5 0.5 0.5\nillum 2\nmap_Kd -s 1 1 1 gone.png\n"
    ));
}

#[test]
fn a_mesh_without_materials_has_no_mtl() {
    let fixture = Fixture::new();
    let square = Piece {
        positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
        faces: vec![face([0, 1, 2], BARE, 0)],
        ..Piece::default()
    };
    let mesh = store(&fixture.path("in"), &[], &[square]);
    fixture.write(&mesh, &one_part(), &options()).unwrap();
    assert!(fixture.obj().ends_with("\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"));
    assert_eq!(fixture.names("out"), ["city.obj"]);
}

#[test]
fn an_older_result_is_replaced_only_with_force_and_only_as_a_whole() {
    let fixture = Fixture::new();
    let mesh = two_squares(&fixture.path("in"));
    let catalogue = two_materials(&fixture.path("in"));
    fs::write(fixture.path("out/city.obj"), "old").unwrap();
    assert!(matches!(fixture.write(&mesh, &catalogue, &options()), Err(Error::Usage(m)) if m.contains("`force`")));
    let force = WriteOptions { force: true, ..options() };
    // The faces are unreadable, so the write fails late.
    let damaged =
        store(&fixture.path("in"), &[], &[Piece { faces: vec![face([0, 1, 2], BARE, 0)], ..Piece::default() }]);
    assert!(matches!(fixture.write(&damaged, &catalogue, &force), Err(Error::Damaged { .. })));
    assert_eq!(fixture.obj(), "old");
    assert_eq!(fixture.names("out"), ["city.obj"]);
    fs::remove_file(fixture.path("out/city.obj")).unwrap();
    fs::write(fixture.path("out/city.mtl"), "old").unwrap();
    let mesh_again = two_squares(&fixture.path("in"));
    assert!(matches!(fixture.write(&mesh_again, &catalogue, &options()), Err(Error::Usage(_))));
    assert_eq!(fixture.names("out"), ["city.mtl"]);
    fixture.write(&mesh, &catalogue, &force).unwrap();
    assert_eq!(fixture.names("out"), ["city.mtl", "city.obj", "city_textures"]);
}

#[test]
fn materials_and_textures_of_the_last_face_are_told_when_it_is_gone() {
    let f = Fixture::new();
    let mut catalogue = two_materials(&f.path("in"));
    // One of the three is on no face.
    let lost = (0..30).map(|i| material(&format!("roof\n{i}"), &f.path("in"), &format!("roof{i}.png")));
    catalogue.materials.extend(lost);
    // One that is lost, and shares its texture with one that stays.
    catalogue.materials.push(Material {
        name: b"twin".into(),
        output_name: b"twin".into(),
        ..catalogue.materials.raw[0].clone()
    });
    let written = f.write(&two_squares(&f.path("in")), &catalogue, &options()).unwrap();
    assert_eq!((written.findings.get("lost_materials"), written.findings.get("lost_textures")), (32, 31));
    assert!(written.findings.are_plain());
    let warnings = written.findings.warnings();
    let first = warnings.iter().find(|line| line.starts_with("lost materials")).unwrap();
    assert!(first.contains("2 of 34 materials left; 'never used' is on no face"), "{first}");
    assert_eq!(warnings.iter().filter(|line| line.starts_with("lost ")).count(), 32 + 31);
}

#[test]
fn the_same_mtl_of_a_killed_run_is_no_obstacle() {
    let fixture = Fixture::new();
    let mesh = two_squares(&fixture.path("in"));
    let catalogue = two_materials(&fixture.path("in"));
    fixture.write(&mesh, &catalogue, &options()).unwrap();
    let first = fixture.obj();
    fs::remove_file(fixture.path("out/city.obj")).unwrap();
    fixture.write(&mesh, &catalogue, &options()).unwrap();
    assert_eq!(fixture.obj(), first);
}

#[test]
fn a_late_failure_removes_everything() {
    let fixture = Fixture::new();
    let mesh = two_squares(&fixture.path("in"));
    fs::remove_file(fixture.path("in/1.t")).unwrap();
    let failed = fixture.write(&mesh, &two_materials(&fixture.path("in")), &options());
    assert!(matches!(failed, Err(Error::Io { .. })));
    assert_eq!(fixture.names("out"), [""; 0]);
    assert_eq!(fixture.names("work"), [""; 0]);
}

#[test]
fn what_can_fail_has_happened_before_the_first_file_gets_its_name() {
    let f = Fixture::new();
    fs::write(f.path("in/brick.png"), "picture").unwrap();
    let (mesh, catalogue) = (two_squares(&f.path("work")), two_materials(&f.path("in")));
    let staged = stage(&mesh, &catalogue, &f.path("out/city.obj"), &f.path("work"), &options(), &Silent).unwrap();
    let waiting = waiting_place(&f.path("out/city.obj"), options().job);
    assert_eq!(fs::metadata(waiting).unwrap().len(), staged.written().content.bytes);
    assert_eq!(staged.left_out_textures().iter().collect::<Vec<_>>(), [&f.path("in/gone.png")]);
    staged.commit(&Silent).unwrap();
}

#[test]
fn each_file_is_durable_before_it_has_its_name_and_the_obj_gets_its_name_last() {
    let f = Fixture::new();
    let (mesh, catalogue) = (two_squares(&f.path("work")), two_materials(&f.path("in")));
    let targets = ["out/city_textures/brick.png", "out/city.mtl", "out/city.obj"].map(|name| f.path(name));
    witness::take();
    let staged = stage(&mesh, &catalogue, &targets[2], &f.path("work"), &options(), &Silent).unwrap();
    let mut synced = witness::take();
    // Temporary files in the work folder do not count here.
    synced.retain(|(_, path)| path.starts_with(f.path("out")));
    let waiting = targets.each_ref().map(|target| ("sync", waiting_place(target, options().job)));
    assert_eq!(synced, waiting);
    staged.commit(&Silent).unwrap();
    let [texture, mtl, obj] = targets;
    let (out, textures) = (f.path("out"), f.path("out/city_textures"));
    let expected = [
        ("rename", texture),
        ("sync", textures),
        ("sync", out.clone()),
        ("rename", mtl),
        ("sync", out.clone()),
        ("rename", obj),
        ("sync", out),
    ];
    assert_eq!(witness::take(), expected);
}

#[test]
fn what_somebody_writes_there_meanwhile_is_not_replaced_without_force() {
    for name in ["city.mtl", "city_textures/brick.png"] {
        let f = Fixture::new();
        fs::write(f.path("in/brick.png"), "picture").unwrap();
        let (mesh, catalogue) = (two_squares(&f.path("work")), two_materials(&f.path("in")));
        let output = f.path("out/city.obj");
        let staged = stage(&mesh, &catalogue, &output, &f.path("work"), &options(), &Silent).unwrap();
        fs::write(f.path("out").join(name), "of the user").unwrap();
        let error = staged.commit(&Silent).unwrap_err();
        assert!(error.kind() == ErrorKind::Usage && error.to_string().contains("by another process"), "{error}");
        assert_eq!(fs::read(f.path("out").join(name)).unwrap(), b"of the user");
        assert!(!output.exists());
    }
}

#[test]
fn an_input_file_is_never_replaced() {
    let fixture = Fixture::new();
    let mesh = two_squares(&fixture.path("in"));
    fs::write(fixture.path("out/city.obj"), "input").unwrap();
    let files = vec![fixture.path("in/../out/city.obj")].into();
    let catalogue = Catalogue { files, ..two_materials(&fixture.path("in")) };
    let sources = Sources::new(catalogue.files.iter().map(PathBuf::as_path));
    let force = WriteOptions { force: true, sources, ..options() };
    assert!(matches!(fixture.write(&mesh, &catalogue, &force), Err(Error::Usage(m)) if m.contains("input")));
    assert_eq!(fixture.obj(), "input");
}

/// A cube in one piece, or in two that share all vertices.
fn cube(folder: &Path, split: bool) -> StoredMesh {
    let corner = |i: u32| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2 & 1)) * 2.0;
    let positions: Vec<DVec3> = (0..8).map(corner).collect();
    let squares = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5u32]];
    let faces: Vec<_> =
        squares.iter().flat_map(|&[a, b, c, d]| [face([a, b, c], BARE, 0), face([a, c, d], BARE, 0)]).collect();
    if !split {
        return store(folder, &[], &[Piece { positions, faces, ..Piece::default() }]);
    }
    // All vertices are shared, each piece has three squares.
    let pieces = faces.chunks(6).map(|faces| Piece { faces: faces.to_vec(), ..Piece::default() });
    store(folder, &positions, &pieces.collect::<Vec<_>>())
}

#[test]
fn a_cube_has_three_normals_a_corner_however_it_is_cut() {
    for split in [false, true] {
        let fixture = Fixture::new();
        let mesh = cube(&fixture.path("in"), split);
        fixture.write(&mesh, &one_part(), &WriteOptions { normals: true, ..options() }).unwrap();
        assert_eq!(fixture.obj().lines().filter(|line| line.starts_with("vn ")).count(), 24);
        let (models, _) = tobj::load_obj(fixture.path("out/city.obj"), &tobj::LoadOptions::default()).unwrap();
        let mesh = &models[0].mesh;
        let vector = |values: &[f64], i: u32| DVec3::from_slice(&values[3 * i as usize..]);
        for (corners, normals) in mesh.indices.chunks(3).zip(mesh.normal_indices.chunks(3)) {
            let [a, b, c] = [0, 1, 2].map(|k| vector(&mesh.positions, corners[k]));
            let flat = (b - a).cross(c - a).normalize();
            assert!(normals.iter().all(|&n| vector(&mesh.normals, n) == flat));
        }
        assert_eq!(fixture.names("work"), [""; 0]);
    }
}

/// A wavy grid of `n` × `n` squares in rows of pieces; rows between two pieces are shared.
fn grid(folder: &Path, n: u32, rows_per_piece: u32, part_count: u32) -> StoredMesh {
    let position = |x: u32, y: u32| {
        let height = f64::from((x * 7 + y * 13) % 5) * 0.1;
        DVec3::new(f64::from(x) + 450_000.125, f64::from(y), height)
    };
    let shared_rows: Vec<u32> = (1..n).filter(|y| y % rows_per_piece == 0).collect();
    let shared: Vec<DVec3> = shared_rows.iter().flat_map(|&y| (0..=n).map(move |x| position(x, y))).collect();
    let mut pieces = Vec::new();
    for first in (0..n).step_by(rows_per_piece as usize) {
        let last = (first + rows_per_piece).min(n);
        let own_rows: Vec<u32> = (first..=last).filter(|y| !shared_rows.contains(y)).collect();
        let own = own_rows.len() as u32 * (n + 1);
        let id = |x: u32, y: u32| match own_rows.iter().position(|&row| row == y) {
            Some(row) => row as u32 * (n + 1) + x,
            None => own + shared_rows.iter().position(|&row| row == y).unwrap() as u32 * (n + 1) + x,
        };
        let mut faces = Vec::new();
        for y in first..last {
            for x in 0..n {
                let corners = [id(x, y), id(x + 1, y), id(x + 1, y + 1), id(x, y + 1)];
                let texcoords = [0, 1, 2 + x % 2, 0];
                let part = (x * 5 + y) % part_count;
                for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
                    let pick = |from: [u32; 4]| [from[a], from[b], from[c]];
                    faces.push(face(pick(corners), pick(texcoords), part));
                }
            }
        }
        pieces.push(Piece {
            positions: own_rows.iter().flat_map(|&y| (0..=n).map(move |x| position(x, y))).collect(),
            colours: None,
            texcoords: vec![DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::new(0.000001, 0.5)],
            faces,
        });
    }
    store(folder, &shared, &pieces)
}

fn numbered_parts(count: u32) -> Catalogue {
    Catalogue {
        names: (0..count).map(|i| format!("part {i}").into_bytes()).collect(),
        parts: (0..count).map(|i| part((i % 3 > 0).then_some(i / 2), Some(i), None)).collect(),
        ..Catalogue::default()
    }
}

#[test]
fn memory_and_threads_leave_no_trace_in_the_bytes() {
    let mut results = Vec::new();
    for (work_bytes, threads) in [(256 * MIB, 1), (256 * MIB, 4), (0, 3)] {
        let fixture = Fixture::new();
        // 204,800 faces of 40 bytes do not fit the smallest share.
        let mesh = grid(&fixture.path("in"), 320, 16, 50);
        let options = WriteOptions { normals: true, work_bytes, ..options() };
        let _threads = Pool::new(threads).unwrap().enter();
        let written = fixture.write(&mesh, &numbered_parts(50), &options).unwrap();
        assert_eq!((written.vertices, written.faces), (321 * 321, 2 * 320 * 320));
        results.push(fixture.obj());
        assert_eq!(fixture.names("work"), [""; 0]);
    }
    assert!(results.iter().all(|result| *result == results[0]));
}

#[test]
fn the_cut_leaves_no_trace_in_the_surface() {
    let surface = |rows_per_piece| {
        let fixture = Fixture::new();
        let mesh = grid(&fixture.path("in"), 12, rows_per_piece, 4);
        fixture.write(&mesh, &numbered_parts(4), &WriteOptions { normals: true, ..options() }).unwrap();
        let (models, _) = tobj::load_obj(fixture.path("out/city.obj"), &tobj::LoadOptions::default()).unwrap();
        let mut corners = Vec::new();
        for model in &models {
            let mesh = &model.mesh;
            for ((&v, &t), &n) in mesh.indices.iter().zip(&mesh.texcoord_indices).zip(&mesh.normal_indices) {
                let position = &mesh.positions[3 * v as usize..][..3];
                let texcoord = &mesh.texcoords[2 * t as usize..][..2];
                let normal = &mesh.normals[3 * n as usize..][..3];
                corners.push(format!("{} {position:?} {texcoord:?} {normal:?}", model.name));
            }
        }
        corners
    };
    let whole = surface(12);
    assert_eq!(whole.len(), 3 * 2 * 12 * 12);
    for rows_per_piece in [1, 3, 5] {
        assert_eq!(surface(rows_per_piece), whole);
    }
}

#[test]
fn a_mesh_without_faces_is_a_header() {
    let fixture = Fixture::new();
    let written = fixture.write(&StoredMesh::default(), &Catalogue::default(), &options()).unwrap();
    assert_eq!((written.vertices, written.faces), (0, 0));
    assert_eq!(fixture.obj().lines().count(), 1);
}
