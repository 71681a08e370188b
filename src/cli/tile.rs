//! `drystone tile`: makes a pyramid of tiles that a browser streams.

use std::path::PathBuf;

use clap::Args;

use super::answer::CommandAnswer;
use super::flags::{JobFlags, heading};
use super::input::InputArguments;
use super::print::{print, print_json};
use super::progress::{stoppable, tell};
use super::stop::Goodbye;
use crate::base::{Error, Progress, Result, quantity};
use crate::job::stage::SharedHands;
use crate::options::{GeoPlace, ImageFormat, TexturesOutside, TileCompression, TileOptions, UpAxis};
use crate::os::signals::StopSignal;
use crate::pipeline;
use crate::report;

/// Arguments of `drystone tile`.
#[derive(Debug, Args)]
pub struct TileArguments {
    /// Folder to write, with tileset.json and the tiles
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    #[command(flatten)]
    flags: TileFlags,
    #[command(flatten)]
    input: InputArguments,
    /// Print the figures of the levels as JSON
    #[arg(long)]
    json: bool,
    /// Print the figures and errors only
    #[arg(short, long)]
    quiet: bool,
}

/// Flags that shape a pyramid.
#[derive(Debug, Clone, Args)]
pub struct TileFlags {
    /// Triangles of a tile at most, 100 to 1 million
    #[arg(long, value_name = "COUNT", default_value_t = TileOptions::default().tile_faces)]
    #[arg(value_parser = quantity::parse_count)]
    tile_faces: u64,

    /// Largest side of a tile's image in texels, a power of two from 256 to 4096
    #[arg(long, value_name = "SIDE", default_value_t = TileOptions::default().tile_side)]
    #[arg(value_parser = quantity::parse_whole::<u32>)]
    tile_side: u32,

    /// Format of the images: png, or jpeg, webp or ktx2, with :QUALITY, from 1 to 100, or without (90, 80, 75)
    ///
    /// webp and ktx2 need a program that is built with the feature of that name, and viewers that know EXT_texture_webp
    /// or KHR_texture_basisu
    #[arg(long, value_name = "FORMAT", default_value_t = TileOptions::default().image)]
    image: ImageFormat,

    /// How vertices and triangles are stored
    #[arg(long, value_enum, default_value_t = TileOptions::default().compress, value_name = "CODEC")]
    compress: TileCompression,

    /// Geometric error of a tile, as a multiple of the larger of its texel and its deviation
    ///
    /// Viewers show the next finer tiles where an error takes more than 16 pixels
    #[arg(long, value_name = "FACTOR", default_value_t = TileOptions::default().error_factor)]
    #[arg(value_parser = quantity::parse_number)]
    error_factor: f64,

    /// Which axis of the input points up
    #[arg(long, value_enum, default_value_t = UpAxis::Z, value_name = "AXIS")]
    up: UpAxis,

    /// Where on earth the input's (0, 0, 0) lies: degrees and metres above the ellipsoid, 0 by default; its x axis points
    /// east
    #[arg(long, value_name = "LONGITUDE,LATITUDE[,HEIGHT]", allow_hyphen_values = true)]
    origin: Option<GeoPlace>,

    /// Coordinate reference system of the input: an EPSG code such as EPSG:32650, or a PROJ string
    ///
    /// Each vertex is projected. x points east, y north; heights are above the ellipsoid, in the unit of the system
    #[arg(long, value_name = "SYSTEM", allow_hyphen_values = true, conflicts_with = "origin")]
    crs: Option<String>,

    /// Added to the coordinates of the input before --crs is applied
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, requires = "crs")]
    #[arg(value_parser = quantity::parse_three)]
    offset: Option<[f64; 3]>,

    /// What to do with images that an MTL names outside its own folder, also by absolute paths
    #[arg(long, value_enum, value_name = "HOW", default_value_t = TexturesOutside::Refer)]
    textures_outside: TexturesOutside,

    #[command(flatten)]
    job: JobFlags,

    /// Write into a folder that holds files; those of the same names are replaced
    #[arg(long, help_heading = heading::JOB)]
    force: bool,
}

impl TileFlags {
    /// The options that the flags are.
    pub fn options(&self) -> TileOptions {
        let flags = self.clone();
        TileOptions {
            tile_faces: flags.tile_faces,
            tile_side: flags.tile_side,
            image: flags.image,
            compress: flags.compress,
            error_factor: flags.error_factor,
            up: flags.up,
            origin: flags.origin,
            crs: flags.crs,
            offset: flags.offset.unwrap_or_default(),
            textures_outside: flags.textures_outside,
            limits: flags.job.limits(),
            job: flags.job.options(flags.force),
        }
    }
}

/// Makes the tiles and prints the figures of the levels.
///
/// # Errors
/// Those of [`pipeline::tile`].
pub fn run(arguments: &TileArguments) -> Result<u8> {
    let TileArguments { output, flags, input, json, quiet } = arguments;
    let options = flags.options();
    let stop = StopSignal::listen()?;
    let work = pipeline::work_folder(output, &options.simplify_options());
    let goodbye = Goodbye::of_job(&stop, &work);
    let told = stoppable(*quiet, stop);
    let report = match pipeline::tile(input.choice(), output, &options, &*told) {
        Err(Error::Stopped) => return Ok(goodbye.say()),
        outcome => outcome?,
    };
    drop(told);
    if !quiet {
        report::warning_lines(&report.warnings, "--json lists them").iter().for_each(|line| tell(line));
    }
    if *json {
        print_json(&report)?
    } else {
        print(&report.table())?
    }
    Ok(0)
}

/// Makes the tiles for a program that calls the command.
///
/// # Errors
/// Those of [`pipeline::tile`].
pub fn answer(arguments: &TileArguments, hands: Option<SharedHands>, progress: &dyn Progress) -> Result<CommandAnswer> {
    let TileArguments { output, flags, input, .. } = arguments;
    let mut options = flags.options();
    options.job.hands = hands;
    CommandAnswer::new(0, &pipeline::tile(input.choice(), output, &options, progress)?)
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct TilesAlone {
        #[command(flatten)]
        flags: TileFlags,
    }

    #[test]
    fn no_flag_means_the_defaults_of_the_library() {
        assert_eq!(TilesAlone::parse_from(["drystone"]).flags.options(), TileOptions::default());
    }
}
