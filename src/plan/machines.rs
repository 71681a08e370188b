//! Predicts what several machines bring to a run, from the processor time of its phases and the bytes that they move.
//!
//! ```text
//! time of a phase = the longer of its processor time, divided among the machines if it can be, and its bytes ÷ bandwidth
//! ```
//! Bytes were measured on a real survey of 1.5 million triangles at 10 % on 2026-11-23: 206 for each triangle of the
//! input, of which 142 are read. Several machines read files, simplify clusters, bake patches and make tiles; one does the
//! rest.

use serde::Serialize;

use super::passes::PassForecast;
use super::time::{TimeForecast, cluster_seconds};
use crate::lend::ITEMS_MIN;

/// Bytes that move, for each byte of the input that is scanned, for each triangle that is partitioned and simplified, and
/// for each that is written.
const SCANNED_BYTES: f64 = 1.2;
const PARTITIONED_BYTES: f64 = 47.0;
const SIMPLIFIED_BYTES: f64 = 22.0;
const WRITTEN_BYTES: f64 = 100.0;
/// Share of a pyramid's processor time in clusters and tiles, which several machines share: of a survey of 0.52 million
/// triangles, 68 %, of one of 0.38 million, 55 %.
const PYRAMID_SHARE: f64 = 0.6;
/// How often the scratch space of a pyramid moves: it is written and read.
const SCRATCH_MOVES: f64 = 2.0;
/// Seconds that a pass waits for other machines to begin and to end.
const STAGE_SECONDS: f64 = 0.3;
/// A machine alone is about as fast as several if it takes at most this many times as long: the model is no better.
const AS_FAST: f64 = 1.15;

/// Prediction for a run on several machines.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MachinesForecast {
    /// Machines, each with as many threads as this one.
    pub machines: u32,
    /// Bytes in a second that the shared disk moves for all of them; `None` if it is no limit.
    pub bandwidth: Option<u64>,
    /// Seconds on all of them.
    pub seconds: f64,
    /// Seconds on one of them alone, on the shared disk.
    pub seconds_of_one: f64,
    /// Seconds on one of them whose work folder lies on a disk of its own.
    pub seconds_with_own_disk: f64,
}

/// A pyramid that is planned.
#[derive(Debug, Clone, Copy)]
pub struct PlannedPyramid {
    /// Seconds of one machine whose disk is no limit.
    pub seconds: f64,
    /// Bytes of input, scratch space and tiles.
    pub input_bytes: u64,
    pub scratch_bytes: u64,
    pub output_bytes: u64,
    /// Stages that tasks are lent in: each waits for other machines.
    pub stages: u64,
}

/// What a run consists of.
#[derive(Debug, Clone, Copy)]
pub struct PlannedRun<'a> {
    /// Mesh files of the input, and their bytes.
    pub input_files: u64,
    pub input_bytes: u64,
    /// Triangles of the result.
    pub target: u64,
    /// Its passes.
    pub passes: &'a [PassForecast],
    /// Its time on one machine whose disk is no limit.
    pub seconds: TimeForecast,
    /// Threads of a machine.
    pub threads: usize,
}

impl MachinesForecast {
    /// Predicts a run on `machines` machines.
    pub fn of(run: &PlannedRun<'_>, machines: u32, bandwidth: Option<u64>) -> Self {
        let seconds_of_one = seconds_on(run, 1, bandwidth);
        Self {
            machines,
            bandwidth,
            seconds: if machines > 1 { seconds_on(run, machines, bandwidth) } else { seconds_of_one },
            seconds_of_one,
            seconds_with_own_disk: seconds_with_own_disk(run, bandwidth),
        }
    }

    /// Predicts a pyramid on `machines` machines.
    pub fn of_pyramid(pyramid: &PlannedPyramid, machines: u32, bandwidth: Option<u64>) -> Self {
        let PlannedPyramid { seconds, input_bytes, scratch_bytes, output_bytes, stages } = *pyramid;
        let through = |bytes: f64| bandwidth.map_or(0.0, |bandwidth| bytes / bandwidth.max(1) as f64);
        let ends = (input_bytes + output_bytes) as f64;
        let shared = through(ends + SCRATCH_MOVES * scratch_bytes as f64);
        let divided = |machines: u32| {
            let waiting = if machines > 1 { STAGE_SECONDS * stages as f64 } else { 0.0 };
            seconds * (1.0 - PYRAMID_SHARE + PYRAMID_SHARE / f64::from(machines)) + waiting
        };
        Self {
            machines,
            bandwidth,
            seconds: divided(machines).max(shared),
            seconds_of_one: seconds.max(shared),
            seconds_with_own_disk: seconds.max(through(ends)),
        }
    }

    /// Whether one machine with a disk of its own is about as fast.
    pub fn is_one_as_fast(&self) -> bool {
        self.seconds_with_own_disk <= AS_FAST * self.seconds
    }
}

fn seconds_on(run: &PlannedRun<'_>, machines: u32, bandwidth: Option<u64>) -> f64 {
    let PlannedRun { input_files, input_bytes, target, passes, seconds, threads } = *run;
    let moved = |bytes: f64| bandwidth.map_or(0.0, |bandwidth| bytes / bandwidth.max(1) as f64);
    let faces: f64 = passes.iter().map(|pass| pass.faces_in as f64).sum();
    let alone = cluster_seconds(passes, threads, 1);
    let divided = cluster_seconds(passes, threads, machines);
    let waiting = if machines > 1 { STAGE_SECONDS * passes.len() as f64 } else { 0.0 };
    let readers = if input_files < ITEMS_MIN as u64 { 1 } else { input_files.min(u64::from(machines)) };
    (seconds.scan / readers as f64).max(moved(SCANNED_BYTES * input_bytes as f64))
        + seconds.partition.max(moved(PARTITIONED_BYTES * faces))
        + (seconds.simplify - alone + divided).max(moved(SIMPLIFIED_BYTES * faces))
        + waiting
        + seconds.bake / f64::from(machines)
        + seconds.write.max(moved(WRITTEN_BYTES * target as f64))
}

fn seconds_with_own_disk(run: &PlannedRun<'_>, bandwidth: Option<u64>) -> f64 {
    let moved = |bytes: u64| bandwidth.map_or(0.0, |bandwidth| bytes as f64 / bandwidth.max(1) as f64);
    let (scan, seconds) = (run.seconds.scan.max(moved(run.input_bytes)), run.seconds);
    seconds.total - seconds.scan + scan
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::memory::Sizes;
    use crate::plan::passes;
    use crate::plan::time::{self, InputSize};

    fn forecast(machines: u32, bandwidth: Option<u64>) -> MachinesForecast {
        forecast_of(1, machines, bandwidth)
    }

    fn forecast_of(input_files: u64, machines: u32, bandwidth: Option<u64>) -> MachinesForecast {
        let (faces, target, threads, input_bytes) = (500_000_000, 50_000_000, 16, 36_000_000_000);
        let vertices = faces / 2;
        let sizes = Sizes {
            faces,
            vertices,
            target,
            cluster_faces: 50_000,
            remesh: None,
            is_textured: true,
            is_bounded: false,
            metric_face_bytes: 0,
        };
        let passes = passes::forecast(&sizes, 3);
        // The files share the bytes; each takes no time of its own.
        let seconds = time::forecast(InputSize { files: 0, bytes: input_bytes }, &passes, target, threads);
        let run = PlannedRun { input_files, input_bytes, target, passes: &passes, seconds, threads };
        MachinesForecast::of(&run, machines, bandwidth)
    }

    #[test]
    fn a_slow_shared_disk_makes_several_machines_useless() {
        let slow = forecast(8, Some(250_000_000));
        assert!(slow.is_one_as_fast() && slow.seconds < slow.seconds_of_one, "{slow:?}");
        let fast = forecast(8, Some(40_000_000_000));
        assert!(!fast.is_one_as_fast() && fast.seconds < 0.6 * fast.seconds_of_one, "{fast:?}");
        assert!(forecast(16, None).seconds < forecast(2, None).seconds);
    }

    #[test]
    fn a_pyramid_gains_as_much_as_its_disk_allows() {
        let pyramid = PlannedPyramid {
            seconds: 3600.0,
            input_bytes: 10_000_000_000,
            scratch_bytes: 60_000_000_000,
            output_bytes: 5_000_000_000,
            stages: 20,
        };
        let on = |machines, bandwidth| MachinesForecast::of_pyramid(&pyramid, machines, bandwidth);
        assert_eq!(on(1, None).seconds, 3600.0);
        assert!(on(8, None).seconds < on(2, None).seconds && on(2, None).seconds < 0.75 * 3600.0);
        assert!(on(8, Some(40_000_000)).is_one_as_fast() && !on(8, None).is_one_as_fast());
        assert!(on(1000, None).seconds > (1.0 - PYRAMID_SHARE) * 3600.0);
    }

    #[test]
    fn several_machines_read_several_files() {
        let seconds = |files| forecast_of(files, 8, None).seconds;
        assert!(seconds(3) == seconds(1) && seconds(4) < seconds(1) && seconds(8) < seconds(4));
        assert_eq!(seconds(100), seconds(8));
    }

    #[test]
    fn one_machine_is_as_fast_as_one() {
        let one = forecast(1, None);
        assert_eq!(one.seconds, one.seconds_of_one);
        assert!((one.seconds - one.seconds_with_own_disk).abs() < 1e-9 * one.seconds, "{one:?}");
    }
}
