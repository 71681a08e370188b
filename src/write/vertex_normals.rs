//! One normal per vertex, for formats whose vertices have them: the sum of the normals of the faces around it, each
//! times the angle of its corner there.
//!
//! In: pieces with positions. Out: unit normals; z for vertices without faces that have an area.
//!
//! # Memory
//! 24 bytes per shared vertex, and a piece: 12 bytes per face and 48 per own vertex.

use glam::DVec3;

use super::normals::{normal_of, touches_shared, vector};
use crate::base::Result;
use crate::base::id::TiVec;
use crate::model::corners::PieceCorners;
use crate::model::id::{PieceVertex, SharedVertex};
use crate::model::{StoredMesh, StoredPiece};

/// Memory of [`own_normals`] in bytes, including its result.
pub(super) fn own_normals_bytes(piece: &StoredPiece) -> u64 {
    12 * piece.faces.len() + 48 * piece.positions.len()
}

/// Normals of the shared vertices.
///
/// # Errors
/// If a file cannot be read.
pub(super) fn shared_normals(mesh: &StoredMesh) -> Result<Vec<DVec3>> {
    let mut sums: TiVec<SharedVertex, DVec3> = vec![DVec3::ZERO; mesh.shared_count() as usize].into();
    for piece in mesh.pieces.iter().filter(|piece| touches_shared(piece)) {
        let corners = PieceCorners::read(mesh, piece, true)?;
        add_corners(&corners, |vertex, normal| {
            if let Some(sum) = vertex.shared(corners.own).and_then(|shared| sums.get_mut(shared)) {
                *sum += normal;
            }
        });
    }
    Ok(units(sums.raw))
}

/// Normals of the own vertices of a piece, whose faces all lie in it.
///
/// # Errors
/// If a file cannot be read.
pub(super) fn own_normals(mesh: &StoredMesh, piece: &StoredPiece) -> Result<Vec<DVec3>> {
    let corners = PieceCorners::read(mesh, piece, false)?;
    let mut sums: TiVec<PieceVertex, DVec3> = vec![DVec3::ZERO; corners.own as usize].into();
    add_corners(&corners, |vertex, normal| {
        if let Some(sum) = sums.get_mut(vertex) {
            *sum += normal;
        }
    });
    Ok(units(sums.raw))
}

fn add_corners(corners: &PieceCorners, mut add: impl FnMut(PieceVertex, DVec3)) {
    for &face in &corners.faces {
        let (normal, angles) = normal_of(corners, face);
        for (vertex, angle) in face.into_iter().zip(angles) {
            add(vertex, vector(normal) * f64::from(angle));
        }
    }
}

fn units(sums: Vec<DVec3>) -> Vec<DVec3> {
    sums.into_iter().map(|sum| sum.try_normalize().unwrap_or(DVec3::Z)).collect()
}
