//! Moves the positions of the input to other coordinates while they are read, such as those of a map to a frame in metres.

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::arrays::ArraySource;
use super::obj::ObjSource;
use super::ply::PlySource;
use super::records::ParsedRecords;
use super::source::{CHUNK_BYTES, Cutter, MeshFormat, MeshSource};
use crate::base::{Error, Result};

/// Decimals of a moved position at least: tenths of a millimetre.
const MOVED_DECIMALS: u32 = 4;

/// Other coordinates for positions.
pub trait MovePositions: Sync {
    /// The other coordinates of a position: the same for the same position; `None` if it has none.
    fn moved(&self, position: DVec3) -> Option<DVec3>;
}

/// Moves the positions of a chunk.
pub(super) fn move_positions(records: &mut ParsedRecords, mover: &dyn MovePositions, path: &Path) -> Result<()> {
    for position in &mut records.positions {
        *position = mover.moved(*position).ok_or_else(|| {
            let DVec3 { x, y, z } = *position;
            Error::input(path, 0, format!("the vertex ({x}, {y}, {z}) has no place in these coordinates"))
        })?;
    }
    records.position_decimals = records.position_decimals.max(MOVED_DECIMALS);
    Ok(())
}

/// A position amid the first ones of some files: the median of each coordinate. `None` without vertices.
///
/// # Errors
/// The first fault of the input up to there.
pub fn typical_position(inputs: &[PathBuf]) -> Result<Option<DVec3>> {
    for (format, range) in MeshFormat::runs(inputs)? {
        let found = match format {
            MeshFormat::Obj => typical_of_run::<ObjSource>(&inputs[range])?,
            MeshFormat::Ply => typical_of_run::<PlySource>(&inputs[range])?,
            MeshFormat::Arrays => typical_of_run::<ArraySource>(&inputs[range])?,
        };
        if found.is_some() {
            return Ok(found);
        }
    }
    Ok(None)
}

fn typical_of_run<S: MeshSource>(inputs: &[PathBuf]) -> Result<Option<DVec3>> {
    let (mut parsed, mut text) = (S::Parsed::default(), Vec::new());
    for (file_index, cut) in Cutter::<S>::new(inputs, CHUNK_BYTES) {
        S::parse(&inputs[file_index], &mut cut?.chunk, &mut parsed, &mut text)?;
        let positions = &S::records(&mut parsed).positions;
        if !positions.is_empty() {
            return Ok(Some(median(positions)));
        }
        S::clear(&mut parsed);
    }
    Ok(None)
}

fn median(positions: &[DVec3]) -> DVec3 {
    let middle = |of: fn(&DVec3) -> f64| {
        let mut values: Vec<f64> = positions.iter().map(of).collect();
        let half = values.len() / 2;
        *values.select_nth_unstable_by(half, f64::total_cmp).1
    };
    DVec3::new(middle(|at| at.x), middle(|at| at.y), middle(|at| at.z))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::base::Silent;
    use crate::read::{ScanOptions, scan_moved};

    struct Shift;

    impl MovePositions for Shift {
        fn moved(&self, position: DVec3) -> Option<DVec3> {
            (position.x < 100.0).then_some(position + DVec3::new(0.5, 0.0, -1.0))
        }
    }

    #[test]
    fn positions_are_moved_in_either_format() {
        let folder = tempfile::tempdir().unwrap();
        let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 99 9 9\nf 1 2 3\n";
        let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                   element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
        for (name, text) in [("a.obj", obj), ("a.ply", ply)] {
            let path = folder.path().join(name);
            fs::write(&path, text).unwrap();
            let inputs = [path];
            assert_eq!(typical_position(&inputs).unwrap().map(|at| at.z), Some(0.0));
            let found = scan_moved(&inputs, folder.path(), &ScanOptions::default(), &Shift, &Silent).unwrap();
            let positions = &found.mesh.pieces[0].positions;
            let moved = positions.window(0..positions.len()).unwrap();
            assert_eq!(moved[1], DVec3::new(1.5, 0.0, -1.0));
            assert!(found.catalogue.position_decimals >= 4);
        }
    }

    #[test]
    fn a_vertex_without_a_place_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let inputs = [folder.path().join("a.obj")];
        fs::write(&inputs[0], "v 0 0 0\nv 500 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
        let error = scan_moved(&inputs, folder.path(), &ScanOptions::default(), &Shift, &Silent).unwrap_err();
        assert!(error.to_string().contains("(500, 0, 0)"), "{error}");
    }
}
