//! The same bytes whatever the machine has: threads and memory leave no trace in the result.

mod meshes;

use drystone::options::{Metric, Seams, SimplifyOptions};
use meshes::{in_many_clusters, ratio, simplify, town};

fn files(options: &SimplifyOptions) -> Vec<Vec<u8>> {
    let run = simplify(&town(), options);
    ["out.obj", "out.mtl"].map(|name| std::fs::read(run.folder().join(name)).unwrap()).into()
}

#[test]
fn threads_and_memory_leave_no_trace_in_the_result() {
    let options = in_many_clusters(ratio(0.1));
    let expected = files(&options);
    for threads in [1, 2, 4] {
        for mebibytes in [128, 256, 1024] {
            let options = SimplifyOptions { threads: Some(threads), memory: Some(mebibytes << 20), ..options.clone() };
            assert!(files(&options) == expected, "{threads} threads, {mebibytes} MiB");
        }
    }
}

#[test]
fn every_way_of_treating_seams_gives_the_same_bytes_again() {
    for seams in [Seams::Stitch, Seams::Follow, Seams::Lock] {
        let options = in_many_clusters(SimplifyOptions { seams: Some(seams), ..ratio(0.3) });
        let four = SimplifyOptions { threads: Some(4), memory: Some(128 << 20), ..options.clone() };
        assert!(files(&options) == files(&four), "{seams:?}");
    }
}

#[test]
fn every_metric_gives_the_same_bytes_at_any_number_of_threads() {
    for metric in [Metric::Qem1997, Metric::Oblique, Metric::Curvature, Metric::Terrain, Metric::Sharpness] {
        let options = in_many_clusters(SimplifyOptions { metric: Some(metric), optimize: true, ..ratio(0.5) });
        let four = SimplifyOptions { threads: Some(4), memory: Some(1 << 30), ..options.clone() };
        assert!(files(&options) == files(&four), "{metric:?}");
    }
}
