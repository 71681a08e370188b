//! How a triangle changes when a corner moves, in space and in the texture, and whether it stays valid.

use glam::{DVec2, DVec3};

/// If no face turns by more than about 10° (squared cosine), no two faces come to lie on each other.
const FOLD_COSINE_SQ: f64 = 0.97;
/// A face may turn by at most about 78° in one collapse (cosine).
const TURN_COSINE: f64 = 0.2;
/// A face below this regularity (4√3 · area / Σ length²; 1 is equilateral) may not become thinner.
const REGULARITY_MIN: f64 = 0.02;
/// A texture triangle must keep more than this share of its size, after allowing for any loss of the face's own area.
const UV_AREA_SHARE_MIN: f64 = 0.05;

/// Whether a triangle keeps its side and shape when a corner moves.
#[inline]
pub fn triangle_survives(before: [DVec3; 3], after: [DVec3; 3]) -> bool {
    change_of(before, after).is_some()
}

/// How a triangle changes when a corner moves.
#[derive(Debug, Clone, Copy)]
pub struct Change {
    /// Squared areas before and after.
    pub areas_sq: [f64; 2],
    /// Whether it turns by more than about 10°, so that it may fold onto a neighbour.
    pub turns: bool,
    /// Its normal afterwards; the length is twice the area.
    pub normal: DVec3,
}

/// How a triangle changes when a corner moves; `None` if it does not keep its side and shape.
///
/// Uses no roots or divisions: checks of collapses spend most of their time here.
#[inline(always)]
pub fn change_of(before: [DVec3; 3], after: [DVec3; 3]) -> Option<Change> {
    let across = |t: [DVec3; 3]| (t[1] - t[0]).cross(t[2] - t[0]);
    let (old, new) = (across(before), across(after));
    let (old_sq, new_sq) = (old.length_squared(), new.length_squared());
    let turn = old.dot(new);
    if turn < 0.0 || turn * turn < TURN_COSINE * TURN_COSINE * (old_sq * new_sq) {
        return None;
    }
    // regularity = 4√3 · area / Σ length², area = √new_sq / 2
    let lengths =
        |t: [DVec3; 3]| t[0].distance_squared(t[1]) + t[1].distance_squared(t[2]) + t[2].distance_squared(t[0]);
    let now = lengths(after);
    let is_regular = 12.0 * new_sq >= (REGULARITY_MIN * now) * (REGULARITY_MIN * now);
    let survives = new_sq > 0.0
        && (is_regular || {
            let was = lengths(before);
            new_sq * was * was >= old_sq * now * now
        });
    let turns = may_fold(turn, old_sq * new_sq);
    survives.then_some(Change { areas_sq: [0.25 * old_sq, 0.25 * new_sq], turns, normal: new })
}

/// How a triangle changes when a corner moves, whichever way it turns; `None` if it has no area afterwards.
pub fn any_change_of(before: [DVec3; 3], after: [DVec3; 3]) -> Option<Change> {
    let [old, normal] = [before, after].map(|t| (t[1] - t[0]).cross(t[2] - t[0]));
    let areas_sq = [old, normal].map(|across| 0.25 * across.length_squared());
    (areas_sq[1] > 0.0).then_some(Change { areas_sq, turns: true, normal })
}

/// Twice the area of a texture triangle, negative if it is mirrored.
pub fn doubled_uv_area([a, b, c]: [DVec2; 3]) -> f64 {
    (b - a).perp_dot(c - a)
}

/// Whether a texture triangle keeps its sign and does not shrink too much in comparison with its face, whose squared
/// areas before and after are given. `true` if it had no texture or no area.
#[inline]
pub fn uv_survives(before: [DVec2; 3], after: [DVec2; 3], areas_sq: [f64; 2]) -> bool {
    let (old, new) = (doubled_uv_area(before), doubled_uv_area(after));
    if old.is_nan() || old == 0.0 {
        return true;
    }
    let [old_sq, new_sq] = if areas_sq[0] > 0.0 { areas_sq } else { [1.0; 2] };
    let (kept, least) = (new * old.signum(), UV_AREA_SHARE_MIN * old);
    kept > 0.0 && kept * kept * old_sq > least * least * new_sq.min(old_sq)
}

/// Whether a face turns so far that it may fold onto a neighbour. `turn` is the dot product of its normals before and
/// after, not negative; `lengths_sq` is the product of their squared lengths.
#[inline(always)]
fn may_fold(turn: f64, lengths_sq: f64) -> bool {
    turn * turn <= FOLD_COSINE_SQ * lengths_sq
}
