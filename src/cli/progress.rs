//! Progress on stderr: a bar on a terminal, plain lines otherwise.

use std::fmt::Write;
use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressState, ProgressStyle};

use crate::base::{Progress, bytes, grouped};
use crate::os::signals::StopSignal;

/// Time between two plain lines of one phase.
const LINE_INTERVAL: Duration = Duration::from_secs(5);

/// Progress for a person, or none.
pub fn told(quiet: bool) -> Box<dyn Progress> {
    stoppable(quiet, StopSignal::default())
}

/// The same for work that a signal stops.
pub fn stoppable(quiet: bool, stop: StopSignal) -> Box<dyn Progress> {
    Box::new(Told { is_quiet: quiet, is_terminal: std::io::stderr().is_terminal(), stop, phase: Mutex::new(None) })
}

/// Tells progress to a person.
struct Told {
    is_quiet: bool,
    is_terminal: bool,
    stop: StopSignal,
    phase: Mutex<Option<Phase>>,
}

struct Phase {
    name: &'static str,
    unit: &'static str,
    total: u64,
    done: u64,
    began: Instant,
    told: Instant,
    bar: Option<ProgressBar>,
}

impl Told {
    fn with(&self, change: impl FnOnce(&mut Option<Phase>)) {
        if self.is_quiet {
            return;
        }
        change(&mut self.phase.lock().unwrap_or_else(|poisoned| poisoned.into_inner()));
    }
}

impl Progress for Told {
    fn begin(&self, phase: &'static str, total: u64, unit: &'static str) {
        self.with(|current| {
            if let Some(bar) = current.take().and_then(|phase| phase.bar) {
                bar.finish_and_clear();
            }
            let now = Instant::now();
            let bar = self.is_terminal.then(|| bar(phase, total, unit));
            if bar.is_none() {
                tell(&match total {
                    0 => phase.to_owned(),
                    _ => format!("{phase}: {}", amount(total, unit)),
                });
            }
            *current = Some(Phase { name: phase, unit, total, done: 0, began: now, told: now, bar });
        });
    }

    fn tell(&self, message: &str) {
        self.with(|current| match current.as_ref().and_then(|phase| phase.bar.as_ref()) {
            Some(bar) => bar.println(message),
            None => tell(message),
        });
    }

    fn is_stopped(&self) -> bool {
        self.stop.number().is_some()
    }

    fn advance(&self, units: u64) {
        self.with(|current| {
            let Some(phase) = current else { return };
            phase.done += units;
            match &phase.bar {
                Some(bar) => bar.set_position(phase.done.min(phase.total)),
                None if phase.told.elapsed() >= LINE_INTERVAL => {
                    phase.told = Instant::now();
                    let elapsed = phase.began.elapsed().as_secs_f64();
                    let rate = phase.done as f64 / elapsed;
                    let left = phase.total.saturating_sub(phase.done) as f64 / rate.max(1e-9);
                    tell(&format!(
                        "{}: {} of {}, {}/s, about {left:.0} s left",
                        phase.name,
                        amount(phase.done, phase.unit),
                        amount(phase.total, phase.unit),
                        amount(rate as u64, phase.unit),
                    ));
                }
                None => {}
            }
        });
    }
}

impl Drop for Told {
    fn drop(&mut self) {
        self.with(|current| {
            if let Some(bar) = current.take().and_then(|phase| phase.bar) {
                bar.finish_and_clear();
            }
        });
    }
}

/// Prints a line; a closed stderr is no reason to stop.
pub fn tell(line: &str) {
    use std::io::Write as _;
    let _ = writeln!(std::io::stderr(), "{line}");
}

fn amount(count: u64, unit: &str) -> String {
    if unit == "B" { bytes::display(count) } else { format!("{} {unit}", grouped(count)) }
}

fn bar(phase: &'static str, total: u64, unit: &'static str) -> ProgressBar {
    let template = match (unit, total) {
        (_, 0) => "{msg:10} {elapsed}",
        ("B", _) => "{msg:10} {wide_bar} {bytes}/{total_bytes} {bytes_per_sec} eta {eta}",
        _ => "{msg:10} {wide_bar} {done} of {all} {unit}, {rate}/s eta {eta}",
    };
    let bar = ProgressBar::new(total).with_message(phase);
    if let Ok(style) = ProgressStyle::with_template(template) {
        let key = |count: fn(&ProgressState) -> u64| {
            move |state: &ProgressState, to: &mut dyn Write| _ = to.write_str(&grouped(count(state)))
        };
        let style = style.with_key("done", key(ProgressState::pos));
        let style = style.with_key("all", key(|state| state.len().unwrap_or(0)));
        let style = style.with_key("rate", key(|state| state.per_sec() as u64));
        bar.set_style(style.with_key("unit", move |_: &ProgressState, to: &mut dyn Write| _ = to.write_str(unit)));
    }
    bar
}
