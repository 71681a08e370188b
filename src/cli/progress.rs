//! Progress on stderr: one bar for the whole run on a terminal, plain lines with the time otherwise.

use std::io::IsTerminal;
use std::path::Path;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::share::JobShare;
use crate::base::error::escape_path;
use crate::base::{Progress, bytes, duration, grouped, lock};
use crate::os::signals::StopSignal;

/// Time between two plain lines of one phase.
const LINE_INTERVAL: Duration = Duration::from_secs(5);
/// Predicted seconds of a run above which a log names the command that shows its status.
const LONG_SECONDS: f64 = 30.0;
/// Steps of the bar.
const BAR_STEPS: u64 = 1000;

/// Progress on stderr, or none if `quiet`.
pub fn told(quiet: bool) -> Box<dyn Progress> {
    stoppable(quiet, StopSignal::default())
}

/// As [`told`], for work that a signal stops.
pub fn stoppable(quiet: bool, stop: StopSignal) -> Box<dyn Progress> {
    Box::new(Told::new(quiet, stop, None, String::new()))
}

/// As [`told`], for a whole run in a work folder.
pub fn of_job(stop: StopSignal, share: JobShare, work: &Path) -> Box<dyn Progress> {
    Box::new(Told::new(false, stop, Some(share), escape_path(work)))
}

/// Reports progress to a person.
struct Told {
    is_quiet: bool,
    is_terminal: bool,
    stop: StopSignal,
    began: Instant,
    work: String,
    state: Mutex<State>,
}

/// Progress of the run.
struct State {
    /// Share of a whole run; `None` for a command whose phases stand alone.
    share: Option<JobShare>,
    phase: Option<Phase>,
    bar: Option<ProgressBar>,
}

struct Phase {
    name: &'static str,
    unit: &'static str,
    total: u64,
    done: u64,
    began: Instant,
    told: Instant,
}

impl Told {
    fn new(is_quiet: bool, stop: StopSignal, share: Option<JobShare>, work: String) -> Self {
        let state = State { share, phase: None, bar: None };
        let is_terminal = std::io::stderr().is_terminal();
        Self { is_quiet, is_terminal, stop, began: Instant::now(), work, state: Mutex::new(state) }
    }

    fn with(&self, change: impl FnOnce(&mut State)) {
        if self.is_quiet {
            return;
        }
        change(&mut lock(&self.state));
    }

    /// Prints a line with the time since the start.
    fn log(&self, message: &str) {
        tell(&format!("{:8.1} s  {message}", self.began.elapsed().as_secs_f64()));
    }

    /// Moves the bar.
    fn show(&self, state: &mut State) {
        let Some(share) = state.advance() else { return };
        let left = state.seconds_left(self.began);
        let Some(phase) = &state.phase else { return };
        let message = [state.name(), phase.amounts(), left].into_iter().filter(|words| !words.is_empty());
        let message = message.collect::<Vec<_>>().join(", ");
        let bar = state.bar.get_or_insert_with(new_bar);
        bar.set_position((share * BAR_STEPS as f64) as u64);
        bar.set_message(message);
    }
}

impl State {
    /// Share of the whole run that is done, or of the phase in a command whose phases stand alone.
    fn advance(&mut self) -> Option<f64> {
        let phase = self.phase.as_ref()?;
        let of_phase = phase.done as f64 / phase.total.max(1) as f64;
        Some(self.share.as_mut().map_or(of_phase.min(1.0), |share| share.advance(of_phase)))
    }

    /// Percentage for a line of the log: `41 %  `.
    fn percent(&mut self) -> String {
        let share = self.advance().filter(|_| self.share.is_some());
        share.map_or_else(String::new, |share| format!("{:3.0} %  ", 100.0 * share))
    }

    /// Name of the phase: `pass 2 of 4, stitch`.
    fn name(&self) -> String {
        let name = self.phase.as_ref().map_or("", |phase| phase.name);
        match self.share.as_ref().and_then(JobShare::pass) {
            Some(pass) => format!("{pass}, {name}"),
            None => name.to_owned(),
        }
    }

    /// Estimated time left: `12 s left`; empty while there is no estimate.
    fn seconds_left(&self, began: Instant) -> String {
        let left = match (&self.share, &self.phase) {
            (Some(share), _) => share.seconds_left(began.elapsed().as_secs_f64()),
            (None, Some(phase)) if phase.done > 0 && phase.total > 0 => {
                let rate = phase.done as f64 / phase.began.elapsed().as_secs_f64().max(1e-9);
                Some(phase.total.saturating_sub(phase.done) as f64 / rate)
            }
            (None, _) => None,
        };
        left.map_or_else(String::new, |left| format!("{} left", time(left)))
    }
}

impl Phase {
    fn amounts(&self) -> String {
        match self.total {
            0 => String::new(),
            total => format!("{} of {}", amount(self.done, self.unit), amount(total, self.unit)),
        }
    }
}

impl Progress for Told {
    fn begin(&self, phase: &'static str, total: u64, unit: &'static str) {
        self.with(|state| {
            let now = Instant::now();
            let is_first = state.phase.is_none();
            state.phase = Some(Phase { name: phase, unit, total, done: 0, began: now, told: now });
            if let Some(share) = &mut state.share {
                share.begin(phase, total);
            }
            if self.is_terminal {
                return self.show(state);
            }
            let predicted = state.share.as_ref().map_or(0.0, JobShare::predicted_seconds);
            if is_first && predicted > LONG_SECONDS {
                let (time, work) = (time(predicted), &self.work);
                self.log(&format!("this may take {time}; `drystone status {work}` prints how far it is"));
            }
            let (share, name) = (state.percent(), state.name());
            match total {
                0 => self.log(&format!("{share}{name}")),
                _ => self.log(&format!("{share}{name}: {}", amount(total, unit))),
            }
        });
    }

    fn begin_pass(&self, number: usize) {
        self.with(|state| state.share.iter_mut().for_each(|share| share.begin_pass(number)));
    }

    fn tell(&self, message: &str) {
        self.with(|state| match &state.bar {
            Some(bar) => bar.println(message),
            None => self.log(message),
        });
    }

    fn is_stopped(&self) -> bool {
        self.stop.number().is_some()
    }

    fn advance(&self, units: u64) {
        self.with(|state| {
            let Some(phase) = &mut state.phase else { return };
            phase.done += units;
            if self.is_terminal {
                return self.show(state);
            }
            if phase.told.elapsed() >= LINE_INTERVAL {
                phase.told = Instant::now();
                let rate = phase.done as f64 / phase.began.elapsed().as_secs_f64().max(1e-9);
                let (amounts, rate) = (phase.amounts(), amount(rate as u64, phase.unit));
                let (share, name, left) = (state.percent(), state.name(), state.seconds_left(self.began));
                let left = if left.is_empty() { left } else { format!(", {left}") };
                self.log(&format!("{share}{name}: {amounts}, {rate}/s{left}"));
            }
        });
    }
}

impl Drop for Told {
    fn drop(&mut self) {
        self.with(|state| state.bar.iter().for_each(ProgressBar::finish_and_clear));
    }
}

/// Prints a line; a closed stderr is no reason to stop.
pub fn tell(line: &str) {
    use std::io::Write as _;
    let _ = writeln!(std::io::stderr(), "{line}");
}

fn amount(count: u64, unit: &str) -> String {
    match (unit, count) {
        ("B", _) => bytes::display(count),
        (_, 1) => format!("1 {}", unit.strip_suffix(if unit == "batches" { "es" } else { "s" }).unwrap_or(unit)),
        _ => format!("{} {unit}", grouped(count)),
    }
}

/// Time left as text: `4 s`, `3 min`, `2.5 h`.
fn time(seconds: f64) -> String {
    if seconds < 9.5 { format!("{seconds:.0} s") } else { duration::rough(seconds) }
}

fn new_bar() -> ProgressBar {
    let bar = ProgressBar::new(BAR_STEPS);
    match ProgressStyle::with_template("{percent:>3} % {wide_bar} {elapsed} {msg}") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_face_is_no_plural() {
        assert_eq!([amount(1, "faces"), amount(2, "faces")], ["1 face", "2 faces"]);
        assert_eq!([amount(1, "batches"), amount(1, "images")], ["1 batch", "1 image"]);
    }

    #[test]
    fn times_are_in_the_unit_that_suits() {
        assert_eq!([7.4, 99.0, 600.0, 9000.0].map(time), ["7 s", "99 s", "10 min", "2.5 h"]);
    }
}
