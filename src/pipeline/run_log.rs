//! What a run notes on its way to the report: times and findings.

use std::time::{Instant, UNIX_EPOCH};

use super::admission::Admission;
use super::files;
use super::input::Input;
#[cfg(not(feature = "report"))]
use super::no_painter::{NoShots as Shots, peak_bytes};
#[cfg(feature = "report")]
use super::painter::{Shots, peak_bytes};
use super::preflight::Preflight;
use super::publish::Published;
use crate::base::{Findings, MemoryBudget};
use crate::job::{WorkFolder, folder_bytes};
use crate::options::Drawing;
use crate::os::system;
use crate::os::timeline::Timeline;
use crate::passes::Passes;
use crate::plan::memory::{self, Sizes};
use crate::report::{BakeFigures, ErrorFigures, FaceFigures, IoFigures, MemoryFigures, Report, SecondFigures, Status};

/// Times and findings of a run.
pub(super) struct RunLog {
    started: Instant,
    /// Bytes that the process had read and written before.
    io_before: (u64, u64),
    seconds: SecondFigures,
    /// What was ignored, repaired or lost.
    pub findings: Findings,
}

impl RunLog {
    /// Starts the clock.
    pub fn start() -> Self {
        Self {
            started: Instant::now(),
            io_before: system::io_bytes(),
            seconds: SecondFigures::default(),
            findings: Findings::default(),
        }
    }

    /// Does work of a phase, and adds the time to it.
    pub fn time<T>(&mut self, phase: fn(&mut SecondFigures) -> &mut f64, work: impl FnOnce() -> T) -> T {
        self.time_with(phase, |_| work())
    }

    /// As [`time`](Self::time), for work that notes findings.
    pub fn time_with<T>(&mut self, phase: fn(&mut SecondFigures) -> &mut f64, work: impl FnOnce(&mut Self) -> T) -> T {
        let started = Instant::now();
        let outcome = work(self);
        *phase(&mut self.seconds) += started.elapsed().as_secs_f64();
        outcome
    }

    /// Reports the run.
    pub fn report(mut self, run: FinishedRun<'_>) -> Report {
        let FinishedRun { job, input, admission, passes, bake, published, shots, work } = run;
        let options = job.options;
        let scratch_peak = passes.scratch_peak.max(folder_bytes(work.path()));
        let is_drawn = options.notes.drawing != Drawing::Nothing;
        let Published { written, measured, is_resumed, .. } = published;
        let files = files::figures(input, &written, job.brings_outside(), is_drawn);
        self.findings.merge(passes.findings);
        self.findings.merge(written.findings);
        self.seconds.write = published.write_time.as_secs_f64();
        self.seconds.measure = published.measure_time.as_secs_f64();
        self.seconds.partition = passes.seconds.partition.as_secs_f64();
        self.seconds.remesh = passes.seconds.remesh.as_secs_f64();
        self.seconds.simplify = passes.seconds.simplify.as_secs_f64();
        self.seconds.stitch = passes.seconds.stitch.as_secs_f64();
        self.seconds.total = self.started.elapsed().as_secs_f64();
        let (io_read, io_written) = system::io_bytes();
        let (read_before, written_before) = self.io_before;
        Report {
            program: env!("CARGO_PKG_VERSION"),
            command: options.notes.command.clone(),
            began: job.began.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs()),
            status: if passes.reached { Status::Done } else { Status::TargetMissed },
            resumed: is_resumed,
            input: job.choice.name().to_owned(),
            inputs: job.choice.paths.clone(),
            input_files: job.inputs.len() as u64,
            options: options.clone(),
            threads: job.threads,
            output: job.output.to_owned(),
            faces: FaceFigures {
                input: input.triangles,
                target: if options.has_target() { admission.target } else { passes.faces },
                output: passes.faces,
            },
            error: ErrorFigures { threshold: passes.reports.last().map_or(0.0, |pass| pass.threshold), measured },
            topology: passes.changes,
            new_texture_below: new_texture_below(passes.seam_density, passes.faces, input.triangles),
            seam_density: passes.seam_density,
            seconds: self.seconds,
            memory: MemoryFigures {
                budget: job.budget.bytes,
                predicted_peak: {
                    let peak = predicted_peak(job, input, admission, passes.permit_peak, shots.is_some());
                    bake.map_or(peak, |(_, bytes)| peak.max(MemoryBudget::FIXED_BYTES + bytes))
                },
                peak_resident: system::peak_resident_bytes(),
            },
            io: IoFigures {
                input: input.bytes,
                read: io_read.saturating_sub(read_before),
                written: io_written.saturating_sub(written_before),
                output: written.content.bytes,
                scratch_peak,
            },
            files,
            bake: bake.map(|(figures, _)| figures),
            timeline: Timeline::default(),
            remesh: passes.remeshed,
            passes: passes.reports,
            #[cfg(feature = "report")]
            shots,
            floor: (!passes.reached).then_some(passes.floor),
            comparison: None,
            repairs: self.findings.iter().map(|(kind, finding)| (kind.to_owned(), finding.count)).collect(),
            warnings: self.findings.warnings(),
        }
    }
}

/// A run with all that a report tells of it.
pub(super) struct FinishedRun<'a> {
    pub job: &'a Preflight<'a>,
    pub input: &'a Input,
    pub admission: &'a Admission,
    pub passes: Passes,
    /// What was baked, and the expected memory of that work in bytes.
    pub bake: Option<(BakeFigures, u64)>,
    pub published: Published,
    /// Renderings before and after.
    pub shots: Shots,
    pub work: &'a WorkFolder,
}

/// Peak of memory that the formulas predict, in bytes.
fn predicted_peak(job: &Preflight<'_>, input: &Input, admission: &Admission, permit_peak: u64, is_drawn: bool) -> u64 {
    let resident = MemoryBudget::FIXED_BYTES + input.need.resident_bytes();
    let sizes = Sizes::of(input.triangles, input.need.vertices, job.options);
    let drawing = if is_drawn { resident + peak_bytes(admission.work_bytes) } else { 0 };
    memory::forecast(&sizes, job.budget, job.threads).peak.max(resident + permit_peak).max(drawing)
}

/// Share of the triangles below which seams would take more vertices than there are; `None` unless they do so in the
/// result.
///
/// NOTE: edge length grows with the inverse square root of the faces, so the number of seam vertices falls with their
/// square root.
fn new_texture_below(seam_density: Option<f64>, faces: u64, input: u64) -> Option<f64> {
    let share = faces as f64 / input.max(1) as f64;
    seam_density
        .filter(|&seam_density| seam_density > 1.0)
        .map(|seam_density| (share * seam_density * seam_density).min(1.0))
}
