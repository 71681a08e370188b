//! The input of a job: scanned, or read back from an earlier process and compared with the files.
//!
//! In: the mesh files, the work folder. Out: what the input holds beside geometry, and where the passes begin.
//! Invariant: a result of an earlier process is used only after the content of every file that it follows from was
//! compared.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use serde::{Deserialize, Serialize};

use super::damage::report_damage;
use super::need::{COUNT_LIMIT, Need};
use crate::base::ordered::map_in_order;
use crate::base::{Error, Findings, Progress, Result, counted};
use crate::job::{Manifest, Step, WorkFolder, folder_bytes};
use crate::model::Catalogue;
use crate::options::{Pieces, SimplifyOptions, TextureFiles, TexturesOutside};
use crate::passes::Start;
use crate::read::fingerprint::{self, Contents, Source};
use crate::read::{self, InputChoice, Scan, ScanOptions};
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
    pub(super) need: Need,
    /// Hash of each mesh file.
    content_hashes: Vec<u64>,
    /// Material libraries.
    libraries: Vec<Source>,
    /// Textures.
    textures: Vec<Source>,
}

/// Reads the input of a job.
pub(super) struct Reading<'a> {
    /// Inputs that the user named.
    pub(super) choice: &'a InputChoice,
    /// When the process began.
    pub(super) began: SystemTime,
    /// Mesh files.
    pub(super) inputs: &'a [PathBuf],
    /// Patterns of the choice that exclude nothing.
    pub(super) idle: &'a Findings,
    /// Manifest of the job.
    pub(super) manifest: &'a Manifest,
    /// Options of the job.
    pub(super) options: &'a SimplifyOptions,
    /// How the scan uses the machine.
    pub(super) scan: ScanOptions,
    /// Receives the progress.
    pub(super) progress: &'a dyn Progress,
}

impl Reading<'_> {
    /// Resumes the job in the work folder, or scans the input.
    ///
    /// # Errors
    /// [`Error::Changed`](crate::base::Error::Changed) if the input has changed since the job began; those of the scan.
    pub(super) fn begin(&self, job: &mut WorkFolder) -> Result<(Input, Start)> {
        let recalled = if job.is_resumed() { Some(self.recall(job)?) } else { None };
        report_damage(job, self.progress);
        if let Some(recalled) = recalled {
            if let Some((input, start)) = recalled {
                self.progress.tell(&start.kept(job));
                return Ok((input, start));
            }
            job.restart(self.manifest)?;
        }
        self.scan(job)
    }

    fn recall(&self, job: &WorkFolder) -> Result<Option<(Input, Start)>> {
        let accept = |input: &mut Input| {
            (input.catalogue.files, input.catalogue.folders) = (self.inputs.to_vec(), self.folders());
            input.catalogue.is_sound()
                && input.need.is_sound()
                && input.triangles.max(input.bytes) < COUNT_LIMIT
                && input.findings.are_plain()
        };
        let Some(input) = job.recall_if(Step::Input, accept)? else { return Ok(None) };
        self.progress.begin("compare", input.bytes, "B");
        let hashes = fingerprint::content_hashes(self.inputs, self.scan.threads, self.progress)?;
        for (path, (old, new)) in self.inputs.iter().zip(input.content_hashes.iter().zip(hashes)) {
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
                return Err(fingerprint::changed(self.choice.name(), "names libraries or textures in other places"));
            }
            all.extend(pairs());
        }
        for (old, new) in all {
            if let Some(what) = old.difference(new) {
                return Err(fingerprint::changed(&old.path, what));
            }
        }
        Ok(Start::recall(job, &input.catalogue, self.options.cluster_faces)?.map(|start| (input, start)))
    }

    fn scan(&self, job: &WorkFolder) -> Result<(Input, Start)> {
        let scanned = read::scan(self.inputs, job.path(), &self.scan, self.progress)?;
        let Scan { mesh, mut catalogue, triangles, findings, input_bytes, content_hashes, libraries } = scanned;
        catalogue.folders = self.folders();
        let textures = self.textures(&catalogue)?;
        let libraries = libraries_at(libraries.iter().map(PathBuf::as_path))?;
        let need = Need::of(&mesh, &catalogue);
        let input =
            Input { catalogue, triangles, findings, bytes: input_bytes, need, content_hashes, libraries, textures };
        job.keep(Step::Input, triangles, [], &input)?;
        job.keep(Step::Scan, triangles, mesh.files(), &mesh)?;
        let mut start = Start::from(mesh);
        start.state.scratch_peak = folder_bytes(job.path());
        Ok((input, start))
    }

    /// The folders that were given as input.
    fn folders(&self) -> Vec<PathBuf> {
        self.choice.folders().cloned().collect()
    }

    /// Sources for textures: with their content if they are copied, otherwise with their presence alone.
    fn textures(&self, catalogue: &Catalogue) -> Result<Vec<Source>> {
        let brings_outside = self.options.textures_outside == TexturesOutside::Copy;
        let (named, known) = (write::named_textures(catalogue, brings_outside), Contents::default());
        let mut sources = Vec::with_capacity(named.len());
        let look = |texture: NamedTexture| {
            self.progress.check_stopped()?;
            let is_copied = self.options.textures == TextureFiles::Copy && !texture.stays;
            if is_copied && brings_outside {
                Source::anywhere(&texture.path, &known)
            } else if is_copied {
                Source::inside(&texture.folder, &texture.path, &known)
            } else {
                Source::presence(&texture.path)
            }
        };
        map_in_order(named.into_iter(), self.scan.threads, 4 * self.scan.threads, look, |source| {
            sources.push(source);
            Ok(())
        })?;
        Ok(sources)
    }
}

/// The error for an input of which no triangle is left.
pub(super) fn nothing_left(path: &Path, triangles: u64, options: &SimplifyOptions) -> Error {
    let why = match options.pieces {
        Pieces::Keep => {
            "every triangle repeats a vertex once those at the same place are one; --weld off keeps them apart"
        }
        Pieces::Drop => "every triangle belongs to a small piece or repeats a vertex; --pieces keep keeps the pieces",
    };
    Error::input(path, 0, format!("of {} none is left: {why}", counted(triangles, "triangle")))
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
    /// [`Error::Changed`](crate::base::Error::Changed) naming the first that differs.
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
