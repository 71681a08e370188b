//! `drystone compare`: compares a simplified mesh with its original.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;

use super::answer::CommandAnswer;
use super::flags::heading;
use super::print::{print, print_json};
use super::stop::run_unkept;
use crate::base::error::escape_path;
use crate::base::{Error, Progress, Result, bytes, grouped, quantity};
use crate::measure::compare::{
    self, BeforeAfter, CompareOptions, Comparison, Distances, Geometry, Onlooker, ROUNDING_SHARE, Resources, Spread,
    Texture,
};
use crate::options::Limits;
use crate::os::durable::temporary_folder;
use crate::plan::{memory, scratch};
use crate::read;
use crate::read::InputChoice;
use crate::report::gallery::Relief;
use crate::report::scene::DrawResources;
use crate::report::{self, ComparisonPage, ReportKind};

/// Minimum and maximum number of points by area.
const SAMPLES: std::ops::RangeInclusive<u64> = 1_000..=1_000_000_000;

/// Arguments of `drystone compare`.
#[derive(Debug, Args)]
pub struct CompareArguments {
    /// OBJ or PLY file, or a folder: every OBJ and PLY in and below it joins one mesh
    original: PathBuf,
    /// OBJ or PLY file made from it, or a folder
    result: PathBuf,
    /// Write a report: .json for scripts, .html for people; an older one is replaced; may be repeated
    ///
    /// docs/reference/comparison.md explains the numbers
    #[arg(long, value_name = "FILE")]
    report: Vec<PathBuf>,
    /// Print the numbers as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    sampling: SamplingArguments,
    /// Measure distances at the vertices of each mesh, as many papers do, instead of at points by area
    #[arg(long, conflicts_with_all = ["samples", "seed"], help_heading = heading::REPORT, hide_short_help = true)]
    vertices: bool,
    /// Average the original's colours over squares with sides of this length before comparing
    #[arg(long, value_name = "LENGTH", value_parser = quantity::parse_length)]
    #[arg(help_heading = heading::REPORT, hide_short_help = true)]
    texel: Option<f64>,
    /// Memory that the program may use, at least 128MiB [default: half of the machine's or cgroup's]
    #[arg(long, value_name = "SIZE", value_parser = bytes::parse)]
    memory: Option<u64>,
    /// Number of threads; the results do not depend on it [default: one per processor]
    #[arg(long, value_name = "COUNT")]
    threads: Option<usize>,
    /// Folder for intermediate files, removed at the end [default: in the system's temporary folder]
    #[arg(long, value_name = "DIR")]
    work: Option<PathBuf>,
    /// Print the numbers and errors only
    #[arg(short, long)]
    quiet: bool,
}

/// Which points are compared.
#[derive(Debug, Clone, Copy, Args)]
pub struct SamplingArguments {
    /// Sample points by area on each surface, 1000 to 1 billion; vertices and points on edges are measured besides
    #[arg(long, value_name = "COUNT", default_value_t = compare::SAMPLES, value_parser = quantity::parse_count)]
    #[arg(help_heading = heading::REPORT, hide_short_help = true)]
    samples: u64,
    /// Seed of the random sample points
    #[arg(long, value_name = "NUMBER", default_value_t = 1, value_parser = quantity::parse_whole::<u64>)]
    #[arg(help_heading = heading::REPORT, hide_short_help = true)]
    seed: u64,
    /// Whether the vertices are measured instead.
    #[arg(skip)]
    at_vertices: bool,
    /// Length of the texels as which the original's colours are compared.
    #[arg(skip)]
    texel: Option<f64>,
}

impl SamplingArguments {
    /// Points by area on each surface.
    pub fn samples(self) -> u64 {
        self.samples
    }

    /// Seed of the points.
    pub fn seed(self) -> u64 {
        self.seed
    }

    /// Checks ranges.
    ///
    /// # Errors
    /// [`Error::Usage`].
    pub fn check(self) -> Result<()> {
        if let Some(texel) = self.texel.filter(|texel| !texel.is_normal() || *texel < 0.0) {
            return Err(Error::Usage(format!("--texel {texel}: expected a length above 0")));
        }
        if SAMPLES.contains(&self.samples) {
            return Ok(());
        }
        let (found, least, most) = (self.samples, SAMPLES.start(), SAMPLES.end());
        Err(Error::Usage(format!("--samples {found}: expected {least} to {most}")))
    }
}

/// Prints the results of a comparison.
///
/// # Errors
/// Those of [`compare::compare`], and of writing the JSON.
pub fn run(arguments: &CompareArguments) -> Result<u8> {
    let show = |comparison: &Comparison| {
        if arguments.json {
            print_json(comparison)?
        } else {
            print(&table(comparison))?
        }
        Ok(0)
    };
    run_unkept(arguments.quiet, |progress| compare(arguments, progress), show)
}

/// Compares for a program that calls the command.
///
/// # Errors
/// Those of [`compare::compare`], and of writing the reports.
pub fn answer(arguments: &CompareArguments, progress: &dyn Progress) -> Result<CommandAnswer> {
    CommandAnswer::new(0, &compare(arguments, progress)?)
}

/// Compares, and writes the reports.
fn compare(arguments: &CompareArguments, progress: &dyn Progress) -> Result<Comparison> {
    let CompareArguments { original, result, report: reports, sampling, memory, threads, work, .. } = arguments;
    let sampling = &SamplingArguments { at_vertices: arguments.vertices, texel: arguments.texel, ..*sampling };
    let kinds = ReportKind::prepare(reports)?;
    let work = work.clone().unwrap_or_else(|| temporary_folder("compare"));
    let limits = Limits { memory: *memory, threads: *threads };
    let mut page = ComparisonPage::default();
    let is_drawn = kinds.contains(&ReportKind::Html);
    let kept_bytes = if is_drawn { Relief::BYTES } else { 0 };
    let meshes = [original.into(), result.into()];
    let task = ComparisonTask { meshes, sampling: *sampling, limits, kept_bytes, work };
    let comparison = if is_drawn {
        page.resources = drawing_resources(limits)?;
        task.run(&mut page, progress)?
    } else {
        task.run(&mut (), progress)?
    };
    for (path, kind) in reports.iter().zip(kinds) {
        match kind {
            ReportKind::Html => page.save(&comparison, path)?,
            ReportKind::Json => report::save_json(&comparison, path)?,
        }
    }
    Ok(comparison)
}

fn drawing_resources(limits: Limits) -> Result<DrawResources> {
    let budget = memory::budget_of(limits.memory)?;
    let work_bytes = budget.for_work().saturating_sub(Relief::BYTES);
    Ok(DrawResources { threads: memory::choose_threads(limits.threads, budget), work_bytes })
}

/// Two meshes to compare, and what that may take.
pub struct ComparisonTask {
    /// Original and result.
    pub meshes: [InputChoice; 2],
    /// Points to compare.
    pub sampling: SamplingArguments,
    /// Memory and threads.
    pub limits: Limits,
    /// Bytes of the memory that are left to others.
    pub kept_bytes: u64,
    /// Folder for intermediate files.
    pub work: PathBuf,
}

impl ComparisonTask {
    /// Compares the meshes.
    ///
    /// # Errors
    /// Those of [`compare::compare`]; [`Error::Usage`], [`Error::Budget`] and [`Error::NoSpace`] before anything is
    /// read.
    pub fn run(self, onlooker: &mut dyn Onlooker, progress: &dyn Progress) -> Result<Comparison> {
        let Self { meshes, sampling, limits, kept_bytes, work } = self;
        sampling.check()?;
        let SamplingArguments { samples, seed, at_vertices, texel } = sampling;
        let spread = if at_vertices { Spread::Vertices } else { Spread::Area(samples) };
        if limits.threads == Some(0) {
            return Err(Error::Usage("`threads: 0`: expected at least 1".into()));
        }
        let mut input_bytes = 0;
        for mesh in &meshes {
            let sizes = read::find_inputs(mesh)?.into_iter().filter_map(|path| path.metadata().ok());
            input_bytes += sizes.map(|meta| meta.len()).sum::<u64>();
        }
        let budget = memory::budget_of(limits.memory)?;
        let threads = memory::choose_threads(limits.threads, budget);
        scratch::refuse_small_disk(input_bytes, 0, &work)?;
        let resources = Resources {
            threads,
            work_bytes: budget.for_work().saturating_sub(kept_bytes),
            scan: memory::scan_options(budget, threads),
        };
        let [original, result] = meshes;
        compare::compare(original, result, &CompareOptions { spread, seed, texel, work, resources }, onlooker, progress)
    }
}

/// The comparison as a table for people.
fn table(comparison: &Comparison) -> String {
    let mut text = String::new();
    let _ = writeln!(text, "original  {}", escape_path(&comparison.original));
    let _ = writeln!(text, "result    {}", escape_path(&comparison.result));
    write_distances(&comparison.geometry, &mut text);
    write_surface(comparison, &mut text);
    write_counts(comparison, &mut text);
    for line in report::warning_lines(&comparison.warnings, "--json lists them") {
        let _ = writeln!(text, "{line}");
    }
    text
}

/// Distances one way, the other way and both.
fn write_distances(geometry: &Geometry, text: &mut String) {
    let _ = writeln!(text, "\n{:22}{:>16}{:>16}{:>16}", "distance", "to original", "to result", "both ways");
    type Figure = (&'static str, fn(&Distances) -> f64);
    let figures: [Figure; 6] = [
        ("largest", |d| d.max),
        ("mean", |d| d.mean),
        ("root mean square", |d| d.rms),
        ("half is nearer than", |d| d.median),
        ("95 % nearer than", |d| d.p95),
        ("99 % nearer than", |d| d.p99),
    ];
    let ways = [&geometry.forward, &geometry.backward, &geometry.symmetric];
    for (name, figure) in figures {
        let [a, b, c] = ways.map(|way| distance(figure(way), geometry.diagonal));
        let _ = writeln!(text, "{name:22}{a:>16}{b:>16}{c:>16}");
    }
    if geometry.symmetric.cut_searches > 0 {
        let [a, b, c] = ways.map(|way| distance(way.max_bound, geometry.diagonal));
        let _ = writeln!(text, "{:22}{a:>16}{b:>16}{c:>16}", "largest, at most");
    }
    let _ = writeln!(text, "in 1e-4 of the diagonal");
    for (name, figure) in figures.into_iter().filter(|(name, _)| *name != "half is nearer than") {
        let [a, b, c] = ways.map(|way| match 1e4 * figure(way) / geometry.diagonal {
            share if share > 0.0 && share < 1e4 * ROUNDING_SHARE => format!("<{:.0e}", 1e4 * ROUNDING_SHARE),
            share => length(share),
        });
        let _ = writeln!(text, "  {name:20}{a:>16}{b:>16}{c:>16}");
    }
}

/// What became of the surface and its texture.
fn write_surface(comparison: &Comparison, text: &mut String) {
    let geometry = &comparison.geometry;
    let mut row = |name: &str, words: String| {
        let _ = writeln!(text, "{name:22}{words}");
    };
    row("diagonal", length(geometry.diagonal));
    for (name, way) in [("largest, to original", &geometry.forward), ("largest, to result", &geometry.backward)] {
        if let Some(place) = way.worst.first() {
            row(name, format!("at {}", place.position.map(length).join(" ")));
        }
    }
    let normals = geometry.normals;
    let angles =
        format!("mean {:.2}°, 95 % below {:.2}°, {} turned over", normals.mean, normals.p95, percent(normals.flipped));
    row("normals", angles);
    row("area", format!("{} of the original's", percent(geometry.area_ratio)));
    if let Some(ratio) = geometry.volume_ratio {
        row("volume", format!("{} of the original's", percent(ratio)));
    }
    if let Some(border) = geometry.border {
        row("open borders", {
            let [max, rms] = [border.max, border.rms].map(|length| distance(length, geometry.diagonal));
            format!("at most {max} away, RMS {rms}")
        });
    }
    if let Some(pinholes) = &comparison.pinholes {
        let (through, behind) = (pinholes.ppm, pinholes.behind_ppm);
        row("pinholes", format!("{through:.1} ppm see-through, {behind:.1} ppm show what lies behind"));
        let worst = &pinholes.worst;
        if worst.ppm > 0.0 {
            let (ppm, turn, tilt) = (worst.ppm, worst.turn, worst.tilt);
            row("  most of them", format!("{ppm:.1} ppm, seen from {turn}° around and {tilt}° above"));
        }
    }
    if let Some(texture) = &comparison.texture {
        if let Some(texel) = comparison.texel {
            row("original's texels", format!("{} long, for both colours below", length(texel)));
        }
        describe_texture(texture, &mut row);
    }
}

/// Counts before and after.
fn write_counts(comparison: &Comparison, text: &mut String) {
    let Comparison { topology, quality, .. } = comparison;
    let _ = writeln!(text, "\n{:22}{:>16}{:>16}", "", "before", "after");
    let mut pair = |name: &str, before: String, after: String| {
        let _ = writeln!(text, "{name:22}{before:>16}{after:>16}");
    };
    let (old, new) = (&topology.before, &topology.after);
    for (name, before, after) in [
        ("triangles", old.faces, new.faces),
        ("vertices", old.vertices, new.vertices),
        ("components", old.components, new.components),
        ("boundary edges", old.boundary_edges, new.boundary_edges),
        ("boundary loops", old.boundary_loops, new.boundary_loops),
        ("non-manifold edges", old.non_manifold_edges, new.non_manifold_edges),
        ("folded edges", old.folded_edges, new.folded_edges),
        ("seam edges", old.seam_edges, new.seam_edges),
        ("charts", old.charts, new.charts),
        ("most edges at a vertex", quality.before.valence_max, quality.after.valence_max),
    ] {
        pair(name, grouped(before), grouped(after));
    }
    pair("Euler characteristic", old.euler.to_string(), new.euler.to_string());
    let (old, new) = (&quality.before, &quality.after);
    pair("mean regularity", format!("{:.4}", old.regularity_mean), format!("{:.4}", new.regularity_mean));
    pair("slivers", percent(old.sliver_share), percent(new.sliver_share));
    pair("5 to 7 edges", percent(old.valence_regular_share), percent(new.valence_regular_share));
}

fn describe_texture(texture: &Texture, row: &mut impl FnMut(&str, String)) {
    let colours = |mean: f64, rms: f64| format!("mean {mean:.2}, RMS {rms:.2} of 255");
    row("colour, to original", colours(texture.colour_mean, texture.colour_rms));
    row("colour, to result", colours(texture.colour_backward_mean, texture.colour_backward_rms));
    if let Some((half, most)) = texture.slide_median.zip(texture.slide_p95) {
        row("texture drift", format!("half below {}, 95 % below {}", length(half), length(most)));
    }
    if let Some((half, most)) = texture.slide_texels_median.zip(texture.slide_texels_p95) {
        row("the same in texels", format!("half below {half:.2}, 95 % below {most:.2}"));
    }
    if texture.repeated_fraction > 0.0 {
        let share = percent(texture.repeated_fraction);
        row("drift unknown", format!("{share} of the surface: the original shows its images more than once"));
    }
    if let Some(outside) = texture.outside_fraction {
        row("outside of all charts", percent(outside));
    }
    row("without image", percent(texture.untextured_fraction));
    let folded =
        format!("{} before, {} after", grouped(texture.folded_triangles_before), grouped(texture.folded_triangles));
    row("folded in texture", folded);
    let BeforeAfter { before, after } = texture.seams;
    let pair = |before: String, after: String| format!("{before} before, {after} after");
    row(
        "colour across seams",
        pair(colours(before.colour_mean, before.colour_rms), colours(after.colour_mean, after.colour_rms)),
    );
    if let Some((before, after)) = before.gap_p95.zip(after.gap_p95) {
        row("gap of seams, 95 %", pair(format!("below {}", length(before)), format!("below {}", length(after))));
    }
    if let Some((before, after)) = before.gap_texels_p95.zip(after.gap_texels_p95) {
        row("the same in texels", pair(format!("below {before:.2}"), format!("below {after:.2}")));
    }
}

/// A distance as text; a distance that may be rounding only as "less than" the limit of rounding.
fn distance(value: f64, diagonal: f64) -> String {
    match value {
        0.0 => "0".to_owned(),
        _ if value < ROUNDING_SHARE * diagonal => format!("<{:.1e}", ROUNDING_SHARE * diagonal),
        _ => length(value),
    }
}

/// A length with five significant digits.
fn length(length: f64) -> String {
    let digits = if length == 0.0 { 0.0 } else { libm::floor(libm::log10(length.abs())) };
    match digits as i32 {
        -4..=6 => format!("{length:.*}", (4 - digits as i32).max(0) as usize),
        _ => format!("{length:.4e}"),
    }
}

fn percent(share: f64) -> String {
    format!("{:.3} %", 100.0 * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roundings_are_no_five_digits() {
        assert_eq!(distance(7.0741e-18, 2.83), "<2.8e-12");
        assert_eq!([0.0, 1e-9, 0.5].map(|value| distance(value, 2.83)), ["0", "1.0000e-9", "0.50000"]);
    }
}
