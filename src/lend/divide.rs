//! Divides clusters among tasks, and has these done.

use super::lent::LentClusters;
use crate::base::{Progress, Result, Silent};
use crate::job::stage::{BUILD, Order, StageTask};
use crate::job::{StepKey, WorkFolder};
use crate::partition::{ClusterId, Partition};

/// Fewest clusters that are lent; with fewer, other processes would begin when this one is done.
const CLUSTERS_MIN: usize = 4;

/// Clusters to be lent.
pub struct Lendable<'a> {
    /// Kind of the stage.
    pub kind: &'static str,
    /// Their partition.
    pub partition: &'a Partition,
    /// What the keys begin with of the steps that record some clusters each; `-<first>-<count>` follows.
    pub prefix: String,
    /// The step that they are computed from.
    pub parent: StepKey,
    /// Computes the checksum of what the program makes of a small mesh; only where clusters are lent.
    pub arithmetic: &'a dyn Fn() -> u64,
    /// Whether the phase counts their faces.
    pub is_counted: bool,
}

impl Lendable<'_> {
    /// Divides clusters among at most `count` tasks.
    fn tasks(&self, clusters: &[ClusterId], count: usize) -> Vec<StageTask> {
        let of_range = |range: &[ClusterId]| {
            let (first, last) = (range[0], range[range.len() - 1]);
            let count = last.number() - first.number() + 1;
            let amount = range.iter().map(|&cluster| self.partition.face_count(cluster)).sum();
            let key = StepKey::numbered(format!("{}-{:06}-{count}", self.prefix, first.number()));
            StageTask { key, first: first.number(), count, amount }
        };
        divide(clusters, self.partition, count).into_iter().map(of_range).collect()
    }

    /// Whether a key is that of a task, however the clusters were divided.
    fn is_task(&self, key: &StepKey) -> bool {
        let rest = key.name().strip_prefix(&*self.prefix).and_then(|rest| rest.strip_prefix('-'));
        rest.is_some_and(|rest| rest.split('-').all(|number| number.parse::<u32>().is_ok()))
    }
}

/// Has clusters done by other processes, if the job has any; returns what they did, now or before. `details` is what they
/// need, encoded.
///
/// # Errors
/// Those of [`WorkFolder::lend`].
pub fn lend(
    job: &WorkFolder,
    what: &Lendable<'_>,
    details: impl FnOnce() -> Result<Vec<u8>>,
    progress: &dyn Progress,
) -> Result<LentClusters> {
    let mut lent = LentClusters::default();
    for key in job.latest().iter().filter(|key| what.is_task(key)) {
        job.recall_lent(key)?.into_iter().for_each(|task| lent.add(task, false));
    }
    let Some(lending) = job.lending() else { return Ok(lent) };
    let clusters: Vec<ClusterId> = what.partition.loadable().collect();
    if clusters.len() < CLUSTERS_MIN {
        return Ok(lent);
    }
    let order = Order {
        build: BUILD.to_owned(),
        arithmetic: (what.arithmetic)(),
        kind: what.kind.to_owned(),
        tasks: what.tasks(&clusters, lending.tasks as usize),
        details: details()?,
    };
    let is_missing = |task: &StageTask| {
        let of_task = task.first..task.first + task.count;
        clusters.iter().any(|&cluster| of_task.contains(&cluster.number()) && !lent.holds(cluster))
    };
    let quiet = Quiet(progress);
    let progress: &dyn Progress = if what.is_counted { progress } else { &quiet };
    for task in job.lend(lending, order, is_missing, &what.parent, progress)? {
        lent.add(task, true);
    }
    Ok(lent)
}

/// Divides clusters among at most `count` tasks, in order, with about the same number of faces in each.
fn divide<'a>(clusters: &'a [ClusterId], partition: &Partition, count: usize) -> Vec<&'a [ClusterId]> {
    let faces: Vec<u64> = clusters.iter().map(|&cluster| partition.face_count(cluster)).collect();
    let all = faces.iter().sum::<u64>().max(1);
    let count = count.clamp(1, clusters.len().max(1)) as u64;
    let mut before = 0;
    let task_of = |&faces: &u64| {
        // By the middle of the cluster.
        let task = (u128::from(2 * before + faces) * u128::from(count) / u128::from(2 * all)) as u64;
        before += faces;
        task
    };
    let tasks: Vec<u64> = faces.iter().map(task_of).collect();
    let mut begin = 0;
    let ranges = tasks.chunk_by(|a, b| a == b).map(|chunk| {
        begin += chunk.len();
        &clusters[begin - chunk.len()..begin]
    });
    ranges.collect()
}

/// Progress of work that the phase does not count.
struct Quiet<'a>(&'a dyn Progress);

impl Progress for Quiet<'_> {
    fn begin(&self, phase: &'static str, total: u64, unit: &'static str) {
        Silent.begin(phase, total, unit);
    }

    fn tell(&self, message: &str) {
        self.0.tell(message);
    }

    fn is_stopped(&self) -> bool {
        self.0.is_stopped()
    }

    fn advance(&self, _units: u64) {}
}
