//! The phases in order: scan, partition and simplify in passes, write.

mod damage;
mod files;
#[cfg(test)]
mod forged;
#[cfg(test)]
mod hostile;
mod input;
mod need;
mod output;
mod pictures;

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use self::damage::report_damage;
use self::input::{Input, Reading};
use self::output::Earlier;
use self::pictures::Painter;
use crate::base::ordered::both;
use crate::base::threads::make_pool;
use crate::base::{Findings, MemoryBudget, Progress, Result};
use crate::job::{InputFile, Manifest, Step, WorkFolder, folder_bytes};
use crate::measure::gauge::gauge;
use crate::options::{
    Borders, Doubles, Drawing, Normals, Pieces, ResumeChoice, SimplifyOptions, TextureFiles, TexturesOutside, Weld,
};
use crate::os::system;
use crate::os::timeline::{Recorder, Timeline};
use crate::passes::{PassOptions, pass};
use crate::plan::memory::{self, Sizes};
use crate::plan::scratch;
use crate::read::{self, InputChoice};
use crate::report::gallery;
use crate::report::scene::DrawResources;
use crate::report::{ErrorFigures, FaceFigures, IoFigures, MemoryFigures, Report, SecondFigures, Status};
use crate::write::{self, WriteOptions};

/// Simplifies OBJ and PLY files, or all below folders, into one OBJ or PLY.
///
/// # Errors
/// [`Error::Usage`](crate::base::Error::Usage) and [`Error::Budget`](crate::base::Error::Budget) before anything is
/// read; see [`Error`](crate::base::Error) for the rest. Whatever happens, an older output stays whole until the new
/// one is complete. Finished work is kept in the work folder: the same call resumes it.
pub fn simplify(
    input: impl Into<InputChoice>,
    output: &Path,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Report> {
    simplify_and(input, output, options, progress, |_, _| Ok(()))
}

/// As [`simplify`], but calls `then` with the report and the job's number before it ends the job. If `then` fails, the
/// next call finds the result written and repeats nothing else.
///
/// # Errors
/// Those of [`simplify`] and of `then`.
pub fn simplify_and(
    input: impl Into<InputChoice>,
    output: &Path,
    options: &SimplifyOptions,
    progress: &dyn Progress,
    then: impl FnOnce(&Report, u64) -> Result<()>,
) -> Result<Report> {
    let began = SystemTime::now();
    let recorder = Recorder::start(progress);
    let progress: &dyn Progress = &recorder;
    options.check()?;
    let choice = input.into();
    let (inputs, idle) = read::find_inputs_and_idle(&choice)?;
    let budget = memory::choose_budget(options)?;
    let threads = memory::choose_threads(options.threads, budget);
    let work_path = work_folder(output, options);
    output::refuse(&choice, &inputs, output, &work_path)?;
    let manifest = manifest(&choice, &inputs, options)?;
    let input_bytes: u64 = manifest.inputs.iter().map(|file| file.bytes).sum();
    scratch::refuse_small_disk(input_bytes, folder_bytes(&work_path), &work_path)?;
    if options.resume == ResumeChoice::Never {
        // The old job is removed only if the new one can begin.
        output::refuse_existing(output, options.force)?;
    }
    make_pool(threads)?;
    let mut job = WorkFolder::open(&work_path, &manifest, options.resume.into())?;
    let reading = Reading {
        choice: &choice,
        began,
        inputs: &inputs,
        idle: &idle,
        manifest: &manifest,
        options,
        scan: memory::scan_options(budget, threads),
        progress,
    };
    let outcome = run(&reading, &mut job, output, budget, threads).and_then(|report| {
        let report = Report { timeline: recorder.finish(), ..report };
        then(&report, job.number())?;
        Ok(report)
    });
    match &outcome {
        Ok(_) => job.finish(options.keep_work)?,
        Err(error) => job.note_failure(error),
    }
    outcome
}

/// Runs the phases in a work folder.
fn run(
    reading: &Reading<'_>,
    job: &mut WorkFolder,
    output: &Path,
    budget: MemoryBudget,
    threads: usize,
) -> Result<Report> {
    let Reading { options, progress, .. } = *reading;
    let started = Instant::now();
    let earlier = output::earlier(job, output)?;
    let was_writing = output::was_writing(job, output)?;
    let replaces_own = !matches!(earlier, Earlier::Nothing);
    output::check(output, job.number(), options.force || replaces_own)?;

    let scanned = Instant::now();
    let (mut input, start) = reading.begin(job)?;
    let is_resumed = job.is_resumed();
    let mut findings = std::mem::take(&mut input.findings);
    findings.merge(reading.idle.clone());
    let Input { ref catalogue, triangles, bytes: input_bytes, ref need, .. } = input;
    let scan_seconds = scanned.elapsed();
    need.check(budget, options, job.path(), start.needs_scratch())?;
    let write_options = WriteOptions {
        textures: options.textures.into(),
        brings_outside: options.textures_outside == TexturesOutside::Copy,
        normals: options.normals == Normals::Auto && catalogue.has_normals,
        force: options.force,
        replaces_own,
        work_bytes: budget.for_work(),
        sources: input.sources(),
        job: job.number(),
    };
    write::check_output(output, catalogue, &write_options, was_writing)?;

    let target = options.target(triangles);
    let sizes = Sizes::of(triangles, need.vertices, options);
    let mut work_bytes = budget.for_work() - need.resident_bytes();
    let painter = Painter {
        catalogue,
        folder: job.path(),
        resources: DrawResources { threads, work_bytes },
        with_errors: options.drawing == Drawing::PicturesAndErrors,
        progress,
    };
    let drawn = Instant::now();
    let before = match start.unsimplified() {
        Some(mesh) if options.drawing != Drawing::Nothing => painter.draw(mesh, None, &mut findings),
        _ => None,
    };
    let mut draw_seconds = drawn.elapsed();
    let map = before.as_ref().map(|(from, _)| from.map(pictures::MAP_SIZE));
    if map.is_some() {
        work_bytes = work_bytes.saturating_sub(pictures::MAP_BYTES);
    }
    let pass_options = pass_options(options, catalogue.has_texcoords, triangles, target, threads, work_bytes)?;
    let pass_options = PassOptions { map, ..pass_options };
    let outcome = pass::simplify(start, &pass_options, catalogue, job, progress);
    report_damage(job, progress);
    let passes = outcome?;
    if passes.faces == 0 {
        job.give_up();
        return Err(input::nothing_left(reading.choice.name(), triangles, options));
    }
    findings.merge(passes.findings);

    let written = Instant::now();
    let write = || {
        let result = match earlier {
            // If the job was restarted on the way, nothing shows that the earlier result follows from the input as it
            // is now.
            Earlier::Whole(written) if is_resumed => written,
            _ => {
                output::remember(job, output)?;
                let staged = write::stage(&passes.mesh, catalogue, output, job.path(), &write_options, progress)?;
                if options.textures == TextureFiles::Copy {
                    input.check_textures(&staged, write_options.brings_outside)?;
                }
                progress.check_stopped()?;
                job.settle()?;
                job.keep(Step::Written, staged.written().faces, [], staged.written())?;
                // Without this record, a result that has its final name already would be taken for that of another job.
                job.sync()?;
                staged.commit(progress)?
            }
        };
        progress.begin("measure", 0, "");
        Ok((result, written.elapsed()))
    };
    // Text is written by one thread most of the time.
    let (result, measured) = both(threads, write, || gauge(&passes.probes, &passes.mesh, progress));
    let ((result, write_seconds), measured) = (result?, measured?);
    let measure_seconds = written.elapsed() - write_seconds;
    let scratch_peak = passes.scratch_peak.max(folder_bytes(job.path()));
    let is_drawn = options.drawing != Drawing::Nothing;
    let files = files::figures(catalogue, &result.findings, &result.companions, write_options.brings_outside, is_drawn);
    findings.merge(result.findings);
    let drawn = Instant::now();
    let shots = before.and_then(|(from, before)| {
        let (_, after) = painter.draw(&passes.mesh, Some(from), &mut findings)?;
        Some([before, after])
    });

    draw_seconds += drawn.elapsed();

    let (read, written) = system::io_bytes();
    let drawing_peak = match shots {
        Some(_) => MemoryBudget::FIXED_BYTES + need.resident_bytes() + gallery::peak_bytes(work_bytes),
        None => 0,
    };
    let status = if passes.reached { Status::Done } else { Status::TargetMissed };
    Ok(Report {
        program: env!("CARGO_PKG_VERSION"),
        command: options.command.clone(),
        began: reading.began.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs()),
        status,
        resumed: is_resumed,
        input: reading.choice.name().to_owned(),
        inputs: reading.choice.paths.clone(),
        input_files: reading.inputs.len() as u64,
        options: options.clone(),
        threads,
        output: output.to_owned(),
        faces: FaceFigures {
            input: triangles,
            target: if options.has_target() { target } else { passes.faces },
            output: passes.faces,
        },
        error: ErrorFigures { threshold: passes.reports.last().map_or(0.0, |pass| pass.threshold), measured },
        topology: passes.changes,
        new_texture_below: new_texture_below(passes.seam_crowding, passes.faces, triangles),
        seam_crowding: passes.seam_crowding,
        seconds: SecondFigures {
            total: started.elapsed().as_secs_f64(),
            scan: scan_seconds.as_secs_f64(),
            partition: passes.seconds.partition.as_secs_f64(),
            remesh: passes.seconds.remesh.as_secs_f64(),
            simplify: passes.seconds.simplify.as_secs_f64(),
            stitch: passes.seconds.stitch.as_secs_f64(),
            write: write_seconds.as_secs_f64(),
            measure: measure_seconds.as_secs_f64(),
            draw: draw_seconds.as_secs_f64(),
        },
        memory: MemoryFigures {
            budget: budget.bytes,
            predicted_peak: memory::forecast(&sizes, budget, threads)
                .peak
                .max(MemoryBudget::FIXED_BYTES + need.resident_bytes() + passes.permit_peak)
                .max(drawing_peak),
            peak_resident: system::peak_resident_bytes(),
        },
        io: IoFigures { input: input_bytes, read, written, output: result.bytes, scratch_peak },
        files,
        timeline: Timeline::default(),
        remesh: passes.remeshed,
        passes: passes.reports,
        shots,
        floor: (!passes.reached).then_some(passes.floor),
        comparison: None,
        warnings: findings.warnings(),
        repairs: repairs(&findings),
    })
}

fn repairs(findings: &Findings) -> std::collections::BTreeMap<String, u64> {
    findings.iter().map(|(kind, finding)| (kind.to_owned(), finding.count)).collect()
}

fn pass_options(
    options: &SimplifyOptions,
    has_texture: bool,
    input: u64,
    target: u64,
    threads: usize,
    work_bytes: u64,
) -> Result<PassOptions> {
    Ok(PassOptions {
        target,
        max_error: options.max_error,
        input,
        passes: options.pass_count(input),
        cluster_faces: options.cluster_faces,
        cost: options.cost(has_texture)?,
        seams: options.seam_policy(),
        lock_borders: options.borders == Borders::Lock,
        drop_pieces: options.pieces == Pieces::Drop,
        frees_topology: options.frees_topology(),
        one_by_one: options.one_by_one,
        drop_doubles: options.doubles == Doubles::Drop,
        remesh: options.remesh,
        optimize: options.optimize,
        weld: options.weld == Weld::Exact,
        map: None,
        threads,
        work_bytes,
    })
}

/// The work folder of a job.
pub fn work_folder(output: &Path, options: &SimplifyOptions) -> PathBuf {
    if let Some(work) = &options.work {
        return work.clone();
    }
    let mut name = output.file_name().unwrap_or_default().to_owned();
    name.push(".work");
    output.with_file_name(name)
}

fn manifest(choice: &InputChoice, inputs: &[PathBuf], options: &SimplifyOptions) -> Result<Manifest> {
    let folders: Vec<OsString> = choice.folders().map(|f| f.canonicalize().unwrap_or_default().into()).collect();
    Ok(Manifest {
        input_folders: PathBuf::from(folders.join(OsStr::new("\n"))),
        program: env!("CARGO_PKG_VERSION").to_owned(),
        options: options.fingerprint(),
        inputs: inputs.iter().map(|path| InputFile::of(path)).collect::<Result<_>>()?,
        passes: options.passes as u64 + u64::from(options.remesh.is_some()),
        owns_folder: options.work.is_none(),
        ..Manifest::default()
    })
}

/// Share of the triangles below which seams would take more vertices than there are; `None` unless they do so in the
/// result.
///
/// NOTE: edge length grows with the inverse square root of the faces, so the number of seam vertices falls with their
/// square root.
fn new_texture_below(crowding: Option<f64>, faces: u64, input: u64) -> Option<f64> {
    let share = faces as f64 / input.max(1) as f64;
    crowding.filter(|&crowding| crowding > 1.0).map(|crowding| (share * crowding * crowding).min(1.0))
}
