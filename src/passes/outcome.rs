//! Results of the passes, and why they may have stopped above the target.

use std::time::Duration;

use super::floor::Floor;
use super::pass_id::Pass;
use super::probes::Probes;
use super::sample::rise;
use crate::base::Findings;
use crate::job::StepKey;
use crate::model::StoredMesh;
use crate::simplify::Changes;
use crate::simplify::Milestone;

/// Result of one pass.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub struct PassReport {
    /// Number of clusters with faces.
    pub clusters: u64,
    /// Faces before.
    pub faces_in: u64,
    /// Faces after.
    pub faces_out: u64,
    /// Highest cost of a collapse, in area × length².
    pub threshold: f64,
    /// Vertices shared by several clusters; they were locked.
    pub border_vertices: u64,
    /// Vertices on seams.
    pub seam_vertices: u64,
    /// Clusters seen from above, as a PNG; `None` if no map was asked for.
    #[serde(skip)]
    pub map: Option<Vec<u8>>,
    /// Each stage of the pass, without those of the sample.
    pub stages: Vec<StageReport>,
}

/// Result of one remeshing pass with centroidal Voronoi cells.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub struct RemeshReport {
    /// Number of clusters with faces.
    pub clusters: u64,
    /// Faces before.
    pub faces_in: u64,
    /// Faces after.
    pub faces_out: u64,
    /// Cells wanted.
    pub wanted: u64,
    /// D_avg: mass of a cell.
    pub cell_mass: f64,
    /// Collapse error above which edges were split, in area × length²; infinite if none was split.
    pub threshold: f64,
    /// Cells grown.
    pub cells: u64,
    /// Fixed vertices, each a cell of its own.
    pub held: u64,
    /// Centres added by the queue.
    pub added: u64,
    /// Junctions of cells that became vertices.
    pub junctions: u64,
    /// Vertices kept because no legal collapse merges them into their centre.
    pub kept: u64,
    /// Faces of clusters that passed through.
    pub passed_through: u64,
}

/// State of all clusters together at the end of a stage.
#[derive(Debug, Clone, Copy, Default, serde::Serialize, serde::Deserialize)]
pub struct StageReport {
    /// Faces left.
    pub faces: u64,
    /// Highest cost of a collapse, in area × length².
    pub threshold: f64,
    /// Estimated root mean squared deviation from the input, in units of length.
    pub rms_estimate: f64,
}

impl PassReport {
    /// State at the end of its last stage.
    pub(super) fn end(&self) -> StageReport {
        StageReport { faces: self.faces_out, threshold: self.threshold, rms_estimate: 0.0 }
    }
}

/// Smallest factor between the costs of two stages that counts as a leap.
const LEAP_MIN: f64 = 64.0;
/// On most meshes costs rise by at most this power of the reduction in faces.
const USUAL_RISE: f64 = 8.0;

/// Result of all passes.
#[derive(Debug)]
pub struct Passes {
    /// Step that recorded the mesh.
    pub step: StepKey,
    /// The simplified mesh.
    pub mesh: StoredMesh,
    /// Each remeshing pass.
    pub remeshed: Vec<RemeshReport>,
    /// Each pass that collapsed edges.
    pub reports: Vec<PassReport>,
    /// What was repaired.
    pub findings: Findings,
    /// Time by phase.
    pub seconds: PassSeconds,
    /// Probes of the input, for measuring the result.
    pub probes: Probes,
    /// Predicted share of the result's vertices that lie on seams; `None` if it was not measured.
    pub seam_density: Option<f64>,
    /// Faces of the mesh.
    pub faces: u64,
    /// Changes of topology.
    pub changes: Changes,
    /// Whether the target was met.
    pub reached: bool,
    /// What prevented further collapses.
    pub floor: Floor,
    /// Largest size of the work folder, in bytes.
    pub scratch_peak: u64,
    /// Largest memory granted to clusters at once, in bytes.
    pub permit_peak: u64,
}

/// Time by phase.
#[derive(Debug, Clone, Copy, Default, serde::Serialize, serde::Deserialize)]
pub struct PassSeconds {
    /// Partitioning.
    pub partition: Duration,
    /// Remeshing.
    pub remesh: Duration,
    /// Simplifying in the first pass.
    pub simplify: Duration,
    /// Simplifying in the passes after it.
    pub stitch: Duration,
}

impl PassSeconds {
    /// Adds time of a pass that collapses edges.
    pub(super) fn add(&mut self, pass: Pass, time: Duration) {
        let phase = if pass.is_first_turn() { &mut self.simplify } else { &mut self.stitch };
        *phase += time;
    }

    /// Reports whether the times are small enough to add to, for a recalled value.
    pub(super) fn is_sound(&self) -> bool {
        [self.partition, self.remesh, self.simplify, self.stitch]
            .iter()
            .all(|time| time.as_secs() <= u64::from(u32::MAX))
    }
}

/// Sums over the clusters of a pass, stage by stage.
#[derive(Debug, Default)]
pub(super) struct StageSums {
    /// One before the first stage, then one after each.
    sums: Vec<StageSum>,
    area: f64,
}

#[derive(Debug, Clone, Copy, Default)]
struct StageSum {
    faces: u64,
    cost: f32,
    /// Squared error × area.
    error: f64,
}

impl StageSums {
    /// Adds a cluster that began with `faces` faces. In stages that it did not run, it counts with its last state.
    pub(super) fn add(&mut self, faces: u64, area: f64, milestones: &[Milestone]) {
        let after = |m: &Milestone| StageSum { faces: m.faces as u64, cost: m.cost, error: m.squared_error * area };
        let mut stages = std::iter::once(StageSum { faces, cost: 0.0, error: 0.0 }).chain(milestones.iter().map(after));
        let last = self.sums.last().map_or(StageSum::default(), |last| StageSum { cost: 0.0, ..*last });
        self.sums.resize(self.sums.len().max(milestones.len() + 1), last);
        let mut current = StageSum::default();
        for sum in &mut self.sums {
            current = stages.next().unwrap_or(StageSum { cost: 0.0, ..current });
            sum.faces += current.faces;
            sum.cost = sum.cost.max(current.cost);
            sum.error += current.error;
        }
        self.area += area;
    }

    /// Returns the stages; `squared_error` is the mean squared deviation of the earlier passes, in units of length
    /// squared.
    pub(super) fn reports(&self, squared_error: f64) -> Vec<StageReport> {
        let report = |sum: &StageSum| StageReport {
            faces: sum.faces,
            threshold: f64::from(sum.cost),
            rms_estimate: (squared_error + if self.area > 0.0 { sum.error / self.area } else { 0.0 }).sqrt(),
        };
        self.sums.iter().skip(1).map(report).collect()
    }
}

/// Returns the cost thresholds of the stages: the measured costs up to the first leap, and the cost to be expected
/// there for the rest. `None` if costs never leap. `before` is the end of the previous pass. Costs up to `least` are
/// not compared.
pub(super) fn before_leap(before: Option<StageReport>, stages: &[StageReport], least: f64) -> Option<Vec<f32>> {
    let skipped = usize::from(before.is_some());
    let stages: Vec<StageReport> = before.into_iter().chain(stages.iter().copied()).collect();
    let leaps = |pair: &[StageReport]| {
        let expected = pair[0].threshold * rise(pair[0].faces, pair[1].faces, USUAL_RISE);
        (pair[0].threshold > least && pair[1].threshold > expected.max(LEAP_MIN * pair[0].threshold))
            .then_some(expected)
    };
    let (at, expected) = stages.windows(2).enumerate().find_map(|(at, pair)| leaps(pair).map(|cost| (at, cost)))?;
    let cost_of = |stage: usize| if stage <= at { stages[stage].threshold } else { expected };
    Some((skipped..stages.len()).map(|stage| cost_of(stage) as f32).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn costs_that_leap_are_cut_off_there() {
        let stage = |faces, threshold| StageReport { faces, threshold, rms_estimate: 0.0 };
        let stages = [stage(20_000, 25.0), stage(18_000, 2e5), stage(17_900, 1e5)];
        let costs = before_leap(None, &stages, 0.1).unwrap();
        assert!(costs[0] == 25.0 && (50.0..100.0).contains(&costs[1]) && costs[1] == costs[2]);
        assert_eq!(before_leap(None, &stages[..1], 0.1), None);
        assert_eq!(before_leap(None, &[stage(20_000, 25.0), stage(10_000, 200.0)], 0.1), None);
        assert_eq!(before_leap(None, &stages, 30.0), None);
        let costs = before_leap(Some(stage(22_000, 20.0)), &stages[1..], 0.1).unwrap();
        assert!((20.0..150.0).contains(&costs[0]) && costs[0] == costs[1]);
    }

    #[test]
    fn a_cluster_with_fewer_stages_counts_as_it_stayed() {
        let milestone = |faces, cost| Milestone { faces, cost, squared_error: f64::from(cost) };
        let mut sums = StageSums::default();
        sums.add(10, 1.0, &[milestone(8, 1.0)]);
        sums.add(20, 3.0, &[milestone(15, 2.0), milestone(10, 4.0)]);
        sums.add(5, 0.0, &[]);
        let reports = sums.reports(0.0);
        assert_eq!(reports.iter().map(|stage| stage.faces).collect::<Vec<_>>(), [8 + 15 + 5, 8 + 10 + 5]);
        assert_eq!(reports.iter().map(|stage| stage.threshold).collect::<Vec<_>>(), [2.0, 4.0]);
        assert_eq!(reports[1].rms_estimate, ((1.0 * 1.0 + 3.0 * 4.0) / 4.0f64).sqrt());
    }
}
