//! A lease on a work folder, for machines that the system's lock does not reach: some network disks lock each machine by
//! itself.
//!
//! ```text
//! lease     number of the process, heartbeats, machine; its process writes it every 2 s
//! ```
//! A process that finds the lease of another machine watches it. One that changes is held; one that stays the same for
//! 15 s of looking has expired and is replaced. A process that finds its own lease replaced had been suspended or cut off
//! from the disk: it records, removes and publishes nothing more.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant, SystemTime};

use crate::base::error::escape_path;
use crate::base::ticker::Ticker;
use crate::base::{Error, Progress, Result, lock};
use crate::os::durable::{folder_of, new_job_number, no_links};
use crate::os::system::{host_name, kernel_start, write_all_at};

/// Name of the file in a work folder.
pub(super) const LEASE: &str = "lease";
/// Time between two heartbeats.
const BEAT: Duration = Duration::from_secs(2);
/// A look at the own lease that is as old as this does not count any more.
const TRUST: Duration = Duration::from_secs(5);
/// Time between two looks at the lease of another machine.
const LOOK: Duration = Duration::from_millis(250);
/// Looks after which a lease that has not changed has expired: 15 s, some heartbeats and what a network disk shows late.
const LOOKS: u32 = 60;
/// Looks after which a process that replaced a lease is sure that no other one did so at the same time.
const LOOKS_AFTER: u32 = 4;
/// Tries to claim a folder that others claim, too.
const TRIES: u32 = 4;
/// Digits of the number of a process, and of its heartbeats.
const NUMBER_DIGITS: usize = 16;
/// Bytes before the name of the machine.
const MACHINE_AT: usize = 2 * (NUMBER_DIGITS + 1);
/// Bytes of a lease, at most.
const LEASE_BYTES_MAX: usize = 256;

/// A held lease; it ends when this is dropped.
#[derive(Debug)]
pub(super) struct Lease {
    file: Arc<LeaseFile>,
    heart: Option<Ticker>,
}

/// What a process knows of its lease.
#[derive(Debug)]
pub(super) struct LeaseFile {
    path: PathBuf,
    /// Number of this process.
    number: u64,
    state: Mutex<LeaseState>,
    /// Whether the state has a loss: seen without waiting for a disk that hangs.
    is_lost: AtomicBool,
}

#[derive(Debug)]
struct LeaseState {
    beats: u64,
    /// When a look began that found the lease to be this process's own, by two clocks: one of them stands still while the
    /// machine sleeps.
    seen: (Instant, SystemTime),
    loss: Option<Loss>,
}

/// How a lease was lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Loss {
    /// Another process has replaced it.
    Replaced,
    /// Its file is gone.
    Gone,
}

/// How an own lease is looked for.
#[derive(Debug, Clone, Copy)]
struct Patience {
    look: Duration,
    looks: u32,
    looks_after: u32,
}

impl Lease {
    /// Claims a locked folder for this process.
    ///
    /// # Errors
    /// [`Error::Locked`] if a process on another machine works in it, [`Error::Stopped`] if asked to stop, else
    /// [`Error::Io`].
    pub(super) fn claim(folder: &Path, progress: &dyn Progress) -> Result<Self> {
        Self::claim_with(folder, Patience { look: LOOK, looks: LOOKS, looks_after: LOOKS_AFTER }, progress)
    }

    fn claim_with(folder: &Path, patience: Patience, progress: &dyn Progress) -> Result<Self> {
        let path = folder.join(LEASE);
        let number = new_job_number(&path);
        let state = LeaseState { beats: 0, seen: now(), loss: None };
        let file = LeaseFile { path, number, state: Mutex::new(state), is_lost: AtomicBool::new(false) };
        for _ in 0..TRIES {
            let was_foreign = file.watch(patience, progress)?;
            if !file.create()? {
                // Another process was faster.
                continue;
            }
            if was_foreign {
                for _ in 0..patience.looks_after {
                    std::thread::sleep(patience.look);
                    file.confirm_now()?;
                }
            }
            return Ok(Self::beating(file));
        }
        Err(Error::Locked(folder.to_owned()))
    }

    fn beating(file: LeaseFile) -> Self {
        let file = Arc::new(file);
        let beating = Arc::clone(&file);
        // Without a thread, the lease is renewed when a step is recorded.
        let heart = Ticker::start("lease", BEAT, move || {
            // A failure is seen when a look is needed.
            let _ = beating.look();
            BEAT
        });
        Self { file, heart: Some(heart) }
    }

    /// The file of the lease.
    pub(super) fn file(&self) -> Arc<LeaseFile> {
        Arc::clone(&self.file)
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        drop(self.heart.take());
        if self.file.confirm_now().is_ok() {
            let _ = fs::remove_file(&self.file.path);
        }
    }
}

impl LeaseFile {
    /// Makes sure that the lease was this process's own a moment ago.
    ///
    /// # Errors
    /// [`Error::Locked`] if another process has replaced it, [`Error::Changed`] if it is gone; [`Error::Io`] if it cannot
    /// be read or written.
    pub(super) fn confirm(&self) -> Result<()> {
        let (instant, time) = lock(&self.state).seen;
        let is_recent = instant.elapsed() < TRUST && time.elapsed().is_ok_and(|since| since < TRUST);
        if is_recent { self.outcome() } else { self.confirm_now() }
    }

    /// Makes sure that the lease is this process's own now.
    ///
    /// # Errors
    /// As [`confirm`](LeaseFile::confirm).
    pub(super) fn confirm_now(&self) -> Result<()> {
        self.look().map_err(|e| Error::io(&self.path, "write", e))?;
        self.outcome()
    }

    /// The error of a lost lease, as far as is known.
    pub(super) fn outcome(&self) -> Result<()> {
        let folder = folder_of(&self.path);
        match lock(&self.state).loss {
            None => Ok(()),
            Some(Loss::Replaced) => Err(Error::Locked(folder.to_owned())),
            Some(Loss::Gone) => {
                let shown = escape_path(folder);
                Err(Error::Changed(format!("{shown}: removed meanwhile, or another process has ended its job")))
            }
        }
    }

    /// Whether it is known that the lease was lost.
    pub(super) fn is_lost(&self) -> bool {
        self.is_lost.load(Ordering::Relaxed)
    }

    fn lose(&self, state: &mut LeaseState, loss: Loss) {
        state.loss = Some(loss);
        self.is_lost.store(true, Ordering::Relaxed);
    }

    /// Looks whether the lease is this process's own, and renews it.
    fn look(&self) -> io::Result<()> {
        let mut state = lock(&self.state);
        if state.loss.is_some() {
            return Ok(());
        }
        let began = now();
        let mut options = File::options();
        let file = match no_links(options.read(true).write(true)).open(&self.path) {
            Err(error) if error.kind() == ErrorKind::NotFound => {
                self.lose(&mut state, Loss::Gone);
                return Ok(());
            }
            opened => opened?,
        };
        if read_lease(&file)?.get(..NUMBER_DIGITS) != self.text(0).get(..NUMBER_DIGITS) {
            self.lose(&mut state, Loss::Replaced);
            return Ok(());
        }
        state.beats += 1;
        write_all_at(&file, &self.text(state.beats), 0)?;
        state.seen = began;
        Ok(())
    }

    /// Creates the file; `false` if there is one.
    fn create(&self) -> Result<bool> {
        let mut options = File::options();
        let created = no_links(options.write(true).create_new(true)).open(&self.path);
        let written = match created {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => return Ok(false),
            created => created.and_then(|file| write_all_at(&file, &self.text(0), 0)),
        };
        if let Err(error) = written {
            let _ = fs::remove_file(&self.path);
            return Err(Error::io(&self.path, "write", error));
        }
        lock(&self.state).seen = now();
        Ok(true)
    }

    fn text(&self, beats: u64) -> Vec<u8> {
        let mut text = format!("{:016x} {beats:016x} {}", self.number, machine()).into_bytes();
        text.truncate(LEASE_BYTES_MAX - 1);
        text
    }

    /// Removes the lease that an ended process left, once it has not changed for a while if it is that of another machine;
    /// returns whether it was.
    fn watch(&self, patience: Patience, progress: &dyn Progress) -> Result<bool> {
        let Some(mut found) = lease_at(&self.path)? else { return Ok(false) };
        if !is_lease(&found) {
            // It is being written, or a power cut has left it.
            std::thread::sleep(patience.look);
            match lease_at(&self.path)? {
                None => return Ok(false),
                Some(again) => found = again,
            }
        }
        let is_foreign = is_lease(&found) && found[MACHINE_AT..] != *self.text(0).get(MACHINE_AT..).unwrap_or_default();
        if is_foreign {
            let folder = folder_of(&self.path);
            let machine = String::from_utf8_lossy(&found[MACHINE_AT..]).into_owned();
            let name = machine.split(' ').next().unwrap_or_default().escape_default();
            let shown = escape_path(folder);
            progress.tell(&format!("{shown}: {name} has worked here; looking for 15 s whether it still does"));
            for _ in 0..patience.looks {
                std::thread::sleep(patience.look);
                progress.check_stopped()?;
                // One that is gone was held until now.
                if lease_at(&self.path)?.as_ref() != Some(&found) {
                    return Err(Error::Locked(folder.to_owned()));
                }
            }
        }
        match fs::remove_file(&self.path) {
            Err(error) if error.kind() != ErrorKind::NotFound => Err(Error::io(&self.path, "remove", error)),
            _ => Ok(is_foreign),
        }
    }
}

fn now() -> (Instant, SystemTime) {
    (Instant::now(), SystemTime::now())
}

/// This machine since it was started, as leases have it: its name, and when its system started if that is known.
fn machine() -> String {
    let name: String = host_name().chars().map(|c| if c.is_ascii_graphic() { c } else { '?' }).collect();
    format!("{name} {}", kernel_start())
}

fn read_lease(file: &File) -> io::Result<Vec<u8>> {
    let mut text = Vec::new();
    file.take(LEASE_BYTES_MAX as u64).read_to_end(&mut text)?;
    Ok(text)
}

/// The lease at a path; `None` if there is none.
fn lease_at(path: &Path) -> Result<Option<Vec<u8>>> {
    let mut options = File::options();
    match no_links(options.read(true)).open(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        opened => opened.and_then(|file| read_lease(&file)).map(Some).map_err(|e| Error::io(path, "read", e)),
    }
}

fn is_lease(text: &[u8]) -> bool {
    let is_number = |part: &[u8]| {
        part.split_last().is_some_and(|(end, digits)| *end == b' ' && digits.iter().all(u8::is_ascii_hexdigit))
    };
    text.len() < LEASE_BYTES_MAX
        && text.get(..MACHINE_AT).is_some_and(|numbers| numbers.chunks(NUMBER_DIGITS + 1).all(is_number))
}

/// Reports whether a file is a lease, is written as one just now, or was left by a power cut; also if it is gone.
pub(super) fn is_lease_at(path: &Path) -> bool {
    match lease_at(path) {
        Ok(found) => found.is_none_or(|text| is_lease(&text) || text.iter().all(|&c| c == 0)),
        Err(_) => false,
    }
}

/// Reports whether a process on another machine holds the lease of a folder; takes up to 5 s to find out.
pub(super) fn is_held(folder: &Path) -> bool {
    let path = folder.join(LEASE);
    let found = |path: &Path| lease_at(path).ok().flatten().filter(|text| is_lease(text));
    let Some(first) = found(&path).filter(|text| text[MACHINE_AT..] != *machine().as_bytes()) else { return false };
    let changes = |_| {
        std::thread::sleep(LOOK);
        found(&path).is_some_and(|text| text != first)
    };
    (0..TRUST.as_millis() / LOOK.as_millis()).any(changes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Silent;

    const OTHERS: &str = "00000000000000aa 0000000000000001 another-machine 7";
    const SHORT: Patience = Patience { look: Duration::from_millis(20), looks: 10, looks_after: 2 };

    fn folder_with(text: &str) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join(LEASE), text).unwrap();
        folder
    }

    #[test]
    fn a_folder_that_another_machine_works_in_is_refused() {
        let folder = folder_with(OTHERS);
        let path = folder.path().join(LEASE);
        assert!(std::thread::scope(|scope| {
            let claim = scope.spawn(|| Lease::claim_with(folder.path(), Patience { looks: 1000, ..SHORT }, &Silent));
            let held = scope.spawn(|| is_held(folder.path()));
            // In its place, as leases are renewed: `fs::write` empties the file first.
            let file = File::options().write(true).open(&path).unwrap();
            let mut beats = 2;
            while !claim.is_finished() || !held.is_finished() {
                write_all_at(&file, OTHERS.replace("01 ", &format!("{beats:02} ")).as_bytes(), 0).unwrap();
                beats = 2 + (beats + 1) % 90;
                std::thread::sleep(Duration::from_millis(50));
            }
            let claimed = claim.join().unwrap();
            assert!(matches!(claimed, Err(Error::Locked(_))), "{claimed:?}");
            held.join().unwrap()
        }));
    }

    #[test]
    fn a_lease_that_another_machine_left_is_replaced_after_a_while() {
        let folder = folder_with(OTHERS);
        let began = Instant::now();
        let lease = Lease::claim_with(folder.path(), SHORT, &Silent).unwrap();
        assert!(began.elapsed() >= SHORT.looks * SHORT.look);
        assert!(lease.file().confirm_now().is_ok());
        drop(lease);
        assert_eq!(folder.path().read_dir().unwrap().count(), 0, "who ends leaves no lease");
    }

    #[test]
    fn one_of_many_that_begin_at_once_gets_the_folder() {
        for text in [None, Some(OTHERS), Some("\0\0\0"), Some("")] {
            let folder = text.map_or_else(|| tempfile::tempdir().unwrap(), folder_with);
            let claims = std::thread::scope(|scope| {
                let claim = |_| scope.spawn(|| Lease::claim_with(folder.path(), SHORT, &Silent));
                let started: Vec<_> = (0..8).map(claim).collect();
                started.into_iter().map(|claim| claim.join().unwrap()).collect::<Vec<_>>()
            });
            // All are of this machine here, where the lock admits one alone: each replaces the one before.
            let held = claims.iter().flatten().filter(|lease| lease.file().confirm_now().is_ok()).count();
            assert!(held <= 1, "{text:?}: {held}");
        }
    }

    #[test]
    fn a_lease_of_this_machine_is_replaced_at_once() {
        let folder = folder_with(&format!("{}{}", &OTHERS[..MACHINE_AT], machine()));
        let long = Patience { look: Duration::from_secs(60), ..SHORT };
        Lease::claim_with(folder.path(), long, &Silent).unwrap();
    }

    #[test]
    fn who_lost_the_lease_does_nothing_more() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(LEASE);
        let claim = || Lease::claim(folder.path(), &Silent).unwrap();
        let lease = claim();
        fs::remove_file(&path).unwrap();
        fs::write(&path, OTHERS).unwrap();
        assert!(lease.file().confirm().is_ok(), "a look a moment ago counts");
        assert!(matches!(lease.file().confirm_now(), Err(Error::Locked(_))));
        assert!(matches!(lease.file().confirm(), Err(Error::Locked(_))));
        drop(lease);
        assert_eq!(fs::read_to_string(&path).unwrap(), OTHERS);
        fs::remove_file(&path).unwrap();
        let lease = claim();
        fs::remove_file(&path).unwrap();
        assert!(matches!(lease.file().confirm_now(), Err(Error::Changed(_))));
    }

    #[test]
    fn only_leases_are_taken_for_such() {
        let is_one = |text: &str| is_lease_at(&folder_with(text).path().join(LEASE));
        assert!(is_one(OTHERS) && is_one("") && is_one("\0\0\0"));
        assert!(!is_one("notes of mine, which are longer than the numbers of a lease") && !is_one("a"));
        assert!(!is_one(&format!("{OTHERS}{}", "x".repeat(LEASE_BYTES_MAX))));
        assert!(is_lease_at(Path::new("nowhere/lease")) && !is_held(Path::new("nowhere")));
    }
}
