//! The phases in order: scan, partition and simplify in passes, write.

#[cfg(test)]
mod hostile;
mod need;

use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use self::need::Need;
use crate::base::{Error, Findings, MemoryBudget, Progress, Result};
use crate::job::{FORMAT_VERSION, Manifest, WorkFolder};
use crate::options::{Borders, Normals, Pieces, SimplifyOptions, Weld};
use crate::os::system;
use crate::os::timeline::Recorder;
use crate::plan::memory::{self, Sizes};
use crate::plan::scratch;
use crate::report::{ErrorFigures, FaceFigures, IoFigures, MemoryFigures, Report, SecondFigures, Status};
use crate::scan::{self, Scan};
use crate::stitch::pass::{self, PassOptions};
use crate::write::{self, WriteOptions};

/// Simplifies one OBJ, or all below a folder, into one OBJ.
///
/// # Errors
/// [`Error::Usage`] and [`Error::Budget`] before anything is read; see [`Error`] for the rest. Whatever happens, an
/// older output stays whole until the new one is complete.
pub fn simplify(input: &Path, output: &Path, options: &SimplifyOptions, progress: &dyn Progress) -> Result<Report> {
    let (started, began) = (Instant::now(), SystemTime::now());
    let recorder = Recorder::start(progress);
    let progress: &dyn Progress = &recorder;
    options.check()?;
    let inputs = scan::find_inputs(input)?;
    refuse_output(&inputs, output, options)?;
    let budget = memory::choose_budget(options)?;
    let threads = memory::choose_threads(options.threads, budget);
    let work_path = options.work.clone().unwrap_or_else(|| default_work(output));
    let input_sizes = inputs.iter().filter_map(|path| std::fs::metadata(path).ok()).map(|meta| meta.len());
    scratch::refuse_small_disk(input_sizes.sum(), &work_path)?;
    let mut work = WorkFolder::open(&work_path, &manifest(&inputs, options))?;

    let scanned = Instant::now();
    let scan_options = memory::scan_options(budget, threads);
    let Scan { mesh, catalogue, triangles, mut findings, input_bytes, .. } =
        scan::scan(&inputs, work.path(), &scan_options, progress)?;
    let scan_seconds = scanned.elapsed();
    let mut scratch_peak = work.bytes();

    let need = Need::of(&mesh, &catalogue);
    need.check(budget, options.cluster_faces, work.path())?;

    let target = options.target(triangles);
    let sizes = Sizes { faces: triangles, vertices: mesh.vertex_count(), target, cluster_faces: options.cluster_faces };
    let work_bytes = budget.for_work() - need.resident_bytes();
    let pass_options = pass_options(options, catalogue.has_texcoords, triangles, target, threads, work_bytes)?;
    let passes = pass::simplify(mesh, &pass_options, &catalogue, work.path(), progress)?;
    findings.merge(passes.findings);
    scratch_peak = scratch_peak.max(passes.scratch_peak);

    let written = Instant::now();
    let write_options = WriteOptions {
        textures: options.textures.into(),
        normals: options.normals == Normals::Auto && catalogue.has_normals,
        force: options.force,
        work_bytes: budget.for_work(),
    };
    let result = write::write(&passes.mesh, &catalogue, output, work.path(), &write_options, progress)?;
    findings.merge(result.findings);
    let write_seconds = written.elapsed();
    work.keep = options.keep_work;
    drop(work);

    let (read, written) = system::io_bytes();
    let status = if passes.reached { Status::Done } else { Status::TargetMissed };
    Ok(Report {
        program: env!("CARGO_PKG_VERSION"),
        began: began.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs()),
        status,
        input: input.to_owned(),
        input_files: inputs.len() as u64,
        options: options.clone(),
        threads,
        output: output.to_owned(),
        faces: FaceFigures {
            input: triangles,
            target: if options.max_error.is_some() { passes.faces } else { target },
            output: passes.faces,
        },
        error: ErrorFigures {
            threshold: passes.reports.last().map_or(0.0, |pass| pass.threshold),
            rms_estimate: passes.rms_estimate,
        },
        seconds: SecondFigures {
            total: started.elapsed().as_secs_f64(),
            scan: scan_seconds.as_secs_f64(),
            partition: passes.seconds.partition.as_secs_f64(),
            simplify: passes.seconds.simplify.as_secs_f64(),
            stitch: passes.seconds.stitch.as_secs_f64(),
            write: write_seconds.as_secs_f64(),
        },
        memory: MemoryFigures {
            budget: budget.bytes,
            predicted_peak: memory::forecast(&sizes, budget, threads)
                .peak
                .max(MemoryBudget::FIXED_BYTES + need.resident_bytes() + passes.permit_peak),
            peak_resident: system::peak_resident_bytes(),
        },
        io: IoFigures { input: input_bytes, read, written, scratch_peak },
        timeline: recorder.finish(),
        passes: passes.reports,
        floor: (!passes.reached).then_some(passes.floor),
        comparison: None,
        warnings: findings.warnings(),
        repairs: repairs(&findings),
    })
}

fn repairs(findings: &Findings) -> std::collections::BTreeMap<String, u64> {
    findings.iter().map(|(kind, finding)| (kind.to_owned(), finding.count)).collect()
}

/// Refuses, before anything is read, an output that exists or is one of the inputs.
fn refuse_output(inputs: &[PathBuf], output: &Path, options: &SimplifyOptions) -> Result<()> {
    let shown = crate::base::error::escape_path(output);
    if output.file_name().is_none() || output.is_dir() {
        return Err(Error::Usage(format!("{shown}: the output must be a file, such as out/city.obj")));
    }
    let Ok(there) = output.canonicalize() else { return Ok(()) };
    if inputs.iter().any(|input| input.canonicalize().is_ok_and(|input| input == there)) {
        return Err(Error::Usage(format!("{shown}: the output is the input; choose another name")));
    }
    if !options.force {
        return Err(Error::Usage(format!("{shown}: exists already; --force replaces it")));
    }
    Ok(())
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
        passes: options.passes,
        cluster_faces: options.cluster_faces,
        cost: options.cost(has_texture)?,
        seams: options.seam_policy(),
        lock_borders: options.borders == Borders::Lock,
        drop_pieces: options.pieces == Pieces::Drop,
        optimize: options.optimize,
        weld: options.weld == Weld::Exact,
        threads,
        work_bytes,
    })
}

/// The work folder of a run that names none.
pub fn default_work(output: &Path) -> PathBuf {
    let mut name = output.file_name().unwrap_or_default().to_owned();
    name.push(".work");
    output.with_file_name(name)
}

fn manifest(inputs: &[PathBuf], options: &SimplifyOptions) -> Manifest {
    let size = |path: &PathBuf| std::fs::metadata(path).map_or(0, |meta| meta.len());
    Manifest {
        format: FORMAT_VERSION,
        program: env!("CARGO_PKG_VERSION").to_owned(),
        options: options.fingerprint(),
        inputs: inputs.iter().map(|path| (path.clone(), size(path))).collect(),
    }
}
