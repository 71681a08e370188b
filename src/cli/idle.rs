//! Options that have no effect beside the others of a command. Who gives one expects something of it, so it is refused.

use std::path::PathBuf;

use clap::ArgMatches;
use clap::parser::ValueSource;

use crate::base::{Error, Result};
use crate::options::{MetricChoice, TextureFiles};
use crate::write::ResultFormat;

/// Options, whether the others of the command let them have an effect, and what they need.
type Need = (&'static [&'static str], bool, &'static str);

/// Refuses options of a command that have no effect; `has_hands` if the caller itself has tasks done.
///
/// # Errors
/// [`Error::Usage`] that names the option and what it needs.
pub fn refuse(matches: &ArgMatches, has_hands: bool) -> Result<()> {
    let Some((command, given)) = matches.subcommand() else { return Ok(()) };
    let idle = needs(command, given, has_hands).into_iter().filter(|(_, has_effect, _)| !has_effect);
    for (options, _, need) in idle {
        if let Some(option) = options.iter().find(|option| is_given(given, option)) {
            return Err(Error::Usage(format!("`{option}` has no effect without {need}")));
        }
    }
    Ok(())
}

fn needs(command: &str, given: &ArgMatches, has_hands: bool) -> [Need; 7] {
    // A command without the other option gives its own meaning to the first.
    let textures = value::<TextureFiles>(given, "textures");
    let makes_images = textures.is_none_or(|files| files == TextureFiles::Bake) || is_given(given, "tile");
    let keeps_images = textures.is_none_or(|files| files != TextureFiles::Bake);
    let moves_images = textures.is_none_or(|files| files != TextureFiles::Reference);
    let measures = value::<bool>(given, "measure").is_none_or(|measures| measures);
    let is_glb = |path: PathBuf| ResultFormat::by_ending(&path) == Some(ResultFormat::Glb);
    let prices_drift =
        value::<MetricChoice>(given, "metric").is_none_or(|metric| metric == MetricChoice::QemAttributes);
    let turns = command == "tile" || value(given, "output").is_none_or(is_glb);
    [
        (&["texels", "atlas", "image"], makes_images, "`textures: bake`"),
        (&["samples", "seed"], measures, "`measure`"),
        (&["uv_weight"], prices_drift, "`metric: qem-attributes`"),
        (&["uv_weight"], keeps_images, "textures that the result keeps"),
        (&["textures_outside"], moves_images, "`textures: copy`"),
        (&["up"], turns, "an output that ends in .glb"),
        (&["tasks", "task_tries"], has_hands || is_given(given, "task_runner"), "`task_runner`"),
    ]
}

/// The value of an option, its default too; `None` if the command does not have it.
fn value<T: Clone + Send + Sync + 'static>(given: &ArgMatches, option: &str) -> Option<T> {
    given.try_get_one::<T>(option).ok().flatten().cloned()
}

/// Whether the user gave an option.
fn is_given(given: &ArgMatches, option: &str) -> bool {
    given.ids().any(|id| id == option) && given.value_source(option) == Some(ValueSource::CommandLine)
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    fn refused(command: &str, has_hands: bool) -> Option<String> {
        let arguments = ["drystone"].into_iter().chain(command.split_whitespace());
        let matches = crate::cli::Cli::command().try_get_matches_from(arguments).unwrap();
        refuse(&matches, has_hands).err().map(|error| error.to_string())
    }

    #[test]
    fn an_option_without_effect_is_refused() {
        for (option, need) in [
            ("texels 3", "`textures: bake`"),
            ("atlas 512", "`textures: bake`"),
            ("image jpeg:5", "`textures: bake`"),
            ("samples 5000", "`measure`"),
            ("seed 4", "`measure`"),
            ("uv-weight 2 --metric terrain", "`metric: qem-attributes`"),
            ("uv-weight 2 --textures bake", "textures that the result keeps"),
            ("textures-outside copy --textures reference", "`textures: copy`"),
            ("up y", "an output that ends in .glb"),
            ("tasks 5", "`task_runner`"),
            ("task-tries 9", "`task_runner`"),
        ] {
            let found = refused(&format!("simplify a.obj -o b.obj --ratio 0.1 --{option}"), false);
            let name = option.split(' ').next().unwrap().replace('-', "_");
            assert_eq!(found, Some(format!("`{name}` has no effect without {need}")));
        }
        assert!(refused("plan a.obj --ratio 0.1 --atlas 512", false).is_some());
        assert!(refused("tile a.obj -o b --tasks 5", false).is_some());
    }

    #[test]
    fn an_option_with_what_it_needs_is_taken() {
        for command in [
            "simplify a.obj -o b.obj --ratio 0.1",
            "simplify a.obj -o b.obj --ratio 0.1 --textures bake --atlas 512 --image jpeg:5 --texels 3",
            "simplify a.obj -o b.GLB --ratio 0.1 --measure --seed 4 --samples 5000 --up y",
            "simplify a.obj -o b.obj --ratio 0.1 --task-runner {stage} --tasks 5 --task-tries 9",
            "plan a.obj --ratio 0.1 --up y",
            "simplify a.obj -o b.obj --ratio 0.1 --uv-weight 2",
            "simplify a.obj -o b.obj --ratio 0.1 --uv-weight 2 --metric qem-attributes",
            "plan a.obj --tile --image png",
            "tile a.obj -o b --up y --image png",
            "compare a.obj b.obj --seed 4 --samples 5000",
            "check a.obj",
        ] {
            assert_eq!(refused(command, false), None, "{command}");
        }
        assert_eq!(refused("simplify a.obj -o b.obj --ratio 0.1 --tasks 5", true), None);
    }
}
