//! How the clusters of a pass stop, and the stages that follow from it.

use serde::{Deserialize, Serialize};

use super::sample;
use super::shares::STAGES_MAX;
use crate::base::id::TiVec;
use crate::cost::Metric;
use crate::job::Recalled;
use crate::partition::ClusterId;
use crate::simplify::{Anchor, Engine, Stop};

/// With a bounded error: smallest share of its faces that a stage keeps.
const BOUNDED_STAGE_KEEPS: f64 = 0.6;
/// With a bounded error: stages end when one removes at most this share of the faces.
const BOUNDED_STAGE_SHARE: f64 = 0.02;
/// Deviations are recomputed once at most this share of the first faces is left; with more left, accumulated bounds are
/// still tight.
const TIGHTENED_BELOW: f64 = 0.7;
/// Largest number of times that deviations are recomputed.
const TIGHTENED_TIMES: usize = 2;
/// They are recomputed again only if at most this share of the faces was left since the time before.
const TIGHTENED_KEEPS: f64 = 0.9;

/// Whether a cluster is simplified for its mesh, or for the log of its collapses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wanted {
    /// The mesh.
    Mesh,
    /// The log.
    Log,
}

/// How the clusters of a pass stop.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) enum StopRule {
    /// One cluster: keep these shares of the free faces at the end of each stage.
    Shares(Vec<f64>),
    /// One cluster: keep these shares of the faces, except that the last stage leaves exactly this number.
    Faces(Vec<f64>, u64),
    /// Stop each stage at a cost threshold.
    Costs(Vec<f32>),
    /// Simplify as far as these bounds on the deviation allow, one after the other, in units of length.
    Deviation(Vec<f64>),
    /// Stop at cost thresholds, or at the face count of each cluster.
    Trim(Vec<f32>, TiVec<ClusterId, u64>),
}

/// How one cluster stops.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) enum ClusterStop {
    /// Keep these shares of the free faces at the end of each stage.
    Shares(Vec<f64>),
    /// Keep these shares of the faces, except that the last stage leaves exactly this number.
    Faces(Vec<f64>, u64),
    /// Stop each stage at a cost threshold, or at this number of faces.
    Costs(Vec<f32>, u64),
    /// Simplify as far as these bounds on the deviation allow, one after the other, in units of length.
    Deviation(Vec<f64>),
}

impl StopRule {
    /// How this cluster stops.
    pub(super) fn of(&self, cluster: ClusterId) -> ClusterStop {
        match self {
            StopRule::Shares(shares) => ClusterStop::Shares(shares.clone()),
            StopRule::Faces(shares, target) => ClusterStop::Faces(shares.clone(), *target),
            StopRule::Costs(costs) => ClusterStop::Costs(costs.clone(), 0),
            StopRule::Deviation(bounds) => ClusterStop::Deviation(bounds.clone()),
            StopRule::Trim(costs, keep) => ClusterStop::Costs(costs.clone(), keep[cluster]),
        }
    }

    /// Highest cost threshold; `None` if clusters stop at anything else.
    pub(super) fn highest_cost(&self) -> Option<f32> {
        match self {
            StopRule::Costs(costs) => costs.iter().copied().reduce(f32::max),
            _ => None,
        }
    }
}

impl ClusterStop {
    /// How a cluster of `before` faces stops that has lost all but `left` of them before it is simplified: its shares
    /// stay those of the faces that it had.
    pub(super) fn of_rest(&self, before: usize, left: usize) -> Self {
        let of_left = |shares: &[f64]| -> Vec<f64> {
            shares.iter().map(|share| (share * before as f64 / left.max(1) as f64).min(1.0)).collect()
        };
        match self {
            _ if left == before => self.clone(),
            ClusterStop::Shares(shares) => ClusterStop::Shares(of_left(shares)),
            ClusterStop::Faces(shares, target) => ClusterStop::Faces(of_left(shares), *target),
            ClusterStop::Costs(..) | ClusterStop::Deviation(_) => self.clone(),
        }
    }
}

impl Recalled for StopRule {
    /// Number of clusters.
    type Context<'a> = usize;

    fn is_sound(&self, cluster_count: &usize) -> bool {
        match self {
            StopRule::Shares(shares) | StopRule::Faces(shares, _) => shares.len() <= STAGES_MAX,
            StopRule::Costs(costs) => costs.len() <= STAGES_MAX,
            StopRule::Deviation(bounds) => bounds.len() <= STAGES_MAX,
            StopRule::Trim(costs, keep) => costs.len() <= STAGES_MAX && keep.len() == *cluster_count,
        }
    }
}

/// Runs the stages up to the stop. Returns the cost of the last stage that collapsed an edge, or 0 if none did; with
/// bounds on the deviation, the highest cost of all stages. If the log is wanted, every collapse of the last stage is
/// logged. In the last stage to a number of faces, the engine may force the target. After a stage that misses its
/// goal, only the last one follows.
pub(super) fn run_stages_to<M: Metric>(engine: &mut Engine<M>, stop: &ClusterStop, wanted: Wanted) -> f32 {
    let faces = engine.mesh.face_count;
    let stages: Vec<Stop> = match stop {
        ClusterStop::Deviation(bounds) => return run_bounded(engine, bounds),
        ClusterStop::Costs(costs, keep) => costs.iter().map(|&cost| Stop::Cost(cost, *keep as usize)).collect(),
        ClusterStop::Shares(shares) => {
            let free = engine.count_free_faces();
            shares.iter().map(|share| Stop::Faces(sample::face_goal(faces, free, *share))).collect()
        }
        ClusterStop::Faces(shares, target) => {
            let before = &shares[..shares.len().saturating_sub(1)];
            let goal = |share: &f64| ((faces as f64 * share).round() as usize).max(*target as usize);
            before.iter().map(|share| Stop::Faces(goal(share))).chain([Stop::Faces(*target as usize)]).collect()
        }
    };
    let mut cost = 0.0;
    let mut is_stuck = false;
    for (i, &stage) in stages.iter().enumerate() {
        let is_last = i + 1 == stages.len();
        // What was refused up to a stage's goal is refused beyond it.
        if is_stuck && !is_last {
            continue;
        }
        if wanted == Wanted::Log && is_last {
            engine.log = Some(Vec::new());
        }
        engine.forces_target = is_last && matches!(stop, ClusterStop::Faces(..));
        let result = engine.run(stage);
        cost = if result.cost > 0.0 { result.cost } else { cost };
        is_stuck = !result.reached;
    }
    cost
}

/// Runs stages under each bound on the deviation in turn; returns the highest cost. An earlier bound yields to the next
/// once a stage cannot remove all that it may. Under the last bound, deviations are recomputed and the slack that this
/// gains is used, as long as many faces go.
fn run_bounded<M: Metric>(engine: &mut Engine<M>, bounds: &[f64]) -> f32 {
    let Some((&last, before)) = bounds.split_last() else { return 0.0 };
    let first = Anchor::of(&engine.mesh);
    let mut highest = 0f32;
    for &most in before {
        engine.bound_deviation(most);
        highest = highest.max(run_stages(engine, 1.0 - BOUNDED_STAGE_KEEPS));
    }
    engine.bound_deviation(last);
    highest = highest.max(run_stages(engine, BOUNDED_STAGE_SHARE));
    let mut most_left = first.face_count() as f64 * TIGHTENED_BELOW;
    for _ in 0..TIGHTENED_TIMES {
        let left = engine.mesh.face_count as f64;
        if left > most_left || !first.tighten(&mut engine.mesh, last) {
            break;
        }
        highest = highest.max(run_stages(engine, BOUNDED_STAGE_SHARE));
        most_left = left * TIGHTENED_KEEPS;
    }
    highest
}

/// Runs stages while each removes more than the share `least` of the faces; returns the highest cost.
fn run_stages<M: Metric>(engine: &mut Engine<M>, least: f64) -> f32 {
    let mut highest = 0f32;
    loop {
        let before = engine.mesh.face_count;
        let goal = (before as f64 * BOUNDED_STAGE_KEEPS) as usize;
        highest = highest.max(engine.run(Stop::Cost(f32::INFINITY, goal)).cost);
        if (before - engine.mesh.face_count) as f64 <= before as f64 * least {
            return highest;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cost::SurfaceCost;
    use crate::mesh::cluster::samples;

    #[test]
    fn shares_are_of_the_faces_before_pieces_were_dropped() {
        let rest = |stop: ClusterStop, left| match stop.of_rest(400, left) {
            ClusterStop::Shares(shares) => (shares, 0),
            ClusterStop::Faces(shares, target) => (shares, target),
            other => panic!("{other:?}"),
        };
        assert_eq!(rest(ClusterStop::Shares(vec![0.75, 0.5]), 400).0, [0.75, 0.5]);
        assert_eq!(rest(ClusterStop::Shares(vec![0.75, 0.25]), 200).0, [1.0, 0.5]);
        assert_eq!(rest(ClusterStop::Faces(vec![0.5, 0.25], 90), 200), (vec![1.0, 0.5], 90));
    }

    #[test]
    fn a_plan_tells_what_its_last_stage_that_did_anything_cost() {
        let run = |costs: &[f32]| {
            let mut engine = Engine::<SurfaceCost>::new(samples::grid(12, 0.3), &Default::default());
            let faces = engine.mesh.face_count;
            let cost = run_stages_to(&mut engine, &ClusterStop::Costs(costs.to_vec(), 0), Wanted::Mesh);
            (cost, faces - engine.mesh.face_count)
        };
        let (early, some) = run(&[0.01]);
        assert!(early > 0.0 && early <= 0.01 && some > 0);
        let (late, more) = run(&[0.01, 0.1]);
        assert!(late > early && late <= 0.1 && more > some);
        assert_eq!(run(&[0.01, 1e-9]), (early, some));
        assert_eq!(run(&[1e-20]), (0.0, 0));
    }

    #[test]
    fn faces_are_reached_stage_by_stage_and_the_last_ones_exactly() {
        let run = |stop: ClusterStop, wanted| {
            let mut engine = Engine::<SurfaceCost>::new(samples::grid(12, 0.3), &Default::default());
            run_stages_to(&mut engine, &stop, wanted);
            let ends: Vec<usize> = engine.milestones.iter().map(|stage| stage.faces).collect();
            (ends, engine.log)
        };
        let is_near = |faces: usize, goal: usize| faces <= goal && faces + 2 > goal;
        let (ends, log) = run(ClusterStop::Faces(vec![0.5, 0.2], 40), Wanted::Mesh);
        assert!(ends.len() == 2 && is_near(ends[0], 144) && is_near(ends[1], 40), "{ends:?}");
        assert!(log.is_none());
        // The log of a trial covers all of its last stage.
        let (ends, log) = run(ClusterStop::Faces(vec![0.5, 0.2], 40), Wanted::Log);
        let log = log.unwrap();
        assert!((ends[0] - 3..ends[0]).contains(&(log[0].faces as usize)), "{log:?}");
        assert_eq!(log.last().unwrap().faces as usize, ends[1]);
        // Earlier stages do not go below the target.
        let (ends, _) = run(ClusterStop::Faces(vec![0.1, 0.2], 100), Wanted::Mesh);
        assert!(ends.len() == 1 && is_near(ends[0], 100), "{ends:?}");
        let (ends, _) = run(ClusterStop::Costs(vec![f32::MAX], 100), Wanted::Mesh);
        assert!(ends.len() == 1 && is_near(ends[0], 100), "{ends:?}");
        let (ends, _) = run(ClusterStop::Shares(vec![0.5]), Wanted::Mesh);
        assert!(ends.len() == 1 && is_near(ends[0], 144), "{ends:?}");
    }

    #[test]
    fn after_a_missed_goal_only_the_last_stage_follows() {
        let ends = |shares: &[f64]| {
            let mut engine = Engine::<SurfaceCost>::new(samples::grid(12, 0.3), &Default::default());
            engine.lock_borders = true;
            run_stages_to(&mut engine, &ClusterStop::Faces(shares.to_vec(), 2), Wanted::Mesh);
            engine.milestones.len()
        };
        // The border has 48 edges.
        assert_eq!(ends(&[0.5, 0.4, 0.3, 0.2]), 4);
        assert_eq!(ends(&[0.5, 0.1, 0.05, 0.02]), 3);
    }

    #[test]
    fn a_bound_on_the_way_says_what_goes_first_and_not_what_is_allowed() {
        let run = |bounds: &[f64]| {
            let mut engine = Engine::<SurfaceCost>::new(samples::grid(20, 0.3), &Default::default());
            assert!(run_stages_to(&mut engine, &ClusterStop::Deviation(bounds.to_vec()), Wanted::Mesh) > 0.0);
            let mesh = engine.finish();
            (mesh.corners.len(), mesh.deviations.iter().fold(0.0, |most: f64, &own| most.max(own.into())))
        };
        let [direct, half, by_half] = [&[0.2][..], &[0.1], &[0.1, 0.2]].map(run);
        assert!(half.1 <= 0.1 && half.0 > direct.0.max(by_half.0), "{direct:?} {half:?} {by_half:?}");
        assert!(by_half.1 > 0.1 && by_half.1 <= 0.2 && direct.1 <= 0.2);
        assert_ne!(by_half, direct);
    }

    #[test]
    fn a_plan_for_other_clusters_or_with_endless_stages_is_not_sound() {
        assert!(StopRule::Trim(vec![1.0], vec![7; 3].into()).is_sound(&3));
        assert!(!StopRule::Trim(vec![1.0], vec![7; 3].into()).is_sound(&4));
        assert!(StopRule::Costs(vec![1.0; STAGES_MAX]).is_sound(&1));
        assert!(!StopRule::Costs(vec![1.0; STAGES_MAX + 1]).is_sound(&1));
        assert!(!StopRule::Faces(vec![0.5; STAGES_MAX + 1], 7).is_sound(&1));
    }
}
