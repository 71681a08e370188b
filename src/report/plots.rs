//! Plots as SVG text, drawn by `plotters`.
//!
//! In: series of numbers. Out: `<svg>` elements that contain no text from outside. The page's style replaces the
//! placeholder colours, so a plot follows the light, the dark and the printed page.

use std::ops::Range;

use plotters::coord::ranged1d::Ranged;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor;

use crate::base::bytes::MIB;
use crate::measure::figures::Histogram;
use crate::os::timeline::{PhaseSpan, Timeline};
use crate::passes::outcome::{PassReport, StageReport};

/// Width and height of a plot in its own units; the page scales it.
const SIZE: (u32, u32) = (640, 300);
/// Placeholder colours: `style.css` replaces `#010101` and the others.
const INK: RGBColor = RGBColor(1, 1, 1);
const RULE: RGBColor = RGBColor(2, 2, 2);
const FIRST: RGBColor = RGBColor(3, 3, 3);
const SECOND: RGBColor = RGBColor(4, 4, 4);
const WASH: RGBColor = RGBColor(5, 5, 5);
const MUTED: RGBColor = RGBColor(6, 6, 6);
/// The page sets the font.
const FONT: &str = "sans-serif";
const TEXT_SIZE: i32 = 13;
/// A distribution is drawn where it has more than this share of the surface, in percent.
const SHOWN_PERCENT: f64 = 0.02;

/// Share of a plot's width that a letter takes.
const NAME_SHARE: f64 = 0.0135;

type Drawn = Result<(), Box<dyn std::error::Error>>;
type PlotArea<'a, 'b, X, Y> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<X, Y>>;

/// Resident memory over time, with the budget, and phases as bands.
pub fn memory(timeline: &Timeline, budget: u64) -> Option<String> {
    let points: Vec<(f64, f64)> =
        timeline.samples.iter().map(|sample| (sample.seconds, mib(sample.resident))).collect();
    let highest = points.iter().map(|point| point.1).fold(0.0, f64::max);
    // A large budget would flatten the curve.
    let shown_budget = Some(mib(budget)).filter(|budget| *budget <= 3.0 * highest);
    // Space above the budget for its label and for those of the phases.
    let top = (shown_budget.unwrap_or(0.0) * 1.25).max(highest * 1.12);
    over_time(timeline, top, "MiB resident", |chart| {
        chart.draw_series(AreaSeries::new(points.iter().copied(), 0.0, WASH))?;
        chart.draw_series(LineSeries::new(points.iter().copied(), FIRST.stroke_width(2)))?;
        if let Some(budget) = shown_budget {
            let end = points.last().map_or(0.0, |point| point.0);
            chart.draw_series(LineSeries::new([(0.0, budget), (end, budget)], SECOND.stroke_width(1)))?;
            note(chart, "budget", (end, budget), (-2, -2), label(SECOND).pos(right_above()))?;
        }
        Ok(())
    })
}

/// Bytes read and written so far over time.
pub fn moved(timeline: &Timeline) -> Option<String> {
    let series = |of: fn(&crate::os::timeline::Sample) -> u64| -> Vec<(f64, f64)> {
        timeline.samples.iter().map(|sample| (sample.seconds, mib(of(sample)))).collect()
    };
    let (read, written) = (series(|sample| sample.read), series(|sample| sample.written));
    let last = |points: &[(f64, f64)]| points.last().copied().unwrap_or_default();
    let top = last(&read).1.max(last(&written).1) * 1.15;
    over_time(timeline, top, "MiB so far", |chart| {
        let is_read_above = last(&read).1 >= last(&written).1;
        for (points, colour, name, is_above) in
            [(&read, FIRST, "read", is_read_above), (&written, SECOND, "written", !is_read_above)]
        {
            chart.draw_series(LineSeries::new(points.iter().copied(), colour.stroke_width(2)))?;
            let (anchor, down) = if is_above { (right_above(), -4) } else { (right_below(), 6) };
            note(chart, name, last(points), (-2, down), label(colour).pos(anchor))?;
        }
        Ok(())
    })
}

/// Deviation against faces at the end of each stage, both on logarithmic axes.
pub fn faces_against_error(passes: &[PassReport]) -> Option<String> {
    against_faces(passes, "estimated deviation (RMS)", |stage| stage.rms_estimate)
}

/// Highest cost of a collapse in each stage against faces at its end, both on logarithmic axes.
pub fn faces_against_cost(passes: &[PassReport]) -> Option<String> {
    against_faces(passes, "highest cost (area × length²)", |stage| stage.threshold)
}

fn against_faces(passes: &[PassReport], y_name: &str, of: impl Fn(&StageReport) -> f64) -> Option<String> {
    let points = |pass: &PassReport| -> Vec<(f64, f64)> {
        let points = pass.stages.iter().map(|stage| (stage.faces as f64, of(stage)));
        points.filter(|point| point.0 > 0.0 && point.1 > 0.0 && point.1.is_finite()).collect()
    };
    let shown: Vec<(f64, f64)> = passes.iter().flat_map(points).collect();
    if shown.len() < 2 {
        return None;
    }
    let x = decades(shown.iter().map(|point| point.0));
    let y = decades(shown.iter().map(|point| point.1));
    svg(|root| {
        let mut chart = ChartBuilder::on(root)
            .margin(6)
            .margin_right(20)
            .x_label_area_size(38)
            .y_label_area_size(62)
            .build_cartesian_2d(x.clone().log_scale(), y.clone().log_scale())?;
        chart
            .configure_mesh()
            .bold_line_style(RULE)
            .light_line_style(TRANSPARENT)
            .axis_style(MUTED)
            .label_style(label(INK))
            .x_desc("triangles left")
            .y_desc(y_name)
            .x_label_formatter(&|faces| round_in(&x, *faces, short(*faces)))
            .y_label_formatter(&|value| round_in(&y, *value, plain(value)))
            .draw()?;
        chart.draw_series(LineSeries::new(shown.iter().copied(), FIRST.stroke_width(2)))?;
        let mut names: Vec<PassName> = Vec::new();
        for (number, pass) in passes.iter().enumerate() {
            let points = points(pass);
            chart.draw_series(points.iter().map(|&point| Circle::new(point, 3, FIRST.filled())))?;
            if let Some(&end) = points.last() {
                chart.draw_series([Circle::new(end, 5, SECOND.filled())])?;
                let is_near = |names: &PassName| {
                    is_near(&x, names.end.0, end.0, 552.0, 70.0) && is_near(&y, names.end.1, end.1, 244.0, 18.0)
                };
                match names.iter_mut().find(|names| is_near(names)) {
                    Some(names) => names.words = format!("{}, {}", names.words.replace("pass ", "passes "), number + 1),
                    None => names.push(PassName { end, words: format!("pass {}", number + 1) }),
                }
            }
        }
        for PassName { end, words } in names {
            note(&mut chart, &words, end, (9, -3), label(SECOND).pos(left_above()))?;
        }
        Ok(())
    })
}

/// Label of the end of a pass, or of several passes whose labels would overlap.
struct PassName {
    end: (f64, f64),
    words: String,
}

/// Whether two values on a logarithmic axis, `units` long, are less than `least` units apart.
fn is_near(range: &Range<f64>, a: f64, b: f64, units: f64, least: f64) -> bool {
    units * libm::fabs(libm::log(a / b)) / libm::log(range.end / range.start) < least
}

/// Share of the surface by distance, both directions; distances on a logarithmic axis.
pub fn distribution(forward: &Histogram, backward: &Histogram) -> Option<String> {
    let steps = |histogram: &Histogram| -> Vec<(f64, f64)> {
        let bins = histogram.edges.windows(2).zip(&histogram.shares);
        // The first bin begins at 0, which has no position on a logarithmic axis.
        let level = |edge: &[f64], share: f64| 100.0 * share / (2.0 * libm::log2(edge[1] / edge[0]));
        bins.skip(1).flat_map(|(edge, &share)| [edge[0], edge[1]].map(|place| (place, level(edge, share)))).collect()
    };
    let (forward, backward) = (steps(forward), steps(backward));
    let both = || forward.iter().chain(&backward).filter(|point| point.1 > SHOWN_PERCENT);
    let top = both().map(|point| point.1).fold(0.0, f64::max);
    let x = decades(both().map(|point| point.0));
    if !(top > 0.0 && x.start > 0.0 && x.end.is_finite()) {
        return None;
    }
    svg(|root| {
        let mut chart = ChartBuilder::on(root)
            .margin(6)
            .margin_right(20)
            .x_label_area_size(38)
            .y_label_area_size(62)
            .build_cartesian_2d(x.clone().log_scale(), 0.0..top * 1.12)?;
        chart
            .configure_mesh()
            .bold_line_style(RULE)
            .light_line_style(TRANSPARENT)
            .axis_style(MUTED)
            .label_style(label(INK))
            .x_desc("distance")
            .y_desc("% of the surface, each √2")
            .x_label_formatter(&plain)
            .y_label_formatter(&plain)
            .draw()?;
        let ways = [(&forward, FIRST, "to the original", 4), (&backward, SECOND, "to the result", 20)];
        for (points, colour, name, down) in ways {
            let inside = points.iter().copied().filter(|point| x.contains(&point.0));
            chart.draw_series(LineSeries::new(inside, colour.stroke_width(2)))?;
            note(&mut chart, name, (x.start, top * 1.12), (10, down), label(colour).pos(left_below()))?;
        }
        Ok(())
    })
}

/// A plot over the seconds of a run, phases as bands behind it.
fn over_time(
    timeline: &Timeline,
    top: f64,
    y_name: &str,
    draw: impl Fn(&mut PlotArea<RangedCoordf64, RangedCoordf64>) -> Drawn,
) -> Option<String> {
    let end = timeline.samples.last()?.seconds;
    if !(end > 0.0 && top > 0.0) {
        return None;
    }
    svg(|root| {
        let mut chart = axes(root, 0.0..end, 0.0..top, "seconds", y_name)?;
        for phase in timeline.phases.iter().skip(1) {
            chart.draw_series(LineSeries::new([(phase.begin, 0.0), (phase.begin, top)], RULE.stroke_width(1)))?;
        }
        let has_room =
            |phase: &&PhaseSpan| (phase.end - phase.begin) / end > NAME_SHARE * (phase.name.len() + 1) as f64;
        for phase in timeline.phases.iter().filter(has_room) {
            let middle = ((phase.begin + phase.end) / 2.0, top);
            let anchor = text_anchor::Pos::new(text_anchor::HPos::Center, text_anchor::VPos::Top);
            note(&mut chart, phase.name, middle, (0, 2), label(MUTED).pos(anchor))?;
        }
        draw(&mut chart)
    })
}

fn axes<'a, 'b>(
    root: &'a DrawingArea<SVGBackend<'b>, plotters::coord::Shift>,
    x: Range<f64>,
    y: Range<f64>,
    x_name: &str,
    y_name: &str,
) -> Result<PlotArea<'a, 'b, RangedCoordf64, RangedCoordf64>, Box<dyn std::error::Error>>
where
    'b: 'a,
{
    let mut chart = ChartBuilder::on(root)
        .margin(6)
        .margin_right(16)
        .x_label_area_size(38)
        .y_label_area_size(62)
        .build_cartesian_2d(x, y)?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .bold_line_style(RULE)
        .light_line_style(TRANSPARENT)
        .axis_style(MUTED)
        .label_style(label(INK))
        .x_labels(8)
        .y_labels(6)
        .x_desc(x_name)
        .y_desc(y_name)
        .x_label_formatter(&plain)
        .y_label_formatter(&plain)
        .draw()?;
    Ok(chart)
}

/// Draws one plot; `None` where nothing can be drawn.
fn svg(draw: impl FnOnce(&DrawingArea<SVGBackend<'_>, plotters::coord::Shift>) -> Drawn) -> Option<String> {
    let mut text = String::new();
    {
        let root = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
        draw(&root).and_then(|()| Ok(root.present()?)).ok()?;
    }
    Some(text)
}

fn label(colour: RGBColor) -> TextStyle<'static> {
    (FONT, TEXT_SIZE).into_font().color(&colour)
}

/// Writes a text beside a point, shifted to the right and down by the given units.
fn note<X: Ranged<ValueType = f64>, Y: Ranged<ValueType = f64>>(
    chart: &mut PlotArea<X, Y>,
    words: &str,
    point: (f64, f64),
    offset: (i32, i32),
    style: TextStyle<'static>,
) -> Drawn {
    let words = EmptyElement::at(point) + Text::new(words.to_owned(), offset, style);
    chart.draw_series([words])?;
    Ok(())
}

fn right_above() -> text_anchor::Pos {
    text_anchor::Pos::new(text_anchor::HPos::Right, text_anchor::VPos::Bottom)
}

fn right_below() -> text_anchor::Pos {
    text_anchor::Pos::new(text_anchor::HPos::Right, text_anchor::VPos::Top)
}

fn mib(bytes: u64) -> f64 {
    bytes as f64 / MIB as f64
}

/// A range that begins and ends a little beyond the values.
fn decades(values: impl Iterator<Item = f64>) -> Range<f64> {
    let (low, high) = values.fold((f64::INFINITY, 0f64), |(low, high), x| (low.min(x), high.max(x)));
    low / 1.3..high * 1.6
}

/// Label of a value on a logarithmic axis; empty where there is no room: then only 1, 2 and 5 of each decade are
/// labelled, or 1.
fn round_in(range: &Range<f64>, place: f64, words: String) -> String {
    let decades = libm::log10(range.end / range.start);
    let leading = place / 10f64.powf(libm::floor(libm::log10(place) + 1e-9));
    let is_near = |digit: f64| (leading - digit).abs() < 1e-6;
    let is_shown = match decades {
        d if d <= 0.8 => true,
        d if d <= 2.5 => [1.0, 2.0, 5.0].into_iter().any(is_near),
        _ => is_near(1.0),
    };
    if is_shown { words } else { String::new() }
}

/// A number without trailing zeros.
fn plain(number: &f64) -> String {
    let rounded = (number * 1e6).round() / 1e6;
    if *number != 0.0 && number.abs() < 1e-3 { format!("{number:.1e}") } else { format!("{rounded}") }
}

/// `250k`, `4.3M`.
fn short(number: f64) -> String {
    match number {
        n if n >= 1e6 => format!("{}M", (n / 1e5).round() / 10.0),
        n if n >= 1e3 => format!("{}k", (n / 1e2).round() / 10.0),
        n => format!("{n:.0}"),
    }
}

fn left_below() -> text_anchor::Pos {
    text_anchor::Pos::new(text_anchor::HPos::Left, text_anchor::VPos::Top)
}

fn left_above() -> text_anchor::Pos {
    text_anchor::Pos::new(text_anchor::HPos::Left, text_anchor::VPos::Bottom)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::os::timeline::Sample;

    fn timeline(samples: &[(f64, u64)]) -> Timeline {
        let sample = |&(seconds, resident)| Sample { seconds, resident, read: resident / 2, written: resident / 4 };
        let end = samples.last().map_or(0.0, |sample| sample.0);
        let phases = vec![PhaseSpan { name: "scan", begin: 0.0, end }];
        Timeline { phases, samples: samples.iter().map(sample).collect() }
    }

    #[test]
    fn a_run_over_time_is_drawn_with_its_phases() {
        let drawn = memory(&timeline(&[(0.0, MIB), (1.0, 30 * MIB), (2.0, 20 * MIB)]), 32 * MIB).unwrap();
        assert!(drawn.starts_with("<svg") && drawn.contains("scan") && drawn.contains("budget"));
        assert!(moved(&timeline(&[(0.0, 0), (1.0, 30 * MIB)])).unwrap().contains("written"));
    }

    #[test]
    fn nothing_is_drawn_of_nothing() {
        assert_eq!(memory(&Timeline::default(), MIB), None);
        assert_eq!(moved(&timeline(&[(0.0, 0), (0.0, 0)])), None);
        assert_eq!(faces_against_error(&[]), None);
    }

    #[test]
    fn a_distribution_leaves_out_what_has_no_place_among_decades() {
        let histogram = |shares: [f64; 3]| Histogram { edges: vec![0.0, 1.0, 1.5, 2.0], shares: shares.to_vec() };
        assert_eq!(distribution(&histogram([1.0, 0.0, 0.0]), &Histogram::default()), None);
        let drawn = distribution(&histogram([0.2, 0.5, 0.3]), &histogram([0.0, 1.0, 0.0])).unwrap();
        assert!(drawn.contains("to the original") && drawn.contains("to the result"));
    }

    #[test]
    fn labels_of_many_decades_are_those_of_round_numbers() {
        let shown = |range: Range<f64>| -> Vec<f64> {
            let places = [0.01, 0.02, 0.03, 0.05, 0.09, 0.1, 0.2];
            places.into_iter().filter(|&place| !round_in(&range, place, plain(&place)).is_empty()).collect()
        };
        assert_eq!(shown(0.03..0.1).len(), 7);
        assert_eq!(shown(0.01..0.3), [0.01, 0.02, 0.05, 0.1, 0.2]);
        assert_eq!(shown(0.01..30.0), [0.01, 0.1]);
    }

    #[test]
    fn stages_without_error_are_left_out_of_the_curve() {
        let stage = |faces, rms_estimate| StageReport { faces, threshold: 1.0, rms_estimate };
        let pass = |stages| PassReport { stages, ..PassReport::default() };
        let flat = pass(vec![stage(100, 0.0), stage(10, 0.0)]);
        assert_eq!(faces_against_error(std::slice::from_ref(&flat)), None);
        let drawn = faces_against_error(&[flat, pass(vec![stage(10, 0.01), stage(4, 0.1)])]).unwrap();
        assert!(drawn.contains("pass 2") && !drawn.contains("pass 1"));
    }

    #[test]
    fn passes_that_end_at_the_same_place_share_their_words() {
        let pass = |faces, rms_estimate| {
            let stage = |faces| StageReport { faces, threshold: 1.0, rms_estimate };
            PassReport { stages: vec![stage(faces)], ..PassReport::default() }
        };
        let drawn = faces_against_error(&[pass(4_000_000, 0.01), pass(444_000, 0.04), pass(431_000, 0.041)]).unwrap();
        assert!(drawn.contains("pass 1") && drawn.contains("passes 2, 3") && !drawn.contains("pass 3"));
    }
}
