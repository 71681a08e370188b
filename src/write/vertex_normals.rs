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
use crate::model::corners::PieceCorners;
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
    let mut sums = vec![DVec3::ZERO; mesh.shared_count() as usize];
    for piece in mesh.pieces.iter().filter(|piece| touches_shared(piece)) {
        let corners = PieceCorners::read(mesh, piece, true)?;
        add_corners(&corners, |vertex, normal| {
            if let Some(sum) = vertex.checked_sub(corners.own).and_then(|shared| sums.get_mut(shared as usize)) {
                *sum += normal;
            }
        });
    }
    Ok(units(sums))
}

/// Normals of the own vertices of a piece, whose faces all lie in it.
///
/// # Errors
/// If a file cannot be read.
pub(super) fn own_normals(mesh: &StoredMesh, piece: &StoredPiece) -> Result<Vec<DVec3>> {
    let corners = PieceCorners::read(mesh, piece, false)?;
    let mut sums = vec![DVec3::ZERO; corners.own as usize];
    add_corners(&corners, |vertex, normal| {
        if let Some(sum) = sums.get_mut(vertex as usize) {
            *sum += normal;
        }
    });
    Ok(units(sums))
}

fn add_corners(corners: &PieceCorners, mut add: impl FnMut(u32, DVec3)) {
    for face in corners.vertices.chunks_exact(3) {
        let (normal, angles) = normal_of(corners, face);
        for (&vertex, angle) in face.iter().zip(angles) {
            add(vertex, vector(normal) * f64::from(angle));
        }
    }
}

fn units(sums: Vec<DVec3>) -> Vec<DVec3> {
    sums.into_iter().map(|sum| sum.try_normalize().unwrap_or(DVec3::Z)).collect()
}
