//! Predicts the time of a run, from measured rates.
//!
//! Rates are for one core of a 2.x GHz server processor, measured on one thread on 2026-11-28 with a synthetic city of
//! 4.3 million triangles at 90, 10 and 2 %, with and without texture coordinates. Photogrammetry with many small charts
//! may take twice as long; so may another machine, or half as long.

use serde::Serialize;

use super::passes::PassForecast;
use crate::passes::sample::{Purpose, sample_faces};

/// Bytes of OBJ text scanned in a second by one core.
const SCAN_BYTES_PER_SECOND: f64 = 300e6;
/// More seconds of one core for each file, however short: opened, mapped, its materials found, noted in the manifest.
const SCAN_SECONDS_PER_FILE: f64 = 0.5e-3;
/// Faces partitioned into clusters in a second by one core.
const PARTITION_FACES_PER_SECOND: f64 = 3.5e6;
/// Of faces without texture coordinates.
const BARE: FaceSeconds = FaceSeconds { held: 0.9e-6, removed_first: 1.7e-6, removed_later: 2.7e-6 };
/// Of faces with texture coordinates.
const TEXTURED: FaceSeconds = FaceSeconds { held: 1.1e-6, removed_first: 2.0e-6, removed_later: 4.5e-6 };
/// More seconds of one core for a face that must keep within a bound, in the first pass: the median of eleven runs on seven
/// meshes on 2026-11-30, 18 to 49 µs with all else.
const BOUND_SECONDS: f64 = 26e-6;
/// Faces of the pass that remeshes, its two looks at the mesh included, in a second by one core.
const REMESH_FACES_PER_SECOND: f64 = 120e3;
/// Faces written in a second by one core.
const WRITE_FACES_PER_SECOND: f64 = 2.4e6;
/// Faces written in a second, however many cores format them: one thread puts their text into the file.
const WRITE_FACES_PER_SECOND_MAX: f64 = 7.8e6;
/// Seconds that a partition waits for the disk.
const CUT_SECONDS: f64 = 0.05;
/// Seconds that the result waits for the disk.
const WRITE_SECONDS: f64 = 0.04;
/// Useful share of each further thread's time: clusters end at different times, and some steps run in order.
const THREAD_SHARE: f64 = 0.85;

/// The mesh files of an input.
#[derive(Debug, Clone, Copy)]
pub struct InputSize {
    /// How many there are.
    pub files: u64,
    /// Their length together.
    pub bytes: u64,
}

/// Seconds of one core for a face of a pass.
#[derive(Debug, Clone, Copy)]
struct FaceSeconds {
    /// Loaded, with the costs of its edges, and stored.
    held: f64,
    /// Removed in the first pass, with seams locked.
    removed_first: f64,
    /// Removed in a later one, where faces are large beside the detail.
    removed_later: f64,
}

/// Predicted time by phase, in seconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TimeForecast {
    /// Of the whole run.
    pub total: f64,
    /// Reading the input.
    pub scan: f64,
    /// Partitioning, in all passes.
    pub partition: f64,
    /// Simplifying, in all passes.
    pub simplify: f64,
    /// Baking textures.
    pub bake: f64,
    /// Writing the result.
    pub write: f64,
}

impl TimeForecast {
    /// The same with a bake that takes `core_seconds` of processor time.
    pub fn with_bake(self, core_seconds: f64, threads: usize) -> Self {
        let bake = core_seconds / speed_up(threads, u64::MAX);
        Self { bake, total: self.total + bake, ..self }
    }
}

/// How many times faster `threads` threads are than one, with `items` items to work on.
pub(super) fn speed_up(threads: usize, items: u64) -> f64 {
    1.0 + (threads as u64).min(items).saturating_sub(1) as f64 * THREAD_SHARE
}

/// Seconds in which the clusters of all passes are simplified by `machines` machines, each on `threads` threads.
pub(super) fn cluster_seconds(passes: &[PassForecast], threads: usize, machines: u32) -> f64 {
    let of_pass = |(number, pass): (usize, &PassForecast)| {
        let machines = u64::from(machines).clamp(1, pass.clusters.max(1));
        let of_each = pass.clusters.div_ceil(machines);
        core_seconds(passes, number) / speed_up(threads, of_each) / machines as f64
    };
    passes.iter().enumerate().map(of_pass).sum()
}

/// Seconds in which one core simplifies the clusters of a pass.
fn core_seconds(passes: &[PassForecast], number: usize) -> f64 {
    let pass = &passes[number];
    let (faces, seconds) = (pass.faces_in as f64, pass.face_seconds());
    if pass.is_remesh {
        return faces / REMESH_FACES_PER_SECOND;
    }
    let removed = if is_first(passes, number) { seconds.removed_first } else { seconds.removed_later };
    let bound = if pass.leads_bound { BOUND_SECONDS } else { 0.0 };
    faces * (seconds.held + bound) + pass.faces_in.saturating_sub(pass.faces_out) as f64 * removed
}

impl PassForecast {
    fn face_seconds(&self) -> FaceSeconds {
        if self.is_textured { TEXTURED } else { BARE }
    }
}

/// Whether a pass is the first that collapses edges, or remeshes.
fn is_first(passes: &[PassForecast], number: usize) -> bool {
    number == 0 || passes[number - 1].is_remesh
}

/// Predicts the time of a run on `threads` threads, each with a core of its own.
pub fn forecast(input: InputSize, passes: &[PassForecast], target: u64, threads: usize) -> TimeForecast {
    let speed_up = |items: u64| speed_up(threads, items);
    let scan = input.bytes as f64 / SCAN_BYTES_PER_SECOND + input.files as f64 * SCAN_SECONDS_PER_FILE;
    let scan = scan / speed_up(u64::MAX);
    let (mut partition, mut simplify) = (0.0, cluster_seconds(passes, threads, 1));
    for (number, pass) in passes.iter().enumerate() {
        let faces = pass.faces_in as f64;
        partition += CUT_SECONDS + faces / PARTITION_FACES_PER_SECOND / speed_up(u64::MAX);
        if pass.clusters > 1 && !pass.is_remesh {
            // The sample is simplified on one thread, while the others wait or partition; half of it before the first
            // pass.
            let share = if is_first(passes, number) { 0.5 } else { 1.0 };
            let is_last = passes.get(number + 1).is_none_or(|next| next.is_trim);
            let seconds = pass.face_seconds();
            let purpose = Purpose { left: target as f64 / faces.max(1.0), is_last };
            simplify += share * sample_faces(pass.faces_in, purpose) as f64 * (seconds.held + seconds.removed_later);
        }
    }
    let write_rate = (WRITE_FACES_PER_SECOND * speed_up(u64::MAX)).min(WRITE_FACES_PER_SECOND_MAX);
    let write = WRITE_SECONDS + target as f64 / write_rate;
    TimeForecast { total: scan + partition + simplify + write, scan, partition, simplify, bake: 0.0, write }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::memory::Sizes;
    use crate::plan::passes;

    const SMALL: InputSize = InputSize { files: 1, bytes: 1 };

    #[test]
    fn one_cluster_gains_nothing_from_more_threads() {
        let sizes = |faces, target| Sizes {
            faces,
            vertices: faces / 2,
            target,
            cluster_faces: 250_000,
            remesh: None,
            is_textured: true,
            is_bounded: false,
            metric_face_bytes: 0,
        };
        let one = passes::forecast(&sizes(100_000, 10_000), 3);
        let many = passes::forecast(&sizes(4_313_336, 431_334), 3);
        let simplify = |passes: &[PassForecast], threads| forecast(SMALL, passes, 1, threads).simplify;
        assert_eq!(simplify(&one, 1), simplify(&one, 8));
        assert!(simplify(&many, 2) < 0.6 * simplify(&many, 1));
    }
    #[test]
    fn a_bound_costs_more_than_what_may_go() {
        let sizes = Sizes {
            faces: 519_691,
            vertices: 260_000,
            target: 519_691,
            cluster_faces: 50_000,
            remesh: None,
            is_textured: true,
            is_bounded: true,
            metric_face_bytes: 0,
        };
        let seconds = |sizes: &Sizes| forecast(SMALL, &passes::forecast(sizes, 3), sizes.target, 1).total;
        // 13 to 25 s, by the bound.
        let bounded = seconds(&sizes);
        assert!((12.0..25.0).contains(&bounded), "{bounded}");
        assert!(seconds(&Sizes { is_bounded: false, ..sizes }) < 5.0);
    }
}
