//! `drystone completions` and `drystone man`: made from the definitions of the options, as `--help` is.

use std::path::PathBuf;

use clap::{Args, CommandFactory};
use clap_complete::Shell;

use super::Cli;
use super::print::print;
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

/// Prints the script.
///
/// # Errors
/// Those of [`print`].
pub fn print_completions(arguments: &CompletionsArguments) -> Result<u8> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut Cli::command(), "drystone", &mut script);
    print(&String::from_utf8_lossy(&script))?;
    Ok(0)
}

/// Writes one page for the program and one for each command.
///
/// # Errors
/// The file system's.
pub fn write_pages(arguments: &ManArguments) -> Result<u8> {
    let folder = &arguments.out;
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, "create", e))?;
    clap_mangen::generate_to(Cli::command(), folder).map_err(|e| Error::io(folder, "write to", e))?;
    Ok(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_has_a_page_and_every_page_the_options() {
        let folder = tempfile::tempdir().unwrap();
        write_pages(&ManArguments { out: folder.path().join("man") }).unwrap();
        let page = |name: &str| std::fs::read_to_string(folder.path().join("man").join(name)).unwrap();
        for command in Cli::command().get_subcommands().filter(|command| !command.is_hide_set()) {
            assert!(page("drystone.1").contains(command.get_name()), "{}", command.get_name());
            page(&format!("drystone-{}.1", command.get_name()));
        }
        let simplify = page("drystone-simplify.1");
        let is_there = |name: &str| simplify.contains(&name.replace('-', "\\-"));
        assert!(["ratio", "max-error", "metric-option"].into_iter().all(is_there), "{simplify}");
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
