//! The report as one page: nothing is loaded from anywhere, and all text is escaped by the template.

use maud::{Markup, html};

use super::gallery::png_address;
use super::key_figures::key_figures;
use super::markup::{self, plot, renderings, row};
use super::numbers::{length, percent, seconds, spaced, spaced_count};
use super::run::{Report, Status};
use super::{comparison, plots, summary};
use crate::base::bytes;
use crate::base::error::escape_path;
use crate::os::timeline::{PhaseSpan, Timeline};

/// The page.
pub(super) fn page(report: &Report) -> String {
    let title = report.output.file_name().map_or_else(String::new, |name| escape_path(name.as_ref()));
    let body = html! {
        (head(report, &title))
        (key_figures(report))
        (floor(report))
        @if let Some([before, after]) = &report.shots { (renderings(before, after)) }
        @if let Some(comparison) = &report.comparison {
            (comparison::body(comparison, report.shots.as_ref().map_or(&[], |[_, after]| after)))
        }
        (topology(report))
        (findings(report))
        (time(report))
        (passes(report))
        (asked(report))
    };
    markup::page(&title, &body, &format!(", {}", date(report.began)))
}

fn head(report: &Report, title: &str) -> Markup {
    html! {
        header {
            p.mark { "drystone simplify" }
            h1 { (title) }
            p.files { @for input in &report.inputs { code { (escape_path(input)) } " " } "→ " code { (escape_path(&report.output)) } }
            @match report.status {
                _ if report.broken_bound().is_some() => p.badge.bad { "bound broken" },
                Status::Done => p.badge.good { "target met" },
                Status::TargetMissed => p.badge.bad { "target missed" },
            }
        }
    }
}

/// Why the target was missed.
fn floor(report: &Report) -> Markup {
    let Some(floor) = &report.floor else { return html! {} };
    let over = report.faces.output.saturating_sub(report.faces.target);
    html! {
        section.alarm {
            h2 { "The target was missed by " (spaced_count(over, "triangle")) }
            p { "Every edge that is left is locked, or its collapse would damage the mesh or move the surface far. \
                What stands in the way:" }
            table {
                (row("vertices on open borders", &spaced(floor.border)))
                (row("vertices on texture seams", &spaced(floor.seam)))
                (row("vertices at non-manifold places", &spaced(floor.non_manifold)))
                (row("collapses refused to keep the topology", &spaced(floor.topology)))
                (row("collapses refused to keep whole pieces", &spaced(floor.pieces)))
            }
        }
    }
}

/// Changes of the topology.
fn topology(report: &Report) -> Markup {
    let changes: Vec<_> = summary::changes(&report.topology).collect();
    html! {
        section {
            h2 { "Topology" }
            @if changes.is_empty() {
                p { "No hole closed, no handle was cut, no piece vanished." }
            } @else {
                table {
                    @for (name, count) in &changes { (row(name, count)) }
                }
            }
            @if let Some(share) = report.new_texture_below {
                p {
                    "Below " (format!("{:.2} %", 100.0 * share)) " of the triangles, the seams of the texture need "
                    "more vertices than the mesh has: --textures bake gives a better image there."
                }
            }
        }
    }
}

/// What was repaired, dropped or noticed.
fn findings(report: &Report) -> Markup {
    let places = |kind: &str| -> Vec<&str> {
        let name = kind.replace('_', " ");
        report.warnings.iter().filter_map(|words| words.strip_prefix(&name)?.strip_prefix(": ")).collect()
    };
    let has_places = report.repairs.keys().any(|kind| !places(kind).is_empty());
    html! {
        section {
            h2 { "Warnings and repairs" }
            @if report.repairs.is_empty() {
                p { "Nothing was repaired or dropped while reading and writing." }
            } @else {
                table.narrow[!has_places] {
                    thead { tr { th { "Kind" } th.number { "Count" } @if has_places { th.wide { "Where" } } } }
                    tbody {
                        @for (kind, count) in &report.repairs {
                            tr {
                                th scope="row" { (kind.replace('_', " ")) }
                                td.number { (spaced(*count)) }
                                @if has_places { td.wide { @for place in places(kind) { div { (place) } } } }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn time(report: &Report) -> Markup {
    let timeline = &report.timeline;
    let total = report.seconds.total.max(1e-9);
    // The memory of a process that does other work, too, says nothing of this run.
    let peak = report.memory.peak_resident;
    html! {
        section {
            h2 { "Time, memory, and bytes moved" }
            div.strip {
                @for phase in &timeline.phases {
                    @let share = 100.0 * (phase.end - phase.begin) / total;
                    span.phase.(phase.name) style=(format!("width:{share:.3}%")) title=(phase.name) {}
                }
            }
            div.pair {
                @if peak.is_some() {
                    (plot(plots::memory(timeline, report.memory.budget), "Resident memory, mapped pages included"))
                }
                (plot(plots::moved(timeline), "Bytes read and written by system calls"))
            }
            table {
                thead {
                    tr {
                        th { "Phase" } th.number { "Time" } th.number { "Share" }
                        @if peak.is_some() { th.number { "Highest memory" } }
                        th.number { "Read" } th.number { "Written" }
                    }
                }
                tbody {
                    @for (phase, pass) in with_passes(&timeline.phases) {
                        @let stay = Stay::of(timeline, phase);
                        tr {
                            th scope="row" {
                                span.key.(phase.name) {}
                                (phase.name) @if let Some(pass) = pass { span.quiet { " · pass " (pass) } }
                            }
                            td.number { (seconds(phase.end - phase.begin)) }
                            td.number { (percent(100.0 * (phase.end - phase.begin) / total)) }
                            @if peak.is_some() { td.number { (bytes::display(stay.resident)) } }
                            td.number { (bytes::display(stay.read)) }
                            td.number { (bytes::display(stay.written)) }
                        }
                    }
                }
                tfoot {
                    tr {
                        th scope="row" { "whole run" }
                        td.number { (seconds(report.seconds.total)) }
                        td.number { }
                        @if let Some(peak) = peak { td.number { (bytes::display(peak)) } }
                        td.number { (bytes::display(report.io.read)) }
                        td.number { (bytes::display(report.io.written)) }
                    }
                }
            }
            p.quiet {
                "Predicted peak: " (bytes::display(report.memory.predicted_peak)) ". Work folder: at most "
                (bytes::display(report.io.scratch_peak)) ". Mapped files are read without system calls and are not among the bytes read."
                @if let Some(comparison) = &report.comparison {
                    " Comparing the result with the original took " (seconds(comparison.seconds)) " after that."
                }
            }
        }
    }
}

/// Memory and bytes of a phase, from the samples around it.
struct Stay {
    resident: u64,
    read: u64,
    written: u64,
}

impl Stay {
    fn of(timeline: &Timeline, phase: &PhaseSpan) -> Self {
        let samples = &timeline.samples;
        let first = samples.partition_point(|sample| sample.seconds < phase.begin).min(samples.len().saturating_sub(1));
        let last = samples.partition_point(|sample| sample.seconds < phase.end).min(samples.len().saturating_sub(1));
        match samples.get(first..=last) {
            Some(inside @ [begin, .., end]) => Self {
                resident: inside.iter().map(|sample| sample.resident).max().unwrap_or(0),
                read: end.read - begin.read,
                written: end.written - begin.written,
            },
            _ => Self { resident: samples.get(first).map_or(0, |sample| sample.resident), read: 0, written: 0 },
        }
    }
}

/// Phases with the number of the pass that they belong to.
fn with_passes(phases: &[PhaseSpan]) -> Vec<(&PhaseSpan, Option<usize>)> {
    let mut pass = 0;
    let number = |phase| match phase {
        &PhaseSpan { name: "partition", .. } => {
            pass += 1;
            (phase, Some(pass))
        }
        PhaseSpan { name: "simplify" | "stitch", .. } => (phase, Some(pass)),
        _ => (phase, None),
    };
    phases.iter().map(number).collect()
}

fn passes(report: &Report) -> Markup {
    html! {
        section {
            h2 { "Passes" }
            div.pair {
                (plot(plots::faces_against_error(&report.passes), "Triangles left and estimated deviation, stage by stage"))
                (plot(plots::faces_against_cost(&report.passes), "Triangles left and the dearest collapse of each stage"))
            }
            table {
                thead {
                    tr {
                        th { "Pass" } th.number { "Clusters" } th.number { "Triangles before" } th.number { "after" }
                        th.number { "Locked on cell borders" } th.number { "On seams" }
                        th.number { "Threshold" } th.number { "Deviation, estimated" }
                    }
                }
                tbody {
                    @for (number, pass) in report.passes.iter().enumerate() {
                        tr {
                            th scope="row" { (number + 1) }
                            td.number { (spaced(pass.clusters)) }
                            td.number { (spaced(pass.faces_in)) }
                            td.number { (spaced(pass.faces_out)) }
                            td.number { (spaced(pass.border_vertices)) }
                            td.number { (spaced(pass.seam_vertices)) }
                            td.number { (length(pass.threshold)) }
                            td.number { (pass.stages.last().map_or_else(String::new, |stage| length(stage.rms_estimate))) }
                        }
                    }
                }
            }
            (maps(report))
            p.quiet {
                "Threshold: highest cost of a collapse (area × length²). Deviation: what the cost function says has been added up to then, "
                "as a root mean square in mesh units; it is an estimate, not a measurement."
            }
        }
    }
}

/// The clusters of each pass from above.
fn maps(report: &Report) -> Markup {
    if report.passes.iter().all(|pass| pass.map.is_none()) {
        return html! {};
    }
    html! {
        h3 { "Clusters of each pass from above, borders that were locked in black" }
        div.maps {
            @for (number, pass) in report.passes.iter().enumerate() {
                @if let Some(map) = &pass.map {
                    @let caption = format!("pass {}: {}", number + 1, spaced_count(pass.clusters, "cluster"));
                    figure { img src=(png_address(map)) alt=(caption); figcaption { (caption) } }
                }
            }
        }
    }
}

/// The options of the run.
fn asked(report: &Report) -> Markup {
    let options = match serde_json::to_value(&report.options) {
        Ok(serde_json::Value::Object(options)) => options,
        _ => serde_json::Map::new(),
    };
    let shown = |name: &str, value: &serde_json::Value| match (name, value) {
        (_, serde_json::Value::Null) => "not given".to_owned(),
        (_, serde_json::Value::String(text)) => text.clone(),
        (_, serde_json::Value::Array(values)) if values.is_empty() => "none".to_owned(),
        ("memory", serde_json::Value::Number(size)) => bytes::display(size.as_u64().unwrap_or(0)),
        (_, other) => other.to_string(),
    };
    html! {
        section {
            h2 { "Command and options" }
            @if let Some(command) = &report.command { pre.command { code { (command) } } }
            dl {
                @for (name, value) in &options {
                    div { dt { "--" (name.replace('_', "-")) } dd.none[value.is_null()] { (shown(name, value)) } }
                }
            }
        }
    }
}

fn date(seconds: u64) -> String {
    let time = std::time::UNIX_EPOCH + std::time::Duration::from_secs(seconds);
    humantime::format_rfc3339_seconds(time).to_string().replace('T', " ").replace('Z', " UTC")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_in_universal_time() {
        assert_eq!(date(1_000_000_000), "2001-09-09 01:46:40 UTC");
    }
}
