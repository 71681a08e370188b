//! The same bytes whatever the machine has: threads and memory leave no trace in the result.

use crate::meshes::{in_many_clusters, ratio, simplify, town};
use drystone::cost::parameter::Parameter;
use drystone::cost::{classic, curvature, oblique, sharpness, terrain, weights};
use drystone::options::{Limits, MetricChoice, Seams, SimplifyOptions};

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
            let options = SimplifyOptions {
                limits: Limits { threads: Some(threads), memory: Some(mebibytes << 20) },
                ..options.clone()
            };
            assert!(files(&options) == expected, "{threads} threads, {mebibytes} MiB");
        }
    }
}

#[test]
fn every_way_of_treating_seams_gives_the_same_bytes_again() {
    for seams in [Seams::Stitch, Seams::Follow, Seams::Lock] {
        let options = in_many_clusters(SimplifyOptions { seams: Some(seams), ..ratio(0.3) });
        let four = SimplifyOptions { limits: Limits { threads: Some(4), memory: Some(128 << 20) }, ..options.clone() };
        assert!(files(&options) == files(&four), "{seams:?}");
    }
}

const METRICS: [MetricChoice; 7] = [
    MetricChoice::Qem,
    MetricChoice::QemAttributes,
    MetricChoice::Qem1997,
    MetricChoice::Oblique,
    MetricChoice::Curvature,
    MetricChoice::Terrain,
    MetricChoice::Sharpness,
];

#[test]
fn every_metric_gives_the_same_bytes_at_any_number_of_threads_and_in_128_mib() {
    for metric in METRICS {
        let options = in_many_clusters(SimplifyOptions { metric: Some(metric), optimize: true, ..ratio(0.5) });
        let expected = files(&options);
        for (threads, mebibytes) in [(1, 128), (4, 1024)] {
            let options = SimplifyOptions {
                limits: Limits { threads: Some(threads), memory: Some(mebibytes << 20) },
                ..options.clone()
            };
            assert!(files(&options) == expected, "{metric:?}, {threads} threads, {mebibytes} MiB");
        }
    }
}

/// Each setting of a metric by itself, at another value than its default.
fn other_settings(metric: MetricChoice, parameters: &[Parameter]) -> Vec<(MetricChoice, String)> {
    let other = |parameter: &Parameter| match parameter.words {
        [_, word, ..] => (*word).to_owned(),
        _ if parameter.range == [0.0, 1.0] => (1.0 - parameter.default).to_string(),
        _ => {
            let other = 0.5 * parameter.default + 0.25;
            assert!(other != parameter.default, "{}", parameter.name);
            other.to_string()
        }
    };
    parameters.iter().map(|parameter| (metric, format!("{}={}", parameter.name, other(parameter)))).collect()
}

#[test]
fn every_setting_of_a_metric_gives_the_same_bytes_at_any_number_of_threads() {
    let settings = [
        other_settings(MetricChoice::Qem, &weights::PARAMETERS),
        other_settings(MetricChoice::QemAttributes, &weights::PARAMETERS),
        other_settings(MetricChoice::Qem1997, &classic::PARAMETERS),
        other_settings(MetricChoice::Oblique, &oblique::PARAMETERS),
        other_settings(MetricChoice::Curvature, &curvature::PARAMETERS),
        other_settings(MetricChoice::Terrain, &terrain::PARAMETERS),
        other_settings(MetricChoice::Sharpness, &sharpness::PARAMETERS),
    ];
    for (metric, setting) in settings.concat() {
        let options = SimplifyOptions { metric: Some(metric), metric_option: vec![setting.clone()], ..ratio(0.5) };
        let options = in_many_clusters(options);
        let four = SimplifyOptions { limits: Limits { threads: Some(4), memory: Some(128 << 20) }, ..options.clone() };
        let (files, again) = (files(&options), files(&four));
        assert!(files == again, "{metric:?} {setting}");
    }
}

#[test]
fn one_edge_at_a_time_gives_the_same_bytes_at_any_number_of_threads() {
    for metric in [None, Some(MetricChoice::Oblique)] {
        let options = in_many_clusters(SimplifyOptions { metric, one_by_one: true, ..ratio(0.3) });
        let four = SimplifyOptions { limits: Limits { threads: Some(4), memory: Some(1 << 30) }, ..options.clone() };
        let rounds = SimplifyOptions { one_by_one: false, ..options.clone() };
        assert!(files(&options) == files(&four), "{metric:?}");
        assert!(files(&options) != files(&rounds), "{metric:?}: the order of a heap is another one");
    }
}
