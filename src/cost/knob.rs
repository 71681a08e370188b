//! Constants of a published system that its user may set: `--metric-option name=value`.

/// One such constant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Knob {
    /// Its name.
    pub name: &'static str,
    /// Its value if nothing is said.
    pub default: f64,
    /// Smallest and largest value.
    pub range: [f64; 2],
    /// Names of its values 0, 1, …, if they have any.
    pub words: &'static [&'static str],
    /// What it does.
    pub meaning: &'static str,
}

/// A switch: 0 or 1.
pub const fn switch(name: &'static str, default: f64, meaning: &'static str) -> Knob {
    number(name, default, [0.0, 1.0], meaning)
}

/// A number of any size from 0.
pub const fn factor(name: &'static str, default: f64, meaning: &'static str) -> Knob {
    number(name, default, [0.0, 1e9], meaning)
}

/// A number between two others.
pub const fn number(name: &'static str, default: f64, range: [f64; 2], meaning: &'static str) -> Knob {
    Knob { name, default, range, words: &[], meaning }
}

/// One of several words, the first unless said otherwise; its value is its place among them.
pub const fn choice(name: &'static str, words: &'static [&'static str], meaning: &'static str) -> Knob {
    Knob { name, default: 0.0, range: [0.0, words.len() as f64 - 1.0], words, meaning }
}

impl Knob {
    /// The default as it is written.
    pub fn default_text(&self) -> String {
        self.words.first().map_or_else(|| self.default.to_string(), |word| (*word).to_owned())
    }

    /// The value that a text stands for.
    ///
    /// # Errors
    /// What is accepted, in words.
    fn parse(&self, text: &str) -> Result<f64, String> {
        if !self.words.is_empty() {
            let place = self.words.iter().position(|word| *word == text);
            return place.map(|place| place as f64).ok_or_else(|| format!("expected {}", self.words.join(" or ")));
        }
        let [low, high] = self.range;
        match text.parse::<f64>() {
            Ok(value) if value >= low && value <= high => Ok(value),
            _ => Err(format!("expected {low} to {high}")),
        }
    }
}

/// The values of a system's constants, in their order.
///
/// # Errors
/// Words that name the setting which is unknown, no number, or out of range.
pub fn read<const N: usize>(knobs: &[Knob; N], given: &[String]) -> Result<[f64; N], String> {
    let mut values = knobs.map(|knob| knob.default);
    for setting in given {
        let known = || knobs.map(|knob| knob.name).join(", ");
        let (name, text) = setting.split_once('=').ok_or_else(|| format!("{setting}: expected name=value"))?;
        let Some(at) = knobs.iter().position(|knob| knob.name == name) else {
            let known = if knobs.is_empty() { "this metric has none".into() } else { format!("known are {}", known()) };
            return Err(format!("{setting}: no such setting; {known}"));
        };
        values[at] = knobs[at].parse(text).map_err(|expected| format!("{setting}: {expected}"))?;
    }
    Ok(values)
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOBS: [Knob; 3] =
        [factor("border", 2.0, ""), switch("carry", 1.0, ""), choice("placement", &["optimal", "three"], "")];

    #[test]
    fn settings_replace_defaults_and_mistakes_are_named() {
        assert_eq!(read(&KNOBS, &["carry=0".into()]), Ok([2.0, 0.0, 0.0]));
        assert_eq!(read(&KNOBS, &["placement=three".into(), "border=1e9".into()]), Ok([1e9, 1.0, 1.0]));
        for (wrong, words) in [
            ("edge=1", "border, carry, placement"),
            ("carry=2", "0 to 1"),
            ("carry", "name=value"),
            ("border=x", "0 to"),
            ("placement=1", "optimal or three"),
        ] {
            assert!(read(&KNOBS, &[wrong.into()]).unwrap_err().contains(words), "{wrong}");
        }
    }
}
