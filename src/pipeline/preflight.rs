//! Checks a job before anything is read or written: options, paths, memory, threads, disk space.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use super::paths::{self, OutputKind};
use crate::base::pool::{Durability, Pool};
use crate::base::{Findings, MemoryBudget, Progress, Result};
use crate::job::stage::Lending;
use crate::job::{InputFile, Manifest, WorkFolder, folder_bytes};
use crate::options::{JobOptions, ResumeChoice, SimplifyOptions, TexturesOutside};
use crate::plan::{memory, scratch};
use crate::read::{InputChoice, MovePositions, find_inputs_and_idle};

/// Largest size of the files of an input whose job may start over after a power cut: a second or two of work.
const SHORT_INPUT_BYTES: u64 = 32 << 20;

/// A job that may begin.
pub(super) struct Preflight<'a> {
    /// When the process began.
    pub began: SystemTime,
    /// Options of the job.
    pub options: &'a SimplifyOptions,
    /// Inputs that the user named.
    pub choice: InputChoice,
    /// Input files.
    pub inputs: Vec<PathBuf>,
    /// Patterns of the choice that exclude nothing.
    pub idle: Findings,
    /// The result.
    pub output: &'a Path,
    /// What it is.
    pub kind: OutputKind,
    /// The work folder.
    pub work_path: PathBuf,
    /// Memory that the job may take.
    pub budget: MemoryBudget,
    /// Threads that fit into it.
    pub threads: usize,
    /// Which files must outlast a power cut.
    pub durability: Durability,
    /// What identifies the job.
    pub manifest: Manifest,
    /// Moves the positions of the input while they are read.
    pub mover: Option<Box<dyn MovePositions>>,
    /// How tasks are done elsewhere, if they are.
    pub lending: Option<Lending>,
}

impl<'a> Preflight<'a> {
    /// Checks a job.
    ///
    /// # Errors
    /// [`Error::Usage`](crate::base::Error::Usage) for options and paths that cannot be,
    /// [`Error::Budget`](crate::base::Error::Budget) and [`Error::NoSpace`](crate::base::Error::NoSpace) for too little
    /// memory or disk space, [`Error::Io`](crate::base::Error::Io) for an input that cannot be read.
    pub fn check(choice: InputChoice, output: &'a Path, options: &'a SimplifyOptions) -> Result<Self> {
        Self::check_output(choice, output, options, OutputKind::File(options.textures), options.fingerprint())
    }

    /// Checks a job with an output of some kind; `fingerprint` tells the options that shape it.
    ///
    /// # Errors
    /// As [`check`](Preflight::check).
    pub fn check_output(
        choice: InputChoice,
        output: &'a Path,
        options: &'a SimplifyOptions,
        kind: OutputKind,
        fingerprint: String,
    ) -> Result<Self> {
        let began = SystemTime::now();
        options.check()?;
        let lending = options.job.lending()?;
        let (inputs, idle) = find_inputs_and_idle(&choice)?;
        let budget = memory::choose_budget(options)?;
        let threads = memory::choose_threads(options.limits.threads, budget);
        let work_path = work_folder(output, options);
        paths::refuse(&choice, &inputs, output, &work_path, kind)?;
        let manifest = Manifest { options: fingerprint, ..manifest(&choice, &inputs, options)? };
        let input_bytes: u64 = manifest.inputs.iter().map(|file| file.bytes).sum();
        scratch::refuse_small_disk(input_bytes, folder_bytes(&work_path), &work_path)?;
        if options.job.resume == ResumeChoice::Never && kind != OutputKind::Folder {
            // The old job is removed only if the new one can begin.
            paths::refuse_existing(output, options.job.force)?;
        }
        Ok(Self {
            began,
            options,
            choice,
            inputs,
            idle,
            output,
            kind,
            work_path,
            budget,
            threads,
            durability: durability(options, input_bytes, kind),
            manifest,
            mover: None,
            lending,
        })
    }

    /// Whether images outside of their MTL's folder come to the result, too, or are read for it.
    pub fn brings_outside(&self) -> bool {
        self.options.textures_outside == TexturesOutside::Copy
    }

    /// Opens the work folder, does the work on the job's threads, and ends the job: what failed can be resumed.
    ///
    /// # Errors
    /// Those of [`WorkFolder::open_watched`], [`WorkFolder::finish`] and `work`.
    pub fn run<T>(&self, progress: &dyn Progress, work: impl FnOnce(&mut WorkFolder) -> Result<T>) -> Result<T> {
        Pool::with(self.threads, self.durability)?.run(progress, || {
            let resume = self.options.job.resume.into();
            let mut folder = WorkFolder::open_watched(&self.work_path, &self.manifest, resume, progress)?;
            if let Some(lending) = self.lending.clone() {
                folder.lend_tasks(lending);
            }
            let outcome = work(&mut folder);
            match &outcome {
                Ok(_) => folder.finish(self.options.job.keep_work)?,
                Err(error) => match folder.loss() {
                    Some(loss) => return Err(loss),
                    None => folder.note_failure(error),
                },
            }
            outcome
        })
    }
}

/// Which files must outlast a power cut. A short job that may simply start over makes its result durable alone.
fn durability(options: &SimplifyOptions, input_bytes: u64, kind: OutputKind) -> Durability {
    let JobOptions { no_sync, keep_work, task_runner, hands, .. } = &options.job;
    let is_lent = task_runner.is_some() || hands.is_some();
    let takes_long = options.bakes() || options.remesh.is_some() || kind == OutputKind::Folder;
    if *no_sync {
        Durability::None
    } else if input_bytes > SHORT_INPUT_BYTES || takes_long || is_lent || *keep_work {
        Durability::All
    } else {
        Durability::Result
    }
}

/// The work folder of a job.
pub fn work_folder(output: &Path, options: &SimplifyOptions) -> PathBuf {
    if let Some(work) = &options.job.work {
        return work.clone();
    }
    let mut name = output.file_name().unwrap_or_default().to_owned();
    name.push(".work");
    output.with_file_name(name)
}

pub(super) fn manifest(choice: &InputChoice, inputs: &[PathBuf], options: &SimplifyOptions) -> Result<Manifest> {
    let folders: Vec<OsString> = choice.folders().map(|f| f.canonicalize().unwrap_or_default().into()).collect();
    Ok(Manifest {
        input_folders: PathBuf::from(folders.join(OsStr::new("\n"))),
        program: env!("CARGO_PKG_VERSION").to_owned(),
        options: options.fingerprint(),
        inputs: inputs.iter().map(|path| InputFile::of(path)).collect::<Result<_>>()?,
        passes: options.passes as u64 + u64::from(options.remesh.is_some()),
        owns_folder: options.job.work.is_none(),
        ..Manifest::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::{CvdSettings, TextureFiles};

    #[test]
    fn only_a_short_job_may_lose_its_work_folder_to_a_power_cut() {
        let file = OutputKind::File(TextureFiles::Copy);
        let plain = SimplifyOptions::default();
        assert_eq!(durability(&plain, SHORT_INPUT_BYTES, file), Durability::Result);
        assert_eq!(durability(&plain, SHORT_INPUT_BYTES + 1, file), Durability::All);
        assert_eq!(durability(&plain, 0, OutputKind::Folder), Durability::All);
        let long: [fn(&mut SimplifyOptions); 4] = [
            |options| options.job.keep_work = true,
            |options| options.job.task_runner = Some("sh {stage}".into()),
            |options| options.textures = TextureFiles::Bake,
            |options| options.remesh = Some(CvdSettings::default()),
        ];
        for (i, change) in long.into_iter().enumerate() {
            let mut options = plain.clone();
            change(&mut options);
            assert_eq!(durability(&options, 0, file), Durability::All, "change {i}");
            options.job.no_sync = true;
            assert_eq!(durability(&options, 1 << 40, file), Durability::None, "change {i}");
        }
    }
}
