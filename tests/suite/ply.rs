//! PLY in and out: it says the same as an OBJ, in each encoding, and a job with it resumes like any other.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::meshes::{StopAfter, contents, copy_town, in_many_clusters, ratio};
use drystone::base::{Error, Progress, Silent};
use drystone::options::SimplifyOptions;
use drystone::pipeline;

const ENCODINGS: [&str; 3] = ["ascii", "binary_little_endian", "binary_big_endian"];

/// What a miniature holds, as it is written.
#[derive(Default)]
struct Miniature {
    vertices: Vec<Vec<String>>,
    texcoords: Vec<[String; 2]>,
    /// Corners of each polygon: vertex, and texture coordinate if it has one.
    faces: Vec<Vec<(usize, Option<usize>)>>,
    has_normals: bool,
    is_textured: bool,
}

impl Miniature {
    fn read(path: &Path) -> Self {
        let mut mesh = Self::default();
        for line in fs::read_to_string(path).unwrap().lines() {
            let words: Vec<&str> = line.split_whitespace().collect();
            match words.split_first() {
                Some((&"v", rest)) => mesh.vertices.push(rest.iter().map(|word| word.to_string()).collect()),
                Some((&"vt", rest)) => mesh.texcoords.push([rest[0].to_owned(), rest[1].to_owned()]),
                Some((&"usemtl", rest)) => mesh.is_textured |= rest[0] == "checker",
                Some((&"f", rest)) => {
                    let absolute = |word: &str, count: usize| match word.parse::<i64>().unwrap() {
                        index if index < 0 => count - index.unsigned_abs() as usize,
                        index => index as usize - 1,
                    };
                    let corner = |word: &&str| {
                        let parts: Vec<&str> = word.split('/').collect();
                        let texcoord = parts.get(1).filter(|part| !part.is_empty());
                        let texcoord = texcoord.map(|part| absolute(part, mesh.texcoords.len()));
                        (absolute(parts[0], mesh.vertices.len()), texcoord)
                    };
                    let corners = rest.iter().map(corner).collect();
                    mesh.has_normals |= rest[0].split('/').count() == 3;
                    mesh.faces.push(corners);
                }
                _ => {}
            }
        }
        mesh
    }

    /// The mesh as a PLY, with doubles, so that each number is the one of the text.
    fn as_ply(&self, encoding: &str) -> Vec<u8> {
        let has_colours = self.vertices[0].len() == 6;
        let has_texcoords = !self.texcoords.is_empty();
        let mut head = format!("ply\nformat {encoding} 1.0\n");
        if self.is_textured {
            head += "comment TextureFile checker.png\n";
        }
        let face_element = format!("element face {}\nproperty list uchar int vertex_indices\n", self.faces.len());
        let mut names = vec!["x", "y", "z"];
        names.extend(if has_colours { &["red", "green", "blue"][..] } else { &[] });
        head += &format!("element vertex {}\n", self.vertices.len());
        names.iter().for_each(|name| head += &format!("property double {name}\n"));
        if self.has_normals {
            ["nx", "ny", "nz"].iter().for_each(|name| head += &format!("property float {name}\n"));
        }
        head += &face_element;
        head += if has_texcoords { "property list uchar double texcoord\nend_header\n" } else { "end_header\n" };
        let mut out = Numbers { bytes: head.into_bytes(), encoding };
        for vertex in &self.vertices {
            vertex.iter().for_each(|word| out.double(word));
            (0..if self.has_normals { 3 } else { 0 }).for_each(|_| out.put("0", &0f32.to_le_bytes()));
            out.end();
        }
        for face in &self.faces {
            out.integer(face.len(), 1);
            face.iter().for_each(|(vertex, _)| out.integer(*vertex, 4));
            if has_texcoords {
                let texcoords: Vec<usize> = face.iter().filter_map(|(_, texcoord)| *texcoord).collect();
                out.integer(2 * texcoords.len(), 1);
                texcoords.iter().flat_map(|texcoord| &self.texcoords[*texcoord]).for_each(|word| out.double(word));
            }
            out.end();
        }
        out.bytes
    }
}

/// Numbers in one of the encodings.
struct Numbers<'a> {
    bytes: Vec<u8>,
    encoding: &'a str,
}

impl Numbers<'_> {
    fn put(&mut self, word: &str, little: &[u8]) {
        match self.encoding {
            "ascii" => self.bytes.extend_from_slice(format!("{word} ").as_bytes()),
            "binary_little_endian" => self.bytes.extend_from_slice(little),
            _ => self.bytes.extend(little.iter().rev()),
        }
    }

    fn double(&mut self, word: &str) {
        self.put(word, &word.parse::<f64>().unwrap().to_le_bytes());
    }

    fn integer(&mut self, value: usize, bytes: usize) {
        self.put(&value.to_string(), &value.to_le_bytes()[..bytes]);
    }

    fn end(&mut self) {
        if self.encoding == "ascii" {
            self.bytes.push(b'\n');
        }
    }
}

/// Every file of the result of an input.
fn result_of(input: &Path, name: &str, options: &SimplifyOptions) -> BTreeMap<PathBuf, Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    pipeline::simplify(input, &folder.path().join(name), options, &Silent).unwrap();
    contents(folder.path())
}

#[test]
fn a_miniature_in_each_encoding_has_the_result_of_its_obj() {
    let mut count = 0;
    for entry in fs::read_dir("fixtures/miniatures").unwrap() {
        let obj = entry.unwrap().path();
        // A material without image has no place in a PLY.
        if obj.extension().is_none_or(|ending| ending != "obj") || obj.ends_with("two_materials_plane.obj") {
            continue;
        }
        let mesh = Miniature::read(&obj);
        let expected = result_of(&obj, "a.ply", &ratio(0.5));
        // Text tells how many decimals are meant; a number alone does not if all end in 0.
        let ends_in_digits = mesh.vertices.iter().flatten().any(|word| !word.ends_with('0'));
        for encoding in ENCODINGS.into_iter().filter(|encoding| ends_in_digits || *encoding == "ascii") {
            let folder = tempfile::tempdir().unwrap();
            let ply = folder.path().join("in.ply");
            fs::write(&ply, mesh.as_ply(encoding)).unwrap();
            fs::copy("fixtures/miniatures/checker.png", folder.path().join("checker.png")).unwrap();
            let found = result_of(&ply, "a.ply", &ratio(0.5));
            assert!(found == expected, "{} {encoding}", obj.display());
        }
        count += 1;
    }
    assert!(count > 8);
}

#[test]
fn a_town_as_ply_and_back_is_the_same_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    copy_town(&path("in"));
    let input = path("in/town.obj");
    let run = |from: &Path, to: &str| {
        pipeline::simplify(from, &path(to), &in_many_clusters(ratio(0.3)), &Silent).unwrap().faces
    };
    let (obj, ply) = (run(&input, "a.obj"), run(&input, "b.ply"));
    assert_eq!((obj.input, obj.output), (ply.input, ply.output));
    let (from_obj, from_ply) = (run(&path("a.obj"), "c.ply"), run(&path("b.ply"), "d.ply"));
    assert_eq!((from_obj.input, from_ply.input), (ply.output, ply.output));
    let images = |folder: &str| contents(&path(folder)).into_values().collect::<Vec<_>>();
    assert_eq!(images("b_textures"), images("a_textures"));
    assert_eq!(images("d_textures").len(), 4);
}

#[test]
fn a_job_with_ply_that_is_stopped_ends_with_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    copy_town(&path("in"));
    let town = path("in/town.obj");
    let options = in_many_clusters(ratio(0.1));
    pipeline::simplify(&town, &path("in/town.ply"), &in_many_clusters(ratio(0.9)), &Silent).unwrap();
    let run = |to: &str, progress: &dyn Progress| {
        fs::create_dir_all(path(to)).unwrap();
        pipeline::simplify(path("in/town.ply"), &path(to).join("town.ply"), &options, progress).map(drop)
    };
    run("whole", &Silent).unwrap();
    let mut stops = 0;
    while let Err(error) = run("parts", &StopAfter::units(20 + 5 * stops)) {
        assert!(matches!(error, Error::Stopped) && stops < 500, "{error}");
        assert!(!path("parts/town.ply").exists());
        stops += 1;
    }
    assert!(stops > 1);
    assert_eq!(contents(&path("parts")), contents(&path("whole")));
    let error = pipeline::simplify(&town, &path("parts/town.ply"), &options, &Silent).unwrap_err();
    assert!(error.to_string().contains("`force`"), "{error}");
}
