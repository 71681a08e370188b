//! What is locked does not move, and what is closed stays closed.

use crate::meshes::{assert_sound, in_many_clusters, ratio, read, simplify, simplify_text, torus, town};
use drystone::options::{Borders, Seams, SimplifyOptions};

#[test]
fn locked_seams_keep_every_vertex_and_its_texcoords() {
    for many in [false, true] {
        let options = SimplifyOptions { seams: Some(Seams::Lock), ..ratio(0.6) };
        let run = simplify(&town(), &if many { in_many_clusters(options) } else { options });
        let (before, after) = (read(&town()).texcoords_by_position(), run.mesh().texcoords_by_position());
        assert!(after.len() < before.len());
        for (position, texcoords) in before.iter().filter(|(_, texcoords)| texcoords.len() > 1) {
            let now = after.get(position).unwrap_or_else(|| panic!("{:?} is gone", position.map(f64::from_bits)));
            for uv in texcoords {
                assert!(now.iter().any(|other| other.distance(*uv) < 1e-6), "{uv} is gone");
            }
        }
    }
}

#[test]
fn locked_borders_keep_every_edge() {
    let before = read(&town()).border_edges();
    assert!(before.len() > 100);
    for many in [false, true] {
        let options = SimplifyOptions { borders: Borders::Lock, ..ratio(0.2) };
        let run = simplify(&town(), &if many { in_many_clusters(options) } else { options });
        assert_eq!(run.mesh().border_edges(), before);
    }
}

#[test]
fn a_torus_in_many_clusters_stays_a_torus() {
    for share in [0.5, 0.1, 0.02] {
        let run = simplify_text(&torus(160, 64).text(), &in_many_clusters(ratio(share)));
        assert!(run.report.passes[0].clusters >= 16);
        let check = run.mesh().check();
        assert_eq!((check.boundary_edges, check.components, check.euler), (0, 1, 0));
        assert_eq!((check.non_manifold_edges, check.non_manifold_vertices), (0, 0));
        assert_eq!(run.report.faces.output, run.report.faces.target);
    }
}

#[test]
fn free_borders_lose_edges_but_gain_no_loops() {
    let run = simplify(&town(), &in_many_clusters(ratio(0.1)));
    assert!(run.mesh().border_edges().len() * 10 < read(&town()).border_edges().len() * 6);
    assert_sound(&read(&town()), &run);
}
