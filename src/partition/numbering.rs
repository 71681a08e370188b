//! Numbers the vertices in cell order, and welds duplicates.
//!
//! ```text
//! MeshVertex        0 1 2 3 4 5 6 …          file order
//! cell              1 0 1 2 0 0 1 …
//! PartitionVertex   | 1 4 5 | 0 2 6 | 3 |    cell 0, cell 1, cell 2
//! ranks             3 0 4 6 1 2 5 …          of each MeshVertex; the same for duplicates
//! ```
//! Duplicates lie in the same cell, since cells are chosen by position. Vertices within a cell follow the file order.
//!
//! # Memory
//! Buffers of 12 MiB, the positions of a cell while it is welded, and [`VertexRanks`]: at most 16 MiB.

use std::collections::HashMap;
use std::ops::Range;
use std::path::Path;

use foldhash::fast::RandomState;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::cells::Cells;
use super::file_names::FileNames;
use super::id::{ClusterId, PartitionVertex, WindowId};
use super::options::PartitionOptions;
use crate::base::id::{IdWindow, TiSlice, TiVec};
use crate::base::ordered::map_in_order;
use crate::base::{Findings, Result};
use crate::file::buckets::{BucketWriter, Buckets, Sorted};
use crate::file::record::{Record, decode_coordinates, decode_pairs, encode_coordinates, encode_pairs};
use crate::file::varint::{self, VARINT_BYTES_MAX, unzigzag, zigzag};
use crate::file::{ColumnWriter, EncodedRun, PositionRunWriter, PositionRuns, Segment};
use crate::geometry::position_key;
use crate::job::folder_bytes;
use crate::model::StoredMesh;
use crate::model::id::MeshVertex;

/// Positions read at once, few enough that the records made of them stay in the caches and in the heap.
const SWEEP_RECORDS: u64 = 16 << 10;
/// A cell of more vertices is welded on its own, extent by extent. It could not be split, so it has few distinct
/// positions.
const CROWD_RECORDS: u64 = 1 << 20;
/// Largest number of positions in a run.
const RUN_RECORDS: usize = 16 << 10;
/// Bytes of a colour.
const COLOUR_BYTES: usize = size_of::<[f32; 3]>();
/// Bytes of a rank.
pub const RANK_BYTES: u64 = 4;
/// Largest size of a window of ranks in bytes. Larger ones would make memory grow with the mesh and save little time.
const WINDOW_BYTES_MAX: u64 = 8 << 20;

/// Size of a window in bytes for this work memory; two may be loaded at once.
pub fn window_bytes(work_bytes: u64) -> u64 {
    (work_bytes / 8).min(WINDOW_BYTES_MAX)
}

/// Reports whether the ranks of `vertices` vertices are kept in memory as a whole: if they take no more than two
/// windows.
pub fn fit_one_window(vertices: u64, work_bytes: u64) -> bool {
    RANK_BYTES * vertices <= 2 * window_bytes(work_bytes)
}

/// Vertices in cell order.
#[derive(Debug, Serialize, Deserialize)]
pub struct Numbering {
    /// Positions of the vertices.
    pub positions: PositionRuns,
    /// Colours of the vertices; `None` if the mesh has none.
    pub colours: Option<Segment<[f32; 3]>>,
    /// First vertex of each cell, then the number of vertices.
    starts: TiVec<ClusterId, PartitionVertex>,
}

impl Numbering {
    /// Number of cells.
    pub fn cell_count(&self) -> usize {
        self.starts.len() - 1
    }

    /// Vertices that lie in a cell.
    #[inline]
    pub fn vertices_of(&self, cell: ClusterId) -> Range<PartitionVertex> {
        self.starts[cell]..self.starts[cell.plus(1)]
    }

    /// Reports whether the tables and files of a recalled and located value are consistent.
    pub fn is_sound(&self) -> bool {
        let count = self.positions.len();
        self.positions.is_sound()
            && self.colours.iter().all(|colours| colours.is_sound() && colours.len() == u64::from(count))
            && self.starts.first() == Some(&PartitionVertex::new(0))
            && self.starts.last() == Some(&PartitionVertex::new(count))
            && self.starts.is_sorted()
    }

    /// Cell of a vertex.
    #[inline]
    pub fn cell_of(&self, vertex: PartitionVertex) -> ClusterId {
        ClusterId::from(self.starts.raw.partition_point(|&start| start <= vertex) - 1)
    }
}

/// A vertex of the mesh, and what it is in the partition.
#[derive(Debug, Clone, Copy)]
struct VertexRank {
    old: MeshVertex,
    new: PartitionVertex,
}

impl Record for VertexRank {
    fn encode(records: &[Self], out: &mut Vec<u8>) {
        encode_pairs(records.iter().map(|rank| [rank.old.number(), rank.new.number()]), out);
    }

    fn decode(bytes: &[u8], count: usize, out: &mut Vec<Self>) -> std::result::Result<(), String> {
        decode_pairs(bytes, count, |[old, new]| {
            out.push(Self { old: MeshVertex::new(old), new: PartitionVertex::new(new) });
        })
    }
}

/// What each vertex of the mesh is in the partition, in windows.
#[derive(Debug)]
pub struct VertexRanks {
    window_len: u32,
    count: u32,
    /// All ranks, if they are kept in memory as a whole.
    whole: TiVec<MeshVertex, PartitionVertex>,
    /// Otherwise, those of each window.
    by_window: Option<Buckets<VertexRank, WindowId>>,
}

impl VertexRanks {
    /// Number of windows.
    pub fn window_count(&self) -> u32 {
        self.count.div_ceil(self.window_len).max(1)
    }

    /// Vertices of consecutive windows.
    pub fn vertices_of(&self, windows: &Range<WindowId>) -> Range<MeshVertex> {
        let start_of =
            |window: WindowId| MeshVertex::new(window.number().saturating_mul(self.window_len).min(self.count));
        start_of(windows.start)..start_of(windows.end)
    }

    /// All ranks if they are in memory as a whole, otherwise `None`.
    pub fn whole(&self) -> Option<&TiSlice<MeshVertex, PartitionVertex>> {
        self.by_window.is_none().then_some(&self.whole)
    }

    /// Loads the ranks of consecutive windows.
    ///
    /// # Errors
    /// On failed reads.
    pub fn load(&self, windows: &Range<WindowId>) -> Result<IdWindow<MeshVertex, PartitionVertex>> {
        let Some(by_window) = &self.by_window else {
            return Ok(IdWindow::new(MeshVertex::new(0), self.whole.raw.clone()));
        };
        let mut ranks = IdWindow::filled(&self.vertices_of(windows), PartitionVertex::default());
        for window in WindowId::within(windows) {
            by_window.read(window, |records| {
                records.iter().for_each(|rank| ranks[rank.old] = rank.new);
                Ok(())
            })?;
        }
        Ok(ranks)
    }
}

/// Record of a vertex that is scattered to its cell.
pub(super) trait VertexRecord: Record {
    fn new(position: DVec3, vertex: MeshVertex, colour: [f32; 3]) -> Self;
    fn position(&self) -> DVec3;
    fn vertex(&self) -> MeshVertex;
    fn colour(&self) -> Option<[f32; 3]>;
}

/// Record without colour.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlainRecord {
    position: DVec3,
    vertex: MeshVertex,
}

impl VertexRecord for PlainRecord {
    fn new(position: DVec3, vertex: MeshVertex, _colour: [f32; 3]) -> Self {
        Self { position, vertex }
    }

    fn position(&self) -> DVec3 {
        self.position
    }

    fn vertex(&self) -> MeshVertex {
        self.vertex
    }

    fn colour(&self) -> Option<[f32; 3]> {
        None
    }
}

/// Encodes all positions, then the ids as differences from the previous one.
impl Record for PlainRecord {
    fn encode(records: &[Self], out: &mut Vec<u8>) {
        encode_coordinates(&records.iter().map(|record| record.position).collect::<Vec<_>>(), out);
        let mut at = out.len();
        out.resize(at + records.len() * VARINT_BYTES_MAX, 0);
        let mut last = 0;
        for record in records {
            let id = i64::from(record.vertex.number());
            at = varint::put(out, at, zigzag(id - last));
            last = id;
        }
        out.truncate(at);
    }

    fn decode(bytes: &[u8], count: usize, out: &mut Vec<Self>) -> std::result::Result<(), String> {
        out.reserve(count);
        let mut positions = Vec::with_capacity(count);
        let bytes = decode_coordinates(bytes, count, &mut positions)?;
        let (mut at, mut id) = (0, 0i64);
        for position in positions {
            let difference = varint::take(bytes, &mut at).ok_or("an extent ends inside a number")?;
            id = id.wrapping_add(unzigzag(difference));
            out.push(Self { position, vertex: MeshVertex::new(id as u32) });
        }
        if at == bytes.len() { Ok(()) } else { Err(format!("{} bytes are left after an extent", bytes.len() - at)) }
    }
}

/// Record with colour.
#[derive(Debug, Clone, Copy)]
pub(super) struct ColouredRecord {
    plain: PlainRecord,
    colour: [f32; 3],
}

impl VertexRecord for ColouredRecord {
    fn new(position: DVec3, vertex: MeshVertex, colour: [f32; 3]) -> Self {
        Self { plain: PlainRecord::new(position, vertex, colour), colour }
    }

    fn position(&self) -> DVec3 {
        self.plain.position()
    }

    fn vertex(&self) -> MeshVertex {
        self.plain.vertex
    }

    fn colour(&self) -> Option<[f32; 3]> {
        Some(self.colour)
    }
}

/// Encodes all colours verbatim, then the plain records.
impl Record for ColouredRecord {
    fn encode(records: &[Self], out: &mut Vec<u8>) {
        records.iter().for_each(|record| out.extend_from_slice(bytemuck::bytes_of(&record.colour)));
        PlainRecord::encode(&records.iter().map(|record| record.plain).collect::<Vec<_>>(), out);
    }

    fn decode(bytes: &[u8], count: usize, out: &mut Vec<Self>) -> std::result::Result<(), String> {
        let (colours, rest) = bytes.split_at_checked(count * COLOUR_BYTES).ok_or("an extent ends inside colours")?;
        let mut plain = Vec::with_capacity(count);
        PlainRecord::decode(rest, count, &mut plain)?;
        let colours = colours.chunks_exact(COLOUR_BYTES).map(bytemuck::pod_read_unaligned);
        out.extend(plain.into_iter().zip(colours).map(|(plain, colour)| Self { plain, colour }));
        Ok(())
    }
}

/// Numbers the vertices of a mesh by cell. `R` must have a colour if the mesh has colours. Also returns the largest
/// size of the folder meanwhile, in bytes.
///
/// # Errors
/// On a full disk, failed reads and writes.
pub(super) fn number<R: VertexRecord>(
    mesh: &StoredMesh,
    cells: &Cells,
    names: FileNames<'_>,
    options: &PartitionOptions,
    findings: &mut Findings,
) -> Result<(Numbering, VertexRanks, u64)> {
    mesh.numbering()?;
    let records = bucket_by_cell::<R>(mesh, cells, &names.path("vertices.buckets"), options)?;

    let vertex_count = mesh.vertex_count() as u32;
    let is_whole = fit_one_window(mesh.vertex_count(), options.work_bytes);
    let window_len = if is_whole {
        vertex_count.max(1)
    } else {
        (window_bytes(options.work_bytes) / RANK_BYTES).max(1 << 16) as u32
    };
    let mut whole: TiVec<MeshVertex, PartitionVertex> =
        vec![PartitionVertex::default(); if is_whole { vertex_count as usize } else { 0 }].into();
    let mut by_window = if is_whole {
        None
    } else {
        let windows = vertex_count.div_ceil(window_len) as usize;
        Some(BucketWriter::create(&names.path("ranks.buckets"), windows)?)
    };
    let mut positions = PositionRunWriter::create(&names.path("positions.plc"))?;
    let mut colours =
        if mesh.has_colours() { Some(ColumnWriter::create(&names.path("colours.col"), *b"colour  ")?) } else { None };
    let mut starts: TiVec<ClusterId, PartitionVertex> = vec![PartitionVertex::new(0)].into();
    let mut welded = 0;
    map_in_order(
        ClusterId::first(cells.count()),
        options.threads,
        options.threads + 1,
        |cell| {
            if records.len(cell) <= CROWD_RECORDS {
                Ok((cell, Some(weld_cell(&records, cell, options.weld)?.encoded())))
            } else {
                Ok((cell, None))
            }
        },
        |(cell, welded_cell)| {
            let base = PartitionVertex::new(positions.len());
            let mut put = |(part, runs): (WeldedCell, Vec<EncodedRun>)| -> Result<()> {
                let before = positions.len();
                runs.into_iter().try_for_each(|run| positions.append(run))?;
                if let Some(colours) = &mut colours {
                    colours.append(&part.colours)?;
                }
                welded += part.vertices.len() as u64 - u64::from(positions.len() - before);
                part.vertices.iter().try_for_each(|vertex| {
                    let rank = VertexRank { old: vertex.old, new: base.plus(vertex.place) };
                    match &mut by_window {
                        None => {
                            whole[rank.old] = rank.new;
                            Ok(())
                        }
                        Some(windows) => windows.push(WindowId::new(rank.old.number() / window_len), rank),
                    }
                })
            };
            match welded_cell {
                Some(whole_cell) => put(whole_cell)?,
                None => weld_crowd(&records, cell, options.weld, put)?,
            }
            starts.push(PartitionVertex::new(positions.len()));
            Ok(())
        },
    )?;
    findings.count("welded_vertices", welded);
    let colours = colours.map(ColumnWriter::finish).transpose()?;
    let by_window = by_window.map(BucketWriter::finish).transpose()?;
    let ranks = VertexRanks { window_len, count: vertex_count, whole, by_window };
    let positions = positions.finish()?;
    let scratch_peak = folder_bytes(names.folder);
    Ok((Numbering { positions, colours, starts }, ranks, scratch_peak))
}

fn bucket_by_cell<R: VertexRecord>(
    mesh: &StoredMesh,
    cells: &Cells,
    path: &Path,
    options: &PartitionOptions,
) -> Result<Buckets<R, ClusterId>> {
    let mut buckets = BucketWriter::create(path, cells.count())?;
    let shared = (mesh.shared_positions.iter()).map(|positions| (positions, mesh.shared_colours.as_ref()));
    let own = mesh.pieces.iter().map(|piece| (&piece.positions, piece.colours.as_ref()));
    let mut base = MeshVertex::new(0);
    let mut windows = Vec::new();
    for (positions, colours) in shared.chain(own) {
        windows.extend(positions.ranges(SWEEP_RECORDS).map(|range| (positions, colours, base, range)));
        base = base.plus(positions.len() as u32);
    }
    map_in_order(
        windows.into_iter(),
        options.threads,
        options.threads * 2,
        |(positions, colours, base, range)| {
            let window = positions.window(range.clone())?;
            let colours = match colours {
                Some(colours) => Some(colours.window(range.clone())?),
                None => None,
            };
            let record = |(i, &position): (usize, &DVec3)| {
                let colour = colours.as_ref().map_or([f32::NAN; 3], |colours| colours[i]);
                R::new(position, base.plus(range.start as u32 + i as u32), colour)
            };
            let cell_of_each: Vec<ClusterId> = window.iter().map(|&position| cells.of(position)).collect();
            Ok(Sorted::new(&cell_of_each, &window.iter().enumerate().map(record).collect::<Vec<R>>()))
        },
        |sorted| buckets.append(sorted),
    )?;
    buckets.finish()
}

/// Place of each position seen, by its bits. Only looked up, never iterated, so the random seed does not affect the
/// result.
type Known = HashMap<[u64; 3], u32, RandomState>;

/// Vertices of a cell, or of a part of it, after welding.
#[derive(Debug, Default)]
struct WeldedCell {
    positions: Vec<DVec3>,
    colours: Vec<[f32; 3]>,
    vertices: Vec<WeldedVertex>,
}

/// A vertex of the mesh, and the place of its position in its cell.
#[derive(Debug, Clone, Copy)]
struct WeldedVertex {
    old: MeshVertex,
    place: u32,
}

impl WeldedCell {
    /// Encodes the positions.
    fn encoded(mut self) -> (Self, Vec<EncodedRun>) {
        let runs = self.positions.chunks(RUN_RECORDS).map(EncodedRun::new).collect();
        self.positions = Vec::new();
        (self, runs)
    }

    /// Adds records; `known` maps positions to their places so far, `fresh` is the next place.
    fn add<R: VertexRecord>(&mut self, records: &[R], weld: bool, known: &mut Known, fresh: &mut u32) {
        for record in records {
            let place = if weld { *known.entry(position_key(record.position())).or_insert(*fresh) } else { *fresh };
            if place == *fresh {
                *fresh += 1;
                self.positions.push(record.position());
                self.colours.extend(record.colour());
            }
            self.vertices.push(WeldedVertex { old: record.vertex(), place });
        }
    }
}

fn weld_cell<R: VertexRecord>(records: &Buckets<R, ClusterId>, cell: ClusterId, weld: bool) -> Result<WeldedCell> {
    let count = records.len(cell) as usize;
    let (positions, vertices) = (Vec::with_capacity(count), Vec::with_capacity(count));
    let mut welded = WeldedCell { positions, vertices, ..WeldedCell::default() };
    let expected = if weld { count } else { 0 };
    let (mut known, mut fresh) = (Known::with_capacity_and_hasher(expected, RandomState::default()), 0);
    records.read(cell, |records| {
        welded.add(records, weld, &mut known, &mut fresh);
        Ok(())
    })?;
    Ok(welded)
}

/// Welds a cell of any size; passes the result of each extent to `put`.
fn weld_crowd<R: VertexRecord>(
    records: &Buckets<R, ClusterId>,
    cell: ClusterId,
    weld: bool,
    mut put: impl FnMut((WeldedCell, Vec<EncodedRun>)) -> Result<()>,
) -> Result<()> {
    let (mut known, mut fresh) = (Known::default(), 0);
    records.read(cell, |records| {
        let mut part = WeldedCell::default();
        part.add(records, weld, &mut known, &mut fresh);
        put(part.encoded())
    })
}
