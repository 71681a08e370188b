//! `drystone plan`: prediction for a run.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::answer::CommandAnswer;
use super::compare::SamplingArguments;
use super::flags::{SimplifyFlags, heading};
use super::input::InputArguments;
use super::print::{print, print_json};
use super::progress::{tell, told};
use super::simplify::Format;
use crate::base::{Error, Progress, Result, bytes, quantity};
use crate::options::{SimplifyOptions, TileCompression, TileOptions};
use crate::pipeline;
use crate::plan::{self, Plan, PyramidPlan};
use crate::report;

/// Arguments of `drystone plan`.
#[derive(Debug, Args)]
pub struct PlanArguments {
    /// Plan a pyramid of tiles, as `drystone tile` makes it; --image as there
    #[arg(long, help_heading = heading::TARGET)]
    #[arg(conflicts_with_all = ["ratio", "faces", "max_error", "remesh", "textures", "texels", "atlas"])]
    #[arg(conflicts_with_all = ["report", "measure", "format"])]
    tile: bool,
    /// With --tile: triangles of a tile at most, 100 to 1 million
    #[arg(long, value_name = "COUNT", default_value_t = TileOptions::default().tile_faces, requires = "tile")]
    #[arg(value_parser = quantity::parse_count, help_heading = heading::TARGET)]
    tile_faces: u64,
    /// With --tile: largest side of a tile's image in texels, a power of two from 256 to 4096
    #[arg(long, value_name = "SIDE", default_value_t = TileOptions::default().tile_side, requires = "tile")]
    #[arg(value_parser = quantity::parse_whole::<u32>, help_heading = heading::TARGET)]
    tile_side: u32,
    /// With --tile: how vertices and triangles are stored
    #[arg(long, value_enum, default_value_t = TileOptions::default().compress, value_name = "CODEC", requires = "tile")]
    #[arg(help_heading = heading::TARGET)]
    compress: TileCompression,
    /// Predict the time on this many machines, each with as many threads as --threads: docs/guide/machines.md
    #[arg(long, value_name = "COUNT", help_heading = heading::JOB)]
    #[arg(value_parser = quantity::parse_whole::<u32>)]
    machines: Option<u32>,
    /// With --machines: bytes per second that their shared disk moves in all, such as 1.1GB [default: no limit]
    #[arg(long, value_name = "SIZE", requires = "machines", value_parser = parse_bandwidth, help_heading = heading::JOB)]
    shared_bandwidth: Option<u64>,
    /// What the run would write: free space is measured where its work folder would be [default: in the current folder]
    #[arg(short, long, value_name = "PATH")]
    output: Option<PathBuf>,
    #[command(flatten)]
    flags: SimplifyFlags,
    #[command(flatten)]
    input: InputArguments,
    #[command(flatten)]
    of_run: RunArguments,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Print the plan and errors only
    #[arg(short, long)]
    quiet: bool,
}

/// Options of `drystone simplify` that change nothing in a plan: it takes them so that one list of options serves both.
#[derive(Debug, Args)]
struct RunArguments {
    /// As `drystone simplify` takes it; a plan writes no report
    #[arg(long, value_name = "FILE", help_heading = heading::REPORT, hide_short_help = true)]
    report: Vec<PathBuf>,
    /// As `drystone simplify` takes it; its time is not planned
    #[arg(long, help_heading = heading::REPORT, hide_short_help = true)]
    measure: bool,
    #[command(flatten)]
    sampling: SamplingArguments,
    /// As `drystone simplify` takes it; json is --json
    #[arg(long, value_enum, value_name = "FORM", default_value_t = Format::Text, help_heading = heading::REPORT)]
    #[arg(hide_short_help = true)]
    format: Format,
}

impl RunArguments {
    /// Checks them as a run would.
    fn check(&self) -> Result<()> {
        self.sampling.check()?;
        self.report.iter().try_for_each(|path| report::ReportKind::of(path).map(drop))
    }
}

impl PlanArguments {
    fn options(&self) -> SimplifyOptions {
        let mut options = self.flags.options();
        if let Some(output) = &self.output {
            options.job.work = Some(pipeline::work_folder(output, &options));
        }
        options
    }

    fn tile_options(&self) -> TileOptions {
        let simplify = self.options();
        TileOptions {
            tile_faces: self.tile_faces,
            tile_side: self.tile_side,
            image: self.flags.image().unwrap_or(TileOptions::default().image),
            compress: self.compress,
            textures_outside: simplify.textures_outside,
            limits: simplify.limits,
            job: simplify.job,
            ..TileOptions::default()
        }
    }

    fn plan(&self, progress: &dyn Progress) -> Result<Plan> {
        self.check_machines()?;
        self.of_run.check()?;
        let plan = plan::plan(self.input.choice(), &self.options(), progress)?;
        Ok(match self.machines {
            Some(machines) => plan.on_machines(machines, self.shared_bandwidth),
            None => plan,
        })
    }

    fn plan_tiles(&self, progress: &dyn Progress) -> Result<PyramidPlan> {
        self.check_machines()?;
        let plan = plan::plan_tiles(self.input.choice(), &self.tile_options(), progress)?;
        Ok(match self.machines {
            Some(machines) => plan.on_machines(machines, self.shared_bandwidth),
            None => plan,
        })
    }

    fn check_machines(&self) -> Result<()> {
        if self.machines == Some(0) {
            return Err(Error::Usage("`machines: 0`: expected 1 or more".into()));
        }
        Ok(())
    }

    fn show(&self, plan: &impl Serialize, table: &str, warnings: &[String]) -> Result<()> {
        if !self.quiet {
            report::warning_lines(warnings, "--json lists them").iter().for_each(|line| tell(line));
        }
        if self.json || self.of_run.format == Format::Json { print_json(plan) } else { print(table) }
    }
}

/// Reads bytes in a second, with or without `/s`.
fn parse_bandwidth(text: &str) -> std::result::Result<u64, String> {
    bytes::parse(text.trim_end().strip_suffix("/s").unwrap_or(text))
}

/// Plans for a program that calls the command, which may ask for more disk space than there is.
///
/// # Errors
/// Those of [`plan::plan`] and [`plan::plan_tiles`].
pub fn answer(arguments: &PlanArguments, progress: &dyn Progress) -> Result<CommandAnswer> {
    if arguments.tile {
        return CommandAnswer::new(0, &arguments.plan_tiles(progress)?);
    }
    CommandAnswer::new(0, &arguments.plan(progress)?)
}

/// Prints the plan.
///
/// # Errors
/// Those of [`plan::plan`] and [`plan::plan_tiles`], and [`Error::NoSpace`](crate::base::Error::NoSpace) after the plan if
/// the disk is too small.
pub fn run(arguments: &PlanArguments) -> Result<u8> {
    let told = told(arguments.quiet);
    if arguments.tile {
        let plan = arguments.plan_tiles(&*told)?;
        drop(told);
        arguments.show(&plan, &plan.table(), &plan.warnings)?;
        plan.scratch.refuse_small_disk()?;
        return Ok(0);
    }
    let plan = arguments.plan(&*told)?;
    drop(told);
    arguments.show(&plan, &plan.table(), &plan.warnings)?;
    plan.scratch.refuse_small_disk()?;
    Ok(0)
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::base::Silent;

    #[derive(Parser)]
    struct PlanAlone {
        #[command(flatten)]
        arguments: PlanArguments,
    }

    #[test]
    fn a_plan_takes_the_options_of_a_run_and_writes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let report = folder.path().join("town.json");
        let run =
            ["--report", report.to_str().unwrap(), "--measure", "--samples", "5000", "--seed", "4", "--format", "json"];
        let job = ["--force", "--resume", "never", "--keep-work", "--no-sync"];
        let arguments = [&["drystone", "fixtures/town/town.obj", "--ratio", "0.1"], &run[..], &job].concat();
        assert!(PlanAlone::parse_from(arguments).arguments.plan(&Silent).is_ok());
        assert!(!report.exists());
        let odd = ["drystone", "fixtures/town/town.obj", "--ratio", "0.1", "--report", "town.txt"];
        assert!(PlanAlone::parse_from(odd).arguments.plan(&Silent).is_err());
    }

    #[test]
    fn free_space_is_measured_where_the_output_will_be() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("out/town.obj");
        let input = "fixtures/town/town.obj";
        let planned = |more: &[&str]| {
            let common = ["drystone", input, "-o", output.to_str().unwrap()];
            PlanAlone::parse_from([&common, more].concat()).arguments
        };
        let plan = planned(&["--ratio", "0.1"]).plan(&Silent).unwrap();
        assert_eq!(plan.scratch.folder, folder.path());
        let pyramid = planned(&["--tile"]).plan_tiles(&Silent).unwrap();
        assert_eq!(pyramid.scratch.folder, folder.path());
        let elsewhere = tempfile::tempdir().unwrap();
        let work = elsewhere.path().to_str().unwrap();
        let plan = planned(&["--ratio", "0.1", "--work", work]).plan(&Silent).unwrap();
        assert_eq!(plan.scratch.folder, elsewhere.path());
        assert!(!folder.path().join("out").exists());
    }
}
