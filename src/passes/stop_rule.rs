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
    /// Simplify as far as these bounds on the deviation allow, one after the other, in units of length, or to the face
    /// count of each cluster.
    Deviation(Vec<f64>, TiVec<ClusterId, u64>),
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
    /// Simplify as far as these bounds on the deviation allow, one after the other, in units of length, or to this
    /// number of faces.
    Deviation(Vec<f64>, u64),
}

impl StopRule {
    /// How this cluster stops.
    pub(super) fn of(&self, cluster: ClusterId) -> ClusterStop {
        match self {
            StopRule::Shares(shares) => ClusterStop::Shares(shares.clone()),
            StopRule::Faces(shares, target) => ClusterStop::Faces(shares.clone(), *target),
            StopRule::Costs(costs) => ClusterStop::Costs(costs.clone(), 0),
            StopRule::Deviation(bounds, keep) => ClusterStop::Deviation(bounds.clone(), keep[cluster]),
            StopRule::Trim(costs, keep) => ClusterStop::Costs(costs.clone(), keep[cluster]),
        }
    }

    /// The same, but each cluster keeps this number of faces; `None` if it does not depend on costs or deviations.
    pub(super) fn keeping(&self, keep: TiVec<ClusterId, u64>) -> Option<Self> {
        match self {
            StopRule::Costs(costs) => Some(StopRule::Trim(costs.clone(), keep)),
            StopRule::Deviation(bounds, _) => Some(StopRule::Deviation(bounds.clone(), keep)),
            _ => None,
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
            ClusterStop::Costs(..) | ClusterStop::Deviation(..) => self.clone(),
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
            StopRule::Deviation(bounds, keep) => bounds.len() <= STAGES_MAX && keep.len() == *cluster_count,
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
        ClusterStop::Deviation(bounds, keep) => return run_bounded(engine, bounds, *keep as usize),
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
/// gains is used, as long as many faces go. At least `keep` faces stay.
fn run_bounded<M: Metric>(engine: &mut Engine<M>, bounds: &[f64], keep: usize) -> f32 {
    let Some((&last, before)) = bounds.split_last() else { return 0.0 };
    let first = Anchor::of(&engine.mesh);
    let mut highest = 0f32;
    for &most in before {
        engine.bound_deviation(most);
        highest = highest.max(run_stages(engine, 1.0 - BOUNDED_STAGE_KEEPS, keep));
    }
    engine.bound_deviation(last);
    highest = highest.max(run_stages(engine, BOUNDED_STAGE_SHARE, keep));
    let (mut before, mut most) = (first.face_count(), TIGHTENED_BELOW);
    for _ in 0..TIGHTENED_TIMES {
        let left = engine.mesh.face_count;
        if !is_at_most(left, most, before) || !first.tighten(&mut engine.mesh, last) {
            break;
        }
        highest = highest.max(run_stages(engine, BOUNDED_STAGE_SHARE, keep));
        (before, most) = (left, TIGHTENED_KEEPS);
    }
    highest
}

/// Runs stages while each removes more than the share `least` of the faces, down to `keep` faces; returns the highest
/// cost.
fn run_stages<M: Metric>(engine: &mut Engine<M>, least: f64, keep: usize) -> f32 {
    let mut highest = 0f32;
    loop {
        let before = engine.mesh.face_count;
        let goal = ((before as f64 * BOUNDED_STAGE_KEEPS) as usize).max(keep);
        highest = highest.max(engine.run(Stop::Cost(f32::INFINITY, goal)).cost);
        if is_at_most(before - engine.mesh.face_count, least, before) {
            return highest;
        }
    }
}

/// Simplifies a sample as far as these bounds on the deviation allow; returns the share of its free faces that is left.
pub(super) fn share_within<M: Metric>(engine: &mut Engine<M>, bounds: &[f64]) -> f64 {
    engine.mesh.link_wedges();
    let free = engine.count_free_faces().max(1);
    let before = engine.mesh.face_count;
    run_bounded(engine, bounds, 0);
    let removed = before.saturating_sub(engine.mesh.face_count);
    (1.0 - removed as f64 / free as f64).max(0.0)
}

/// Whether a number of faces is at most this share of another.
fn is_at_most(faces: usize, share: f64, others: usize) -> bool {
    faces as f64 <= others as f64 * share
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::cost::SurfaceCost;
    use crate::mesh::ClusterMesh;
    use crate::mesh::cluster::samples;

    #[test]
    fn a_cluster_stops_as_its_pass_does_and_in_a_trim_at_its_own_faces() {
        let of = |rule: StopRule| rule.of(ClusterId::new(1));
        assert_eq!(of(StopRule::Shares(vec![0.5, 0.25])), ClusterStop::Shares(vec![0.5, 0.25]));
        assert_eq!(of(StopRule::Faces(vec![0.5], 7)), ClusterStop::Faces(vec![0.5], 7));
        assert_eq!(of(StopRule::Costs(vec![1.0, 3.0])), ClusterStop::Costs(vec![1.0, 3.0], 0));
        assert_eq!(of(StopRule::Deviation(vec![0.5], vec![4, 9].into())), ClusterStop::Deviation(vec![0.5], 9));
        assert_eq!(of(StopRule::Trim(vec![2.0], vec![7, 8, 9].into())), ClusterStop::Costs(vec![2.0], 8));
        assert_eq!(StopRule::Costs(vec![1.0, 3.0, 2.0]).highest_cost(), Some(3.0));
        assert_eq!(StopRule::Trim(vec![2.0], vec![7].into()).highest_cost(), None);
    }

    proptest! {
        #[test]
        fn a_share_of_the_rest_is_as_many_faces_as_the_share_of_all(
            shares in prop::collection::vec(0.0..1.0f64, 1..5),
            before in 1usize..5_000,
            dropped in prop_oneof![Just(0.0), 0.0..=1.0, Just(1.0)],
        ) {
            let left = before - (before as f64 * dropped) as usize;
            let rest = ClusterStop::Shares(shares.clone()).of_rest(before, left);
            prop_assert_eq!(
                ClusterStop::Faces(shares.clone(), 9).of_rest(before, left),
                match &rest {
                    ClusterStop::Shares(shares) => ClusterStop::Faces(shares.clone(), 9),
                    other => panic!("{other:?}"),
                }
            );
            for other in [ClusterStop::Costs(vec![0.5], 9), ClusterStop::Deviation(shares.clone(), 0)] {
                prop_assert_eq!(other.of_rest(before, left), other);
            }
            if left == before {
                prop_assert_eq!(rest, ClusterStop::Shares(shares));
            } else if let ClusterStop::Shares(of_rest) = rest {
                let left = left.max(1) as f64;
                for (share, of_rest) in shares.iter().zip(of_rest) {
                    prop_assert!((of_rest * left - (share * before as f64).min(left)).abs() < 1e-6);
                }
            }
        }
    }

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
        for left in [0, 1] {
            assert_eq!(rest(ClusterStop::Shares(vec![0.00125]), left).0, [0.5], "as of one face");
        }
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
        assert_eq!(ends(&[0.5, 0.1, 0.05, 0.04, 0.03, 0.02]), 3);
    }

    #[test]
    fn the_engine_may_force_a_number_of_faces_alone() {
        let forces = |stop: ClusterStop| {
            let mut engine = Engine::<SurfaceCost>::new(samples::grid(6, 0.3), &Default::default());
            run_stages_to(&mut engine, &stop, Wanted::Mesh);
            engine.forces_target
        };
        assert!(forces(ClusterStop::Faces(vec![0.5, 0.3], 20)));
        let others =
            [ClusterStop::Shares(vec![0.5]), ClusterStop::Costs(vec![0.1], 0), ClusterStop::Deviation(vec![0.1], 0)];
        assert_eq!(others.map(forces), [false; 3]);
    }

    #[test]
    fn a_bound_on_the_way_says_what_goes_first_and_not_what_is_allowed() {
        let run = |bounds: &[f64]| {
            let mut engine = Engine::<SurfaceCost>::new(samples::grid(20, 0.3), &Default::default());
            assert!(run_stages_to(&mut engine, &ClusterStop::Deviation(bounds.to_vec(), 0), Wanted::Mesh) > 0.0);
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
        for (count, is_sound) in [(0, true), (1, true), (STAGES_MAX, true), (STAGES_MAX + 1, false)] {
            let (shares, costs) = (vec![0.5; count], vec![1.0; count]);
            let rules = [
                StopRule::Shares(shares.clone()),
                StopRule::Faces(shares.clone(), 7),
                StopRule::Costs(costs.clone()),
                StopRule::Deviation(shares, vec![7].into()),
                StopRule::Trim(costs, vec![7].into()),
            ];
            rules.iter().for_each(|rule| assert_eq!(rule.is_sound(&1), is_sound, "{rule:?}"));
        }
    }

    #[test]
    fn a_share_of_others_counts_up_to_the_last_face() {
        assert_eq!([4, 5, 6].map(|faces| is_at_most(faces, 0.5, 10)), [true, true, false]);
        assert!(is_at_most(0, 0.5, 0));
    }

    /// A mesh without two faces in one plane.
    fn rough(n: u32, bump: f64) -> ClusterMesh {
        let mut mesh = samples::grid(n, 0.0);
        for position in mesh.positions.iter_mut() {
            let [x, y] = [position.x, position.y];
            position.z = bump * ((x * x * 31.0 + y * y * 17.0 + x * y * 13.0) % 23.0) / 23.0;
        }
        mesh
    }

    /// Why deviations were recomputed no more often under a last bound.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
    enum Because {
        TooManyLeft,
        NothingToGain,
        Often,
    }

    /// What [`run_bounded`] does, with its numbers; tells how often deviations were recomputed, and why no more often where
    /// one more time would have gained something, or nothing.
    fn run_by_hand(engine: &mut Engine<SurfaceCost>, bounds: &[f64]) -> (usize, Because) {
        let first = Anchor::of(&engine.mesh);
        for (i, &bound) in bounds.iter().enumerate() {
            engine.bound_deviation(bound);
            run_stages(engine, if i + 1 < bounds.len() { 0.4 } else { 0.02 }, 0);
        }
        let last = bounds[bounds.len() - 1];
        let mut before = first.face_count() as f64 * 0.7;
        for times in 0..=2 {
            let left = engine.mesh.face_count as f64;
            let mut tightened = engine.mesh.clone();
            if !first.tighten(&mut tightened, last) {
                return (times, Because::NothingToGain);
            }
            if left > before {
                return (times, Because::TooManyLeft);
            }
            if times < 2 {
                engine.mesh = tightened;
                run_stages(engine, 0.02, 0);
                before = left * 0.9;
            }
        }
        (2, Because::Often)
    }

    #[test]
    fn deviations_are_recomputed_twice_at_most_and_only_where_many_faces_went() {
        let mut reasons = std::collections::BTreeSet::new();
        for mesh in [samples::grid(9, 0.3), samples::grid(20, 0.1), rough(8, 0.3), rough(8, 1.0)] {
            for last in [0.02, 0.05, 0.08, 0.1, 0.12, 0.15, 0.2, 0.3, 0.5, 0.8] {
                for bounds in [vec![last], vec![0.5 * last, last], vec![last, 1e-6]] {
                    let [mut engine, mut other] =
                        [(); 2].map(|()| Engine::<SurfaceCost>::new(mesh.clone(), &Default::default()));
                    let cost = run_bounded(&mut engine, &bounds, 0);
                    reasons.insert(run_by_hand(&mut other, &bounds));
                    assert_eq!(engine.milestones, other.milestones, "{bounds:?}");
                    assert_eq!(cost, engine.milestones.iter().fold(0.0, |most: f32, stage| most.max(stage.cost)));
                }
            }
        }
        let once_each =
            [(0, Because::TooManyLeft), (0, Because::NothingToGain), (1, Because::TooManyLeft), (2, Because::Often)];
        assert!(once_each.iter().all(|reason| reasons.contains(reason)), "{reasons:?}");
    }

    #[test]
    fn bounded_stages_remove_two_fifths_each_until_one_removes_little() {
        for (mesh, bound) in [(samples::grid(20, 0.1), 0.15), (samples::grid(9, 0.3), 0.5), (rough(12, 0.3), 0.2)] {
            for least in [0.02, 0.4] {
                let mut engine = Engine::<SurfaceCost>::new(mesh.clone(), &Default::default());
                let mut before = engine.mesh.face_count as f64;
                engine.bound_deviation(bound);
                run_stages(&mut engine, least, 0);
                let stage_count = engine.milestones.len();
                for (i, stage) in engine.milestones.iter().enumerate() {
                    let removed = before - stage.faces as f64;
                    assert!(removed < 0.4 * before + 3.0, "{removed} of {before}");
                    assert_eq!(removed <= least * before, i + 1 == stage_count, "{removed} of {before}");
                    before = stage.faces as f64;
                }
            }
        }
    }

    #[test]
    fn a_bound_yields_to_the_faces_that_are_to_stay() {
        let run = |keep| {
            let mut engine = Engine::<SurfaceCost>::new(samples::grid(20, 0.3), &Default::default());
            run_stages_to(&mut engine, &ClusterStop::Deviation(vec![0.15, 0.3], keep), Wanted::Mesh);
            engine.mesh.face_count as u64
        };
        let least = run(0);
        assert!(least < 300, "{least}");
        for keep in [least / 2, least, 400, 800] {
            let wanted = least.max(keep);
            assert!((wanted.saturating_sub(1)..=wanted).contains(&run(keep)), "{} of {keep}", run(keep));
        }
    }

    #[test]
    fn a_sample_tells_which_share_of_the_free_faces_a_bound_leaves() {
        let share = |bound: f64| {
            let mut engine = Engine::<SurfaceCost>::new(samples::grid(20, 0.3), &Default::default());
            let before = engine.mesh.face_count as f64;
            let share = share_within(&mut engine, &[bound]);
            let left = engine.mesh.face_count as f64 / before;
            assert!((share - left).abs() < 0.02, "{share}, {left} of all");
            share
        };
        assert_eq!(share(0.0), 1.0);
        assert!(share(0.3) < 0.4 && share(0.3) < share(0.1) && share(0.1) < 1.0);
        let mut nothing = Engine::<SurfaceCost>::new(ClusterMesh::default(), &Default::default());
        assert_eq!(share_within(&mut nothing, &[1.0]), 1.0);
    }

    #[test]
    fn rules_that_depend_on_costs_or_deviations_may_end_at_face_counts() {
        let keeping = |rule: StopRule| rule.keeping(vec![7].into()).map(|rule| rule.of(ClusterId::new(0)));
        assert_eq!(keeping(StopRule::Costs(vec![1.0])), Some(ClusterStop::Costs(vec![1.0], 7)));
        let within = StopRule::Deviation(vec![0.5], vec![0].into());
        assert_eq!(keeping(within), Some(ClusterStop::Deviation(vec![0.5], 7)));
        assert_eq!(keeping(StopRule::Shares(vec![0.5])), None);
        assert_eq!(keeping(StopRule::Faces(vec![0.5], 9)), None);
    }

    #[test]
    fn without_bounds_or_faces_nothing_happens() {
        let mut engine = Engine::<SurfaceCost>::new(samples::grid(6, 0.3), &Default::default());
        assert_eq!(run_stages_to(&mut engine, &ClusterStop::Deviation(Vec::new(), 0), Wanted::Mesh), 0.0);
        assert!(engine.milestones.is_empty());
        let mut engine = Engine::<SurfaceCost>::new(ClusterMesh::default(), &Default::default());
        assert_eq!(run_stages_to(&mut engine, &ClusterStop::Deviation(vec![0.1, 0.2], 0), Wanted::Mesh), 0.0);
    }
}
