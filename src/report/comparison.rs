//! Shows what a comparison found, as part of a page and as a page of its own.

use std::path::Path;

use maud::{Markup, html};

use super::file::save_text;
use super::gallery::{self, Shot, VANTAGES, Viewpoints};
use super::markup::{self, figure, plot, rendering, renderings, row};
use super::numbers::{length, percent, seconds, signed, spaced};
use super::plots;
use super::scene::DrawResources;
use crate::base::error::escape_path;
use crate::base::{Findings, Result, bytes};
use crate::measure::compare::Pinholes;
use crate::measure::compare::cells::MeasuredMesh;
use crate::measure::compare::{
    Comparison, Distances, FarPoint, Geometry, Onlooker, Quality, SeamFigures, Texture, TopologyCounts,
};
use crate::os::durable::new_job_number;

/// Number of positions of largest distances that are shown.
const SHOWN_PLACES: usize = 5;

/// A name, and the function that returns its figure.
type Figure<T, F> = (&'static str, fn(&T) -> F);

/// The page of a comparison. It observes the comparison to draw both meshes and to colour the result by error.
#[derive(Debug, Default)]
pub struct ComparisonPage {
    /// Resources for drawing.
    pub resources: DrawResources,
    shots: Option<[Vec<Shot>; 2]>,
    findings: Findings,
}

impl Onlooker for ComparisonPage {
    fn see_meshes(&mut self, before: &MeasuredMesh, after: &MeasuredMesh) -> Result<()> {
        let Some(from) = Viewpoints::of(before)? else { return Ok(()) };
        let mut draw = |mesh, with_relief| gallery::draw(mesh, &from, with_relief, &self.resources, &mut self.findings);
        self.shots = Some([draw(before, false)?, draw(after, true)?]);
        Ok(())
    }

    fn see_point(&mut self, place: &FarPoint) {
        if let Some([_, after]) = &mut self.shots {
            after.see_point(place);
        }
    }
}

impl ComparisonPage {
    /// Writes the page.
    ///
    /// # Errors
    /// The file system's.
    pub fn save(&self, comparison: &Comparison, path: &Path) -> Result<()> {
        let title = comparison.result.file_name().map_or_else(String::new, |name| escape_path(name.as_ref()));
        let faces = [comparison.topology.before.faces, comparison.topology.after.faces];
        let rms = comparison.geometry.symmetric.rms;
        let peak = comparison.peak_resident.map(|peak| format!("{} peak memory", bytes::display(peak)));
        let body = html! {
            header {
                p.mark { "drystone compare" }
                h1 { (title) }
                p.files {
                    code { (escape_path(&comparison.original)) } " → " code { (escape_path(&comparison.result)) }
                }
            }
            section.figures {
                (figure("triangles before", &spaced(faces[0]), "of the original"))
                (figure("triangles after", &spaced(faces[1]),
                    &format!("{} of the original", percent(100.0 * faces[1] as f64 / faces[0].max(1) as f64))))
                (figure("distance, RMS", &length(rms), "both ways, mesh units"))
                (figure("distance, largest", &length(comparison.geometry.symmetric.max), "both ways, mesh units"))
                @if let Some(texture) = &comparison.texture {
                    (figure("difference of colour", &length(texture.colour_rms), "RMS, of 255"))
                }
                (figure("time", &seconds(comparison.seconds), &peak.unwrap_or_default()))
            }
            @if let Some([before, after]) = &self.shots { (renderings(before, after)) }
            (body(comparison, self.shots.as_ref().map_or(&[], |[_, after]| after)))
            @let warnings: Vec<String> = comparison.warnings.iter().cloned().chain(self.findings.warnings()).collect();
            @if !warnings.is_empty() {
                section { h2 { "Warnings" } ul { @for warning in &warnings { li { (warning) } } } }
            }
        };
        save_text(&markup::page(&title, &body, ""), path, new_job_number(path))
    }
}

/// The sections of the page that show a comparison; `after` are renderings of the result.
pub(super) fn body(comparison: &Comparison, after: &[Shot]) -> Markup {
    html! {
        (distances(comparison))
        (errors(comparison, after))
        @if let Some(found) = &comparison.pinholes { (pinholes(found)) }
        @if let Some(texture) = &comparison.texture { (texture_tables(texture)) }
        (shapes(comparison))
    }
}

fn distances(comparison: &Comparison) -> Markup {
    let geometry = &comparison.geometry;
    let ways = [&geometry.forward, &geometry.backward, &geometry.symmetric];
    let figures: [Figure<Distances, f64>; 6] = [
        ("largest", |d| d.max),
        ("mean", |d| d.mean),
        ("root mean square", |d| d.rms),
        ("half of the surface is nearer than", |d| d.median),
        ("95 % is nearer than", |d| d.p95),
        ("99 % is nearer than", |d| d.p99),
    ];
    html! {
        section {
            h2 { "Distance between result and original" }
            div.pair {
                table {
                    thead { tr { th {} th.number { "to the original" } th.number { "to the result" } th.number { "both ways" } } }
                    tbody {
                        @for (name, of) in figures {
                            tr { th scope="row" { (name) } @for way in ways { td.number { (length(of(way))) } } }
                        }
                        @if comparison.geometry.symmetric.cut_searches > 0 {
                            tr {
                                th scope="row" { "largest, at most" }
                                @for way in ways { td.number { (length(way.max_bound)) } }
                            }
                        }
                        tr {
                            th scope="row" { "RMS per diagonal" }
                            @for way in ways { td.number { (length(way.rms / geometry.diagonal.max(f64::MIN_POSITIVE))) } }
                        }
                    }
                }
                (plot(plots::distribution(&geometry.forward.histogram, &geometry.backward.histogram),
                    "How much of the surface is how far; distances in mesh units"))
            }
            p.quiet {
                @match comparison.samples {
                    Some(count) => {
                        "Exact distances from " (spaced(count)) " points by area on each surface, and from vertices and points on "
                        "edges for the largest one."
                    }
                    None => "Exact distances from all vertices of each surface.",
                }
                " To the original: what was added. To the result: what was lost. Diagonal of the original: "
                (length(geometry.diagonal)) "."
                @if geometry.symmetric.cut_searches > 0 {
                    " " (spaced(geometry.symmetric.cut_searches)) " points were given up, since triangles lie across each other by "
                    "the thousand; others near by speak for them."
                }
            }
            (worst(comparison))
        }
    }
}

/// The positions of the largest distances.
fn worst(comparison: &Comparison) -> Markup {
    let Geometry { forward, backward, .. } = &comparison.geometry;
    let mut places: Vec<(&str, &FarPoint)> = forward.worst.iter().map(|place| ("added", place)).collect();
    places.extend(backward.worst.iter().map(|place| ("lost", place)));
    places.sort_by(|a, b| b.1.distance.total_cmp(&a.1.distance));
    let position = |at: [f64; 3]| at.map(|coordinate| format!("{coordinate:.3}").replace('-', "\u{2212}")).join(", ");
    html! {
        @if !places.is_empty() {
            h3 { "Largest distances" }
            table {
                thead { tr { th { "Surface" } th.number { "Distance" } th.number { "From" } th.number { "To" } } }
                tbody {
                    @for (what, place) in places.iter().take(SHOWN_PLACES) {
                        tr {
                            th scope="row" { (what) }
                            td.number { (length(place.distance)) }
                            td.number { (position(place.position)) }
                            td.number { (position(place.closest)) }
                        }
                    }
                }
            }
        }
    }
}

/// The result coloured by its distance from the original.
fn errors(comparison: &Comparison, after: &[Shot]) -> Markup {
    let forward = &comparison.geometry.forward;
    let most = if forward.p99 > 0.0 { forward.p99 } else { forward.max };
    let coloured: Vec<_> =
        VANTAGES.iter().zip(after).filter_map(|(p, shot)| Some((p, shot.relief.as_ref()?))).collect();
    if coloured.is_empty() || most <= 0.0 {
        return html! {};
    }
    html! {
        section {
            h2 { "The result by its distance from the original" }
            div.scale {
                div.ramp role="img" aria-label="scale of colours, from no distance to the largest shown" {}
                @for step in 0..=4 { span { (length(most * f64::from(step) / 4.0)) @if step == 4 { " and more" } } }
            }
            p.quiet { "Measured from each point of the result to the original; the last colour begins where 1 % of the surface is farther away." }
            div.pair.shots {
                @for (place, relief) in coloured {
                    (rendering(&relief.colour(most), &format!("distance from the original, {}", place.name)))
                }
            }
        }
    }
}

/// The pinholes, and the view with most of them.
fn pinholes(found: &Pinholes) -> Markup {
    html! {
        section {
            h2 { "Pinholes" }
            table {
                thead { tr { th { "Pixels per million" } th.number { "all views" } th.number { "the worst" } } }
                tbody {
                    tr {
                        th scope="row" { "show the background" }
                        td.number { (length(found.ppm)) } td.number { (length(found.worst.ppm)) }
                    }
                    tr {
                        th scope="row" { "show a surface far behind" }
                        td.number { (length(found.behind_ppm)) } td.number { (length(found.worst.behind_ppm)) }
                    }
                }
            }
            p.quiet {
                "Of " (spaced(found.pixels)) " pixels in 16 views, at least 5 pixels inside the outline of the original. Far behind: more "
                "than a hundredth of the diagonal behind the surface that the original shows there."
            }
            @if !found.worst.rendering.is_empty() {
                div.shots {
                    (rendering(&gallery::jpeg_file_address(&found.worst.rendering), &format!(
                        "the view with most pinholes: {:.0}° around, {:.0}° above the horizon; background in red, surfaces behind in orange",
                        found.worst.turn, found.worst.tilt)))
                }
            }
        }
    }
}

/// Text for a figure that cannot be measured.
const UNKNOWN: &str = "unknown";

fn known_length(figure: Option<f64>) -> String {
    figure.map_or(UNKNOWN.into(), length)
}

fn known_lengths(half: Option<f64>, most: Option<f64>) -> String {
    half.zip(most).map_or(UNKNOWN.into(), |(half, most)| format!("{} · {}", length(half), length(most)))
}

fn known_share(figure: Option<f64>) -> String {
    figure.map_or(UNKNOWN.into(), |share| percent(100.0 * share))
}

fn texture_tables(texture: &Texture) -> Markup {
    let two = |a: f64, b: f64| format!("{} · {}", length(a), length(b));
    let folded = [texture.folded_triangles_before, texture.folded_triangles].map(spaced);
    let figures: [Figure<SeamFigures, String>; 8] = [
        ("length of all seams", |s| length(s.length)),
        ("difference of colour across, mean", |s| length(s.colour_mean)),
        ("root mean square", |s| length(s.colour_rms)),
        ("gap: half of the length below", |s| known_length(s.gap_median)),
        ("95 % below", |s| known_length(s.gap_p95)),
        ("in texels: half below", |s| known_length(s.gap_texels_median)),
        ("95 % below", |s| known_length(s.gap_texels_p95)),
        ("a side outside of all charts", |s| known_share(s.outside_fraction)),
    ];
    html! {
        section {
            h2 { "Texture" }
            div.pair {
                table {
                    thead { tr { th { "Surface" } th.number { "half below · 95 % below" } } }
                    tbody {
                        (row("texture drift, mesh units", &known_lengths(texture.slide_median, texture.slide_p95)))
                        (row("texture drift, texels", &known_lengths(texture.slide_texels_median, texture.slide_texels_p95)))
                    }
                    thead { tr { th { "Colours, of 255" } th.number { "mean · root mean square" } } }
                    tbody {
                        (row("to the original", &two(texture.colour_mean, texture.colour_rms)))
                        (row("to the result", &two(texture.colour_backward_mean, texture.colour_backward_rms)))
                    }
                    thead { tr { th { "Charts and images" } th {} } }
                    tbody {
                        (row("surface that shows a place outside of all charts", &known_share(texture.outside_fraction)))
                        (row("surface whose image the original shows more than once", &percent(100.0 * texture.repeated_fraction)))
                        (row("surface without image", &percent(100.0 * texture.untextured_fraction)))
                        (row("images read", &spaced(texture.images)))
                        @if texture.reduced_images > 0 {
                            (row("of these at a lower resolution", &spaced(texture.reduced_images)))
                        }
                    }
                }
                table {
                    thead { tr { th { "Seams" } th.number { "before" } th.number { "after" } } }
                    tbody {
                        @for (name, of) in figures { (trio(name, &of(&texture.seams.before), &of(&texture.seams.after))) }
                        (trio("triangles folded in texture", &folded[0], &folded[1]))
                    }
                }
            }
            p.quiet {
                "Texture drift: how far the texture image moved over the surface, from where the texel at a point of the result lies on "
                "the original to the closest point there. Where an image repeats, that may be another repetition: read the colours then. Gap: from "
                "where the texel on one side of a seam lies on the original to where that on the other side lies; it is measured on "
                "a grid of texels, so a seam that did not change has a gap of up to a texel of it."
            }
        }
    }
}

/// A name with a figure of the original and of the result.
fn trio(name: &str, before: &str, after: &str) -> Markup {
    html! { tr { th scope="row" { (name) } td.number { (before) } td.number { (after) } } }
}

fn shapes(comparison: &Comparison) -> Markup {
    let Comparison { topology, quality, geometry, .. } = comparison;
    let counts: [Figure<TopologyCounts, String>; 10] = [
        ("triangles", |t| spaced(t.faces)),
        ("vertices", |t| spaced(t.vertices)),
        ("components", |t| spaced(t.components)),
        ("boundary edges", |t| spaced(t.boundary_edges)),
        ("boundary loops", |t| spaced(t.boundary_loops)),
        ("non-manifold edges", |t| spaced(t.non_manifold_edges)),
        ("folded edges", |t| spaced(t.folded_edges)),
        ("seam edges", |t| spaced(t.seam_edges)),
        ("charts", |t| spaced(t.charts)),
        ("Euler characteristic", |t| signed(t.euler)),
    ];
    let shapes: [Figure<Quality, String>; 4] = [
        ("mean regularity of triangles", |q| length(q.regularity_mean)),
        ("slivers", |q| percent(100.0 * q.sliver_share)),
        ("inner vertices with 5, 6 or 7 edges", |q| percent(100.0 * q.valence_regular_share)),
        ("most edges at a vertex", |q| spaced(q.valence_max)),
    ];
    let volume = |volume: Option<f64>| volume.map_or_else(|| "open".to_owned(), length);
    let heads = |name: &str| html! { thead { tr { th { (name) } th.number { "before" } th.number { "after" } } } };
    let normals = &geometry.normals;
    html! {
        section {
            h2 { "Topology and shape" }
            div.pair {
                table {
                    (heads("Counts"))
                    tbody {
                        @for (name, of) in counts { (trio(name, &of(&topology.before), &of(&topology.after))) }
                    }
                }
                div {
                    table {
                        (heads("Shapes"))
                        tbody {
                            @for (name, of) in shapes { (trio(name, &of(&quality.before), &of(&quality.after))) }
                            (trio("area", &length(geometry.area.before), &length(geometry.area.after)))
                            (trio("volume", &volume(geometry.volume.before), &volume(geometry.volume.after)))
                        }
                    }
                    p.quiet {
                        "Normals differ by " (length(normals.mean)) "° in the mean, 95 % of the surface by less than "
                        (length(normals.p95)) "°; " (percent(100.0 * normals.flipped)) " is turned over."
                        @if let Some(border) = &geometry.border {
                            " Open borders lie at most " (length(border.max)) " from those of the original, RMS "
                            (length(border.rms)) "."
                        }
                    }
                }
            }
        }
    }
}
