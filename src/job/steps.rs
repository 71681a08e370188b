//! Which recorded steps count.
//!
//! ```text
//! scan ──▶ pass-0-partition ──▶ pass-0-stops-0 ──▶ pass-0-cluster-0-000017
//!                    ╰────────▶ pass-0-mesh ──▶ pass-1-partition ──▶ …
//! ```
//! A record has an id and the ids of its parents, the records that it was computed from. A record counts if it is the
//! last one of its step and all its parents count. So if a step is computed again, all that was computed from it is
//! void. Files are kept for the steps that are wanted; those of others may be gone.

use std::collections::{HashMap, HashSet};

use super::journal::Entry;
use super::step::{StepKey, StepRecord};

/// Id that no record has: what was computed from a step that is not recorded never counts.
const UNRECORDED: u64 = u64::MAX;

/// What is known of the recorded steps.
#[derive(Debug, Default)]
pub(super) struct RecordedSteps {
    known: HashMap<StepKey, LastRecord>,
    /// Ids of the records that count.
    valid: HashSet<u64>,
    /// Ids of records that others were computed from.
    parents: HashSet<u64>,
    wanted: WantedRecords,
    next_id: u64,
}

/// The last record of a step.
#[derive(Debug)]
struct LastRecord {
    record: StepRecord,
    /// Whether an earlier process recorded it, so that its value can be recalled.
    is_earlier: bool,
}

/// The records whose files are kept.
#[derive(Debug, Default)]
struct WantedRecords {
    /// All from this id on.
    from: u64,
    /// Those before it.
    earlier: HashSet<u64>,
}

impl WantedRecords {
    fn contains(&self, id: u64) -> bool {
        id >= self.from || self.earlier.contains(&id)
    }

    /// Of the records before `from`, only these are wanted any more.
    fn narrow(&mut self, from: u64, ids: &[u64]) {
        let earlier = ids.iter().copied().filter(|&id| id < from && self.contains(id)).collect();
        *self = Self { from: self.from.max(from), earlier };
    }
}

impl RecordedSteps {
    /// The steps that the entries of a journal record.
    pub(super) fn replay(entries: Vec<Entry>) -> Self {
        let mut steps = Self::default();
        for entry in entries {
            match entry {
                Entry::Kept(record) => {
                    steps.next_id = steps.next_id.max(record.id.saturating_add(1));
                    steps.parents.extend(&record.parents);
                    steps.known.insert(record.key.clone(), LastRecord { record, is_earlier: true });
                }
                Entry::Wanted { from, ids } => steps.wanted.narrow(from, &ids),
                Entry::Began { .. } | Entry::Failed { .. } => {}
            }
        }
        steps.validate(|_| true);
        steps
    }

    /// Those whose values are kept if the job starts over.
    pub(super) fn outlasting(mut self) -> Self {
        self.known.retain(|_, known| known.record.outlasts);
        Self { wanted: WantedRecords::default(), ..self }
    }

    /// Whether there are none.
    pub(super) fn is_empty(&self) -> bool {
        self.known.is_empty()
    }

    /// All records.
    pub(super) fn records(&self) -> impl Iterator<Item = &StepRecord> {
        self.known.values().map(|known| &known.record)
    }

    /// The record of a step that an earlier process finished, if it counts.
    pub(super) fn recall(&self, key: &StepKey) -> Option<&StepRecord> {
        let known = self.known.get(key)?;
        (known.is_earlier && self.valid.contains(&known.record.id)).then_some(&known.record)
    }

    /// Steps that an earlier process finished and that count, latest first.
    pub(super) fn latest(&self) -> Vec<StepKey> {
        let counts = |known: &&LastRecord| known.is_earlier && self.valid.contains(&known.record.id);
        let mut records: Vec<&StepRecord> = self.known.values().filter(counts).map(|known| &known.record).collect();
        records.sort_unstable_by_key(|record| std::cmp::Reverse(record.id));
        records.into_iter().map(|record| record.key.clone()).collect()
    }

    /// Whether the files of a record may be gone, since it is no longer wanted.
    pub(super) fn may_be_gone(&self, id: u64) -> bool {
        !self.wanted.contains(id)
    }

    /// Takes the next id.
    pub(super) fn take_id(&mut self) -> u64 {
        self.next_id = self.next_id.saturating_add(1);
        self.next_id - 1
    }

    /// Ids of the last records of some steps; [`UNRECORDED`] for a step without any.
    pub(super) fn ids_of(&self, keys: &[StepKey]) -> Vec<u64> {
        keys.iter().map(|key| self.known.get(key).map_or(UNRECORDED, |known| known.record.id)).collect()
    }

    /// Adds the record of a step that this process finished, whose value is not needed; an earlier one of the step is void.
    pub(super) fn add(&mut self, record: StepRecord) {
        let (id, parents) = (record.id, record.parents.clone());
        let before = self.known.insert(record.key.clone(), LastRecord { record, is_earlier: false });
        if let Some(LastRecord { record: StepRecord { id: void, .. }, .. }) = before
            && self.valid.remove(&void)
            && self.parents.contains(&void)
        {
            let valid = std::mem::take(&mut self.valid);
            self.validate(|id| valid.contains(&id));
        }
        if parents.iter().all(|parent| self.valid.contains(parent)) {
            self.valid.insert(id);
        }
        self.parents.extend(parents);
    }

    /// Determines which of the records that `may` count do so.
    fn validate(&mut self, may: impl Fn(u64) -> bool) {
        let mut records: Vec<&StepRecord> = self.records().filter(|record| may(record.id)).collect();
        // A parent is recorded before its children.
        records.sort_unstable_by_key(|record| record.id);
        let mut valid = HashSet::with_capacity(records.len());
        for record in records {
            if record.parents.iter().all(|parent| valid.contains(parent)) {
                valid.insert(record.id);
            }
        }
        self.valid = valid;
    }

    /// From now on only some of the steps so far are wanted. Returns the entry that says so.
    pub(super) fn want_only(&mut self, keys: &[StepKey]) -> Entry {
        let (from, ids) = (self.next_id, self.ids_of(keys));
        self.wanted.narrow(from, &ids);
        self.known.retain(|_, known| known.is_earlier || ids.contains(&known.record.id));
        Entry::Wanted { from, ids }
    }

    /// Names of the files of some steps.
    pub(super) fn names_of(&self, keys: &[StepKey]) -> HashSet<String> {
        keys.iter().filter_map(|key| self.known.get(key)).flat_map(|known| known.record.names()).collect()
    }

    /// Names of the files of all records that count, or of all that do not.
    pub(super) fn names(&self, count: bool) -> HashSet<String> {
        let records = self.records().filter(|record| self.valid.contains(&record.id) == count);
        records.flat_map(StepRecord::names).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::step::Value;
    use super::*;

    const SCAN: StepKey = StepKey::fixed("scan");
    const CUT: StepKey = StepKey::fixed("cut");
    const PIECE: StepKey = StepKey::fixed("piece");

    fn record(key: StepKey, id: u64, parents: &[u64]) -> StepRecord {
        let (parents, value) = (parents.to_vec(), Value::Here(vec![1]));
        StepRecord { key, id, parents, amount: 0, time: 0, outlasts: false, files: Vec::new(), value }
    }

    fn kept(key: StepKey, id: u64, parents: &[u64]) -> Entry {
        Entry::Kept(record(key, id, parents))
    }

    fn chain() -> Vec<Entry> {
        vec![kept(SCAN, 0, &[]), kept(CUT, 1, &[0]), kept(PIECE, 2, &[1])]
    }

    #[test]
    fn a_step_that_is_computed_again_makes_all_void_that_was_computed_from_it() {
        let mut steps = RecordedSteps::replay(chain());
        assert_eq!(steps.latest(), [PIECE, CUT, SCAN]);
        let again = record(CUT, steps.take_id(), &steps.ids_of(&[SCAN]));
        steps.add(again.clone());
        assert_eq!(steps.latest(), [SCAN], "this process need not recall its own steps");
        assert!(steps.names(false).contains("piece.state"));
        // Another process finds the same in the journal.
        let entries = [chain(), vec![Entry::Kept(again)]].concat();
        assert_eq!(RecordedSteps::replay(entries).latest(), [CUT, SCAN]);
    }

    #[test]
    fn a_step_whose_parent_is_recorded_later_counts_and_one_whose_parent_is_lost_does_not() {
        let [scan, cut, piece] = chain().try_into().unwrap();
        assert_eq!(RecordedSteps::replay(vec![scan.clone(), piece.clone(), cut]).latest(), [PIECE, CUT, SCAN]);
        let mut lost = RecordedSteps::replay(vec![scan, piece]);
        assert_eq!(lost.latest(), [SCAN]);
        assert_eq!(lost.take_id(), 3, "the id of the lost record is not given again");
    }

    #[test]
    fn what_is_not_wanted_may_be_gone_and_what_comes_after_may_not() {
        let mut steps = RecordedSteps::replay(chain());
        let wanted = steps.want_only(&[CUT]);
        let later = record(PIECE, steps.take_id(), &[1]);
        steps.add(later.clone());
        let entries = [chain(), vec![Entry::Kept(later), wanted]].concat();
        for steps in [steps, RecordedSteps::replay(entries)] {
            assert_eq!([0, 1, 2, 3].map(|id| steps.may_be_gone(id)), [true, false, true, false]);
        }
    }

    #[test]
    fn records_that_name_each_other_do_not_count() {
        let entries = vec![kept(SCAN, 1, &[2]), kept(CUT, 2, &[1]), kept(PIECE, UNRECORDED, &[UNRECORDED])];
        let mut steps = RecordedSteps::replay(entries);
        assert!(steps.latest().is_empty());
        assert!([steps.take_id(), steps.take_id()].iter().all(|&id| id >= u64::MAX - 1));
    }
}
