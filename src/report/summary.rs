//! The end of a run's output: a summary for stdout, warnings and a missed target for stderr.

use std::fmt::Write as _;

use super::numbers::length;
use super::run::{Report, Status};
use crate::base::error::escape_path;
use crate::base::{bytes, counted, grouped};
use crate::options::{Borders, Doubles, Pieces, Seams, SimplifyOptions, Weld};
use crate::passes::Floor;
use crate::passes::outcome::StageReport;
use crate::simplify::Changes;

/// Maximum number of characters of a warning line; the report has the rest. Two names of the input, each cut by
/// [`escape`](crate::base::error::escape) after 200, and a reason fit.
const LINE_CHARACTERS: usize = 600;
/// Maximum number of warning lines of one kind; the report has the rest.
const LINES_PER_KIND: usize = 3;
/// Growth of the error that counts as a leap, as a multiple of that of a smooth surface.
const LEAP: f64 = 3.0;

/// The changes of the topology, as pairs of key and text.
pub(super) fn changes(made: &Changes) -> impl Iterator<Item = (&'static str, String)> {
    let counts = [
        ("holes closed", made.holes_closed),
        ("handles cut", made.handles_cut),
        ("pieces dropped", made.pieces_dropped),
        ("border vertices welded", made.vertices_welded),
        ("non-manifold vertices resolved", made.complex_resolved),
        ("triangles forced out", made.faces_forced),
    ];
    let area = (made.pieces_area > 0.0).then(|| ("area of the pieces dropped", length(made.pieces_area)));
    counts.into_iter().filter(|(_, count)| *count > 0).map(|(name, count)| (name, count.to_string())).chain(area)
}

impl Report {
    /// The summary, a line for each figure: `key: value`, numbers without blanks.
    pub fn summary(&self) -> String {
        let mut text = String::new();
        let share = 100.0 * self.faces.output as f64 / self.faces.input.max(1) as f64;
        let status = match self.status {
            _ if self.broken_bound().is_some() => "bound-broken",
            Status::Done => "done",
            Status::TargetMissed => "target-missed",
        };
        let _ = writeln!(text, "status: {status}");
        let _ = writeln!(text, "output: {}", escape_path(&self.output));
        let _ = writeln!(text, "triangles: {}", self.faces.output);
        let _ = writeln!(text, "triangles before: {}", self.faces.input);
        let _ = writeln!(text, "share: {share:.3}%");
        let _ = writeln!(text, "seconds: {:.1}", self.seconds.total);
        if let Some(peak) = self.memory.peak_resident {
            let _ = writeln!(text, "peak memory: {}", bytes::display(peak));
        }
        let _ = writeln!(text, "memory allowed: {}", bytes::display(self.memory.budget));
        self.add_deviation(&mut text);
        for (name, count) in changes(&self.topology) {
            let _ = writeln!(text, "{name}: {count}");
        }
        if let Some(share) = self.new_texture_below {
            let _ = writeln!(text, "use --textures bake below: {:.2}%", 100.0 * share);
        }
        for (kind, count) in &self.repairs {
            let _ = writeln!(text, "{}: {count}", kind.replace('_', " "));
        }
        text
    }

    /// The warnings for a terminal: a few of each kind, each a line of at most 600 characters.
    pub fn warning_lines(&self) -> Vec<String> {
        warning_lines(&self.warnings, "--report FILE.json or FILE.html lists them")
    }

    /// Lines that say where the run stopped above its target, what holds it there and which options would free it, or
    /// that only forced collapses met the target; none if others did.
    pub fn target_lines(&self) -> Vec<String> {
        let Some(floor) = &self.floor else { return self.forced_line().into_iter().collect() };
        let vertices = if floor.border == 1 { "vertex" } else { "vertices" };
        let share = |faces: u64| 100.0 * faces as f64 / self.faces.input.max(1) as f64;
        let mut lines = vec![
            format!(
                "stopped at {:.2} % ({}): the target of {} cannot be reached: every edge that is left is locked, or \
                 its collapse would damage the mesh or move the surface far",
                share(self.faces.output),
                counted(self.faces.output, "triangle"),
                counted(self.faces.target, "triangle"),
            ),
            format!(
                "what holds the rest: {} {vertices} on borders, {} on seams, {} at non-manifold places; {} refused to \
                 keep the topology, {} to keep pieces",
                grouped(floor.border),
                grouped(floor.seam),
                grouped(floor.non_manifold),
                counted(floor.topology, "edge"),
                grouped(floor.pieces),
            ),
        ];
        let stages: Vec<_> = self.passes.iter().flat_map(|pass| &pass.stages).collect();
        lines.push(match last_sensible(&stages) {
            Some([before, after]) => format!(
                "with fewer than {:.2} % of the triangles, the estimated RMS error jumps from {} to {}: the lowest \
                 sensible target is about --ratio {:.4}",
                share(before.faces),
                length(before.rms_estimate),
                length(after.rms_estimate),
                share(before.faces) / 100.0,
            ),
            None => format!("the lowest sensible target is about --ratio {:.4}", share(self.faces.output) / 100.0),
        });
        lines.extend(self.ways_out(floor));
        lines
    }

    fn forced_line(&self) -> Option<String> {
        let forced = self.topology.faces_forced;
        let least = (self.faces.output + forced) as f64 / self.faces.input.max(1) as f64;
        (forced > 0).then(|| {
            format!(
                "the last {} went by collapses that may fold triangles or turn them over: the lowest sensible target \
                 is about --ratio {least:.4}",
                counted(forced, "triangle"),
            )
        })
    }

    /// Options to type to free the vertices and edges that hold the mesh above its target.
    fn ways_out(&self, floor: &Floor) -> Vec<String> {
        ways_out(&self.options, floor, self.repairs.get("welded_vertices").copied().unwrap_or(0))
    }
}

/// Options to type to free what holds a mesh; `welded` of its vertices were joined with others.
fn ways_out(options: &SimplifyOptions, floor: &Floor, welded: u64) -> Vec<String> {
    let is_simplified = options.metric.is_none();
    let ways = [
        (floor.border, options.borders == Borders::Lock, "--borders simplify", "vertices on borders"),
        (floor.seam, is_simplified && options.seams == Some(Seams::Lock), "--seams stitch", "vertices on seams"),
        (
            // Where no vertices were joined, none can come apart.
            floor.non_manifold.min(welded),
            options.weld == Weld::Exact,
            "--weld off",
            "vertices at non-manifold places, if only \
              equal positions join the faces there",
        ),
        (floor.doubles, options.doubles == Doubles::Keep, "--doubles drop", "copies and back sides of faces"),
        (floor.pieces, options.pieces == Pieces::Keep, "--pieces drop", "edges of small components"),
    ];
    let is_way = |way: &&(u64, bool, &str, &str)| way.0 > 0 && way.1;
    let words = |(count, _, option, what): &(u64, bool, &str, &str)| {
        format!("{option} would free up to {} {what}", grouped(*count))
    };
    ways.iter().filter(is_way).map(words).collect()
}

/// The first two consecutive stages between which the error leaps: it grows more than [`LEAP`] times as fast as on a
/// smooth surface, where the distance is inversely proportional to the number of faces.
fn last_sensible<'a>(stages: &[&'a StageReport]) -> Option<[&'a StageReport; 2]> {
    let leaps = |pair: &&[&StageReport]| {
        let fewer = pair[0].faces as f64 / pair[1].faces.max(1) as f64;
        pair[0].rms_estimate > 0.0 && pair[1].rms_estimate > LEAP * fewer * pair[0].rms_estimate
    };
    stages.windows(2).find(leaps).map(|pair| [pair[0], pair[1]])
}

/// Lines `warning: kind: place`, a few of each kind, each of at most 600 characters; then a line that says that there
/// are more, and which option lists them.
pub fn warning_lines(warnings: &[String], way: &str) -> Vec<String> {
    let kind_of = |line: &String| line.split(':').next().unwrap_or_default().to_owned();
    let mut lines = Vec::new();
    for group in warnings.chunk_by(|a, b| kind_of(a) == kind_of(b)) {
        let told = if group.len() > LINES_PER_KIND + 1 { LINES_PER_KIND } else { group.len() };
        lines.extend(group[..told].iter().map(|line| clipped(&format!("warning: {line}"))));
        if told < group.len() {
            let kind = kind_of(&group[0]);
            lines.push(clipped(&format!("warning: {kind}: and more; {way}")));
        }
    }
    lines
}

/// A line shortened in its middle if it is too long: files stand at its beginning, reasons at its end.
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
    fn the_lowest_sensible_target_is_where_the_error_leaps() {
        let stage = |faces, rms_estimate| StageReport { faces, threshold: 0.0, rms_estimate };
        let stages = [stage(1000, 0.1), stage(500, 0.2), stage(250, 0.5), stage(200, 9.0), stage(100, 90.0)];
        let stages: Vec<_> = stages.iter().collect();
        assert_eq!(last_sensible(&stages).unwrap().map(|stage| stage.faces), [250, 200]);
        assert!(last_sensible(&stages[..3]).is_none());
    }

    #[test]
    fn welding_is_left_out_only_where_vertices_were_joined() {
        let floor = Floor { non_manifold: 90, ..Floor::default() };
        let ways = |welded| ways_out(&SimplifyOptions::default(), &floor, welded);
        assert_eq!(ways(0), [""; 0]);
        assert!(ways(7)[0].starts_with("--weld off would free up to 7 vertices"), "{:?}", ways(7));
    }

    #[test]
    fn a_few_warnings_of_each_kind_are_printed() {
        let mut warnings: Vec<_> = (0..20).map(|line| format!("degenerate faces: a.obj:{line}")).collect();
        warnings.push("degenerate faces: and 4 more".to_owned());
        warnings.push("missing texture: roof.jpg is not there".to_owned());
        let lines = warning_lines(&warnings, "--report lists them");
        assert_eq!(lines.len(), LINES_PER_KIND + 2);
        assert_eq!(lines[0], "warning: degenerate faces: a.obj:0");
        assert!(lines[LINES_PER_KIND].contains("--report"));
        assert_eq!(lines[LINES_PER_KIND + 1], "warning: missing texture: roof.jpg is not there");
    }

    #[test]
    fn files_that_fill_the_same_space_are_named_by_whole_paths() {
        let [one, other] = ["a", "b"].map(|name| format!("/{}/{name}.obj", "a folder of scans/".repeat(10)));
        let line = format!("doubled surface: {one} and {other} fill the same space: if one is a copy, leave it out");
        assert_eq!(warning_lines(std::slice::from_ref(&line), "--json lists them"), [format!("warning: {line}")]);
    }

    proptest! {
        #[test]
        fn no_line_has_more_than_600_characters(text in ".{0,1000}") {
            let line = clipped(&text);
            prop_assert!(line.chars().count() <= LINE_CHARACTERS);
            prop_assert!(text.chars().count() > LINE_CHARACTERS || line == text);
        }
    }
}
