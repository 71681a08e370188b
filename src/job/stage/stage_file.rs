//! The file of a stage: what any process needs to do its tasks.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use super::folder::{STAGE_FILE, folder_name, remove_folder};
use crate::base::error::escape_path;
use crate::base::{Error, Result, counted};
use crate::file::header::{FORMAT_VERSION, HEADER_BYTES, Header};
use crate::file::{RecordFile, codec};
use crate::job::names::is_phase_file;
use crate::job::step::StepKey;
use crate::os::durable::{make_folders, no_links};

/// This program, with a checksum of its sources; another one might write other bytes.
pub const BUILD: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("DRYSTONE_BUILD"), ")");
const KIND: [u8; 8] = *b"stage   ";

/// A task of a stage: what is done to some items in succession.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct StageTask {
    /// The step that records it; the name of its results is the key's name.
    pub key: StepKey,
    /// Number of its first item.
    pub first: u32,
    /// How many there are.
    pub count: u32,
    /// Size of the work, in the units of the phase.
    pub amount: u64,
}

impl StageTask {
    /// Whether an item is one of those of the task.
    pub fn holds(&self, item: u32) -> bool {
        item.checked_sub(self.first).is_some_and(|place| place < self.count)
    }
}

/// What a stage is made from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Order {
    /// The program that wrote it; another one might write other bytes.
    pub build: String,
    /// Checksum of what the program makes of a small mesh; another processor might make something else.
    pub arithmetic: u64,
    /// What is done, for the phase that does it.
    pub kind: String,
    /// The tasks.
    pub tasks: Vec<StageTask>,
    /// Whether files of results are read whole before they are taken, since they hold blocks without checksums.
    pub is_read_whole: bool,
    /// What the phase needs to do any of them, encoded.
    pub details: Vec<u8>,
}

/// A stage in a work folder.
#[derive(Debug, Clone)]
pub struct Stage {
    folder: PathBuf,
    id: u64,
    order: Order,
}

impl Stage {
    /// Writes a stage to the work folder `work`, or finds it there, with the results that it has by now.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub(super) fn place(work: &Path, order: Order) -> Result<Self> {
        let bytes = codec::encode(&order).map_err(|message| Error::Damaged { path: work.to_owned(), message })?;
        let id = xxh3_64(&bytes);
        let folder = work.join(folder_name(id));
        let stage = Self { folder, id, order };
        if Self::open(&stage.path()).is_ok_and(|found| found.is_some_and(|found| found.order == stage.order)) {
            return Ok(stage);
        }
        remove_folder(&stage.folder);
        make_folders(&stage.folder)?;
        let mut file = RecordFile::create(&stage.path())?;
        file.put(&bytes)?;
        file.finish(KIND, 0, stage.order.tasks.len() as u64)?;
        Ok(stage)
    }

    /// Opens a stage for a process that does a task of it; `None` if it is over, so that its folder is gone.
    ///
    /// # Errors
    /// [`Error::Changed`] if a program with another format wrote it, [`Error::Damaged`] if it is no stage or not as it
    /// was written, [`Error::Io`] if it cannot be read.
    pub fn open(path: &Path) -> Result<Option<Self>> {
        let damaged = |message: String| Error::Damaged { path: path.to_owned(), message };
        let mut options = File::options();
        let mut file = match no_links(options.read(true)).open(path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            opened => opened.map_err(|e| Error::io(path, "open", e))?,
        };
        let wrap = |e| Error::io(path, "read", e);
        if !file.metadata().map_err(wrap)?.is_file() {
            return Err(damaged("it is not a file".into()));
        }
        let mut header = [0; HEADER_BYTES as usize];
        let mut bytes = Vec::new();
        if file.read_exact(&mut header).is_err() {
            return Err(damaged("it is not a stage".into()));
        }
        if let Some(version) = Header::version(&header).filter(|&version| version != FORMAT_VERSION) {
            let words = format!("its format is version {version}, this program's is {FORMAT_VERSION}");
            let message = format!("{}: made by another drystone: {words}", escape_path(path));
            return Err(Error::Changed(message));
        }
        let header = Header::decode(&header).map_err(damaged)?;
        file.read_to_end(&mut bytes).map_err(wrap)?;
        if header.kind != KIND {
            return Err(damaged("it is not a stage".into()));
        }
        if header.checksum != xxh3_64(&bytes) {
            return Err(damaged("its checksum does not match".into()));
        }
        let order: Order = codec::decode(&bytes).map_err(damaged)?;
        let is_named =
            |task: &StageTask| is_phase_file(&task.key.file_name()) && !task.key.name().contains(['/', '\\']);
        if !order.tasks.iter().all(is_named) {
            return Err(damaged("a task has a name that no task has".into()));
        }
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        Ok(Some(Self { folder, id: header.checksum, order }))
    }

    /// Path of its file.
    pub fn path(&self) -> PathBuf {
        self.folder.join(STAGE_FILE)
    }

    /// Number that no stage with other content has.
    pub fn id(&self) -> u64 {
        self.id
    }

    /// The work folder.
    pub fn work(&self) -> &Path {
        self.folder.parent().unwrap_or(Path::new(""))
    }

    /// The program that made it.
    pub fn build(&self) -> &str {
        &self.order.build
    }

    /// Refuses to do tasks where another checksum comes of the same small surface than where the stage was made.
    ///
    /// # Errors
    /// [`Error::Changed`].
    pub fn check_arithmetic(&self, own: u64) -> Result<()> {
        if own == self.order.arithmetic {
            return Ok(());
        }
        let words = "this machine computes other results than the one that began the job";
        Err(Error::Changed(format!("{}: {words}", escape_path(&self.path()))))
    }

    /// What is done.
    pub fn kind(&self) -> &str {
        &self.order.kind
    }

    /// Its tasks.
    pub fn tasks(&self) -> &[StageTask] {
        &self.order.tasks
    }

    /// Whether files of results are read whole before they are taken.
    pub(super) fn is_read_whole(&self) -> bool {
        self.order.is_read_whole
    }

    /// What the phase needs, encoded.
    pub fn details(&self) -> &[u8] {
        &self.order.details
    }

    /// The task of a number.
    ///
    /// # Errors
    /// [`Error::Usage`] if there is none.
    pub fn task(&self, index: usize) -> Result<&StageTask> {
        let tasks = counted(self.order.tasks.len() as u64, "task");
        let none = || Error::Usage(format!("{}: has {tasks}, none numbered {index}", escape_path(&self.path())));
        self.order.tasks.get(index).ok_or_else(none)
    }

    /// Path in the stage's folder of a file of a task.
    pub fn file_of(&self, task: &StageTask, ending: &str) -> PathBuf {
        self.folder.join(format!("{}.{ending}", task.key.name()))
    }

    /// Whether the stage is still there, as this process opened it.
    pub fn is_under_way(&self) -> bool {
        let bytes = fs::read(self.path()).unwrap_or_default();
        bytes.get(HEADER_BYTES as usize..).is_some_and(|content| xxh3_64(content) == self.id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_that_computes_something_else_is_refused() {
        let work = tempfile::tempdir().unwrap();
        let task = StageTask {
            key: StepKey::numbered("pass-0-clusters-0-000000-1".to_owned()),
            first: 0,
            count: 1,
            amount: 1,
        };
        let order = Order {
            build: BUILD.to_owned(),
            arithmetic: 7,
            kind: "sweep".to_owned(),
            tasks: vec![task],
            is_read_whole: false,
            details: Vec::new(),
        };
        let stage = Stage::place(work.path(), order).unwrap();
        let read = Stage::open(&stage.path()).unwrap().unwrap();
        assert!(read.check_arithmetic(7).is_ok());
        assert!(matches!(read.check_arithmetic(8), Err(Error::Changed(_))));
    }
}
