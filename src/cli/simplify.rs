//! `drystone simplify`: simplifies one or more meshes into one OBJ, PLY or GLB.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::json;

use super::answer::CommandAnswer;
use super::compare::{ComparisonTask, SamplingArguments};
use super::exit::{code_of, code_of_run};
use super::flags::{SimplifyFlags, heading};
use super::input::InputArguments;
use super::print::{print, print_json};
use super::progress::{of_job, stoppable, tell};
use super::share::JobShare;
use super::stop::{Goodbye, command_line};
use super::words::with_flags;
use crate::base::{Error, Progress, Result};
use crate::job::stage::SharedHands;
use crate::measure::compare::Comparison;
use crate::options::{Drawing, ReportNotes, SimplifyOptions};
use crate::os::signals::StopSignal;
use crate::pipeline;
use crate::read::InputChoice;
use crate::report;
use crate::report::Report;
use crate::report::gallery::Relief;
use crate::write::ResultFormat;

/// Text after `-h`.
pub const MORE: &str = "--help has every option, each with its choices, and examples.";

/// Text after `--help`.
pub const EXAMPLES: &str = "\
Examples:
  drystone simplify city.obj -o out/city.obj --ratio 10%
      Keep a tenth of the triangles; MTL and textures go beside the result.
  drystone simplify tiles/ -o out/city.obj --faces 2M --memory 1GiB --exclude '*_lod*'
      Join every OBJ in and below tiles/, but those named *_lod*, into one mesh of 2 million triangles, within 1 GiB.
  drystone simplify city.obj -o out/city.obj --max-error 0.05 --report out/city.html
      Remove whatever moves the surface by less than 0.05 units; write a page with renderings and plots.
  drystone simplify city.obj -o out/city.obj --ratio 0.1 --quiet --format json | jq .faces
      Print the report as JSON and nothing else.
  drystone status out/city.obj.work
      See, from another terminal, how far it is. A stopped or killed job resumes with the command that started it.";

/// Arguments of `drystone simplify`.
#[derive(Debug, Args)]
pub struct SimplifyArguments {
    /// Mesh file to write: OBJ, PLY or GLB, by the name's ending; MTL and textures go beside it, those
    /// of a GLB into it
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    flags: SimplifyFlags,
    #[command(flatten)]
    input: InputArguments,
    /// Write a report: .json for scripts, .html for people; an older one is replaced; may be repeated
    #[arg(long, value_name = "FILE", help_heading = heading::REPORT)]
    report: Vec<PathBuf>,
    /// Compare the result with the input, as `drystone compare` does
    ///
    /// The reports get the numbers; exit code 1 if --max-error is broken
    #[arg(long, help_heading = heading::REPORT)]
    measure: bool,
    #[command(flatten)]
    sampling: SamplingArguments,
    /// Form of the summary on stdout
    #[arg(long, value_enum, value_name = "FORM", default_value_t = Format::Text, help_heading = heading::REPORT)]
    format: Format,
    /// Print the summary and errors only
    #[arg(short, long, help_heading = heading::REPORT)]
    quiet: bool,
    /// What other commands call it; refused with words that help
    #[arg(long, hide = true)]
    json: bool,
}

/// Form of what a command prints on stdout.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// Lines of `key: value`, numbers without blanks
    Text,
    /// The report, as one JSON object
    Json,
}

/// Simplifies, compares if asked to, prints the summary and warnings, and returns the exit code. With `--format json`
/// stdout gets one object, also if the run fails or its options are not `usable` together.
///
/// # Errors
/// That of `usable`, those of [`pipeline::simplify`] and of the reports.
pub fn run(arguments: &SimplifyArguments, usable: Result<()>) -> Result<u8> {
    if arguments.json {
        return Err(Error::Usage("--json: simplify prints its report as JSON with --format json".into()));
    }
    let mut is_printed = false;
    let outcome = usable.and_then(|()| simplify(arguments, &mut is_printed));
    if arguments.format == Format::Json && !is_printed {
        let (status, code) = match &outcome {
            Ok(code) => ("stopped", *code),
            Err(error) => ("failed", code_of(error)),
        };
        let error = outcome.as_ref().err().unwrap_or(&Error::Stopped).to_string();
        print_json(&json!({ "status": status, "exit_code": code, "error": with_flags(&error) }))?;
    }
    outcome
}

fn simplify(arguments: &SimplifyArguments, is_printed: &mut bool) -> Result<u8> {
    let SimplifyArguments { input, output, measure, sampling, quiet, .. } = arguments;
    let options = arguments.options()?;
    let choice = input.choice();
    let stop = StopSignal::listen()?;
    let work = pipeline::work_folder(output, &options);
    let goodbye = Goodbye::of_job(&stop, &work);
    let samples = if *measure { sampling.samples() } else { 0 };
    // A quiet run has no bar, so it need not examine the input for one.
    let told = if *quiet {
        stoppable(true, stop.clone())
    } else {
        of_job(stop.clone(), JobShare::of(&choice, &options, samples), &work)
    };
    let outcome = arguments.simplify(&choice, &options, &*told, || goodbye.only_compares(&choice, output));
    drop(told);
    let (result, failure) = match outcome {
        Err(Error::Stopped) => return Ok(goodbye.say()),
        outcome => outcome?,
    };
    arguments.say(&result)?;
    *is_printed = true;
    match failure {
        Some(Error::Stopped) => Ok(goodbye.say()),
        Some(error) => Err(error),
        None => Ok(code_of_run(&result)),
    }
}

/// Simplifies for a program that calls the command.
///
/// # Errors
/// Those of [`run`].
pub fn answer(
    arguments: &SimplifyArguments,
    hands: Option<SharedHands>,
    progress: &dyn Progress,
) -> Result<CommandAnswer> {
    let mut options = arguments.options()?;
    options.job.hands = hands;
    options.notes.command = None;
    match arguments.simplify(&arguments.input.choice(), &options, progress, || ())? {
        (_, Some(error)) => Err(error),
        (result, None) => CommandAnswer::new(code_of_run(&result), &result),
    }
}

impl SimplifyArguments {
    /// Simplifies, writes the reports, and compares if asked to. The result is complete even if the comparison fails,
    /// whose error is then returned, too. Calls `on_written` before the comparison.
    fn simplify(
        &self,
        choice: &InputChoice,
        options: &SimplifyOptions,
        progress: &dyn Progress,
        on_written: impl FnOnce(),
    ) -> Result<(Report, Option<Error>)> {
        let mut number = 0;
        // Reports are written before the job ends: if one cannot be written, the same command resumes the job.
        let mut result = pipeline::simplify_and(choice.clone(), &self.output, options, progress, |result, job| {
            number = job;
            self.report.iter().try_for_each(|path| result.save(path, job))
        })?;
        on_written();
        if !self.measure {
            return Ok((result, None));
        }
        let work = work_beside(&pipeline::work_folder(&self.output, options));
        let compared = self.compare(choice, &mut result, work, progress);
        let failure = compared.map(|comparison| result.comparison = Some(comparison)).err();
        self.report.iter().try_for_each(|path| result.save(path, number))?;
        Ok((result, failure))
    }

    /// The options, once the reports can be written.
    fn options(&self) -> Result<SimplifyOptions> {
        self.sampling.check()?;
        let kinds = report::ReportKind::prepare(&self.report)?;
        if self.measure && ResultFormat::by_ending(&self.output) == Some(ResultFormat::Glb) {
            let words = "`measure` reads the result, and a GLB is not read: write an OBJ or a PLY to measure";
            return Err(Error::Usage(words.into()));
        }
        let drawing = match (kinds.contains(&report::ReportKind::Html), self.measure) {
            (false, _) => Drawing::Nothing,
            (true, false) => Drawing::Renderings,
            (true, true) => Drawing::RenderingsAndErrors,
        };
        let notes = ReportNotes {
            drawing,
            exclude: self.input.choice().exclude,
            measure: self.measure,
            samples: self.measure.then(|| self.sampling.samples()),
            seed: self.measure.then(|| self.sampling.seed()),
            command: Some(command_line()),
        };
        Ok(SimplifyOptions { notes, ..self.flags.options() })
    }

    /// Compares the result with the input; colours the renderings of the result by error.
    fn compare(
        &self,
        choice: &InputChoice,
        result: &mut Report,
        work: PathBuf,
        progress: &dyn Progress,
    ) -> Result<Comparison> {
        let task = |kept_bytes| ComparisonTask {
            meshes: [choice.clone(), self.output.as_path().into()],
            sampling: self.sampling,
            limits: result.options.limits,
            kept_bytes,
            work,
        };
        match &mut result.shots {
            Some([_, after]) => task(Relief::BYTES).run(after, progress),
            None => task(0).run(&mut (), progress),
        }
    }

    /// Prints the summary on stdout, warnings on stderr.
    fn say(&self, result: &Report) -> Result<()> {
        if !self.quiet {
            tell_lines(result.warning_lines());
        }
        tell_lines(result.target_lines());
        tell_lines(result.broken_bound().into_iter().collect());
        match self.format {
            Format::Json => print_json(result),
            Format::Text => print(&result.summary()),
        }
    }
}

/// The work folder of a comparison, beside that of the run.
fn work_beside(work: &Path) -> PathBuf {
    let mut name = work.file_name().unwrap_or_default().to_owned();
    name.push("-measure");
    work.with_file_name(name)
}

/// Prints lines on stderr, so that a script that reads the summary does not see them.
fn tell_lines(lines: Vec<String>) {
    lines.iter().for_each(|line| tell(line));
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    #[test]
    fn the_short_help_is_one_screen() {
        let mut program = crate::cli::Cli::command().term_width(100);
        program.build();
        let simplify = program.find_subcommand_mut("simplify").unwrap();
        let (short, long) = (simplify.render_help().to_string(), simplify.render_long_help().to_string());
        assert!(short.lines().count() <= 40, "{short}");
        assert!(short.lines().chain(long.lines()).all(|line| line.chars().count() <= 100), "{long}");
        let headings = ["Target:", "Input:", "Texture:", "Job:", "Methods of papers:", "Report:", "Examples:"];
        let places = headings.map(|heading| long.find(&format!("\n{heading}\n")));
        assert!(places.iter().all(Option::is_some) && places.is_sorted(), "{places:?}");
    }
}
