//! A simplified cluster as a piece of the next mesh.

use std::path::Path;

use glam::{DVec2, DVec3};

use super::Partition;
use super::cluster::ClusterSource;
use super::id::PartitionVertex;
use super::reading::gather;
use super::rounding::{Rounding, TakenPlaces, may_have_twins, round_to};
use super::texture_scale::TextureScale;
use crate::base::Result;
use crate::base::id::TiVec;
use crate::file::Segment;
use crate::mesh::cluster::{ClusterMesh, flag, rounded_up};
use crate::mesh::id::{LocalVertex, Wedge};
use crate::mesh::split::EdgePoint;
use crate::model::id::{PieceTexcoord, PieceVertex};
use crate::model::piece::{PendingPiece, PieceFile, write_piece};
use crate::model::{Catalogue, Face, StoredPiece};

/// The own vertices of a piece, in the cluster that it is made from.
type OwnVertices = TiVec<PieceVertex, LocalVertex>;

/// What a piece of the next stored mesh holds.
#[derive(Debug)]
pub struct PieceContent {
    positions: TiVec<PieceVertex, DVec3>,
    texcoords: TiVec<PieceTexcoord, DVec2>,
    colours: Option<Vec<[f32; 3]>>,
    faces: Vec<Face<PieceVertex>>,
}

impl PieceContent {
    /// Writes the piece as a file of its own.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn write(&self, path: &Path) -> Result<PendingPiece> {
        let Self { positions, texcoords, colours, faces } = self;
        write_piece(path, &positions.raw, &texcoords.raw, colours.as_deref(), faces)
    }

    /// Appends the piece to a file of several.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn put_in(&self, file: &mut PieceFile) -> Result<StoredPiece> {
        let Self { positions, texcoords, colours, faces } = self;
        file.put(&positions.raw, &texcoords.raw, colours.as_deref(), faces)
    }
}

impl ClusterSource {
    /// Returns the simplified mesh as a piece of the next stored mesh; `partition` is the one it was loaded from.
    ///
    /// If `max_error` (in units of length) bounds the deviation, the deviation of a face grows by the distance that
    /// rounding moves its corners: less than a sixtieth of `max_error`.
    ///
    /// # Errors
    /// On failed reads and damaged files.
    pub fn piece_of(
        &self,
        simplified: &ClusterMesh,
        partition: &Partition,
        catalogue: &Catalogue,
        scale: &TextureScale,
        max_error: Option<f64>,
    ) -> Result<PieceContent> {
        let own = own_vertices(simplified);
        let loaded = own.partition_point(|&vertex| vertex < self.vertex_ids.next_key());
        let own_ids: Vec<PartitionVertex> = own[..loaded].iter().map(|&vertex| self.vertex_ids[vertex]).collect();
        let rounding = Rounding { input_decimals: catalogue.position_decimals, max_error };
        let positions = self.positions_of(simplified, partition, rounding, &own, &own_ids)?;
        let colours = match &partition.numbering.colours {
            Some(colours) => {
                let mut own_colours = gather(colours, &own_ids)?;
                own_colours.extend(self.colours_on_edges(simplified, colours, &own.raw[loaded.index()..])?);
                Some(own_colours)
            }
            None => None,
        };
        let mut in_piece = simplified.per_vertex(PieceVertex::NONE);
        let mut shifts = simplified.per_vertex(0.0);
        for (vertex, &local) in own.iter_enumerated() {
            in_piece[local] = vertex;
            if max_error.is_some() && has_moved(simplified, local) {
                shifts[local] = positions[vertex].distance(simplified.positions[local] + self.origin);
            }
        }
        let own_count = own.len() as u32;
        let mut texcoord_of = simplified.per_wedge(PieceTexcoord::NONE);
        let mut texcoords = TiVec::with_capacity(own.len());
        let mut faces = Vec::with_capacity(simplified.corners.len());
        for (face, corners) in simplified.corners.iter_enumerated() {
            let part = simplified.parts[face];
            let locals = corners.map(|wedge| simplified.wedge_vertex[wedge]);
            let mut vertices = [PieceVertex::NONE; 3];
            for (vertex, local) in vertices.iter_mut().zip(locals) {
                *vertex = if simplified.is_shared(local) {
                    PieceVertex::of_shared(partition.faces.shared.rank(self.vertex_ids[local]), own_count)
                } else {
                    in_piece[local]
                };
            }
            let mut named = [PieceTexcoord::NONE; 3];
            for (named, &wedge) in named.iter_mut().zip(corners) {
                if texcoord_of[wedge] == PieceTexcoord::NONE && simplified.wedge_uv[wedge].is_finite() {
                    let texcoord = self.texcoord_of(simplified, catalogue, wedge, scale.of(catalogue, part));
                    texcoord_of[wedge] = texcoords.push_and_get_key(texcoord);
                }
                *named = texcoord_of[wedge];
            }
            let shift = locals.into_iter().map(|local| shifts[local]).fold(0.0, f64::max);
            let deviation = rounded_up(f64::from(simplified.deviations[face]) + shift);
            faces.push(Face { vertices, texcoords: named, part, continues_polygon: false, deviation });
        }
        Ok(PieceContent { positions, texcoords, colours, faces })
    }

    /// Interpolates the colours of vertices on edges from the two ends; if one end has no colour, takes that of the
    /// other.
    fn colours_on_edges(
        &self,
        simplified: &ClusterMesh,
        colours: &Segment<[f32; 3]>,
        vertices: &[LocalVertex],
    ) -> Result<Vec<[f32; 3]>> {
        let points: Vec<EdgePoint> = vertices.iter().map(|&vertex| self.point_of(simplified, vertex)).collect();
        let end_id = |end: LocalVertex| self.vertex_ids[end];
        let mut ids: Vec<PartitionVertex> = points.iter().flat_map(|point| point.ends.map(end_id)).collect();
        ids.sort_unstable();
        ids.dedup();
        let known = gather(colours, &ids)?;
        let colour_of = |end: LocalVertex| known[ids.partition_point(|&id| id < end_id(end))];
        let between = |point: EdgePoint| {
            let [a, b] = point.ends.map(colour_of);
            let mixed: [f32; 3] = std::array::from_fn(|k| a[k] + (b[k] - a[k]) * point.share as f32);
            [mixed, a, b].into_iter().find(|colour| !colour[0].is_nan()).unwrap_or(a)
        };
        Ok(points.into_iter().map(between).collect())
    }

    /// Where a vertex lies between loaded ones: on its edge if it was inserted into one, else at itself.
    fn point_of(&self, simplified: &ClusterMesh, vertex: LocalVertex) -> EdgePoint {
        // Loaded vertices come first, then vertices inserted into edges, then copies of either.
        let loaded = self.vertex_ids.len();
        let original = simplified.origin_of(vertex);
        match original.index().checked_sub(loaded) {
            Some(point) => self.points[point],
            None => EdgePoint { ends: [original; 2], share: 0.0 },
        }
    }

    /// Positions of the own vertices, of which the loaded ones have these ids: unmoved ones exactly as loaded, moved
    /// ones rounded.
    fn positions_of(
        &self,
        simplified: &ClusterMesh,
        partition: &Partition,
        rounding: Rounding,
        own: &OwnVertices,
        ids: &[PartitionVertex],
    ) -> Result<TiVec<PieceVertex, DVec3>> {
        let shortest_sq = shortest_edges_sq(simplified);
        let mut positions: TiVec<PieceVertex, DVec3> = partition.numbering.positions.gather(ids)?.into();
        // Vertices inserted into edges are flagged as moved, and get their positions below.
        positions.resize(own.len(), DVec3::NAN);
        let rounded = |vertex: LocalVertex| {
            let exact = simplified.positions[vertex] + self.origin;
            let decimals = rounding.decimals(shortest_sq[vertex].sqrt());
            (DVec3::from_array(exact.to_array().map(|x| round_to(x, decimals))), decimals)
        };
        let moved = || own.iter_enumerated().filter(|&(_, &local)| has_moved(simplified, local));
        let before = positions.clone();
        moved().for_each(|(vertex, &local)| positions[vertex] = rounded(local).0);
        if may_have_twins(&positions.raw) {
            let mut taken = TakenPlaces::new(before, |vertex| !has_moved(simplified, own[vertex]));
            for (vertex, &local) in moved() {
                let (place, decimals) = rounded(local);
                positions[vertex] = taken.place(vertex, place, decimals);
            }
        }
        Ok(positions)
    }

    /// Texture coordinate of a wedge in units of the file: as loaded, or unscaled and rounded if it moved.
    fn texcoord_of(&self, simplified: &ClusterMesh, catalogue: &Catalogue, wedge: Wedge, scale: f64) -> DVec2 {
        if !simplified.wedge_moved[wedge] {
            return self.texcoords[self.wedge_texcoord[wedge]];
        }
        let uv = simplified.wedge_uv[wedge] / scale;
        // NOTE: six decimals are a sixtieth of a texel of a 16K image.
        let decimals = catalogue.texcoord_decimals.max(6);
        DVec2::new(round_to(uv.x, decimals), round_to(uv.y, decimals))
    }
}

fn has_moved(mesh: &ClusterMesh, vertex: LocalVertex) -> bool {
    mesh.flags[vertex] & flag::MOVED != 0
}

/// Vertices that faces use and no other cluster shares, ascending: those of the next piece.
fn own_vertices(mesh: &ClusterMesh) -> OwnVertices {
    let mut are_used = mesh.per_vertex(false);
    for &wedge in mesh.corners.raw.as_flattened() {
        are_used[mesh.wedge_vertex[wedge]] = true;
    }
    are_used.keys().filter(|&vertex| are_used[vertex] && !mesh.is_shared(vertex)).collect()
}

/// Squared length of the shortest edge of each vertex.
fn shortest_edges_sq(mesh: &ClusterMesh) -> TiVec<LocalVertex, f64> {
    let mut shortest_sq = mesh.per_vertex(f64::INFINITY);
    for corners in &mesh.corners {
        let [a, b, c] = corners.map(|wedge| mesh.wedge_vertex[wedge]);
        for ends in [[a, b], [b, c], [c, a]] {
            let [from, to] = ends.map(|end| mesh.positions[end]);
            let length_sq = from.distance_squared(to);
            ends.into_iter().for_each(|end| shortest_sq[end] = shortest_sq[end].min(length_sq));
        }
    }
    shortest_sq
}
