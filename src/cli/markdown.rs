//! `docs/options.md`, written from the definitions of the options, so that it cannot say anything else.

use std::fmt::Write as _;

use clap::{Arg, Command, CommandFactory};

use super::{Cli, exit};

const INTRODUCTION: &str = "\
# Options

This page is printed by `drystone options-markdown`; a test compares the two.

Sizes are written as `512MiB`, `1.5GiB`, `2G` (powers of 1024) or `800MB` (powers of 1000). Lengths are in the unit of
the mesh. The result depends on the input and on the options that shape it, never on `--memory`, `--threads` or `--work`.
";

/// The whole page.
pub fn options_markdown() -> String {
    let mut page = INTRODUCTION.to_owned();
    let mut program = Cli::command();
    program.build();
    for command in program.get_subcommands().filter(|command| !command.is_hide_set() && command.get_name() != "help") {
        describe(&mut page, command);
    }
    page.push_str("\n## Exit codes\n\n| Code | Meaning |\n| --- | --- |\n");
    for (code, meaning) in exit::CODES {
        let _ = writeln!(page, "| {code} | {meaning} |");
    }
    page
}

fn describe(page: &mut String, command: &Command) {
    let about = command.get_about().map(ToString::to_string).unwrap_or_default();
    let positionals: Vec<String> =
        command.get_positionals().map(|argument| argument.get_id().as_str().to_uppercase()).collect();
    let _ = writeln!(page, "\n## drystone {}\n\n{about}.", command.get_name());
    let _ = writeln!(page, "\n```\ndrystone {} {} [OPTIONS]\n```", command.get_name(), positionals.join(" "));
    page.push_str("\n| Option | Default | Meaning |\n| --- | --- | --- |\n");
    for argument in command.get_positionals() {
        let _ = writeln!(page, "| `{}` | | {} |", argument.get_id().as_str().to_uppercase(), meaning(argument));
    }
    let options = command.get_arguments().filter(|argument| !argument.is_positional() && !argument.is_hide_set());
    for argument in options.filter(|argument| argument.get_id().as_str() != "help") {
        let (meaning, default) = split_default(meaning(argument), argument);
        let _ = writeln!(page, "| {} | {default} | {meaning} |", flag(argument));
    }
}

/// `-o`, `--output FILE`.
fn flag(argument: &Arg) -> String {
    let mut text = argument.get_short().map(|short| format!("`-{short}`, ")).unwrap_or_default();
    let _ = write!(text, "`--{}", argument.get_long().unwrap_or_default());
    if argument.get_action().takes_values() {
        match choices(argument).is_empty() {
            true => {
                let names = argument.get_value_names().unwrap_or_default();
                let _ = write!(text, " {}", names.first().map_or("VALUE", |name| name.as_str()));
            }
            false => text.push_str(" …"),
        }
    }
    text + "`"
}

fn choices(argument: &Arg) -> Vec<clap::builder::PossibleValue> {
    if argument.get_action().takes_values() { argument.get_possible_values() } else { Vec::new() }
}

/// The option's words, then its choices with theirs.
fn meaning(argument: &Arg) -> String {
    let mut text = argument.get_help().map(ToString::to_string).unwrap_or_default();
    if argument.is_required_set() && !argument.is_positional() {
        text.push_str(" (needed)");
    }
    for choice in choices(argument) {
        let words = choice.get_help().map(ToString::to_string).unwrap_or_default();
        let _ = write!(text, "<br>`{}`: {}", choice.get_name(), lower_first(&words));
    }
    text.replace('|', "\\|")
}

/// The default: clap's, or the one that the words end with (`[default: …]`).
fn split_default(meaning: String, argument: &Arg) -> (String, String) {
    let defaults = argument.get_default_values();
    if argument.get_action().takes_values()
        && let Some(value) = defaults.first()
    {
        return (meaning, format!("`{}`", value.to_string_lossy()));
    }
    match meaning.split_once(" [default: ").and_then(|(words, rest)| Some((words, rest.split_once(']')?))) {
        Some((words, (default, rest))) => (format!("{words}{rest}"), default.to_owned()),
        None => (meaning, String::new()),
    }
}

fn lower_first(text: &str) -> String {
    let mut characters = text.chars();
    characters.next().map_or(String::new(), |first| first.to_lowercase().chain(characters).collect())
}
