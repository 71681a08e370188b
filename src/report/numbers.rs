//! Formats numbers for reports.

#[cfg(feature = "report")]
use crate::base::{counted, duration, grouped};

/// A number with narrow blanks that do not break.
#[cfg(feature = "report")]
pub(super) fn spaced(number: u64) -> String {
    grouped(number).replace(' ', "\u{202f}")
}

/// A count with its noun, and narrow blanks that do not break.
#[cfg(feature = "report")]
pub(super) fn spaced_count(number: u64, thing: &str) -> String {
    counted(number, thing).replace(' ', "\u{202f}")
}

/// A whole number with a minus sign as wide as a plus.
#[cfg(feature = "report")]
pub(super) fn signed(number: i64) -> String {
    format!("{}{}", if number < 0 { "\u{2212}" } else { "" }, spaced(number.unsigned_abs()))
}

#[cfg(feature = "report")]
pub(super) fn percent(share: f64) -> String {
    match share {
        s if s >= 10.0 => format!("{s:.0}\u{202f}%"),
        s if s >= 1.0 => format!("{s:.1}\u{202f}%"),
        s => format!("{s:.2}\u{202f}%"),
    }
}

#[cfg(feature = "report")]
pub(super) fn seconds(seconds: f64) -> String {
    match seconds {
        s if s < 9.995 => format!("{s:.2}\u{202f}s"),
        s if s < 89.95 => format!("{s:.1}\u{202f}s"),
        s => duration::whole(s.round() as u64).replace(' ', "\u{202f}"),
    }
}

/// A length with three significant digits.
pub(super) fn length(length: f64) -> String {
    match length.abs() {
        0.0 => "0".into(),
        l if (1e-3..1e5).contains(&l) => {
            let decimals = (2.0 - libm::log10(l).floor()).max(0.0) as usize;
            format!("{length:.decimals$}")
        }
        _ => format!("{length:.2e}"),
    }
}

#[cfg(all(test, feature = "report"))]
mod tests {
    use super::*;

    #[test]
    fn negative_numbers_have_a_minus_sign() {
        assert_eq!([-1634, 12].map(signed), ["\u{2212}1\u{202f}634", "12"]);
    }

    #[test]
    fn lengths_have_three_digits_that_count() {
        assert_eq!(
            [0.0, 0.012_345, 1.234_5, 98_765.4, 1.0e-7].map(length),
            ["0", "0.0123", "1.23", "98765", "1.00e-7"]
        );
    }
}
