//! What a run did, for scripts (JSON) and for people (a few lines).

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::base::error::escape_path;
use crate::base::{Error, Result, bytes};
use crate::os::durable::DurableFile;
use crate::stitch::outcome::{Floor, PassReport};

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// The target was met.
    Done,
    /// The result was written, with more faces than asked for.
    TargetMissed,
}

/// Numbers of triangles.
#[derive(Debug, Clone, Serialize)]
pub struct FaceFigures {
    /// Of the input, after triangulation.
    pub input: u64,
    /// Asked for.
    pub target: u64,
    /// Of the result.
    pub output: u64,
}

/// What the cost function says of the error.
#[derive(Debug, Clone, Serialize)]
pub struct ErrorFigures {
    /// Highest cost of a collapse in the last pass, in area × length².
    pub threshold: f64,
    /// Estimate of the root of the mean squared deviation, in the mesh's unit of length.
    pub rms_estimate: f64,
}

/// Times of the phases in seconds.
#[derive(Debug, Clone, Serialize)]
pub struct SecondFigures {
    /// Of the whole run.
    pub total: f64,
    /// Reading the input.
    pub scan: f64,
    /// Cutting, in all passes.
    pub partition: f64,
    /// Simplifying in the first pass.
    pub simplify: f64,
    /// Simplifying in the passes after it.
    pub stitch: f64,
    /// Writing the result.
    pub write: f64,
}

/// Memory in bytes.
#[derive(Debug, Clone, Serialize)]
pub struct MemoryFigures {
    /// What the user allowed.
    pub budget: u64,
    /// What the formulas say.
    pub predicted_peak: u64,
    /// What the system measured.
    pub peak_resident: u64,
}

/// Bytes moved.
#[derive(Debug, Clone, Serialize)]
pub struct IoFigures {
    /// Length of the OBJ input.
    pub input: u64,
    /// Read by system calls.
    pub read: u64,
    /// Written by system calls.
    pub written: u64,
    /// Most that the work folder held.
    pub scratch_peak: u64,
}

/// Everything about a run.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// How it ended.
    pub status: Status,
    /// The OBJ that was written.
    pub output: PathBuf,
    /// Triangles.
    pub faces: FaceFigures,
    /// Error.
    pub error: ErrorFigures,
    /// Time.
    pub seconds: SecondFigures,
    /// Memory.
    pub memory: MemoryFigures,
    /// Input and output.
    pub io: IoFigures,
    /// Each pass.
    pub passes: Vec<PassReport>,
    /// What stands in the way of the target, if it was missed.
    pub floor: Option<Floor>,
    /// What was repaired or dropped, by kind.
    pub repairs: BTreeMap<String, u64>,
    /// The same in words, where there are words.
    pub warnings: Vec<String>,
}

impl Report {
    /// Exit code of the process: 0, or 3 if the target was missed.
    pub fn exit_code(&self) -> u8 {
        match self.status {
            Status::Done => 0,
            Status::TargetMissed => 3,
        }
    }

    /// Writes the report as JSON.
    ///
    /// # Errors
    /// [`Error::Usage`] for another extension than `.json`; the file system's.
    pub fn save(&self, path: &Path) -> Result<()> {
        check_path(path)?;
        let text = serde_json::to_string_pretty(self)
            .map_err(|e| Error::Damaged { path: path.to_owned(), message: e.to_string() })?;
        let mut file = DurableFile::create(path, 4096)?;
        file.write(text.as_bytes())?;
        file.write(b"\n")?;
        file.commit()?;
        Ok(())
    }

    /// The closing words of a run.
    pub fn summary(&self) -> String {
        let mut text = String::new();
        let share = 100.0 * self.faces.output as f64 / self.faces.input.max(1) as f64;
        let (input, output) = (grouped(self.faces.input), grouped(self.faces.output));
        let _ = writeln!(text, "{input} -> {output} triangles ({share:.3} %) in {}", escape_path(&self.output));
        let _ = writeln!(
            text,
            "{:.1} s, {} peak memory of {} allowed, deviation about {:.3e} (RMS, in the mesh's units)",
            self.seconds.total,
            bytes::display(self.memory.peak_resident),
            bytes::display(self.memory.budget),
            self.error.rms_estimate,
        );
        for (kind, count) in &self.repairs {
            let _ = writeln!(text, "{}: {}", kind.replace('_', " "), grouped(*count));
        }
        for warning in &self.warnings {
            let _ = writeln!(text, "warning: {warning}");
        }
        if let Some(floor) = &self.floor {
            let _ = writeln!(
                text,
                "the target of {} triangles was missed: no legal collapse is left; vertices on borders: {}, on seams: {}, \
                 at non-manifold places: {}; refused to keep the topology: {}, to keep pieces: {}",
                grouped(self.faces.target),
                grouped(floor.border),
                grouped(floor.seam),
                grouped(floor.non_manifold),
                grouped(floor.topology),
                grouped(floor.pieces),
            );
        }
        text
    }
}

/// Refuses a report file of an unknown kind.
///
/// # Errors
/// [`Error::Usage`].
pub fn check_path(path: &Path) -> Result<()> {
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("json") => Ok(()),
        _ => Err(Error::Usage(format!("--report {}: expected a name that ends in .json", escape_path(path)))),
    }
}

/// A number with a blank before every three digits: `16 609 988`.
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_numbers_are_grouped() {
        assert_eq!(grouped(16_609_988), "16 609 988");
        assert_eq!(grouped(999), "999");
    }
}
