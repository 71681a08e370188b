//! The input of a job: scanned, or read back from an earlier process and compared with the files.
//!
//! In: the mesh files, the work folder. Out: what the input holds beside geometry, and where the passes begin.
//! Invariant: a result of an earlier process is used only after the content of every file that it follows from was
//! compared.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::damage::report_damage;
use super::lend_scan::lend_files;
use super::original::{baked_images, has_original};
use super::paths::OutputKind;
use super::preflight::Preflight;
use super::requirements::Requirements;
use crate::base::ordered::map_in_order;
use crate::base::{Error, Findings, Progress, Result, counted};
use crate::job::{Recalled, Step, WorkFolder, folder_bytes};
use crate::model::Catalogue;
use crate::model::id::FileId;
use crate::options::{Pieces, TextureFiles};
use crate::passes::ResumePoint;
use crate::plan::memory;
use crate::read::fingerprint::{self, Contents, Source};
use crate::read::{self, COUNT_LIMIT, INPUT, SCAN, Scan, ScanOptions, ScannedFile};
use crate::write::{self, NamedTexture, Sources, Staged};

/// Catalogue, counts and source files of the input: everything but geometry.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Input {
    /// Labels and materials.
    pub(super) catalogue: Catalogue,
    /// Triangles.
    pub(super) triangles: u64,
    /// Findings of the scan: elements ignored or repaired.
    pub(super) findings: Findings,
    /// Bytes of the mesh files.
    pub(super) bytes: u64,
    /// Memory and disk space that the job needs.
    pub(super) need: Requirements,
    /// Hash of each mesh file.
    content_hashes: Vec<u64>,
    /// Material libraries.
    libraries: Vec<Source>,
    /// Textures.
    textures: Vec<Source>,
}

impl Recalled for Input {
    /// Files and folders that the user names now.
    type Context<'a> = (Vec<PathBuf>, Vec<PathBuf>);

    fn locate(&mut self, _: &Path, (files, folders): &(Vec<PathBuf>, Vec<PathBuf>)) {
        (self.catalogue.files, self.catalogue.folders) = (files.clone().into(), folders.clone());
    }

    fn is_sound(&self, _: &(Vec<PathBuf>, Vec<PathBuf>)) -> bool {
        self.catalogue.is_sound()
            && self.need.is_sound()
            && self.triangles.max(self.bytes) < COUNT_LIMIT
            && self.findings.are_plain()
    }
}

/// Reads the input of a job: resumes the job in the work folder, or scans the files.
///
/// # Errors
/// [`Error::Changed`] if the input has changed since the job began; those of the scan.
pub(super) fn read(
    job: &Preflight<'_>,
    work: &mut WorkFolder,
    progress: &dyn Progress,
) -> Result<(Input, ResumePoint)> {
    let reading = Reading { job, scan: memory::scan_options(job.budget, job.threads), progress };
    let recalled = if work.is_resumed() { Some(reading.recall(work)?) } else { None };
    report_damage(work, progress);
    if let Some(recalled) = recalled {
        if let Some((input, start)) = recalled {
            progress.tell(&start.kept(work));
            return Ok((input, start));
        }
        work.restart(&job.manifest)?;
    }
    reading.scan(work)
}

struct Reading<'a> {
    job: &'a Preflight<'a>,
    /// How the scan uses the machine.
    scan: ScanOptions,
    progress: &'a dyn Progress,
}

impl Reading<'_> {
    fn recall(&self, work: &WorkFolder) -> Result<Option<(Input, ResumePoint)>> {
        let named = (self.job.inputs.clone(), self.folders());
        let Some(input) = work.recall::<Input>(&INPUT, &named)? else { return Ok(None) };
        self.progress.begin("compare", input.bytes, "B");
        let hashes = fingerprint::content_hashes(&self.job.inputs, self.scan.threads, self.progress)?;
        for (path, (old, new)) in self.job.inputs.iter().zip(input.content_hashes.iter().zip(hashes)) {
            if *old != new {
                return Err(fingerprint::changed(path, "has changed"));
            }
        }
        let libraries = libraries_at(input.libraries.iter().map(|source| source.path.as_path()))?;
        let textures = self.textures(&input.catalogue)?;
        let mut all = Vec::new();
        for (old, new) in [(&input.libraries, &libraries), (&input.textures, &textures)] {
            let pairs = || old.iter().zip(new);
            if old.len() != new.len() || pairs().any(|(old, new)| old.path != new.path) {
                return Err(fingerprint::changed(
                    self.job.choice.name(),
                    "names libraries or textures in other places",
                ));
            }
            all.extend(pairs());
        }
        for (old, new) in all {
            if let Some(what) = old.difference(new) {
                return Err(fingerprint::changed(&old.path, what));
            }
        }
        let start = ResumePoint::recall(work, &input.catalogue, self.job.options.cluster_faces)?;
        // What is baked needs the surface of the input, which the passes leave behind.
        let is_enough = |start: &ResumePoint| {
            Ok(!self.job.options.bakes() || start.unsimplified().is_some() || has_original(work)?)
        };
        match start {
            Some(start) if is_enough(&start)? => Ok(Some((input, start))),
            _ => Ok(None),
        }
    }

    fn scan(&self, work: &WorkFolder) -> Result<(Input, ResumePoint)> {
        let scanned = match (&self.job.mover, self.scan_elsewhere(work)?) {
            (_, Some(scanned)) => scanned,
            (Some(mover), None) => {
                read::scan_moved(&self.job.inputs, work.path(), &self.scan, &**mover, self.progress)?
            }
            (None, None) => read::scan(&self.job.inputs, work.path(), &self.scan, self.progress)?,
        };
        let Scan { mesh, mut catalogue, triangles, findings, input_bytes, content_hashes, libraries } = scanned;
        catalogue.folders = self.folders();
        let textures = self.textures(&catalogue)?;
        let libraries = libraries_at(libraries.iter().map(PathBuf::as_path))?;
        let need = Requirements::of(&mesh, &catalogue);
        let input =
            Input { catalogue, triangles, findings, bytes: input_bytes, need, content_hashes, libraries, textures };
        work.keep(Step::new(INPUT).of_size(triangles), [], &input)?;
        work.keep(Step::new(SCAN).from([INPUT]).of_size(triangles), mesh.files(), &mesh)?;
        let mut start = ResumePoint::from(mesh);
        start.state.scratch_peak = folder_bytes(work.path());
        Ok((input, start))
    }

    /// Has the files read by other processes; `None` if they are not.
    fn scan_elsewhere(&self, work: &WorkFolder) -> Result<Option<Scan>> {
        if work.lending().is_none() || self.job.mover.is_some() {
            return Ok(None);
        }
        let lent = lend_files(&self.job.manifest.inputs, work, self.progress)?;
        let files = FileId::first(self.job.inputs.len());
        if !files.clone().all(|file| lent.holds(file)) {
            return Ok(None);
        }
        let result = |file: FileId| -> Result<ScannedFile> {
            let gone = || fingerprint::changed(&self.job.inputs[file.index()], "was not read");
            lent.result(work.path(), file, &())?.map(|(scanned, _)| scanned).ok_or_else(gone)
        };
        read::join(&self.job.inputs, files.map(result), &self.scan).map(Some)
    }

    /// The folders that were given as input.
    fn folders(&self) -> Vec<PathBuf> {
        self.job.choice.folders().cloned().collect()
    }

    /// Sources for textures: with their content if they are copied, otherwise with their presence alone; and the images
    /// that new textures are baked from, wherever they were found.
    fn textures(&self, catalogue: &Catalogue) -> Result<Vec<Source>> {
        let brings_outside = self.job.brings_outside();
        let (named, known) = (write::named_textures(catalogue, brings_outside), Contents::default());
        let baked = if self.job.options.bakes() { baked_images(self.job, catalogue) } else { Vec::new() };
        let mut sources = Vec::with_capacity(named.len() + baked.len());
        let source_of = |texture: TextureSource| {
            self.progress.check_stopped()?;
            match texture {
                TextureSource::Baked(path) => Source::anywhere(&path, &known),
                TextureSource::Named(texture) => {
                    let is_copied = self.job.options.textures == TextureFiles::Copy && !texture.stays;
                    if is_copied && brings_outside {
                        Source::anywhere(&texture.path, &known)
                    } else if is_copied {
                        Source::inside(&texture.folder, &texture.path, &known)
                    } else {
                        Source::presence(&texture.path)
                    }
                }
            }
        };
        let all = named.into_iter().map(TextureSource::Named).chain(baked.into_iter().map(TextureSource::Baked));
        map_in_order(all, self.scan.threads, 4 * self.scan.threads, source_of, |source| {
            sources.push(source);
            Ok(())
        })?;
        Ok(sources)
    }
}

/// A texture that a result may depend on.
enum TextureSource {
    /// A material names it.
    Named(NamedTexture),
    /// New textures show it.
    Baked(PathBuf),
}

/// The error for an input of which no triangle is left.
pub(super) fn nothing_left(job: &Preflight<'_>, input: &Input) -> Error {
    let why = match (job.kind, job.options.pieces) {
        (OutputKind::Folder, _) => "every triangle repeats a vertex once those at the same place are one",
        (_, Pieces::Keep) => {
            "every triangle repeats a vertex once those at the same place are one; `weld: off` keeps them apart"
        }
        (_, Pieces::Drop) => {
            "every triangle belongs to a small piece or repeats a vertex; `pieces: keep` keeps the pieces"
        }
    };
    Error::input(job.choice.name(), 0, format!("of {} none is left: {why}", counted(input.triangles, "triangle")))
}

fn libraries_at<'a>(paths: impl Iterator<Item = &'a Path>) -> Result<Vec<Source>> {
    let known = Contents::default();
    paths.map(|path| Source::library(path, &known)).collect()
}

impl Input {
    /// The files that the result follows from.
    pub(super) fn sources(&self) -> Sources {
        let beside = self.libraries.iter().chain(&self.textures).map(|source| source.path.as_path());
        Sources::new(self.catalogue.files.iter().map(PathBuf::as_path).chain(beside))
    }

    /// Compares textures as they were copied with their content when the job began, if they are to be copied.
    ///
    /// # Errors
    /// [`Error::Changed`] naming the first that differs.
    pub(super) fn check_textures(&self, staged: &Staged, brings_outside: bool) -> Result<()> {
        let named = write::named_textures(&self.catalogue, brings_outside);
        let hashed = named.iter().zip(&self.textures).filter(|(texture, _)| !texture.stays).map(|(_, source)| source);
        let mut known = HashMap::new();
        for source in hashed {
            if source.content.is_some() && staged.left_out_textures().contains(&source.path) {
                return Err(fingerprint::changed(&source.path, "is missing now"));
            }
            let path = source.path.canonicalize().unwrap_or_else(|_| source.path.clone());
            // Of two names, the one that leads out of its folder may be refused.
            let content = known.entry(path).or_insert(source.content);
            *content = content.or(source.content);
        }
        let copied = staged.copied_textures();
        match copied.iter().find(|(path, content)| known.get(path).is_some_and(|known| *known != Some(*content))) {
            Some((path, _)) => Err(fingerprint::changed(path, "has changed")),
            None => Ok(()),
        }
    }
}
