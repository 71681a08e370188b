//! Formats numbers, plots and renderings for the page.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::gallery::{SIZE, Shot, VANTAGES};
use crate::base::grouped;

const STYLE: &str = include_str!("style.css");

/// A whole page, with `ending` at its foot.
pub(super) fn page(title: &str, body: &Markup, ending: &str) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                link rel="icon" href="data:,";
                title { (title) " · drystone" }
                style { (PreEscaped(STYLE)) }
            }
            body {
                main { (body) }
                footer { "drystone " (env!("CARGO_PKG_VERSION")) (ending) }
            }
        }
    };
    page.into_string()
}

/// Renderings before and after from the same viewpoints.
pub(super) fn pictures(before: &[Shot], after: &[Shot]) -> Markup {
    html! {
        section {
            h2 { "Before and after" }
            p.quiet { "Both sides of a triangle are lit alike: a back face looks like a front face. Holes show the background." }
            @for ((place, before), after) in VANTAGES.iter().zip(before).zip(after) {
                @let edges = if place.with_edges { ", with edges" } else { "" };
                div.pair.shots {
                    (picture(&before.address, &format!("before, {}{edges}", place.name)))
                    (picture(&after.address, &format!("after, {}{edges}", place.name)))
                }
            }
        }
    }
}

pub(super) fn figure(name: &str, value: &str, note: &str) -> Markup {
    html! { div { p.name { (name) } p.value { (value) } p.note { (note) } } }
}

pub(super) fn row(name: &str, value: &str) -> Markup {
    html! { tr { th scope="row" { (name) } td.number { (value) } } }
}

pub(super) fn picture(address: &str, caption: &str) -> Markup {
    html! {
        figure { img src=(address) alt=(caption) width=(SIZE[0]) height=(SIZE[1]); figcaption { (caption) } }
    }
}

pub(super) fn plot(svg: Option<String>, caption: &str) -> Markup {
    html! {
        @if let Some(svg) = svg {
            figure { div.plot role="img" aria-label=(caption) { (PreEscaped(svg)) } figcaption { (caption) } }
        }
    }
}

/// A number with narrow blanks that do not break.
pub(super) fn spaced(number: u64) -> String {
    grouped(number).replace(' ', "\u{202f}")
}

/// A whole number with a minus sign as wide as a plus.
pub(super) fn signed(number: i64) -> String {
    format!("{}{}", if number < 0 { "\u{2212}" } else { "" }, spaced(number.unsigned_abs()))
}

pub(super) fn percent(share: f64) -> String {
    match share {
        s if s >= 10.0 => format!("{s:.0}\u{202f}%"),
        s if s >= 1.0 => format!("{s:.1}\u{202f}%"),
        s => format!("{s:.2}\u{202f}%"),
    }
}

pub(super) fn seconds(seconds: f64) -> String {
    match seconds {
        s if s >= 3600.0 => format!("{:.0}\u{202f}h {:.0}\u{202f}min", (s / 3600.0).floor(), (s % 3600.0) / 60.0),
        s if s >= 90.0 => format!("{:.0}\u{202f}min {:.0}\u{202f}s", (s / 60.0).floor(), s % 60.0),
        s if s >= 10.0 => format!("{s:.1}\u{202f}s"),
        s => format!("{s:.2}\u{202f}s"),
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

#[cfg(test)]
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
