//! GLB out: a file that the format allows, with the surface, the materials and the images of the OBJ.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use glam::{DVec2, DVec3};
use proptest::prelude::*;

use crate::glb_reader::{Glb, GlbTriangle};
use crate::meshes::{self, Mesh, StopAfter, cases, contents, fixture, in_many_clusters, ratio, read, terrain, town};
use drystone::ErrorKind;
use drystone::base::{Error, Silent};
use drystone::options::{SimplifyOptions, TextureFiles, UpAxis};
use drystone::pipeline;
use drystone::report::Report;

fn write(input: &Path, folder: &Path, options: &SimplifyOptions) -> (Report, Glb) {
    let output = folder.join("out.glb");
    let report = pipeline::simplify(input, &output, options, &Silent).unwrap();
    (report, Glb::read(&output))
}

/// Corners of triangles, in an order that does not depend on that of the faces or of the corners: positions, and texture
/// coordinates where there are some.
fn sorted(triangles: impl Iterator<Item = ([DVec3; 3], Option<[DVec2; 3]>)>) -> Vec<[[f64; 5]; 3]> {
    let corners = |(positions, texcoords): ([DVec3; 3], Option<[DVec2; 3]>)| {
        let texcoords = texcoords.unwrap_or_default();
        let corner = |k: usize| {
            let ([x, y, z], [u, v]) = (positions[k].to_array(), texcoords[k].to_array());
            [x, y, z, u, v]
        };
        let by_order = |a: &[[f64; 5]; 3], b: &[[f64; 5]; 3]| a.partial_cmp(b).unwrap();
        let turns = [[0, 1, 2], [1, 2, 0], [2, 0, 1]].map(|turn| turn.map(corner));
        turns.into_iter().min_by(by_order).unwrap()
    };
    let mut all: Vec<_> = triangles.map(corners).collect();
    all.sort_by(|a, b| a.partial_cmp(b).unwrap());
    all
}

/// Asserts that a GLB has the triangles of an OBJ, rounded to floats.
fn assert_same(glb: &[GlbTriangle], obj: &Mesh) {
    let surface = &obj.surface;
    let from_obj =
        surface.faces.iter().zip(&surface.face_texcoords).enumerate().map(|(face, (vertices, texcoords))| {
            let uv = texcoords.map(|id| surface.texcoords.get(id).copied());
            let uv = uv[0].zip(uv[1]).zip(uv[2]).map(|((a, b), c)| [a, b, c]).filter(|_| obj.shows_image[face]);
            (vertices.map(|vertex| surface.positions[vertex]), uv)
        });
    let (low, high) = surface
        .positions
        .iter()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), &position| (low.min(position), high.max(position)));
    let rounding = 4.0 * f64::from(f32::EPSILON) * (high - low).max_element().max(1.0);
    let (found, expected) = (glb.iter().map(|triangle| (triangle.positions, triangle.texcoords)), from_obj);
    let (found, expected) = (found.collect::<Vec<_>>(), expected.collect::<Vec<_>>());
    assert_eq!(found.len(), expected.len());
    // Rounded first, so that both are sorted alike.
    let grid = |x: f64, origin: f64| ((x - origin) / (64.0 * rounding)).round();
    let rounded = |list: Vec<([DVec3; 3], Option<[DVec2; 3]>)>| {
        let place =
            |position: DVec3| DVec3::new(grid(position.x, low.x), grid(position.y, low.y), grid(position.z, low.z));
        let at = |uv: DVec2| DVec2::new((uv.x * 1e4).round(), (uv.y * 1e4).round());
        sorted(
            list.into_iter().map(move |(positions, texcoords)| (positions.map(place), texcoords.map(|uv| uv.map(at)))),
        )
    };
    let (found, expected) = (rounded(found), rounded(expected));
    let differs = found
        .iter()
        .zip(&expected)
        .filter(|(a, b)| a.iter().flatten().zip(b.iter().flatten()).any(|(a, b)| (a - b).abs() > 1.0));
    // Numbers beside a border of the grid may be sorted otherwise.
    assert!(differs.count() * 50 <= expected.len(), "{} triangles", expected.len());
}

#[test]
fn the_town_is_that_of_the_obj_with_its_images() {
    for options in [ratio(1.0), ratio(0.3), in_many_clusters(ratio(0.2))] {
        let folder = tempfile::tempdir().unwrap();
        let (report, glb) = write(&town(), folder.path(), &options);
        let run = meshes::simplify(&town(), &options);
        let triangles = glb.triangles();
        let obj = run.mesh();
        assert_same(&triangles, &obj);
        assert_eq!(triangles.len() as u64, report.faces.output);
        assert!(triangles.iter().all(|triangle| triangle.texcoords.is_some()));
        let images = glb.document["images"].as_array().unwrap();
        let names: Vec<&str> = images.iter().map(|image| image["name"].as_str().unwrap()).collect();
        assert_eq!(names.len(), obj.textures.len());
        for (number, name) in names.iter().enumerate() {
            let (bytes, kind) = glb.image(number);
            let ending = if kind == "image/png" { "png" } else { "jpg" };
            assert!(fs::read(town().with_file_name(format!("{name}.{ending}"))).unwrap() == bytes, "{name}");
        }
        // Nothing lies beside it, and nothing is lit: the images show what the camera saw.
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        assert_eq!(glb.document["extensionsUsed"][0], "KHR_materials_unlit");
        let of_material =
            |material: usize| triangles.iter().filter(|triangle| triangle.material == material).count() as u64;
        for (number, material) in glb.document["materials"].as_array().unwrap().iter().enumerate() {
            assert_eq!(of_material(number), obj.materials[material["name"].as_str().unwrap()]);
        }
    }
}

#[test]
fn what_points_up_points_along_y() {
    for (up, is_turned) in [(UpAxis::Z, true), (UpAxis::Y, false)] {
        let folder = tempfile::tempdir().unwrap();
        let (_, glb) = write(&town(), folder.path(), &SimplifyOptions { up, ..ratio(0.5) });
        let node = &glb.document["nodes"][0];
        assert_eq!(node["rotation"].is_array(), is_turned);
        assert_same(&glb.triangles(), &meshes::simplify(&town(), &ratio(0.5)).mesh());
        // The town lies far to the north.
        let north = &node["translation"][if is_turned { 2 } else { 1 }];
        assert!(north.as_f64().unwrap().abs() > 4e6, "{node}");
    }
}

#[test]
fn each_miniature_is_that_of_the_obj() {
    for entry in fs::read_dir("fixtures/miniatures").unwrap() {
        let input = entry.unwrap().path();
        if input.extension().is_none_or(|ending| ending != "obj") {
            continue;
        }
        let folder = tempfile::tempdir().unwrap();
        let (report, glb) = write(&input, folder.path(), &ratio(0.6));
        let obj = meshes::simplify(&input, &ratio(0.6)).mesh();
        let triangles = glb.triangles();
        assert_eq!(triangles.len() as u64, report.faces.output, "{}", input.display());
        assert_same(&triangles, &obj);
        assert_eq!(obj.faces_with_normals > 0, triangles.iter().all(|triangle| triangle.normals.is_some()));
        let normals = triangles.iter().filter_map(|triangle| triangle.normals).flatten();
        assert!(normals.into_iter().all(|normal| (normal.length() - 1.0).abs() < 1e-5));
    }
}

#[test]
fn many_triangles_of_a_piece_and_many_materials() {
    // More than a window of triangles, and than 16 bits number.
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("in.obj");
    fs::write(&input, terrain(280).text()).unwrap();
    let (_, glb) = write(&input, folder.path(), &ratio(1.0));
    let kinds: Vec<_> = glb.document["accessors"].as_array().unwrap().iter().map(|a| &a["componentType"]).collect();
    assert_eq!(*kinds.last().unwrap(), 5125);
    assert_same(&glb.triangles(), &read(&input));

    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("in.obj");
    let mut text = String::new();
    for i in 0..3000 {
        text += &format!("v {i} 0 0\nv {i}.9 0 0\nv {i} 1 0\nusemtl m{i}\nf -3 -2 -1\n");
    }
    fs::write(&input, text).unwrap();
    let (_, glb) = write(&input, folder.path(), &ratio(1.0));
    let triangles = glb.triangles();
    assert_eq!(glb.document["materials"].as_array().unwrap().len(), 3000);
    for triangle in &triangles {
        let name = format!("m{}", triangle.positions[0].x.floor());
        assert_eq!(glb.document["materials"][triangle.material]["name"], name.as_str());
    }
    assert_same(&triangles, &read(&input));
}

#[test]
fn colours_of_vertices_are_amounts_of_light() {
    let folder = tempfile::tempdir().unwrap();
    let (_, glb) = write(&fixture("miniatures/coloured_sphere.obj"), folder.path(), &ratio(0.5));
    let obj = meshes::simplify(&fixture("miniatures/coloured_sphere.obj"), &ratio(0.5)).mesh();
    let linear = |c: f64| if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) };
    let place = |position: DVec3| position.to_array().map(|x| (x * 1e5).round() as i64);
    let expected: BTreeMap<[i64; 3], DVec3> =
        obj.surface.positions.iter().zip(&obj.colours).map(|(&position, &colour)| (place(position), colour)).collect();
    let mut compared = 0;
    for triangle in glb.triangles() {
        for (position, colour) in triangle.positions.into_iter().zip(triangle.colours.unwrap()) {
            let Some(expected) = expected.get(&place(position)) else { continue };
            assert_eq!(colour[3], 1.0);
            assert!((0..3).all(|k| (colour[k] - linear(expected[k])).abs() < 1e-3), "{colour:?} {expected}");
            compared += 1;
        }
    }
    assert!(compared > 50, "{compared}");
}

#[test]
fn a_baked_town_has_its_new_images_inside() {
    let folder = tempfile::tempdir().unwrap();
    let options = SimplifyOptions { textures: TextureFiles::Bake, atlas: 512, ..ratio(0.2) };
    let (report, glb) = write(&town(), folder.path(), &options);
    let images = glb.document["images"].as_array().unwrap().len();
    assert_eq!(images as u64, report.bake.as_ref().unwrap().images);
    assert!((0..images).all(|image| glb.image(image).0.starts_with(b"\x89PNG")));
    let texcoords = glb.triangles().into_iter().flat_map(|triangle| triangle.texcoords.unwrap());
    assert!(texcoords.into_iter().all(|uv| uv.min_element() >= 0.0 && uv.max_element() <= 1.0));
    assert!(!report.repairs.contains_key("unwritten_statements"), "{:?}", report.repairs);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn placements_of_images_and_missing_and_foreign_ones() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::create_dir(path("in")).unwrap();
    fs::copy(fixture("miniatures/checker.png"), path("in/a.png")).unwrap();
    fs::copy(fixture("miniatures/checker.png"), path("secret.png")).unwrap();
    fs::write(path("in/b.tga"), b"no image").unwrap();
    // A bitmap of two pixels, red and blue.
    let header = [b"BM".to_vec(), [62u32, 0, 54, 40, 2, 1].map(u32::to_le_bytes).concat(), vec![1, 0, 24, 0]].concat();
    let pixels = [0, 0, 255, 255, 0, 0, 0, 0];
    fs::write(path("in/c.bmp"), [&header[..], &[0; 24], &pixels].concat()).unwrap();
    let library = "newmtl placed\nmap_Kd -s 2 3 -o 0.25 -0.5 a.png\nnewmtl lost\nKd 1 0 0\nmap_Kd nowhere.png\n\
                   newmtl out\nmap_Kd ../secret.png\nnewmtl other\nmap_Kd b.tga\nnewmtl bitmap\nmap_Kd c.bmp\n\
                   newmtl lost_too\nmap_Kd nowhere.png\nnewmtl bitmap_too\nmap_Kd ./c.bmp\n";
    fs::write(path("in/a.mtl"), library).unwrap();
    let mut text = "mtllib a.mtl\nvt 0.25 0.5\nvt 1 0\nvt 0 1\n".to_owned();
    for (i, name) in ["placed", "lost", "out", "other", "bitmap", "lost_too", "bitmap_too"].iter().enumerate() {
        text += &format!("v {i} 0 0\nv {i}.9 0 0\nv {i} 1 0\nusemtl {name}\nf -3/1 -2/2 -1/3\n");
    }
    text += "v 9 0 0\nv 9.5 0 0\nv 9 1 0\nusemtl placed\nf -3 -2 -1\n";
    fs::write(path("in/a.obj"), text).unwrap();
    let (report, glb) = write(&path("in/a.obj"), folder.path(), &ratio(1.0));
    let triangles = glb.triangles();
    let textured: Vec<_> = triangles.iter().filter_map(|triangle| triangle.texcoords).collect();
    assert_eq!((triangles.len(), textured.len(), glb.document["images"].as_array().unwrap().len()), (8, 3, 2));
    let (bitmap, kind) = glb.image(1);
    assert!(bitmap.starts_with(b"\x89PNG") && kind == "image/png");
    let image = image::load_from_memory(bitmap).unwrap().into_rgb8();
    assert_eq!(image.into_raw(), [255, 0, 0, 0, 0, 255]);
    let expected = [(0.25, 0.5), (1.0, 0.0), (0.0, 1.0)].map(|(u, v)| DVec2::new(2.0 * u + 0.25, 3.0 * v - 0.5));
    assert!(textured[0].iter().all(|uv| expected.iter().any(|other| uv.distance(*other) < 1e-6)), "{textured:?}");
    for kind in ["missing_texture", "refused_texture", "unwritten_images"] {
        assert_eq!(report.repairs.get(kind), Some(&1), "{kind}: {:?}", report.warnings);
    }
    let lost =
        glb.document["materials"].as_array().unwrap().iter().find(|material| material["name"] == "lost").unwrap();
    assert_eq!(lost["pbrMetallicRoughness"]["baseColorFactor"].to_string(), "[1.0,0.0,0.0,1]");
}

proptest! {
    #![proptest_config(cases(12, 20))]

    /// Far from the origin, large or small: floats suffice, since positions are relative to a place nearby.
    #[test]
    fn positions_keep_seven_digits_of_the_size(
        shift in prop::array::uniform3(-7e6..7e6f64),
        scale in prop::sample::select(vec![1e-6, 1.0, 1e5]),
        share in 0.1..1.0f64,
    ) {
        let mut sketch = terrain(24);
        let shift = DVec3::from_array(shift);
        sketch.positions.iter_mut().for_each(|position| *position = *position * scale + shift);
        let folder = tempfile::tempdir().unwrap();
        let input = folder.path().join("in.obj");
        fs::write(&input, sketch.text()).unwrap();
        let (_, glb) = write(&input, folder.path(), &ratio(share));
        let obj = meshes::simplify(&input, &ratio(share)).mesh();
        assert_same(&glb.triangles(), &obj);
    }
}

#[test]
fn the_bytes_depend_on_neither_threads_nor_memory_nor_kills() {
    let options = in_many_clusters(ratio(0.3));
    let bytes = |memory: u64, threads: usize| {
        let folder = tempfile::tempdir().unwrap();
        let limits = drystone::Limits { memory: Some(memory << 20), threads: Some(threads) };
        write(&town(), folder.path(), &SimplifyOptions { limits, ..options.clone() });
        fs::read(folder.path().join("out.glb")).unwrap()
    };
    let expected = bytes(256, 2);
    assert!(bytes(128, 1) == expected && bytes(1024, 4) == expected);
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out.glb");
    let mut units = 0;
    loop {
        match pipeline::simplify(town(), &output, &options, &StopAfter::units(units)) {
            Ok(_) => break,
            Err(Error::Stopped) => assert!(!output.exists()),
            Err(error) => panic!("{error}"),
        }
        units += 9000;
    }
    assert!(fs::read(&output).unwrap() == expected);
}

#[test]
fn what_cannot_be_is_refused_with_words() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("a.glb");
    for textures in [TextureFiles::Link, TextureFiles::Reference] {
        let options = SimplifyOptions { textures, ..ratio(0.5) };
        let error = pipeline::simplify(town(), &output, &options, &Silent).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Usage);
        assert!(error.to_string().contains("a GLB holds its images"), "{error}");
    }
    assert!(contents(folder.path()).is_empty());
    pipeline::simplify(town(), &output, &ratio(0.5), &Silent).unwrap();
    let error = pipeline::simplify(town(), &output, &ratio(0.4), &Silent).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Usage, "{error}");
    let error = pipeline::simplify(&output, &folder.path().join("b.obj"), &ratio(0.5), &Silent).unwrap_err();
    assert!(error.to_string().contains("a GLB is written, but not read"), "{error}");
    assert!(read(&town()).face_count() > 0);
}
