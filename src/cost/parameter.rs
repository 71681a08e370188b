//! Parameters of a cost function that a user may set: `--metric-option name=value`.

/// One parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Its name.
    pub name: &'static str,
    /// Its default value.
    pub default: f64,
    /// Smallest and largest value.
    pub range: [f64; 2],
    /// Names of its values 0, 1, …; empty for a number.
    pub words: &'static [&'static str],
    /// What it does, for the help text.
    pub meaning: &'static str,
}

/// A switch, 0 or 1, or a share: any number between is accepted.
pub const fn switch(name: &'static str, default: f64, meaning: &'static str) -> Parameter {
    number(name, default, [0.0, 1.0], meaning)
}

/// A number from 0 to 10⁹.
pub const fn factor(name: &'static str, default: f64, meaning: &'static str) -> Parameter {
    number(name, default, [0.0, 1e9], meaning)
}

/// A number within a range, ends included.
pub const fn number(name: &'static str, default: f64, range: [f64; 2], meaning: &'static str) -> Parameter {
    Parameter { name, default, range, words: &[], meaning }
}

/// One of several words, by default the first; its value is the index of the word.
pub const fn choice(name: &'static str, words: &'static [&'static str], meaning: &'static str) -> Parameter {
    Parameter { name, default: 0.0, range: [0.0, words.len() as f64 - 1.0], words, meaning }
}

impl Parameter {
    /// The default as a user would type it.
    pub fn default_text(&self) -> String {
        self.words.first().map_or_else(|| self.default.to_string(), |word| (*word).to_owned())
    }

    /// Parses a value.
    ///
    /// # Errors
    /// Words that describe the accepted values.
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

/// Values of all parameters, in the order of `parameters`; `given` holds settings as `name=value`.
///
/// # Errors
/// Words that name the setting that is unknown, not a number, or out of range.
pub fn read<const N: usize>(parameters: &[Parameter; N], given: &[String]) -> Result<[f64; N], String> {
    let mut values = parameters.map(|parameter| parameter.default);
    for setting in given {
        let known = || parameters.map(|parameter| parameter.name).join(", ");
        let (name, text) = setting.split_once('=').ok_or_else(|| format!("{setting}: expected name=value"))?;
        let Some(at) = parameters.iter().position(|parameter| parameter.name == name) else {
            let known =
                if parameters.is_empty() { "this metric has none".into() } else { format!("known are {}", known()) };
            return Err(format!("{setting}: no such setting; {known}"));
        };
        values[at] = parameters[at].parse(text).map_err(|expected| format!("{setting}: {expected}"))?;
    }
    Ok(values)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARAMETERS: [Parameter; 3] =
        [factor("border", 2.0, ""), switch("carry", 1.0, ""), choice("placement", &["optimal", "three"], "")];

    #[test]
    fn settings_replace_defaults_and_mistakes_are_named() {
        assert_eq!(read(&PARAMETERS, &["carry=0".into()]), Ok([2.0, 0.0, 0.0]));
        assert_eq!(read(&PARAMETERS, &["placement=three".into(), "border=1e9".into()]), Ok([1e9, 1.0, 1.0]));
        for (wrong, words) in [
            ("edge=1", "border, carry, placement"),
            ("carry=2", "0 to 1"),
            ("carry", "name=value"),
            ("border=x", "0 to"),
            ("placement=1", "optimal or three"),
        ] {
            assert!(read(&PARAMETERS, &[wrong.into()]).unwrap_err().contains(words), "{wrong}");
        }
    }
}
