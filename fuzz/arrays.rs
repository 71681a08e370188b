//! What is fuzzed of array files, against a reader of a few lines.

use std::fs;

use drystone::base::{ErrorKind, Silent};
use drystone::options::{Limits, SimplifyOptions, Target, TextureFiles};
use drystone::pipeline;
use drystone::read::{ScanOptions, count, scan};

use super::{Numbers, assert_tame, assert_whole, folder};

/// Stands for none in a face.
const NONE: u32 = u32::MAX;

/// What the simple reader counts.
#[derive(Debug, PartialEq)]
struct Counted {
    vertices: u64,
    texcoords: u64,
    triangles: u64,
    /// Those that do not repeat a vertex, and all of polygons.
    kept: u64,
}

/// Any bytes as an array file, or as the numbers of one: refused where the simple reader refuses, the same counts
/// otherwise; simplified, an array file of the triangles that the report counts.
pub fn scan_arrays(bytes: &[u8]) {
    let made = (!bytes.starts_with(b"drystone")).then(|| file_of(bytes));
    let bytes = made.as_deref().unwrap_or(bytes);
    let has_images = bytes.get(56..64).is_some_and(|images| images != [0; 8]);
    let expected = counted(bytes);
    let folder = folder();
    let path = folder.path().join("a.drystone");
    fs::write(&path, bytes).expect("written");
    let input = [path];
    let options = ScanOptions { chunks_in_flight: 1, ..Default::default() };
    let found = match scan(&input, folder.path(), &options, &Silent) {
        Ok(found) => found,
        Err(error) => {
            assert_tame(&error);
            assert_eq!(error.kind(), ErrorKind::Input, "{error}");
            assert!(has_images || expected.is_none_or(|expected| expected.kept == 0), "{error}");
            return;
        }
    };
    assert_whole(&found);
    let scanned = Counted {
        vertices: found.mesh.vertex_count(),
        texcoords: found.mesh.texcoord_count(),
        triangles: found.triangles,
        kept: found.mesh.face_count(),
    };
    assert_eq!(Some(&scanned), expected.as_ref());
    let (counts, _) = count(&input, 1, None, &Silent).expect("a mesh that was scanned");
    assert_eq!((counts.vertices, counts.texcoords), (scanned.vertices, scanned.texcoords));
    assert_eq!((counts.triangles, counts.bytes), (scanned.triangles, bytes.len() as u64));
    let output = folder.path().join("out/a.drystone");
    let options = SimplifyOptions {
        target: Target::ratio(0.5),
        limits: Limits { memory: Some(128 << 20), threads: Some(1) },
        textures: TextureFiles::Reference,
        ..Default::default()
    };
    match pipeline::simplify(&input[0], &output, &options, &Silent) {
        Ok(report) => {
            let result = counted(&fs::read(&output).expect("a result")).expect("a result that can be read");
            assert_eq!((result.triangles, result.kept), (report.faces.output, report.faces.output));
        }
        // Vertices at one place are one.
        Err(error) => assert!(error.to_string().contains("none is left: every triangle repeats a vertex"), "{error}"),
    }
}

/// Counts an array file, as `docs/reference/input.md` describes it; `None` if it is faulty. Does not look at images.
fn counted(bytes: &[u8]) -> Option<Counted> {
    let header = bytes.strip_prefix(b"drystone")?.as_chunks::<8>().0.first_chunk::<8>()?;
    let [version, vertices, texcoords, faces, flags, corners, _, text] = header.map(u64::from_le_bytes);
    if version != 1 || flags > 7 || !(3..=512).contains(&corners) {
        return None;
    }
    let words = corners * (1 + (flags >> 1 & 1)) + (flags >> 2);
    let sizes = [(vertices, 24 + 12 * (flags & 1)), (texcoords, 16), (faces, 4 * words)];
    let header = (72 + u128::from(text)).next_multiple_of(8);
    let records: u128 = sizes.iter().map(|&(count, size)| u128::from(count) * u128::from(size)).sum();
    if header + records != bytes.len() as u128 {
        return None;
    }
    let (positions, rest) = bytes[header as usize..].split_at((sizes[0].0 * sizes[0].1) as usize);
    let (uv, faces) = rest.split_at((16 * texcoords) as usize);
    let is_number = |x: &[u8; 8]| f64::from_le_bytes(*x).abs() <= f64::from(f32::MAX);
    let mut at = positions.chunks_exact(sizes[0].1 as usize).map(|record| &record[..24]);
    if !at.all(|record| record.as_chunks().0.iter().all(is_number)) || !uv.as_chunks().0.iter().all(is_number) {
        return None;
    }
    let (mut triangles, mut kept) = (0, 0);
    for face in faces.chunks_exact(4 * words as usize) {
        let ids: Vec<u32> = face.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect();
        let (ids, rest) = ids.split_at(corners as usize);
        let size = ids.iter().position(|id| *id == NONE).unwrap_or(ids.len());
        let is_there = |id: u32, there: u64| u64::from(id) < there;
        let texcoord_count = if flags & 2 == 0 { 0 } else { size };
        if size < 3
            || !ids[..size].iter().all(|id| is_there(*id, vertices))
            || !rest[..texcoord_count].iter().all(|id| *id == NONE || is_there(*id, texcoords))
        {
            return None;
        }
        let repeats = size == 3 && (ids[0] == ids[1] || ids[1] == ids[2] || ids[2] == ids[0]);
        triangles += size as u64 - 2;
        kept += if repeats { 0 } else { size as u64 - 2 };
    }
    Some(Counted { vertices, texcoords, triangles, kept })
}

/// A file whose counts agree with its length, and whose numbers are seldom faulty.
fn file_of(bytes: &[u8]) -> Vec<u8> {
    let mut numbers = Numbers(bytes);
    let flags = u64::from(numbers.next() % 8);
    let [corners, vertices, texcoords] = [6, 40, 12].map(|limit| u64::from(numbers.next() % limit));
    let corners = 3 + corners;
    let mut text = String::new();
    let images = u64::from(numbers.next() % 3);
    for image in 0..images {
        text += &format!("{} image-{image}.png\n", numbers.next() % 4);
    }
    let mut records = Vec::new();
    for _ in 0..vertices {
        push_doubles::<3>(&mut numbers, &mut records);
        if flags & 1 != 0 {
            let colour = if numbers.next() == 255 { f32::INFINITY } else { 0.5 };
            (0..3).for_each(|_| records.extend_from_slice(&colour.to_le_bytes()));
        }
    }
    (0..texcoords).for_each(|_| push_doubles::<2>(&mut numbers, &mut records));
    let mut faces = 0u64;
    while !numbers.0.is_empty() {
        let mut push = |limit: u64| {
            let word = match numbers.next() {
                255 => NONE,
                254 => limit as u32,
                byte => (u64::from(byte) % limit.max(1)) as u32,
            };
            records.extend_from_slice(&word.to_le_bytes());
        };
        (0..corners).for_each(|_| push(vertices));
        (0..corners * (flags >> 1 & 1)).for_each(|_| push(texcoords));
        (0..flags >> 2).for_each(|_| push(4));
        faces += 1;
    }
    let mut file = b"drystone".to_vec();
    for word in [1, vertices, texcoords, faces, flags, corners, images, text.len() as u64] {
        file.extend_from_slice(&word.to_le_bytes());
    }
    file.extend_from_slice(text.as_bytes());
    file.resize(file.len().next_multiple_of(8), 0);
    file.extend_from_slice(&records);
    file
}

fn push_doubles<const N: usize>(numbers: &mut Numbers, records: &mut Vec<u8>) {
    for _ in 0..N {
        let number = match numbers.next() {
            255 => f64::NAN,
            254 => 1e39,
            253 => -1e-40,
            byte => f64::from(byte) / 16.0,
        };
        records.extend_from_slice(&number.to_le_bytes());
    }
}
