//! An array file holds what an OBJ of the same numbers holds.

use std::fs;
use std::path::{Path, PathBuf};

use proptest::prelude::*;

use crate::base::{ErrorKind, Silent};
use crate::model::array_file::{ArrayLayout, NONE};
use crate::model::corners::FaceReader;
use crate::read::fingerprint::content_hashes;
use crate::read::{Scan, ScanOptions, count, scan, scan_in_chunks};

/// A mesh of two squares with colours, texture coordinates and labels.
fn file_of(positions: &[[f64; 3]], texcoords: &[[f64; 2]], faces: &[[u32; 7]], images: &[(u32, &str)]) -> Vec<u8> {
    let layout = ArrayLayout {
        vertices: positions.len() as u64,
        texcoords: texcoords.len() as u64,
        faces: faces.len() as u64,
        corners: 3,
        has_colours: true,
        has_texcoords: true,
        has_labels: true,
        images: images.iter().map(|(label, name)| (*label, name.as_bytes().to_vec())).collect(),
    };
    let mut bytes = layout.encode();
    for (i, position) in positions.iter().enumerate() {
        position.iter().for_each(|x| bytes.extend_from_slice(&x.to_le_bytes()));
        [0.5, 0.25, i as f32].iter().for_each(|c| bytes.extend_from_slice(&c.to_le_bytes()));
    }
    texcoords.iter().flatten().for_each(|x| bytes.extend_from_slice(&x.to_le_bytes()));
    faces.iter().flatten().for_each(|word| bytes.extend_from_slice(&word.to_le_bytes()));
    bytes
}

fn squares() -> Vec<u8> {
    let positions = [[0.0; 3], [1.5, 0.0, 0.0], [1.5, 1.0, 0.0], [0.0, 1.0, 0.125], [4e6, 0.0, 0.0]];
    let texcoords = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.25, 1.0]];
    let faces = [[0, 1, 2, 0, 1, 2, 3], [0, 2, 3, 0, 2, 3, 9], [1, 4, 2, NONE, NONE, NONE, NONE]];
    file_of(&positions, &texcoords, &faces, &[(9, "nine.png"), (5, "unused.png")])
}

fn written(folder: &Path, bytes: &[u8]) -> [PathBuf; 1] {
    let path = folder.join("mesh.drystone");
    fs::write(&path, bytes).unwrap();
    [path]
}

fn faces_of(scan: &Scan) -> Vec<String> {
    let mut found = Vec::new();
    let reading = FaceReader::default().each_block(&scan.mesh.pieces[0], |block| {
        found.extend(block.iter().map(|face| format!("{face:?}")));
        Ok(())
    });
    reading.unwrap();
    found
}

#[test]
fn the_mesh_is_that_of_an_obj_of_the_same_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = written(folder.path(), &squares());
    let text = "mtllib a.mtl\nv 0 0 0 .5 .25 0\nv 1.5 0 0 .5 .25 1\nv 1.5 1 0 .5 .25 2\nv 0 1 .125 .5 .25 3\n\
                v 4e6 0 0 .5 .25 4\nvt 0 0\nvt 1 0\nvt 1 1\nvt .25 1\nusemtl 3\nf 1/1 2/2 3/3\nusemtl 9\n\
                f 1/1 3/3 4/4\nusemtl\nf 2 5 3\n";
    fs::write(folder.path().join("a.mtl"), "newmtl 9\nmap_Kd nine.png\n").unwrap();
    let obj = [folder.path().join("mesh.obj")];
    fs::write(&obj[0], text).unwrap();
    let scans = [&inputs, &obj].map(|inputs| {
        let work = tempfile::tempdir().unwrap();
        (scan(inputs, work.path(), &ScanOptions::default(), &Silent).unwrap(), work)
    });
    let [(arrays, _kept), (obj, _kept_too)] = &scans;
    assert_eq!(faces_of(arrays), faces_of(obj));
    let columns = |scan: &Scan| {
        let piece = &scan.mesh.pieces[0];
        let positions = piece.positions.window(0..piece.positions.len()).unwrap().to_vec();
        let texcoords = piece.texcoords.window(0..piece.texcoords.len()).unwrap().to_vec();
        let colours = piece.colours.as_ref().unwrap();
        (positions, texcoords, colours.window(0..colours.len()).unwrap().to_vec())
    };
    assert_eq!(columns(arrays), columns(obj));
    assert_eq!((arrays.catalogue.position_decimals, arrays.catalogue.texcoord_decimals), (3, 2));
    let textures = |scan: &Scan| {
        let materials = scan.catalogue.materials.iter();
        let named = materials.map(|m| (m.name.clone(), m.definition.as_ref().map(|d| d.textures.clone())));
        named.collect::<Vec<_>>()
    };
    assert_eq!(textures(arrays), textures(obj));
    assert_eq!(arrays.triangles, 3);
    let (counts, _) = count(&inputs, 2, None, &Silent).unwrap();
    assert_eq!((counts.vertices, counts.texcoords, counts.triangles, counts.decimals), (5, 4, 3, 3));
    assert_eq!(counts.bytes, fs::metadata(&inputs[0]).unwrap().len());
    assert_eq!(content_hashes(&inputs, 2, &Silent).unwrap(), arrays.content_hashes);
}

#[test]
fn polygons_are_those_of_an_obj() {
    let layout = ArrayLayout {
        vertices: 5,
        texcoords: 0,
        faces: 2,
        corners: 5,
        has_colours: false,
        has_texcoords: false,
        has_labels: false,
        images: Vec::new(),
    };
    let mut bytes = layout.encode();
    let positions = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 1.0], [0.0, 4.0]];
    positions.iter().flat_map(|[x, y]| [*x, *y, 0.0f64]).for_each(|x| bytes.extend_from_slice(&x.to_le_bytes()));
    let faces = [[0, 1, 2, 3, 4], [2, 4, 3, NONE, 7]];
    faces.iter().flatten().for_each(|word: &u32| bytes.extend_from_slice(&word.to_le_bytes()));
    let folder = tempfile::tempdir().unwrap();
    let arrays = written(folder.path(), &bytes);
    let obj = [folder.path().join("mesh.obj")];
    fs::write(&obj[0], "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 2 1 0\nv 0 4 0\nf 1 2 3 4 5\nf 3 5 4\n").unwrap();
    let [arrays, obj] = [&arrays, &obj].map(|inputs| {
        let work = tempfile::tempdir().unwrap();
        let found = scan(inputs, work.path(), &ScanOptions::default(), &Silent).unwrap();
        (faces_of(&found), found.triangles)
    });
    assert_eq!(arrays, obj);
    assert_eq!(arrays.1, 4);
}

#[test]
fn chunks_of_any_size_give_the_same_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = written(folder.path(), &squares());
    let read = |chunk_bytes| {
        let work = tempfile::tempdir().unwrap();
        let options = ScanOptions { threads: 2, chunks_in_flight: 3, ..ScanOptions::default() };
        let found = scan_in_chunks(&inputs, work.path(), &options, None, &Silent, chunk_bytes).unwrap();
        (faces_of(&found), format!("{:?}", found.catalogue))
    };
    let whole = read(1 << 20);
    assert!((1..80).all(|chunk_bytes| read(chunk_bytes) == whole));
}

#[test]
fn faulty_records_are_named() {
    let triangle = |position: [f64; 3], texcoord: [f64; 2], face: [u32; 7]| {
        let positions = [[0.0; 3], [1.0, 0.0, 0.0], position];
        file_of(&positions, &[[0.0; 2], texcoord], &[[0, 1, 2, 0, 0, 0, 0], face], &[])
    };
    let (there, uv, face) = ([0.0, 1.0, 0.0], [1.0; 2], [0, 1, 2, 0, 0, 0, 0]);
    let faults = [
        (triangle([0.0, f64::NAN, 0.0], uv, face), "vertex 2: expected a number between -3.4e38 and 3.4e38, found NaN"),
        (triangle([1e39, 0.0, 0.0], uv, face), "vertex 2:"),
        (triangle(there, [0.0, f64::INFINITY], face), "texture coordinate 1:"),
        (triangle(there, uv, [0, 1, 3, 0, 0, 0, 0]), "face 1: refers to vertex 3; there are 3, counted from 0"),
        (triangle(there, uv, [0, 1, 2, 0, 2, 0, 0]), "face 1: refers to texture coordinate 2"),
        (file_of(&[[0.0; 3]], &[], &[], &[]), "no faces"),
        (file_of(&[[0.0; 3]], &[], &[[0, 0, 0, NONE, NONE, NONE, 0]], &[]), "no faces: the only face repeats a vertex"),
    ];
    let folder = tempfile::tempdir().unwrap();
    for (bytes, words) in faults {
        let inputs = written(folder.path(), &bytes);
        let error = scan(&inputs, folder.path(), &ScanOptions::default(), &Silent).unwrap_err();
        assert!(error.kind() == ErrorKind::Input && error.to_string().contains(words), "{error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]
    #[test]
    fn damaged_files_are_refused_or_read(places in prop::collection::vec((0usize..400, any::<u8>()), 1..4), cut in 0usize..40) {
        let mut bytes = squares();
        for (place, byte) in places {
            let length = bytes.len();
            bytes[place % length] = byte;
        }
        bytes.truncate(bytes.len() - if cut < 20 { 0 } else { cut });
        let folder = tempfile::tempdir().unwrap();
        let inputs = written(folder.path(), &bytes);
        if let Err(error) = scan(&inputs, folder.path(), &ScanOptions::default(), &Silent) {
            prop_assert!(matches!(error.kind(), ErrorKind::Input | ErrorKind::Limit), "{}", error);
        }
    }
}
