//! Reads the faces of a cluster, with their positions and texture coordinates.
//!
//! # Memory
//! 36 bytes per face, 24 bytes per vertex, 8 to 20 bytes per texcoord.

use std::collections::{HashMap, HashSet};
use std::ops::Range;

use foldhash::fast::RandomState;
use glam::{DVec2, DVec3};

use super::Partition;
use super::id::{ClusterId, ClusterTexcoord, PartitionVertex};
use super::texcoord_ids::texcoord_ids;
use crate::base::id::{Id, IdWindow, TiSlice, TiVec, numbers};
use crate::base::{Error, Result};
use crate::file::Segment;
use crate::geometry::position_key;
use crate::mesh::doubles::doubles;
use crate::mesh::id::{FaceId, LocalVertex};
use crate::mesh::polygon;
use crate::model::face::{POLYGON_CORNERS_MAX, repeats_vertex};
use crate::model::id::{FaceVertex, PieceTexcoord, Texcoord};
use crate::model::{Face, StoredMesh};

/// Largest span of a window while gathering, in records.
const GATHER_RECORDS: u64 = 64 << 10;
/// Faces per block of a cluster that is too heavy to load at once.
const PASS_FACES: usize = 64 << 10;

/// Faces of a cluster as read, with their positions and texture coordinates.
#[derive(Debug)]
pub struct ClusterFaces {
    pub(super) faces: TiVec<FaceId, Face<LocalVertex>>,
    pub(super) positions: TiVec<LocalVertex, DVec3>,
    pub(super) degenerate: u64,
    pub(super) doubles: u64,
    /// Vertices in the partition, ascending.
    pub(super) vertex_ids: TiVec<LocalVertex, PartitionVertex>,
    /// Texture coordinates that the faces name, ascending.
    pub(super) texcoord_ids: TiVec<ClusterTexcoord, Texcoord>,
    pub(super) texcoords: TiVec<ClusterTexcoord, DVec2>,
}

impl ClusterFaces {
    /// Number of faces.
    pub fn face_count(&self) -> usize {
        self.faces.len()
    }

    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.positions.len()
    }

    /// Vertices of a face.
    pub fn vertices(&self, face: FaceId) -> [LocalVertex; 3] {
        self.faces[face].vertices
    }

    /// Positions of the corners of a face.
    #[inline]
    pub fn triangle(&self, face: FaceId) -> [DVec3; 3] {
        self.triangle_of(&self.faces[face])
    }

    /// Positions of the corners of one of the faces.
    #[inline]
    pub(super) fn triangle_of(&self, face: &Face<LocalVertex>) -> [DVec3; 3] {
        let [a, b, c] = face.vertices;
        [self.positions[a], self.positions[b], self.positions[c]]
    }

    /// Faces of a whole mesh in memory, by its own ids. Welds vertices at
    /// bit-identical positions if `weld`; drops faces that repeat a vertex, and those that lie on an earlier one if
    /// `without_doubles`.
    pub fn whole(
        mut faces: Vec<Face<PartitionVertex>>,
        positions: &TiSlice<PartitionVertex, DVec3>,
        texcoords: Vec<DVec2>,
        weld: bool,
        without_doubles: bool,
    ) -> Self {
        if weld {
            let mut firsts = HashMap::with_capacity_and_hasher(positions.len(), RandomState::default());
            let first_of = |(vertex, &position)| *firsts.entry(position_key(position)).or_insert(vertex);
            let firsts: TiVec<PartitionVertex, PartitionVertex> = positions.iter_enumerated().map(first_of).collect();
            faces.iter_mut().for_each(|face| face.vertices = face.vertices.map(|v| firsts[v]));
        }
        let before = faces.len();
        faces.retain(|face| !repeats_vertex(face.vertices));
        let degenerate = (before - faces.len()) as u64;
        let doubles = if without_doubles { drop_doubles(&mut faces) } else { 0 };
        let vertex_ids: TiVec<LocalVertex, PartitionVertex> = vertices_of(&faces).into();
        let mut local: TiVec<PartitionVertex, LocalVertex> = vec![LocalVertex::NONE; positions.len()].into();
        vertex_ids.iter_enumerated().for_each(|(rank, &vertex)| local[vertex] = rank);
        let faces = faces.into_iter().map(|face| face.renumbered(|v| local[v])).collect();
        let positions = vertex_ids.iter().map(|&vertex| positions[vertex]).collect();
        let texcoord_ids = Texcoord::first(texcoords.len()).collect();
        Self { faces, positions, degenerate, doubles, vertex_ids, texcoord_ids, texcoords: texcoords.into() }
    }

    /// Keeps only these faces, given ascending; keeps all vertices and texcoords.
    pub fn keep(&mut self, faces: &[FaceId]) {
        self.faces = faces.iter().map(|&face| self.faces[face]).collect();
    }
}

/// Reads a cluster from disk.
///
/// # Errors
/// On failed reads and damaged files.
pub fn read(partition: &Partition, mesh: &StoredMesh, cluster: ClusterId) -> Result<ClusterFaces> {
    read_one_in(1, partition, mesh, cluster)
}

/// Reads one in `step` runs of the faces of a cluster. Reads all of them if texture coordinates were copied to the
/// clusters, because those are stored for all faces together.
///
/// # Errors
/// On failed reads and damaged files.
pub fn read_one_in(step: usize, partition: &Partition, mesh: &StoredMesh, cluster: ClusterId) -> Result<ClusterFaces> {
    let step = if partition.texcoords.is_some() { 1 } else { step };
    let texcoords = |ids: &[Texcoord]| match &partition.texcoords {
        Some(brought) => brought.read(cluster),
        None => gather_texcoords(mesh, ids),
    };
    let faces = partition.faces.by_cluster.to_vec(step, cluster)?;
    read_faces(partition, faces, partition.numbering.vertices_of(cluster), texcoords)
}

/// Reads the vertices and texcoords of faces; most vertices lie in the range `own`.
pub(super) fn read_faces(
    partition: &Partition,
    faces: Vec<Face<PartitionVertex>>,
    own: Range<PartitionVertex>,
    texcoords: impl Fn(&[Texcoord]) -> Result<TiVec<ClusterTexcoord, DVec2>>,
) -> Result<ClusterFaces> {
    let vertex_ids = mostly_own_vertices_of(&faces, &own);
    let positions: TiVec<LocalVertex, DVec3> = partition.numbering.positions.gather(&vertex_ids.raw)?.into();
    let local = LocalVertices::new(&vertex_ids, &own);
    let mut faces: Vec<Face<LocalVertex>> = faces.into_iter().map(|face| face.renumbered(|v| local.of(v))).collect();
    drop(local);
    // NOTE: before triangulation, which may drop triangles: copied texcoords cover all faces of the cluster.
    let texcoord_ids = texcoord_ids(&faces);
    let degenerate = triangulate_polygons(&mut faces, &positions);
    let doubles = if partition.drops_doubles { drop_doubles(&mut faces) } else { 0 };
    let texcoords = texcoords(&texcoord_ids.raw)?;
    if texcoords.len() != texcoord_ids.len() {
        let path = partition.faces.by_cluster.path().to_owned();
        let message = format!("{} texture coordinates for {} ids", texcoords.len(), texcoord_ids.len());
        return Err(Error::Damaged { path, message });
    }
    let faces = faces.into();
    Ok(ClusterFaces { faces, positions, degenerate, doubles, vertex_ids, texcoord_ids, texcoords })
}

/// Passes the faces of a cluster to `take` in blocks of about [`PASS_FACES`]; does not split polygons.
pub(super) fn for_each_block(
    partition: &Partition,
    cluster: ClusterId,
    mut take: impl FnMut(Vec<Face<PartitionVertex>>) -> Result<()>,
) -> Result<()> {
    let mut pending = Vec::new();
    partition.faces.by_cluster.read(cluster, |block| {
        for &face in block {
            if pending.len() >= PASS_FACES && !face.continues_polygon {
                take(std::mem::take(&mut pending))?;
            }
            pending.push(face);
        }
        Ok(())
    })?;
    take(pending)
}

/// Drops faces with the same vertices as an earlier one; returns their number.
fn drop_doubles<V: FaceVertex>(faces: &mut Vec<Face<V>>) -> u64 {
    let doubles = doubles(faces.iter().map(|face| face.vertices));
    let (mut dropped, mut all) = (doubles.iter().peekable(), FaceId::first(faces.len()));
    faces.retain(|_| all.next().is_some_and(|face| dropped.next_if_eq(&&face).is_none()));
    doubles.len() as u64
}

/// All vertices of faces, ascending.
pub(super) fn vertices_of<V: FaceVertex>(faces: &[Face<V>]) -> Vec<V> {
    let mut vertices: Vec<V> = faces.iter().flat_map(|face| face.vertices).collect();
    vertices.sort_unstable();
    vertices.dedup();
    vertices
}

/// The same, if most of them lie in the range `own`.
fn mostly_own_vertices_of(
    faces: &[Face<PartitionVertex>],
    own: &Range<PartitionVertex>,
) -> TiVec<LocalVertex, PartitionVertex> {
    let mut are_used = IdWindow::filled(own, false);
    let mut foreign = HashSet::new();
    for face in faces {
        for vertex in face.vertices {
            match are_used.get_mut(vertex) {
                Some(is_used) => *is_used = true,
                None => _ = foreign.insert(vertex),
            }
        }
    }
    // NOTE: sorted at once, so the order of the set does not affect the result.
    let mut vertices: Vec<PartitionVertex> = foreign.into_iter().collect();
    vertices.sort_unstable();
    let at = vertices.partition_point(|&vertex| vertex < own.start);
    let used = are_used.iter().filter(|(_, is_used)| **is_used).map(|(vertex, _)| vertex);
    vertices.splice(at..at, used);
    vertices.into()
}

/// What vertices of the partition are in a cluster.
#[derive(Debug)]
struct LocalVertices<'a> {
    vertex_ids: &'a TiSlice<LocalVertex, PartitionVertex>,
    of_own: IdWindow<PartitionVertex, LocalVertex>,
}

impl<'a> LocalVertices<'a> {
    /// Of a cluster with these vertices, most of which lie in the range `own`.
    fn new(vertex_ids: &'a TiSlice<LocalVertex, PartitionVertex>, own: &Range<PartitionVertex>) -> Self {
        let mut of_own = IdWindow::filled(own, LocalVertex::NONE);
        let first = vertex_ids.partition_point(|&vertex| vertex < own.start);
        let end = vertex_ids.partition_point(|&vertex| vertex < own.end);
        for local in LocalVertex::within(&(first..end)) {
            of_own[vertex_ids[local]] = local;
        }
        Self { vertex_ids, of_own }
    }

    fn of(&self, vertex: PartitionVertex) -> LocalVertex {
        match self.of_own.get(vertex) {
            Some(&local) => local,
            None => self.vertex_ids.partition_point(|&other| other < vertex),
        }
    }
}

/// Replaces the fans of polygons by triangulations; drops triangles that repeat a vertex and returns their number.
pub fn triangulate_polygons<V: FaceVertex>(faces: &mut Vec<Face<V>>, positions: &TiSlice<V, DVec3>) -> u64 {
    if !faces.iter().any(|face| face.continues_polygon) {
        return 0;
    }
    let mut dropped = 0;
    let mut out = Vec::with_capacity(faces.len());
    let (mut corners, mut outline, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
    let mut at = 0;
    while at < faces.len() {
        let more = faces[at + 1..].iter().take(POLYGON_CORNERS_MAX).take_while(|face| face.continues_polygon).count();
        let fan = &faces[at..=at + more];
        at += more + 1;
        let first = fan[0];
        corners.clear();
        corners.extend((0..2).map(|k| (first.vertices[k], first.texcoords[k])));
        corners.extend(fan.iter().map(|face| (face.vertices[2], face.texcoords[2])));
        outline.clear();
        outline.extend(corners.iter().map(|&(v, _)| positions.raw[v.index()]));
        polygon::triangulate(&outline, &mut triangles);
        for triangle in &triangles {
            let pick = triangle.map(|i| corners[i]);
            let vertices = pick.map(|(v, _)| v);
            if repeats_vertex(vertices) {
                dropped += 1;
                continue;
            }
            out.push(Face { vertices, texcoords: pick.map(|(_, t)| t), continues_polygon: false, ..first });
        }
    }
    *faces = out;
    dropped
}

/// Returns the records at ascending ids, read through windows of bounded size.
///
/// # Errors
/// On failed reads.
pub fn gather<T: bytemuck::Pod>(column: &Segment<T>, ids: &[impl Id]) -> Result<Vec<T>> {
    let ids = numbers(ids);
    let mut out = Vec::with_capacity(ids.len());
    let mut at = 0;
    while at < ids.len() {
        let start = u64::from(ids[at]);
        let end = at + ids[at..].partition_point(|&id| u64::from(id) < start + GATHER_RECORDS);
        let window = column.window(start..u64::from(ids[end - 1]) + 1)?;
        out.extend(ids[at..end].iter().map(|&id| window[(u64::from(id) - start) as usize]));
        at = end;
    }
    Ok(out)
}

/// Returns ascending texture coordinates of the mesh.
pub(super) fn gather_texcoords(mesh: &StoredMesh, ids: &[Texcoord]) -> Result<TiVec<ClusterTexcoord, DVec2>> {
    let mut out = TiVec::with_capacity(ids.len());
    let (mut base, mut at) = (0u64, 0);
    for piece in &mesh.pieces {
        let end = at + ids[at..].partition_point(|&id| u64::from(id.number()) < base + piece.texcoords.len());
        if end > at {
            let first = Texcoord::new(base as u32);
            let of_piece: Vec<_> = ids[at..end].iter().map(|&id| PieceTexcoord::from(id.since(first))).collect();
            out.extend(piece.texcoords.gather(&of_piece)?);
        }
        base += piece.texcoords.len();
        at = end;
    }
    Ok(out)
}
