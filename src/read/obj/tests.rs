//! Tests of the scan of OBJ files, from text to records.

use std::fs;
use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use proptest::prelude::*;

use super::*;
use crate::base::{Error, Silent};
use crate::model::face::POLYGON_CORNERS_MAX;
use crate::model::id::{FileId, MaterialId, NameId, PartId, PieceTexcoord, PieceVertex};
use crate::model::{Catalogue, Face, Part};
use crate::read::{CHUNK_BYTES, Scan, ScanOptions, scan, scan_in_chunks};

/// Records of a scan, in memory.
#[derive(Debug)]
struct Records {
    scan: Scan,
    positions: Vec<DVec3>,
    texcoords: Vec<DVec2>,
    colours: Option<Vec<[f32; 3]>>,
    faces: Vec<Face<PieceVertex>>,
}

impl Records {
    /// Everything that must not depend on how the text was split, in a comparable form.
    fn fingerprint(&self) -> String {
        let Scan { catalogue, triangles, findings, input_bytes, .. } = &self.scan;
        let Catalogue { names, materials, parts, position_decimals, texcoord_decimals, .. } = catalogue;
        format!(
            "{:?} {:?} {:?} {:?} {names:?} {materials:?} {parts:?} {position_decimals} {texcoord_decimals} {} {} \
             {triangles} {findings:?} {input_bytes}",
            self.positions, self.texcoords, self.colours, self.faces, catalogue.has_normals, catalogue.has_texcoords
        )
    }
}

fn scan_files(files: &[(&str, &[u8])], chunk_bytes: u64, threads: usize) -> Result<Records> {
    let folder = tempfile::tempdir().unwrap();
    let mut inputs = Vec::new();
    for (name, text) in files {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, text).unwrap();
        if name.ends_with(".obj") {
            inputs.push(path);
        }
    }
    let work = folder.path().join("work");
    fs::create_dir(&work).unwrap();
    let options = ScanOptions { threads, chunks_in_flight: threads + 1, ..Default::default() };
    let scan = scan_in_chunks(&inputs, &work, &options, None, &Silent, chunk_bytes)?;
    let (mut positions, mut texcoords, mut colours, mut faces) = (vec![], vec![], None::<Vec<_>>, vec![]);
    for piece in &scan.mesh.pieces {
        positions.extend_from_slice(&piece.positions.window(0..piece.positions.len())?);
        texcoords.extend_from_slice(&piece.texcoords.window(0..piece.texcoords.len())?);
        if let Some(column) = &piece.colours {
            assert_eq!(column.len(), piece.positions.len());
            colours.get_or_insert_default().extend_from_slice(&column.window(0..column.len())?);
        }
        let (file, mut bytes, mut block_faces) = (piece.faces.open()?, vec![], vec![]);
        for block in piece.faces.blocks() {
            piece.faces.read_block(&file, block, &mut bytes, &mut block_faces)?;
            faces.extend_from_slice(&block_faces);
        }
    }
    Ok(Records { scan, positions, texcoords, colours, faces })
}

fn scan_text(text: &str) -> Result<Records> {
    scan_files(&[("a.obj", text.as_bytes())], CHUNK_BYTES, 1)
}

fn message(text: &str) -> String {
    let message = scan_text(text).map(|records| records.fingerprint()).unwrap_err().to_string();
    message.split_once("/a.obj").map_or(message.clone(), |(_, rest)| format!("a.obj{rest}"))
}

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

#[test]
fn a_polygon_becomes_a_fan() {
    let records = scan_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\nf 4 2 1\n").unwrap();
    let faces = records.faces.iter().map(|face| (face.vertices.map(|v| v.number()), face.continues_polygon));
    assert!(faces.eq([([0, 1, 2], false), ([0, 2, 3], true), ([3, 1, 0], false)]));
    assert_eq!(records.scan.triangles, 3);
}

#[test]
fn a_polygon_of_very_many_corners_becomes_triangles_and_is_told() {
    let corners = |count: usize| (0..count).map(|i| format!(" {}", [1, 2, 3][i % 3])).collect::<String>();
    let (most, more) = (POLYGON_CORNERS_MAX, POLYGON_CORNERS_MAX + 2);
    let records = scan_text(&format!("{TRIANGLE}f{}\nf{}\n", corners(most), corners(more))).unwrap();
    assert_eq!(records.scan.findings.get("fanned_polygons"), 1);
    assert_eq!(records.scan.triangles, (1 + most - 2 + more - 2) as u64);
    let (first, second) = records.faces[1..].split_at(most - 2);
    assert!(first.iter().skip(1).all(|face| face.continues_polygon));
    assert!(second.iter().all(|face| !face.continues_polygon && face.vertices[0] != face.vertices[1]));
    assert_eq!(records.scan.findings.get("degenerate_faces") + second.len() as u64, more as u64 - 2);
}

#[test]
fn nothing_is_repeated_of_a_file_that_is_no_library_nor_is_one_read_twice() {
    let obj = format!("{TRIANGLE}mtllib secret.env\nmtllib a.mtl x/../a.mtl\nusemtl a\nf 1 2 3\n");
    let files: [(&str, &[u8]); 4] = [
        ("a.obj", obj.as_bytes()),
        ("secret.env", b"TOPSECRET=1\n"),
        ("a.mtl", b"newmtl a\nKd 1 1 1\n"),
        ("x/b.mtl", b""),
    ];
    let findings = scan_files(&files, CHUNK_BYTES, 1).unwrap().scan.findings;
    assert!(!findings.warnings().concat().contains("TOPSECRET"));
    assert_eq!(findings.get("mtl_statement_before_newmtl"), 1);
    assert_eq!(findings.get("repeated_material_definition"), 0);
}

#[test]
fn a_triangle_that_repeats_a_vertex_is_dropped_and_a_polygon_is_kept() {
    let records = scan_text(&format!("{TRIANGLE}f 1 1 2\nf 1 2 -2\nf 1 2 3 2\n")).unwrap();
    assert_eq!(records.faces.len(), 3);
    assert_eq!((records.scan.triangles, records.scan.findings.get("degenerate_faces")), (5, 2));
}

#[test]
fn faces_without_texture_coordinates_stay_without() {
    let text =
        "vt 0 0\nvt 1 0.25\nvt 0\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1/1 2/2 3/3\nf 1//1 2//1 3//1\nvn 0 0 1\n";
    let records = scan_text(text).unwrap();
    let texcoords: Vec<_> = records.faces.iter().map(|face| face.texcoords).collect();
    let bare = [PieceTexcoord::NONE; 3];
    assert_eq!(texcoords, [bare, [0, 1, 2].map(PieceTexcoord::new), bare]);
    assert_eq!(records.texcoords[1], DVec2::new(1.0, 0.25));
    let catalogue = &records.scan.catalogue;
    assert!(catalogue.has_normals && catalogue.has_texcoords);
    assert_eq!((catalogue.position_decimals, catalogue.texcoord_decimals), (0, 2));
}

#[test]
fn a_face_with_some_texture_coordinates_is_read_without_and_told() {
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 1\nf 1/1 2 3/-1 4\nf 1/1 2/2 3/2\n";
    let records = scan_text(text).unwrap();
    assert_eq!(records.faces[0].texcoords, [PieceTexcoord::NONE; 3]);
    assert_eq!(records.faces[2].texcoords, [0, 1, 1].map(PieceTexcoord::new));
    assert!(records.scan.findings.warnings()[0].contains("a.obj:7: 2 of 4 corners"));
}

#[test]
fn colours_stay_with_their_vertices() {
    let text = "v 0 0 0\nv 1 0 0 0.5 0.25 1\nv 0 1 0 1 2 3 0.5\nv 5 5 5 1\nf 1 2 3\n";
    let plain = ("b.obj", TRIANGLE.as_bytes());
    let records = scan_files(&[("a.obj", text.as_bytes()), plain], 20, 2).unwrap();
    let colours = records.colours.unwrap();
    assert!(colours[0][0].is_nan() && colours[3][0].is_nan());
    assert_eq!(colours[1..3], [[0.5, 0.25, 1.0], [1.0, 2.0, 3.0]]);
    assert!(records.scan.mesh.pieces[1].colours.is_none());
}

#[test]
fn weights_and_extra_numbers_are_ignored_and_told() {
    let records = scan_text("v 0 0 0 9 9\nv 2 0 0 2\nv 0 1 0 1\nf 1 2 3 # end\n").unwrap();
    assert_eq!(records.positions[1], DVec3::new(2.0, 0.0, 0.0));
    let findings = &records.scan.findings;
    assert_eq!((findings.get("extra_numbers"), findings.get("vertex_weights")), (1, 1));
    assert!(findings.warnings()[0].contains("a.obj:1: "));
}

#[test]
fn damaged_lines_are_named() {
    for (text, expected) in [
        ("v 1 2\n", "a.obj:1: a vertex has 3 numbers, found 2"),
        ("v 0 0 0\nv 1,5 0 0\n", "a.obj:2: expected a number, found '1,5'"),
        ("v nan 0 0\n", "a.obj:1: expected a number between -3.4e38 and 3.4e38, found 'nan'"),
        ("v 0 0 1e39\n", "a.obj:1: expected a number between -3.4e38 and 3.4e38, found '1e39'"),
        ("v 0 0 0\0\n", "a.obj:1: expected text, found NUL bytes; the file is damaged, or binary"),
        ("v 0 0 0\nf 0 1 1\n", "a.obj:2: expected a vertex index, found 0; OBJ counts from 1"),
        ("v 0 0 0\nf 1/1/1/1 1 1\n", "a.obj:2: a corner has at most two slashes, found '1/1/1/1'"),
        ("v 0 0 0\nf 1.5 1 1\n", "a.obj:2: expected a corner such as 1/2/3, found '1.5'"),
        ("v 0 0 0\nv 0 0 0\nf -1 -2 -3\nv 0 0 0\n", "a.obj:3: face refers to vertex -3, the file has 2 so far"),
        ("v 0 0 0\n\nf \\\n1 1 9\n", "a.obj:3: face refers to vertex 9, the file has 1"),
        ("v 0 0 0\nvt 0 0\nf 1/2 1/1 1/1\n", "a.obj:3: face refers to texture coordinate 2, the file has 1"),
        ("v 0 0 0\nf 1/2 1/1 1/1\nvt 0 0\n", "a.obj:2: face refers to texture coordinate 2, the file has 1"),
        ("v 0 0 0\nf 1/-1 1/1 1/1\nvt 0 0\n", "a.obj:2: face refers to texture coordinate -1, the file has 0"),
        ("OFF\n3 1 3\n", "a.obj:1: expected OBJ text, found an OFF file"),
        ("V 0 0 0\nF 1 1 1\n", "a.obj: no faces; 2 lines are not OBJ"),
        ("f 1 1 1\nv 0 0 0\n", "a.obj: no faces: the only face repeats a vertex"),
        ("f 1 1 1\nf 1 1 1\nv 0 0 0\n", "a.obj: no faces: all 2 repeat a vertex"),
        ("V 0 0 0\n", "a.obj: no faces; 1 line is not OBJ: "),
        ("v 0 0 0\n", "a.obj: no faces; expected OBJ text with 'f' statements, found 1 line"),
        ("", "a.obj: no faces; expected OBJ text with 'f' statements, found 0 lines"),
    ] {
        assert!(message(text).starts_with(expected), "{text:?} says {}", message(text));
    }
}

#[test]
fn an_index_beyond_32_bits_does_not_wrap() {
    for index in ["4294967297", "18446744073709551617", "-9223372036854775808", "4294967295"] {
        let found = message(&format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 {index}\n"));
        assert!(found.starts_with("a.obj:4: face refers to vertex"), "{found}");
    }
}

#[test]
fn the_first_error_is_named_at_any_chunk_size() {
    let mut text = String::from("v 0 0 0\r\n# two\\\r\nv 1 0 0\\\n\rv 0 1 0\n");
    text.push_str(&"f 1 2 3\n".repeat(20));
    text.push_str("f 1 2 99999\nf 1 2 99999\n");
    for chunk_bytes in [1, 7, 50, 1000] {
        for threads in [1, 3] {
            let error = scan_files(&[("a.obj", text.as_bytes())], chunk_bytes, threads).unwrap_err().to_string();
            assert!(error.ends_with("a.obj:26: face refers to vertex 99999, the file has 3"), "{error}");
        }
    }
}

proptest! {
    #[test]
    fn a_file_without_texture_coordinates_is_read_without_its_texture_indices(
        faces in prop::collection::vec((prop::array::uniform3(-9i64..9), any::<bool>()), 1..40),
        chunk_bytes in 1u64..300,
    ) {
        let text = |with_texture: bool| faces.iter().fold(TRIANGLE.to_owned(), |text, ([a, b, c], is_relative)| {
            let vertices = if *is_relative { [-3, -2, -1] } else { [1, 2, 3] };
            let corner = |v: i64, t: i64| if with_texture && t != 0 { format!("{v}/{t}") } else { v.to_string() };
            let [u, v, w] = vertices;
            format!("{text}f {} {} {}\n", corner(u, *a), corner(v, *b), corner(w, *c))
        });
        let bare = scan_text(&text(false)).unwrap();
        let found = scan_files(&[("a.obj", text(true).as_bytes())], chunk_bytes, 2).unwrap();
        prop_assert_eq!(&found.faces, &bare.faces);
        prop_assert!(!found.scan.catalogue.has_texcoords);
        let names_any = faces.iter().any(|(texcoords, _)| texcoords.iter().any(|t| *t != 0));
        prop_assert_eq!(found.scan.findings.get("dangling_texture_coordinates"), u64::from(names_any));
    }
}

#[test]
fn a_normal_that_is_not_there_is_told() {
    let records = scan_text(&format!("{TRIANGLE}f 1//1 2//7 3//1\nvn 0 0 1\n")).unwrap();
    assert_eq!(records.faces.len(), 2);
    assert!(records.scan.findings.warnings()[0].contains("a.obj:5: face refers to normal 7, the file has 1"));
    let records = scan_text(&format!("vn 0 0 1\n{TRIANGLE}f 1//-1 2//-2 3//1\nvn 0 0 1\nvn 0 0 1\n")).unwrap();
    assert_eq!(records.scan.findings.get("dangling_normals"), 1);
    assert!(records.scan.findings.warnings()[0].contains("a.obj:6: "), "{:?}", records.scan.findings);
    let records = scan_text(&format!("vn 0 0 1\n{TRIANGLE}f 1//-1 2//-1 3//1\n")).unwrap();
    assert_eq!(records.scan.findings.get("dangling_normals"), 0);
}

#[test]
fn labels_follow_the_faces_across_chunks() {
    let text =
        format!("{TRIANGLE}o house\ng roof west\nusemtl tile\nf 1 2 3\nusemtl unused\nusemtl\nf 1 2 3\ng\nf 1 2 3\n");
    for chunk_bytes in [1, 30, 1000] {
        let records = scan_files(&[("a.obj", text.as_bytes())], chunk_bytes, 2).unwrap();
        let catalogue = &records.scan.catalogue;
        assert_eq!(catalogue.names.raw, [&b"house"[..], b"roof west", b""]);
        assert_eq!(catalogue.materials.len(), 1);
        let part = |object: Option<u32>, group: Option<u32>, material: Option<u32>| Part {
            file: FileId::new(0),
            object: object.map(NameId::new),
            group: group.map(NameId::new),
            material: material.map(MaterialId::new),
        };
        let expected = [
            part(None, None, None),
            part(Some(0), Some(1), Some(0)),
            part(Some(0), Some(1), None),
            part(Some(0), Some(2), None),
        ];
        assert_eq!(catalogue.parts.raw, expected);
        assert!(records.faces.iter().map(|face| face.part).eq(PartId::first(4)));
    }
}

#[test]
fn definitions_come_from_the_libraries_as_written() {
    let obj = format!("{TRIANGLE}usemtl a b\nf 1 2 3\nusemtl gone\nf 1 2 3\nmtllib sub\\m.mtl x.mtl\n");
    let mtl = "\u{feff}Kd 1 1 1\r\n\tnewmtl\t a b \r\nKa\r\nKd spectral f.rfl 1\r\nmap_Kd\r\n\
               map_Kd -s 2 \t t u.png\t\r\nbogus 1\r\nnewmtl a b\r\nd 1\r\n";
    let records = scan_files(&[("a.obj", obj.as_bytes()), ("sub/m.mtl", mtl.as_bytes())], CHUNK_BYTES, 1).unwrap();
    let Scan { catalogue, findings, .. } = &records.scan;
    let definition = catalogue.materials.raw[0].definition.as_ref().unwrap();
    assert_eq!(definition.statements, [&b"Ka"[..], b"Kd spectral f.rfl 1", b"bogus 1"]);
    assert_eq!(definition.textures[0].key_and_options, b"map_Kd -s 2");
    assert_eq!(definition.textures[0].name, b"t u.png");
    assert!(definition.folder.ends_with("sub"));
    assert!(catalogue.materials.raw[1].definition.is_none());
    for kind in [
        "missing_mtl",
        "undefined_material",
        "texture_without_name",
        "mtl_statement_before_newmtl",
        "repeated_material_definition",
    ] {
        assert_eq!(findings.get(kind), 1, "{kind}");
    }
    assert!(findings.warnings().iter().any(|warning| warning.contains("a.obj:9: material library 'x.mtl'")));
    assert!(findings.warnings().iter().any(|warning| warning.contains("sub/m.mtl:5: ")), "{findings:?}");
}

#[test]
fn a_material_keeps_so_many_statements_and_no_more() {
    let obj = format!("{TRIANGLE}mtllib a.mtl\nusemtl a\nf 1 2 3\n");
    let mtl = format!("newmtl a\nKd 1 1 1\n{}", "map_Kd wall.png\n".repeat(1000));
    let records = scan_files(&[("a.obj", obj.as_bytes()), ("a.mtl", mtl.as_bytes())], CHUNK_BYTES, 1).unwrap();
    let (catalogue, findings) = (&records.scan.catalogue, &records.scan.findings);
    let definition = catalogue.materials.raw[0].definition.as_ref().unwrap();
    assert_eq!((definition.statements.len(), definition.textures.len()), (1, 255));
    assert_eq!(findings.get("too_many_statements"), 745);
}

#[test]
fn names_and_materials_beyond_their_memory_are_refused_as_they_come() {
    let folder = tempfile::tempdir().unwrap();
    let (inputs, library) = ([folder.path().join("a.obj")], folder.path().join("a.mtl"));
    let scan_within = |catalogue_bytes: u64, obj: &str, mtl: &str| {
        fs::write(&inputs[0], [TRIANGLE, obj].concat()).unwrap();
        fs::write(&library, mtl).unwrap();
        scan(&inputs, folder.path(), &ScanOptions { catalogue_bytes, ..Default::default() }, &Silent)
    };
    let faces: String = (0..1000).map(|i| format!("g g{i}\nf 1 2 3\n")).collect();
    let libraries: String = (0..1000).map(|i| format!("mtllib {i}.mtl\n")).collect();
    let one = "mtllib a.mtl\nusemtl a\nf 1 2 3\n";
    let textures: String = (0..200).map(|i| format!("bump a{i}\n")).collect();
    let statements = format!("Kd{}\n", " 1".repeat(40)).repeat(200);
    let textures = format!("newmtl a\n{textures}");
    let statements = format!("newmtl a\n{statements}");
    let cases = [
        (faces.as_str(), "", 300_000, "a.obj"),
        (&(libraries + one), "", 1_200_000, "a.obj"),
        (one, &textures, 300_000, "a.mtl"),
        (one, &statements, 60_000, "a.mtl"),
    ];
    for (obj, mtl, enough, name) in cases {
        let error = scan_within(enough / 4, obj, mtl).unwrap_err();
        assert!(matches!(error, Error::Budget { .. }) && error.to_string().contains(name), "{error}");
        let catalogue = scan_within(enough, obj, mtl).unwrap().catalogue;
        assert!(catalogue.bytes() <= enough);
    }
}

#[test]
fn a_line_takes_memory_by_its_length_and_is_refused_if_it_does_not_fit() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = [folder.path().join("a.obj")];
    let line = format!("# {}\n", "-".repeat(3 << 20));
    fs::write(&inputs[0], [TRIANGLE, &line.repeat(4), "f 1 2 3\n"].concat()).unwrap();
    for threads in [1, 4] {
        let scan_within = |catalogue_bytes: u64| {
            let options = ScanOptions { threads, chunks_in_flight: 2, catalogue_bytes };
            scan(&inputs, folder.path(), &options, &Silent)
        };
        assert!(scan_within(13 << 20).is_ok());
        let error = scan_within(9 << 20).unwrap_err();
        assert!(matches!(error, Error::Budget { .. }) && error.to_string().contains("a long line"), "{error}");
    }
}

#[test]
fn long_names_take_memory_for_each_of_their_copies() {
    let names: String = (0..6).map(|i| format!("o {i}{}\nf 1 2 3\n", "n".repeat(1 << 20))).collect();
    let folder = tempfile::tempdir().unwrap();
    let inputs = [folder.path().join("a.obj")];
    fs::write(&inputs[0], [TRIANGLE, &names].concat()).unwrap();
    let scan_within = |catalogue_bytes: u64| {
        scan(&inputs, folder.path(), &ScanOptions { catalogue_bytes, ..Default::default() }, &Silent)
    };
    assert!(matches!(scan_within(10 << 20), Err(Error::Budget { .. })));
    assert_eq!(scan_within(16 << 20).unwrap().catalogue.names.len(), 6);
}

#[test]
fn the_text_of_a_library_takes_memory_while_it_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = [folder.path().join("a.obj")];
    let scan_with = |library_bytes: usize| {
        let mut obj = TRIANGLE.to_owned();
        for i in 0..3 {
            fs::write(folder.path().join(format!("{i}.mtl")), "#".repeat(library_bytes)).unwrap();
            obj.push_str(&format!("mtllib {i}.mtl\n"));
        }
        fs::write(&inputs[0], obj).unwrap();
        scan(&inputs, folder.path(), &ScanOptions { catalogue_bytes: 200_000, ..Default::default() }, &Silent)
    };
    scan_with(100_000).unwrap();
    assert!(matches!(scan_with(300_000), Err(Error::Budget { .. })));
}

#[test]
fn a_hundred_thousand_materials_are_read_in_no_time() {
    let mut text = TRIANGLE.to_owned();
    for i in 0..100_000 {
        text.push_str(&format!("g g{i}\nusemtl m{i}\nf 1 2 3\n"));
    }
    let begin = std::time::Instant::now();
    let records = scan_text(&text).unwrap();
    assert_eq!(records.scan.catalogue.materials.len(), 100_000);
    assert!(begin.elapsed().as_secs() < 10);
}

/// Lines of every kind, valid in any order after three vertices and two texture coordinates, with absolute and relative
/// indices.
fn any_line() -> impl Strategy<Value = String> {
    let number = prop_oneof!["-?[0-9]{1,9}\\.[0-9]{0,9}", "-?[0-9]{1,4}(e-?[0-9])?", "[0-9]\\.[0-9]{20}"];
    let vertex = prop::collection::vec(number.clone(), 3..8).prop_map(|n| format!("v {}", n.join(" ")));
    let blank = prop_oneof![Just(" "), Just("\t")];
    let texcoord = (prop::collection::vec(number, 1..4), blank).prop_map(|(n, blank)| format!("vt {}", n.join(blank)));
    let index = |limit: i64| prop_oneof![1..=limit, -limit..=-1];
    let corner = (index(3), index(2), -3i64..0, 0..5).prop_map(|(v, t, n, form)| match form {
        0 => format!("{v}"),
        1 => format!("{v}/{t}"),
        2 => format!("{v}//{n}"),
        3 => format!("{v}/{t}/"),
        _ => format!("{v}/{t}/{n}"),
    });
    let face = prop::collection::vec(corner, 2..6).prop_map(|c| format!("f {}", c.join(" ")));
    let name =
        prop_oneof!["usemtl [ab]", "g [ab]{0,2}", "o [ab]", "# [a-c \\\\]{0,5}", "mtllib no\\.mtl", "foo", "l 1 2"];
    prop_oneof![3 => vertex, 2 => texcoord, 1 => Just("vn 0 0 1".to_owned()), 6 => face, 2 => name]
}

fn any_text() -> impl Strategy<Value = String> {
    let ends =
        prop_oneof![6 => Just("\n"), 2 => Just("\r\n"), 1 => Just("\r"), 1 => Just(" \\\n\n"), 1 => Just("\n\n")];
    prop::collection::vec((any_line(), ends), 0..40).prop_map(|lines| {
        let mut text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 1\nvn 0 0 1\nvn 0 0 1\nvn 1 0 0\nf 1 2 3\n".to_owned();
        for (line, end) in lines {
            text.push_str(&line);
            text.push_str(end);
        }
        text
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn cuts_and_threads_change_nothing(text in any_text(), chunk_bytes in 1u64..200, threads in 1usize..4) {
        let whole = scan_text(&text).unwrap();
        let cut = scan_files(&[("a.obj", text.as_bytes())], chunk_bytes, threads).unwrap();
        let strip = |records: &Records| {
            let text = records.fingerprint();
            text.split('"').filter(|part| !part.contains("/a.obj")).collect::<String>()
        };
        prop_assert_eq!(strip(&whole), strip(&cut));
    }

    #[test]
    fn relative_indices_mean_the_same_as_absolute_ones(corners in prop::collection::vec((0u32..6, 0u32..6, 0u32..6), 1..40), chunk_bytes in 1u64..100) {
        let (mut absolute, mut relative) = (String::new(), String::new());
        let mut count = 0;
        for (a, b, c) in corners {
            for text in [&mut absolute, &mut relative] {
                text.push_str(&format!("v {count} 0 0\nv 0 {count} 0\nv 0 0 {count}\nvt {count}\n"));
            }
            count += 3;
            let back = [a, b, c].map(|back| 1 + back % count);
            let [i, j, k] = back.map(|back| count + 1 - back);
            absolute.push_str(&format!("f {i}/1 {j}/1 {k}/{}\n", count / 3));
            relative.push_str(&format!("f -{}/-{} -{}/1 -{}/-1\n", back[0], count / 3, back[1], back[2]));
        }
        let absolute = absolute + "f 1 2 3\n";
        let relative = relative + "f 1 2 3\n";
        let absolute = scan_text(&absolute).unwrap();
        let relative = scan_files(&[("a.obj", relative.as_bytes())], chunk_bytes, 2).unwrap();
        prop_assert_eq!(absolute.faces, relative.faces);
        prop_assert_eq!(absolute.positions, relative.positions);
    }

    #[test]
    fn the_two_readers_agree(line in any_line(), end in prop_oneof![Just("\n"), Just("\r\n")]) {
        // A trailing comment sends a line to the general reader.
        let plain = obj_of(&format!("{line}{end}"));
        let general = obj_of(&format!("{line} #{end}"));
        prop_assume!(!line.starts_with(['g', 'o', 'u', 'm']));
        prop_assert_eq!(plain, general);
    }

    #[test]
    fn bytes_never_panic(bytes in prop::collection::vec(prop_oneof![any::<u8>(), prop::sample::select(b"vf 1/-.e\n\\\r".to_vec())], 0..200)) {
        let _ = scan_files(&[("a.obj", &bytes)], 16, 1);
    }
}

fn obj_of(text: &str) -> String {
    let mut chunk = ParsedChunk::default();
    let result = statements::parse(text.as_bytes(), &mut chunk);
    format!("{result:?} {chunk:?}")
}

/// Runs over a folder of small files with known faults and an `expected.json` with the expected results.
#[test]
fn every_file_of_the_edge_collection_is_read_or_refused_as_expected() {
    let shared = std::env::var_os("DRYSTONE_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let edge = shared.join("objcorpus/edge");
    let Ok(text) = fs::read(edge.join("expected.json")) else {
        eprintln!("skipped: no {} (set DRYSTONE_SHARED)", edge.join("expected.json").display());
        return;
    };
    let expected: serde_json::Value = serde_json::from_slice(&text).unwrap();
    let mut wrong = Vec::new();
    for case in expected["cases"].as_array().unwrap() {
        let (id, expect) = (case["id"].as_str().unwrap(), case["expect"].as_str().unwrap());
        let allowed = |outcome: &str| case["allow"].as_array().unwrap().iter().any(|allowed| allowed == outcome);
        let line = case["line"].as_u64();
        let work = tempfile::tempdir().unwrap();
        let inputs = [edge.join(case["main"].as_str().unwrap())];
        let options = ScanOptions { threads: 2, chunks_in_flight: 4, ..Default::default() };
        match scan(&inputs, work.path(), &options, &Silent) {
            Err(error) => {
                if !allowed("error") || line.is_some_and(|line| !error.to_string().contains(&format!(".obj:{line}:"))) {
                    wrong.push(format!("{id}: expected {expect} at {line:?}, found {error}"));
                }
            }
            Ok(scan) => {
                let (count, warnings) = (case["counts"]["tris"].as_u64(), scan.findings.warnings().join("\n"));
                // This reader may accept a statement as a face that the reference reader does not.
                let known = case["tris_any"].as_array().is_some_and(|any| any.contains(&scan.triangles.into()));
                let is_expected = expect != "error" && (count == Some(scan.triangles) || known);
                let names_line =
                    expect != "warn" || line.is_none_or(|line| warnings.contains(&format!(".obj:{line}:")));
                if !is_expected || !names_line || !allowed("accept") && warnings.is_empty() {
                    let found = scan.triangles;
                    wrong.push(format!("{id}: expected {expect} at {line:?}, {count:?}; found {found}, {warnings}"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
