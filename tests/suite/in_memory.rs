//! What a mesh in memory is promised: the same as one in a file.

use std::path::Path;

use crate::meshes::{cases, ratio, rms_distance, simplify, simplify_text, terrain, torus, town};
use drystone::measure::{Surface, compare_checks, weld_and_check};
use drystone::options::{MetricChoice, Seams, Topology};
use drystone::{Error, Mesh, Progress, Result, Silent, SimplifyOptions, Target, simplify_mesh};
use glam::DVec3;
use proptest::prelude::*;

/// An OBJ as a program reads it with tobj.
fn load(path: &Path) -> Mesh {
    let options = tobj::LoadOptions { triangulate: true, ..tobj::LoadOptions::default() };
    Mesh::from(tobj::load_obj(path, &options).unwrap().0.as_slice())
}

/// OBJ text of a mesh, without labels.
fn text_of(mesh: &Mesh) -> String {
    let mut text = String::new();
    mesh.positions.iter().for_each(|[x, y, z]| text += &format!("v {x} {y} {z}\n"));
    mesh.texcoords.iter().for_each(|[u, v]| text += &format!("vt {u} {v}\n"));
    for (face, corners) in mesh.faces.iter().enumerate() {
        let ids = mesh.face_texcoords.get(face).copied().unwrap_or([Mesh::NO_TEXCOORD; 3]);
        let corner = |k: usize| match ids[k] {
            Mesh::NO_TEXCOORD => format!(" {}", corners[k] + 1),
            id => format!(" {}/{}", corners[k] + 1, id + 1),
        };
        text += &format!("f{}{}{}\n", corner(0), corner(1), corner(2));
    }
    text
}

fn folder_with(text: &str) -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.obj");
    std::fs::write(&path, text).unwrap();
    (folder, path)
}

#[test]
fn every_metric_reaches_its_target_and_tears_nothing() {
    let before = load(&town());
    let metrics = [None, Some(MetricChoice::Qem), Some(MetricChoice::Qem1997), Some(MetricChoice::Oblique)];
    let of_papers = [MetricChoice::Curvature, MetricChoice::Terrain, MetricChoice::Sharpness].map(Some);
    for metric in metrics.into_iter().chain(of_papers) {
        let options = SimplifyOptions { metric, ..ratio(0.3) };
        let (after, report) = simplify_mesh(&before, &options, &Silent).unwrap();
        after.check().unwrap();
        assert!(
            report.is_reached && report.output <= report.target && report.output + 2 >= report.target,
            "{report:?}"
        );
        let checks = [&before, &after].map(|mesh| weld_and_check(&Surface::from(mesh)).unwrap());
        let news = compare_checks(&checks[0], &checks[1]);
        assert!(news.is_empty(), "{metric:?}: {}", news.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "));
    }
}

#[test]
fn a_mesh_in_memory_ends_as_near_as_one_in_a_file() {
    for (sketch, share) in [(terrain(80), 0.1), (terrain(80), 0.01), (torus(120, 60), 0.05)] {
        let (_folder, path) = folder_with(&sketch.text());
        let run = simplify(&path, &ratio(share));
        let (after, report) = simplify_mesh(&load(&path), &ratio(share), &Silent).unwrap();
        assert_eq!(report.output, run.report.faces.output);
        let again = simplify_text(&text_of(&after), &ratio(1.0));
        let [in_file, in_memory] = [&run, &again].map(|run| rms_distance(&path, run));
        assert!(in_memory < 1.05 * in_file, "{in_memory} in memory, {in_file} in a file");
    }
}

#[test]
fn a_target_beside_a_bound_costs_no_faces() {
    let town = load(&town());
    let run = |target: Target| {
        let options = SimplifyOptions { target, ..ratio(1.0) };
        let (_, report) = simplify_mesh(&town, &options, &Silent).unwrap();
        assert!(report.is_reached);
        report.output as f64
    };
    let alone = run(Target::max_error(0.2));
    for share in [0.1, 0.9, 1.2, 2.0, 4.0] {
        let target = (alone * share) as u64;
        let both = run(Target::faces(target).within(0.2));
        assert!(both <= (target as f64).max(1.1 * alone), "{both} triangles of {target}, by the bound alone {alone}");
        assert!(both + 2.0 >= target as f64, "{both} triangles of {target}");
    }
}

#[test]
fn what_does_not_change_keeps_every_bit() {
    let before = load(&town());
    let (after, report) = simplify_mesh(&before, &ratio(1.0), &Silent).unwrap();
    assert_eq!(report.output, report.input);
    let corners = |mesh: &Mesh| {
        let corner = |face: usize, k: usize| {
            let texcoord = mesh.face_texcoords[face][k];
            let uv = mesh.texcoords.get(texcoord as usize).map(|uv| uv.map(f64::to_bits));
            (mesh.positions[mesh.faces[face][k] as usize].map(f64::to_bits), uv, mesh.face_labels[face])
        };
        let mut corners: Vec<_> = (0..mesh.faces.len()).map(|face| [0, 1, 2].map(|k| corner(face, k))).collect();
        corners.sort_unstable();
        corners
    };
    assert_eq!(corners(&before), corners(&after));
}

#[test]
fn negative_zero_is_no_seam_beside_zero() {
    let (_folder, path) = folder_with(&terrain(24).text());
    let mut plain = load(&path);
    plain.texcoords.iter_mut().for_each(|[u, _]| *u = 0.0);
    // Half of the faces have texture coordinates of their own.
    let (mut odd, count) = (plain.clone(), plain.texcoords.len());
    odd.texcoords.extend(plain.texcoords.iter().map(|[_, v]| [-0.0, *v]));
    let half = odd.faces.len() / 2;
    odd.face_texcoords[half..].iter_mut().flatten().for_each(|texcoord| *texcoord += count as u32);
    let [plain, odd] = [plain, odd].map(|mesh| simplify_mesh(&mesh, &ratio(0.2), &Silent).unwrap().0);
    assert_eq!((odd.positions, odd.faces), (plain.positions, plain.faces));
}

#[test]
fn colours_and_labels_stay_with_their_places() {
    let mut mesh = load(&folder_with(&terrain(40).text()).1);
    mesh.colours = mesh.positions.iter().map(|&[x, y, _]| [x as f32, y as f32, 0.5]).collect();
    let middle = |mesh: &Mesh, face: usize| mesh.faces[face].map(|v| mesh.positions[v as usize][0]).iter().sum::<f64>();
    let bounds =
        mesh.positions.iter().map(|p| p[0]).fold([f64::INFINITY, f64::NEG_INFINITY], |b, x| [b[0].min(x), b[1].max(x)]);
    let half = 1.5 * (bounds[0] + bounds[1]);
    mesh.face_labels = (0..mesh.faces.len()).map(|face| if middle(&mesh, face) < half { 3 } else { 9 }).collect();
    let options = SimplifyOptions { seams: Some(Seams::Lock), topology: Topology::Keep, ..ratio(0.2) };
    let (after, _) = simplify_mesh(&mesh, &options, &Silent).unwrap();
    assert_eq!(after.colours.len(), after.positions.len());
    assert!(after.face_labels.iter().all(|label| [3, 9].contains(label)));
    for face in 0..after.faces.len() {
        let is_left = after.face_labels[face] == 3;
        assert_eq!(is_left, middle(&after, face) < half, "face {face}");
    }
}

#[test]
fn colours_stay_where_handles_are_cut() {
    let mut mesh = load(&folder_with(&torus(60, 30).text()).1);
    mesh.colours = mesh.positions.iter().map(|&[x, y, z]| [x as f32, y as f32, z as f32]).collect();
    let (after, report) =
        simplify_mesh(&mesh, &SimplifyOptions { target: Target::faces(4), ..ratio(1.0) }, &Silent).unwrap();
    assert!(report.output <= 4 && after.colours.len() == after.positions.len(), "{report:?}");
}

#[test]
fn its_progress_counts_the_faces_of_each_pass() {
    #[derive(Default)]
    struct Sums([std::sync::atomic::AtomicU64; 2]);
    impl Progress for Sums {
        fn begin(&self, _: &'static str, total: u64, _: &'static str) {
            self.0[0].fetch_add(total, std::sync::atomic::Ordering::Relaxed);
        }
        fn advance(&self, units: u64) {
            self.0[1].fetch_add(units, std::sync::atomic::Ordering::Relaxed);
        }
    }
    let sums = Sums::default();
    simplify_mesh(&load(&town()), &ratio(0.1), &sums).unwrap();
    let [wanted, done] = sums.0.map(std::sync::atomic::AtomicU64::into_inner);
    assert!(wanted > 0 && done == wanted, "{done} of {wanted}");
}

#[test]
fn a_program_can_stop_it_and_hears_of_its_passes() {
    struct Stop;
    impl Progress for Stop {
        fn begin(&self, _: &'static str, _: u64, _: &'static str) {}
        fn advance(&self, _: u64) {}
        fn is_stopped(&self) -> bool {
            true
        }
    }
    let mesh = load(&town());
    assert!(matches!(simplify_mesh(&mesh, &ratio(0.5), &Stop), Err(Error::Stopped)));
}

#[test]
fn what_cannot_be_is_refused_and_nothing_is_something() -> Result<()> {
    let mesh = load(&town());
    for options in [SimplifyOptions::default(), ratio(0.0), SimplifyOptions { passes: 0, ..ratio(0.5) }] {
        assert!(simplify_mesh(&mesh, &options, &Silent).is_err());
    }
    let broken = Mesh { faces: vec![[0, 1, u32::MAX - 1]], ..Mesh::default() };
    assert!(simplify_mesh(&broken, &ratio(0.5), &Silent).is_err());
    let (empty, report) = simplify_mesh(&Mesh::default(), &ratio(0.5), &Silent)?;
    assert_eq!((empty.faces.len(), report.output), (0, 0));
    Ok(())
}

#[test]
fn models_of_tobj_come_and_go() {
    let before = load(&town());
    let models = before.to_tobj();
    assert!(models.len() > 1);
    let after = Mesh::from(models.as_slice());
    assert_eq!(after.faces.len(), before.faces.len());
    let area = |mesh: &Mesh| {
        let area = |face: &[u32; 3]| {
            let [a, b, c] = face.map(|v| DVec3::from_array(mesh.positions[v as usize]));
            0.5 * (b - a).cross(c - a).length()
        };
        mesh.faces.iter().map(area).sum::<f64>()
    };
    assert!((area(&after) - area(&before)).abs() < 1e-6 * area(&before));
    let labels = |mesh: &Mesh| {
        let mut labels = mesh.face_labels.clone();
        labels.sort_unstable();
        labels
    };
    assert_eq!(labels(&after), labels(&before));
}

proptest! {
    #![proptest_config(cases(16, 50))]

    #[test]
    fn any_target_is_met_or_said_to_be_missed(side in 3usize..40, power in -3.0..0.0f64, keep in any::<bool>()) {
        let mesh = load(&folder_with(&terrain(side).text()).1);
        let topology = if keep { Topology::Keep } else { Topology::Simplify };
        let options = SimplifyOptions { topology, ..ratio(10f64.powf(power)) };
        let (after, report) = simplify_mesh(&mesh, &options, &Silent).unwrap();
        after.check().unwrap();
        prop_assert_eq!(after.faces.len() as u64, report.output);
        prop_assert_eq!(report.is_reached, report.output <= report.target);
        prop_assert!(!report.is_reached || report.output + 2 >= report.target, "{:?}", report);
    }

    #[test]
    fn a_bound_holds(side in 5usize..40, bound in 0.001..1.0f64) {
        let (_folder, path) = folder_with(&terrain(side).text());
        let options = SimplifyOptions { target: Target::max_error(bound), ..ratio(1.0) };
        let (after, _) = simplify_mesh(&load(&path), &options, &Silent).unwrap();
        let again = simplify_text(&text_of(&after), &ratio(1.0));
        let far = crate::meshes::max_distance(&path, &again);
        prop_assert!(far <= bound * (1.0 + 1e-9), "{far} with a bound of {bound}");
    }
}
