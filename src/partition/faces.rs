//! Distributes faces to clusters, and marks the vertices that several clusters use.
//!
//! A triangle goes to the cluster of the cell of most of its corners (the smallest id of three), a polygon to that of
//! its first corner, because it must stay whole until it is triangulated. Every corner that lies in another cell is
//! *shared*.
//!
//! Old ids are looked up window by window of the numbering, so that a shuffled file causes no random access. Blocks of
//! faces that need one window are looked up as they are read, if the order of the file is such that windows rarely
//! change. The ids of other blocks are looked up beforehand, window by window, and kept in a temporary file of 12 bytes
//! per face.

use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use super::file_names::FileNames;
use super::id::{ClusterId, PartitionVertex, WindowId};
use super::numbering::{Numbering, VertexRanks};
use super::options::PartitionOptions;
use super::shared::Shared;
use super::stretches::{ClusterStretch, NamedStretches, SeenStretches};
use super::weight::RecentWedges;
use crate::base::id::{IdWindow, TiVec};
use crate::base::ordered::map_in_order;
use crate::base::{Error, Findings, Result, lock};
use crate::file::buckets::{BucketWriter, Buckets, Sorted};
use crate::model::face::{FaceBlock, repeats_vertex};
use crate::model::id::{FaceVertex, MeshVertex, Texcoord};
use crate::model::stored_mesh::PieceNumbering;
use crate::model::{Face, StoredMesh, StoredPiece};
use crate::os::system::{read_exact_at, write_all_at};

/// Faces by cluster, and the vertices shared by several clusters.
#[derive(Debug, Serialize, Deserialize)]
pub struct ClusteredFaces {
    /// Faces of each cluster.
    pub by_cluster: Buckets<Face<PartitionVertex>, ClusterId>,
    /// Vertices used by several clusters.
    pub shared: Shared,
    /// Corners of the faces of each cluster that lie in other cells.
    pub foreign_corners: TiVec<ClusterId, u64>,
    /// Upper bound on the wedges of each cluster.
    pub wedges: TiVec<ClusterId, u64>,
    /// Stretches of texture coordinates that the faces of each cluster refer to.
    #[serde(skip)]
    pub stretches: NamedStretches,
}

/// Largest mean number of window changes per window with which windows are loaded on demand.
const WINDOW_CHANGES_MAX: u64 = 4;
/// Mean number of windows per block above which two windows are looked up at once, since each lookup reads the block
/// again.
const MANY_WINDOWS: usize = 4;
/// Bytes per face in the file of corners.
const CORNERS_BYTES: u64 = size_of::<[PartitionVertex; 3]>() as u64;

impl ClusteredFaces {
    /// Marks all vertices of some ranges as shared, because the faces of their cells will be spread over several
    /// pieces.
    pub fn share_all(&mut self, ranges: impl Iterator<Item = Range<PartitionVertex>>) {
        ranges.for_each(|vertices| self.shared.insert_all(vertices));
    }
}

/// A block of faces, with the numbering of its piece.
#[derive(Debug, Clone, Copy)]
struct Job<'a> {
    /// Index among all blocks.
    index: usize,
    piece: &'a StoredPiece,
    numbering: PieceNumbering,
    block: &'a FaceBlock,
    /// Number of faces in earlier blocks.
    first: u64,
    /// The window of the numbering with all its vertices, if they are looked up on demand.
    window: Option<WindowId>,
}

impl Job<'_> {
    fn read(&self) -> Result<Vec<Face<MeshVertex>>> {
        self.read_as(|face| face)
    }

    /// Reads its faces, each turned into another numbering by `renumbered`.
    fn read_as<V: FaceVertex>(&self, mut renumbered: impl FnMut(Face<MeshVertex>) -> Face<V>) -> Result<Vec<Face<V>>> {
        let (mut bytes, mut faces) = (Vec::new(), Vec::new());
        self.piece.faces.read_block(&self.piece.faces.open()?, self.block, &mut bytes, &mut faces)?;
        let vertices = self.numbering.vertex_base.plus(self.numbering.own);
        let texcoords = self.numbering.texcoord_base.plus(self.piece.texcoords.len() as u32);
        let mut out = Vec::with_capacity(faces.len());
        for face in &faces {
            let is_of_block = face.vertices.iter().all(|v| self.block.vertices.contains(v));
            let face = self.numbering.globalise(face);
            if !is_of_block
                || face.vertices.iter().any(|&v| v >= vertices)
                || face.named_texcoords().any(|t| t >= texcoords)
            {
                let message = "a face names a vertex or texture coordinate that is not there".to_owned();
                return Err(Error::Damaged { path: self.piece.faces.path().to_owned(), message });
            }
            out.push(renumbered(face));
        }
        Ok(out)
    }

    /// The window of the numbering that contains all its vertices; `None` if it needs several.
    fn only_window(&self, ranks: &VertexRanks) -> Option<WindowId> {
        let mut windows = self.windows(ranks);
        windows.next().filter(|_| windows.next().is_none())
    }

    /// The windows of the numbering that its faces may refer to.
    fn windows(&self, ranks: &VertexRanks) -> impl Iterator<Item = WindowId> {
        let all = WindowId::first(ranks.window_count() as usize);
        all.filter(|&window| self.may_touch(&ranks.vertices_of(&(window..window.plus(1)))))
    }

    /// Reports whether a face of the block may refer to a vertex in a range.
    fn may_touch(&self, range: &Range<MeshVertex>) -> bool {
        self.numbering.vertices(&self.block.vertices).any(|own| own.start < range.end && range.start < own.end)
    }
}

/// Distributes the faces of a mesh to cells.
///
/// # Errors
/// On a full disk, failed reads and writes, and damaged files.
pub(super) fn distribute(
    mesh: &StoredMesh,
    numbering: &Numbering,
    ranks: &VertexRanks,
    names: FileNames<'_>,
    options: &PartitionOptions,
    findings: &mut Findings,
) -> Result<ClusteredFaces> {
    let mut jobs = Vec::new();
    let mut first = 0;
    for (piece, numbering) in mesh.pieces.iter().zip(mesh.numbering()?) {
        for block in piece.faces.blocks() {
            jobs.push(Job { index: jobs.len(), piece, numbering, block, first, window: None });
            first += u64::from(block.faces);
        }
    }
    if ranks.window_count() > 1 {
        jobs.iter_mut().for_each(|job| job.window = job.only_window(ranks));
        let changes = jobs.windows(2).filter(|pair| pair[0].window != pair[1].window).count();
        if changes as u64 > u64::from(ranks.window_count()) * WINDOW_CHANGES_MAX {
            jobs.iter_mut().for_each(|job| job.window = None);
        }
    }
    let waiting: Vec<Job<'_>> = jobs.iter().copied().filter(|job| job.window.is_none()).collect();
    let looked_up = match ranks.whole() {
        Some(_) => None,
        None => {
            let corners = Corners::create(&names.path("corners.tmp"), jobs.len(), first)?;
            corners.look_up(&waiting, ranks, options)?;
            Some(corners)
        }
    };
    let loaded = LoadedWindow::default();
    let mut by_cluster = BucketWriter::create(&names.path("faces.buckets"), numbering.cell_count())?;
    let mut shared = Shared::default();
    let mut foreign_corners: TiVec<ClusterId, u64> = vec![0; numbering.cell_count()].into();
    let mut wedges = foreign_corners.clone();
    let mut stretches = NamedStretches::new(mesh.texcoord_count());
    let mut degenerate = 0;
    map_in_order(
        jobs.iter().copied(),
        options.threads,
        options.threads * 2,
        |job| {
            let mut faces: Vec<Face<PartitionVertex>> = if let Some(window) = job.window {
                let ranks = loaded.get(ranks, window)?;
                job.read_as(|face| face.renumbered(|v| ranks[v]))?
            } else if let Some(corners) = &looked_up {
                let mut found = corners.read(&job, job.block.faces as usize)?.into_iter();
                job.read_as(|face| face.with_vertices(found.next().unwrap_or_default()))?
            } else {
                let ranks = ranks.whole().unwrap_or_default();
                job.read_as(|face| face.renumbered(|v| ranks[v]))?
            };
            if options.drop_texcoords {
                faces.iter_mut().for_each(|face| face.texcoords = [Texcoord::NONE; 3]);
            }
            Ok(assign(faces, numbering))
        },
        |assigned: AssignedFaces| {
            degenerate += assigned.degenerate;
            for corner in assigned.foreign_corners {
                shared.insert(corner.vertex);
                foreign_corners[corner.cluster] += 1;
            }
            for run in assigned.wedges {
                wedges[run.cluster] += u64::from(run.count);
            }
            stretches.add(assigned.stretches);
            by_cluster.append(assigned.faces)
        },
    )?;
    findings.count("degenerate_faces", degenerate);
    Ok(ClusteredFaces { by_cluster: by_cluster.finish_durable()?, shared, foreign_corners, wedges, stretches })
}

/// Result of assigning a block of faces.
struct AssignedFaces {
    faces: Sorted<Face<PartitionVertex>, ClusterId>,
    foreign_corners: Vec<ForeignCorner>,
    wedges: Vec<WedgeRun>,
    /// Stretches of texture coordinates that the faces refer to.
    stretches: Vec<ClusterStretch>,
    degenerate: u64,
}

/// A corner in another cell than its face.
struct ForeignCorner {
    /// Cluster of the face.
    cluster: ClusterId,
    vertex: PartitionVertex,
}

/// Consecutive faces of one cluster.
struct WedgeRun {
    cluster: ClusterId,
    /// Upper bound on their wedges.
    count: u32,
}

/// Chooses the cluster of each face of a block; drops triangles that repeat a vertex.
fn assign(mut faces: Vec<Face<PartitionVertex>>, numbering: &Numbering) -> AssignedFaces {
    let mut clusters: Vec<ClusterId> = Vec::with_capacity(faces.len());
    let (mut foreign_corners, mut wedges, mut degenerate) = (Vec::new(), Vec::new(), 0);
    let mut stretches = SeenStretches::new();
    let mut recent_wedges = RecentWedges::default();
    let mut last = (ClusterId::NONE, PartitionVertex::NONE..PartitionVertex::NONE);
    let mut cell_of = |vertex: PartitionVertex| {
        if !last.1.contains(&vertex) {
            let cell = numbering.cell_of(vertex);
            last = (cell, numbering.vertices_of(cell));
        }
        last.0
    };
    for i in 0..faces.len() {
        let face = &faces[i];
        let is_polygon = face.continues_polygon || faces.get(i + 1).is_some_and(|next| next.continues_polygon);
        if !is_polygon && repeats_vertex(face.vertices) {
            degenerate += 1;
            continue;
        }
        let [a, b, c] = face.vertices;
        let cells = [cell_of(a), cell_of(b), cell_of(c)];
        let cluster = match cells {
            [first, ..] if is_polygon => first,
            [_, b, c] if b == c => b,
            [a, b, c] if a == b || a == c => a,
            [a, b, c] => a.min(b).min(c),
        };
        for (k, &cell) in cells.iter().enumerate() {
            if cell != cluster {
                foreign_corners.push(ForeignCorner { cluster, vertex: face.vertices[k] });
            }
            stretches.see(cluster, face.texcoords[k]);
        }
        let new_wedges = recent_wedges.count_new(face);
        match wedges.last_mut() {
            Some(WedgeRun { cluster: last, count }) if *last == cluster => *count += new_wedges,
            _ => wedges.push(WedgeRun { cluster, count: new_wedges }),
        }
        // Faces move up to where some were dropped.
        if clusters.len() < i {
            faces[clusters.len()] = faces[i];
        }
        clusters.push(cluster);
    }
    let faces = Sorted::new(&clusters, &faces[..clusters.len()]);
    AssignedFaces { faces, foreign_corners, wedges, stretches: stretches.seen, degenerate }
}

/// Cache of the last window of the numbering.
#[derive(Default)]
struct LoadedWindow {
    last: Mutex<Option<(WindowId, Arc<RankWindow>)>>,
}

/// Ranks of consecutive vertices.
type RankWindow = IdWindow<MeshVertex, PartitionVertex>;

impl LoadedWindow {
    fn get(&self, ranks: &VertexRanks, window: WindowId) -> Result<Arc<RankWindow>> {
        let mut last = lock(&self.last);
        if let Some((_, found)) = last.as_ref().filter(|(at, _)| *at == window) {
            return Ok(found.clone());
        }
        *last = None;
        let found = Arc::new(ranks.load(&(window..window.plus(1)))?);
        *last = Some((window, found.clone()));
        Ok(found)
    }
}

/// Vertices of all corners in the partition, in a temporary file that is deleted on drop.
struct Corners {
    file: File,
    path: PathBuf,
    /// XXH3 of the data of each block; 0 before it is written.
    checksums: Vec<AtomicU64>,
}

impl Corners {
    fn create(path: &Path, blocks: usize, faces: u64) -> Result<Self> {
        let _ = std::fs::remove_file(path);
        let file = File::options().read(true).write(true).create_new(true).open(path);
        let file = file.map_err(|e| Error::io(path, "create", e))?;
        let checksums = (0..blocks).map(|_| AtomicU64::new(0)).collect();
        let corners = Self { file, path: path.to_owned(), checksums };
        corners.file.set_len(faces * CORNERS_BYTES).map_err(|e| Error::io(path, "extend", e))?;
        Ok(corners)
    }

    /// Looks up the corners of blocks, one or two windows of the numbering at a time.
    fn look_up(&self, jobs: &[Job<'_>], ranks: &VertexRanks, options: &PartitionOptions) -> Result<()> {
        let end = WindowId::new(ranks.window_count());
        let named = jobs.iter().map(|job| job.windows(ranks).count()).sum::<usize>();
        let at_once = if named > MANY_WINDOWS * jobs.len() { 2 } else { 1 };
        for first in WindowId::first(end.index()).step_by(at_once) {
            let windows = first..first.plus(at_once as u32).min(end);
            let range = ranks.vertices_of(&windows);
            let mut touching = jobs.iter().copied().filter(|job| job.may_touch(&range)).peekable();
            if touching.peek().is_none() {
                continue;
            }
            let loaded = ranks.load(&windows)?;
            map_in_order(
                touching,
                options.threads,
                options.threads * 2,
                |job| {
                    let faces = job.read()?;
                    let mut found = self.read(&job, faces.len())?;
                    for (face, found) in faces.iter().zip(&mut found) {
                        for (vertex, found) in face.vertices.into_iter().zip(found) {
                            *found = loaded.get(vertex).copied().unwrap_or(*found);
                        }
                    }
                    self.write(&job, &found)
                },
                |()| Ok(()),
            )?;
        }
        Ok(())
    }

    fn write(&self, job: &Job<'_>, corners: &[[PartitionVertex; 3]]) -> Result<()> {
        let bytes = bytemuck::cast_slice(corners);
        self.checksums[job.index].store(xxh3_64(bytes), Ordering::Relaxed);
        write_all_at(&self.file, bytes, job.first * CORNERS_BYTES).map_err(|e| Error::io(&self.path, "write", e))
    }

    /// Reads the corners of a block; zeros if none were written yet.
    fn read(&self, job: &Job<'_>, count: usize) -> Result<Vec<[PartitionVertex; 3]>> {
        let mut corners = vec![[PartitionVertex::default(); 3]; count];
        let checksum = self.checksums[job.index].load(Ordering::Relaxed);
        if checksum == 0 {
            return Ok(corners);
        }
        let bytes = bytemuck::cast_slice_mut(&mut corners);
        read_exact_at(&self.file, bytes, job.first * CORNERS_BYTES).map_err(|e| Error::io(&self.path, "read", e))?;
        if xxh3_64(bytes) != checksum {
            let message = "the checksum of a block differs from what was written".into();
            return Err(Error::Damaged { path: self.path.clone(), message });
        }
        Ok(corners)
    }
}

impl Drop for Corners {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::id::{PieceTexcoord, PieceVertex};

    /// A piece of three times the same face, in a folder.
    fn piece(folder: &Path) -> StoredPiece {
        let (vertices, texcoords) = ([0, 1, 2].map(PieceVertex::new), [PieceTexcoord::NONE; 3]);
        let faces = [Face { vertices, texcoords, ..Face::default() }; 3];
        let path = folder.join("a.piece");
        let piece = crate::model::piece::write_piece(&path, &[glam::DVec3::ZERO; 3], &[], None, &faces).unwrap();
        piece.commit().unwrap()
    }

    const NUMBERING: PieceNumbering =
        PieceNumbering { own: 3, vertex_base: MeshVertex::new(0), texcoord_base: Texcoord::new(0) };

    #[test]
    fn corners_that_a_disk_lost_are_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let piece = piece(folder.path());
        let block = &piece.faces.blocks()[0];
        let job = Job { index: 0, piece: &piece, numbering: NUMBERING, block, first: 0, window: None };
        let corners = Corners::create(&folder.path().join("corners"), 1, 3).unwrap();
        assert_eq!(corners.read(&job, 3).unwrap(), [[PartitionVertex::new(0); 3]; 3]);
        let found = [[4, 5, 6].map(PartitionVertex::new); 3];
        corners.write(&job, &found).unwrap();
        assert_eq!(corners.read(&job, 3).unwrap(), found);
        write_all_at(&corners.file, &[7], 13).unwrap();
        assert!(matches!(corners.read(&job, 3), Err(Error::Damaged { .. })));
    }

    #[test]
    fn a_face_that_its_block_does_not_name_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let piece = piece(folder.path());
        let whole = &piece.faces.blocks()[0];
        let forged = FaceBlock { vertices: PieceVertex::new(0)..PieceVertex::new(2), ..whole.clone() };
        let read = |block| Job { index: 0, piece: &piece, numbering: NUMBERING, block, first: 0, window: None }.read();
        let vertices = [0, 1, 2].map(MeshVertex::new);
        assert!(read(whole).unwrap().iter().all(|face| face.vertices == vertices));
        assert!(matches!(read(&forged), Err(Error::Damaged { .. })));
    }
}
