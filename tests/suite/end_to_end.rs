//! Whole runs over the fixtures, through the library: what was asked for comes out, sound, and nothing is lost.

use crate::meshes::{assert_sound, fixture, in_many_clusters, ratio, read, simplify, town};
use drystone::options::{SimplifyOptions, Target};
use drystone::report::Status;

const MINIATURES: [&str; 12] = [
    "bow_tie",
    "closed_sphere",
    "coloured_sphere",
    "cube_24_vertices",
    "negative_indices",
    "ngons_concave",
    "non_manifold_fin",
    "normals_box",
    "open_border_disk",
    "seam_strip",
    "three_chart_corner",
    "two_materials_plane",
];

#[test]
fn town_comes_out_sound_in_one_cluster() {
    let input = read(&town());
    for share in [0.5, 0.1, 0.05] {
        let run = simplify(&town(), &ratio(share));
        assert_eq!(run.report.faces.input, 18_218);
        assert_eq!(run.report.status, Status::Done);
        assert_sound(&input, &run);
    }
}

#[test]
fn town_comes_out_sound_in_many_clusters() {
    let input = read(&town());
    for share in [0.5, 0.1, 0.05] {
        let run = simplify(&town(), &in_many_clusters(ratio(share)));
        assert!(run.report.passes[0].clusters >= 16);
        assert_eq!(run.report.status, Status::Done);
        assert_sound(&input, &run);
    }
}

#[test]
fn a_number_of_faces_is_met() {
    let run = simplify(&town(), &SimplifyOptions { target: Target::faces(3000), ..ratio(1.0) });
    assert_eq!(run.report.faces.target, 3000);
    assert_sound(&read(&town()), &run);
}

#[test]
fn all_textures_are_there_to_be_found() {
    let run = simplify(&town(), &ratio(0.1));
    let textures = run.mesh().textures;
    assert_eq!(textures.len(), 4);
    for name in textures.values() {
        let original = std::path::Path::new(name).file_name().unwrap();
        let expected = std::fs::read(town().with_file_name(original)).unwrap();
        assert_eq!(std::fs::read(run.folder().join(name)).unwrap(), expected, "{name}");
    }
}

#[test]
fn miniatures_come_out_sound() {
    for name in MINIATURES {
        let input = fixture(&format!("miniatures/{name}.obj"));
        for share in [0.5, 0.1] {
            println!("{name} at {share}");
            assert_sound(&read(&input), &simplify(&input, &ratio(share)));
        }
    }
}

#[test]
fn everything_is_kept_at_ratio_one() {
    let run = simplify(&town(), &ratio(1.0));
    assert_eq!(run.report.faces.output, 18_218);
    assert_sound(&read(&town()), &run);
}

#[test]
fn no_passes_but_one_are_enough() {
    let run = simplify(&town(), &in_many_clusters(SimplifyOptions { passes: 1, ..ratio(0.1) }));
    assert_sound(&read(&town()), &run);
}
