//! Sends meshes that no exporter writes through the whole pipeline, in cells far too small for them.

use std::fmt::Write as _;
use std::path::Path;

use crate::base::Silent;
use crate::options::{Limits, SimplifyOptions, Target, TextureFiles, Weld};
use crate::report::{Report, Status};

const FACES: usize = 40_000;

fn simplified(text: &str, change: impl Fn(&mut SimplifyOptions)) -> (Report, Vec<tobj::Model>) {
    let folder = tempfile::tempdir().unwrap();
    let (input, output) = (folder.path().join("a.obj"), folder.path().join("b.obj"));
    std::fs::write(&input, text).unwrap();
    let mut options = SimplifyOptions {
        target: Target::ratio(0.5),
        limits: Limits { memory: Some(128 << 20), ..Limits::default() },
        cluster_faces: 5000,
        textures: TextureFiles::Reference,
        ..SimplifyOptions::default()
    };
    change(&mut options);
    let report = super::super::simplify(&input, &output, &options, &Silent).unwrap();
    let models = read(&output);
    let read_faces: usize = models.iter().map(|model| model.mesh.indices.len() / 3).sum();
    assert_eq!(report.faces.output, read_faces as u64);
    (report, models)
}

fn read(path: &Path) -> Vec<tobj::Model> {
    tobj::load_obj(path, &tobj::LoadOptions::default()).unwrap().0
}

fn rim(text: &mut String) {
    for i in 0..FACES {
        let angle = std::f64::consts::TAU * i as f64 / FACES as f64;
        let _ = writeln!(text, "v {:.5} {:.5} {:.3}", 100.0 * angle.cos(), 100.0 * angle.sin(), (17.0 * angle).sin());
    }
}

#[test]
fn faces_at_one_edge_pass_through_unchanged_and_are_counted() {
    // 1 and 2 are the edge; every other vertex makes a face with it.
    let mut text = "v 0 0 -1\nv 0 0 1\n".to_owned();
    rim(&mut text);
    (0..FACES).for_each(|i| _ = writeln!(text, "f 1 2 {}", i + 3));
    let (report, models) = simplified(&text, |_| ());
    assert_eq!(report.status, Status::TargetMissed);
    assert_eq!(report.faces.output, FACES as u64);
    assert_eq!(report.repairs["passed_through_faces"], FACES as u64);
    assert_eq!(models.iter().map(|model| model.mesh.positions.len() / 3).sum::<usize>(), FACES + 2);
}

#[test]
fn polygons_and_textures_that_pass_through_keep_their_corners() {
    let mut text = "v 0 0 -1\nv 0 0 1\nvt 0.25 0.5\n".to_owned();
    rim(&mut text);
    for i in 0..FACES / 2 {
        let _ = writeln!(text, "vt {} 1", i + 2);
        let _ = writeln!(text, "f 1/1 2/-1 {0}/-1 {1}/-1", 2 * i + 3, 2 * i + 4);
    }
    let (report, models) = simplified(&text, |_| ());
    assert!(report.repairs["passed_through_faces"] > FACES as u64 / 3);
    assert_eq!(report.faces.output, FACES as u64);
    let texcoords: usize = models.iter().map(|model| model.mesh.texcoords.len() / 2).sum();
    assert!(texcoords > FACES / 2);
}

#[test]
fn a_fan_around_one_vertex_is_simplified_at_its_rim() {
    let mut text = "v 0 0 10\n".to_owned();
    rim(&mut text);
    (0..FACES).for_each(|i| _ = writeln!(text, "f 1 {} {}", i + 2, (i + 1) % FACES + 2));
    let (report, _) = simplified(&text, |_| ());
    assert_eq!(report.status, Status::Done);
    assert!(report.faces.output.abs_diff(report.faces.target) <= 20, "{:?}", report.faces);
}

#[test]
fn ten_thousand_texture_coordinates_at_one_vertex_take_no_time() {
    let mut text = "v 0 0 10\n".to_owned();
    rim(&mut text);
    for i in 0..FACES {
        let u = i as f64 / FACES as f64;
        let _ = writeln!(text, "vt {u:.7} 0\nvt {u:.7} 1\nvt {:.7} 1", u + 0.4 / FACES as f64);
        let _ = writeln!(text, "f 1/-3 {}/-2 {}/-1", i + 2, (i + 1) % FACES + 2);
    }
    let begin = std::time::Instant::now();
    let (report, _) = simplified(&text, |options| options.cluster_faces = 50_000);
    assert!(report.faces.output > 0);
    assert!(begin.elapsed().as_secs() < 60);
}

#[test]
fn vertices_at_one_place_are_kept_apart_if_asked_for() {
    let mut text = "v 1 2 3\n".repeat(FACES + 2);
    (0..FACES).for_each(|i| _ = writeln!(text, "f {} {} {}", i + 1, i + 2, i + 3));
    text.push_str("v 5 5 5\nv 6 5 5\nv 5 6 5\nf -3 -2 -1\n");
    let (welded, _) = simplified(&text, |_| ());
    assert_eq!((welded.faces.output, welded.repairs["degenerate_faces"]), (1, FACES as u64));
    let (apart, _) = simplified(&text, |options| options.weld = Weld::Off);
    assert!(!apart.repairs.contains_key("degenerate_faces"));
}

#[test]
fn a_shuffled_file_gives_the_bytes_of_its_clusters_read_in_stretches() {
    // A bumpy grid with a texture coordinate for each vertex, once in order, once with the vt lines shuffled.
    let side = 150;
    let vertex = |i: usize, j: usize| j * side + i + 1;
    let count = side * side;
    let step = 7919;
    let mut texts = [String::new(), String::new()];
    for (text, is_shuffled) in texts.iter_mut().zip([false, true]) {
        for j in 0..side {
            for i in 0..side {
                let _ = writeln!(text, "v {i} {j} {}", (i * j) % 7);
            }
        }
        for k in 0..count {
            let k = if is_shuffled { k * step % count } else { k };
            let _ = writeln!(text, "vt {:.4} {:.4}", (k % side) as f64 / 150.0, (k / side) as f64 / 150.0);
        }
        let mut texcoord = vec![0; count + 1];
        for k in 0..count {
            texcoord[if is_shuffled { k * step % count } else { k } + 1] = k + 1;
        }
        for j in 0..side - 1 {
            for i in 0..side - 1 {
                let [a, b, c, d] = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| vertex(i, j));
                for [p, q, r] in [[a, b, c], [a, c, d]] {
                    let _ = writeln!(text, "f {p}/{} {q}/{} {r}/{}", texcoord[p], texcoord[q], texcoord[r]);
                }
            }
        }
    }
    let [plain, shuffled] = texts.map(|text| simplified(&text, |_| ()));
    assert_eq!(plain.0.faces.output, shuffled.0.faces.output);
    for (a, b) in plain.1.iter().zip(&shuffled.1) {
        assert_eq!(a.mesh.positions, b.mesh.positions);
        assert_eq!(a.mesh.texcoords, b.mesh.texcoords);
    }
}
