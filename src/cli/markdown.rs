//! Generates `docs/reference/options.md` from the definitions of the options, so that the two agree.

use std::fmt::Write as _;

use clap::{Arg, Command, CommandFactory};

use super::{Cli, exit};

const INTRODUCTION: &str = "\
# Options

This page is printed by `drystone options-markdown`; a test compares the two.
[Choosing](../guide/choosing.md) says which options to start with.

Sizes are written as `512MiB`, `1.5GiB`, `2G` (powers of 1024) or `800MB` (powers of 1000). Lengths
are in the unit of the mesh. The result depends on the input and on the options that shape it, never
on `--memory`, `--threads` or `--work`.
";

/// The whole page.
pub fn options_markdown() -> String {
    let mut page = INTRODUCTION.to_owned();
    let mut program = Cli::command();
    program.build();
    let simplify = program.find_subcommand("simplify").cloned().unwrap_or_default();
    for command in program.get_subcommands().filter(|command| !command.is_hide_set() && command.get_name() != "help") {
        describe(&mut page, command, &simplify);
    }
    page.push_str("\n## Exit codes\n\n| Code | Meaning |\n| --- | --- |\n");
    for (code, meaning) in exit::CODES {
        let _ = writeln!(page, "| {code} | {meaning} |");
    }
    page
}

/// Appends a section for a command: its arguments, then its options by heading; options shared with `simplify` only
/// once.
fn describe(page: &mut String, command: &Command, simplify: &Command) {
    let about = command.get_about().map(ToString::to_string).unwrap_or_default();
    let positionals: Vec<String> =
        command.get_positionals().map(|argument| argument.get_id().as_str().to_uppercase()).collect();
    let _ = writeln!(page, "\n## drystone {}\n\n{about}.", command.get_name());
    let usage = [vec![format!("drystone {}", command.get_name())], positionals, vec!["[OPTIONS]".to_owned()]];
    let _ = writeln!(page, "\n```\n{}\n```", usage.concat().join(" "));
    let is_other = command.get_name() != simplify.get_name();
    let takes_all = is_other && command.get_arguments().any(|argument| argument.get_id() == "ratio");
    if takes_all {
        page.push_str("\nTakes the options of [simplify](#drystone-simplify), and:\n");
    }
    let is_said = |argument: &Arg| {
        takes_all && simplify.get_arguments().any(|other| !other.is_hide_set() && other.get_id() == argument.get_id())
    };
    let is_of_each = |argument: &Arg| argument.get_id() == "quiet" || argument.get_id() == "output";
    let options: Vec<&Arg> = command
        .get_arguments()
        .filter(|argument| !argument.is_hide_set() && argument.get_id() != "help" && argument.get_id() != "version")
        .filter(|argument| argument.is_positional() || is_of_each(argument) || !is_said(argument))
        .collect();
    let mut headings: Vec<Option<&str>> = Vec::new();
    for argument in &options {
        if !headings.contains(&argument.get_help_heading()) {
            headings.push(argument.get_help_heading());
        }
    }
    for heading in headings {
        if let Some(heading) = heading {
            let _ = writeln!(page, "\n### {heading}");
        }
        page.push_str("\n| Option | Default | Meaning |\n| --- | --- | --- |\n");
        for argument in options.iter().filter(|argument| argument.get_help_heading() == heading) {
            let (meaning, default) = split_default(meaning(argument), argument);
            let _ = writeln!(page, "| {} | {default} | {meaning} |", flag(argument));
        }
    }
}

/// `-o`, `--output FILE`.
fn flag(argument: &Arg) -> String {
    if argument.is_positional() {
        return format!("`{}`", argument.get_id().as_str().to_uppercase());
    }
    let mut text = argument.get_short().map(|short| format!("`-{short}`, ")).unwrap_or_default();
    let _ = write!(text, "`--{}", argument.get_long().unwrap_or_default());
    if argument.get_action().takes_values() {
        if choices(argument).is_empty() {
            let names = argument.get_value_names().unwrap_or_default();
            let _ = write!(text, " {}", names.first().map_or("VALUE", |name| name.as_str()));
        } else {
            text.push_str(" …")
        }
    }
    text + "`"
}

fn choices(argument: &Arg) -> Vec<clap::builder::PossibleValue> {
    if argument.get_action().takes_values() { argument.get_possible_values() } else { Vec::new() }
}

/// Description of an option, followed by its choices and their descriptions.
fn meaning(argument: &Arg) -> String {
    let words = argument.get_long_help().or(argument.get_help());
    let words = words.map(ToString::to_string).unwrap_or_default();
    // Paragraphs of `--help` become sentences of one cell; a default stands behind the last.
    let mut text = words.replace("\n\n[", " [").replace("\n\n", ". ").replace('\n', " ");
    if argument.is_required_set() && !argument.is_positional() {
        text.push_str(" (required)");
    }
    for choice in choices(argument) {
        let _ = write!(text, "<br>`{}`", choice.get_name());
        if let Some(words) = choice.get_help() {
            let _ = write!(text, ": {}", lower_first(&words.to_string()));
        }
    }
    text.replace('|', "\\|")
}

/// Splits off the default: clap's, or the one at the end of the description (`[default: …]`).
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
