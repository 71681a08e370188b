//! The steps of the passes, by which a work folder knows them.

use super::pass_id::Pass;
use crate::job::{Step, StepKey};
use crate::partition::ClusterId;
use crate::read::SCAN;

/// Statistics of the whole mesh that the metric is normalised by, from the first partition.
pub const STATISTICS: StepKey = StepKey::fixed("pass-0-statistics");
/// Probes of the input, for measuring the result.
pub const PROBES: StepKey = StepKey::fixed("pass-0-probes");

/// A step of a pass; passes are numbered from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PassStep {
    /// The partition of the pass.
    Partition { pass: u32 },
    /// Where the clusters stop, in an attempt.
    Stops { pass: u32, attempt: u32 },
    /// A cluster simplified to learn the costs of its collapses, in a trial.
    Trial { pass: u32, trial: u32, cluster: ClusterId },
    /// A simplified cluster, in an attempt.
    Cluster { pass: u32, attempt: u32, cluster: ClusterId },
    /// Clusters among some that one process simplified for such a trial.
    Trials { pass: u32, trial: u32, first: ClusterId, count: u32 },
    /// Clusters among some that one process simplified.
    Clusters { pass: u32, attempt: u32, first: ClusterId, count: u32 },
    /// The mesh after the pass.
    Mesh { pass: u32 },
}

impl PassStep {
    /// The partition of a pass.
    pub fn partition(pass: Pass) -> Self {
        Self::Partition { pass: pass.number as u32 }
    }

    /// Where the clusters of a pass stop, in an attempt.
    pub fn stops(pass: Pass, attempt: u32) -> Self {
        Self::Stops { pass: pass.number as u32, attempt }
    }

    /// The mesh after a pass.
    pub fn mesh(pass: Pass) -> Self {
        Self::Mesh { pass: pass.number as u32 }
    }

    /// Key of the mesh after some passes.
    pub fn mesh_after(passes: usize) -> StepKey {
        match passes {
            0 => SCAN,
            _ => Self::Mesh { pass: passes as u32 - 1 }.key(),
        }
    }

    /// Its key.
    pub fn key(self) -> StepKey {
        StepKey::numbered(match self {
            Self::Partition { pass } => format!("pass-{pass}-partition"),
            Self::Stops { pass, attempt } => format!("pass-{pass}-stops-{attempt}"),
            Self::Trial { pass, trial, cluster } => format!("pass-{pass}-trial-{trial}-{:06}", cluster.number()),
            Self::Cluster { pass, attempt, cluster } => {
                format!("pass-{pass}-cluster-{attempt}-{:06}", cluster.number())
            }
            Self::Trials { pass, trial, first, count } => {
                format!("{}-{:06}-{count}", Self::prefix_of_trials(pass, trial), first.number())
            }
            Self::Clusters { pass, attempt, first, count } => {
                format!("{}-{:06}-{count}", Self::prefix_of_clusters(pass, attempt), first.number())
            }
            Self::Mesh { pass } => format!("pass-{pass}-mesh"),
        })
    }

    /// What the keys of [`Trials`](Self::Trials) begin with.
    pub fn prefix_of_trials(pass: u32, trial: u32) -> String {
        format!("pass-{pass}-trials-{trial}")
    }

    /// What the keys of [`Clusters`](Self::Clusters) begin with.
    pub fn prefix_of_clusters(pass: u32, attempt: u32) -> String {
        format!("pass-{pass}-clusters-{attempt}")
    }

    /// The step to record.
    pub fn to_record(self) -> Step {
        Step::new(self.key()).from([self.parent()])
    }

    /// The step that it is computed from.
    fn parent(self) -> StepKey {
        match self {
            Self::Partition { pass } => Self::mesh_after(pass as usize),
            Self::Stops { pass, .. } | Self::Trial { pass, .. } | Self::Trials { pass, .. } | Self::Mesh { pass } => {
                Self::Partition { pass }.key()
            }
            Self::Cluster { pass, attempt, .. } | Self::Clusters { pass, attempt, .. } => {
                Self::Stops { pass, attempt }.key()
            }
        }
    }

    /// The step of a key; `None` if it is none of a pass.
    pub fn of(key: &StepKey) -> Option<Self> {
        let mut words = key.name().strip_prefix("pass-")?.split('-');
        let number = |word: Option<&str>| word?.parse::<u32>().ok();
        let pass = number(words.next())?;
        let kind = words.next()?;
        let mut next = || number(words.next());
        let step = match kind {
            "partition" => Self::Partition { pass },
            "stops" => Self::Stops { pass, attempt: next()? },
            "trial" => Self::Trial { pass, trial: next()?, cluster: ClusterId::new(next()?) },
            "cluster" => Self::Cluster { pass, attempt: next()?, cluster: ClusterId::new(next()?) },
            "trials" => Self::Trials { pass, trial: next()?, first: ClusterId::new(next()?), count: next()? },
            "clusters" => Self::Clusters { pass, attempt: next()?, first: ClusterId::new(next()?), count: next()? },
            "mesh" => Self::Mesh { pass },
            _ => return None,
        };
        (step.key() == *key).then_some(step)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_names_its_step() {
        let steps = [
            PassStep::Partition { pass: 0 },
            PassStep::Stops { pass: 1, attempt: 2 },
            PassStep::Trial { pass: 3, trial: 4, cluster: ClusterId::new(1_234_567) },
            PassStep::Cluster { pass: u32::MAX, attempt: 0, cluster: ClusterId::new(5) },
            PassStep::Trials { pass: 3, trial: 4, first: ClusterId::new(0), count: 9 },
            PassStep::Clusters { pass: 3, attempt: 1, first: ClusterId::new(1_234_567), count: 1 },
            PassStep::Mesh { pass: 7 },
        ];
        for step in steps {
            assert_eq!(PassStep::of(&step.key()), Some(step));
        }
        for name in ["pass-0-statistics", "pass-01-mesh", "pass-1-stops", "pass-1-mesh-2", "scan-mesh", "pass--mesh"] {
            assert_eq!(PassStep::of(&StepKey::fixed(name)), None, "{name}");
        }
    }
}
