//! The closing words of a run, for the terminal.

use std::fmt::Write as _;

use super::Report;
use super::figures::length;
use crate::base::error::escape_path;
use crate::base::{bytes, counted, grouped};

impl Report {
    /// The closing words of a run.
    pub fn summary(&self) -> String {
        let mut text = String::new();
        let share = 100.0 * self.faces.output as f64 / self.faces.input.max(1) as f64;
        let (input, output) = (grouped(self.faces.input), grouped(self.faces.output));
        let _ = writeln!(text, "{input} -> {output} triangles ({share:.3} %) in {}", escape_path(&self.output));
        let _ = writeln!(
            text,
            "{:.1} s, {} peak memory of {} allowed, deviation about {} (RMS, in the mesh's units)",
            self.seconds.total,
            bytes::display(self.memory.peak_resident),
            bytes::display(self.memory.budget),
            length(self.error.rms_estimate),
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
                "the target of {} was missed: no legal collapse is left\n\
                 what holds the rest: {} on borders, {} on seams, {} at non-manifold places; {} refused to keep the \
                 topology, {} to keep pieces",
                counted(self.faces.target, "triangle"),
                grouped(floor.border) + if floor.border == 1 { " vertex" } else { " vertices" },
                grouped(floor.seam),
                grouped(floor.non_manifold),
                counted(floor.topology, "edge"),
                grouped(floor.pieces),
            );
        }
        text
    }
}
