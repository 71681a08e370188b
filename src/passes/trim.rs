//! Removes the last faces above the target.
//!
//! A pass that stops at a threshold ends near the target, at one cost everywhere. Clusters may then lose the same small
//! share of their faces: costs stay nearly even, and only some clusters have to be simplified again. Where some
//! clusters have no cheap collapse left, faces are chosen over all clusters as one queue would choose them: every
//! cluster is simplified slightly too far and logs the cost of each collapse; the logs are merged by cost; the prefix
//! that removes enough faces gives each cluster its quota. A second run of each cluster, identical to the bit, stops at
//! its quota.

use super::sample::evenly_spread;
use crate::base::id::{TiSlice, TiVec};
use crate::partition::ClusterId;
use crate::simplify::LoggedCollapse;

/// Largest share of its faces that a cluster loses while other clusters stay as they are.
const SPREAD_SHARE: f64 = 0.06;

/// Returns the faces that each cluster keeps so that they sum to `target`, or one less. As few clusters as possible,
/// evenly spread, lose the same share.
pub fn spread_shares(faces: &TiSlice<ClusterId, u64>, target: u64) -> TiVec<ClusterId, u64> {
    let all: u64 = faces.iter().sum();
    let excess = all.saturating_sub(target);
    let is_enough = |chosen: &[ClusterId]| {
        let of_chosen: u64 = chosen.iter().map(|&cluster| faces[cluster]).sum();
        excess as f64 <= SPREAD_SHARE * of_chosen as f64
    };
    let chosen = fewest_spread(faces, excess as f64 / (SPREAD_SHARE * all as f64), is_enough);
    let of_chosen: Vec<u64> = chosen.iter().map(|&cluster| faces[cluster]).collect();
    let left = of_chosen.iter().sum::<u64>().saturating_sub(excess);
    let mut keep = faces.to_vec();
    chosen.iter().zip(equal_shares(&of_chosen, left)).for_each(|(&cluster, faces)| keep[cluster] = faces);
    keep
}

/// Returns as few evenly spread clusters as are enough, at least this share of all; all of them if no fewer are. The
/// share is infinite or NaN where no faces are left to share.
fn fewest_spread(
    faces: &TiSlice<ClusterId, u64>,
    least: f64,
    is_enough: impl Fn(&[ClusterId]) -> bool,
) -> Vec<ClusterId> {
    let count = (least * faces.len() as f64) as usize;
    let some = (count.max(1)..faces.len()).map(|count| evenly_spread(faces, count)).find(|chosen| is_enough(chosen));
    some.unwrap_or_else(|| evenly_spread(faces, faces.len()))
}

/// Returns the faces that each cluster keeps so that they sum to `target`, or one less; all lose the same share.
fn equal_shares(faces: &[u64], target: u64) -> Vec<u64> {
    let all = faces.iter().sum::<u64>().max(1);
    let (mut before, mut given) = (0, 0);
    let keep_of = |&count: &u64| {
        before += count;
        let due = (u128::from(before) * u128::from(target) / u128::from(all)) as u64;
        let keep = due.saturating_sub(given).min(count);
        // Most collapses remove two faces. If an odd number has to go, remove one more here and one less in the next
        // cluster.
        let keep = keep.saturating_sub(count.saturating_sub(keep) % 2);
        given += keep;
        keep
    };
    faces.iter().map(keep_of).collect()
}

/// Returns the faces at which clusters stop so that the sum is `target`, clamped to what is possible, after a run reduced
/// them from `before` to `after`; 0 where that run stands. As few clusters as possible, evenly spread, give back the same
/// share of what they lost.
pub fn give_back(
    before: &TiSlice<ClusterId, u64>,
    after: &TiSlice<ClusterId, u64>,
    target: u64,
) -> TiVec<ClusterId, u64> {
    let lost = |cluster: ClusterId| before[cluster].saturating_sub(after[cluster]);
    let all: u64 = after.iter().sum();
    let missing = target.saturating_sub(all);
    let is_enough = |chosen: &[ClusterId]| {
        let room = |&cluster: &ClusterId| lost(cluster).min((SPREAD_SHARE * after[cluster] as f64) as u64);
        missing <= chosen.iter().map(room).sum()
    };
    let chosen = fewest_spread(before, missing as f64 / (SPREAD_SHARE * all as f64), is_enough);
    let way: u64 = chosen.iter().map(|&cluster| lost(cluster)).sum();
    let (mut stretch, mut given) = (0, 0);
    let mut stops: TiVec<ClusterId, u64> = vec![0; before.len()].into();
    for cluster in chosen {
        stretch += lost(cluster);
        let due = (u128::from(stretch) * u128::from(missing.min(way)) / u128::from(way.max(1))) as u64;
        stops[cluster] = if due > given { after[cluster] + due - given } else { 0 };
        given = due;
    }
    stops
}

/// A collapse in the queue of all clusters.
#[derive(Debug, Clone, Copy, PartialEq)]
struct MergedCollapse {
    /// Highest cost so far in its cluster.
    cost: f32,
    cluster: ClusterId,
    /// Faces that the cluster has lost with it; 0 where it closed more holes than that.
    lost: u32,
    /// Number of collapses that its cluster logged before it.
    place: u32,
}

/// Logged collapses of all clusters.
#[derive(Debug, Default)]
pub struct MergedLog {
    collapses: Vec<MergedCollapse>,
}

impl MergedLog {
    /// Adds the log of a cluster that has `faces` faces. Add clusters in ascending order.
    pub fn add(&mut self, cluster: ClusterId, faces: u64, log: &[LoggedCollapse]) {
        let mut highest = 0f32;
        for (place, logged) in (0..).zip(log) {
            highest = highest.max(logged.cost);
            // A cluster has fewer than 2³² faces.
            let lost = faces.saturating_sub(u64::from(logged.faces)) as u32;
            self.collapses.push(MergedCollapse { cost: highest, cluster, lost, place });
        }
    }

    /// Memory that it takes, in bytes.
    pub fn bytes(&self) -> u64 {
        (self.collapses.capacity() * size_of::<MergedCollapse>()) as u64
    }

    /// Returns the faces that each cluster may lose so that together they lose `excess`, or one more. Where a collapse
    /// would remove more, its cluster stops before it, and the next cheapest ones of others take its place. If they are
    /// not enough, the collapse that would remove the fewest is done after all where that is at most `spare` too many; its
    /// cluster has to find other ones for the rest where it is not.
    pub fn cut(mut self, excess: u64, spare: u64, cluster_count: usize) -> Quotas {
        // Equal costs stay in the order of clusters and collapses. A stable sort would need half as much memory again.
        self.collapses
            .sort_unstable_by(|a, b| a.cost.total_cmp(&b.cost).then((a.cluster, a.place).cmp(&(b.cluster, b.place))));
        let mut chosen = Chosen { lost: vec![0; cluster_count].into(), sum: 0 };
        let mut is_over: TiVec<ClusterId, bool> = vec![false; cluster_count].into();
        let mut over: Option<&MergedCollapse> = None;
        for collapse in &self.collapses {
            if chosen.sum >= excess {
                break;
            }
            if is_over[collapse.cluster] {
                continue;
            }
            if chosen.sum_with(collapse) > excess + 1 {
                is_over[collapse.cluster] = true;
                over = over.filter(|over| chosen.gain(over) <= chosen.gain(collapse)).or(Some(collapse));
                continue;
            }
            chosen.add(collapse);
        }
        let over = over.filter(|_| chosen.sum < excess);
        if let Some(collapse) = over.filter(|collapse| chosen.sum_with(collapse) <= excess + spare) {
            chosen.add(collapse);
        }
        let Chosen { mut lost, sum } = chosen;
        if let Some(collapse) = over {
            lost[collapse.cluster] += excess.saturating_sub(sum);
        }
        Quotas { lost, is_enough: sum >= excess }
    }
}

/// What the clusters lose together.
#[derive(Debug, PartialEq)]
pub struct Quotas {
    /// Faces that each cluster loses.
    pub lost: TiVec<ClusterId, u64>,
    /// Whether the logged collapses are enough.
    pub is_enough: bool,
}

/// The collapses chosen so far.
struct Chosen {
    /// Faces that each cluster loses.
    lost: TiVec<ClusterId, u64>,
    /// Faces that all clusters lose.
    sum: u64,
}

impl Chosen {
    /// Faces that go with a further collapse.
    fn gain(&self, collapse: &MergedCollapse) -> u64 {
        u64::from(collapse.lost).saturating_sub(self.lost[collapse.cluster])
    }

    fn sum_with(&self, collapse: &MergedCollapse) -> u64 {
        self.sum - self.lost[collapse.cluster] + u64::from(collapse.lost)
    }

    fn add(&mut self, collapse: &MergedCollapse) {
        self.sum = self.sum_with(collapse);
        self.lost[collapse.cluster] = u64::from(collapse.lost);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Adds a cluster of 100 faces whose collapses have these costs and remove these numbers of faces.
    fn log(merged: &mut MergedLog, cluster: u32, collapses: &[(f32, i32)]) {
        let mut faces = 100;
        let entry = |&(cost, died): &(f32, i32)| {
            faces -= died;
            LoggedCollapse { cost, faces: faces as u32 }
        };
        merged.add(ClusterId::new(cluster), 100, &collapses.iter().map(entry).collect::<Vec<_>>());
    }

    #[test]
    fn a_log_takes_sixteen_bytes_for_a_collapse() {
        let mut merged = MergedLog::default();
        let log = vec![LoggedCollapse { cost: 1.0, faces: 50 }; 1 << 16];
        (0..16).for_each(|cluster| merged.add(ClusterId::new(cluster), 100, &log));
        assert_eq!(merged.bytes(), 16 << 20);
    }

    #[test]
    fn equal_shares_add_up_and_take_faces_in_pairs() {
        for (faces, target) in [(vec![1001, 500, 733, 0, 12], 2000), (vec![7], 3), (vec![10, 10], 40), (vec![], 5)] {
            let keep = equal_shares(&faces, target);
            let (all, kept) = (faces.iter().sum::<u64>(), keep.iter().sum::<u64>());
            assert!(kept <= target.min(all) && kept + 1 >= target.min(all), "{keep:?}");
            for (&count, &keep) in faces.iter().zip(&keep) {
                assert!(keep >= count || (count - keep).is_multiple_of(2));
                let due = count as f64 * target.min(all) as f64 / all as f64;
                assert!((keep as f64 - due).abs() <= 2.0, "{keep} of {count}");
            }
        }
    }

    #[test]
    fn a_small_excess_is_taken_from_few_clusters() {
        let faces = [1000, 0, 1000, 1000, 1000];
        let spread = |target| spread_shares(TiSlice::from_ref(&faces), target).raw;
        assert_eq!(spread(3980), [1000, 0, 1000, 980, 1000]);
        assert_eq!(spread(3900), [1000, 0, 950, 1000, 950]);
        assert_eq!(spread(3600), [900, 0, 900, 900, 900]);
        // Exactly as much as one cluster may lose.
        assert_eq!(spread(3940), [1000, 0, 1000, 940, 1000]);
        assert_eq!(spread(4000), faces);
        assert_eq!(spread(5000), faces);
        assert!(spread_shares(TiSlice::from_ref(&[]), 5).is_empty());
    }

    #[test]
    fn one_large_cluster_does_not_lose_the_excess_of_all() {
        let spread = |faces: &[u64], target| spread_shares(TiSlice::from_ref(faces), target).raw;
        assert_eq!(spread(&[10, 10, 1000, 10], 980), [8, 10, 952, 10]);
    }

    #[test]
    fn nothing_is_lost_where_nothing_has_to_go() {
        assert_eq!(equal_shares(&[10, 7, 10], 27), [10, 7, 10]);
        assert_eq!(equal_shares(&[1], 1), [1]);
        assert_eq!(spread_shares(TiSlice::from_ref(&[0, 0]), 0).raw, [0, 0]);
    }

    proptest! {
        #[test]
        fn clusters_lose_the_excess_together(
            faces in proptest::collection::vec(prop_oneof![Just(0u64), 1u64..20_000], 0..40),
            share in 0.0..1.2f64,
        ) {
            let all: u64 = faces.iter().sum();
            let target = (all as f64 * share) as u64;
            let keep = spread_shares(TiSlice::from_ref(&faces), target);
            let kept: u64 = keep.iter().sum();
            prop_assert!(kept <= target.min(all) && kept + 1 >= target.min(all), "{kept} of {target}");
            prop_assert!(keep.iter().zip(&faces).all(|(keep, faces)| keep <= faces));
            let losses = || keep.iter().zip(&faces).filter(|(keep, faces)| keep < faces);
            let most = SPREAD_SHARE.max(1.0 - share);
            for (keep, faces) in losses() {
                prop_assert!((faces - keep) as f64 <= most * *faces as f64 + 3.0, "{keep} of {faces}");
            }
        }
    }

    #[test]
    fn few_clusters_give_back_and_none_more_than_it_lost() {
        let stops = |before: &[u64], after: &[u64], target| {
            give_back(TiSlice::from_ref(before), TiSlice::from_ref(after), target).raw
        };
        // Each has room for six faces.
        let stopped = stops(&[200; 10], &[100; 10], 1011);
        assert_eq!(stopped.iter().filter(|&&stop| stop > 0).count(), 2);
        assert_eq!(stopped.iter().map(|stop| stop.saturating_sub(100)).sum::<u64>(), 11);
        let stopped = stops(&[200; 10], &[100; 10], 1012);
        assert_eq!(stopped.iter().filter(|&&stop| stop > 0).count(), 2, "all that two have room for");
        // One that lost nothing has nothing to give back.
        for target in [110, 150, 500, 1100] {
            let stopped = stops(&[100, 1000, 0], &[100, 10, 0], target);
            assert_eq!(stopped, [0, if target > 110 { target - 100 } else { 0 }, 0]);
        }
        assert_eq!(stops(&[10, 10], &[0, 0], 10), [5, 5]);
        assert_eq!(stops(&[10, 10], &[5, 5], 8), [0, 0]);
        assert_eq!(stops(&[10], &[9], 10), [10]);
        assert_eq!(stops(&[0, 0], &[0, 0], 3), [0, 0]);
        assert!(stops(&[], &[], 3).is_empty());
    }

    proptest! {
        #[test]
        fn what_is_given_back_adds_up(
            faces in proptest::collection::vec((0u64..9_000, 0.0..1.0f64), 1..30),
            share in 0.0..1.2f64,
        ) {
            let before: Vec<u64> = faces.iter().map(|&(before, _)| before).collect();
            let after: Vec<u64> = faces.iter().map(|&(before, left)| (before as f64 * left) as u64).collect();
            let [all, left]: [u64; 2] = [before.iter().sum(), after.iter().sum()];
            let target = left + ((all - left) as f64 * share) as u64;
            let stopped = give_back(TiSlice::from_ref(&before), TiSlice::from_ref(&after), target);
            let ends = || stopped.iter().zip(&after).map(|(&stop, &after)| if stop > 0 { stop } else { after });
            prop_assert_eq!(ends().sum::<u64>(), target.min(all));
            prop_assert!(ends().zip(&before).zip(&after).all(|((end, before), after)| end <= *before && end >= *after));
        }
    }

    #[test]
    fn the_cheapest_collapses_of_all_clusters_are_chosen() {
        let mut merged = MergedLog::default();
        log(&mut merged, 0, &[(1.0, 2), (5.0, 2), (4.0, 2)]);
        log(&mut merged, 1, &[(2.0, 2), (3.0, 1), (9.0, 2)]);
        assert_eq!(merged.cut(5, 0, 2).lost.raw, [2, 3]);
    }

    #[test]
    fn a_collapse_of_too_many_faces_makes_way_for_others() {
        let cut = |excess, second: &[(f32, i32)]| {
            let mut merged = MergedLog::default();
            log(&mut merged, 0, &[(1.0, 2), (2.0, 4), (3.0, 1)]);
            log(&mut merged, 1, second);
            let quotas = merged.cut(excess, 0, 2);
            (quotas.lost.raw, quotas.is_enough)
        };
        assert_eq!(cut(3, &[(4.0, 2), (5.0, 2)]), (vec![2, 2], true));
        assert_eq!(cut(5, &[(4.0, 2), (5.0, 2)]), (vec![6, 0], true));
        assert_eq!(cut(4, &[(4.0, 1), (5.0, 1)]), (vec![2, 2], true));
        // What others have is not enough.
        assert_eq!(cut(4, &[(4.0, 1)]), (vec![3, 1], false));
        assert_eq!(cut(4, &[(4.0, 5)]), (vec![4, 0], false));
        assert_eq!(cut(20, &[(4.0, 1)]), (vec![7, 1], false));
    }

    #[test]
    fn one_collapse_may_remove_a_few_faces_too_many_where_no_other_is_left() {
        let cut = |excess, spare| {
            let mut merged = MergedLog::default();
            log(&mut merged, 0, &[(1.0, 6), (2.0, 2)]);
            log(&mut merged, 1, &[(1.5, 2), (2.5, 4)]);
            let quotas = merged.cut(excess, spare, 2);
            (quotas.lost.raw, quotas.is_enough)
        };
        assert_eq!(cut(3, 2), (vec![0, 3], false));
        assert_eq!(cut(3, 3), (vec![0, 6], true));
        assert_eq!(cut(2, 9), (vec![0, 2], true));
    }

    #[test]
    fn a_cluster_that_stops_before_a_collapse_does_not_skip_it() {
        let cut = |spare| {
            let mut merged = MergedLog::default();
            log(&mut merged, 0, &[(1.0, 2), (2.0, 4), (3.0, -3)]);
            let quotas = merged.cut(3, spare, 1);
            (quotas.lost.raw, quotas.is_enough)
        };
        assert_eq!([cut(0), cut(3)], [(vec![3], false), (vec![6], true)]);
    }

    #[test]
    fn the_first_of_several_collapses_that_remove_too_many_faces_is_done_after_all() {
        let cut = |removed: [i32; 2]| {
            let mut merged = MergedLog::default();
            (0..2).for_each(|cluster| log(&mut merged, cluster, &[(1.0, removed[cluster as usize])]));
            merged.cut(3, 2, 2).lost.raw
        };
        assert_eq!([cut([5, 5]), cut([7, 5]), cut([5, 7])], [[5, 0], [0, 5], [5, 0]]);
    }

    proptest! {
        #[test]
        fn clusters_lose_the_faces_that_one_queue_would_remove(
            clusters in proptest::collection::vec(proptest::collection::vec(0.0..1.0f32, 0..20), 1..8),
            share in 0.0..1.0f64,
        ) {
            let mut merged = MergedLog::default();
            let mut all = Vec::new();
            for (cluster, costs) in clusters.iter().enumerate() {
                log(&mut merged, cluster as u32, &costs.iter().map(|&cost| (cost, 2)).collect::<Vec<_>>());
                let mut highest = 0f32;
                all.extend(costs.iter().map(|cost| {
                    highest = highest.max(*cost);
                    (highest, cluster)
                }));
            }
            all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let excess = (2.0 * share * all.len() as f64) as u64;
            let mut lost = vec![0; clusters.len()];
            all[..excess.div_ceil(2) as usize].iter().for_each(|&(_, cluster)| lost[cluster] += 2);
            prop_assert_eq!(merged.cut(excess, 0, clusters.len()), Quotas { lost: lost.into(), is_enough: true });
        }
    }

    #[test]
    fn faces_that_close_holes_count_only_where_a_cluster_is_simplified() {
        let cut = |excess| {
            let mut merged = MergedLog::default();
            log(&mut merged, 0, &[(1.0, -3), (2.0, 2), (3.0, 2)]);
            log(&mut merged, 1, &[(1.5, 2), (2.5, 2)]);
            merged.cut(excess, 0, 2).lost.raw
        };
        assert_eq!(cut(4), [0, 4]);
        assert_eq!(cut(5), [1, 4]);
    }

    #[test]
    fn a_cheap_collapse_after_a_dear_one_waits_for_it() {
        let mut merged = MergedLog::default();
        log(&mut merged, 0, &[(5.0, 2), (1.0, 2)]);
        log(&mut merged, 1, &[(2.0, 2)]);
        assert_eq!(merged.cut(2, 0, 2).lost.raw, [0, 2]);
    }
}
