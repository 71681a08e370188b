//! The ways in which exporters write one and the same mesh: it comes out the same.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use crate::meshes::{
    Mesh, Sketch, bits, fixture, in_many_clusters, ratio, read, simplify, simplify_text, terrain, torus, town,
};
use drystone::base::ErrorKind;
use drystone::base::Silent;
use drystone::measure::compare_checks;
use drystone::options::{
    Doubles, JobOptions, Normals, Pieces, Seams, SimplifyOptions, TextureFiles, TexturesOutside, Topology,
};
use drystone::pipeline;
use drystone::read::InputChoice;
use drystone::report::Status;
use glam::DVec3;

/// Lines of the result that begin with a word.
fn lines(text: &str, word: &str) -> Vec<String> {
    text.lines().filter(|line| line.split_whitespace().next() == Some(word)).map(str::to_owned).collect()
}

fn geometry(text: &str) -> Vec<String> {
    ["v", "vt", "f"].iter().flat_map(|word| lines(text, word)).collect()
}

#[test]
fn relative_indices_and_odd_blanks_give_the_same_bytes() {
    let text = std::fs::read_to_string(town()).unwrap();
    let (mut odd, mut v, mut vt) = (String::from("\u{feff}"), 0, 0);
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => v += 1,
            Some("vt") => vt += 1,
            Some("f") => {
                let corners = words.map(|corner| {
                    let (a, b) = corner.split_once('/').unwrap();
                    format!("{}/{}", a.parse::<i64>().unwrap() - v - 1, b.parse::<i64>().unwrap() - vt - 1)
                });
                let _ = write!(odd, "f\t{} \\\r\n \r\n", corners.collect::<Vec<_>>().join("  "));
                continue;
            }
            _ => {}
        }
        let _ = write!(odd, "{line}\r\n");
    }
    let folder = tempfile::tempdir().unwrap();
    for entry in std::fs::read_dir(town().parent().unwrap()).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, folder.path().join(path.file_name().unwrap())).unwrap();
    }
    let input = folder.path().join("town.obj");
    std::fs::write(&input, odd).unwrap();
    let options = in_many_clusters(ratio(0.2));
    assert!(simplify(&input, &options).text() == simplify(&town(), &options).text());
}

#[test]
fn negative_zero_is_zero() {
    let side = 24;
    let mut plain = terrain(side);
    plain.texcoords.iter_mut().for_each(|texcoord| *texcoord -= 0.5);
    plain.positions.iter_mut().step_by(3).for_each(|position| position.z = 0.0);
    // The right half has texture coordinates of its own, so that both zeros meet in the middle.
    let mut doubled = plain.clone();
    doubled.texcoords.extend_from_slice(&plain.texcoords);
    let is_right = |face: usize| face / 2 % side >= side / 2;
    for (_, corners) in doubled.faces.iter_mut().enumerate().filter(|(face, _)| is_right(*face)) {
        corners.iter_mut().for_each(|(_, texcoord)| *texcoord += plain.texcoords.len());
    }
    let mut odd = String::new();
    for (number, line) in doubled.text().lines().enumerate() {
        let is_odd = number < plain.positions.len() || number >= plain.positions.len() + plain.texcoords.len();
        let line = if is_odd { line.replace(" 0.000000", " -0.000000") } else { line.to_owned() };
        let _ = writeln!(odd, "{line}");
    }
    assert!(odd.matches("-0.000000").count() > 200);
    for options in [ratio(0.2), in_many_clusters(ratio(0.2))] {
        assert!(simplify_text(&odd, &options).text() == simplify_text(&plain.text(), &options).text());
    }
}

/// The terrain cut along x = `side` / 2 into two files; each has its own copy of the vertices between them.
fn write_tiles(folder: &std::path::Path, side: usize) {
    let whole = terrain(side);
    for (name, is_left) in [("a.obj", true), ("sub/b.obj", false)] {
        let mut tile = Sketch { texcoords: whole.texcoords.clone(), ..Sketch::default() };
        let mut ids = vec![None; whole.positions.len()];
        for (i, face) in whole.faces.iter().enumerate() {
            if ((i / 2 % side) < side / 2) == is_left {
                tile.faces.push(face.map(|(v, t)| {
                    let id = *ids[v].get_or_insert_with(|| {
                        tile.positions.push(whole.positions[v]);
                        tile.positions.len() - 1
                    });
                    (id, t)
                }));
            }
        }
        let library = if is_left { "left" } else { "right" };
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, format!("mtllib tile.mtl\no tile\nusemtl ground\n{}", tile.text())).unwrap();
        std::fs::write(path.with_file_name("tile.mtl"), "newmtl ground\nmap_Kd ground.png\n").unwrap();
        std::fs::write(path.with_file_name("ground.png"), library).unwrap();
    }
}

#[test]
fn a_folder_of_tiles_is_joined_without_a_crack() {
    let folder = tempfile::tempdir().unwrap();
    write_tiles(folder.path(), 60);
    let whole = folder.path().join("whole.txt");
    std::fs::write(&whole, terrain(60).text()).unwrap();
    for many in [false, true] {
        let options = if many { in_many_clusters(ratio(0.1)) } else { ratio(0.1) };
        let run = simplify(folder.path(), &options);
        assert_eq!(run.report.faces.input, 7200);
        assert!(run.report.faces.output.abs_diff(720) <= 2);
        let check = run.mesh().check();
        assert_eq!((check.boundary_loops, check.components, check.euler), (1, 1, 1));
        let news = compare_checks(&read(&whole).check(), &check);
        assert!(news.is_empty(), "{news:?}");
    }
}

#[test]
fn materials_and_textures_of_one_name_in_two_tiles_do_not_collide() {
    let folder = tempfile::tempdir().unwrap();
    write_tiles(folder.path(), 20);
    let run = simplify(folder.path(), &ratio(0.5));
    let mesh = run.mesh();
    let pictures: BTreeSet<String> =
        mesh.textures.values().map(|name| std::fs::read_to_string(run.folder().join(name)).unwrap()).collect();
    assert_eq!(pictures, BTreeSet::from(["left".to_owned(), "right".to_owned()]));
    for (triangle, material) in mesh.triangles().zip(&mesh.surface.face_materials) {
        let middle = triangle.into_iter().sum::<DVec3>().x / 3.0;
        let other = mesh.triangles().zip(&mesh.surface.face_materials).find(|(_, m)| *m != material).unwrap().0;
        let there = other.into_iter().sum::<DVec3>().x / 3.0;
        assert_ne!(middle < 10.0, there < 10.0, "each half has its own material");
    }
}

#[test]
fn concave_polygons_keep_their_area() {
    let input = fixture("miniatures/ngons_concave.obj");
    let run = simplify(&input, &ratio(1.0));
    assert_eq!(run.report.faces.input, 36);
    // two ten-cornered stars and ten quads close a volume: its closedness and area tell folded triangles
    let mesh = run.mesh();
    let volume: f64 = mesh.triangles().map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum();
    let fans = read(&input);
    let fan_volume: f64 = fans.triangles().map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum();
    assert!((volume - fan_volume).abs() < 1e-9 * fan_volume.abs(), "{volume} {fan_volume}");
    assert!(mesh.area() <= fans.area() + 1e-9);
    assert_eq!(mesh.check().boundary_edges, 0);
}

#[test]
fn quads_count_as_two_triangles() {
    let sketch = terrain(40);
    let mut text = Sketch { faces: Vec::new(), ..sketch.clone() }.text();
    for pair in sketch.faces.chunks_exact(2) {
        let corners = [pair[0][0], pair[0][1], pair[0][2], pair[1][2]].map(|(v, t)| format!("{}/{}", v + 1, t + 1));
        let _ = writeln!(text, "f {}", corners.join(" "));
    }
    let run = simplify_text(&text, &ratio(0.25));
    assert_eq!((run.report.faces.input, run.report.faces.target), (3200, 800));
    assert!(run.report.faces.output.abs_diff(800) <= 2);
}

#[test]
fn colours_are_carried() {
    // The colour of a point on this sphere is half its position plus a half.
    for share in [1.0, 0.5] {
        let mesh = simplify(&fixture("miniatures/coloured_sphere.obj"), &ratio(share)).mesh();
        assert_eq!(mesh.colours.len(), mesh.surface.positions.len());
        for (colour, position) in mesh.colours.iter().zip(&mesh.surface.positions) {
            let expected = 0.5 + 0.5 * *position;
            assert!((*colour - expected).abs().max_element() < 0.25, "{colour} at {position}");
        }
    }
}

#[test]
fn normals_of_faces_do_not_change_the_geometry() {
    let sketch = terrain(50);
    let plain = sketch.text();
    let mut flat = String::new();
    let mut count = 0;
    for line in plain.lines() {
        if let Some(corners) = line.strip_prefix("f ") {
            let [a, b, c] = sketch.faces[count].map(|(v, _)| sketch.positions[v]);
            let n = (b - a).cross(c - a).normalize();
            count += 1;
            let _ = writeln!(flat, "vn {:.4} {:.4} {:.4}", n.x, n.y, n.z);
            let corners: Vec<String> = corners.split(' ').map(|corner| format!("{corner}/{count}")).collect();
            let _ = writeln!(flat, "f {}", corners.join(" "));
        } else {
            let _ = writeln!(flat, "{line}");
        }
    }
    let options = in_many_clusters(ratio(0.2));
    let without = simplify_text(&plain, &options);
    let with = simplify_text(&flat, &options);
    assert_eq!(without.mesh().faces_with_normals, 0);
    assert_eq!(with.mesh().faces_with_normals as u64, with.report.faces.output);
    let bare = |text: &str| {
        let strip =
            |line: String| line.split(' ').map(|c| c.rsplit_once('/').map_or(c, |(c, _)| c).to_owned()).collect();
        let corners: Vec<Vec<String>> = lines(text, "f").into_iter().map(strip).collect();
        (lines(text, "v"), lines(text, "vt"), corners)
    };
    let plain_faces: Vec<Vec<String>> =
        lines(&without.text(), "f").iter().map(|line| line.split(' ').map(str::to_owned).collect()).collect();
    let (v, vt, f) = bare(&with.text());
    assert!(v == lines(&without.text(), "v") && vt == lines(&without.text(), "vt"));
    assert!(f == plain_faces);
    let dropped = simplify_text(&flat, &SimplifyOptions { normals: Normals::Drop, ..options });
    assert!(geometry(&dropped.text()) == geometry(&without.text()));
}

#[test]
fn vertices_that_stay_keep_their_numbers() {
    let numbers = |mesh: &Mesh| mesh.surface.positions.iter().copied().map(bits).collect::<BTreeSet<_>>();
    let town_mesh = read(&town());
    let before = numbers(&town_mesh);
    let kept = simplify(&town(), &in_many_clusters(ratio(1.0))).mesh();
    assert!(numbers(&kept) == before);
    let seams = town_mesh.texcoords_by_position().values().filter(|texcoords| texcoords.len() > 1).count();
    let options = SimplifyOptions { seams: Some(Seams::Lock), ..in_many_clusters(ratio(0.6)) };
    let after = numbers(&simplify(&town(), &options).mesh());
    assert!(after.intersection(&before).count() >= seams);
    assert!(after.len() > after.intersection(&before).count());
}

#[test]
fn coordinates_of_every_length_come_back_as_they_were() {
    let text = "v 0.1 1e-7 -3\nv 123456.789012345 0 0\nv 0.30000000000000004 5000000.125 1\nf 1 2 3\n";
    let mesh = simplify_text(text, &ratio(1.0)).mesh();
    let expected = [
        DVec3::new(0.1, 1e-7, -3.0),
        DVec3::new(123_456.789_012_345, 0.0, 0.0),
        DVec3::new(0.300_000_000_000_000_04, 5_000_000.125, 1.0),
    ];
    assert_eq!(mesh.surface.positions.raw, expected);
}

/// A position in tenths of a millimetre.
fn rounded(p: DVec3) -> [i64; 3] {
    p.to_array().map(|x| (x * 1e4).round() as i64)
}

#[test]
fn an_offset_moves_the_result_and_nothing_else() {
    let offset = DVec3::new(432_100.0, 4_581_200.0, 30.0);
    for (sketch, options) in [(torus(90, 40), ratio(0.1)), (terrain(60), in_many_clusters(ratio(0.1)))] {
        let mut far = sketch.clone();
        far.positions.iter_mut().for_each(|p| *p += offset);
        let (near, far) = (simplify_text(&sketch.text(), &options).mesh(), simplify_text(&far.text(), &options).mesh());
        assert_eq!(near.face_count(), far.face_count());
        // The offset costs a nanometre, which may order two collapses of the same cost another way round.
        let here: BTreeSet<[i64; 3]> = near.surface.positions.iter().map(|p| rounded(*p)).collect();
        let same = far.surface.positions.iter().filter(|p| here.contains(&rounded(**p - offset))).count();
        println!("{same} of {} vertices are the same", here.len());
        assert!(same * 4 >= here.len() * 3, "{same} of {}", here.len());
    }
}

#[test]
fn textures_outside_of_the_folder_are_named_by_a_path_that_works_from_the_output() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().canonicalize().unwrap();
    for name in ["tiles", "tex", "out/deep"] {
        std::fs::create_dir_all(root.join(name)).unwrap();
    }
    std::fs::write(root.join("tex/roof.jpg"), "roof").unwrap();
    let absolute = format!("map_AO {}\n", root.join("tex/roof.jpg").display());
    std::fs::write(root.join("tiles/a.mtl"), format!("newmtl m\nmap_Kd ../tex/roof.jpg\n{absolute}")).unwrap();
    let obj = "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    std::fs::write(root.join("tiles/a.obj"), obj).unwrap();
    for textures in [TextureFiles::Copy, TextureFiles::Link, TextureFiles::Reference] {
        let options = SimplifyOptions { job: JobOptions { force: true, ..ratio(1.0).job }, textures, ..ratio(1.0) };
        let output = root.join("out/deep/a.obj");
        let report = pipeline::simplify(root.join("tiles/a.obj"), &output, &options, &Silent).unwrap();
        let mtl = std::fs::read_to_string(output.with_extension("mtl")).unwrap();
        let names: Vec<_> = mtl.lines().filter_map(|line| line.strip_prefix("map_")?.split_once(' ')).collect();
        assert_eq!(names.len(), 2, "{mtl}");
        for (_, name) in names {
            assert_eq!(std::fs::read(root.join("out/deep").join(name)).unwrap(), b"roof", "{name}");
        }
        let is_told = report.warnings.iter().any(|line| line.starts_with("refused texture"));
        assert_eq!(is_told, textures != TextureFiles::Reference);
    }
}

#[test]
fn textures_outside_of_the_folder_are_copied_where_the_user_allows_it() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().canonicalize().unwrap();
    for name in ["tiles/out_textures", "tex", "out"] {
        std::fs::create_dir_all(root.join(name)).unwrap();
    }
    std::fs::write(root.join("tex/roof.jpg"), "roof").unwrap();
    std::fs::write(root.join("tiles/roof.jpg"), "inside").unwrap();
    let absolute = root.join("tex/../tex/roof.jpg");
    let mtl = format!("newmtl m\nmap_Kd ../tex/roof.jpg\nmap_AO {}\nmap_Ks roof.jpg\n", absolute.display());
    std::fs::write(root.join("tiles/a.mtl"), mtl).unwrap();
    let obj = "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    std::fs::write(root.join("tiles/a.obj"), obj).unwrap();
    let options = SimplifyOptions { textures_outside: TexturesOutside::Copy, ..ratio(1.0) };
    let report = pipeline::simplify(root.join("tiles/a.obj"), &root.join("out/a.obj"), &options, &Silent).unwrap();
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    let mtl = std::fs::read_to_string(root.join("out/a.mtl")).unwrap();
    let names: Vec<_> = mtl.lines().filter_map(|line| line.strip_prefix("map_")).collect();
    assert_eq!(names, ["Kd a_textures/roof.jpg", "AO a_textures/roof.jpg", "Ks a_textures/roof_2.jpg"]);
    for (name, bytes) in [("roof.jpg", "roof"), ("roof_2.jpg", "inside")] {
        assert_eq!(std::fs::read_to_string(root.join("out/a_textures").join(name)).unwrap(), bytes);
    }
    // One that would land on a file of the input is refused, whatever is forced.
    std::fs::write(root.join("tiles/out_textures/roof.jpg"), "own").unwrap();
    let mtl = "newmtl m\nmap_Kd ../tex/roof.jpg\nmap_Ks out_textures/roof.jpg\n";
    std::fs::write(root.join("tiles/a.mtl"), mtl).unwrap();
    let options = SimplifyOptions { job: JobOptions { force: true, ..options.job.clone() }, ..options };
    let refused = pipeline::simplify(root.join("tiles/a.obj"), &root.join("tiles/out.obj"), &options, &Silent);
    assert_eq!(refused.unwrap_err().kind(), ErrorKind::Usage);
    assert_eq!(std::fs::read_to_string(root.join("tiles/out_textures/roof.jpg")).unwrap(), "own");
}

#[test]
fn an_input_of_which_nothing_is_left_is_an_error_and_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("a.obj");
    std::fs::write(&input, "v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n").unwrap();
    let dropping = SimplifyOptions { pieces: Pieces::Drop, ..ratio(0.5) };
    let runs = [ratio(0.5), ratio(1.0), in_many_clusters(ratio(0.5)), dropping];
    for (i, (options, advice)) in runs.into_iter().zip(["`weld: ", "`weld: ", "`weld: ", "`pieces: "]).enumerate() {
        let output = folder.path().join(format!("out-{i}.obj"));
        let error = pipeline::simplify(&input, &output, &options, &Silent).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Input, "{error}");
        assert!(error.to_string().contains("of 1 triangle none is left"), "{error}");
        assert!(error.to_string().contains(advice), "{error}");
        assert!(!output.exists() && !pipeline::work_folder(&output, &options).exists());
    }
}

/// Every face of a torus twice: as a copy, or as its own back side.
fn doubled_torus(is_copy: bool) -> Sketch {
    let mut sketch = torus(60, 30);
    let turned = |&[a, b, c]: &[(usize, usize); 3]| if is_copy { [b, c, a] } else { [a, c, b] };
    let doubles: Vec<_> = sketch.faces.iter().map(turned).collect();
    sketch.faces.extend(doubles);
    sketch
}

#[test]
fn doubled_faces_are_told_and_go_where_the_user_says_so() {
    for is_copy in [true, false] {
        let sketch = doubled_torus(is_copy);
        let faces = sketch.faces.len() as u64;
        let keep = || SimplifyOptions { topology: Topology::Keep, ..ratio(0.2) };
        for options in [keep(), in_many_clusters(keep())] {
            let kept = simplify_text(&sketch.text(), &options);
            assert_eq!(kept.report.status, Status::TargetMissed);
            assert!(kept.report.repairs["doubled_faces"] > faces / 4);
            assert!(kept.report.target_lines().iter().any(|line| line.contains("--doubles drop")));
            let dropped = simplify_text(&sketch.text(), &SimplifyOptions { doubles: Doubles::Drop, ..options });
            assert_eq!(dropped.report.repairs["dropped_doubles"], faces / 2);
            let output = dropped.report.faces.output;
            assert!(output <= faces / 5 && output + 2 >= faces / 5, "{output} of {}", faces / 5);
            assert_eq!(dropped.mesh().check().boundary_edges, 0);
        }
    }
}

#[test]
fn both_sides_of_a_square_are_cut_alike() {
    let front = [1, 2, 3, 4];
    for first in 0..4 {
        let mut back: Vec<i32> = front.into_iter().rev().collect();
        back.rotate_left(first);
        let [a, b, c, d] = back[..] else { panic!("four corners") };
        let text = format!("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\nf {a} {b} {c} {d}\n");
        let run = simplify_text(&text, &SimplifyOptions { doubles: Doubles::Drop, ..ratio(1.0) });
        assert_eq!(run.report.repairs["dropped_doubles"], 2);
        assert_eq!(run.mesh().face_count(), 2);
    }
}

#[test]
fn several_inputs_join_and_what_is_excluded_stays_out() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    std::fs::create_dir_all(root.join("tiles/backup")).unwrap();
    let [near, far] = [0.0, 500.0].map(|x| {
        let mut sketch = terrain(20);
        sketch.positions.iter_mut().for_each(|p| p.x += x);
        sketch.text()
    });
    let faces = terrain(20).faces.len() as u64;
    std::fs::write(root.join("tiles/a.obj"), &near).unwrap();
    std::fs::write(root.join("tiles/backup/a.obj"), &near).unwrap();
    std::fs::write(root.join("b.obj"), &far).unwrap();
    let run = |names: &[&str], exclude: &[&str]| {
        let paths = names.iter().map(|name| root.join(name)).collect();
        let exclude = exclude.iter().map(|&pattern| pattern.to_owned()).collect();
        let output = root.join(format!("out-{}-{}.obj", names.len(), names[0].len()));
        pipeline::simplify(InputChoice { paths, exclude }, &output, &ratio(1.0), &Silent).unwrap()
    };
    let doubled = run(&["tiles"], &[]);
    assert_eq!(doubled.faces.input, 2 * faces);
    assert!(doubled.warnings.iter().any(|line| line.contains("are the same") && line.contains("--exclude")));
    std::fs::remove_file(&doubled.output).unwrap();
    let single = run(&["tiles"], &["backup"]);
    assert_eq!((single.faces.input, single.warnings.len()), (faces, 0));
    // Neighbours are no doubles, and a file that is named twice is read once.
    let joined = run(&["b.obj", "tiles/a.obj", "tiles/../b.obj"], &[]);
    assert_eq!((joined.faces.input, joined.input_files, joined.warnings.len()), (2 * faces, 2, 0));
    let coarser = simplify(&root.join("tiles/a.obj"), &ratio(0.3));
    std::fs::copy(&coarser.output, root.join("tiles/backup/a.obj")).unwrap();
    let levels = run(&["tiles", "b.obj"], &[]);
    assert!(levels.warnings.iter().any(|line| line.contains("fill the same space")), "{:?}", levels.warnings);
}

#[test]
fn only_what_fills_the_same_space_is_warned_of() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("tiles");
    let part = |name: &str, shift: [f64; 3], scale: f64| {
        let mut sketch = terrain(12);
        sketch.positions.iter_mut().for_each(|p| *p = *p * scale + DVec3::from_array(shift));
        let path = root.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, sketch.text()).unwrap();
    };
    let warnings = || {
        let output = folder.path().join("out.obj");
        let options = SimplifyOptions { job: JobOptions { force: true, ..ratio(1.0).job }, ..ratio(1.0) };
        let warnings = pipeline::simplify(&root, &output, &options, &Silent).unwrap().warnings;
        warnings.into_iter().filter(|line| line.contains("same")).collect::<Vec<_>>()
    };
    // A small mesh within the box of a large one, which is that of the folder, too; and neighbours on each axis.
    part("a.obj", [0.0; 3], 1.0);
    part("within.obj", [5.0, 5.0, 0.0], 0.1);
    part("beside.obj", [12.5, 0.0, 0.0], 1.0);
    part("behind.obj", [0.0, 12.5, 0.0], 1.0);
    part("above.obj", [0.0, 0.0, 30.0], 1.0);
    assert_eq!(warnings(), [""; 0]);
    // Half of it is elsewhere on one axis.
    part("shifted.obj", [0.0, 0.0, 3.0], 1.0);
    assert_eq!(warnings(), [""; 0]);
    // A coarser level of the whole, cut elsewhere.
    for (name, shift) in [("lod/1.obj", [0.0; 3]), ("lod/2.obj", [0.01, 0.0, 0.0])] {
        part(name, shift, 1.001);
    }
    let found = warnings();
    assert!(found.iter().any(|line| line.contains("a.obj") && line.contains("lod/1.obj")), "{found:?}");
    assert!(found.iter().all(|line| line.contains("lod")), "{found:?}");
}

#[test]
fn folders_that_fill_the_same_space_are_warned_of_as_folders() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("tiles");
    for (name, first) in [("fine", 10.0), ("coarse", 14.0)] {
        std::fs::create_dir_all(root.join(name)).unwrap();
        for (file, range) in [("1.obj", [0.0, first]), ("2.obj", [first, 20.0])] {
            let [a, b] = range;
            let text = format!("v {a} 0 0\nv {b} 0 0\nv {b} 5 1\nv {a} 5 2\nf 1 2 3 4\n");
            std::fs::write(root.join(name).join(file), text).unwrap();
        }
    }
    let output = folder.path().join("out.obj");
    let warnings = pipeline::simplify(&root, &output, &ratio(1.0), &Silent).unwrap().warnings;
    let found: Vec<_> = warnings.iter().filter(|line| line.contains("fill the same space")).collect();
    assert!(found.len() == 1 && found[0].contains("coarse and ") && found[0].contains("fine fill"), "{warnings:?}");
}
