//! A function that is called at intervals, on a thread of its own, while other work runs.

use std::thread::{Builder, JoinHandle};
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded};

/// Calls a function at intervals until it is dropped.
#[derive(Debug)]
pub struct Ticker {
    stop: Option<Sender<()>>,
    /// `None` if the system refused it.
    thread: Option<JoinHandle<()>>,
}

impl Ticker {
    /// Calls `tick` for the first time after `interval`, then each time after as long as it returns. If no thread can be
    /// started, it is never called.
    pub fn start(name: &str, interval: Duration, tick: impl FnMut() -> Duration + Send + 'static) -> Self {
        let (stop, stopped) = bounded(0);
        let thread = Builder::new().name(name.to_owned()).spawn(move || call(&stopped, interval, tick)).ok();
        Self { stop: Some(stop), thread }
    }
}

impl Drop for Ticker {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            // What a call did before it panicked stays done.
            let _ = thread.join();
        }
    }
}

/// Calls `tick` every `interval` while `work` runs. If no thread can be started, it is never called.
pub fn ticking<T>(interval: Duration, mut tick: impl FnMut() + Send, work: impl FnOnce() -> T) -> T {
    let (stop, stopped) = bounded(0);
    let tick = move || {
        tick();
        interval
    };
    std::thread::scope(|scope| {
        let _ticker = Builder::new().spawn_scoped(scope, move || call(&stopped, interval, tick));
        // Dropped once the work is over, also by a panic: the ticker ends.
        let _stop = stop;
        work()
    })
}

/// Calls `tick` until the other end of the channel is dropped.
fn call(stopped: &Receiver<()>, mut interval: Duration, mut tick: impl FnMut() -> Duration) {
    while stopped.recv_timeout(interval) == Err(RecvTimeoutError::Timeout) {
        interval = tick();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU32, Ordering};
    use std::time::Instant;

    use super::*;

    const SOON: Duration = Duration::from_millis(1);
    const NEVER: Duration = Duration::from_secs(3600);

    #[test]
    fn a_function_is_called_while_work_runs_and_not_after() {
        let calls = AtomicU32::new(0);
        let called = || calls.load(Ordering::Relaxed);
        let count = || {
            calls.fetch_add(1, Ordering::Relaxed);
        };
        let began = Instant::now();
        ticking(SOON, count, || while called() < 3 && began.elapsed() < Duration::from_secs(60) {});
        let after = called();
        assert!(after >= 3);
        std::thread::sleep(20 * SOON);
        assert_eq!(called(), after);
    }

    #[test]
    fn nobody_waits_for_an_interval_to_end() {
        let began = Instant::now();
        assert_eq!(ticking(NEVER, || (), || 7), 7);
        drop(Ticker::start("idle", NEVER, || NEVER));
        assert!(std::panic::catch_unwind(|| ticking(NEVER, || (), || panic!("broken"))).is_err());
        assert!(began.elapsed() < NEVER / 2);
    }

    #[test]
    fn each_call_says_when_the_next_is() {
        let calls = Arc::new(AtomicU32::new(0));
        let counted = Arc::clone(&calls);
        let ticker = Ticker::start("counter", SOON, move || {
            counted.fetch_add(1, Ordering::Relaxed);
            NEVER
        });
        let began = Instant::now();
        while calls.load(Ordering::Relaxed) == 0 && began.elapsed() < Duration::from_secs(60) {}
        std::thread::sleep(20 * SOON);
        drop(ticker);
        assert_eq!(calls.load(Ordering::Relaxed), 1);
    }
}
