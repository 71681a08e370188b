//! Records the memory and I/O of a run over time, with its phases.
//!
//! A [`Recorder`] sits between the phases and the listener to their progress. It records when each phase begins, and
//! samples the process on its own thread, at first every 20 ms. At `SAMPLES_MAX` samples it drops every second one
//! and doubles the interval, so a run of hours has as many as one of seconds. No result depends on this.

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde::Serialize;

use super::system;
use crate::base::ticker::Ticker;
use crate::base::{Progress, lock};

/// Time between two samples at the start of a run.
const FIRST_INTERVAL: Duration = Duration::from_millis(20);
/// Number of samples at which every second one is dropped.
const SAMPLES_MAX: usize = 1000;

/// State of the process at one moment.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Sample {
    /// Seconds since the run began.
    pub seconds: f64,
    /// Resident memory in bytes, including mapped pages.
    pub resident: u64,
    /// Bytes read by system calls since the run began.
    pub read: u64,
    /// Bytes written by system calls since the run began.
    pub written: u64,
}

/// Time span of a phase.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PhaseSpan {
    /// `scan`, `partition`, `simplify`, `stitch`, `write` etc.; a name may occur several times.
    pub name: &'static str,
    /// Start in seconds since the run began.
    pub begin: f64,
    /// End in seconds since the run began.
    pub end: f64,
}

/// Record of a run.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Timeline {
    /// Phases in order, without gaps between them.
    pub phases: Vec<PhaseSpan>,
    /// Samples in order.
    pub samples: Vec<Sample>,
}

/// Records a [`Timeline`] and forwards progress to a listener.
pub struct Recorder<'a> {
    listener: &'a dyn Progress,
    clock: Clock,
    timeline: Arc<Mutex<Timeline>>,
    sampler: Option<Ticker>,
}

impl<'a> Recorder<'a> {
    /// Starts recording. If no thread can be started, records phases without samples.
    pub fn start(listener: &'a dyn Progress) -> Self {
        let clock = Clock { started: Instant::now(), io_base: system::io_bytes() };
        let timeline = Arc::new(Mutex::new(Timeline::default()));
        let shared = Arc::clone(&timeline);
        let mut interval = FIRST_INTERVAL;
        let sampler = Ticker::start("sampler", interval, move || {
            if keep(&mut lock(&shared).samples, || clock.sample()) {
                interval *= 2;
            }
            interval
        });
        Self { listener, clock, timeline, sampler: Some(sampler) }
    }

    /// Stops recording and returns the timeline.
    pub fn finish(mut self) -> Timeline {
        drop(self.sampler.take());
        let mut timeline = std::mem::take(&mut *lock(&self.timeline));
        let last = self.clock.sample();
        timeline.samples.push(last);
        close(&mut timeline.phases, last.seconds);
        timeline
    }
}

impl Progress for Recorder<'_> {
    fn begin(&self, phase: &'static str, total: u64, unit: &'static str) {
        {
            let mut timeline = lock(&self.timeline);
            let now = self.clock.sample();
            timeline.samples.push(now);
            close(&mut timeline.phases, now.seconds);
            timeline.phases.push(PhaseSpan { name: phase, begin: now.seconds, end: now.seconds });
        }
        self.listener.begin(phase, total, unit);
    }

    fn begin_pass(&self, number: usize) {
        self.listener.begin_pass(number);
    }

    fn advance(&self, units: u64) {
        self.listener.advance(units);
    }

    fn tell(&self, message: &str) {
        self.listener.tell(message);
    }

    fn is_stopped(&self) -> bool {
        self.listener.is_stopped()
    }
}

fn close(phases: &mut [PhaseSpan], now: f64) {
    if let Some(last) = phases.last_mut() {
        last.end = now;
    }
}

/// Start of a run, with the bytes that the process had read and written before.
#[derive(Debug, Clone, Copy)]
struct Clock {
    started: Instant,
    io_base: (u64, u64),
}

impl Clock {
    fn sample(&self) -> Sample {
        let (read, written) = system::io_bytes();
        Sample {
            seconds: self.started.elapsed().as_secs_f64(),
            resident: system::resident_bytes(),
            read: read.saturating_sub(self.io_base.0),
            written: written.saturating_sub(self.io_base.1),
        }
    }
}

/// Appends a sample, taken while the list is locked; returns whether every second one was dropped.
fn keep(samples: &mut Vec<Sample>, sample: impl FnOnce() -> Sample) -> bool {
    samples.push(sample());
    if samples.len() < SAMPLES_MAX {
        return false;
    }
    let mut place = 0;
    samples.retain(|_| {
        place += 1;
        place % 2 == 1
    });
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Silent;

    #[test]
    fn phases_follow_each_other_without_gaps() {
        let recorder = Recorder::start(&Silent);
        recorder.begin("scan", 1, "B");
        recorder.begin("partition", 0, "");
        let timeline = recorder.finish();
        assert_eq!(timeline.phases.iter().map(|phase| phase.name).collect::<Vec<_>>(), ["scan", "partition"]);
        assert_eq!(timeline.phases[0].end, timeline.phases[1].begin);
        assert!(timeline.phases[1].end >= timeline.phases[1].begin);
        assert!(timeline.samples.windows(2).all(|pair| pair[0].seconds <= pair[1].seconds));
    }

    #[test]
    fn long_runs_keep_as_many_samples_as_short_ones() {
        let mut samples = Vec::new();
        let at = |i: usize| Sample { seconds: i as f64, resident: 0, read: 0, written: 0 };
        let halved = (0..10_000).filter(|&i| keep(&mut samples, || at(i))).count();
        assert!(halved > 1 && samples.len() < SAMPLES_MAX);
        assert!(samples.windows(2).all(|pair| pair[0].seconds < pair[1].seconds));
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_sample_has_the_memory_of_this_process() {
        let recorder = Recorder::start(&Silent);
        let timeline = recorder.finish();
        assert!(timeline.samples.iter().all(|sample| sample.resident > 1 << 20));
        assert!(!timeline.samples.is_empty());
    }
}
