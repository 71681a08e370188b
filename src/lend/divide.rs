//! Divides items among tasks, and has these done.

use super::lent::LentResults;
use crate::base::id::Id;
use crate::base::{Progress, Result};
use crate::job::stage::{BUILD, Order, StageTask};
use crate::job::{StepKey, WorkFolder};
use crate::partition::{ClusterId, Partition};

/// Fewest items that are lent; with fewer, other processes would begin when this one is done.
pub const ITEMS_MIN: usize = 4;

/// What one process does at a time, and the size of the work in units of the phase.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LentItem<I> {
    /// What it is done to.
    pub item: I,
    /// The size.
    pub size: u64,
}

impl LentItem<ClusterId> {
    /// The clusters of a partition that other processes can do, by their faces.
    pub fn clusters_of(partition: &Partition) -> Vec<Self> {
        Self::among(partition, partition.clusters())
    }

    /// Those among some clusters of a partition that other processes can do, by their faces.
    pub fn among(partition: &Partition, clusters: impl IntoIterator<Item = ClusterId>) -> Vec<Self> {
        let loadable = clusters.into_iter().filter(|&cluster| partition.is_loadable(cluster));
        loadable.map(|item| Self { item, size: partition.face_count(item) }).collect()
    }
}

/// Items to be lent.
pub struct Lendable<'a, I> {
    /// Kind of the stage.
    pub kind: &'static str,
    /// The items, ascending.
    pub items: Vec<LentItem<I>>,
    /// What the keys begin with of the steps that record some items each; `-<first>-<count>` follows.
    pub prefix: String,
    /// The step that they are computed from, if there is one.
    pub parent: Option<StepKey>,
    /// Computes the checksum of what the program makes of a small mesh; only where items are lent.
    pub arithmetic: &'a dyn Fn() -> Result<u64>,
    /// Whether the phase counts their sizes.
    pub is_counted: bool,
    /// Whether files that they become are read whole before they are taken: those that may hold colours, whose blocks
    /// have no checksums.
    pub is_read_whole: bool,
}

impl<I: Id> Lendable<'_, I> {
    /// Divides the items among at most `count` tasks.
    fn tasks(&self, count: usize) -> Vec<StageTask> {
        let of_range = |range: &[LentItem<I>]| {
            let (first, last) = (range[0].item.number(), range[range.len() - 1].item.number());
            let count = last - first + 1;
            let key = StepKey::numbered(format!("{}-{first:06}-{count}", self.prefix));
            StageTask { key, first, count, amount: range.iter().map(|item| item.size).sum() }
        };
        divide(&self.items, count).into_iter().map(of_range).collect()
    }

    /// Whether a key is that of a task, however the items were divided.
    fn is_task(&self, key: &StepKey) -> bool {
        let rest = key.name().strip_prefix(&*self.prefix).and_then(|rest| rest.strip_prefix('-'));
        rest.is_some_and(|rest| rest.split('-').all(|number| number.parse::<u32>().is_ok()))
    }
}

/// Has items done by other processes, if the job has any; returns what they did, now or before. `details` is what they
/// need, encoded.
///
/// # Errors
/// Those of [`WorkFolder::lend`].
pub fn lend<I: Id>(
    job: &WorkFolder,
    what: &Lendable<'_, I>,
    details: impl FnOnce() -> Result<Vec<u8>>,
    progress: &dyn Progress,
) -> Result<LentResults<I>> {
    let mut lent = LentResults::default();
    for key in job.latest().iter().filter(|key| what.is_task(key)) {
        job.recall_lent(key)?.into_iter().for_each(|task| lent.add(task, false));
    }
    let Some(lending) = job.lending() else { return Ok(lent) };
    if what.items.len() < ITEMS_MIN {
        return Ok(lent);
    }
    let order = Order {
        build: BUILD.to_owned(),
        arithmetic: (what.arithmetic)()?,
        kind: what.kind.to_owned(),
        tasks: what.tasks(lending.tasks as usize),
        is_read_whole: what.is_read_whole,
        details: details()?,
    };
    let is_missing =
        |task: &StageTask| what.items.iter().any(|of| task.holds(of.item.number()) && !lent.holds(of.item));
    let uncounted = Uncounted(progress);
    let progress: &dyn Progress = if what.is_counted { progress } else { &uncounted };
    for task in job.lend(lending, order, is_missing, what.parent.as_ref(), progress)? {
        lent.add(task, true);
    }
    Ok(lent)
}

/// Divides items among at most `count` tasks, in order, with about the same size of work in each.
fn divide<I>(items: &[LentItem<I>], count: usize) -> Vec<&[LentItem<I>]> {
    let all = items.iter().map(|item| item.size).sum::<u64>().max(1);
    let count = count.clamp(1, items.len().max(1)) as u64;
    let mut before = 0;
    let task_of = |item: &LentItem<I>| {
        // By the middle of the item.
        let task = (u128::from(2 * before + item.size) * u128::from(count) / u128::from(2 * all)) as u64;
        before += item.size;
        task
    };
    let tasks: Vec<u64> = items.iter().map(task_of).collect();
    let mut begin = 0;
    let ranges = tasks.chunk_by(|a, b| a == b).map(|chunk| {
        begin += chunk.len();
        &items[begin - chunk.len()..begin]
    });
    ranges.collect()
}

/// Progress of work that the phase does not count.
pub struct Uncounted<'a>(pub &'a dyn Progress);

impl Progress for Uncounted<'_> {
    fn begin(&self, _phase: &'static str, _total: u64, _unit: &'static str) {}

    fn tell(&self, message: &str) {
        self.0.tell(message);
    }

    fn is_stopped(&self) -> bool {
        self.0.is_stopped()
    }

    fn advance(&self, _units: u64) {}
}
