//! Reads the faces of a cluster, with their positions and texture coordinates.
//!
//! # Memory
//! 36 bytes per face, 24 bytes per vertex, 8 to 20 bytes per texcoord.

use std::collections::{HashMap, HashSet};

use glam::{DVec2, DVec3};

use super::Partition;
use super::texcoord_ids::texcoord_ids;
use crate::base::{Error, Result};
use crate::file::Segment;
use crate::geometry::position_key;
use crate::mesh::doubles::doubles;
use crate::mesh::id::{FaceId, LocalVertex};
use crate::mesh::polygon;
use crate::model::face::{POLYGON_CORNERS_MAX, repeats_vertex};
use crate::model::{Face, StoredMesh};

/// Largest span of a window while gathering, in records.
const GATHER_RECORDS: u64 = 64 << 10;
/// Faces per block of a cluster that is too heavy to load at once.
const PASS_FACES: usize = 64 << 10;
/// Faces of a cluster as read, with their positions and texture coordinates.
#[derive(Debug)]
pub struct ClusterFaces {
    /// Vertices are indices into `vertex_ids` and `positions`; texcoords are ids of the mesh.
    pub(super) faces: Vec<Face>,
    pub(super) positions: Vec<DVec3>,
    pub(super) degenerate: u64,
    pub(super) doubles: u64,
    pub(super) vertex_ids: Vec<u32>,
    pub(super) texcoord_ids: Vec<u32>,
    pub(super) texcoords: Vec<DVec2>,
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
        self.faces[face.index()].vertices.map(LocalVertex::new)
    }

    /// Positions of the corners of a face.
    pub fn triangle(&self, face: FaceId) -> [DVec3; 3] {
        self.vertices(face).map(|v| self.positions[v.index()])
    }

    /// Faces of a whole mesh in memory, whose ids are those of `positions` and `texcoords`. Welds vertices at
    /// bit-identical positions if `weld`; drops faces that repeat a vertex, and those that lie on an earlier one if
    /// `without_doubles`.
    pub fn whole(
        mut faces: Vec<Face>,
        positions: Vec<DVec3>,
        texcoords: Vec<DVec2>,
        weld: bool,
        without_doubles: bool,
    ) -> Self {
        if weld {
            let mut firsts = HashMap::with_capacity(positions.len());
            let first_of = |(vertex, &position)| *firsts.entry(position_key(position)).or_insert(vertex);
            let firsts: Vec<u32> = (0..).zip(&positions).map(first_of).collect();
            faces.iter_mut().for_each(|face| face.vertices = face.vertices.map(|v| firsts[v as usize]));
        }
        let before = faces.len();
        faces.retain(|face| !repeats_vertex(face.vertices));
        let degenerate = (before - faces.len()) as u64;
        let doubles = if without_doubles { drop_doubles(&mut faces) } else { 0 };
        let mut vertex_ids: Vec<u32> = faces.iter().flat_map(|face| face.vertices).collect();
        vertex_ids.sort_unstable();
        vertex_ids.dedup();
        let mut local = vec![0; positions.len()];
        (0..).zip(&vertex_ids).for_each(|(rank, &id)| local[id as usize] = rank);
        faces.iter_mut().for_each(|face| face.vertices = face.vertices.map(|v| local[v as usize]));
        let positions = vertex_ids.iter().map(|&id| positions[id as usize]).collect();
        let texcoord_ids = (0..texcoords.len() as u32).collect();
        Self { faces, positions, degenerate, doubles, vertex_ids, texcoord_ids, texcoords }
    }

    /// Keeps only these faces, given ascending; keeps all vertices and texcoords.
    pub fn keep(&mut self, faces: &[FaceId]) {
        self.faces = faces.iter().map(|&face| self.faces[face.index()]).collect();
    }
}

/// Reads a cluster from disk.
///
/// # Errors
/// On failed reads and damaged files.
pub fn read(partition: &Partition, mesh: &StoredMesh, cluster: usize) -> Result<ClusterFaces> {
    read_one_in(1, partition, mesh, cluster)
}

/// Reads one in `step` blocks of the faces of a cluster. Reads all of them if texture coordinates were copied to the
/// cells, because those are stored for all faces together.
///
/// # Errors
/// On failed reads and damaged files.
pub fn read_one_in(step: usize, partition: &Partition, mesh: &StoredMesh, cluster: usize) -> Result<ClusterFaces> {
    let step = if partition.texcoords.is_some() { 1 } else { step };
    let own = partition.numbering.starts[cluster]..partition.numbering.starts[cluster + 1];
    let texcoords = |ids: &[u32]| match &partition.texcoords {
        Some(brought) => brought.read(cluster),
        None => gather_texcoords(mesh, ids),
    };
    read_faces(partition, partition.faces.by_cell.to_vec(step, cluster)?, own, texcoords)
}

/// Reads the vertices and texcoords of faces; most vertices lie in the range `own` of partition ids.
pub(super) fn read_faces(
    partition: &Partition,
    mut faces: Vec<Face>,
    own: std::ops::Range<u32>,
    texcoords: impl Fn(&[u32]) -> Result<Vec<DVec2>>,
) -> Result<ClusterFaces> {
    let vertex_ids = vertex_ids(&faces, &own);
    let positions = partition.numbering.positions.gather(&vertex_ids)?;
    let own_count = vertex_ids.partition_point(|&id| id < own.end) - vertex_ids.partition_point(|&id| id < own.start);
    let mut local = LocalIds::new(&vertex_ids, &own, own_count);
    for face in &mut faces {
        face.vertices = face.vertices.map(|id| local.of(id));
    }
    drop(std::mem::take(&mut local));
    // NOTE: before triangulation, which may drop triangles: copied texcoords cover all faces of the cell.
    let texcoord_ids = texcoord_ids(&faces);
    let degenerate = triangulate_polygons(&mut faces, &positions);
    let doubles = if partition.drops_doubles { drop_doubles(&mut faces) } else { 0 };
    let texcoords = texcoords(&texcoord_ids)?;
    if texcoords.len() != texcoord_ids.len() {
        let path = partition.faces.by_cell.path().to_owned();
        let message = format!("{} texture coordinates for {} ids", texcoords.len(), texcoord_ids.len());
        return Err(Error::Damaged { path, message });
    }
    Ok(ClusterFaces { faces, positions, degenerate, doubles, vertex_ids, texcoord_ids, texcoords })
}

/// Passes the faces of a cluster to `take` in blocks of about [`PASS_FACES`]; does not split polygons.
pub(super) fn for_each_block(
    partition: &Partition,
    cluster: usize,
    mut take: impl FnMut(Vec<Face>) -> Result<()>,
) -> Result<()> {
    let mut pending: Vec<Face> = Vec::new();
    partition.faces.by_cell.read(cluster, |block| {
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
fn drop_doubles(faces: &mut Vec<Face>) -> u64 {
    let doubles = doubles(faces.iter().map(|face| face.vertices));
    let (mut dropped, mut all) = (doubles.iter().peekable(), FaceId::first(faces.len()));
    faces.retain(|_| all.next().is_some_and(|face| dropped.next_if_eq(&&face).is_none()));
    doubles.len() as u64
}

/// Ids of all vertices that faces use, ascending.
fn vertex_ids(faces: &[Face], own: &std::ops::Range<u32>) -> Vec<u32> {
    let mut own_used = vec![false; own.len()];
    let mut foreign = HashSet::new();
    for id in faces.iter().flat_map(|face| face.vertices) {
        if own.contains(&id) {
            own_used[(id - own.start) as usize] = true;
        } else {
            foreign.insert(id);
        }
    }
    // NOTE: sorted at once, so the order of the set does not affect the result.
    let mut ids: Vec<u32> = foreign.into_iter().collect();
    ids.sort_unstable();
    let at = ids.partition_point(|&id| id < own.start);
    let used = (0..own.len() as u32).filter(|&i| own_used[i as usize]).map(|i| own.start + i);
    ids.splice(at..at, used);
    ids
}

/// Maps partition ids to local ids.
#[derive(Debug, Default)]
struct LocalIds<'a> {
    ids: &'a [u32],
    own: std::ops::Range<u32>,
    of_own: Vec<u32>,
}

impl<'a> LocalIds<'a> {
    fn new(ids: &'a [u32], own: &std::ops::Range<u32>, own_count: usize) -> Self {
        let mut of_own = vec![u32::MAX; own.len()];
        let first = ids.partition_point(|&id| id < own.start);
        for (i, &id) in ids[first..first + own_count].iter().enumerate() {
            of_own[(id - own.start) as usize] = (first + i) as u32;
        }
        Self { ids, own: own.clone(), of_own }
    }

    fn of(&self, id: u32) -> u32 {
        match self.own.contains(&id) {
            true => self.of_own[(id - self.own.start) as usize],
            false => self.ids.partition_point(|&other| other < id) as u32,
        }
    }
}

/// Replaces the fans of polygons by triangulations; drops triangles that repeat a vertex and returns their number.
pub fn triangulate_polygons(faces: &mut Vec<Face>, positions: &[DVec3]) -> u64 {
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
        outline.extend(corners.iter().map(|&(v, _)| positions[v as usize]));
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
pub fn gather<T: bytemuck::Pod>(column: &Segment<T>, ids: &[u32]) -> Result<Vec<T>> {
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

/// Returns the texture coordinates at ascending ids of the mesh.
pub(super) fn gather_texcoords(mesh: &StoredMesh, ids: &[u32]) -> Result<Vec<DVec2>> {
    let mut out = Vec::with_capacity(ids.len());
    let (mut base, mut at) = (0u64, 0);
    for piece in &mesh.pieces {
        let end = at + ids[at..].partition_point(|&id| u64::from(id) < base + piece.texcoords.len());
        if end > at {
            let local: Vec<u32> = ids[at..end].iter().map(|&id| (u64::from(id) - base) as u32).collect();
            out.append(&mut piece.texcoords.gather(&local)?);
        }
        (base, at) = (base + piece.texcoords.len(), end);
    }
    Ok(out)
}
