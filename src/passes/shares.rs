//! How far each pass simplifies, and in how many stages.
//!
//! Quadrics are recomputed between stages. That matters most once many faces are gone, and is cheapest then, so the
//! last pass has the most stages.

/// Approximate share of its faces that a stage of the first pass keeps: one stage for ratios down to a tenth.
const FIRST_STAGE_SHARE: f64 = 0.3;
/// The same for passes between the first and the last: one stage from 4 × to 2 × the target.
const MIDDLE_STAGE_SHARE: f64 = 0.36;
/// The same for the last pass: two stages from 2 × the target.
const LAST_STAGE_SHARE: f64 = 0.7;
/// A last pass over several clusters aims this share above the target; the trim removes the rest.
pub const TRIM_SHARE: f64 = 0.06;
/// Largest excess over the target, as a share of the target, at which a trim replaces an ordinary pass.
pub const TRIM_SHARE_MAX: f64 = 0.25;

/// Largest number of stages of a pass: that of [`stage_shares`] for the smallest share.
pub const STAGES_MAX: usize = 58;
/// Smallest share of the faces that a pass aims at.
const SHARE_MIN: f64 = 1e-9;

/// Smallest share of its faces that a pass before the last two keeps. Quadrics of a much coarser mesh carry little
/// information, and the next pass must catch up on the locked rims of clusters.
const PASS_SHARE_MIN: f64 = 0.25;

/// Number of passes for a target: `wanted`, or as many as it takes from `input` to `target` faces in steps of a
/// quarter. `wanted` if that is at most 1, or if `target` or `input` is 0.
pub fn pass_count(wanted: usize, input: u64, target: u64) -> usize {
    if wanted <= 1 || target == 0 {
        return wanted;
    }
    let before_last = 4.0 * target as f64 / input as f64;
    let steps = (libm::log(before_last) / libm::log(PASS_SHARE_MIN) - STEP_SLACK).ceil().max(0.0) as usize;
    wanted.max(2 + steps)
}

/// Part of a step that is spread over the other steps instead of adding one.
const STEP_SLACK: f64 = 0.05;

/// Number of faces that pass `pass` (from 0) of `passes` aims at, between `input` and `target` faces.
///
/// Even steps down to 4 × the target, then 2 ×, then 1 ×, but never above an even share of the whole way.
pub fn pass_target(input: u64, target: u64, pass: usize, passes: usize) -> f64 {
    let left = passes.saturating_sub(pass + 1) as i32;
    let ratio = (target as f64 / input.max(1) as f64).min(1.0);
    let even = libm::pow(ratio, (pass + 1) as f64 / passes as f64);
    let doubled = match left {
        0 | 1 => ratio * libm::pow(2.0, f64::from(left)),
        _ => libm::pow(4.0 * ratio, (pass + 1) as f64 / (passes - 2) as f64),
    };
    if left == 0 { target as f64 } else { input as f64 * even.min(doubled) }
}

/// Part of a stage that is spread over the others, so that a pass that ended slightly above its target adds no stage.
const STAGE_SLACK: f64 = 0.25;

/// Shares of the faces to keep at the end of each stage of pass `pass` (from 0) of `passes`; the last one is `share`.
pub fn stage_shares(share: f64, pass: usize, passes: usize) -> Vec<f64> {
    let share = share.clamp(SHARE_MIN, 1.0);
    let stage_share = match pass {
        0 => FIRST_STAGE_SHARE,
        _ if pass + 1 < passes => MIDDLE_STAGE_SHARE,
        _ => LAST_STAGE_SHARE,
    };
    let stages = (libm::log(share) / libm::log(stage_share) - STAGE_SLACK).ceil().max(1.0);
    (1..=stages as u32).map(|stage| libm::pow(share, f64::from(stage) / stages)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_share_has_the_most_stages() {
        assert_eq!(stage_shares(0.0, 2, 3).len(), STAGES_MAX);
        assert!(stage_shares(0.0, 0, 1).len() < STAGES_MAX && stage_shares(0.0, 1, 3).len() < STAGES_MAX);
    }

    #[test]
    fn three_passes_go_over_four_and_two_times_the_target() {
        let targets: Vec<u64> = (0..3).map(|pass| pass_target(1000, 100, pass, 3).round() as u64).collect();
        assert_eq!(targets, [400, 200, 100]);
    }

    #[test]
    fn a_far_target_takes_more_passes_of_a_quarter_each_at_most() {
        let counts = [500, 100, 40, 20, 5, 1].map(|target| pass_count(3, 1000, target));
        assert_eq!(counts, [3, 3, 4, 4, 5, 6]);
        assert_eq!([pass_count(1, 1000, 1), pass_count(8, 1000, 1), pass_count(3, 1000, 0)], [1, 8, 3]);
        assert_eq!([pass_count(3, 0, 1), pass_count(2, 1, 1), pass_count(2, 1, 1000)], [3, 2, 2]);
        // With two passes the last starts from twice the target. Slightly more than a quarter does not add a step.
        assert_eq!([500, 100, 60, 50].map(|target| pass_count(2, 1000, target)), [2, 3, 3, 4]);
        let targets: Vec<u64> = (0..5).map(|pass| pass_target(100_000, 500, pass, 5).round() as u64).collect();
        assert_eq!(targets, [27_144, 7_368, 2_000, 1_000, 500]);
    }

    #[test]
    fn stages_go_so_far_in_each_pass() {
        let stages = |share, pass| stage_shares(share, pass, 3).len();
        assert_eq!([0.3, 0.2, 0.05].map(|share| stages(share, 0)), [1, 2, 3]);
        assert_eq!([0.36, 0.25, 0.15].map(|share| stages(share, 1)), [1, 2, 2]);
        assert_eq!([0.7, 0.5, 0.36].map(|share| stages(share, 2)), [1, 2, 3]);
        assert_eq!(stage_shares(1.5, 0, 3), [1.0]);
    }

    #[test]
    fn mild_ratios_are_shared_evenly() {
        let targets: Vec<u64> = (0..3).map(|pass| pass_target(1000, 729, pass, 3).round() as u64).collect();
        assert_eq!(targets, [900, 810, 729]);
    }

    #[test]
    fn passes_never_aim_above_the_input_and_the_last_one_aims_at_the_target_to_the_face() {
        for input in 1..60 {
            for target in 1..60 {
                let targets: Vec<f64> = (0..5).map(|pass| pass_target(input, target, pass, 4)).collect();
                assert!(targets[..3].iter().all(|&faces| faces <= input as f64), "{input} {targets:?}");
                assert!(targets[..3].is_sorted_by(|a, b| a >= b), "{targets:?}");
                assert_eq!(targets[3..], [target as f64; 2]);
                if target >= input {
                    assert_eq!(targets[..3], [input as f64; 3]);
                }
            }
        }
    }

    #[test]
    fn the_last_stage_ends_at_the_share() {
        let shares = stage_shares(0.5, 2, 3);
        assert_eq!(shares.len(), 2);
        assert!((shares[1] - 0.5).abs() < 1e-12);
        assert_eq!(stage_shares(0.9, 2, 3).len(), 1);
        assert_eq!(stage_shares(0.4, 0, 3).len(), 1);
        assert_eq!(stage_shares(0.4, 1, 3).len(), 1);
    }
}
