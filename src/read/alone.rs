//! Reads files one by one, so that several processes can, and joins what they read.
//!
//! Invariant: the files joined are what reading them in one go would give, but for the paths in findings: they are
//! those that the files were read at.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::builder::FinishedFile;
use super::flow::{FormatRun, ScanOptions};
use super::parts::Labels;
use super::source::{CHUNK_BYTES, MeshFormat};
use super::{Scan, Scanned};
use crate::base::{Allowance, Error, Findings, Progress, Result};
use crate::job::Recalled;
use crate::model::Catalogue;

/// No input has as many of anything.
pub const COUNT_LIMIT: u64 = 1 << 48;

/// What a file of the input holds.
#[derive(Debug, Serialize, Deserialize)]
pub struct ScannedFile {
    file: FinishedFile,
    /// Its parts, names and materials.
    catalogue: Catalogue,
    findings: Findings,
}

impl Recalled for ScannedFile {
    type Context<'a> = ();

    fn locate(&mut self, folder: &Path, (): &()) {
        self.file.piece.locate(folder);
        // Its own file is the only one.
        self.catalogue.files = vec![PathBuf::new()].into();
    }

    fn is_sound(&self, (): &()) -> bool {
        let FinishedFile { piece, triangles, bytes, .. } = &self.file;
        let counts = self.findings.iter().map(|(_, finding)| finding.count).chain([*triangles, *bytes]);
        piece.is_sound()
            && self.catalogue.is_sound()
            && self.findings.are_plain()
            && counts.max().is_none_or(|count| count < COUNT_LIMIT)
    }
}

impl ScannedFile {
    /// Reads the file at an index of the input into columns in `folder`.
    ///
    /// # Errors
    /// Those of [`scan`](super::scan).
    pub fn read(
        inputs: &[PathBuf],
        index: usize,
        folder: &Path,
        options: &ScanOptions,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let inputs = &inputs[index..=index];
        let mut labels = Labels::new(Allowance::new(options.catalogue_bytes));
        let (mut findings, mut finished) = (Findings::default(), None);
        let run =
            FormatRun { inputs, first_index: index, folder, options, mover: None, chunk_bytes: CHUNK_BYTES, progress };
        run.read_as(MeshFormat::of(&inputs[0])?, &mut labels, &mut findings, |file| finished = Some(file))?;
        let cut_short = || Error::input(&inputs[0], 0, "no end was found".to_owned());
        Ok(Self { file: finished.ok_or_else(cut_short)?, catalogue: labels.of_one_file(), findings })
    }

    /// Its column files.
    pub fn files(&self) -> Vec<PathBuf> {
        self.file.piece.files().map(Path::to_owned).collect()
    }
}

/// Joins what was read of the files of the input, in their order.
///
/// # Errors
/// Those of `files`; [`Error::Limit`] and [`Error::Budget`] as [`scan`](super::scan).
pub fn join(
    inputs: &[PathBuf],
    files: impl Iterator<Item = Result<ScannedFile>>,
    options: &ScanOptions,
) -> Result<Scan> {
    let mut labels = Labels::new(Allowance::new(options.catalogue_bytes));
    let mut scanned = Scanned::default();
    for (path, read) in inputs.iter().zip(files) {
        let ScannedFile { mut file, catalogue, findings } = read?;
        labels.begin_file(path);
        file.piece.faces.raise_parts(labels.adopt(catalogue)?.number());
        scanned.findings.merge(findings);
        scanned.keep(file);
    }
    Ok(scanned.finish(inputs, labels))
}
