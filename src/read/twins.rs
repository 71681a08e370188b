//! Detects inputs that contain the same surface twice: a backup, or levels of detail beside a mesh.
//!
//! In: the files and folders of an input with their bounding boxes. Out: pairs with the same box. Adjacent tiles do not
//! have the same box; nor do parts of a mesh, unless each of them spans the mesh along all three axes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::base::Findings;
use crate::base::error::escape_path;
use crate::file::packed::RecordBounds;
use crate::model::StoredMesh;

/// Two boxes count as the same if, on each axis, their overlap is at least this share of their union.
const SAME_SHARE: f64 = 0.98;

/// Reports files and folders of a scanned mesh with the same bounding box, and which files have equal content.
pub(super) fn note_twins(files: &[PathBuf], hashes: &[u64], mesh: &StoredMesh, findings: &mut Findings) {
    let pieces = files.iter().zip(hashes).zip(&mesh.pieces).filter(|(_, piece)| !piece.faces.is_empty());
    note(pieces.map(|((path, &hash), piece)| (path.as_path(), piece.positions.bounds(), Some(hash))), findings);
}

/// The same by bounding boxes alone, for files that were not hashed.
pub fn note_twin_boxes(files: &[PathBuf], boxes: &[RecordBounds], findings: &mut Findings) {
    note(files.iter().zip(boxes).map(|(path, &bounds)| (path.as_path(), bounds, None)), findings);
}

fn note<'a>(files: impl Iterator<Item = (&'a Path, RecordBounds, Option<u64>)>, findings: &mut Findings) {
    let mut folders: BTreeMap<&Path, (RecordBounds, u64)> = BTreeMap::new();
    let mut places = Vec::new();
    for (path, bounds, hash) in files {
        places.push(TwinPlace { path, bounds, hash, is_folder: false });
        let (of_folder, count) = folders.entry(path.parent().unwrap_or(path)).or_default();
        of_folder.merge(&bounds);
        *count += 1;
    }
    let of_several = folders.into_iter().filter(|(_, (_, count))| *count > 1);
    places.extend(of_several.map(|(path, (bounds, _))| TwinPlace { path, bounds, hash: None, is_folder: true }));
    places.sort_by(|a, b| a.bounds.low[0].total_cmp(&b.bounds.low[0]).then(a.path.cmp(b.path)));
    for (first, place) in places.iter().enumerate() {
        let reached = places[first + 1..].iter().take_while(|other| other.bounds.low[0] <= place.bounds.high[0]);
        for other in reached.filter(|other| place.is_twin_of(other)) {
            let [a, b] = if place.path <= other.path { [place, other] } else { [other, place] };
            let [a_name, b_name] = [a, b].map(|place| escape_path(place.path));
            let words = if a.hash.is_some() && a.hash == b.hash {
                "are the same: leave one out with --exclude"
            } else {
                "fill the same space: if one is a copy or a level of detail of the other, --exclude leaves it out"
            };
            findings.note("doubled_surface", || format!("{a_name} and {b_name} {words}"));
        }
    }
}

/// A file, or a folder of several.
struct TwinPlace<'a> {
    path: &'a Path,
    bounds: RecordBounds,
    /// Hash of the content; `None` for a folder or if it is unknown.
    hash: Option<u64>,
    is_folder: bool,
}

impl TwinPlace<'_> {
    fn is_twin_of(&self, other: &Self) -> bool {
        let is_inside = |folder: &Self, file: &Self| folder.is_folder && file.path.parent() == Some(folder.path);
        !is_inside(self, other) && !is_inside(other, self) && are_same(&self.bounds, &other.bounds)
    }
}

fn are_same(a: &RecordBounds, b: &RecordBounds) -> bool {
    (0..3).all(|axis| {
        let common = a.high[axis].min(b.high[axis]) - a.low[axis].max(b.low[axis]);
        let both = a.high[axis].max(b.high[axis]) - a.low[axis].min(b.low[axis]);
        common >= SAME_SHARE * both
    })
}
