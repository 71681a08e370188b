//! Files that are either complete or absent: written under a temporary name, synced and renamed; then the folder is
//! synced.
//!
//! In a work folder, the temporary name is that of the file plus `.tmp`, or plus a number and `.tmp` where several
//! processes may write the file. In folders of the user, it must neither match
//! a file of the user nor of another process; there it is `drystone-<job>-<hash of the file name>.tmp`, which only this
//! job creates and removes ([`waiting_place`], [`remove_waiting`]).

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use xxhash_rust::xxh3::{xxh3_64, xxh3_64_with_seed};

use crate::base::pool::{Durability, durability};
use crate::base::threads::beside;
use crate::base::{Error, Result};

/// Longest wait for the lock of a folder, which may belong to the user and never be released.
const LOCK_PATIENCE: Duration = Duration::from_secs(20);
const LOCK_INTERVAL: Duration = Duration::from_millis(20);

/// A file being written; removed on drop unless it is [committed](DurableFile::commit).
#[derive(Debug)]
pub struct DurableFile {
    writer: Option<BufWriter<File>>,
    temporary: PathBuf,
    target: PathBuf,
    is_sealed: bool,
    /// Whether it matters only until the job ends.
    is_scratch: bool,
    /// Syncs what was appended earlier.
    ahead: Option<JoinHandle<Result<()>>>,
}

impl DurableFile {
    /// Creates a file that a job cannot do without, under a temporary name in its work folder; follows no symbolic link
    /// and replaces no other file.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be created.
    pub fn create(target: &Path, buffer_bytes: usize) -> Result<Self> {
        let mut name = target.file_name().unwrap_or_default().to_owned();
        name.push(".tmp");
        Self::create_at(target, target.with_file_name(name), buffer_bytes, false)
    }

    /// Creates a file under a temporary name of this job in a folder of the user.
    ///
    /// # Errors
    /// As [`create`](DurableFile::create).
    pub fn create_outside(target: &Path, job: u64, buffer_bytes: usize) -> Result<Self> {
        Self::create_at(target, waiting_place(target, job), buffer_bytes, false)
    }

    /// Creates a scratch file under a temporary name of this process, for a target that several processes may write at
    /// once.
    ///
    /// # Errors
    /// As [`create`](DurableFile::create).
    pub fn create_shared(target: &Path, buffer_bytes: usize) -> Result<Self> {
        let mut name = target.file_name().unwrap_or_default().to_owned();
        name.push(format!(".{:016x}.tmp", new_job_number(target)));
        Self::create_at(target, target.with_file_name(name), buffer_bytes, true)
    }

    fn create_at(target: &Path, temporary: PathBuf, buffer_bytes: usize, is_scratch: bool) -> Result<Self> {
        // NOTE: a killed run may have left this file; only this program uses the name.
        let _ = fs::remove_file(&temporary);
        let mut options = OpenOptions::new();
        let opened = options.read(true).write(true).create_new(true).open(&temporary);
        let file = opened.map_err(|e| Error::io(target, "create", e))?;
        let writer = Some(BufWriter::with_capacity(buffer_bytes, file));
        Ok(Self { writer, temporary, target: target.to_owned(), is_sealed: false, is_scratch, ahead: None })
    }

    /// Path of the file once it is committed.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// [`Error::NoSpace`] on a full disk, else [`Error::Io`].
    pub fn write(&mut self, bytes: &[u8]) -> Result<()> {
        let Some(writer) = self.writer.as_mut() else { return Ok(()) };
        self.is_sealed = false;
        let held = writer.buffer().len();
        writer.write_all(bytes).map_err(|e| Error::io(&self.target, "write", e).lacking((held + bytes.len()) as u64))
    }

    /// Begins to sync what was appended so far, beside what follows, so that [`seal`](DurableFile::seal) finds little to
    /// do; does nothing while an earlier sync lasts.
    ///
    /// # Errors
    /// As [`write`](DurableFile::write), those of the earlier sync.
    pub fn sync_ahead(&mut self) -> Result<()> {
        if !self.must_last() || self.ahead.as_ref().is_some_and(|thread| !thread.is_finished()) {
            return Ok(());
        }
        self.wait_for_sync()?;
        let Some(writer) = &self.writer else { return Ok(()) };
        let (temporary, target) = (self.temporary.clone(), self.target.clone());
        // Without a second handle, all is synced at the end.
        if let Ok(file) = writer.get_ref().try_clone() {
            let sync = move || sync_file(&file, &temporary).map_err(|e| Error::io(&target, "write", e));
            self.ahead = beside(sync)?;
        }
        Ok(())
    }

    /// Whether the file must outlast a power cut.
    fn must_last(&self) -> bool {
        durability() == Durability::All || !self.is_scratch
    }

    /// Waits for a sync that goes on. NOTE: the system tells a failed sync once, so its outcome may not be lost.
    fn wait_for_sync(&mut self) -> Result<()> {
        let lost = |_| Error::Damaged { path: self.target.clone(), message: "a sync ended without an outcome".into() };
        self.ahead.take().map_or(Ok(()), |thread| thread.join().map_err(lost)?)
    }

    /// Flushes appended bytes, then overwrites bytes at an offset.
    ///
    /// # Errors
    /// As [`write`](DurableFile::write).
    pub fn write_at(&mut self, offset: u64, bytes: &[u8]) -> Result<()> {
        let Some(writer) = self.writer.as_mut() else { return Ok(()) };
        self.is_sealed = false;
        let flushed = writer.flush().and_then(|()| super::system::write_all_at(writer.get_ref(), bytes, offset));
        flushed.map_err(|e| Error::io(&self.target, "write", e).lacking(bytes.len() as u64))
    }

    /// Renames the file to its final name without syncing, and returns the open file. For files that only this process
    /// reads.
    ///
    /// # Errors
    /// As [`write`](DurableFile::write).
    pub fn commit_scratch(mut self) -> Result<File> {
        let file = self.take_file()?;
        give_name(&self.temporary, &self.target)?;
        Ok(file)
    }

    /// Syncs the file under its temporary name, so that little can fail when it is renamed.
    ///
    /// # Errors
    /// As [`write`](DurableFile::write).
    pub fn seal(&mut self) -> Result<()> {
        self.wait_for_sync()?;
        let must_last = self.must_last();
        if let Some(writer) = self.writer.as_mut().filter(|_| !self.is_sealed) {
            let held = writer.buffer().len() as u64;
            let flushed = writer.flush();
            let sync = || sync_file(writer.get_ref(), &self.temporary);
            let synced = if must_last { flushed.and_then(|()| sync()) } else { flushed };
            synced.map_err(|e| Error::io(&self.target, "write", e).lacking(held))?;
            self.is_sealed = true;
        }
        Ok(())
    }

    /// Syncs the file, renames it to its final name, syncs the folder, and returns the open file.
    ///
    /// # Errors
    /// As [`write`](DurableFile::write).
    pub fn commit(mut self) -> Result<File> {
        self.seal()?;
        let file = self.take_file()?;
        give_name(&self.temporary, &self.target)?;
        if self.must_last() {
            sync_folder(&self.target)?;
        }
        Ok(file)
    }

    /// Flushes the buffer and returns the open file.
    fn take_file(&mut self) -> Result<File> {
        let again = || Error::Damaged { path: self.target.clone(), message: "committed twice".into() };
        let writer = self.writer.take().ok_or_else(again)?;
        writer.into_inner().map_err(|e| Error::io(&self.target, "write", e.into_error()))
    }
}

impl Drop for DurableFile {
    fn drop(&mut self) {
        // The file takes space while it is synced.
        let _ = self.wait_for_sync();
        // Has no effect once the file is renamed.
        let _ = fs::remove_file(&self.temporary);
    }
}

/// Returns the temporary path of a job's file that will become `target`. The job's number is in it, so that a later
/// process of the job finds the file after a kill; no other process writes to it.
pub fn waiting_place(target: &Path, job: u64) -> PathBuf {
    static PROCESS: OnceLock<u64> = OnceLock::new();
    let process = *PROCESS.get_or_init(|| new_job_number(Path::new("")));
    let name = target.file_name().unwrap_or_default().as_encoded_bytes();
    target.with_file_name(format!("drystone-{job:016x}-{:016x}.tmp", xxh3_64_with_seed(name, process)))
}

/// Removes the temporary files of a job from a folder; returns whether there were any.
pub fn remove_waiting(folder: &Path, job: u64) -> bool {
    let mut found = false;
    let prefix = format!("drystone-{job:016x}-");
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        if name.to_str().is_some_and(|name| name.starts_with(&prefix) && name.ends_with(".tmp")) {
            let _ = fs::remove_file(entry.path());
            found = true;
        }
    }
    found
}

/// Returns an id for [`waiting_place`] that is unique in practice: a hash of the time, the process id and a path.
pub fn new_job_number(path: &Path) -> u64 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    let seed = [&since.as_nanos().to_le_bytes()[..], &std::process::id().to_le_bytes()].concat();
    xxh3_64_with_seed(path.as_os_str().as_encoded_bytes(), xxh3_64(&seed))
}

/// Returns a path in the system's temporary folder that does not exist yet.
pub fn temporary_folder(purpose: &str) -> PathBuf {
    let folder = std::env::temp_dir();
    folder.join(format!("drystone-{purpose}-{:016x}", new_job_number(&folder)))
}

/// Makes opening fail on a symbolic link, and not block on a pipe.
pub fn no_links(options: &mut OpenOptions) -> &mut OpenOptions {
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(options, libc::O_NOFOLLOW | libc::O_NONBLOCK);
    options
}

/// Returns the folder of a path; `.` if the path names none.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Creates a folder and its missing parents, and makes their entries durable.
///
/// # Errors
/// [`Error::Io`] if one cannot be created or synced.
pub fn make_folders(path: &Path) -> Result<()> {
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    if path.is_dir() {
        return Ok(());
    }
    if let Some(parent) = path.parent() {
        make_folders(parent)?;
    }
    match fs::create_dir(path) {
        Ok(()) => {
            witness::note("make", path);
            sync_folder(path)
        }
        // Another process may have created it first.
        Err(_) if path.is_dir() => Ok(()),
        Err(error) => Err(Error::io(path, "create", error)),
    }
}

/// Waits for the lock of a folder; it is held until the returned file is dropped. `None` if folders cannot be locked,
/// or after 20 s. Calls `wait` between attempts; an error of it ends the waiting.
///
/// # Errors
/// Those of `wait`.
pub fn lock_while_open(folder: &Path, wait: impl FnMut() -> Result<()>) -> Result<Option<File>> {
    lock_within(LOCK_PATIENCE, folder, wait)
}

fn lock_within(patience: Duration, folder: &Path, mut wait: impl FnMut() -> Result<()>) -> Result<Option<File>> {
    let Ok(folder) = File::open(folder) else { return Ok(None) };
    let began = Instant::now();
    loop {
        match fs4::FileExt::try_lock(&folder) {
            Ok(()) => return Ok(Some(folder)),
            Err(fs4::TryLockError::WouldBlock) if began.elapsed() < patience => wait()?,
            Err(_) => return Ok(None),
        }
        std::thread::sleep(LOCK_INTERVAL);
    }
}

/// Syncs the data of an open file, unless [nothing](Durability::None) of this thread's work must outlast a power cut.
///
/// # Errors
/// The error of the system call.
pub fn sync_file(file: &File, path: &Path) -> io::Result<()> {
    if durability() == Durability::None {
        return Ok(());
    }
    file.sync_data().inspect(|()| witness::note("sync", path))
}

/// Renames a temporary file to its final name; does not sync the folder.
///
/// # Errors
/// [`Error::Io`] if it cannot be renamed.
pub fn give_name(temporary: &Path, target: &Path) -> Result<()> {
    fs::rename(temporary, target).map_err(|e| Error::io(target, "rename", e))?;
    witness::note("rename", target);
    Ok(())
}

/// Makes the entry of `path` in its folder durable, unless [nothing](Durability::None) of this thread's work must
/// outlast a power cut.
///
/// # Errors
/// [`Error::Io`] if the folder cannot be opened or synced.
pub fn sync_folder(path: &Path) -> Result<()> {
    if cfg!(not(unix)) || durability() == Durability::None {
        return Ok(());
    }
    let folder = folder_of(path);
    let synced = File::open(folder).and_then(|f| f.sync_all());
    synced.inspect(|()| witness::note("sync", folder)).map_err(|e| Error::io(folder, "sync", e))
}

/// Records what a thread made durable and in which order, in tests; does nothing otherwise.
pub(crate) mod witness {
    use std::path::Path;
    #[cfg(test)]
    use std::{cell::RefCell, path::PathBuf};

    #[cfg(test)]
    thread_local! {
        static SEEN: RefCell<Vec<(&'static str, PathBuf)>> = const { RefCell::new(Vec::new()) };
    }

    /// Records a call that succeeded.
    #[inline(always)]
    pub(super) fn note(_what: &'static str, _path: &Path) {
        #[cfg(test)]
        SEEN.with_borrow_mut(|seen| seen.push((_what, _path.to_owned())));
    }

    /// Returns and clears the records of this thread.
    #[cfg(test)]
    pub(crate) fn take() -> Vec<(&'static str, PathBuf)> {
        SEEN.take()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_appears_only_when_committed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        let mut file = DurableFile::create(&path, 16).unwrap();
        file.write(b"hello").unwrap();
        assert!(!path.exists());
        file.write_at(0, b"j").unwrap();
        file.commit().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"jello");
    }

    /// A sealed file with some bytes, its final path, and its folder.
    fn sealed() -> (tempfile::TempDir, PathBuf, DurableFile) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        let mut file = DurableFile::create(&path, 16).unwrap();
        file.write(b"hello").unwrap();
        file.seal().unwrap();
        (folder, path, file)
    }

    #[test]
    fn a_file_is_synced_before_it_has_its_name_and_its_folder_afterwards() {
        let changes: [fn(&mut DurableFile); 2] =
            [|file| file.write(b" again").unwrap(), |file| file.write_at(0, b"j").unwrap()];
        for change in changes {
            let (folder, path, mut file) = sealed();
            let waiting = folder.path().join("a.bin.tmp");
            change(&mut file);
            witness::take();
            file.commit().unwrap();
            let expected = [("sync", waiting), ("rename", path), ("sync", folder.path().to_owned())];
            assert_eq!(witness::take(), expected);
        }
    }

    #[test]
    fn a_file_without_bytes_is_synced_too() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        let file = DurableFile::create(&path, 16).unwrap();
        witness::take();
        file.commit().unwrap();
        assert_eq!(witness::take().first(), Some(&("sync", folder.path().join("a.bin.tmp"))));
    }

    #[test]
    fn what_must_last_is_synced_and_nothing_else() {
        use crate::base::pool::Pool;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        let creations: [fn(&Path) -> Result<DurableFile>; 3] = [
            |path| DurableFile::create(path, 16),
            |path| DurableFile::create_outside(path, 1, 16),
            |path| DurableFile::create_shared(path, 16),
        ];
        for (must_last, synced) in [
            (Durability::All, [true, true, true]),
            (Durability::Result, [true, true, false]),
            (Durability::None, [false, false, false]),
        ] {
            let _inside = Pool::with(1, must_last).unwrap().enter();
            for (create, is_synced) in creations.into_iter().zip(synced) {
                let mut file = create(&path).unwrap();
                file.write(b"hello").unwrap();
                witness::take();
                file.sync_ahead().unwrap();
                assert!(file.must_last() || file.ahead.is_none(), "{must_last:?}");
                file.commit().unwrap();
                let calls: Vec<_> = witness::take().into_iter().map(|(what, _)| what).collect();
                let expected: &[&str] = if is_synced { &["sync", "rename", "sync"] } else { &["rename"] };
                assert!(calls == expected, "{must_last:?}: {calls:?}");
                assert_eq!(fs::read(&path).unwrap(), b"hello");
            }
        }
    }

    #[test]
    fn what_is_committed_is_handed_over_to_be_read() {
        use std::io::{Read, Seek};
        let commits: [fn(DurableFile) -> Result<File>; 2] = [DurableFile::commit, DurableFile::commit_scratch];
        for commit in commits {
            let folder = tempfile::tempdir().unwrap();
            let mut file = DurableFile::create(&folder.path().join("a.bin"), 16).unwrap();
            file.write(b"hello").unwrap();
            let (mut file, mut text) = (commit(file).unwrap(), String::new());
            file.rewind().unwrap();
            file.read_to_string(&mut text).unwrap();
            assert_eq!(text, "hello");
        }
    }

    #[test]
    fn what_is_synced_ahead_is_sealed_as_well() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        let mut file = DurableFile::create(&path, 16).unwrap();
        for _ in 0..3 {
            file.write(&[7; 40]).unwrap();
            file.sync_ahead().unwrap();
        }
        file.commit().unwrap();
        assert_eq!(fs::read(&path).unwrap(), [7; 120]);
        assert!(witness::take().iter().any(|&(what, _)| what == "rename"));
    }

    #[test]
    fn no_sync_begins_ahead_while_another_lasts_whose_failure_is_told_at_the_end() {
        use std::sync::mpsc::channel;
        let (_folder, _, mut file) = sealed();
        let (end, ended) = channel::<()>();
        // It ends by itself if it is waited for.
        let fail = |_| Err(Error::Stopped);
        file.ahead = Some(std::thread::spawn(move || fail(ended.recv_timeout(Duration::from_secs(1)))));
        let thread = |file: &DurableFile| file.ahead.as_ref().map(|thread| thread.thread().id());
        let first = thread(&file);
        file.sync_ahead().unwrap();
        assert!(first.is_some() && thread(&file) == first);
        drop(end);
        assert!(matches!(file.commit(), Err(Error::Stopped)));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_sync_that_failed_ahead_is_told() {
        let null = OpenOptions::new().write(true).open("/dev/null").unwrap();
        let writer = Some(BufWriter::with_capacity(8192, null));
        let [temporary, target] = ["nowhere/a.tmp", "nowhere/a"].map(PathBuf::from);
        let mut file = DurableFile { writer, temporary, target, is_sealed: false, is_scratch: false, ahead: None };
        file.sync_ahead().unwrap();
        let told = file.wait_for_sync().unwrap_err();
        assert!(matches!(told, Error::Io { .. }), "{told}");
        assert!(file.wait_for_sync().is_ok());
        // Also if the next one begins.
        file.sync_ahead().unwrap();
        while file.ahead.as_ref().is_some_and(|thread| !thread.is_finished()) {
            std::thread::yield_now();
        }
        assert!(matches!(file.sync_ahead(), Err(Error::Io { .. })));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_told_with_what_is_missing() {
        let message = |change: fn(&mut DurableFile) -> Result<()>| {
            let full = OpenOptions::new().read(true).write(true).open("/dev/full").unwrap();
            let writer = Some(BufWriter::with_capacity(8192, full));
            let [temporary, target] = ["nowhere/a.tmp", "nowhere/a"].map(PathBuf::from);
            let mut file = DurableFile { writer, temporary, target, is_sealed: false, is_scratch: false, ahead: None };
            file.write(&[7; 5120]).unwrap();
            match change(&mut file) {
                Err(Error::NoSpace { path, message }) => {
                    // Unwritten bytes do not affect how the file ends.
                    std::mem::forget(file);
                    (path, message)
                }
                other => panic!("{other:?}"),
            }
        };
        let (path, written) = message(|file| file.write(&[7; 4096]));
        assert!(path == Path::new("nowhere/a") && written.starts_with("about 9 KiB"), "{written}");
        let (_, sealed) = message(DurableFile::seal);
        assert!(sealed.starts_with("about 5 KiB"), "{sealed}");
        let (_, overwritten) = message(|file| file.write_at(0, &[7; 3072]));
        assert!(overwritten.starts_with("about 3 KiB"), "{overwritten}");
    }

    #[test]
    fn what_waits_for_its_name_is_found_and_removed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("city.obj");
        fs::write(waiting_place(&path, 1), "left").unwrap();
        assert!(!remove_waiting(folder.path(), 2));
        assert!(remove_waiting(folder.path(), 1));
        assert!(!remove_waiting(folder.path(), 1));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn what_was_sealed_and_not_changed_since_is_not_synced_again() {
        let (folder, path, file) = sealed();
        witness::take();
        file.commit().unwrap();
        assert_eq!(witness::take(), [("rename", path), ("sync", folder.path().to_owned())]);
    }

    #[test]
    fn scratch_is_never_synced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        let file = DurableFile::create(&path, 16).unwrap();
        witness::take();
        file.commit_scratch().unwrap();
        assert_eq!(witness::take(), [("rename", path)]);
    }

    #[test]
    fn each_new_folder_is_synced_into_the_one_above_it() {
        let folder = tempfile::tempdir().unwrap();
        let (outer, inner) = (folder.path().join("outer"), folder.path().join("outer/inner"));
        witness::take();
        make_folders(&inner).unwrap();
        let root = folder.path().to_owned();
        assert_eq!(witness::take(), [("make", outer.clone()), ("sync", root), ("make", inner), ("sync", outer)]);
        make_folders(&folder.path().join("outer/inner")).unwrap();
        make_folders(Path::new("")).unwrap();
        assert_eq!(witness::take(), []);
    }

    #[test]
    fn folders_on_the_way_are_made_but_not_in_the_place_of_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let [one, other] = ["one", "other"].map(|name| folder.path().join(name));
        // `one/..` is there as soon as `one` is.
        make_folders(&one.join("../other")).unwrap();
        assert!(one.is_dir() && other.is_dir());
        fs::write(one.join("file"), "mine").unwrap();
        assert!(matches!(make_folders(&one.join("file")), Err(Error::Io { .. })));
        assert!(matches!(make_folders(&one.join("file/more")), Err(Error::Io { .. })));
    }

    #[test]
    fn nothing_of_the_users_is_taken_for_a_left_over() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("city.obj");
        fs::write(folder.path().join("city.obj.tmp"), "mine").unwrap();
        let mut of_one = DurableFile::create_outside(&path, 1, 16).unwrap();
        let mut of_other = DurableFile::create_outside(&path, 2, 16).unwrap();
        of_one.write(b"one").unwrap();
        of_other.write(b"other").unwrap();
        of_one.commit().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"one");
        of_other.commit().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"other");
        assert_eq!(fs::read(folder.path().join("city.obj.tmp")).unwrap(), b"mine");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn the_lock_of_a_folder_is_waited_for_until_the_caller_has_enough() {
        let folder = tempfile::tempdir().unwrap();
        let held = lock_while_open(folder.path(), || Ok(())).unwrap();
        assert!(held.is_some());
        let mut asked = 0;
        let outcome = lock_while_open(folder.path(), || {
            asked += 1;
            if asked < 3 { Ok(()) } else { Err(Error::Stopped) }
        });
        assert!(matches!(outcome, Err(Error::Stopped)) && asked == 3);
        let without_patience = lock_within(Duration::ZERO, folder.path(), || panic!("nobody waits"));
        assert!(without_patience.unwrap().is_none());
        drop(held);
        assert!(lock_while_open(folder.path(), || Err(Error::Stopped)).unwrap().is_some());
    }

    #[test]
    fn time_passes_between_two_looks_at_a_lock() {
        let folder = tempfile::tempdir().unwrap();
        let _held = lock_while_open(folder.path(), || Ok(())).unwrap();
        let mut looks = 0;
        let count = || {
            looks += 1;
            Ok(())
        };
        assert!(lock_within(3 * LOCK_INTERVAL, folder.path(), count).unwrap().is_none());
        assert!(looks <= 3, "{looks}");
    }

    #[test]
    fn an_abandoned_file_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        drop(DurableFile::create(&folder.path().join("a.bin"), 16).unwrap());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
