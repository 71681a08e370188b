//! The key figures of a run, at the head of its page.

use maud::{Markup, html};

use super::markup::figure;
use super::numbers::{length, percent, seconds, spaced, spaced_count};
use super::run::{BakeFigures, MemoryFigures, Report};
use crate::base::bytes;
use crate::options::TextureFiles;
use crate::write::ResultFormat;

/// All of them.
pub(super) fn key_figures(report: &Report) -> Markup {
    let faces = &report.faces;
    let share = 100.0 * faces.output as f64 / faces.input.max(1) as f64;
    html! {
        section.figures {
            (figure("triangles before", &spaced(faces.input), &files(report.input_files)))
            (figure("triangles after", &spaced(faces.output), &format!("{} of the input", percent(share))))
            (deviation(report))
            (figure("time", &seconds(report.seconds.total), &spaced_count(report.threads as u64, "thread")))
            (memory(&report.memory))
            (figure("mesh before", &bytes::display(report.io.input), "read once"))
            (figure("mesh after", &bytes::display(report.io.output), beside(report)))
            @match &report.bake {
                Some(bake) => (baked(bake)),
                None => (kept(report)),
            }
        }
    }
}

/// What the file of the result leaves to others.
fn beside(report: &Report) -> &'static str {
    match ResultFormat::by_ending(&report.output) {
        Some(ResultFormat::Glb) => "with its images",
        Some(ResultFormat::Obj) => "without MTL and textures",
        _ => "without textures",
    }
}

fn deviation(report: &Report) -> Markup {
    let Some(comparison) = &report.comparison else { return measured(report) };
    html! {
        (figure("distance, RMS", &length(comparison.geometry.symmetric.rms), "measured both ways, mesh units"))
        @if let Some(texture) = &comparison.texture {
            (figure("difference of colour", &length(texture.colour_rms), "RMS, of 255"))
        }
    }
}

/// The deviation measured at some thousand points.
fn measured(report: &Report) -> Markup {
    match &report.error.measured {
        Some(found) => {
            let points = format!("RMS both ways, mesh units, measured at {} points", spaced(found.points));
            figure("distance, RMS", &length(found.rms), &points)
        }
        None => figure("distance", "not measured", "--measure measures it"),
    }
}

/// The peak as a share of the budget, or the budget.
fn memory(memory: &MemoryFigures) -> Markup {
    let budget = bytes::display(memory.budget);
    match memory.peak_resident {
        Some(peak) => {
            let share = percent(100.0 * peak as f64 / memory.budget.max(1) as f64);
            figure("peak memory", &bytes::display(peak), &format!("{share} of the {budget} allowed"))
        }
        None => figure("memory allowed", &budget, "the peak is not measured inside another program"),
    }
}

/// New textures.
fn baked(bake: &BakeFigures) -> Markup {
    let megapixels = format!("{} megapixels", length(bake.texels as f64 / 1e6));
    let charts =
        format!("{}, of which charts cover {}", spaced_count(bake.images, "image"), percent(100.0 * bake.fill));
    html! {
        (figure("new texture", &megapixels, &charts))
        (figure("charts", &spaced(bake.charts), "pieces of the surface that lie flat in the new texture"))
        (figure("texel", &length(bake.texel), "its side on the surface, mesh units"))
    }
}

/// Materials and textures of the input that the result shows.
fn kept(report: &Report) -> Markup {
    let files = &report.files;
    html! {
        (figure("materials left", &spaced(files.materials_left), &lost(files.materials, files.materials_left)))
        (figure("textures left", &spaced(files.textures_left), &lost(files.textures, files.textures_left)))
        @if ResultFormat::by_ending(&report.output) != Some(ResultFormat::Glb) {
            (images(report))
        }
    }
}

/// Total, and how many of it are on no face of the result.
fn lost(before: u64, left: u64) -> String {
    let lost = if left == before { "none lost".into() } else { format!("{} lost", spaced(before - left)) };
    format!("of {}: {lost}", spaced(before))
}

/// Texture images beside the result.
fn images(report: &Report) -> Markup {
    let files = &report.files;
    let count = spaced_count(files.images, "image");
    let megapixels = match files.megapixels {
        Some([before, after]) if before > 0.0 => format!(", {} of {} megapixels", length(after), length(before)),
        _ => String::new(),
    };
    match report.options.textures {
        TextureFiles::Reference => figure("texture images", "none copied", "the result names those of the input"),
        TextureFiles::Link => figure("texture images", &count, &format!("linked{megapixels}")),
        TextureFiles::Copy | TextureFiles::Bake => {
            figure("texture images", &bytes::display(files.image_bytes), &format!("{count} copied{megapixels}"))
        }
    }
}

fn files(count: u64) -> String {
    if count == 1 { "in one file".into() } else { format!("in {} files", spaced(count)) }
}
