//! Predicts a pyramid of tiles: levels, tiles, images, bytes, memory, scratch space, time.
//!
//! ```text
//! triangles and texels of the input ──▶ those of each level ──▶ tiles of the level: as many as hold both
//! ```
//! Shares, bytes and rates were measured on 2026-11-27 on three surveys and a town of 0.4 to 0.8 million triangles. How
//! many triangles a level needs depends on the shape, which a forecast does not see: half or twice as many are usual.

use std::fmt::Write as _;

use serde::Serialize;

use super::bake;
use super::bake_forecast::BakeTask;
use super::machines::PlannedPyramid;
use super::memory::{self, Sizes};
use super::time::speed_up;
use super::{InputFigures, MachinesForecast, ScratchFigures, put_machines, row, scratch};
use crate::base::{MemoryBudget, Progress, Result, bytes, counted, duration, grouped};
use crate::options::{ImageFormat, TileCompression, TileOptions};
use crate::os::system;
use crate::read::{self, InputChoice, TextureSample};
use crate::tile::{TileCrew, pass_count};

/// Triangles of the finest level by those of the input: cuts and skirts add some.
const WITH_BORDERS: f64 = 1.2;
/// Triangles of the first level above the finest, by those of the input, and of each further one by those of the level
/// below.
const FIRST_SHARE: f64 = 1.0 / 8.0;
const NEXT_SHARE: f64 = 1.0 / 2.8;
/// Tiles of a level by the larger one of the numbers that hold its triangles and its texels, and by the smaller one.
const TILES_BY_LARGER: f64 = 1.1;
const TILES_BY_SMALLER: f64 = 0.33;
/// Share of an image that the surface shows, in the finest level and above.
const FILL: [f64; 2] = [0.65, 0.5];
/// Bytes of a triangle, plain and compressed.
const TRIANGLE_BYTES: f64 = 13.0;
const MESHOPT_BYTES: f64 = 5.5;
/// Bytes of a texel: of a JPEG of quality 85, of a WebP of quality 80, of a KTX2 of any and of a PNG.
const JPEG_BYTES: f64 = 0.25;
const WEBP_BYTES: f64 = 0.12;
const KTX2_BYTES: f64 = 0.26;
const PNG_BYTES: f64 = 1.6;
/// Processor time of a triangle of the input, and of a texel of all images.
const TRIANGLE_SECONDS: f64 = 45e-6;
const TEXEL_SECONDS: f64 = 0.2e-6;
/// Bytes of scratch space of a triangle of the input while its levels are cut, beyond those of the passes and of its
/// surface, and of a pixel of its images.
const CUT_BYTES: f64 = 150.0;
const PIXEL_BYTES: f64 = 3.0;
/// Levels at most.
const LEVELS_MAX: u32 = 30;

/// Prediction for a level.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LevelForecast {
    /// Number of the level; 0 is the finest.
    pub level: u32,
    /// Tiles.
    pub tiles: u64,
    /// Triangles of all tiles.
    pub triangles: u64,
    /// Texels of all images.
    pub texels: u64,
    /// Bytes of the files.
    pub bytes: u64,
}

/// Prediction for a pyramid.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PyramidPlan {
    /// Counts of the input.
    pub input: InputFigures,
    /// The levels, the finest first.
    pub levels: Vec<LevelForecast>,
    /// Threads that the run would use.
    pub threads: u64,
    /// Memory that the user allows, in bytes.
    pub budget: u64,
    /// Memory of the run, in bytes.
    pub memory: u64,
    /// Scratch space.
    pub scratch: ScratchFigures,
    /// Bytes of all tiles.
    pub output_bytes: u64,
    /// Time in seconds.
    pub seconds: f64,
    /// What several machines would bring; `None` if that was not asked for.
    pub machines: Option<MachinesForecast>,
    /// Warnings: inputs that may hold one surface twice, images that are missing, and patterns that exclude nothing.
    pub warnings: Vec<String>,
}

/// Plans a pyramid. The work folder's disk is that of `options.job.work`, else that of the current folder.
///
/// # Errors
/// As [`pipeline::tile`](crate::pipeline::tile) for options, an impossible budget and inputs that are no meshes.
pub fn plan_tiles(
    input: impl Into<InputChoice>,
    options: &TileOptions,
    progress: &dyn Progress,
) -> Result<PyramidPlan> {
    options.check()?;
    let simplify = options.simplify_options();
    let (inputs, mut findings) = read::find_inputs_and_idle(&input.into())?;
    let budget = memory::choose_budget(&simplify)?;
    let threads = memory::choose_threads(options.limits.threads, budget);
    let mut sample = TextureSample::new(budget.for_work());
    let (counts, boxes) = read::count(&inputs, threads, Some(&mut sample), progress)?;
    read::note_twin_boxes(&inputs, &boxes, &mut findings);
    let shown = sample.finish();
    let faces = counts.triangles;
    let task = BakeTask { faces, target: faces, threads, work_bytes: budget.for_work() };
    let images = bake::input_texels(&shown, &task, options.textures_outside, &mut findings);
    findings.merge(shown.findings);

    // Tiles have no image where neither materials nor vertices have colours.
    let has_colour =
        counts.has_colours || shown.catalogue.materials.iter().any(|material| material.definition.is_some());
    let levels = forecast_levels(faces as f64, if has_colour { images.shown } else { 0.0 }, options);
    let sizes = Sizes::of(faces, counts.vertices, &simplify);
    let painting = threads as u64 * TileCrew::worker_bytes(options.tile_faces, options.tile_side);
    let painting = MemoryBudget::FIXED_BYTES + painting.max(images.decoding_bytes).min(budget.for_work());
    let folder = scratch::existing_folder(options.job.work.as_deref().unwrap_or(std::path::Path::new(".")));
    let of_passes = scratch::forecast(&counts, &sizes, pass_count(faces, options.tile_faces), budget);
    let of_images = PIXEL_BYTES * images.pixels as f64;
    let texels: u64 = levels.iter().map(|level| level.texels).sum();
    let core_seconds = faces as f64 * TRIANGLE_SECONDS + texels as f64 * TEXEL_SECONDS;
    Ok(PyramidPlan {
        input: InputFigures::of(&counts, inputs.len()),
        threads: threads as u64,
        budget: budget.bytes,
        memory: memory::forecast(&sizes, budget, threads).peak.max(painting),
        scratch: ScratchFigures {
            bytes: of_passes + (bake::SURFACE_BYTES * faces as f64 + of_images + CUT_BYTES * faces as f64) as u64,
            free: system::free_disk_bytes(&folder).ok(),
            folder,
        },
        output_bytes: levels.iter().map(|level| level.bytes).sum(),
        levels,
        seconds: core_seconds / speed_up(threads, u64::MAX),
        machines: None,
        warnings: findings.warnings(),
    })
}

/// The levels of an input with `faces` triangles that show `covered` texels.
fn forecast_levels(faces: f64, covered: f64, options: &TileOptions) -> Vec<LevelForecast> {
    let limits = crate::tile::tile_limits(options.tile_faces, options.tile_side);
    let triangle_bytes = match options.compress {
        TileCompression::None => TRIANGLE_BYTES,
        TileCompression::Meshopt => MESHOPT_BYTES,
    };
    let texel_bytes = texel_bytes(options.image);
    let mut levels = Vec::new();
    let (mut triangles, mut covered) = (faces * WITH_BORDERS, covered);
    for level in 0..LEVELS_MAX {
        let (by_faces, by_texels) = (triangles / limits.faces as f64, covered / limits.texels);
        let most = TILES_BY_LARGER * by_faces.max(by_texels) + TILES_BY_SMALLER * by_faces.min(by_texels);
        let tiles = if by_faces.max(by_texels) <= 1.0 { 1 } else { most.ceil() as u64 };
        let texels = covered / FILL[usize::from(level > 0)];
        levels.push(LevelForecast {
            level,
            tiles,
            triangles: triangles as u64,
            texels: texels as u64,
            bytes: (triangles * triangle_bytes + texels * texel_bytes) as u64,
        });
        if tiles == 1 {
            break;
        }
        triangles = if level == 0 { faces * FIRST_SHARE } else { triangles * NEXT_SHARE };
        covered /= 4.0;
    }
    levels
}

/// Bytes of a texel of an image. They grow with the square root of what is missing to quality 100, within a tenth from 60
/// to 97.
fn texel_bytes(image: ImageFormat) -> f64 {
    let at = |bytes: f64, of: f64, quality: u8| bytes * ((100.0 - of) / (100.0 - f64::from(quality)).max(1.0)).sqrt();
    match image {
        ImageFormat::Png => PNG_BYTES,
        ImageFormat::Jpeg(quality) => at(JPEG_BYTES, 85.0, quality),
        ImageFormat::WebP(quality) => at(WEBP_BYTES, 80.0, quality),
        ImageFormat::Ktx2(_) => KTX2_BYTES,
    }
}

impl PyramidPlan {
    /// The plan with a prediction for several machines; `bandwidth` is what their shared disk moves in a second, in bytes.
    pub fn on_machines(self, machines: u32, bandwidth: Option<u64>) -> Self {
        let levels = self.levels.len() as u64;
        let pyramid = PlannedPyramid {
            seconds: self.seconds,
            input_bytes: self.input.bytes,
            scratch_bytes: self.scratch.bytes,
            output_bytes: self.output_bytes,
            // Two passes make a level; its tiles are lent once.
            stages: 3 * levels,
        };
        Self { machines: Some(MachinesForecast::of_pyramid(&pyramid, machines, bandwidth)), ..self }
    }

    /// The plan as a table for people.
    pub fn table(&self) -> String {
        let mut text = String::new();
        self.input.put_rows(&mut text);
        for level in self.levels.iter().rev() {
            let LevelForecast { level, tiles, triangles, texels, bytes } = *level;
            let (tiles, triangles) = (counted(tiles, "tile"), grouped(triangles));
            let texels = format!("{:.1} million texels", texels as f64 / 1e6);
            let words = format!("about {tiles}, {triangles} triangles, {texels}, {}", bytes::display(bytes));
            row(&mut text, &format!("level {level}"), &words);
        }
        row(&mut text, "tiles", &format!("about {}", bytes::display(self.output_bytes)));
        let allowed = bytes::display(self.budget);
        row(&mut text, "memory", &format!("{} of {allowed} allowed", bytes::display(self.memory)));
        row(&mut text, "scratch", &self.scratch.words("about"));
        let threads = counted(self.threads, "thread");
        let _ = writeln!(text, "{:10}{} on {threads} with a core each", "time", duration::about(self.seconds));
        self.machines.iter().for_each(|machines| put_machines(&mut text, machines));
        text
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::base::Silent;

    #[test]
    fn levels_grow_coarser_up_to_one_tile() {
        for (faces, texels, side) in [(1e3, 1e5, 1024), (1e6, 4e7, 1024), (2e7, 1e9, 2048), (1e8, 1e6, 256)] {
            let options = TileOptions { tile_side: side, ..TileOptions::default() };
            let levels = forecast_levels(faces, texels, &options);
            assert_eq!(levels.last().map(|level| level.tiles), Some(1));
            assert!(levels.is_sorted_by(|a, b| a.tiles >= b.tiles && a.triangles > b.triangles && a.texels > b.texels));
        }
    }

    #[test]
    fn better_images_are_larger_and_compressed_triangles_smaller() {
        let bytes = |image: &str, compress| {
            let options = TileOptions { image: image.parse().unwrap(), compress, ..TileOptions::default() };
            forecast_levels(1e6, 4e7, &options)[0].bytes
        };
        let of = |image: &str| bytes(image, TileCompression::None);
        let ascending = ["webp:80", "webp:90", "jpeg:85", "jpeg:97", "png"].map(of);
        assert!(ascending.is_sorted() && of("jpeg:100") < 2 * of("jpeg:95"), "{ascending:?}");
        assert!(bytes("png", TileCompression::Meshopt) < of("png"));
    }

    #[test]
    fn the_town_is_planned() {
        let options = TileOptions { tile_faces: 2000, tile_side: 512, ..TileOptions::default() };
        let plan = plan_tiles(Path::new("fixtures/town/town.obj"), &options, &Silent).unwrap();
        assert_eq!(plan.input.triangles, 18_218);
        assert!(plan.levels.len() > 2 && plan.memory < plan.budget);
        assert!(plan.table().contains("level 0") && plan.table().contains("scratch"), "{}", plan.table());
        let on_four = plan.on_machines(4, Some(1_000_000_000));
        assert!(on_four.table().contains("4 machines on a shared disk"), "{}", on_four.table());
    }
}
