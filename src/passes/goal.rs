//! Computes what the clusters of a pass must reach together, from the target, the bound and the schedule alone.

use serde::{Deserialize, Serialize};

use super::sample::Purpose;
use super::shares::{TRIM_SHARE, TRIM_SHARE_MAX, pass_target, stage_shares};
use super::stop_rule::StopRule;

/// Share of the allowed error that collapses may use; the rest covers rounding of the positions.
const BOUND_SAFETY: f64 = 0.98;
/// Extra passes that stop at sampled thresholds. If they end far above the target, the sample does not tell what its
/// faces cost, and the next passes trim, however many faces have to go.
const EXTRA_SAMPLED: usize = 8;

/// What the clusters of a pass must reach together.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Goal {
    /// Keep the deviation below this bound, in units of length.
    Deviation(f64),
    /// Reach the target to the face. The sampled threshold is the one for this share of the faces.
    Trim(f64),
    /// Keep these shares of the faces at the end of each stage.
    Stages(Vec<f64>),
}

/// Aim of all passes. A turn is the index, from 0, of a pass among those that collapse edges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Aim {
    /// Faces wanted; 0 for as few as the bound allows.
    pub target: u64,
    /// Faces of the input.
    pub input: u64,
    /// Planned passes; extra passes aim at the target, too.
    pub passes: usize,
    /// Largest deviation in units of length; `None` if it is unbounded.
    pub bound: Option<f64>,
    /// Which of the two says where a pass ends.
    pub lead: Lead,
}

/// Which of the target and the bound says where a pass ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub(super) enum Lead {
    /// The target.
    #[default]
    Target,
    /// The bound.
    Bound,
    /// The bound, of which the first pass uses half. With few faces left, the borders of its clusters, which are
    /// locked, have a large share of them; the next pass needs the other half to remove those.
    BoundFromHalf,
}

impl Aim {
    /// Reports whether a pass aims at the target itself.
    pub fn is_last(self, turn: usize) -> bool {
        match self.lead {
            Lead::Target => turn + 1 >= self.passes,
            Lead::Bound => true,
            Lead::BoundFromHalf => turn > 0,
        }
    }

    /// Deviation allowed in a pass, in units of length; `None` if it is unbounded.
    pub fn bound_of(self, turn: usize) -> Option<f64> {
        let share = if turn == 0 && self.lead == Lead::BoundFromHalf { 0.5 } else { 1.0 };
        Some(self.bound? * BOUND_SAFETY * share)
    }

    /// Number of faces that a pass aims to leave.
    pub fn faces_after(self, turn: usize) -> f64 {
        pass_target(self.input, self.target, turn, self.passes)
    }

    /// Returns what a pass over `faces` faces must reach.
    pub fn goal(self, turn: usize, faces: u64) -> Goal {
        if self.lead != Lead::Target
            && let Some(most) = self.bound_of(turn)
        {
            return Goal::Deviation(most);
        }
        let (all, target) = (faces.max(1) as f64, self.target as f64);
        if !self.is_last(turn) {
            return Goal::Stages(self.stages(self.faces_after(turn) / all, turn));
        }
        if faces as f64 <= target * (1.0 + TRIM_SHARE_MAX) || turn >= self.passes + EXTRA_SAMPLED {
            let excess = faces.saturating_sub(self.target) as f64;
            return Goal::Trim((target - (2.0 * excess).min(TRIM_SHARE_MAX * target)).max(1.0) / all);
        }
        Goal::Stages(self.stages(target / all * (1.0 + TRIM_SHARE), turn))
    }

    /// Returns how a single cluster of `faces` faces stops; the last pass ends at the target to the face.
    pub fn in_one_cluster(self, turn: usize, faces: u64) -> StopRule {
        let faces = faces.max(1) as f64;
        if self.is_last(turn) {
            return StopRule::Faces(self.stages(self.target as f64 / faces, turn), self.target);
        }
        StopRule::Shares(self.stages(self.faces_after(turn) / faces, turn))
    }

    /// Returns how a pass over `clusters` clusters with the deviation bound `most` stops. The first pass spends half of
    /// the bound before it uses the rest, so that the cheapest collapses come first. A single cluster ends at the
    /// target at the latest.
    pub fn within(self, most: f64, turn: usize, clusters: usize) -> StopRule {
        let keep = vec![if clusters == 1 { self.target } else { 0 }; clusters];
        StopRule::Deviation(if turn == 0 { half_first(most) } else { vec![most] }, keep.into())
    }

    /// Faces above which a pass that is stopped by face count leaves the rest to the trim.
    pub fn before_trim(self) -> u64 {
        (self.target as f64 * (1.0 + 0.5 * TRIM_SHARE)).ceil() as u64
    }

    /// Returns what the sample for a pass over about `faces` faces is for.
    pub fn purpose(self, turn: usize, faces: f64) -> Purpose {
        let left = if self.target > 0 { self.target as f64 / faces.max(1.0) } else { 1.0 };
        Purpose { left, is_last: self.is_last(turn) }
    }

    fn stages(self, share: f64, turn: usize) -> Vec<f64> {
        stage_shares(share, turn, self.passes)
    }
}

/// Half of a bound, then all of it.
pub(super) fn half_first(most: f64) -> Vec<f64> {
    vec![0.5 * most, most]
}

#[cfg(test)]
mod tests {
    use super::*;

    const AIM: Aim = Aim { target: 1000, input: 10_000, passes: 3, bound: None, lead: Lead::Target };

    /// The share at the end of the last stage of a goal.
    fn share(goal: Goal) -> f64 {
        match goal {
            Goal::Stages(shares) => *shares.last().unwrap(),
            other => panic!("{other:?}"),
        }
    }

    fn is_near(one: f64, other: f64) -> bool {
        (one - other).abs() < 1e-12
    }

    #[test]
    fn the_last_of_the_passes_wanted_and_all_beyond_it_aim_at_the_target() {
        assert_eq!([0, 1, 2, 3].map(|turn| AIM.is_last(turn)), [false, false, true, true]);
        assert!(is_near(share(AIM.goal(0, 10_000)), 0.4) && is_near(share(AIM.goal(1, 4000)), 0.5));
        for turn in [2, 3] {
            assert!(is_near(share(AIM.goal(turn, 2000)), 0.53), "the trim removes the rest");
        }
        assert_eq!(AIM.goal(0, 0), AIM.goal(0, 1));
    }

    #[test]
    fn a_trim_takes_over_near_the_target_and_is_foreseen_for_twice_what_is_left() {
        assert_eq!(AIM.goal(2, 1010), Goal::Trim(980.0 / 1010.0));
        assert_eq!(AIM.goal(2, 1250), Goal::Trim(750.0 / 1250.0));
        assert!(matches!(AIM.goal(2, 1251), Goal::Stages(_)));
        assert!(matches!(AIM.goal(1, 1010), Goal::Stages(_)));
        assert!(matches!(AIM.goal(10, 9000), Goal::Stages(_)));
        assert_eq!(AIM.goal(11, 9000), Goal::Trim(750.0 / 9000.0));
        let single = Aim { target: 1, ..AIM };
        assert_eq!(single.goal(2, 1), Goal::Trim(1.0));
        assert_eq!(AIM.before_trim(), 1030);
    }

    #[test]
    fn a_bound_that_leads_is_the_goal_of_every_pass() {
        let bounded = |lead| Aim { bound: Some(8.0), lead, ..AIM };
        let allowed = |lead| [0, 1, 2, 3].map(|turn| bounded(lead).bound_of(turn).unwrap());
        let [all, half] = [8.0 * BOUND_SAFETY, 4.0 * BOUND_SAFETY];
        assert_eq!(allowed(Lead::Bound), [all; 4]);
        assert_eq!(allowed(Lead::Target), [all; 4]);
        assert_eq!(allowed(Lead::BoundFromHalf), [half, all, all, all]);
        for (lead, turn, most) in [
            (Lead::Bound, 0, all),
            (Lead::Bound, 3, all),
            (Lead::BoundFromHalf, 0, half),
            (Lead::BoundFromHalf, 1, all),
        ] {
            assert_eq!(bounded(lead).goal(turn, 5000), Goal::Deviation(most));
        }
        assert_eq!(bounded(Lead::Target).goal(1, 4000), AIM.goal(1, 4000));
        assert_eq!(AIM.bound_of(0), None);
        let is_last = |lead| [0, 1, 2].map(|turn| bounded(lead).is_last(turn));
        assert_eq!(is_last(Lead::Bound), [true; 3]);
        assert_eq!(is_last(Lead::BoundFromHalf), [false, true, true]);
    }

    #[test]
    fn half_of_a_bound_goes_first_and_a_single_cluster_ends_at_the_target() {
        let stops = |turn, clusters| match AIM.within(4.0, turn, clusters) {
            StopRule::Deviation(bounds, keep) => (bounds, keep.raw),
            other => panic!("{other:?}"),
        };
        assert_eq!(stops(0, 2), (vec![2.0, 4.0], vec![0, 0]));
        assert_eq!(stops(1, 1), (vec![4.0], vec![1000]));
    }

    #[test]
    fn a_single_cluster_ends_at_the_target_in_the_last_pass_alone() {
        match AIM.in_one_cluster(2, 2000) {
            StopRule::Faces(shares, target) => assert!(target == 1000 && is_near(*shares.last().unwrap(), 0.5)),
            other => panic!("{other:?}"),
        }
        match AIM.in_one_cluster(1, 4000) {
            StopRule::Shares(shares) => assert!(is_near(*shares.last().unwrap(), 0.5)),
            other => panic!("{other:?}"),
        }
        assert!(matches!(AIM.in_one_cluster(2, 0), StopRule::Faces(..)));
        let single = Aim { target: 1, ..AIM };
        assert!(matches!(single.in_one_cluster(2, 1), StopRule::Faces(shares, 1) if shares == [1.0]));
    }

    #[test]
    fn a_sample_is_taken_for_what_will_be_left_of_it() {
        let of = |aim: Aim, turn, faces| {
            let Purpose { left, is_last } = aim.purpose(turn, faces);
            (left, is_last)
        };
        assert_eq!(of(AIM, 1, 4000.0), (0.25, false));
        assert_eq!(of(AIM, 2, 2000.0), (0.5, true));
        assert_eq!(of(AIM, 2, 0.0), (1000.0, true));
        assert_eq!(of(Aim { target: 1, ..AIM }, 0, 4000.0), (1.0 / 4000.0, false));
        assert_eq!(of(Aim { target: 0, ..AIM }, 0, 4000.0), (1.0, false));
        assert_eq!([0, 1, 2].map(|turn| AIM.faces_after(turn).round()), [4000.0, 2000.0, 1000.0]);
    }
}
