//! Parts of a page: figures, rows, plots, renderings.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::gallery::{SIZE, Shot, VANTAGES};

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
pub(super) fn renderings(before: &[Shot], after: &[Shot]) -> Markup {
    html! {
        section {
            h2 { "Before and after" }
            p.quiet { "Both sides of a triangle are lit alike: a back face looks like a front face. Holes show the background." }
            @for ((place, before), after) in VANTAGES.iter().zip(before).zip(after) {
                @let edges = if place.with_edges { ", with edges" } else { "" };
                div.pair.shots {
                    (rendering(&before.address, &format!("before, {}{edges}", place.name)))
                    (rendering(&after.address, &format!("after, {}{edges}", place.name)))
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

pub(super) fn rendering(address: &str, caption: &str) -> Markup {
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
