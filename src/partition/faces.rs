//! Distributes faces to cells, and marks the vertices that several cells use.
//!
//! A triangle goes to the cell of most of its corners (the smallest id of three), a polygon to that of its first
//! corner, because it must stay whole until it is triangulated. Every corner that lies in another cell is *shared*.
//!
//! Old ids are looked up window by window of the numbering, so that a shuffled file causes no random access. Blocks of
//! faces that need one window are looked up as they are read, if the order of the file is such that windows rarely
//! change. The ids of other blocks are looked up beforehand, window by window, and kept in a temporary file of 12 bytes
//! per face.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use super::file_names::FileNames;
use super::numbering::{IdMap, Numbering};
use super::options::PartitionOptions;
use super::shared::Shared;
use super::stretches::{CellStretch, NamedStretches, SeenStretches};
use super::weight::RecentWedges;
use crate::base::ordered::map_in_order;
use crate::base::{Error, Findings, Result, lock};
use crate::file::buckets::{BucketWriter, Buckets, Sorted};
use crate::model::face::FaceBlock;
use crate::model::stored_mesh::PieceNumbering;
use crate::model::{Face, NO_TEXCOORD, StoredMesh, StoredPiece};
use crate::os::system::{read_exact_at, write_all_at};

/// Faces by cell, and the vertices shared by several cells.
#[derive(Debug, Serialize, Deserialize)]
pub struct CellFaces {
    /// Faces of each cell, with new vertex ids and texcoord ids of the mesh.
    pub by_cell: Buckets<Face>,
    /// Vertices used by several cells.
    pub shared: Shared,
    /// For each cell, the corners of its faces that lie in other cells.
    pub foreign_corners: Vec<u64>,
    /// Upper bound on the wedges of each cell.
    pub wedges: Vec<u64>,
    /// Stretches of texture coordinates that the faces of each cell refer to.
    #[serde(skip)]
    pub stretches: NamedStretches,
}

/// Largest mean number of window changes per window with which windows are loaded on demand.
const WINDOW_CHANGES_MAX: u64 = 4;
/// Mean number of windows per block above which two windows are looked up at once, since each lookup reads the block
/// again.
const MANY_WINDOWS: usize = 4;
/// Bytes per face in the file of corners: three new vertex ids.
const CORNERS_BYTES: u64 = size_of::<[u32; 3]>() as u64;

impl CellFaces {
    /// Marks all vertices of some ranges as shared, because the faces of their cells will be spread over several
    /// pieces.
    pub fn share_all(&mut self, ranges: impl Iterator<Item = std::ops::Range<u32>>) {
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
    window: Option<u32>,
}

impl Job<'_> {
    fn read(&self) -> Result<Vec<Face>> {
        let (mut bytes, mut faces) = (Vec::new(), Vec::new());
        self.piece.faces.read_block(&self.piece.faces.open()?, self.block, &mut bytes, &mut faces)?;
        let vertices = self.numbering.own + self.numbering.vertex_base;
        let texcoords = u64::from(self.numbering.texcoord_base) + self.piece.texcoords.len();
        for face in &mut faces {
            let is_of_block = face.vertices.iter().all(|v| self.block.vertices.contains(v));
            *face = self.numbering.globalise(face);
            let is_missing = |&t: &u32| t != NO_TEXCOORD && u64::from(t) >= texcoords;
            if !is_of_block || face.vertices.iter().any(|&v| v >= vertices) || face.texcoords.iter().any(is_missing) {
                let message = "a face names a vertex or texture coordinate that is not there".to_owned();
                return Err(Error::Damaged { path: self.piece.faces.path().to_owned(), message });
            }
        }
        Ok(faces)
    }

    /// The window of the numbering that contains all its vertices; `None` if it needs several.
    fn only_window(&self, ranks: &IdMap) -> Option<u32> {
        let mut windows = self.windows(ranks);
        windows.next().filter(|_| windows.next().is_none())
    }

    /// The windows of the numbering that its faces may refer to.
    fn windows(&self, ranks: &IdMap) -> impl Iterator<Item = u32> {
        (0..ranks.window_count()).filter(|&window| self.may_touch(&ranks.range(window..window + 1)))
    }

    /// Reports whether a face of the block may refer to a vertex in a range of mesh ids.
    fn may_touch(&self, range: &std::ops::Range<u32>) -> bool {
        let PieceNumbering { own, vertex_base, .. } = self.numbering;
        let (low, high) = (self.block.vertices.start, self.block.vertices.end);
        let meets = |low: u32, high: u32| low < range.end && range.start < high;
        (low < own && meets(vertex_base + low, vertex_base + high.min(own)))
            || (high > own && meets(low.saturating_sub(own), high - own))
    }
}

/// Distributes the faces of a mesh to cells.
///
/// # Errors
/// On a full disk, failed reads and writes, and damaged files.
pub(super) fn distribute(
    mesh: &StoredMesh,
    numbering: &Numbering,
    ranks: &IdMap,
    names: FileNames<'_>,
    options: &PartitionOptions,
    findings: &mut Findings,
) -> Result<CellFaces> {
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
    let mut by_cell = BucketWriter::create(&names.path("faces.buckets"), numbering.cell_count())?;
    let mut shared = Shared::default();
    let mut foreign_corners = vec![0; numbering.cell_count()];
    let mut wedges = vec![0; numbering.cell_count()];
    let mut stretches = NamedStretches::new(mesh.texcoord_count());
    let mut degenerate = 0;
    map_in_order(
        jobs.iter().copied(),
        options.threads,
        options.threads * 2,
        |job| {
            let mut faces = job.read()?;
            if let Some(window) = job.window {
                let (start, found) = (ranks.range(window..window + 1).start, loaded.get(ranks, window)?);
                faces.iter_mut().for_each(|face| face.vertices = face.vertices.map(|v| found[(v - start) as usize]));
            } else if let Some(corners) = &looked_up {
                let found = corners.read(&job, faces.len())?;
                faces.iter_mut().zip(found).for_each(|(face, vertices)| face.vertices = vertices);
            } else {
                let ranks = ranks.whole().unwrap_or(&[]);
                faces.iter_mut().for_each(|face| face.vertices = face.vertices.map(|v| ranks[v as usize]));
            }
            Ok(assign(&faces, numbering))
        },
        |assigned: Assigned| {
            degenerate += assigned.degenerate;
            for (cell, vertex) in assigned.shared {
                shared.insert(vertex);
                foreign_corners[cell as usize] += 1;
            }
            for (cell, count) in assigned.wedges {
                wedges[cell as usize] += u64::from(count);
            }
            stretches.add(assigned.stretches);
            by_cell.append(assigned.faces)
        },
    )?;
    findings.count("degenerate_faces", degenerate);
    Ok(CellFaces { by_cell: by_cell.finish_durable()?, shared, foreign_corners, wedges, stretches })
}

/// Result of assigning a block of faces.
struct Assigned {
    faces: Sorted<Face>,
    /// Corners in other cells: the cell of the face, and the vertex.
    shared: Vec<(u32, u32)>,
    /// Cells, with an upper bound on the wedges of consecutive faces in each.
    wedges: Vec<(u32, u32)>,
    /// Stretches of texture coordinates that the faces refer to.
    stretches: Vec<CellStretch>,
    degenerate: u64,
}

/// Chooses the cell of each face of a block; drops triangles that repeat a vertex.
fn assign(faces: &[Face], numbering: &Numbering) -> Assigned {
    let mut placed: Vec<(u32, Face)> = Vec::with_capacity(faces.len());
    let (mut shared, mut wedges, mut degenerate) = (Vec::new(), Vec::new(), 0);
    let mut stretches = SeenStretches::new();
    let mut recent_wedges = RecentWedges::default();
    let mut last = (0, 0..0);
    let mut cell_of = |vertex: u32| {
        if !last.1.contains(&vertex) {
            let cell = numbering.cell_of(vertex);
            last = (cell, numbering.starts[cell as usize]..numbering.starts[cell as usize + 1]);
        }
        last.0
    };
    for (i, face) in faces.iter().enumerate() {
        let is_polygon = face.continues_polygon || faces.get(i + 1).is_some_and(|next| next.continues_polygon);
        let [a, b, c] = face.vertices;
        if !is_polygon && (a == b || b == c || c == a) {
            degenerate += 1;
            continue;
        }
        let cells = face.vertices.map(&mut cell_of);
        let cell = match cells {
            [first, ..] if is_polygon => first,
            [_, b, c] if b == c => b,
            [a, b, c] if a == b || a == c => a,
            [a, b, c] => a.min(b).min(c),
        };
        for (k, &own) in cells.iter().enumerate() {
            if own != cell {
                shared.push((cell, face.vertices[k]));
            }
            stretches.see(cell, face.texcoords[k]);
        }
        let new_wedges = recent_wedges.count_new(face);
        match wedges.last_mut() {
            Some((last, count)) if *last == cell => *count += new_wedges,
            _ => wedges.push((cell, new_wedges)),
        }
        placed.push((cell, *face));
    }
    Assigned { faces: Sorted::new(&placed), shared, wedges, stretches: stretches.seen, degenerate }
}

/// Cache of the last window of the numbering.
#[derive(Default)]
struct LoadedWindow {
    window: Mutex<Option<(u32, Arc<Vec<u32>>)>>,
}

impl LoadedWindow {
    fn get(&self, ranks: &IdMap, window: u32) -> Result<Arc<Vec<u32>>> {
        let mut loaded = lock(&self.window);
        if let Some((_, found)) = loaded.as_ref().filter(|(at, _)| *at == window) {
            return Ok(found.clone());
        }
        *loaded = None;
        let found = Arc::new(ranks.load(window..window + 1)?);
        *loaded = Some((window, found.clone()));
        Ok(found)
    }
}

/// New vertex ids of all corners, in a temporary file that is deleted on drop.
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
    fn look_up(&self, jobs: &[Job<'_>], ranks: &IdMap, options: &PartitionOptions) -> Result<()> {
        let count = ranks.window_count();
        let named = jobs.iter().map(|job| job.windows(ranks).count()).sum::<usize>();
        let at_once = if named > MANY_WINDOWS * jobs.len() { 2 } else { 1 };
        for first in (0..count).step_by(at_once) {
            let windows = first..(first + at_once as u32).min(count);
            let range = ranks.range(windows.clone());
            let mut touching = jobs.iter().copied().filter(|job| job.may_touch(&range)).peekable();
            if touching.peek().is_none() {
                continue;
            }
            let loaded = ranks.load(windows)?;
            map_in_order(
                touching,
                options.threads,
                options.threads * 2,
                |job| {
                    let faces = job.read()?;
                    let mut found = self.read(&job, faces.len())?;
                    for (face, found) in faces.iter().zip(&mut found) {
                        for (v, found) in face.vertices.into_iter().zip(found) {
                            if range.contains(&v) {
                                *found = loaded[(v - range.start) as usize];
                            }
                        }
                    }
                    self.write(&job, &found)
                },
                |()| Ok(()),
            )?;
        }
        Ok(())
    }

    fn write(&self, job: &Job<'_>, corners: &[[u32; 3]]) -> Result<()> {
        let bytes = bytemuck::cast_slice(corners);
        self.checksums[job.index].store(xxh3_64(bytes), Ordering::Relaxed);
        write_all_at(&self.file, bytes, job.first * CORNERS_BYTES).map_err(|e| Error::io(&self.path, "write", e))
    }

    /// Reads the corners of a block; zeros if none were written yet.
    fn read(&self, job: &Job<'_>, count: usize) -> Result<Vec<[u32; 3]>> {
        let mut corners = vec![[0u32; 3]; count];
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

    #[test]
    fn corners_that_a_disk_lost_are_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let faces = [Face { vertices: [0, 1, 2], ..Face::default() }; 3];
        let path = folder.path().join("a.piece");
        let piece = crate::model::piece::write_piece(&path, &[glam::DVec3::ZERO; 3], &[], None, &faces).unwrap();
        let piece = piece.commit().unwrap();
        let numbering = PieceNumbering { own: 3, vertex_base: 0, texcoord_base: 0 };
        let block = &piece.faces.blocks()[0];
        let job = Job { index: 0, piece: &piece, numbering, block, first: 0, window: None };
        let corners = Corners::create(&folder.path().join("corners"), 1, 3).unwrap();
        assert_eq!(corners.read(&job, 3).unwrap(), [[0; 3]; 3]);
        corners.write(&job, &[[4, 5, 6]; 3]).unwrap();
        assert_eq!(corners.read(&job, 3).unwrap(), [[4, 5, 6]; 3]);
        write_all_at(&corners.file, &[7], 13).unwrap();
        assert!(matches!(corners.read(&job, 3), Err(Error::Damaged { .. })));
    }

    #[test]
    fn a_face_that_its_block_does_not_name_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let faces = [Face { vertices: [0, 1, 2], texcoords: [NO_TEXCOORD; 3], ..Face::default() }; 3];
        let path = folder.path().join("a.piece");
        let piece = crate::model::piece::write_piece(&path, &[glam::DVec3::ZERO; 3], &[], None, &faces).unwrap();
        let piece = piece.commit().unwrap();
        let numbering = PieceNumbering { own: 3, vertex_base: 0, texcoord_base: 0 };
        let whole = &piece.faces.blocks()[0];
        let forged = FaceBlock { vertices: 0..2, ..whole.clone() };
        let read = |block| Job { index: 0, piece: &piece, numbering, block, first: 0, window: None }.read();
        assert_eq!(read(whole).unwrap(), faces);
        assert!(matches!(read(&forged), Err(Error::Damaged { .. })));
    }
}
