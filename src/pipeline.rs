//! The phases in order: scan, partition and simplify in passes, write.

use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::base::{Error, Findings, MemoryBudget, Progress, Result, bytes};
use crate::cost::surface::Weights;
use crate::job::{FORMAT_VERSION, Manifest, WorkFolder};
use crate::options::{Borders, Metric, Normals, SimplifyOptions, Weld};
use crate::os::system;
use crate::report::{ErrorFigures, FaceFigures, IoFigures, MemoryFigures, Report, SecondFigures, Status};
use crate::scan::{self, Scan, ScanOptions};
use crate::simplify::engine::FACE_BYTES;
use crate::stitch::pass::{PassOptions, Run};
use crate::write::{self, WriteOptions};

/// Memory of a chunk that is being parsed, for the scan's share of the budget.
const CHUNK_BYTES: u64 = 16 << 20;
/// A cluster may come out this much larger than asked for.
const CLUSTER_EXCESS: f64 = 1.3;
/// Scratch space for each byte of OBJ text, measured on photogrammetry.
const SCRATCH_PER_INPUT: f64 = 1.6;

/// Simplifies one OBJ, or all below a folder, into one OBJ.
///
/// # Errors
/// [`Error::Usage`] and [`Error::Budget`] before anything is read; see [`Error`] for the rest. Whatever happens, an
/// older output stays whole until the new one is complete.
pub fn simplify(input: &Path, output: &Path, options: &SimplifyOptions, progress: &dyn Progress) -> Result<Report> {
    let started = Instant::now();
    options.check()?;
    let inputs = scan::find_inputs(input)?;
    refuse_output(&inputs, output, options)?;
    let budget = choose_budget(options)?;
    let threads = choose_threads(options, budget);
    let work_path = options.work.clone().unwrap_or_else(|| default_work(output));
    refuse_small_disk(&inputs, output, &work_path)?;
    let mut work = WorkFolder::open(&work_path, &manifest(&inputs, options))?;

    let scanned = Instant::now();
    let scan_options = scan_options(budget, threads);
    let Scan { mesh, catalogue, triangles, mut findings, input_bytes, .. } =
        scan::scan(&inputs, work.path(), &scan_options, progress)?;
    let scan_seconds = scanned.elapsed();
    let mut scratch_peak = work.bytes();

    let target = options.target(triangles);
    let pass_options = pass_options(options, catalogue.has_texcoords, triangles, target, threads, budget);
    let passes = Run::new(&pass_options, &catalogue, work.path(), progress).simplify(mesh)?;
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
    Ok(Report {
        status: if passes.reached { Status::Done } else { Status::TargetMissed },
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
            predicted_peak: predicted_peak(&pass_options, &scan_options, budget),
            peak_resident: system::peak_resident_bytes(),
        },
        io: IoFigures { input: input_bytes, read, written, scratch_peak },
        passes: passes.reports,
        floor: (!passes.reached).then_some(passes.floor),
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

fn choose_budget(options: &SimplifyOptions) -> Result<MemoryBudget> {
    let floor = MemoryBudget::FLOOR_BYTES;
    let half = system::memory_bytes().map_or(1 << 30, |bytes| bytes / 2).max(floor);
    let bytes = options.memory.unwrap_or(half);
    if bytes < floor {
        let (found, floor) = (bytes::display(bytes), bytes::display(floor));
        return Err(Error::Budget(format!("--memory {found}: at least {floor} are needed")));
    }
    let budget = MemoryBudget { bytes };
    let cluster = (options.cluster_faces as f64 * CLUSTER_EXCESS) as u64 * FACE_BYTES;
    if cluster > budget.for_work() {
        let most = (budget.for_work() as f64 / CLUSTER_EXCESS) as u64 / FACE_BYTES;
        return Err(Error::Budget(format!(
            "{} cannot hold a cluster of {} triangles; give --cluster-faces {most} or --memory {}",
            bytes::display(bytes),
            options.cluster_faces,
            bytes::display(cluster + MemoryBudget::FIXED_BYTES + bytes::MIB),
        )));
    }
    Ok(budget)
}

fn choose_threads(options: &SimplifyOptions, budget: MemoryBudget) -> usize {
    let wanted = options.threads.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
    wanted.min((budget.for_work() / CHUNK_BYTES / 2).max(1) as usize)
}

fn scan_options(budget: MemoryBudget, threads: usize) -> ScanOptions {
    let fitting = (budget.for_work() / CHUNK_BYTES) as usize;
    ScanOptions { threads, chunks_in_flight: (threads * 2).min(fitting).max(1) }
}

fn pass_options(
    options: &SimplifyOptions,
    has_texture: bool,
    input: u64,
    target: u64,
    threads: usize,
    budget: MemoryBudget,
) -> PassOptions {
    let metric = options.metric.unwrap_or(if has_texture { Metric::QemAttributes } else { Metric::Qem });
    let uv = if metric == Metric::QemAttributes && has_texture { options.uv_weight } else { 0.0 };
    PassOptions {
        target,
        max_error: options.max_error,
        input,
        passes: options.passes,
        cluster_faces: options.cluster_faces,
        weights: Weights { uv, ..Weights::default() },
        seams: options.seams.into(),
        lock_borders: options.borders == Borders::Lock,
        weld: options.weld == Weld::Exact,
        threads,
        work_bytes: budget.for_work(),
    }
}

/// The most memory that any phase should take, in bytes.
fn predicted_peak(options: &PassOptions, scan: &ScanOptions, budget: MemoryBudget) -> u64 {
    let scan = (scan.threads + 3 * scan.chunks_in_flight) as u64 * (4 << 20);
    let cluster = options.cluster_faces.min(options.input) * FACE_BYTES;
    let clusters = cluster * (options.threads as u64).min(options.input.div_ceil(options.cluster_faces.max(1)).max(1));
    let partition = (36 << 20) + (options.input * 2).min(options.work_bytes / 4) + options.input / 16;
    MemoryBudget::FIXED_BYTES + scan.max(clusters).max(partition).min(budget.for_work())
}

fn default_work(output: &Path) -> PathBuf {
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

/// Refuses, from the files' sizes alone, a job for which the work folder's disk is too small.
fn refuse_small_disk(inputs: &[PathBuf], output: &Path, work: &Path) -> Result<()> {
    let input: u64 = inputs.iter().filter_map(|path| std::fs::metadata(path).ok()).map(|meta| meta.len()).sum();
    let needed = (input as f64 * SCRATCH_PER_INPUT) as u64;
    let existing = [work, output].into_iter().find_map(|path| path.ancestors().find(|a| a.is_dir()));
    let folder = existing.unwrap_or(Path::new("."));
    let Ok(free) = system::free_disk_bytes(folder) else { return Ok(()) };
    if free < needed {
        let (needed, free) = (bytes::display(needed), bytes::display(free));
        let message =
            format!("about {needed} of scratch space are needed, {free} are free; --work DIR takes another disk");
        return Err(Error::NoSpace { path: folder.to_owned(), message });
    }
    Ok(())
}
