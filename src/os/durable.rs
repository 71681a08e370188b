//! Files that are either whole or absent: written under a temporary name, synced, renamed, and the folder synced.

use std::fs::{self, File, OpenOptions};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::base::{Error, Result};

/// A file under construction; without [`commit`](DurableFile::commit) it is removed on drop.
#[derive(Debug)]
pub struct DurableFile {
    writer: Option<BufWriter<File>>,
    temporary: PathBuf,
    target: PathBuf,
    has_name: bool,
}

impl DurableFile {
    /// Opens a new file beside `target` with a temporary name; follows no symbolic link and replaces nothing.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be made.
    pub fn create(target: &Path, buffer_bytes: usize) -> Result<Self> {
        let mut name = target.file_name().unwrap_or_default().to_owned();
        name.push(".tmp");
        let temporary = target.with_file_name(name);
        // NOTE: a left-over of a killed run may stand in the way; it is ours by its name.
        let _ = fs::remove_file(&temporary);
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .create_new(true)
            .open(&temporary)
            .map_err(|e| Error::io(&temporary, "create", e))?;
        let writer = Some(BufWriter::with_capacity(buffer_bytes, file));
        Ok(Self { writer, temporary, target: target.to_owned(), has_name: false })
    }

    /// The path that the file will have once committed.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// [`Error::NoSpace`] on a full disk, else [`Error::Io`].
    pub fn write(&mut self, bytes: &[u8]) -> Result<()> {
        let Some(writer) = self.writer.as_mut() else { return Ok(()) };
        writer.write_all(bytes).map_err(|e| Error::io(&self.temporary, "write", e))
    }

    /// Overwrites bytes at an offset, after what was appended so far has been flushed.
    ///
    /// # Errors
    /// As [`write`](DurableFile::write).
    pub fn write_at(&mut self, offset: u64, bytes: &[u8]) -> Result<()> {
        let Some(writer) = self.writer.as_mut() else { return Ok(()) };
        let flushed = writer.flush().and_then(|()| super::system::write_all_at(writer.get_ref(), bytes, offset));
        flushed.map_err(|e| Error::io(&self.temporary, "write", e))
    }

    /// Gives the file its name without making anything durable, and returns the open file: for what another process
    /// never reads.
    ///
    /// # Errors
    /// As [`write`](DurableFile::write).
    pub fn commit_scratch(mut self) -> Result<File> {
        let mut writer = self.take_writer()?;
        writer.flush().map_err(|e| Error::io(&self.temporary, "write", e))?;
        self.rename(writer)
    }

    /// Syncs the file, gives it its name, syncs the folder, and returns the open file.
    ///
    /// # Errors
    /// As [`write`](DurableFile::write).
    pub fn commit(mut self) -> Result<File> {
        let mut writer = self.take_writer()?;
        let synced = writer.flush().and_then(|()| writer.get_ref().sync_data());
        synced.map_err(|e| Error::io(&self.temporary, "write", e))?;
        let file = self.rename(writer)?;
        sync_folder(&self.target)?;
        Ok(file)
    }

    fn take_writer(&mut self) -> Result<BufWriter<File>> {
        let again = || Error::Damaged { path: self.target.clone(), message: "committed twice".into() };
        self.writer.take().ok_or_else(again)
    }

    fn rename(&mut self, writer: BufWriter<File>) -> Result<File> {
        fs::rename(&self.temporary, &self.target).map_err(|e| Error::io(&self.target, "rename", e))?;
        self.has_name = true;
        writer.into_inner().map_err(|e| Error::io(&self.target, "write", e.into_error()))
    }
}

impl Drop for DurableFile {
    fn drop(&mut self) {
        if !self.has_name {
            let _ = fs::remove_file(&self.temporary);
        }
    }
}

/// The same way of opening a file, which fails where the file is a symbolic link.
pub fn no_links(options: &mut OpenOptions) -> &mut OpenOptions {
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(options, libc::O_NOFOLLOW);
    options
}

/// Makes the entry of `path` in its folder durable.
///
/// # Errors
/// [`Error::Io`] if the folder cannot be opened or synced.
pub fn sync_folder(path: &Path) -> Result<()> {
    if cfg!(not(unix)) {
        return Ok(());
    }
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    File::open(folder).and_then(|f| f.sync_all()).map_err(|e| Error::io(folder, "sync", e))
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

    #[test]
    fn an_abandoned_file_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        drop(DurableFile::create(&folder.path().join("a.bin"), 16).unwrap());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
