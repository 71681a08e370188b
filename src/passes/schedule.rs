//! Which pass comes next, and when the passes end.

use serde::{Deserialize, Serialize};

use super::goal::Lead;
use super::options::PassOptions;
use super::pass_id::{Pass, PassKind};
use super::shares::TRIM_SHARE;
use crate::remesh::cvd::CvdSettings;

/// Largest number of passes beyond those asked for.
const EXTRA_PASSES: usize = 12;
/// With a bound on the error and no target, the passes end when one removes less than this share of the faces.
const BOUNDED_LAST_SHARE: f64 = 0.02;
/// An extra pass at the highest allowed threshold that removes less than this share of the faces is the last: another
/// one would cost far more and remove little.
const WALL_SHARE: f64 = 0.08;
/// A pass that removes at most this share of the faces counts as stuck.
const FLOOR_SHARE: f64 = 1e-4;
/// So does one that removes at most this share of the faces above the target: it would take ever more passes to get
/// there.
const CLOSER_SHARE: f64 = 1.0 / 64.0;
/// If a bound on the deviation leaves less than this share of the faces, the first pass uses half of it.
const DEEP_SHARE: f64 = 0.03;
/// The bound leads up to a target of this many times the faces that it alone would leave: passes led by the target use
/// up the bound in the order of cost, and end above a target that lies so near.
const LEAD_FACTOR: f64 = 2.5;
/// Remeshing passes for a target in cells, if there are several clusters.
pub const CELL_PASSES: usize = 3;

/// Position in the passes of a job; recorded with the state of each pass.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Schedule {
    /// Number, from 0, of the next or current pass.
    pub(super) pass: usize,
    /// Number of remeshing passes, which come first.
    remesh_passes: usize,
    /// Clusters with faces in the last remeshing pass.
    remeshed_clusters: u64,
    /// Number of consecutive passes that removed almost no faces.
    stuck: u32,
    /// Whether the target or the bound on the deviation says where a pass ends.
    pub(super) lead: Lead,
    /// Whether the other one did before.
    has_turned: bool,
    /// Whether the target is met.
    pub(super) reached: bool,
    /// Whether no pass follows.
    pub(super) is_over: bool,
}

/// What a pass that collapses edges did, for the decision whether another one follows.
#[derive(Debug, Clone, Copy)]
pub(super) struct PassEnd {
    /// Faces before.
    pub faces_in: u64,
    /// Faces after.
    pub faces_out: u64,
    /// Whether the pass aimed at the target itself.
    pub is_last: bool,
    /// Whether there is only one cluster.
    pub is_single: bool,
    /// Whether its clusters were to meet the target to the face.
    pub is_exact: bool,
    /// Whether it collapsed up to the highest threshold allowed.
    pub is_steepest: bool,
    /// Whether collapses that cost far more ended it.
    pub met_wall: bool,
}

impl PassEnd {
    /// Number of faces removed.
    fn gained(&self) -> u64 {
        self.faces_in.saturating_sub(self.faces_out)
    }

    /// Whether it removed next to nothing on the way to `target` faces.
    fn is_stuck(&self, target: u64) -> bool {
        let above = self.faces_out.saturating_sub(target) as f64;
        // A plan to the face that removed any may remove more.
        let few = if self.is_exact { 0.0 } else { self.faces_in as f64 * FLOOR_SHARE };
        self.gained() as f64 <= few.max(above * CLOSER_SHARE)
    }
}

impl Schedule {
    /// Returns the next pass; `None` if the passes are over.
    pub(super) fn next(&self, options: &PassOptions) -> Option<Pass> {
        if self.is_over || self.pass >= self.remesh_passes + options.passes + EXTRA_PASSES {
            return None;
        }
        let kind = match options.remesh {
            Some(settings) if !self.is_remeshed(&settings) => PassKind::Remesh(settings),
            _ => PassKind::Collapse,
        };
        Some(Pass { number: self.pass, turn: self.pass - self.remesh_passes, kind })
    }

    /// Whether no further remeshing pass follows.
    fn is_remeshed(&self, settings: &CvdSettings) -> bool {
        match (settings.cells, self.remesh_passes) {
            (_, 0) => false,
            (None, _) => true,
            (Some(_), done) => self.remeshed_clusters <= 1 || done >= CELL_PASSES,
        }
    }

    /// Ends a remeshing pass over `clusters` clusters.
    pub(super) fn end_remeshing(&mut self, settings: &CvdSettings, clusters: u64) {
        self.pass += 1;
        self.remesh_passes += 1;
        self.remeshed_clusters = clusters;
        self.is_over = settings.cells.is_some() && self.is_remeshed(settings);
        self.reached = self.is_over;
    }

    /// Ends a pass that collapsed edges.
    pub(super) fn end_collapsing(&mut self, end: PassEnd, options: &PassOptions) {
        self.pass += 1;
        let gained_less_than = |share: f64| (end.gained() as f64) < end.faces_in as f64 * share;
        self.reached = end.is_last && end.faces_out <= options.target;
        if self.lead != Lead::Target {
            self.reached |= end.is_last && (end.is_single || gained_less_than(BOUNDED_LAST_SHARE));
            self.is_over = self.reached;
            let is_near = end.faces_out as f64 <= options.target as f64 * (1.0 + TRIM_SHARE);
            if is_near && !self.has_turned {
                (self.lead, self.has_turned) = (Lead::Target, true);
            }
            return;
        }
        self.stuck = if end.is_stuck(options.target) { self.stuck + 1 } else { 0 };
        // A single cluster has no locked rim, so one stuck pass is final. With several, vertices locked in one pass are
        // free in the next.
        let is_stuck = self.stuck > 2 || (end.is_single && self.stuck > 0);
        let is_wall = end.met_wall || (end.is_steepest && gained_less_than(WALL_SHARE));
        self.is_over = self.reached || is_wall || (end.is_last && is_stuck);
        if self.is_over && !self.reached && options.max_error.is_some() {
            // The one of the two limits that stops the passes first counts as reached.
            self.reached = self.has_turned;
            self.is_over = self.has_turned;
            (self.lead, self.has_turned) = (Lead::Bound, true);
        }
    }

    /// Chooses what leads the passes under a bound, before the first one that collapses edges: `left` is the share of
    /// the faces that the bound alone would leave.
    pub(super) fn choose_lead(&mut self, left: f64, is_single: bool, options: &PassOptions) {
        let is_beyond = options.target == 0 || LEAD_FACTOR * left * options.input as f64 > options.target as f64;
        let of_bound = if left < DEEP_SHARE && !is_single { Lead::BoundFromHalf } else { Lead::Bound };
        self.lead = if is_beyond { of_bound } else { Lead::Target };
    }

    /// The position before pass `pass`.
    #[cfg(test)]
    pub(super) fn at(pass: usize) -> Self {
        Self { pass, ..Self::default() }
    }

    /// Reports whether a recalled value can be the position before pass `pass`.
    pub(super) fn is_sound(&self, pass: u32) -> bool {
        self.pass == pass as usize && self.remesh_passes <= self.pass && self.stuck as usize <= self.pass
    }
}

#[cfg(test)]
mod tests;
