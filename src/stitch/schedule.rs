//! How far each pass goes, and in how many stages.
//!
//! Quadrics are recomputed between stages. That matters where much is lost already and takes little time there, since few
//! faces are left: the last pass has the most stages.

/// Share of its faces that a stage of the first pass keeps, about: one stage for ratios down to a tenth.
const FIRST_STAGE_SHARE: f64 = 0.3;
/// The same between the first pass and the last: one stage on the way from four times the target to twice.
const MIDDLE_STAGE_SHARE: f64 = 0.36;
/// The same in the last pass: two stages from twice the target.
const LAST_STAGE_SHARE: f64 = 0.7;
/// A last pass in many clusters aims this much above the target; the trim removes the rest.
pub const TRIM_SHARE: f64 = 0.06;

/// Stages of a pass, at most: what [`stage_shares`] makes of the smallest share.
pub const STAGES_MAX: usize = 58;
/// The smallest share of the faces that a pass goes for.
const SHARE_MIN: f64 = 1e-9;

/// Share of its faces that a pass before the last two keeps, at least: quadrics of what is far coarser say little, and what
/// a cluster's rim holds must be made good by the next pass.
const PASS_SHARE_MIN: f64 = 0.25;

/// Passes that a target takes: those that are `wanted`, or as many as the way from `input` to `target` faces needs in steps
/// of a quarter each; a single one stays alone.
pub fn pass_count(wanted: usize, input: u64, target: u64) -> usize {
    if wanted <= 1 || target == 0 || input == 0 {
        return wanted;
    }
    let before_last = (4.0 * target as f64 / input as f64).min(1.0);
    let steps = (libm::log(before_last) / libm::log(PASS_SHARE_MIN) - STEP_SLACK).ceil().max(0.0) as usize;
    wanted.max(2 + steps)
}

/// Part of a step that the steps before it may do as well.
const STEP_SLACK: f64 = 0.05;

/// Faces that pass `pass` (from 0) of `passes` aims at, on the way from `input` to `target` faces.
///
/// Even steps to 4 ×, then 2 × → 1 × of the target, but never more than an even share of the whole way.
pub fn pass_target(input: u64, target: u64, pass: usize, passes: usize) -> f64 {
    let left = passes.saturating_sub(pass + 1) as i32;
    let ratio = (target as f64 / input.max(1) as f64).clamp(0.0, 1.0);
    let even = libm::pow(ratio, (pass + 1) as f64 / passes as f64);
    let doubled = match left {
        0 | 1 => ratio * libm::pow(2.0, f64::from(left)),
        _ => libm::pow(4.0 * ratio, (pass + 1) as f64 / (passes - 2) as f64),
    };
    if left <= 0 { target as f64 } else { input as f64 * even.min(doubled).min(1.0) }
}

/// Part of a stage that the others may do as well, so that a pass that ended a little above its target costs no other one.
const STAGE_SLACK: f64 = 0.25;

/// Shares of the faces to keep at the end of each stage of pass `pass` (from 0) of `passes`, the last one being `share`.
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
        // Of two, the last goes from twice the target, the first to it; a little more than a quarter is no step of its own.
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
    fn the_last_stage_ends_at_the_share() {
        let shares = stage_shares(0.5, 2, 3);
        assert_eq!(shares.len(), 2);
        assert!((shares[1] - 0.5).abs() < 1e-12);
        assert_eq!(stage_shares(0.9, 2, 3).len(), 1);
        assert_eq!(stage_shares(0.4, 0, 3).len(), 1);
        assert_eq!(stage_shares(0.4, 1, 3).len(), 1);
    }
}
