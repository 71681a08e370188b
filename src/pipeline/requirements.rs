//! What a job needs, computed from the counts of the scan: memory that grows with the mesh, and scratch space.
//!
//! # Memory
//! ```text
//! 0.14 bytes   each vertex: which are shared, and their ranks
//! names        each part and material
//! ```
//! stays resident through all passes. The rest of the budget is for clusters; the heaviest one must fit.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::base::{Error, MemoryBudget, Result, bytes};
use crate::file::PackedColumn;
use crate::model::{Catalogue, StoredMesh};
use crate::options::SimplifyOptions;
use crate::os::system;
use crate::plan::memory::heaviest_bytes;
use crate::plan::scratch::{self, FirstPass};
use crate::read::COUNT_LIMIT;

/// Bits for each vertex in the set of shared vertices, with its ranks.
const VERTEX_BITS: u64 = 9;

/// Sizes of the mesh.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) struct Requirements {
    pub(super) vertices: u64,
    faces: u64,
    /// Bytes of the stored positions.
    position_bytes: u64,
    has_colours: bool,
    label_bytes: u64,
}

impl Requirements {
    /// Counts a scanned mesh.
    pub(super) fn of(mesh: &StoredMesh, catalogue: &Catalogue) -> Self {
        Self {
            vertices: mesh.vertex_count(),
            faces: mesh.face_count(),
            position_bytes: mesh.position_columns().map(PackedColumn::bytes).sum(),
            has_colours: mesh.has_colours(),
            label_bytes: catalogue.bytes(),
        }
    }

    /// Whether all counts of a value that was read back are below [`COUNT_LIMIT`].
    pub(super) fn is_sound(&self) -> bool {
        [self.vertices, self.faces, self.position_bytes, self.label_bytes].iter().all(|count| *count < COUNT_LIMIT)
    }

    /// Memory that stays allocated through all passes, in bytes.
    pub(super) fn resident_bytes(&self) -> u64 {
        self.vertices * VERTEX_BITS / 64 + self.label_bytes
    }

    /// Scratch space that the first pass takes beside the columns of the scan, in bytes.
    pub(super) fn scratch_bytes(&self, options: &SimplifyOptions) -> u64 {
        let vertices = self.vertices as f64;
        let first = FirstPass {
            columns: 0.0,
            texcoords: 0.0,
            vertices,
            position_bytes: self.position_bytes as f64 / vertices.max(1.0),
            colour_bytes: if self.has_colours { scratch::COLOUR_BYTES } else { 0.0 },
            faces: self.faces as f64,
            faces_out: match options.remesh {
                // A pass that remeshes leaves a little more than the whole.
                Some(_) => 1.5 * self.faces as f64,
                // A first pass leaves about half of the mesh, or the target if that is more.
                None => (0.5 * self.faces as f64).max(options.most_faces(self.faces) as f64),
            },
            looked_up: scratch::RANK_BYTES * vertices,
        };
        // The columns are removed before the next pass, which is taken to leave at least 0.7 of its faces.
        let columns = self.position_bytes as f64 + scratch::FACE_BYTES * first.faces;
        let target = options.most_faces(self.faces) as f64;
        let later = scratch::later_pass(
            first.faces_out,
            target.max(0.7 * first.faces_out),
            first.position_bytes,
            first.colour_bytes,
        );
        first.peak().max(later - columns) as u64
    }

    /// Refuses a job that cannot succeed: a cluster would not fit the memory, or the files of the first pass, if they
    /// are still needed, would not fit the disk.
    ///
    /// # Errors
    /// [`Error::Budget`] and [`Error::NoSpace`], with the size that would suffice.
    pub(super) fn check(
        &self,
        budget: MemoryBudget,
        options: &SimplifyOptions,
        work: &Path,
        needs_scratch: bool,
    ) -> Result<()> {
        let cluster_faces = options.cluster_faces;
        let cluster = heaviest_bytes(options, cluster_faces.min(self.faces))?;
        let resident = self.resident_bytes();
        if resident + cluster > budget.for_work() {
            let needed = MemoryBudget::FIXED_BYTES + resident + cluster + 2 * bytes::MIB;
            let message = format!(
                "`memory: {}` cannot hold the tables of {} vertices and a cluster of {cluster_faces} triangles; give \
                 `memory: {}`",
                bytes::display(budget.bytes),
                self.vertices,
                bytes::display(needed),
            );
            return Err(Error::Budget { needed: Some(needed), message });
        }
        match system::free_disk_bytes(work) {
            Ok(free) if needs_scratch => scratch::refuse_disk(work, self.scratch_bytes(options), free),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::ErrorKind;
    use crate::options::Target;

    const SURVEY: Requirements = Requirements {
        vertices: 150_000_000,
        faces: 300_000_000,
        position_bytes: 750_000_000,
        has_colours: false,
        label_bytes: 0,
    };

    #[test]
    fn a_budget_that_cannot_hold_the_tables_is_refused_with_one_that_can() {
        let folder = tempfile::tempdir().unwrap();
        let need = Requirements { faces: 4_000_000, ..SURVEY };
        let options = SimplifyOptions { cluster_faces: 250_000, ..Default::default() };
        let error =
            need.check(MemoryBudget { bytes: 128 << 20 }, &options, folder.path(), true).unwrap_err().to_string();
        let given =
            error.rsplit("`memory: ").next().and_then(|text| bytes::parse(text.trim_end_matches('`')).ok()).unwrap();
        assert!(given < 160 << 20, "{error}");
        let outcome = need.check(MemoryBudget { bytes: given }, &options, folder.path(), true);
        assert!(!matches!(outcome, Err(Error::Budget { .. })), "{outcome:?}");
    }

    #[test]
    fn what_each_metric_keeps_counts_against_the_budget() {
        let folder = tempfile::tempdir().unwrap();
        let need = Requirements { faces: 4_000_000, vertices: 2_000_000, ..SURVEY };
        let fits = |metric, bytes| {
            let options = SimplifyOptions { metric: Some(metric), cluster_faces: 250_000, ..Default::default() };
            !matches!(need.check(MemoryBudget { bytes }, &options, folder.path(), false), Err(Error::Budget { .. }))
        };
        let plain = MemoryBudget::FIXED_BYTES + need.resident_bytes() + 2 * 200 * 250_000;
        for (metric, extra) in crate::plan::memory::METRIC_FACE_BYTES {
            let needed = plain + 250_000 * extra;
            assert!(fits(metric, needed) && !fits(metric, needed - 1), "{metric:?}");
        }
    }

    #[test]
    fn a_disk_that_is_too_small_is_refused_with_the_space_needed() {
        let tenth = SimplifyOptions { target: Target::ratio(0.1), ..Default::default() };
        let error = scratch::refuse_disk(Path::new("/scratch"), SURVEY.scratch_bytes(&tenth), 1 << 30).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::NoSpace);
        assert!(error.to_string().contains("1.00 GiB are free"), "{error}");
    }

    #[test]
    fn a_bounded_error_may_leave_every_face_on_the_disk() {
        let of = |options: SimplifyOptions| SURVEY.scratch_bytes(&options);
        let tenth = of(SimplifyOptions { target: Target::ratio(0.1), ..Default::default() });
        let bounded = of(SimplifyOptions { target: Target::max_error(0.1), ..Default::default() });
        assert!(bounded > tenth);
        assert_eq!(bounded, of(SimplifyOptions { target: Target::ratio(1.0), ..Default::default() }));
    }
}
