//! What other processes did of a partition.

use std::collections::HashMap;
use std::path::Path;

use crate::base::Result;
use crate::job::Recalled;
use crate::job::stage::LentTask;
use crate::partition::ClusterId;

/// Results of the clusters that other processes did.
#[derive(Debug, Default)]
pub struct LentClusters {
    tasks: Vec<LentTask>,
    /// Task that did each cluster, and whether the progress knows of it.
    places: HashMap<ClusterId, LentPlace>,
}

#[derive(Debug, Clone, Copy)]
struct LentPlace {
    task: usize,
    is_told: bool,
}

impl LentClusters {
    pub(super) fn add(&mut self, task: LentTask, is_told: bool) {
        let place = LentPlace { task: self.tasks.len(), is_told };
        self.places.extend(task.items().map(|item| (ClusterId::new(item), place)));
        self.tasks.push(task);
    }

    /// The result of a cluster, and whether the progress knows of it; `None` if no other process did it. `work` is the
    /// work folder.
    ///
    /// # Errors
    /// [`Error::Damaged`](crate::base::Error::Damaged) if it is not sound.
    pub fn result<T: Recalled>(
        &self,
        work: &Path,
        cluster: ClusterId,
        context: &T::Context<'_>,
    ) -> Result<Option<(T, bool)>> {
        let Some(LentPlace { task, is_told }) = self.places.get(&cluster).copied() else { return Ok(None) };
        Ok(Some((self.tasks[task].read(work, cluster.number(), context)?, is_told)))
    }

    /// Whether another process did a cluster.
    pub(super) fn holds(&self, cluster: ClusterId) -> bool {
        self.places.contains_key(&cluster)
    }
}
