//! Loads a cluster for simplification, and writes the result as a piece of the next mesh.
//!
//! # Memory
//! While loading: 32 bytes per face of the bucket and 8 to 12 bytes per texcoord, in addition to the mesh. Afterwards:
//! 4 bytes per vertex and 20 bytes per wedge, to map them back to the partition.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use super::Partition;
use super::ranks::SortedIds;
use super::reading::{ClusterFaces, for_each_block, gather, gather_texcoords, read, read_faces, triangulate_polygons};
use super::texcoord_ids::texcoord_ids;
use crate::base::Result;
use crate::base::id::TiVec;
use crate::file::Segment;
use crate::file::decimal::POWERS_OF_TEN;
use crate::geometry::position_key;
use crate::mesh::cluster::{ClusterMesh, flag, rounded_up};
use crate::mesh::id::{LocalVertex, Wedge};
use crate::mesh::split::EdgePoint;
use crate::model::id::PartId;
use crate::model::piece::{PendingPiece, write_piece};
use crate::model::{Catalogue, Face, NO_TEXCOORD, StoredMesh, StoredPiece};

/// Largest rounding error of a moved vertex, as a share of its shortest edge.
const ROUNDING_SHARE: f64 = 1e-3;
/// Largest unit of the last decimal of a moved coordinate, as a share of the bound on the error. Rounding and up to
/// [`STEPS_ASIDE_MAX`] units of shift then move a vertex by less than a sixtieth of the bound.
const BOUND_UNIT_SHARE: f64 = 1.0 / 1024.0;
/// Wedges of a vertex that are searched linearly; further ones are in a hash map.
const CHAIN_MAX: usize = 32;
/// Positions tried for a moved vertex whose own is taken.
const STEPS_ASIDE_MAX: u32 = 16;
/// Decimals from which a coordinate is not rounded.
const DECIMALS_MAX: u32 = POWERS_OF_TEN.len() as u32 - 1;

/// Faces of a material and their doubled areas.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MaterialArea {
    /// Number of faces.
    pub faces: u64,
    /// Doubled area in space of the faces that have texture coordinates.
    pub space: f64,
    /// Doubled area of the same faces in texture space.
    pub texture: f64,
}

impl std::ops::AddAssign for MaterialArea {
    fn add_assign(&mut self, other: Self) {
        self.faces += other.faces;
        self.space += other.space;
        self.texture += other.texture;
    }
}

/// Scale of texture coordinates per material; the last entry is for faces without material. See `cost::surface`.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct TextureScale {
    scales: Vec<f64>,
}

impl TextureScale {
    /// Computes the scales from areas by material; a material without area in space or in texture has scale 1.
    pub fn new(areas: &[MaterialArea]) -> Self {
        let scale = |area: &MaterialArea| {
            let scale = (area.space / area.texture).sqrt();
            if scale.is_normal() { scale } else { 1.0 }
        };
        Self { scales: areas.iter().map(scale).collect() }
    }

    /// Scale 1 for all materials.
    pub fn none(catalogue: &Catalogue) -> Self {
        Self { scales: vec![1.0; catalogue.materials.len() + 1] }
    }

    /// Reports whether a recalled value has a scale for each material.
    pub fn is_sound(&self, catalogue: &Catalogue) -> bool {
        self.scales.len() == catalogue.materials.len() + 1
    }

    /// Scale of the material of a part.
    pub fn of(&self, catalogue: &Catalogue, part: u32) -> f64 {
        self.scales[catalogue.material_index(part)]
    }
}

/// A loaded cluster, with the origin of its vertices and wedges in the partition.
#[derive(Debug)]
pub struct ClusterSource {
    /// The mesh, relative to `origin`.
    pub mesh: ClusterMesh,
    /// Position of the mesh's origin in space.
    pub origin: DVec3,
    /// Triangles of triangulated polygons that were dropped because they repeat a vertex.
    pub degenerate: u64,
    /// Faces dropped because an earlier face has the same vertices.
    pub doubles: u64,
    /// Partition id of each loaded vertex.
    vertex_ids: Vec<u32>,
    /// Index in `texcoords` of each wedge, or [`NO_TEXCOORD`].
    wedge_texcoord: TiVec<Wedge, u32>,
    texcoords: Vec<DVec2>,
    /// Vertices inserted into edges; their ids follow those of the loaded ones.
    points: Vec<EdgePoint>,
}

/// Loads a cluster.
///
/// # Errors
/// On failed reads and damaged files.
pub fn load(
    partition: &Partition,
    mesh: &StoredMesh,
    catalogue: &Catalogue,
    scale: &TextureScale,
    cluster: usize,
) -> Result<ClusterSource> {
    Ok(read(partition, mesh, cluster)?.into_source(partition, catalogue, scale))
}

/// Loads a cluster that is too heavy to load at once, block by block. Vertices are repeated in each block that uses
/// them.
///
/// # Errors
/// On failed reads and damaged files, and those of `take`.
pub fn load_in_blocks(
    partition: &Partition,
    mesh: &StoredMesh,
    catalogue: &Catalogue,
    scale: &TextureScale,
    cluster: usize,
    mut take: impl FnMut(ClusterSource) -> Result<()>,
) -> Result<()> {
    for_each_block(partition, cluster, |faces| {
        let texcoords = |ids: &[u32]| gather_texcoords(mesh, ids);
        take(read_faces(partition, faces, 0..0, texcoords)?.into_source(partition, catalogue, scale))
    })
}

/// Writes the faces of a cluster that is too heavy to load, one piece per block.
///
/// All its vertices are shared, so the pieces have no vertices of their own. Returns the pieces, and the number of
/// triangles of polygons that were dropped because they repeat a vertex.
///
/// # Errors
/// On a full disk, failed reads and writes, and damaged files.
pub fn pass_through(
    partition: &Partition,
    mesh: &StoredMesh,
    cluster: usize,
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
    mut faces: Vec<Face>,
    path: &Path,
) -> Result<(Option<StoredPiece>, u64)> {
    let mut ids: Vec<u32> = faces.iter().flat_map(|face| face.vertices).collect();
    ids.sort_unstable();
    ids.dedup();
    let local = |id: u32| ids.partition_point(|&other| other < id) as u32;
    let mut degenerate = 0;
    if faces.iter().any(|face| face.continues_polygon) {
        faces.iter_mut().for_each(|face| face.vertices = face.vertices.map(local));
        degenerate = triangulate_polygons(&mut faces, &partition.numbering.positions.gather(&ids)?);
        faces.iter_mut().for_each(|face| face.vertices = face.vertices.map(|v| ids[v as usize]));
    }
    let texcoord_ids = texcoord_ids(&faces);
    let texcoords = gather_texcoords(mesh, &texcoord_ids)?;
    let texcoord_ranks = SortedIds::new(&texcoord_ids);
    for face in &mut faces {
        face.vertices = face.vertices.map(|id| partition.faces.shared.rank(id));
        face.texcoords = face.texcoords.map(|id| if id == NO_TEXCOORD { id } else { texcoord_ranks.of(id) });
    }
    let colours = partition.numbering.colours.is_some().then_some(&[][..]);
    let piece = match faces.is_empty() {
        true => None,
        false => Some(write_piece(path, &[], &texcoords, colours, &faces)?.commit()?),
    };
    Ok((piece, degenerate))
}

impl ClusterFaces {
    /// Adds the areas of the faces in space and in texture to those of their materials.
    pub fn add_areas(&self, catalogue: &Catalogue, areas: &mut [MaterialArea]) {
        let ranks = SortedIds::new(&self.texcoord_ids);
        for face in &self.faces {
            let sum = &mut areas[catalogue.material_index(face.part)];
            sum.faces += 1;
            if face.texcoords.contains(&NO_TEXCOORD) {
                continue;
            }
            let corners = face.vertices.map(|v| self.positions[v as usize]);
            let uv = face.texcoords.map(|id| self.texcoords[ranks.of(id) as usize]);
            let texture = (uv[1] - uv[0]).perp_dot(uv[2] - uv[0]).abs();
            if texture.is_finite() {
                sum.space += (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
                sum.texture += texture;
            }
        }
    }

    /// Builds the mesh of the faces of a cluster; vertices that other clusters share are locked.
    pub fn into_source(self, partition: &Partition, catalogue: &Catalogue, scale: &TextureScale) -> ClusterSource {
        let are_shared: Vec<bool> = partition.faces.shared.contains_each(&self.vertex_ids).collect();
        self.build(are_shared, catalogue, scale)
    }

    /// Builds the mesh of faces that are a whole mesh.
    pub fn into_whole(self, catalogue: &Catalogue, scale: &TextureScale) -> ClusterSource {
        let are_shared = vec![false; self.vertex_ids.len()];
        self.build(are_shared, catalogue, scale)
    }

    fn build(
        self,
        are_shared: impl IntoIterator<Item = bool>,
        catalogue: &Catalogue,
        scale: &TextureScale,
    ) -> ClusterSource {
        let Self { faces, positions, degenerate, doubles, vertex_ids, texcoord_ids, texcoords } = self;
        let origin = positions.first().copied().unwrap_or(DVec3::ZERO);
        let mesh = ClusterMesh::default();
        let mut source = ClusterSource {
            mesh,
            origin,
            degenerate,
            doubles,
            vertex_ids,
            wedge_texcoord: TiVec::new(),
            texcoords,
            points: Vec::new(),
        };
        source.mesh.positions.reserve_exact(positions.len());
        source.mesh.flags.reserve_exact(positions.len());
        for (&position, shared) in positions.iter().zip(are_shared) {
            source.mesh.push_vertex(position - origin, if shared { flag::SHARED | flag::LOCKED } else { 0 });
        }
        source.add_faces(&faces, &texcoord_ids, catalogue, scale);
        source
    }
}

impl ClusterSource {
    fn add_faces(&mut self, faces: &[Face], texcoord_ids: &[u32], catalogue: &Catalogue, scale: &TextureScale) {
        let ranks = SortedIds::new(texcoord_ids);
        let mesh = &mut self.mesh;
        mesh.corners.reserve_exact(faces.len());
        mesh.parts.reserve_exact(faces.len());
        mesh.corner_vertices.reserve_exact(faces.len());
        mesh.deviations.reserve_exact(faces.len());
        mesh.is_turned.reserve_exact(faces.len());
        let mut first_wedge = mesh.per_vertex(Wedge::NONE);
        // For each wedge: the next wedge of the same vertex, and its material.
        let mut gathered: TiVec<Wedge, (Wedge, u32)> = TiVec::with_capacity(mesh.positions.len() * 5 / 4);
        // The last wedge that used each texture coordinate, which is usually the one wanted next.
        let mut recent = vec![Wedge::NONE; self.texcoords.len()];
        // Wedges of a vertex beyond the first [`CHAIN_MAX`]; only looked up, never iterated.
        let mut crowd: HashMap<(LocalVertex, u32, [u64; 2]), Wedge> = HashMap::new();
        for face in faces {
            let material = catalogue.material_index(face.part) as u32;
            let scale = scale.of(catalogue, face.part);
            let mut corners = [Wedge::NONE; 3];
            // By index: iterators over whole arrays would copy them.
            for (k, corner) in corners.iter_mut().enumerate() {
                let (vertex, id) = (LocalVertex::new(face.vertices[k]), face.texcoords[k]);
                let index = if id == NO_TEXCOORD { id } else { ranks.of(id) };
                let known = recent.get(index as usize).and_then(|wedge| wedge.some());
                if let Some(wedge) = known
                    && mesh.wedge_vertex[wedge] == vertex
                    && gathered[wedge].1 == material
                {
                    *corner = wedge;
                    continue;
                }
                let uv = self.texcoords.get(index as usize).map_or(DVec2::NAN, |&uv| uv * scale);
                let same = |w: Wedge| {
                    gathered[w].1 == material
                        && mesh.wedge_uv[w].to_array().map(f64::to_bits) == uv.to_array().map(f64::to_bits)
                };
                let (mut wedge, mut walked) = (first_wedge[vertex], 0);
                while wedge != Wedge::NONE && !same(wedge) {
                    wedge = gathered[wedge].0;
                    walked += 1;
                }
                let key = (vertex, material, uv.to_array().map(f64::to_bits));
                if wedge == Wedge::NONE && walked == CHAIN_MAX {
                    wedge = crowd.get(&key).copied().unwrap_or(Wedge::NONE);
                }
                if wedge == Wedge::NONE {
                    wedge = mesh.push_wedge(vertex, uv);
                    gathered.push((first_wedge[vertex], material));
                    match walked {
                        CHAIN_MAX => _ = crowd.insert(key, wedge),
                        _ => first_wedge[vertex] = wedge,
                    }
                    self.wedge_texcoord.push(index);
                }
                recent.get_mut(index as usize).into_iter().for_each(|recent| *recent = wedge);
                *corner = wedge;
            }
            let added = mesh.push_face(corners, PartId::new(face.part));
            mesh.deviations[added] = face.deviation;
        }
        mesh.link_wedges();
    }

    /// Partition ids of the loaded vertices.
    pub fn vertex_ids(&self) -> &[u32] {
        &self.vertex_ids
    }

    /// Texture coordinate of each wedge, by its rank among those of the faces; `None` where it has none.
    pub fn texcoord_ids(&self) -> TiVec<Wedge, Option<u32>> {
        self.wedge_texcoord.iter().map(|&id| (id != NO_TEXCOORD).then_some(id)).collect()
    }

    /// Registers vertices that were inserted into edges between loaded ones, in the order of their ids.
    pub fn adopt(&mut self, points: Vec<EdgePoint>) {
        self.points = points;
    }

    /// Partition id of a loaded vertex.
    pub fn vertex_id(&self, vertex: LocalVertex) -> u32 {
        self.vertex_ids[vertex.index()]
    }

    /// Writes the simplified mesh as a piece of the next stored mesh; `partition` is the one it was loaded from.
    ///
    /// If `max_error` (in units of length) bounds the deviation, the deviation of a face grows by the distance that
    /// rounding moves its corners: less than a sixtieth of `max_error`.
    ///
    /// # Errors
    /// On a full disk or failed reads and writes.
    pub fn write(
        &self,
        simplified: &ClusterMesh,
        partition: &Partition,
        catalogue: &Catalogue,
        scale: &TextureScale,
        max_error: Option<f64>,
        path: &Path,
    ) -> Result<PendingPiece> {
        let used = self.used_vertices(simplified);
        let loaded = used.partition_point(|&v| v.index() < self.vertex_ids.len());
        let own_ids: Vec<u32> = used[..loaded].iter().map(|&v| self.vertex_id(v)).collect();
        let rounding = Rounding { input_decimals: catalogue.position_decimals, max_error };
        let positions = self.positions_of(simplified, partition, rounding, &used, &own_ids)?;
        let colours = match &partition.numbering.colours {
            Some(colours) => {
                let mut own = gather(colours, &own_ids)?;
                own.extend(self.colours_on_edges(simplified, colours, &used[loaded..])?);
                Some(own)
            }
            None => None,
        };
        let mut piece_id = simplified.per_vertex(u32::MAX);
        let mut shifts = simplified.per_vertex(0.0);
        for (i, &v) in used.iter().enumerate() {
            piece_id[v] = i as u32;
            if max_error.is_some() && simplified.flags[v] & flag::MOVED != 0 {
                shifts[v] = positions[i].distance(simplified.positions[v] + self.origin);
            }
        }
        let own_count = used.len() as u32;
        let mut texcoord_id = simplified.per_wedge(NO_TEXCOORD);
        let mut texcoords = Vec::new();
        let mut faces = Vec::with_capacity(simplified.corners.len());
        for (face, corners) in simplified.corners.iter_enumerated() {
            let part = simplified.parts[face].number();
            let vertices = corners.map(|w| {
                let v = simplified.wedge_vertex[w];
                match simplified.is_shared(v) {
                    true => own_count + partition.faces.shared.rank(self.vertex_id(v)),
                    false => piece_id[v],
                }
            });
            for &w in corners {
                if texcoord_id[w] == NO_TEXCOORD && simplified.wedge_uv[w].is_finite() {
                    texcoord_id[w] = texcoords.len() as u32;
                    texcoords.push(self.texcoord_of(simplified, catalogue, w, scale.of(catalogue, part)));
                }
            }
            let texcoords = corners.map(|w| texcoord_id[w]);
            let shift = corners.map(|w| shifts[simplified.wedge_vertex[w]]);
            let deviation = rounded_up(f64::from(simplified.deviations[face]) + shift.into_iter().fold(0.0, f64::max));
            faces.push(Face { vertices, texcoords, part, continues_polygon: false, deviation });
        }
        write_piece(path, &positions, &texcoords, colours.as_deref(), &faces)
    }

    /// Vertices that faces use and no other cluster shares, ascending.
    fn used_vertices(&self, simplified: &ClusterMesh) -> Vec<LocalVertex> {
        let mut used = simplified.per_vertex(false);
        for &wedge in simplified.corners.iter().flatten() {
            used[simplified.wedge_vertex[wedge]] = true;
        }
        simplified.vertex_ids().filter(|&v| used[v] && !simplified.is_shared(v)).collect()
    }

    /// Interpolates the colours of vertices on edges from the two ends; if one end has no colour, takes that of the
    /// other.
    fn colours_on_edges(
        &self,
        simplified: &ClusterMesh,
        colours: &Segment<[f32; 3]>,
        vertices: &[LocalVertex],
    ) -> Result<Vec<[f32; 3]>> {
        // Ids: loaded vertices, then vertices inserted into edges, then copies of either.
        let origin_of = |v: LocalVertex| match v.index().checked_sub(self.vertex_ids.len() + self.points.len()) {
            Some(copy) => simplified.copied_from[copy],
            None => v,
        };
        let point_of = |&v: &LocalVertex| {
            let origin = origin_of(v);
            let point = origin.index().checked_sub(self.vertex_ids.len()).map(|point| self.points[point]);
            point.unwrap_or(EdgePoint { ends: [origin; 2], share: 0.0 })
        };
        let end_id = |end: LocalVertex| self.vertex_id(end);
        let mut ids: Vec<u32> = vertices.iter().flat_map(|v| point_of(v).ends.map(end_id)).collect();
        ids.sort_unstable();
        ids.dedup();
        let known = gather(colours, &ids)?;
        let colour_of = |end: LocalVertex| known[ids.partition_point(|&id| id < end_id(end))];
        let between = |v: &LocalVertex| {
            let EdgePoint { ends: [a, b], share } = point_of(v);
            let (a, b) = (colour_of(a), colour_of(b));
            let mixed: [f32; 3] = std::array::from_fn(|k| a[k] + (b[k] - a[k]) * share as f32);
            [mixed, a, b].into_iter().find(|colour| !colour[0].is_nan()).unwrap_or(a)
        };
        Ok(vertices.iter().map(between).collect())
    }

    /// Positions of the vertices `used`: unmoved ones exactly as loaded, moved ones rounded.
    fn positions_of(
        &self,
        simplified: &ClusterMesh,
        partition: &Partition,
        rounding: Rounding,
        used: &[LocalVertex],
        ids: &[u32],
    ) -> Result<Vec<DVec3>> {
        let mut shortest_sq = simplified.per_vertex(f64::INFINITY);
        for corners in &simplified.corners {
            let v = corners.map(|w| simplified.wedge_vertex[w]);
            for (a, b) in [(v[0], v[1]), (v[1], v[2]), (v[2], v[0])] {
                let length_sq = simplified.positions[a].distance_squared(simplified.positions[b]);
                for end in [a, b] {
                    shortest_sq[end] = shortest_sq[end].min(length_sq);
                }
            }
        }
        let mut positions = partition.numbering.positions.gather(ids)?;
        // Vertices inserted into edges are flagged as moved, and get their positions below.
        positions.resize(used.len(), DVec3::NAN);
        let rounded = |v: LocalVertex| {
            let exact = simplified.positions[v] + self.origin;
            let decimals = rounding.decimals(shortest_sq[v].sqrt());
            (DVec3::from_array(exact.to_array().map(|x| round_to(x, decimals))), decimals)
        };
        let moved = || (0..used.len()).filter(|&at| simplified.flags[used[at]] & flag::MOVED != 0);
        let before = positions.clone();
        moved().for_each(|at| positions[at] = rounded(used[at]).0);
        if may_have_twins(&positions) {
            let mut taken = Taken::new(before, |at| simplified.flags[used[at]] & flag::MOVED == 0);
            for at in moved() {
                let (place, decimals) = rounded(used[at]);
                positions[at] = taken.place(at, place, decimals);
            }
        }
        Ok(positions)
    }

    /// Texture coordinate of a wedge in units of the file: as loaded, or unscaled and rounded if it moved.
    fn texcoord_of(&self, simplified: &ClusterMesh, catalogue: &Catalogue, wedge: Wedge, scale: f64) -> DVec2 {
        if !simplified.wedge_moved[wedge] {
            return self.texcoords[self.wedge_texcoord[wedge] as usize];
        }
        let uv = simplified.wedge_uv[wedge] / scale;
        // NOTE: six decimals are a sixtieth of a texel of a 16K image.
        let decimals = catalogue.texcoord_decimals.max(6);
        DVec2::new(round_to(uv.x, decimals), round_to(uv.y, decimals))
    }
}

/// Rounding of the coordinates of moved vertices.
#[derive(Debug, Clone, Copy)]
struct Rounding {
    /// Largest number of decimals of a position in the input.
    input_decimals: u32,
    /// Largest allowed deviation in units of length; `None` if it is unbounded.
    max_error: Option<f64>,
}

impl Rounding {
    /// Decimals for a vertex whose shortest edge has length `shortest`.
    fn decimals(&self, shortest: f64) -> u32 {
        let bounded = self.max_error.map_or(f64::INFINITY, |most| BOUND_UNIT_SHARE * most);
        let step = (2.0 * ROUNDING_SHARE * shortest).min(bounded);
        // The decimals of the input, but no finer than a thousandth of what is needed: some exporters write 1e-05.
        self.input_decimals.min(decimals_for(step * 1e-3)).max(decimals_for(step))
    }
}

/// Positions in use. Two sheets of the same shape may simplify to the same positions, and would then seem joined.
struct Taken {
    /// Position of each vertex before it moved.
    before: Vec<DVec3>,
    /// One vertex at each position; only looked up, never iterated.
    at: HashMap<[u64; 3], usize>,
}

impl Taken {
    /// Marks the positions of the vertices that stay as taken.
    fn new(before: Vec<DVec3>, stays: impl Fn(usize) -> bool) -> Self {
        let staying =
            (0..before.len()).filter(|&vertex| stays(vertex)).map(|vertex| (position_key(before[vertex]), vertex));
        Self { at: staying.collect(), before }
    }

    /// Returns the position for a moved vertex: `wanted`, or if a vertex is there that was elsewhere before, a position
    /// shifted along x by one or more units of the last decimal. Falls back to `wanted` if all are taken.
    fn place(&mut self, vertex: usize, wanted: DVec3, decimals: u32) -> DVec3 {
        let unit = 1.0 / POWERS_OF_TEN[decimals.min(DECIMALS_MAX) as usize];
        let beside = (0..STEPS_ASIDE_MAX).map(|step| DVec3::new(wanted.x + f64::from(step) * unit, wanted.y, wanted.z));
        let rounded = beside.map(|place| DVec3::new(round_to(place.x, decimals), place.y, place.z));
        let was_together = |other: usize| self.before[other] == self.before[vertex];
        let mut free =
            rounded.filter(|&place| self.at.get(&position_key(place)).is_none_or(|&other| was_together(other)));
        let place = free.next().unwrap_or(wanted);
        self.at.insert(position_key(place), vertex);
        place
    }
}

/// Reports whether some of the positions may be equal; false is certain.
fn may_have_twins(positions: &[DVec3]) -> bool {
    let hash = |position: &DVec3| xxh3_64(bytemuck::bytes_of(&position_key(*position)));
    let mut hashes: Vec<u64> = positions.iter().map(hash).collect();
    hashes.sort_unstable();
    hashes.windows(2).any(|pair| pair[0] == pair[1])
}

/// Smallest number of decimals whose last unit is at most `step`.
fn decimals_for(step: f64) -> u32 {
    if step > 0.0 && step.is_finite() {
        (-libm::log10(step)).ceil().max(0.0).min(f64::from(DECIMALS_MAX)) as u32
    } else {
        0
    }
}

/// Rounds `x` to a number of decimals; returns `x` itself if doubles are coarser than that.
fn round_to(x: f64, decimals: u32) -> f64 {
    let factor = POWERS_OF_TEN[decimals.min(DECIMALS_MAX) as usize];
    let scaled = (x * factor).round();
    if decimals >= DECIMALS_MAX || scaled.abs() > 4e15 { x } else { scaled / factor }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_gives_the_decimals_asked_for() {
        assert_eq!(round_to(4_581_200.123_456_789, 3), 4_581_200.123);
        assert_eq!(round_to(0.1 + 0.2, 4), 0.3);
        assert_eq!(round_to(1e300, 3), 1e300);
        assert_eq!(decimals_for(0.002), 3);
        assert_eq!(decimals_for(0.0), 0);
    }

    #[test]
    fn rounding_leaves_room_below_a_bound() {
        let free = Rounding { input_decimals: 2, max_error: None };
        assert_eq!(free.decimals(50.0), 2);
        for max_error in [1e-6, 0.003, 0.5] {
            let decimals = Rounding { max_error: Some(max_error), ..free }.decimals(50.0);
            let unit = 1.0 / POWERS_OF_TEN[decimals as usize];
            assert!((f64::from(STEPS_ASIDE_MAX) + 0.5 * 3f64.sqrt()) * unit < max_error / 60.0);
        }
    }

    #[test]
    fn two_vertices_do_not_come_to_one_place_unless_they_were_at_one() {
        let before = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Y, DVec3::Z];
        assert!(may_have_twins(&before) && !may_have_twins(&before[..3]));
        let mut taken = Taken::new(before.to_vec(), |vertex| vertex == 0);
        assert_eq!(taken.place(1, DVec3::ZERO, 3), DVec3::new(0.001, 0.0, 0.0));
        assert_eq!(taken.place(4, DVec3::ZERO, 3), DVec3::new(0.002, 0.0, 0.0));
        let place = DVec3::splat(2.5);
        assert_eq!(taken.place(2, place, 3), place);
        assert_eq!(taken.place(3, place, 3), place);
    }

    #[test]
    fn the_scale_makes_texture_as_large_as_the_surface() {
        let area = MaterialArea { faces: 2, space: 400.0, texture: 1.0 };
        let scale = TextureScale::new(&[area, MaterialArea::default()]);
        assert_eq!(scale.scales, [20.0, 1.0]);
    }
}
