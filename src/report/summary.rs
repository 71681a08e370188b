//! The closing words of a run: a summary for stdout, warnings and a missed target for stderr.

use std::fmt::Write as _;

use super::Report;
use crate::base::error::escape_path;
use crate::base::{bytes, counted, grouped};

/// Characters of a line of warning, at most; the report has the rest.
const LINE_CHARACTERS: usize = 200;
/// Lines of warning of one kind, at most; the report has the rest.
const LINES_PER_KIND: usize = 3;

impl Report {
    /// The summary, a line for each figure: `key: value`, numbers without blanks.
    pub fn summary(&self) -> String {
        let mut text = String::new();
        let share = 100.0 * self.faces.output as f64 / self.faces.input.max(1) as f64;
        let _ = writeln!(text, "output: {}", escape_path(&self.output));
        let _ = writeln!(text, "triangles: {}", self.faces.output);
        let _ = writeln!(text, "triangles before: {}", self.faces.input);
        let _ = writeln!(text, "share: {share:.3}%");
        let _ = writeln!(text, "seconds: {:.1}", self.seconds.total);
        let _ = writeln!(text, "peak memory: {}", bytes::display(self.memory.peak_resident));
        let _ = writeln!(text, "memory allowed: {}", bytes::display(self.memory.budget));
        self.add_deviation(&mut text);
        for (kind, count) in &self.repairs {
            let _ = writeln!(text, "{}: {count}", kind.replace('_', " "));
        }
        text
    }

    /// The warnings for a terminal: a few of each kind, each a line of at most 200 characters.
    pub fn warning_lines(&self) -> Vec<String> {
        warning_lines(&self.warnings)
    }

    /// What holds the mesh above its target, if it was missed; no line otherwise.
    pub fn miss_lines(&self) -> Vec<String> {
        let Some(floor) = &self.floor else { return Vec::new() };
        let vertices = if floor.border == 1 { "vertex" } else { "vertices" };
        vec![
            format!("the target of {} was missed: no legal collapse is left", counted(self.faces.target, "triangle")),
            format!(
                "what holds the rest: {} {vertices} on borders, {} on seams, {} at non-manifold places; {} refused to \
                 keep the topology, {} to keep pieces",
                grouped(floor.border),
                grouped(floor.seam),
                grouped(floor.non_manifold),
                counted(floor.topology, "edge"),
                grouped(floor.pieces),
            ),
        ]
    }
}

/// `warning: kind: place`, a few of each kind, each clipped; then how many more there are.
fn warning_lines(warnings: &[String]) -> Vec<String> {
    let kind_of = |line: &String| line.split(':').next().unwrap_or_default().to_owned();
    let mut lines = Vec::new();
    for group in warnings.chunk_by(|a, b| kind_of(a) == kind_of(b)) {
        let told = if group.len() > LINES_PER_KIND + 1 { LINES_PER_KIND } else { group.len() };
        lines.extend(group[..told].iter().map(|line| clipped(&format!("warning: {line}"))));
        if told < group.len() {
            let kind = kind_of(&group[0]);
            lines.push(clipped(&format!("warning: {kind}: and more; --report FILE.json or FILE.html lists them")));
        }
    }
    lines
}

/// A line without its middle if it is too long: files stand at its beginning, reasons at its end.
fn clipped(line: &str) -> String {
    let characters: Vec<char> = line.chars().collect();
    if characters.len() <= LINE_CHARACTERS {
        return line.to_owned();
    }
    let half = LINE_CHARACTERS / 2;
    let (head, tail) = (&characters[..half], &characters[characters.len() - (half - 1)..]);
    head.iter().chain(&['…']).chain(tail).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_few_warnings_of_each_kind_are_printed() {
        let mut warnings: Vec<_> = (0..20).map(|line| format!("degenerate faces: a.obj:{line}")).collect();
        warnings.push("degenerate faces: and 4 more".to_owned());
        warnings.push("missing texture: roof.jpg is not there".to_owned());
        let lines = warning_lines(&warnings);
        assert_eq!(lines.len(), LINES_PER_KIND + 2);
        assert_eq!(lines[0], "warning: degenerate faces: a.obj:0");
        assert!(lines[LINES_PER_KIND].contains("--report"));
        assert_eq!(lines[LINES_PER_KIND + 1], "warning: missing texture: roof.jpg is not there");
    }

    proptest! {
        #[test]
        fn no_line_has_more_than_200_characters(text in ".{0,600}") {
            let line = clipped(&text);
            prop_assert!(line.chars().count() <= LINE_CHARACTERS);
            prop_assert!(text.chars().count() > LINE_CHARACTERS || line == text);
        }
    }
}
