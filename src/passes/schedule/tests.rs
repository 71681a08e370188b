use proptest::prelude::*;

use super::*;
use crate::passes::options::samples::three_passes;

fn options(target: u64, max_error: Option<f64>, remesh: Option<CvdSettings>) -> PassOptions {
    PassOptions { max_error, remesh, ..three_passes(10_000, target) }
}

/// A pass over several clusters that removes half of the faces on the way to the target.
const HALVES: PassEnd = PassEnd {
    faces_in: 10_000,
    faces_out: 5_000,
    is_last: false,
    is_single: false,
    is_exact: false,
    is_steepest: false,
    met_wall: false,
};

#[test]
fn a_pass_is_stuck_if_it_removes_little_of_what_is_above_the_target() {
    let is_stuck = |[faces_in, faces_out, target]: [u64; 3], is_exact| {
        PassEnd { faces_in, faces_out, is_last: true, is_single: true, is_exact, ..HALVES }.is_stuck(target)
    };
    for is_exact in [false, true] {
        assert!(is_stuck([2_800, 2_800, 300], is_exact));
        assert!(is_stuck([2_800, 2_790, 300], is_exact));
        assert!(!is_stuck([2_800, 2_700, 300], is_exact));
        assert!(!is_stuck([15, 14, 4], is_exact));
        // A 64th of what is left above the target.
        assert!(is_stuck([6_500, 6_400, 0], is_exact));
        assert!(!is_stuck([6_501, 6_400, 0], is_exact));
    }
    assert!(is_stuck([80_000, 79_995, 79_990], false));
    assert!(!is_stuck([80_000, 79_995, 79_990], true));
    // A ten thousandth of the faces.
    assert!(is_stuck([80_000, 79_992, 79_990], false));
    assert!(!is_stuck([80_000, 79_991, 79_990], false));
}

/// Numbers and turns of all passes, and whether each of them remeshes; `clusters` are those of each remeshing pass.
fn passes(options: &PassOptions, clusters: &[u64]) -> (Schedule, Vec<(usize, usize, bool)>) {
    let (mut schedule, mut passes) = (Schedule::default(), Vec::new());
    while let Some(pass) = schedule.next(options) {
        match pass.kind {
            PassKind::Remesh(settings) => schedule.end_remeshing(&settings, clusters[passes.len()]),
            PassKind::Collapse => schedule.end_collapsing(HALVES, options),
        }
        passes.push((pass.number, pass.turn, matches!(pass.kind, PassKind::Remesh(_))));
    }
    (schedule, passes)
}

#[test]
fn a_target_that_stays_far_takes_twelve_passes_beyond_those_asked_for() {
    let (schedule, passes) = passes(&options(100, None, None), &[]);
    assert_eq!(passes, (0..15).map(|number| (number, number, false)).collect::<Vec<_>>());
    assert!(!schedule.reached && !schedule.is_over);
}

#[test]
fn a_remeshing_pass_comes_first_and_is_not_counted_among_the_others() {
    let settings = CvdSettings { cells: None, ..CvdSettings::default() };
    let (schedule, passes) = passes(&options(100, None, Some(settings)), &[7]);
    let collapsing = (0..15).map(|turn| (turn + 1, turn, false));
    assert_eq!(passes, std::iter::once((0, 0, true)).chain(collapsing).collect::<Vec<_>>());
    assert!(!schedule.reached);
}

#[test]
fn a_number_of_cells_takes_three_remeshing_passes_over_several_clusters_and_no_others() {
    let settings = CvdSettings { cells: Some(50), ..CvdSettings::default() };
    for (clusters, count) in [(&[7, 7, 7, 7][..], 3), (&[2, 2, 2, 2], 3), (&[7, 1], 2), (&[1], 1), (&[0], 1)] {
        let (schedule, passes) = passes(&options(100, None, Some(settings)), clusters);
        assert_eq!(passes, (0..count).map(|number| (number, 0, true)).collect::<Vec<_>>(), "{clusters:?}");
        assert!(schedule.reached && schedule.is_over);
    }
}

/// Whether the target is met, and whether no pass follows, after all of these.
fn verdict(ends: &[PassEnd], options: &PassOptions) -> (bool, bool) {
    let end = ends[ends.len() - 1];
    let removed = end.faces_in - end.faces_out;
    let stuck_count = ends.iter().rev().take_while(|end| end.is_stuck(options.target)).count();
    let is_met = end.is_last && end.faces_out <= options.target;
    let has_wall = end.met_wall || end.is_steepest && removed * 100 < end.faces_in * 8;
    let most = if end.is_single { 1 } else { 3 };
    let is_over = is_met || has_wall || end.is_last && stuck_count >= most;
    (is_met, is_over)
}

/// The same if the bound leads.
fn verdict_within(end: PassEnd, target: u64) -> (bool, bool) {
    let removed = end.faces_in - end.faces_out;
    let is_over = end.is_last && (end.faces_out <= target || end.is_single || removed * 100 < end.faces_in * 2);
    (is_over, is_over)
}

/// Ends of passes: most remove nearly nothing, some exactly or nearly as much as decides.
fn end() -> impl Strategy<Value = PassEnd> {
    let removed = prop_oneof![4 => 0u64..3, 3 => prop::sample::select(vec![199, 200, 799, 800, 5_000])];
    let mostly = prop::bool::weighted(0.8);
    let seldom = || prop::bool::weighted(0.2);
    (removed, mostly, seldom(), seldom(), seldom(), prop::bool::weighted(0.05)).prop_map(
        |(removed, is_last, is_single, is_exact, is_steepest, met_wall)| PassEnd {
            faces_out: HALVES.faces_in - removed,
            is_last,
            is_single,
            is_exact,
            is_steepest,
            met_wall,
            ..HALVES
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    #[test]
    fn passes_end_at_the_target_at_a_wall_or_where_they_are_stuck(
        ends in prop::collection::vec(end(), 1..7),
        target in prop::sample::select(vec![0, 1, 5_000, 9_800, 9_999]),
        bound in prop::sample::select(vec![None, Some(Lead::Target), Some(Lead::Bound), Some(Lead::BoundFromHalf)]),
    ) {
        let options = options(target, bound.map(|_| 1.0), None);
        let mut schedule = Schedule { lead: bound.unwrap_or_default(), ..Schedule::default() };
        // Number of times that the lead changed, and passes before the last time.
        let (mut turned, mut since) = (0, 0);
        for count in 1..=ends.len() {
            let lead = schedule.lead;
            schedule.end_collapsing(ends[count - 1], &options);
            let (is_met, is_over) = match lead {
                Lead::Target => verdict(&ends[since..count], &options),
                _ => verdict_within(ends[count - 1], target),
            };
            // What ends above the target goes on as far as the bound allows, once.
            let goes_on = bound.is_some() && lead == Lead::Target && is_over && !is_met;
            let expected = if goes_on { (turned > 0, turned > 0) } else { (is_met, is_over) };
            if schedule.lead != lead && !schedule.is_over {
                (turned, since) = (turned + 1, count);
            }
            prop_assert!(turned <= 1 && (bound.is_some() || turned == 0));
            prop_assert_eq!((schedule.reached, schedule.is_over), expected, "{:?}", &ends[..count]);
            prop_assert_eq!(schedule.next(&options).is_none(), schedule.is_over);
            prop_assert_eq!(schedule.pass, count);
            if schedule.is_over {
                break;
            }
        }
    }
}

#[test]
fn the_bound_leads_if_the_target_lies_near_it_or_beyond() {
    let lead = |left: f64, is_single, target| {
        let mut schedule = Schedule::default();
        schedule.choose_lead(left, is_single, &options(target, Some(1.0), None));
        schedule.lead
    };
    for is_single in [false, true] {
        // Half of the faces, and 2.5 times as many.
        assert_eq!(lead(0.5, is_single, 0), Lead::Bound);
        assert_eq!(lead(0.2, is_single, 4_999), Lead::Bound);
        assert_eq!(lead(0.2, is_single, 5_000), Lead::Target);
        assert_eq!(lead(0.0, is_single, 100), Lead::Target);
    }
    assert_eq!(lead(0.02, false, 100), Lead::BoundFromHalf);
    assert_eq!(lead(0.02, true, 100), Lead::Bound);
    assert_eq!(lead(0.0, false, 0), Lead::BoundFromHalf);
}

#[test]
fn a_bound_that_reaches_to_the_target_leaves_the_rest_to_it() {
    let options = options(5_000, Some(1.0), None);
    let after = |faces_out| {
        let mut schedule = Schedule { lead: Lead::Bound, ..Schedule::default() };
        schedule.end_collapsing(PassEnd { faces_out, is_last: true, ..HALVES }, &options);
        (schedule.lead, schedule.reached)
    };
    assert!(after(5_000).1);
    assert_eq!(after(5_001), (Lead::Target, false));
    assert_eq!(after(5_300), (Lead::Target, false));
    assert_eq!(after(5_301), (Lead::Bound, false));
}

#[test]
fn a_position_after_more_passes_than_there_were_is_not_sound() {
    let whole = Schedule { remesh_passes: 2, stuck: 2, ..Schedule::at(2) };
    assert!(whole.is_sound(2) && !whole.is_sound(1) && !whole.is_sound(3));
    assert!(!Schedule { remesh_passes: 3, ..whole.clone() }.is_sound(2));
    assert!(!Schedule { stuck: 3, ..whole }.is_sound(2));
}
