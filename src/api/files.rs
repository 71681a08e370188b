//! Simplifies a mesh of any size, from files to a file.

use std::path::{Path, PathBuf};

use crate::base::{Progress, Result};
use crate::options::{JobOptions, SimplifyOptions, Target};
use crate::pipeline;
use crate::read::InputChoice;
use crate::report::Report;

/// A run from files to a file, within a memory budget.
///
/// ```
/// use drystone::{Silent, Simplify};
///
/// # let folder = tempfile::tempdir().unwrap();
/// # let output = folder.path().join("sphere.obj");
/// let report = Simplify::new("fixtures/miniatures/closed_sphere.obj")
///     .to(&output)
///     .ratio(0.1)
///     .memory(512 << 20)
///     .run(&Silent)?;
/// assert_eq!(report.faces.output, report.faces.target);
/// # Ok::<(), drystone::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Simplify {
    input: InputChoice,
    output: PathBuf,
    options: SimplifyOptions,
}

impl Simplify {
    /// A run over a file, or over all files in and below a folder, which it joins. The result goes to `simplified.obj`
    /// in the current folder unless [`to`](Self::to) names another.
    pub fn new(input: impl AsRef<Path>) -> Self {
        Self {
            input: input.as_ref().into(),
            output: PathBuf::from("simplified.obj"),
            options: SimplifyOptions::default(),
        }
    }

    /// A run over several files and folders, which it joins.
    pub fn of_all<P: Into<PathBuf>>(inputs: impl IntoIterator<Item = P>) -> Self {
        let paths = inputs.into_iter().map(Into::into).collect();
        Self { input: InputChoice { paths, exclude: Vec::new() }, ..Self::new("") }
    }

    /// Leaves out files and folders of an input folder whose name, or path from that folder on, matches a pattern such
    /// as `*_lod*`.
    #[must_use]
    pub fn exclude(mut self, pattern: impl Into<String>) -> Self {
        self.input.exclude.push(pattern.into());
        self
    }

    /// File to write; the ending names the format. Materials and textures go beside it.
    #[must_use]
    pub fn to(self, output: impl AsRef<Path>) -> Self {
        Self { output: output.as_ref().to_owned(), ..self }
    }

    /// Keep this share of the triangles, above 0 and up to 1.
    #[must_use]
    pub fn ratio(self, ratio: f64) -> Self {
        self.with(|options| options.target.faces = Target::ratio(ratio).faces)
    }

    /// Keep this number of triangles.
    #[must_use]
    pub fn faces(self, count: u64) -> Self {
        self.with(|options| options.target.faces = Target::faces(count).faces)
    }

    /// Largest distance between result and input, both ways, in the mesh's unit of length. With a number of triangles,
    /// the run stops at the limit that it reaches first.
    #[must_use]
    pub fn max_error(self, length: f64) -> Self {
        self.with(|options| options.target.max_error = Some(length))
    }

    /// Memory in bytes, at least 128 MiB. Half of the machine's or cgroup's unless given.
    ///
    /// The budget is what the library allocates. With glibc, freed memory may stay with the process; a program that
    /// must stay within a hard limit calls [`return_freed_memory`](crate::return_freed_memory) at its start.
    #[must_use]
    pub fn memory(self, bytes: u64) -> Self {
        self.with(|options| options.limits.memory = Some(bytes))
    }

    /// Threads; one per processor unless given. The result does not depend on them.
    #[must_use]
    pub fn threads(self, count: usize) -> Self {
        self.with(|options| options.limits.threads = Some(count))
    }

    /// Intermediate files, and what may be replaced.
    #[must_use]
    pub fn job(self, job: JobOptions) -> Self {
        self.with(|options| options.job = job)
    }

    /// Changes any option.
    #[must_use]
    pub fn with(mut self, change: impl FnOnce(&mut SimplifyOptions)) -> Self {
        change(&mut self.options);
        self
    }

    /// The options as they are now.
    pub fn options(&self) -> &SimplifyOptions {
        &self.options
    }

    /// Simplifies. A call that was stopped or killed is resumed by the same call.
    ///
    /// # Errors
    /// See [`Error`](crate::Error). A missed target is none: [`Report::status`] says so. Whatever happens, an older
    /// output stays whole until the new one is complete.
    pub fn run(&self, progress: &dyn Progress) -> Result<Report> {
        pipeline::simplify(self.input.clone(), &self.output, &self.options, progress)
    }
}
