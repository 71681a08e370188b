//! Clusters that are too heavy to load at once: their faces come block by block, and are not simplified.

use std::path::{Path, PathBuf};

use super::Partition;
use super::cluster::ClusterSource;
use super::id::{ClusterId, PartitionVertex};
use super::ranks::SortedIds;
use super::reading::{for_each_block, gather_texcoords, read_faces, triangulate_polygons, vertices_of};
use super::texcoord_ids::texcoord_ids;
use super::texture_scale::TextureScale;
use crate::base::Result;
use crate::base::id::{TiSlice, TiVec};
use crate::mesh::id::LocalVertex;
use crate::model::id::{PieceTexcoord, PieceVertex, Texcoord};
use crate::model::piece::write_piece;
use crate::model::{Catalogue, Face, StoredMesh, StoredPiece};

/// Loads a cluster block by block. Vertices are repeated in each block that uses them.
///
/// # Errors
/// On failed reads and damaged files, and those of `take`.
pub fn load_in_blocks(
    partition: &Partition,
    mesh: &StoredMesh,
    catalogue: &Catalogue,
    scale: &TextureScale,
    cluster: ClusterId,
    mut take: impl FnMut(ClusterSource) -> Result<()>,
) -> Result<()> {
    let none = PartitionVertex::new(0)..PartitionVertex::new(0);
    for_each_block(partition, cluster, |faces| {
        let texcoords = |ids: &[Texcoord]| gather_texcoords(mesh, ids);
        take(read_faces(partition, faces, none.clone(), texcoords)?.into_source(partition, catalogue, scale))
    })
}

/// Writes the faces of a cluster, one piece per block.
///
/// All its vertices are shared, so the pieces have no vertices of their own. Returns the pieces, and the number of
/// triangles of polygons that were dropped because they repeat a vertex.
///
/// # Errors
/// On a full disk, failed reads and writes, and damaged files.
pub fn pass_through(
    partition: &Partition,
    mesh: &StoredMesh,
    cluster: ClusterId,
    path: impl Fn(usize) -> PathBuf,
) -> Result<(Vec<StoredPiece>, u64)> {
    let (mut pieces, mut degenerate) = (Vec::new(), 0);
    for_each_block(partition, cluster, |faces| {
        let (piece, dropped) = pass_faces(partition, mesh, faces, &path(pieces.len()))?;
        pieces.extend(piece);
        degenerate += dropped;
        Ok(())
    })?;
    Ok((pieces, degenerate))
}

fn pass_faces(
    partition: &Partition,
    mesh: &StoredMesh,
    faces: Vec<Face<PartitionVertex>>,
    path: &Path,
) -> Result<(Option<StoredPiece>, u64)> {
    let (faces, degenerate) =
        if faces.iter().any(|face| face.continues_polygon) { triangulated(partition, faces)? } else { (faces, 0) };
    let texcoord_ids = texcoord_ids(&faces).raw;
    let texcoords = gather_texcoords(mesh, &texcoord_ids)?;
    let ranks = SortedIds::<PieceTexcoord, Texcoord>::new(TiSlice::from_ref(&texcoord_ids));
    let in_piece = |vertex| PieceVertex::of_shared(partition.faces.shared.rank(vertex), 0);
    let faces: Vec<_> =
        faces.into_iter().map(|face| face.translated(in_piece, |texcoord| ranks.of(texcoord))).collect();
    let colours = partition.numbering.colours.is_some().then_some(&[][..]);
    let piece =
        if faces.is_empty() { None } else { Some(write_piece(path, &[], &texcoords.raw, colours, &faces)?.commit()?) };
    Ok((piece, degenerate))
}

/// Triangulates the polygons; also returns the number of triangles that were dropped because they repeat a vertex.
fn triangulated(partition: &Partition, faces: Vec<Face<PartitionVertex>>) -> Result<(Vec<Face<PartitionVertex>>, u64)> {
    let vertices: TiVec<LocalVertex, PartitionVertex> = vertices_of(&faces).into();
    let positions: TiVec<LocalVertex, _> = partition.numbering.positions.gather(&vertices.raw)?.into();
    let local = |vertex: PartitionVertex| vertices.partition_point(|&other| other < vertex);
    let mut faces = faces.into_iter().map(|face| face.renumbered(local)).collect();
    let degenerate = triangulate_polygons(&mut faces, &positions);
    Ok((faces.into_iter().map(|face| face.renumbered(|v| vertices[v])).collect(), degenerate))
}
