//! Does clusters for a job that another process coordinates.

use std::path::PathBuf;

use serde::Serialize;

use crate::base::ordered::map_within;
use crate::base::{Error, Progress, Result, WorkLimits};
use crate::file::codec;
use crate::job::Recalled;
use crate::job::stage::{Stage, StageTask, TaskWriter};
use crate::model::StoredPiece;
use crate::model::piece::PieceFile;
use crate::partition::{ClusterId, Partition, PieceContent};

/// Memory of the tables of a stage, for each encoded byte.
const TABLES_GROWTH: u64 = 4;
/// Ending of the file of a task's pieces.
const PIECES: &str = "piece";

/// How the clusters of a stage are done.
pub struct LentWork<'a, T> {
    /// Their partition.
    pub partition: &'a Partition,
    /// Whether clusters become pieces of the next mesh.
    pub has_pieces: bool,
    /// Memory of a cluster in bytes.
    pub bytes: &'a (dyn Fn(ClusterId) -> u64 + Sync),
    /// Does a cluster.
    pub work: &'a (dyn Fn(ClusterId) -> Result<(T, Option<PieceContent>)> + Sync),
    /// Adds the piece of a cluster to its result.
    pub add: &'a dyn Fn(&mut T, StoredPiece),
    /// Other files of a result, in the folder of the stage.
    pub files: &'a dyn Fn(&T) -> Vec<PathBuf>,
}

impl<T: Serialize + Send> LentWork<'_, T> {
    /// Does the clusters of a task, and writes their results.
    ///
    /// # Errors
    /// On a full disk, failed reads and writes, and damaged files.
    pub fn run(&self, stage: &Stage, task: &StageTask, limits: WorkLimits, progress: &dyn Progress) -> Result<()> {
        let of_task = |cluster: &ClusterId| cluster.number().checked_sub(task.first).is_some_and(|i| i < task.count);
        let clusters = self.partition.loadable().filter(of_task);
        let mut results = TaskWriter::create(stage, task)?;
        let place = stage.file_of(task, PIECES);
        let path = stage.work().join(place.file_name().unwrap_or_default());
        let mut pieces = if self.has_pieces { Some(PieceFile::create_shared(&place, path)?) } else { None };
        let work = |cluster: ClusterId| {
            progress.check_stopped()?;
            let (result, content) = (self.work)(cluster)?;
            Ok((cluster, result, content))
        };
        let mut files = Vec::new();
        let budget = limits.work_bytes.saturating_sub(TABLES_GROWTH * stage.details().len() as u64);
        map_within(
            budget,
            |&cluster| (self.bytes)(cluster),
            clusters,
            work,
            |(cluster, mut result, content)| {
                if let (Some(content), Some(file)) = (content, &mut pieces) {
                    (self.add)(&mut result, content.put_in(file)?);
                }
                files.extend((self.files)(&result));
                progress.advance(self.partition.face_count(cluster));
                results.put(cluster.number(), &result)
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
/// [`Error::Damaged`] if the stage does not hold it.
pub fn details_of<T: for<'a> Recalled<Context<'a> = ()>>(stage: &Stage) -> Result<T> {
    let damaged = |message: String| Error::Damaged { path: stage.path(), message };
    let mut details: T = codec::decode(stage.details()).map_err(damaged)?;
    details.locate(stage.work(), &());
    if details.is_sound(&()) { Ok(details) } else { Err(damaged("its content is inconsistent".into())) }
}

/// Encodes what a process needs to do tasks of a stage.
///
/// # Errors
/// If it cannot be encoded.
pub fn encoded<T: Serialize>(details: &T) -> Result<Vec<u8>> {
    codec::encode(details).map_err(|message| Error::Damaged { path: PathBuf::from("stage"), message })
}
