//! `drystone completions` and `drystone man`: generated from the definitions of the options, as `--help` is.

use std::path::PathBuf;

use clap::{ArgAction, Args, Command};
use clap_complete::Shell;
use clap_mangen::Man;

use super::print::print;
use super::version;
use crate::base::{Error, Result};

/// Arguments of `drystone completions`.
#[derive(Debug, Args)]
pub struct CompletionsArguments {
    /// Shell that reads the script
    #[arg(value_enum)]
    shell: Shell,
}

/// Arguments of `drystone man`.
#[derive(Debug, Args)]
pub struct ManArguments {
    /// Folder to write drystone.1, drystone-simplify.1 and so on to; it is created if need be
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Prints the completion script of `program`.
///
/// # Errors
/// Those of [`print`].
pub fn print_completions(arguments: &CompletionsArguments, mut program: Command) -> Result<u8> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut program, "drystone", &mut script);
    print(&String::from_utf8_lossy(&script))?;
    Ok(0)
}

/// Writes a manual page for `program` and one for each of its commands.
///
/// # Errors
/// The file system's.
pub fn write_pages(arguments: &ManArguments, program: Command) -> Result<u8> {
    let folder = &arguments.out;
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, "create", e))?;
    let mut program = program.disable_help_subcommand(true);
    program.build();
    let shown = program.get_subcommands().filter(|command| !command.is_hide_set());
    for command in std::iter::once(&program).chain(shown) {
        let name = command.get_display_name().unwrap_or(command.get_name());
        let path = folder.join(format!("{name}.1"));
        let text = page(command, name).map_err(|e| Error::io(&path, "write", e))?;
        std::fs::write(&path, text).map_err(|e| Error::io(&path, "write", e))?;
    }
    Ok(0)
}

/// The manual page of a command.
fn page(command: &Command, name: &str) -> std::io::Result<Vec<u8>> {
    let man = Man::new(command.clone().version(version::SHORT))
        .title(name.to_uppercase())
        .source(format!("drystone {}", version::SHORT))
        .manual("drystone manual");
    let mut text = Vec::new();
    man.render_title(&mut text)?;
    man.render_name_section(&mut text)?;
    text.extend(synopsis(command).into_bytes());
    man.render_description_section(&mut text)?;
    man.render_options_section(&mut text)?;
    if command.get_subcommands().any(|command| !command.is_hide_set()) {
        man.render_subcommands_section(&mut text)?;
    }
    let more = command.get_after_long_help().or(command.get_after_help()).map(ToString::to_string).unwrap_or_default();
    // `Examples:` and lines, which are printed unchanged.
    if let Some((heading, lines)) = more.split_once(":\n") {
        let lines: String = lines.lines().map(|line| roff(line) + "\n").collect();
        text.extend(format!(".SH {}\n.nf\n{lines}.fi\n", heading.to_uppercase()).into_bytes());
    }
    man.render_version_section(&mut text)?;
    Ok(text)
}

/// Synopsis of a command: each option with the name of its value, optional ones in brackets.
fn synopsis(command: &Command) -> String {
    let bin = command.get_bin_name().unwrap_or(command.get_name());
    let mut text = format!(".SH SYNOPSIS\n\\fB{}\\fR", roff(bin));
    for argument in command.get_arguments().filter(|argument| !argument.is_hide_set()) {
        let names = argument.get_value_names().unwrap_or_default();
        let value = if argument.is_positional() || argument.get_action().takes_values() {
            names.first().map(|name| format!("\\fI{}\\fR", roff(name)))
        } else {
            None
        };
        let flag = argument.get_long().map(|long| format!("\\fB\\-\\-{}\\fR", roff(long)));
        let words = [flag, value].into_iter().flatten().collect::<Vec<_>>().join(" ");
        let more =
            if argument.is_positional() && matches!(argument.get_action(), ArgAction::Append) { "..." } else { "" };
        text += &if argument.is_required_set() { format!(" {words}{more}") } else { format!(" [{words}{more}]") };
    }
    if command.has_subcommands() {
        text += " \\fICOMMAND\\fR";
    }
    text + "\n"
}

/// A line of text with the characters escaped that a manual page treats as commands.
fn roff(line: &str) -> String {
    let text = line.replace('\\', "\\e").replace('-', "\\-");
    if text.starts_with(['.', '\'']) { format!("\\&{text}") } else { text }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::super::Cli;
    use super::*;

    #[test]
    fn every_command_has_a_page_and_every_page_the_options() {
        let folder = tempfile::tempdir().unwrap();
        write_pages(&ManArguments { out: folder.path().join("man") }, Cli::command()).unwrap();
        let page = |name: &str| std::fs::read_to_string(folder.path().join("man").join(name)).unwrap();
        for command in Cli::command().get_subcommands().filter(|command| !command.is_hide_set()) {
            assert!(page("drystone.1").contains(command.get_name()), "{}", command.get_name());
            page(&format!("drystone-{}.1", command.get_name()));
        }
        let simplify = page("drystone-simplify.1");
        let is_there = |name: &str| simplify.contains(&name.replace('-', "\\-"));
        assert!(["ratio", "max-error", "metric-option"].into_iter().all(is_there), "{simplify}");
        let has = |words: &str| assert!(simplify.contains(words), "{words}: {simplify}");
        has(".TH DRYSTONE-SIMPLIFY 1");
        has(".SH EXAMPLES\n.nf\n  drystone simplify city.obj");
        has("\\fB\\-\\-output\\fR \\fIFILE\\fR");
        has("[\\fB\\-\\-ratio\\fR \\fISHARE\\fR]");
        for name in ["drystone.1", "drystone-simplify.1", "drystone-status.1"] {
            assert!(page(name).contains(&format!("drystone {}", version::SHORT)) && !page(name).contains(".SH EXTRA"));
        }
        assert!(page("drystone.1").contains(".SH EXIT CODES\n.nf\n"));
    }

    #[test]
    fn every_shell_completes_every_command() {
        for shell in [Shell::Bash, Shell::Zsh, Shell::Fish, Shell::Elvish, Shell::PowerShell] {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "drystone", &mut script);
            let script = String::from_utf8(script).unwrap();
            assert!(["simplify", "compare", "max-error"].iter().all(|word| script.contains(word)), "{shell}");
        }
    }
}
