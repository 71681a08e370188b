//! Tests of the scan of PLY files: each mesh in each encoding, and files that are damaged in every way.

use std::fs;
use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};

use super::*;
use crate::base::{Error, Silent};
use crate::model::id::{MaterialId, PieceTexcoord, PieceVertex};
use crate::model::{Catalogue, Face};
use crate::read::{Scan, ScanOptions, scan, scan_in_chunks};

/// Records of a scan, in memory.
#[derive(Debug)]
struct Records {
    scan: Scan,
    positions: Vec<DVec3>,
    texcoords: Vec<DVec2>,
    colours: Vec<[f32; 3]>,
    faces: Vec<Face<PieceVertex>>,
}

fn scan_bytes(bytes: &[u8], chunk_bytes: u64, threads: usize) -> Result<Records> {
    // Thousands of files are quicker in memory, where there is such a place.
    let folder = tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).unwrap();
    let path = folder.path().join("a.ply");
    fs::write(&path, bytes).unwrap();
    let options = ScanOptions { threads, chunks_in_flight: threads + 1, ..Default::default() };
    records(scan_in_chunks(&[path], folder.path(), &options, None, &Silent, chunk_bytes)?)
}

fn records(scan: Scan) -> Result<Records> {
    let piece = &scan.mesh.pieces[0];
    let (file, mut bytes, mut block, mut faces) = (piece.faces.open()?, vec![], vec![], vec![]);
    for of in piece.faces.blocks() {
        piece.faces.read_block(&file, of, &mut bytes, &mut block)?;
        faces.extend_from_slice(&block);
    }
    let colours = piece.colours.as_ref().map_or(Ok(Vec::new()), |c| c.window(0..c.len()).map(|c| c.to_vec()))?;
    Ok(Records {
        positions: piece.positions.window(0..piece.positions.len())?,
        texcoords: piece.texcoords.window(0..piece.texcoords.len())?,
        colours,
        faces,
        scan,
    })
}

fn message(bytes: &[u8]) -> String {
    let message = scan_bytes(bytes, 64, 2).map(|records| records.faces.len()).unwrap_err().to_string();
    message.split_once("/a.ply").map_or(message.clone(), |(_, rest)| format!("a.ply{rest}"))
}

/// Writes text as a PLY of another encoding: each line of the body is a record of numbers by the header's types.
fn encoded(text: &str, encoding: &str) -> Vec<u8> {
    let (head, body) = text.split_once("end_header\n").unwrap();
    let mut out = format!("{}end_header\n", head.replace("ascii", encoding)).into_bytes();
    if encoding == "ascii" {
        out.extend_from_slice(body.as_bytes());
        return out;
    }
    let mut put = |kind: &str, word: &str| {
        let mut bytes = match kind {
            "uchar" => vec![word.parse::<u8>().unwrap()],
            "char" => word.parse::<i8>().unwrap().to_le_bytes().to_vec(),
            "ushort" => word.parse::<u16>().unwrap().to_le_bytes().to_vec(),
            "int" => word.parse::<i32>().unwrap().to_le_bytes().to_vec(),
            "uint" => word.parse::<u32>().unwrap().to_le_bytes().to_vec(),
            "float" => word.parse::<f32>().unwrap().to_le_bytes().to_vec(),
            "double" => word.parse::<f64>().unwrap().to_le_bytes().to_vec(),
            _ => panic!("{kind}"),
        };
        if encoding.contains("big") {
            bytes.reverse();
        }
        out.extend(bytes);
    };
    let mut lines = body.lines();
    let mut element: Option<(usize, Vec<Vec<&str>>)> = None;
    let mut elements = Vec::new();
    for line in head.lines() {
        let words: Vec<&str> = line.split(' ').collect();
        match words[0] {
            "element" => elements.extend(element.replace((words[2].parse().unwrap(), Vec::new()))),
            "property" => element.as_mut().unwrap().1.push(words[1..].to_vec()),
            _ => {}
        }
    }
    elements.extend(element);
    for (count, properties) in elements {
        for _ in 0..count {
            let mut words = lines.next().unwrap().split(' ');
            for property in &properties {
                match property[..] {
                    ["list", length, item, _] => {
                        let count = words.next().unwrap();
                        put(length, count);
                        (0..count.parse::<usize>().unwrap()).for_each(|_| put(item, words.next().unwrap()));
                    }
                    [kind, _] => put(kind, words.next().unwrap()),
                    _ => panic!("{property:?}"),
                }
            }
        }
    }
    out
}

const ENCODINGS: [&str; 3] = ["ascii", "binary_little_endian", "binary_big_endian"];

/// A quad and a triangle, with everything that is read and some that is not.
const MESH: &str = "ply\nformat ascii 1.0\ncomment by hand\ncomment TextureFile wall.png\n\
    comment TextureFile sub/roof.png\nelement camera 2\nproperty list ushort double pose\nproperty int id\n\
    element face 3\nproperty uchar flags\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\n\
    property int texnumber\nelement vertex 5\nproperty float x\nproperty float y\nproperty double z\nproperty float nx\n\
    property float ny\nproperty float nz\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
    property uchar alpha\nproperty float quality\nend_header\n\
    2 0.5 1.5 7\n0 8\n\
    0 4 0 1 2 3 8 0 0 1 0 1 1 0 1 0\n9 3 0 3 4 6 0 0 0 1 0.25 0.125 1\n0 3 4 3 2 0 -1\n\
    0 0 0 0 0 1 255 0 51 255 0.5\n1 0 0.1 0 0 1 0 255 0 255 0.5\n1 1 0 0 0 1 0 0 255 255 0.5\n\
    0 1.125 0 0 0 1 1 2 3 255 0.5\n-1 12.345 1e-3 0 0 1 1 1 1 255 9\n";

#[test]
fn every_encoding_says_the_same_at_any_cut_and_number_of_threads() {
    let mut first: Option<String> = None;
    for encoding in ENCODINGS {
        let bytes = encoded(MESH, encoding);
        for (chunk_bytes, threads) in [(1, 1), (7, 3), (40, 2), (1 << 20, 2)] {
            let records = scan_bytes(&bytes, chunk_bytes, threads).unwrap();
            let Scan { catalogue, triangles, findings, input_bytes, .. } = &records.scan;
            assert_eq!((*triangles, *input_bytes), (4, bytes.len() as u64));
            let counts = ["unknown_elements", "unknown_properties", "ignored_alphas"].map(|kind| findings.get(kind));
            assert_eq!(counts, [1, 2, 5], "{findings:?}");
            let Catalogue { materials, parts, has_normals, has_texcoords, .. } = catalogue;
            assert!(*has_normals && *has_texcoords);
            let names: Vec<_> = materials.iter().map(|material| &material.name[..]).collect();
            assert_eq!(names, [&b"wall"[..], b"roof"]);
            let definition = materials.raw[1].definition.as_ref().unwrap();
            assert_eq!(definition.textures[0].name, b"sub/roof.png");
            let [wall, roof] = [0, 1].map(|number| Some(MaterialId::new(number)));
            assert!(parts.iter().map(|part| part.material).eq([wall, roof, None]));
            let uv_of = |t: PieceTexcoord| records.texcoords.get(t.index()).copied();
            let of_corners = |face: &Face<PieceVertex>| face.texcoords.map(uv_of);
            let said = format!(
                "{:?} {:?} {:?}",
                records.positions,
                records.colours,
                records.faces.iter().map(|face| (face.vertices, face.part, of_corners(face))).collect::<Vec<_>>()
            );
            assert_eq!(*first.get_or_insert(said.clone()), said, "{encoding} {chunk_bytes}");
        }
    }
    let records = scan_bytes(MESH.as_bytes(), 1 << 20, 1).unwrap();
    assert_eq!(records.positions[4], DVec3::new(-1.0, 12.345, 0.001));
    assert_eq!(records.colours[0], [1.0, 0.0, 0.2]);
    let faces = records.faces.iter().map(|face| (face.vertices.map(|v| v.number()), face.continues_polygon));
    assert!(faces.eq([([0, 1, 2], false), ([0, 2, 3], true), ([0, 3, 4], false), ([4, 3, 2], false)]));
    assert_eq!(records.faces[3].texcoords, [PieceTexcoord::NONE; 3]);
    assert_eq!(records.texcoords[records.faces[2].texcoords[2].index()], DVec2::new(0.25, 0.125));
}

#[test]
fn texture_coordinates_of_vertices_are_known_by_any_name() {
    for [u, v] in [["u", "v"], ["s", "t"], ["texture_u", "texture_v"]] {
        let text = format!(
            "ply\nformat ascii 1.0\ncomment TextureFile wall.png\nelement vertex 3\nproperty float x\nproperty float y\n\
             property float z\nproperty float {v}\nproperty float {u}\nelement face 1\n\
             property list uchar uint vertex_index\nend_header\n0 0 0 0.5 0.25\n1 0 0 0 nan\n0 1 0 1 1\n3 0 1 2\n"
        );
        let records = scan_bytes(text.as_bytes(), 8, 1).unwrap();
        assert_eq!(records.texcoords, [DVec2::new(0.25, 0.5), DVec2::ZERO, DVec2::ONE]);
        assert_eq!(records.faces[0].texcoords, [0, 1, 2].map(PieceTexcoord::new));
        assert_eq!(records.scan.catalogue.materials.raw[0].name, b"wall");
        assert!(records.scan.findings.warnings()[0].contains("a.ply:14: vertex 1: a texture coordinate"));
    }
}

#[test]
fn two_images_of_one_name_are_two_materials() {
    let text =
        MESH.replace("sub/roof.png", "sub/wall.png").replace("end_header", "comment TextureFile wall.png\nend_header");
    let text = text.replace("3 4 3 2 0 -1", "3 4 3 2 0 2");
    let records = scan_bytes(text.as_bytes(), 1 << 20, 1).unwrap();
    let names: Vec<_> = records.scan.catalogue.materials.iter().map(|material| &material.name[..]).collect();
    assert_eq!(names, [&b"wall"[..], b"wall_1"]);
    assert_eq!(records.faces[3].part, records.faces[0].part);
}

/// A tetrahedron.
const SMALL: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
    element face 4\nproperty list uchar int vertex_indices\nend_header\n\
    0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 3 1\n3 1 3 2\n3 0 2 3\n";

#[test]
fn faulty_records_are_named_by_line_or_byte() {
    let text = |from: &str, to: &str| SMALL.replacen(from, to, 1).into_bytes();
    let header_bytes = SMALL.find("0 0 0\n").unwrap();
    for (bytes, expected) in [
        (text("1 0 0\n", "1 0\n"), "a.ply:11: vertex 1: expected a number, found a line end"),
        (text("1 0 0\n", "1 0 0 5\n"), "a.ply:11: vertex 1: expected a line end, found '5'"),
        (text("1 0 0\n", "1 O 0\n"), "a.ply:11: vertex 1: expected a number, found 'O'"),
        (text("1 0 0\n", "1 nan 0\n"), "a.ply:11: vertex 1: expected a number between -3.4e38 and 3.4e38, found NaN"),
        (text("1 0 0\n", "1 1e39 0\n"), "a.ply:11: vertex 1: expected a number between -3.4e38 and 3.4e38, found 1000"),
        (text("3 0 3 1", "3 0 3 4"), "a.ply:15: face 1: refers to vertex 4; the file has 4, counted from 0"),
        (text("3 0 3 1", "3 0 3 -1"), "a.ply:15: face 1: refers to vertex -1"),
        (text("3 0 3 1", "3 0 3 99999999999999999999"), "a.ply:15: face 1: refers to vertex 9223372036854775807"),
        (text("3 0 3 1", "3 0 3 1.5"), "a.ply:15: face 1: expected an integer, found '1.5'"),
        (text("3 0 3 1", "4 0 3 1"), "a.ply:15: face 1: expected a number, found a line end"),
        (text("3 0 2 3\n", ""), "a.ply:17: expected 4 records of element 'face', the file ends after 3"),
        (text("3 0 2 3\n", "3 0 2 3\n\n7\n"), "a.ply:18: expected the end of the file"),
        (text("element vertex 4", "element vertex 4000"), "a.ply:3: element 'vertex' needs at least 24000 bytes (4000"),
        (text("element face", "element faces"), "a.ply: no faces: the header has no element 'face'"),
        (text("element vertex", "element vertices"), "a.ply: expected an element 'vertex'"),
        (text("float y", "float w"), "a.ply: expected a property 'y' of element 'vertex'"),
        (text("uchar int", "uchar float"), "a.ply:8: expected vertex indices that are integers"),
        (text("vertex_indices", "corners"), "a.ply: expected a list 'vertex_indices'"),
        (
            text("3 0 1 2\n3 0 3 1\n3 1 3 2\n3 0 2 3", "1 0\n2 1 2\n3 1 1 2\n0"),
            "a.ply: no faces: the only face repeats",
        ),
    ] {
        let found = message(&bytes);
        assert!(found.starts_with(expected), "{found}\n{expected}");
    }
    let binary = |text: &str| encoded(text, "binary_little_endian");
    let start = binary(SMALL).len() - 4 * 12 - 4 * 13;
    assert_eq!(start, header_bytes + "binary_little_endian".len() - "ascii".len());
    let changed = |at: usize, bytes: &[u8]| {
        let mut whole = binary(SMALL);
        whole[start + at..start + at + bytes.len()].copy_from_slice(bytes);
        whole
    };
    let cut = |less: usize| binary(SMALL)[..binary(SMALL).len() - less].to_vec();
    for (bytes, expected) in [
        (changed(16, &f32::NAN.to_le_bytes()), format!("vertex 1, at byte {}: expected a number between", start + 12)),
        (changed(48 + 13 + 1, &4u32.to_le_bytes()), format!("face 1, at byte {}: refers to vertex 4", start + 61)),
        (changed(48 + 13 + 1, &(-1i32).to_le_bytes()), format!("face 1, at byte {}: refers to vertex -1", start + 61)),
        (changed(48 + 39, &[255]), format!("face 3, at byte {}: a list of 255 numbers passes the end", start + 87)),
        (cut(1), "a list of 3 numbers passes the end of the file".to_owned()),
        (cut(13), "expected 4 records of element 'face', the file ends after 3".to_owned()),
        (
            cut(60),
            "element 'vertex' needs at least 48 bytes (4 records of at least 12); the file has 40 left at".to_owned(),
        ),
        ([binary(SMALL), vec![0; 3]].concat(), "expected the end of the file at byte".to_owned()),
    ] {
        let found = message(&bytes);
        assert!(found.contains(&expected), "{found}\n{expected}");
    }
}

#[test]
fn any_change_of_a_byte_or_of_the_length_is_an_error_or_a_mesh() {
    for encoding in ENCODINGS {
        let whole = encoded(MESH, encoding);
        for at in 0..whole.len() {
            let _ = scan_bytes(&whole[..at], 64, 1).map_err(tame);
            let mut changed = whole.clone();
            changed[at] = if at % 2 == 0 { b'9' } else { 0xff };
            match scan_bytes(&changed, 64, 1) {
                Ok(records) => {
                    let vertices = PieceVertex::from(records.positions.len());
                    assert!(records.faces.iter().flat_map(|face| face.vertices).all(|vertex| vertex < vertices));
                }
                Err(error) => tame(error),
            }
        }
    }
}

fn tame(error: Error) {
    let text = error.to_string();
    assert!(text.len() < 8000 && !text.chars().any(char::is_control), "{text:?}");
    assert!(matches!(error, Error::Input { .. } | Error::Limit(_)), "{error:?}");
}

#[test]
fn every_header_word_may_be_missing_or_doubled() {
    let words: Vec<&str> = MESH.split_inclusive([' ', '\n']).collect();
    let header = words.iter().position(|word| word.starts_with("end_header")).unwrap();
    for at in 0..=header {
        for repeats in [0, 2] {
            let changed: String =
                words.iter().enumerate().flat_map(|(i, word)| vec![*word; if i == at { repeats } else { 1 }]).collect();
            let _ = scan_bytes(changed.as_bytes(), 64, 1).map_err(tame);
        }
    }
}

#[test]
fn counts_never_size_an_allocation() {
    let huge = [u64::MAX, u64::MAX / 2, u64::from(u32::MAX), 1 << 40];
    for count in huge {
        for element in ["vertex 5", "face 3", "camera 2"] {
            let (name, _) = element.split_once(' ').unwrap();
            let text = MESH.replace(&format!("element {element}"), &format!("element {name} {count}"));
            for encoding in ENCODINGS {
                let bytes = text.replace("ascii", encoding);
                assert!(message(bytes.as_bytes()).contains("records of at least"), "{element} {count}");
            }
        }
    }
    let list = SMALL.replace("list uchar int", "list uint int");
    let mut bytes = encoded(&list, "binary_little_endian");
    let at = bytes.len() - 16;
    bytes[at..at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(message(&bytes).contains("a list of 4294967295 numbers passes the end of the file"));
    // An element without properties takes no bytes.
    let text = SMALL.replace("end_header", &format!("element nothing {}\nend_header", u64::MAX));
    assert_eq!(scan_bytes(text.as_bytes(), 64, 1).unwrap().faces.len(), 4);
}

#[test]
fn a_record_longer_than_a_chunk_is_read_and_one_longer_than_all_is_refused() {
    let polygon = |corners: usize| {
        let list = SMALL.replace("element face 4", "element face 1").replace("list uchar", "list uint");
        let head = list.split_once("end_header\n").unwrap().0;
        let ids = (0..corners).map(|i| format!(" {}", i % 4)).collect::<String>();
        format!("{head}end_header\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n{corners}{ids}\n")
    };
    for encoding in ENCODINGS {
        let records = scan_bytes(&encoded(&polygon(300_000), encoding), 1 << 12, 2).unwrap();
        assert_eq!(records.scan.triangles, 299_998);
        assert_eq!(records.scan.findings.get("fanned_polygons"), 1);
    }
    let found = message(&encoded(&polygon(5_000_000), "binary_big_endian"));
    assert!(found.contains("a record has at most 16 MiB"), "{found}");
    let long = SMALL.replace("1 0 0\n", &format!("1 0 0{}\n", " ".repeat(18 << 20)));
    assert!(message(long.as_bytes()).starts_with("a.ply:11: expected a line end within 16 MiB"));
}

#[test]
fn line_ends_of_every_kind_and_blank_lines_are_read() {
    let expected = scan_bytes(SMALL.as_bytes(), 1 << 20, 1).unwrap();
    for end in ["\r\n", "\r", "\n\n", " \t\n\n  \n"] {
        let (head, body) = SMALL.split_once("end_header\n").unwrap();
        let head_end = if end.starts_with('\r') { end } else { "\n" };
        let text = head.replace('\n', head_end) + "end_header" + head_end + &body.replace('\n', end);
        for text in [text.clone(), text.trim_end().to_owned()] {
            for chunk_bytes in [1, 5, 64, 1000] {
                let found = scan_bytes(text.as_bytes(), chunk_bytes, 2).unwrap();
                assert_eq!((found.positions.len(), &found.faces), (4, &expected.faces), "{end:?}");
            }
        }
    }
}

#[test]
fn hashes_of_a_resumed_job_are_those_of_the_scan() {
    let folder = tempfile::tempdir().unwrap();
    let mut text = SMALL.replace("element vertex 4", "element vertex 200004").replace("3 0 1 2\n", "");
    text = text.replace("element face 4", "element face 3");
    let at = text.find("0 0 0\n").unwrap();
    text.insert_str(at, &"5 6 7.25\n".repeat(200_000));
    for encoding in ENCODINGS {
        let inputs: [PathBuf; 1] = [folder.path().join("a.ply")];
        fs::write(&inputs[0], encoded(&text, encoding)).unwrap();
        let found = scan(&inputs, folder.path(), &ScanOptions::default(), &Silent).unwrap();
        let again = crate::read::fingerprint::content_hashes(&inputs, 2, &Silent).unwrap();
        assert_eq!(found.content_hashes, again);
        let (counts, _) = crate::read::count(&inputs, 2, None, &Silent).unwrap();
        assert_eq!((counts.vertices, counts.triangles), (200_004, 3));
    }
}

#[test]
fn the_ending_tells_the_format_and_without_one_the_first_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let scan_at = |path: &Path| scan(&[path.to_owned()], folder.path(), &ScanOptions::default(), &Silent);
    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    for (name, text, triangles) in [("a", SMALL, 4), ("a.mesh", SMALL, 4), ("b.txt", obj, 1), ("c.OBJ", obj, 1)] {
        fs::write(at(name), text).unwrap();
        assert_eq!(scan_at(&at(name)).unwrap().triangles, triangles, "{name}");
    }
    for (name, text, words) in [
        ("d.obj", SMALL, "d.obj:1: expected OBJ text, found a PLY file"),
        ("e.ply", obj, "e.ply:1: expected 'ply' on the first line"),
    ] {
        fs::write(at(name), text).unwrap();
        let error = scan_at(&at(name)).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
    let both = [at("a"), at("c.OBJ")];
    let found = scan(&both, folder.path(), &ScanOptions::default(), &Silent).unwrap();
    assert_eq!((found.triangles, found.mesh.pieces.len(), found.content_hashes.len()), (5, 2, 2));
}

#[test]
fn the_first_list_of_corners_counts() {
    let header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
        element face 2\nproperty list uchar int vertex_indices\nproperty list uchar int vertex_index\nend_header\n";
    let text = format!("{header}0 0 0\n1 0 0\n0 1 0\n1 1 1\n3 0 1 2 3 3 1 2\n3 1 3 2 3 0 3 2\n");
    let found = scan_bytes(text.as_bytes(), 64, 2).unwrap();
    assert_eq!((found.faces.len(), found.scan.findings.get("unknown_properties")), (2, 1));
}
