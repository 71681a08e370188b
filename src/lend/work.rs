//! Does items for a job that another process coordinates.

use std::path::PathBuf;

use serde::Serialize;

use super::divide::LentItem;
use crate::base::id::Id;
use crate::base::ordered::map_within;
use crate::base::{Error, Progress, Result, WorkLimits};
use crate::file::codec;
use crate::job::Recalled;
use crate::job::stage::{Stage, StageTask, TaskWriter};
use crate::model::StoredPiece;
use crate::model::piece::PieceFile;
use crate::partition::PieceContent;

/// Memory of the tables of a stage, for each encoded byte.
const TABLES_GROWTH: u64 = 4;
/// Ending of the file of a task's pieces.
const PIECES: &str = "piece";

/// What an item becomes, as the process that lent it reads it.
pub trait LentResult: Serialize + Send {
    /// Adds the piece of the next mesh that the item became.
    fn add_piece(&mut self, piece: StoredPiece);

    /// Other files, in the folder of the stage.
    fn files(&self) -> Vec<PathBuf> {
        Vec::new()
    }
}

/// How the items of a stage are done.
pub struct LentWork<'a, I, T> {
    /// All items of the stage.
    pub items: Vec<LentItem<I>>,
    /// Whether items become pieces of the next mesh.
    pub has_pieces: bool,
    /// Memory of an item in bytes.
    pub bytes: &'a (dyn Fn(I) -> u64 + Sync),
    /// Does an item.
    pub work: &'a (dyn Fn(I) -> Result<(T, Option<PieceContent>)> + Sync),
}

impl<I: Id, T: LentResult> LentWork<'_, I, T> {
    /// Does the items of a task, and writes their results.
    ///
    /// # Errors
    /// On a full disk, failed reads and writes, and damaged files.
    pub fn run(&self, stage: &Stage, task: &StageTask, limits: WorkLimits, progress: &dyn Progress) -> Result<()> {
        let items = self.items.iter().copied().filter(|of| task.holds(of.item.number()));
        let mut results = TaskWriter::create(stage, task)?;
        let place = stage.file_of(task, PIECES);
        let path = stage.work().join(place.file_name().unwrap_or_default());
        let mut pieces = if self.has_pieces { Some(PieceFile::create(&place, path)?) } else { None };
        let work = |of: LentItem<I>| {
            progress.check_stopped()?;
            let (result, content) = (self.work)(of.item)?;
            Ok((of, result, content))
        };
        let mut files = Vec::new();
        let budget = limits.work_bytes.saturating_sub(TABLES_GROWTH * stage.details().len() as u64);
        map_within(
            budget,
            |of| (self.bytes)(of.item),
            items,
            work,
            |(of, mut result, content)| {
                if let (Some(content), Some(file)) = (content, &mut pieces) {
                    result.add_piece(content.put_in(file)?);
                }
                files.extend(result.files());
                progress.advance(of.size);
                results.put(of.item.number(), &result)
            },
        )?;
        if let Some(file) = pieces {
            file.seal()?.commit()?;
            files.push(place);
        }
        results.finish(files.iter().map(PathBuf::as_path))
    }
}

/// Decodes what a process needs to do tasks of a stage.
///
/// # Errors
/// [`Error::Damaged`] if the stage does not hold it; [`Error::Io`] if it names files that are not seen here as they are,
/// as on a network disk that shows new files late.
pub fn details_of<T: for<'a> Recalled<Context<'a> = ()>>(stage: &Stage) -> Result<T> {
    let damaged = |message: String| Error::Damaged { path: stage.path(), message };
    let mut details: T = codec::decode(stage.details()).map_err(damaged)?;
    details.locate(stage.work(), &());
    if details.is_sound(&()) {
        return Ok(details);
    }
    let late = std::io::Error::other("it names files that are missing here, or shorter than they should be");
    Err(Error::io(&stage.path(), "read", late))
}

/// Encodes what a process needs to do tasks of a stage.
///
/// # Errors
/// If it cannot be encoded.
pub fn encoded<T: Serialize>(details: &T) -> Result<Vec<u8>> {
    codec::encode(details).map_err(|message| Error::Damaged { path: PathBuf::from("stage"), message })
}
