//! What other processes did.

use std::collections::HashMap;
use std::path::Path;

use crate::base::Result;
use crate::base::id::Id;
use crate::job::Recalled;
use crate::job::stage::LentTask;

/// Results of the items that other processes did.
#[derive(Debug)]
pub struct LentResults<I> {
    tasks: Vec<LentTask>,
    /// Task that did each item, and whether the progress knows of it.
    places: HashMap<I, LentPlace>,
}

impl<I> Default for LentResults<I> {
    fn default() -> Self {
        Self { tasks: Vec::new(), places: HashMap::new() }
    }
}

#[derive(Debug, Clone, Copy)]
struct LentPlace {
    task: usize,
    is_told: bool,
}

impl<I: Id> LentResults<I> {
    pub(super) fn add(&mut self, task: LentTask, is_told: bool) {
        let place = LentPlace { task: self.tasks.len(), is_told };
        self.places.extend(task.items().map(|item| (I::new(item), place)));
        self.tasks.push(task);
    }

    /// The result of an item, and whether the progress knows of it; `None` if no other process did it. `work` is the
    /// work folder.
    ///
    /// # Errors
    /// [`Error::Damaged`](crate::base::Error::Damaged) if it is not sound.
    pub fn result<T: Recalled>(&self, work: &Path, item: I, context: &T::Context<'_>) -> Result<Option<(T, bool)>> {
        let Some(LentPlace { task, is_told }) = self.places.get(&item).copied() else { return Ok(None) };
        Ok(Some((self.tasks[task].read(work, item.number(), context)?, is_told)))
    }

    /// Removes the files of the results, once each is recorded in another way; on a best-effort basis.
    pub fn remove(&self, work: &Path) {
        self.tasks.iter().for_each(|task| task.remove(work));
    }

    /// Whether another process did an item.
    pub fn holds(&self, item: I) -> bool {
        self.places.contains_key(&item)
    }
}
