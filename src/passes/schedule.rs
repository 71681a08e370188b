//! Which pass comes next, and when the passes end.

use serde::{Deserialize, Serialize};

use super::options::PassOptions;
use super::pass_id::{Pass, PassKind};
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
        if options.max_error.is_some() && options.target == 0 {
            self.reached = end.is_last && (end.is_single || gained_less_than(BOUNDED_LAST_SHARE));
            self.is_over = self.reached;
            return;
        }
        self.reached = end.is_last && end.faces_out <= options.target;
        self.stuck = if end.is_stuck(options.target) { self.stuck + 1 } else { 0 };
        // A single cluster has no locked rim, so one stuck pass is final. With several, vertices locked in one pass are
        // free in the next.
        let is_stuck = self.stuck > 2 || (end.is_single && self.stuck > 0);
        let is_wall = end.met_wall || (end.is_steepest && gained_less_than(WALL_SHARE));
        self.is_over = self.reached || is_wall || (end.is_last && is_stuck);
        // With both a target and a bound, the one that stops the passes first counts as reached.
        self.reached |= self.is_over && options.max_error.is_some();
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
