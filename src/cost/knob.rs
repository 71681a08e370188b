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
    /// What it does.
    pub meaning: &'static str,
}

/// A switch: 0 or 1.
pub const fn switch(name: &'static str, default: f64, meaning: &'static str) -> Knob {
    Knob { name, default, range: [0.0, 1.0], meaning }
}

/// A number of any size from 0.
pub const fn factor(name: &'static str, default: f64, meaning: &'static str) -> Knob {
    Knob { name, default, range: [0.0, 1e9], meaning }
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
        let [low, high] = knobs[at].range;
        values[at] = match text.parse::<f64>() {
            Ok(value) if value >= low && value <= high => value,
            _ => return Err(format!("{setting}: expected {low} to {high}")),
        };
    }
    Ok(values)
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOBS: [Knob; 2] = [factor("border", 2.0, ""), switch("carry", 1.0, "")];

    #[test]
    fn settings_replace_defaults_and_mistakes_are_named() {
        assert_eq!(read(&KNOBS, &["carry=0".into()]), Ok([2.0, 0.0]));
        for (wrong, words) in
            [("edge=1", "border, carry"), ("carry=2", "0 to 1"), ("carry", "name=value"), ("border=x", "0 to")]
        {
            assert!(read(&KNOBS, &[wrong.into()]).unwrap_err().contains(words), "{wrong}");
        }
    }
}
