//! Says who works in a work folder, for machines that the system's lock does not reach: some network disks lock each
//! machine by itself.
//!
//! ```text
//! holder    number, count and machine in a line; the process that works there counts every 2 s
//! ```
//! A process that finds the line of another machine watches it. A line that changes is that of a process at work; one
//! that stays for 15 s is replaced. A process whose line is gone was taken for dead, since it had stopped or was cut
//! off: it records nothing more.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

use crossbeam_channel::{RecvTimeoutError, Sender, bounded};

use crate::base::error::escape_path;
use crate::base::{Error, Progress, Result, lock};
use crate::os::durable::{folder_of, new_job_number, no_links};
use crate::os::system::{host_name, write_all_at};

/// Name of the file in a work folder.
pub(super) const HOLDER: &str = "holder";
/// The same while it is written.
pub(super) const HOLDER_WRITTEN: &str = "holder.tmp";
/// Time between two counts.
const BEAT: Duration = Duration::from_secs(2);
/// A look at the line that is as old as this does not count any more.
const TRUST: Duration = Duration::from_secs(5);
/// Time after which a line that has not changed is replaced: some counts, and what a network disk shows late.
const PATIENCE: Duration = Duration::from_secs(15);
/// Time between two looks at the line of another machine.
const LOOK: Duration = Duration::from_millis(250);
/// Bytes of a line, at most.
const LINE_BYTES_MAX: usize = 256;

/// A process that works in a folder, until this is dropped.
#[derive(Debug)]
pub(super) struct Holder {
    seat: Arc<Seat>,
    stop: Option<Sender<()>>,
    counter: Option<JoinHandle<()>>,
}

/// What a process knows of its line.
#[derive(Debug)]
pub(super) struct Seat {
    path: PathBuf,
    /// Number of this process.
    number: u64,
    state: Mutex<SeatState>,
}

#[derive(Debug)]
struct SeatState {
    count: u64,
    /// When the line was last seen to be that of this process.
    seen: Instant,
    is_lost: bool,
}

impl Holder {
    /// Takes a locked folder for this process.
    ///
    /// # Errors
    /// [`Error::Locked`] if a process on another machine works in it, [`Error::Stopped`] if asked to stop, else
    /// [`Error::Io`].
    pub(super) fn claim(folder: &Path, progress: &dyn Progress) -> Result<Self> {
        Self::claim_after(folder, PATIENCE, progress)
    }

    fn claim_after(folder: &Path, patience: Duration, progress: &dyn Progress) -> Result<Self> {
        let path = folder.join(HOLDER);
        let wrap = |e| Error::io(&path, "write", e);
        watch(&path, patience, progress)?;
        let state = SeatState { count: 0, seen: Instant::now(), is_lost: false };
        let seat = Seat { path: path.clone(), number: new_job_number(&path), state: Mutex::new(state) };
        // By another name first: who counts in the earlier file must not write to this one.
        let written = folder.join(HOLDER_WRITTEN);
        let _ = fs::remove_file(&written);
        let mut options = File::options();
        let file = no_links(options.write(true).create_new(true)).open(&written).map_err(wrap)?;
        write_all_at(&file, &seat.line(0), 0).map_err(wrap)?;
        drop(file);
        fs::rename(&written, &path).map_err(wrap)?;
        let (seat, (stop, stopped)) = (Arc::new(seat), bounded::<()>(0));
        let counting = Arc::clone(&seat);
        let count = move || {
            while stopped.recv_timeout(BEAT) == Err(RecvTimeoutError::Timeout) {
                // A failure is seen when a look is needed.
                let _ = counting.look();
            }
        };
        // Without a thread, the line is counted when a step is recorded.
        let counter = Builder::new().name("holder".into()).spawn(count).ok();
        Ok(Self { seat, stop: Some(stop), counter })
    }

    /// Whether another process has taken the folder over, as far as can be seen now.
    pub(super) fn is_lost(&self) -> bool {
        self.seat.look().is_ok() && self.seat.confirm().is_err()
    }

    /// What this process knows of its line.
    pub(super) fn seat(&self) -> Arc<Seat> {
        Arc::clone(&self.seat)
    }
}

impl Drop for Holder {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(counter) = self.counter.take() {
            let _ = counter.join();
        }
        if self.seat.confirm().is_ok() {
            let _ = fs::remove_file(&self.seat.path);
        }
    }
}

impl Seat {
    /// Makes sure that no other process has replaced the line.
    ///
    /// # Errors
    /// [`Error::Locked`] if one has; [`Error::Io`] if the line cannot be read or written.
    pub(super) fn confirm(&self) -> Result<()> {
        let is_recent = lock(&self.state).seen.elapsed() < TRUST;
        if !is_recent {
            self.look().map_err(|e| Error::io(&self.path, "write", e))?;
        }
        if lock(&self.state).is_lost { Err(Error::Locked(folder_of(&self.path).to_owned())) } else { Ok(()) }
    }

    /// Looks whether the line is that of this process, and counts.
    fn look(&self) -> io::Result<()> {
        let mut state = lock(&self.state);
        if state.is_lost {
            return Ok(());
        }
        let mut options = File::options();
        let file = match no_links(options.read(true).write(true)).open(&self.path) {
            // Whoever replaced it is done.
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                state.is_lost = true;
                return Ok(());
            }
            opened => opened?,
        };
        let found = read_line(&file)?;
        if found.len() < NUMBER_DIGITS || found[..NUMBER_DIGITS] != self.line(0)[..NUMBER_DIGITS] {
            state.is_lost = true;
            return Ok(());
        }
        state.count += 1;
        write_all_at(&file, &self.line(state.count), 0)?;
        state.seen = Instant::now();
        Ok(())
    }

    fn line(&self, count: u64) -> Vec<u8> {
        let mut line = format!("{:016x} {count:016x} {}", self.number, machine()).into_bytes();
        line.truncate(LINE_BYTES_MAX);
        line
    }
}

/// Digits of the number of a process.
const NUMBER_DIGITS: usize = 16;
/// Bytes of a line before the name of the machine.
const MACHINE_AT: usize = 2 * (NUMBER_DIGITS + 1);

/// Name of this machine, as lines have it.
fn machine() -> String {
    host_name().chars().map(|c| if c.is_ascii_graphic() { c } else { '?' }).take(LINE_BYTES_MAX - MACHINE_AT).collect()
}

fn read_line(file: &File) -> io::Result<Vec<u8>> {
    let mut line = Vec::new();
    file.take(LINE_BYTES_MAX as u64).read_to_end(&mut line)?;
    Ok(line)
}

/// The line in a folder; `None` if there is none.
fn line_at(path: &Path) -> Result<Option<Vec<u8>>> {
    let mut options = File::options();
    match no_links(options.read(true)).open(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        opened => opened.and_then(|file| read_line(&file)).map(Some).map_err(|e| Error::io(path, "read", e)),
    }
}

/// Reports whether a file holds a line, or nothing, as after a power cut.
pub(super) fn is_line_at(path: &Path) -> bool {
    let is_line = |line: &[u8]| line.iter().all(|&c| c == 0) || line.get(..MACHINE_AT).is_some_and(is_counted);
    matches!(line_at(path), Ok(Some(line)) if line.len() < LINE_BYTES_MAX && is_line(&line))
}

fn is_counted(numbers: &[u8]) -> bool {
    let is_number = |part: &[u8]| {
        part.split_last().is_some_and(|(end, digits)| *end == b' ' && digits.iter().all(u8::is_ascii_hexdigit))
    };
    numbers.chunks(NUMBER_DIGITS + 1).all(is_number)
}

/// Waits until the line in a folder, if it is that of another machine, has not changed for some time.
fn watch(path: &Path, patience: Duration, progress: &dyn Progress) -> Result<()> {
    let Some(found) = line_at(path)? else { return Ok(()) };
    let machine_of = |line: &[u8]| line.get(MACHINE_AT..).map(|name| String::from_utf8_lossy(name).into_owned());
    let Some(other) = machine_of(&found).filter(|other| *other != machine()) else { return Ok(()) };
    let folder = folder_of(path);
    let (shown, seconds) = (escape_path(folder), patience.as_secs());
    progress.tell(&format!(
        "{shown}: {} has worked here; looking for {seconds} s whether it still does",
        other.escape_default()
    ));
    let began = Instant::now();
    while began.elapsed() < patience {
        std::thread::sleep(LOOK.min(patience));
        progress.check_stopped()?;
        match line_at(path)? {
            None => return Ok(()),
            Some(line) if line != found => return Err(Error::Locked(folder.to_owned())),
            Some(_) => {}
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Silent;

    const OTHERS: &str = "00000000000000aa 0000000000000001 another-machine";

    fn folder_with(line: &str) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join(HOLDER), line).unwrap();
        folder
    }

    #[test]
    fn a_folder_that_another_machine_works_in_is_refused() {
        let folder = folder_with(OTHERS);
        let path = folder.path().join(HOLDER);
        let claimed = std::thread::scope(|scope| {
            let claim = scope.spawn(|| Holder::claim_after(folder.path(), Duration::from_secs(60), &Silent));
            std::thread::sleep(Duration::from_millis(50));
            while !claim.is_finished() {
                fs::write(&path, OTHERS.replace("01 ", "02 ")).unwrap();
                std::thread::sleep(Duration::from_millis(50));
            }
            claim.join().unwrap()
        });
        assert!(matches!(claimed, Err(Error::Locked(_))), "{claimed:?}");
    }

    #[test]
    fn a_folder_that_another_machine_left_is_taken_after_a_while() {
        let folder = folder_with(OTHERS);
        let began = Instant::now();
        let holder = Holder::claim_after(folder.path(), Duration::from_millis(300), &Silent).unwrap();
        assert!(began.elapsed() >= Duration::from_millis(300));
        assert!(holder.seat().confirm().is_ok());
        drop(holder);
        assert_eq!(folder.path().read_dir().unwrap().count(), 0, "who ends leaves no line");
    }

    #[test]
    fn a_line_of_this_machine_is_replaced_at_once() {
        let folder = folder_with(&format!("{}{}", &OTHERS[..MACHINE_AT], machine()));
        let began = Instant::now();
        Holder::claim_after(folder.path(), Duration::from_secs(60), &Silent).unwrap();
        assert!(began.elapsed() < Duration::from_secs(30));
    }

    #[test]
    fn who_was_taken_for_dead_does_nothing_more() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(HOLDER);
        let holder = Holder::claim(folder.path(), &Silent).unwrap();
        fs::remove_file(&path).unwrap();
        fs::write(&path, OTHERS).unwrap();
        holder.seat().look().unwrap();
        assert!(matches!(holder.seat().confirm(), Err(Error::Locked(_))));
        drop(holder);
        assert_eq!(fs::read_to_string(&path).unwrap(), OTHERS);
    }

    #[test]
    fn only_lines_are_taken_for_such() {
        let is_line = |text: &str| is_line_at(&folder_with(text).path().join(HOLDER));
        assert!(is_line(OTHERS) && is_line("") && is_line("\0\0\0"));
        assert!(!is_line("notes of mine, which are longer than the numbers of a line") && !is_line("a"));
        assert!(!is_line(&format!("{OTHERS}{}", "x".repeat(LINE_BYTES_MAX))));
    }
}
