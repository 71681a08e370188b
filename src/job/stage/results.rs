//! Results of a task, in one file.
//!
//! ```text
//! header │ result │ result │ … │ table of contents │ its length, 8 bytes
//! ```
//! Results are written one by one, so that a process holds few of them at once.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::stage_file::{Stage, StageTask};
use crate::base::{Error, Result};
use crate::file::header::{HEADER_BYTES, Header};
use crate::file::{RecordFile, codec};
use crate::job::recalled::Recalled;
use crate::job::stamp::Stamp;
use crate::os::content::Content;
use crate::os::durable::no_links;
use crate::os::system::read_exact_at;

const KIND: [u8; 8] = *b"results ";
/// Ending of the file's name.
pub(super) const RESULTS: &str = "results";

/// Where the result of an item lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct ResultFrame {
    /// Number of the item.
    pub item: u32,
    offset: u64,
    bytes: u64,
}

/// Table of contents.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct TaskContents {
    /// Id of the stage.
    pub stage: u64,
    pub frames: Vec<ResultFrame>,
    /// The other files of the task.
    pub files: Vec<Stamp>,
}

/// Results of a task, being written.
pub struct TaskWriter {
    file: RecordFile,
    contents: TaskContents,
}

impl TaskWriter {
    /// Begins the results of a task.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn create(stage: &Stage, task: &StageTask) -> Result<Self> {
        let file = RecordFile::create(&stage.file_of(task, RESULTS))?;
        Ok(Self { file, contents: TaskContents { stage: stage.id(), frames: Vec::new(), files: Vec::new() } })
    }

    /// Adds the result of an item.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn put<T: Serialize>(&mut self, item: u32, result: &T) -> Result<()> {
        let bytes = encoded(result)?;
        let offset = self.file.put(&bytes)?;
        self.contents.frames.push(ResultFrame { item, offset, bytes: bytes.len() as u64 });
        Ok(())
    }

    /// Gives the file its name, once the other files of the task have theirs: the task is done.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn finish<'a>(mut self, files: impl IntoIterator<Item = &'a Path>) -> Result<()> {
        self.contents.files = files.into_iter().map(Stamp::of).collect::<Result<_>>()?;
        let bytes = encoded(&self.contents)?;
        self.file.put(&bytes)?;
        self.file.put(&(bytes.len() as u64).to_le_bytes())?;
        self.file.finish(KIND, 0, self.contents.frames.len() as u64)?;
        Ok(())
    }
}

fn encoded<T: Serialize>(value: &T) -> Result<Vec<u8>> {
    codec::encode(value).map_err(|message| Error::Damaged { path: PathBuf::from("results"), message })
}

impl TaskContents {
    /// Reads the table of a finished task, and compares its file with its checksum; `None` if there is none.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the file is not as it was written; [`Error::Io`] if it cannot be read.
    pub(super) fn read(path: &Path) -> Result<Option<Self>> {
        let damaged = |message: &str| Error::Damaged { path: path.to_owned(), message: message.to_owned() };
        let wrap = |e| Error::io(path, "read", e);
        let mut options = File::options();
        let mut file = match no_links(options.read(true)).open(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            opened => opened.map_err(|e| Error::io(path, "open", e))?,
        };
        let meta = file.metadata().map_err(wrap)?;
        let length = meta.len();
        if !meta.is_file() || length < HEADER_BYTES + 8 {
            return Err(damaged("it holds no results"));
        }
        let (mut header, mut last) = ([0; HEADER_BYTES as usize], [0; 8]);
        file.read_exact(&mut header).map_err(wrap)?;
        let header = Header::decode(&header).map_err(|message| damaged(&message))?;
        let rest = file.try_clone().map_err(wrap)?;
        let content = Content::pass(rest, |_| Ok::<(), io::Error>(())).map_err(wrap)?;
        if header.kind != KIND || header.checksum != content.hash {
            return Err(damaged("its checksum does not match"));
        }
        read_exact_at(&file, &mut last, length - 8).map_err(wrap)?;
        let bytes = u64::from_le_bytes(last);
        let start = (length - 8).checked_sub(bytes).filter(|&start| start >= HEADER_BYTES);
        let start = start.ok_or_else(|| damaged("its table of contents is not in it"))?;
        let mut table = vec![0; bytes as usize];
        read_exact_at(&file, &mut table, start).map_err(wrap)?;
        let contents: Self = codec::decode(&table).map_err(|message| damaged(&message))?;
        let is_inside = |frame: &ResultFrame| frame.offset.checked_add(frame.bytes).is_some_and(|end| end <= start);
        if !contents.frames.iter().all(is_inside) {
            return Err(damaged("a result is not in it"));
        }
        Ok(Some(contents))
    }
}

impl ResultFrame {
    /// Reads a result from the results of its task; its files lie in `folder`.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the result is not sound; [`Error::Io`] if the file cannot be read.
    pub(super) fn read<T: Recalled>(&self, path: &Path, folder: &Path, context: &T::Context<'_>) -> Result<T> {
        let damaged = |message: String| Error::Damaged { path: path.to_owned(), message };
        let wrap = |e| Error::io(path, "read", e);
        let mut options = File::options();
        let file = no_links(options.read(true)).open(path).map_err(wrap)?;
        let length = file.metadata().map_err(wrap)?.len();
        if self.offset.checked_add(self.bytes).is_none_or(|end| end > length) {
            return Err(damaged("a result is not in it".into()));
        }
        let mut bytes = vec![0; self.bytes as usize];
        read_exact_at(&file, &mut bytes, self.offset).map_err(wrap)?;
        let mut value: T = codec::decode(&bytes).map_err(damaged)?;
        value.locate(folder, context);
        if value.is_sound(context) { Ok(value) } else { Err(damaged("its content is inconsistent".into())) }
    }
}
