//! Choices of the library as values of flags, and options that its messages name as flags.

use clap::ValueEnum;
use clap::builder::PossibleValue;

use crate::options::{
    Borders, Choice, Doubles, MetricChoice, Normals, Pieces, ResumeChoice, Seams, TextureFiles, TexturesOutside,
    TileCompression, Topology, UpAxis, Weld,
};

macro_rules! values_of_flags {
    ($($choice:ty),+ $(,)?) => {
        $(impl ValueEnum for $choice {
            fn value_variants<'a>() -> &'a [Self] {
                Self::ALL
            }

            fn to_possible_value(&self) -> Option<PossibleValue> {
                Some(PossibleValue::new(self.name()).help(self.help()))
            }
        })+
    };
}

values_of_flags!(
    Borders,
    Doubles,
    MetricChoice,
    Normals,
    Pieces,
    ResumeChoice,
    Seams,
    TextureFiles,
    TexturesOutside,
    TileCompression,
    Topology,
    UpAxis,
    Weld,
);

/// Spells the options in a message of the library as flags: `` `weld: off` `` becomes `--weld off`, `` `force` ``
/// becomes `--force`.
pub fn with_flags(message: &str) -> String {
    let mut text = String::new();
    let mut rest = message;
    while let Some((before, after)) = rest.split_once('`') {
        let Some((option, behind)) = after.split_once('`').filter(|(option, _)| is_option(option)) else {
            text.push_str(before);
            text.push('`');
            rest = after;
            continue;
        };
        let (name, value) = option.split_once(": ").unwrap_or((option, ""));
        text.push_str(before);
        text.push_str("--");
        text.push_str(&name.replace('_', "-"));
        if !value.is_empty() {
            text.push(' ');
            text.push_str(value);
        }
        rest = behind;
    }
    text + rest
}

/// Reports whether text is an option: its name, or its name, a colon and a value.
fn is_option(text: &str) -> bool {
    let name = text.split(": ").next().unwrap_or_default();
    name.starts_with(|c: char| c.is_ascii_lowercase()) && name.bytes().all(|b| b.is_ascii_lowercase() || b == b'_')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_in_a_message_are_spelled_as_flags() {
        let spelled = [
            ("a.obj: exists already; `force` replaces it", "a.obj: exists already; --force replaces it"),
            ("`max_error: -1`: expected a length", "--max-error -1: expected a length"),
            ("give `ratio`, `faces` or `max_error`", "give --ratio, --faces or --max-error"),
            ("`cluster_faces: 5` or `memory: 1 GiB`", "--cluster-faces 5 or --memory 1 GiB"),
        ];
        for (message, expected) in spelled {
            assert_eq!(with_flags(message), expected);
        }
    }

    #[test]
    fn other_backticks_stay() {
        for message in ["a`b.obj: cannot open", "`A file.obj`: `", "``", "no option"] {
            assert_eq!(with_flags(message), message);
        }
    }
}
