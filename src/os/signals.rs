//! Signals that ask the process to stop.
//!
//! The first signal is recorded, and work ends at the next safe point. A second one ends the process at once, which is
//! as safe as `kill -9`, and that is safe at any time.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::base::Result;

/// The signal received, if any.
#[derive(Debug, Clone, Default)]
pub struct StopSignal(Arc<AtomicUsize>);

/// A signal and its name.
#[cfg(unix)]
const SIGNALS: [(libc::c_int, &str); 3] =
    [(libc::SIGINT, "SIGINT"), (libc::SIGTERM, "SIGTERM"), (libc::SIGHUP, "SIGHUP")];

impl StopSignal {
    /// Listens for SIGINT, SIGTERM and SIGHUP; leaves SIGHUP ignored if it is (`nohup`). On other systems than Unix the
    /// process is ended instead, which loses no more than a kill.
    ///
    /// # Errors
    /// If a handler cannot be registered.
    pub fn listen() -> Result<Self> {
        let stop = Self::default();
        #[cfg(unix)]
        stop.register().map_err(|e| crate::base::Error::io(std::path::Path::new("signals"), "listen for", e))?;
        Ok(stop)
    }

    #[cfg(unix)]
    fn register(&self) -> std::io::Result<()> {
        use signal_hook::flag;
        // A file that exceeds its size limit makes the write fail instead of ending the process.
        flag::register(libc::SIGXFSZ, Arc::default())?;
        let again = Arc::new(std::sync::atomic::AtomicBool::new(false));
        for (signal, _) in SIGNALS {
            if signal == libc::SIGHUP && is_ignored(signal) {
                continue;
            }
            flag::register_conditional_shutdown(signal, 128 + signal, again.clone())?;
            flag::register_usize(signal, self.0.clone(), signal as usize)?;
            flag::register(signal, again.clone())?;
        }
        Ok(())
    }

    /// Number of the signal received, or `None`.
    pub fn number(&self) -> Option<u8> {
        u8::try_from(self.0.load(Ordering::Relaxed)).ok().filter(|number| *number != 0)
    }

    /// Name of the signal received.
    pub fn name(&self) -> &'static str {
        #[cfg(unix)]
        if let Some((_, name)) = SIGNALS.iter().find(|(signal, _)| self.number().map(i32::from) == Some(*signal)) {
            return name;
        }
        "a signal"
    }
}

/// Reports whether the process was started with a signal ignored.
#[cfg(unix)]
fn is_ignored(signal: libc::c_int) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    mask >> (signal - 1) & 1 != 0
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_ignored_is_told_apart() {
        // Rust ignores SIGPIPE in every program, and SIGCONT is never ignored here.
        assert!(is_ignored(libc::SIGPIPE));
        assert!(!is_ignored(libc::SIGCONT));
    }

    #[test]
    fn no_signal_has_no_number() {
        assert_eq!(StopSignal::default().number(), None);
    }
}
