//! The steps of the passes, by which a work folder knows them.

use super::pass_id::Pass;
use crate::job::{Step, StepKey};
use crate::read::SCAN;

/// Statistics of the whole mesh that the metric is normalised by, from the first partition.
pub const STATISTICS: StepKey = StepKey::fixed("pass-0-statistics");
/// Probes of the input, for measuring the result.
pub const PROBES: StepKey = StepKey::fixed("pass-0-probes");

/// A step of a pass; passes are numbered from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PassStep {
    /// The partition of the pass.
    Partition(u32),
    /// Where the clusters stop, in an attempt.
    Stops(u32, u32),
    /// A cluster (the last number) simplified to learn the costs of its collapses, in a trial.
    Trial(u32, u32, u32),
    /// A simplified cluster (the last number), in an attempt.
    Cluster(u32, u32, u32),
    /// The mesh after the pass.
    Mesh(u32),
}

impl PassStep {
    /// The partition of a pass.
    pub fn partition(pass: Pass) -> Self {
        Self::Partition(pass.number as u32)
    }

    /// Where the clusters of a pass stop, in an attempt.
    pub fn stops(pass: Pass, attempt: u32) -> Self {
        Self::Stops(pass.number as u32, attempt)
    }

    /// The mesh after a pass.
    pub fn mesh(pass: Pass) -> Self {
        Self::Mesh(pass.number as u32)
    }

    /// Key of the mesh after some passes.
    pub fn mesh_after(passes: usize) -> StepKey {
        match passes {
            0 => SCAN,
            _ => Self::Mesh(passes as u32 - 1).key(),
        }
    }

    /// Its key.
    pub fn key(self) -> StepKey {
        StepKey::numbered(match self {
            Self::Partition(pass) => format!("pass-{pass}-partition"),
            Self::Stops(pass, attempt) => format!("pass-{pass}-stops-{attempt}"),
            Self::Trial(pass, trial, cluster) => format!("pass-{pass}-trial-{trial}-{cluster:06}"),
            Self::Cluster(pass, attempt, cluster) => format!("pass-{pass}-cluster-{attempt}-{cluster:06}"),
            Self::Mesh(pass) => format!("pass-{pass}-mesh"),
        })
    }

    /// The step to record.
    pub fn to_record(self) -> Step {
        Step::new(self.key()).from([self.parent()])
    }

    /// The step that it is computed from.
    fn parent(self) -> StepKey {
        match self {
            Self::Partition(pass) => Self::mesh_after(pass as usize),
            Self::Stops(pass, _) | Self::Trial(pass, ..) | Self::Mesh(pass) => Self::Partition(pass).key(),
            Self::Cluster(pass, attempt, _) => Self::Stops(pass, attempt).key(),
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
            "partition" => Self::Partition(pass),
            "stops" => Self::Stops(pass, next()?),
            "trial" => Self::Trial(pass, next()?, next()?),
            "cluster" => Self::Cluster(pass, next()?, next()?),
            "mesh" => Self::Mesh(pass),
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
            PassStep::Partition(0),
            PassStep::Stops(1, 2),
            PassStep::Trial(3, 4, 1_234_567),
            PassStep::Cluster(u32::MAX, 0, 5),
            PassStep::Mesh(7),
        ];
        for step in steps {
            assert_eq!(PassStep::of(&step.key()), Some(step));
        }
        for name in ["pass-0-statistics", "pass-01-mesh", "pass-1-stops", "pass-1-mesh-2", "scan-mesh", "pass--mesh"] {
            assert_eq!(PassStep::of(&StepKey::fixed(name)), None, "{name}");
        }
    }
}
