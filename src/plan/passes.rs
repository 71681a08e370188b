//! Which passes a run will make, and how many clusters each will have.
//!
//! Cells halve the vertices again and again, so counts alone tell how many there will be, within the tenth by which
//! planes move to where few vertices lie.

use serde::Serialize;

use crate::partition::cells::expected_count;
use crate::stitch::schedule::pass_target;

/// A pass to come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct PassForecast {
    /// Clusters, about.
    pub clusters: u64,
    /// Faces before, about.
    pub faces_in: u64,
    /// Faces after, about.
    pub faces_out: u64,
    /// Whether it removes the last faces above the target, chosen by cost over all clusters.
    pub is_trim: bool,
}

/// Faces above the target that the last pass over several clusters leaves to the trim.
const TRIM_SHARE: f64 = 0.03;

/// Predicts the passes of a run; `passes` are those asked for.
pub fn forecast(input: u64, target: u64, passes: usize, cluster_faces: u64) -> Vec<PassForecast> {
    let mut found = Vec::new();
    let mut faces = input;
    for pass in 0..passes {
        let clusters = expected_count(faces, cluster_faces, pass);
        let is_last = pass + 1 == passes;
        let wanted = pass_target(input, target, pass, passes).round() as u64;
        let left = if is_last && clusters > 1 { (target as f64 * (1.0 + TRIM_SHARE)) as u64 } else { wanted };
        let faces_out = left.min(faces);
        found.push(PassForecast { clusters, faces_in: faces, faces_out, is_trim: false });
        faces = faces_out;
    }
    if faces > target {
        let clusters = expected_count(faces, cluster_faces, passes);
        found.push(PassForecast { clusters, faces_in: faces, faces_out: target, is_trim: true });
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_city_takes_three_passes_and_a_trim() {
        let passes = forecast(4_313_336, 431_334, 3, 250_000);
        // Measured: 23, 12, 5 and 2 clusters.
        assert_eq!(passes.iter().map(|pass| pass.clusters).collect::<Vec<_>>(), [24, 12, 6, 2]);
        assert!(passes[3].is_trim && passes[3].faces_out == 431_334);
    }

    #[test]
    fn a_small_mesh_is_one_cluster_and_needs_no_trim() {
        let passes = forecast(18_218, 1_822, 3, 250_000);
        assert_eq!(passes.iter().map(|pass| pass.clusters).collect::<Vec<_>>(), [1, 1, 1]);
        assert_eq!(passes[2].faces_out, 1_822);
    }
}
