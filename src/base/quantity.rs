//! Parses numbers on the command line: `10%`, `50k`, `1.5M`.

use std::str::FromStr;

/// Parses a share such as `0.1` or `10%`. Does not check its range.
///
/// # Errors
/// A description of what is expected.
pub fn parse_share(text: &str) -> Result<f64, String> {
    let expected = || "expected a share such as 0.1 or 10%".to_owned();
    let text = text.trim();
    match text.strip_suffix('%') {
        Some(percent) => percent.trim_end().parse::<f64>().map(|percent| percent / 100.0).map_err(|_| expected()),
        None => text.parse().map_err(|_| expected()),
    }
}

/// Parses a count such as `50000`, `50k` or `1.5M` (thousands and millions).
///
/// # Errors
/// A description of what is expected, also for a count that is not an integer or exceeds 10^15.
pub fn parse_count(text: &str) -> Result<u64, String> {
    let expected = || "expected a whole number such as 50000, 50k or 1.5M".to_owned();
    let text = text.trim();
    let (number, factor) = match text.strip_suffix(['k', 'K']) {
        Some(number) => (number, 1e3),
        None => match text.strip_suffix(['m', 'M']) {
            Some(number) => (number, 1e6),
            None => return text.parse().map_err(|_| expected()),
        },
    };
    if !number.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.') {
        return Err(expected());
    }
    // NOTE: 1.001 thousand is 1000.9999999999999 in binary; a count within a millionth of an integer is meant to be
    // one.
    let count: f64 = number.parse::<f64>().map_err(|_| expected())? * factor;
    let whole = count.round();
    if (count - whole).abs() > 1e-6 || whole > 1e15 {
        return Err(expected());
    }
    Ok(whole as u64)
}

/// Parses a length such as `0.05`. Does not check its range.
///
/// # Errors
/// A description of what is expected.
pub fn parse_length(text: &str) -> Result<f64, String> {
    text.trim().parse().map_err(|_| "expected a length in the mesh's unit, such as 0.05".to_owned())
}

/// Parses a number.
///
/// # Errors
/// A description of what is expected.
pub fn parse_number(text: &str) -> Result<f64, String> {
    text.trim().parse().map_err(|_| "expected a number such as 0.7".to_owned())
}

/// Parses three numbers with commas between them.
///
/// # Errors
/// A description of what is expected.
pub fn parse_three(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    numbers.and_then(|numbers| numbers.try_into().ok()).ok_or_else(|| "expected three numbers such as 0,0,12.5".into())
}

/// Parses a non-negative integer.
///
/// # Errors
/// A description of what is expected.
pub fn parse_whole<T: FromStr>(text: &str) -> Result<T, String> {
    text.trim().parse().map_err(|_| "expected a whole number such as 2".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_may_be_a_percentage() {
        assert_eq!(parse_share("0.1"), Ok(0.1));
        assert_eq!(parse_share("10%"), Ok(0.1));
        assert_eq!(parse_share("12.5 %"), Ok(0.125));
        for text in ["", "%", "ten", "10%%", "10 percent"] {
            assert_eq!(parse_share(text), Err("expected a share such as 0.1 or 10%".to_owned()), "{text}");
        }
    }

    #[test]
    fn a_count_may_be_in_thousands_or_millions() {
        for (text, count) in [("7", 7), ("50k", 50_000), ("50K", 50_000), ("1.5M", 1_500_000), ("1.001k", 1001)] {
            assert_eq!(parse_count(text), Ok(count), "{text}");
        }
        for text in ["", "k", "-5", "-5k", "0.5", "1.0005k", "infk", "1e3k", "5G", "99999999999999999M", "50 000"] {
            assert!(parse_count(text).is_err(), "{text}");
        }
    }

    #[test]
    fn every_count_reads_back_in_thousands_and_millions() {
        for count in (0..2_000_000).step_by(997) {
            let (thousands, millions) = (format!("{}.{:03}k", count / 1000, count % 1000), count as f64 / 1e6);
            assert_eq!(parse_count(&thousands), Ok(count));
            assert_eq!(parse_count(&format!("{millions}M")), Ok(count));
        }
    }
}
