//! Reports a run, for scripts (JSON) and for people (a few lines, a page).
//!
//! ```text
//! Report ──summary──▶ lines on the terminal
//!        ──save─────▶ report.json
//!                     report.html ◀── plots (SVG)
//! ```
//! In: the figures of the phases. Out: text. Invariant: all text from outside (paths, names) is escaped, and the page
//! loads nothing: style, plots and renderings are inside it.

#[cfg(feature = "report")]
mod comparison;
mod deviation;
mod file;
#[cfg(feature = "report")]
pub mod gallery;
#[cfg(feature = "report")]
mod html;
#[cfg(feature = "report")]
mod key_figures;
#[cfg(feature = "report")]
mod markup;
mod numbers;
#[cfg(feature = "report")]
mod plots;
mod run;
#[cfg(feature = "report")]
pub mod scene;
mod summary;
#[cfg(feature = "images")]
mod tile;

use std::path::Path;

#[cfg(feature = "report")]
pub use self::comparison::ComparisonPage;
pub use self::file::{ReportKind, save_json};
pub use self::run::{
    BakeFigures, ErrorFigures, FaceFigures, FileFigures, IoFigures, MemoryFigures, Report, SecondFigures, Status,
};
pub use self::summary::warning_lines;
#[cfg(feature = "images")]
pub use self::tile::{LevelFigures, TileReport};
pub use crate::measure::figures;
pub use crate::measure::gauge::Gauged;
pub use crate::os::timeline::{PhaseSpan, Sample, Timeline};
pub use crate::passes::outcome::StageReport;
pub use crate::passes::{Floor, PassReport, RemeshReport};
pub use crate::simplify::Changes;

use self::file::{json, save_text};
#[cfg(not(feature = "report"))]
use crate::base::Error;
use crate::base::Result;

impl Report {
    /// Writes the report as JSON or as a page, by the extension of `path`, for the job of this number.
    ///
    /// # Errors
    /// [`Error::Usage`](crate::base::Error::Usage) for an extension other than `.json` or `.html`; the file system's.
    pub fn save(&self, path: &Path, job: u64) -> Result<()> {
        match ReportKind::of(path)? {
            #[cfg(feature = "report")]
            ReportKind::Html => save_text(&html::page(self), path, job),
            #[cfg(not(feature = "report"))]
            ReportKind::Html => Err(Error::Usage("pages need the feature `report` of the crate".into())),
            ReportKind::Json => save_text(&json(self, path)?, path, job),
        }
    }
}
