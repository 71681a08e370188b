//! Predicts the passes of a run, and the clusters of each.
//!
//! Cells halve the vertices again and again, so the number of clusters follows from counts alone, except where planes
//! move to where few vertices lie.

use serde::Serialize;

use super::memory::Sizes;
use crate::partition::cells::expected_count;
use crate::passes::CELL_PASSES;
use crate::passes::shares::{TRIM_SHARE, TRIM_SHARE_MAX, pass_target};

/// Forecast of a pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct PassForecast {
    /// Approximate number of clusters.
    pub clusters: u64,
    /// Approximate number of faces before.
    pub faces_in: u64,
    /// Approximate number of faces after.
    pub faces_out: u64,
    /// Whether it removes the last faces above the target.
    pub is_trim: bool,
    /// Whether it remeshes.
    pub is_remesh: bool,
    /// Whether faces have texture coordinates.
    #[serde(skip)]
    pub is_textured: bool,
    /// Whether it is the first that keeps within a bound.
    #[serde(skip)]
    pub leads_bound: bool,
}

/// Faces after remeshing for each face before; measured on photogrammetry.
const REMESH_FACES: f64 = 1.1;

/// Predicts the passes of a run; `passes` is the number asked for.
pub fn forecast(sizes: &Sizes, passes: usize) -> Vec<PassForecast> {
    let &Sizes { faces: input, target, cluster_faces, is_textured, is_bounded, .. } = sizes;
    let mut found = Vec::new();
    let mut faces = input;
    if let Some(remesh) = sizes.remesh {
        let clusters = expected_count(faces, cluster_faces, 0);
        let has_cells = remesh.cells.is_some();
        let faces_out = if has_cells { target } else { (input as f64 * REMESH_FACES) as u64 };
        let count = if has_cells && clusters > 1 { CELL_PASSES } else { 1 };
        for _ in 0..count {
            found.push(PassForecast {
                clusters,
                faces_in: faces,
                faces_out,
                is_trim: false,
                is_remesh: true,
                is_textured,
                leads_bound: false,
            });
            faces = faces_out;
        }
        if has_cells {
            return found;
        }
    }
    let lead = found.len();
    for pass in 0..passes {
        let clusters = expected_count(faces, cluster_faces, lead + pass);
        let is_last = pass + 1 == passes;
        if is_last && clusters > 1 && faces as f64 <= target as f64 * (1.0 + TRIM_SHARE_MAX) {
            break;
        }
        let wanted = pass_target(input, target, pass, passes).round() as u64;
        let left = if is_last && clusters > 1 { (target as f64 * (1.0 + TRIM_SHARE)) as u64 } else { wanted };
        let faces_out = left.min(faces);
        found.push(PassForecast {
            clusters,
            faces_in: faces,
            faces_out,
            is_trim: false,
            is_remesh: false,
            is_textured,
            leads_bound: is_bounded && pass == 0,
        });
        faces = faces_out;
    }
    if faces > target {
        let clusters = expected_count(faces, cluster_faces, found.len());
        found.push(PassForecast {
            clusters,
            faces_in: faces,
            faces_out: target,
            is_trim: true,
            is_remesh: false,
            is_textured,
            leads_bound: false,
        });
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::remesh::cvd::CvdSettings;

    fn sizes(faces: u64, target: u64) -> Sizes {
        let vertices = faces / 2;
        let cluster_faces = 50_000;
        Sizes {
            faces,
            vertices,
            target,
            cluster_faces,
            remesh: None,
            is_textured: true,
            is_bounded: false,
            metric_face_bytes: 0,
        }
    }

    #[test]
    fn a_remeshed_mesh_takes_a_pass_more_and_a_target_in_cells_nothing_else() {
        let remeshed = |text: &str| Sizes { remesh: text.parse().ok(), ..sizes(4_313_336, 431_334) };
        let passes = forecast(&remeshed("cvd"), 3);
        assert!(passes.len() == 5 && passes[0].is_remesh && !passes[1].is_remesh);
        assert!(forecast(&remeshed("cvd:cells=5000"), 3).iter().all(|pass| pass.is_remesh));
        assert_eq!("cvd".parse(), Ok(CvdSettings::default()));
    }

    #[test]
    fn a_city_takes_three_passes_and_a_trim() {
        let passes = forecast(&sizes(4_313_336, 431_334), 3);
        for (pass, measured) in passes.iter().zip([122, 58, 26, 14]) {
            assert!(pass.clusters.abs_diff(measured) * 6 <= measured, "{pass:?}");
        }
        assert!(passes[3].is_trim && passes[3].faces_out == 431_334);
    }

    #[test]
    fn a_small_mesh_is_one_cluster_and_needs_no_trim() {
        let passes = forecast(&sizes(18_218, 1_822), 3);
        assert_eq!(passes.iter().map(|pass| pass.clusters).collect::<Vec<_>>(), [1, 1, 1]);
        assert_eq!(passes[2].faces_out, 1_822);
    }
}
