//! Steps of a job: their keys, and the records of finished ones.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use super::stamp::Stamp;

/// Name of a step, unique in its job, such as `pass-1-cluster-0-000017`. The names of its own files begin with it.
///
/// The phases choose the keys of their steps; a work folder knows none of them.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct StepKey(Cow<'static, str>);

impl StepKey {
    /// A key that is known in advance.
    pub const fn fixed(name: &'static str) -> Self {
        Self(Cow::Borrowed(name))
    }

    /// A key of several of a kind.
    pub fn numbered(name: String) -> Self {
        Self(Cow::Owned(name))
    }

    /// Prefix of the names of the step's own files.
    pub fn name(&self) -> &str {
        &self.0
    }

    /// Name of the file for a large value of the step.
    pub fn file_name(&self) -> String {
        format!("{}.state", self.0)
    }
}

/// A finished step that is to be recorded.
#[derive(Debug, Clone)]
pub struct Step {
    pub(super) key: StepKey,
    pub(super) parents: Vec<StepKey>,
    pub(super) amount: u64,
    pub(super) outlasts: bool,
}

impl Step {
    /// A step that depends on nothing but the manifest.
    pub fn new(key: StepKey) -> Self {
        Self { key, parents: Vec::new(), amount: 0, outlasts: false }
    }

    /// The steps that it was computed from: its record counts only as long as theirs do.
    pub fn from(self, parents: impl IntoIterator<Item = StepKey>) -> Self {
        Self { parents: parents.into_iter().collect(), ..self }
    }

    /// Size of its result, for `drystone status`: triangles of the input or of a pass, clusters of a partition, faces of
    /// a cluster.
    pub fn of_size(self, amount: u64) -> Self {
        Self { amount, ..self }
    }

    /// Its value names files outside of the work folder, so it is kept if the job starts over.
    pub fn that_outlasts(self) -> Self {
        Self { outlasts: true, ..self }
    }
}

/// Record of a finished step.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StepRecord {
    /// The step.
    pub key: StepKey,
    /// Number of the record; later ones have larger numbers.
    pub(super) id: u64,
    /// Ids of the records that it was computed from.
    pub(super) parents: Vec<u64>,
    /// Size of its result, for `drystone status`.
    pub amount: u64,
    /// Time in seconds since 1970.
    pub time: u64,
    /// Whether it is kept if the job starts over.
    pub(super) outlasts: bool,
    /// Its files, and those of other steps that it refers to.
    pub(super) files: Vec<Stamp>,
    pub(super) value: Value,
}

impl StepRecord {
    /// Names of all its files.
    pub(super) fn names(&self) -> impl Iterator<Item = String> {
        let own = self.files.iter().map(|stamp| stamp.name().to_owned());
        own.chain([self.key.file_name()])
    }
}

/// Where the value of a step is stored.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) enum Value {
    Here(Vec<u8>),
    InFile(Stamp),
}
