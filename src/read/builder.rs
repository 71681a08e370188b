//! Appends parsed records of a file to its columns, in order, whatever the format.
//!
//! In: the records of the chunks of one input file, in order. Out: a [`StoredPiece`]. Invariant: the output depends on
//! the order of chunks alone.
//!
//! # Memory
//! The buffers of the writers and [`FACE_BUFFER`] faces.
//!
//! # Files
//! `scan-<index>-positions.col`, `-texcoords.col`, `-colours.col` (if a vertex has a colour) and `-faces.blk`. The last
//! is `-faces.bare.blk` if faces refer to texture coordinates and the file has none.

use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::parts::Labels;
use super::records::{ChunkCorner, ParsedRecords};
use crate::base::error::escape_path;
use crate::base::ordered::both;
use crate::base::{Error, Findings, Result};
use crate::file::{ColumnWriter, PackedWriter, codec};
use crate::model::face::{POLYGON_CORNERS_MAX, repeats_vertex};
use crate::model::id::{PieceTexcoord, PieceVertex};
use crate::model::stored_mesh::ID_LIMIT;
use crate::model::{Catalogue, Face, FaceBlocks, FaceWriter, StoredPiece};

const FACE_BUFFER: usize = 4096;
const COLOUR_BUFFER: usize = 4096;

/// Appends what a file holds to its columns.
pub(super) struct MeshBuilder<'a> {
    path: &'a Path,
    colours_path: PathBuf,
    positions: PackedWriter<DVec3>,
    texcoords: PackedWriter<DVec2>,
    colours: Option<ColumnWriter<[f32; 3]>>,
    faces: FaceWriter,
    face_buffer: Vec<Face<PieceVertex>>,
    /// Triangles so far, including degenerate ones.
    pub(super) triangles: u64,
    /// Most decimals of a position so far.
    pub(super) position_decimals: u32,
    texcoord_decimals: u32,
    uses_normals: bool,
    /// What was ignored or repaired.
    pub(super) findings: Findings,
}

/// A file that was read to its end.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct FinishedFile {
    /// Its piece of the mesh.
    pub(super) piece: StoredPiece,
    /// Its triangles, including degenerate ones.
    pub(super) triangles: u64,
    /// Its length in bytes.
    pub(super) bytes: u64,
    /// Hash of its content, chained over its parts.
    pub(super) content_hash: u64,
    /// Further files that it names and that its materials come from, whether they exist or not.
    #[serde(with = "codec::paths")]
    pub(super) libraries: Vec<PathBuf>,
}

impl<'a> MeshBuilder<'a> {
    /// Creates the column files of an input in the work folder.
    ///
    /// # Errors
    /// If a file cannot be created.
    pub(super) fn create(path: &'a Path, folder: &Path, index: usize) -> Result<Self> {
        let file = |what: &str| folder.join(format!("scan-{index}-{what}"));
        Ok(Self {
            path,
            colours_path: file("colours.col"),
            positions: PackedWriter::create(&file("positions.col"), *b"position")?,
            texcoords: PackedWriter::create(&file("texcoords.col"), *b"texcoord")?,
            colours: None,
            faces: FaceWriter::create(&file("faces.blk"))?,
            face_buffer: Vec::with_capacity(FACE_BUFFER),
            triangles: 0,
            position_decimals: 0,
            texcoord_decimals: 0,
            uses_normals: false,
            findings: Findings::default(),
        })
    }

    /// Refuses more vertices or texture coordinates than there are ids.
    ///
    /// # Errors
    /// [`Error::Limit`] that names the file.
    pub(super) fn check_counts(&self, vertices: u64, texcoords: u64) -> Result<()> {
        for (count, what) in [(vertices, "vertices"), (texcoords, "texture coordinates")] {
            if count > ID_LIMIT {
                let path = escape_path(self.path);
                return Err(Error::Limit(format!("{path}: more than {ID_LIMIT} {what}; split the file into tiles")));
            }
        }
        Ok(())
    }

    /// Number of texture coordinates so far.
    pub(super) fn texcoord_count(&self) -> u64 {
        self.texcoords.len()
    }

    /// Adds the findings of a chunk; lines count from `line_base`, and line 0 stands for none.
    pub(super) fn report(&mut self, records: &ParsedRecords, line_base: u64) {
        for note in &records.notes {
            for (line, words) in &note.places {
                let path = escape_path(self.path);
                self.findings.note(note.kind, || match line_base + line {
                    0 => format!("{path}: {words}"),
                    line => format!("{path}:{line}: {words}"),
                });
            }
            self.findings.count(note.kind, note.count - note.places.len() as u64);
        }
        self.position_decimals = self.position_decimals.max(records.position_decimals);
        self.texcoord_decimals = self.texcoord_decimals.max(records.texcoord_decimals);
        self.uses_normals |= records.uses_normals;
    }

    /// Appends the vertices and texture coordinates of packed records.
    ///
    /// # Errors
    /// Those of the writers.
    pub(super) fn append_vertices(&mut self, records: &ParsedRecords) -> Result<()> {
        let vertex_base = self.positions.len();
        self.positions.append_packed(&records.packed_positions)?;
        self.texcoords.append_packed(&records.packed_texcoords)?;
        if records.colours.is_empty() {
            if let Some(colours) = &mut self.colours {
                append_uncoloured(colours, records.positions.len() as u64)?;
            }
            return Ok(());
        }
        let colours = match &mut self.colours {
            Some(colours) => colours,
            None => {
                let mut colours = ColumnWriter::create(&self.colours_path, *b"colour  ")?;
                append_uncoloured(&mut colours, vertex_base)?;
                self.colours.insert(colours)
            }
        };
        colours.append(&records.colours)
    }

    /// Appends the faces of records, whose corners are ids of the file.
    ///
    /// # Errors
    /// [`Error::Budget`] if names take too much memory, and those of the writers.
    pub(super) fn append_faces(&mut self, records: &ParsedRecords, labels: &mut Labels) -> Result<()> {
        let mut degenerate_count = 0;
        let mut changes = records.changes.iter().peekable();
        let mut first = ChunkCorner::new(0);
        for (polygon, size) in records.polygon_sizes.iter().enumerate() {
            while let Some(change) = changes.next_if(|change| change.polygon as usize == polygon) {
                labels.change(change.kind, records.name(&change.name));
            }
            let corners = first..first.plus(*size);
            first = corners.end;
            let vertices = &records.corner_vertices[corners.clone()].raw;
            self.triangles += vertices.len() as u64 - 2;
            if matches!(*vertices, [a, b, c] if repeats_vertex([a, b, c])) {
                degenerate_count += 1;
                continue;
            }
            let part = labels.part()?;
            let texcoords = records.corner_texcoords.get(corners).map(|texcoords| &texcoords.raw);
            let texcoords = texcoords.filter(|texcoords| !texcoords.is_empty());
            let is_polygon = vertices.len() <= POLYGON_CORNERS_MAX;
            for i in 2..vertices.len() {
                let triangle = [vertices[0], vertices[i - 1], vertices[i]];
                if !is_polygon && repeats_vertex(triangle) {
                    degenerate_count += 1;
                    continue;
                }
                self.face_buffer.push(Face {
                    vertices: triangle,
                    texcoords: texcoords.map_or([PieceTexcoord::NONE; 3], |t| [t[0], t[i - 1], t[i]]),
                    part,
                    continues_polygon: is_polygon && i > 2,
                    deviation: 0.0,
                });
                if self.face_buffer.len() == FACE_BUFFER {
                    self.flush_faces()?;
                }
            }
        }
        for change in changes {
            labels.change(change.kind, records.name(&change.name));
        }
        self.findings.count("degenerate_faces", degenerate_count);
        Ok(())
    }

    fn flush_faces(&mut self) -> Result<()> {
        self.faces.append(&self.face_buffer)?;
        self.face_buffer.clear();
        Ok(())
    }

    /// Whether no face is left that has three vertices.
    pub(super) fn has_no_faces(&self) -> bool {
        self.faces.is_empty() && self.face_buffer.is_empty()
    }

    /// Words for a file whose faces all repeat a vertex; `None` if it has no faces at all.
    pub(super) fn all_repeat(&self) -> Option<String> {
        match self.triangles {
            0 => None,
            1 => Some("no faces: the only face repeats a vertex".to_owned()),
            count => Some(format!("no faces: all {count} repeat a vertex")),
        }
    }

    /// Adds what is known of the whole file to the catalogue.
    pub(super) fn describe(&self, catalogue: &mut Catalogue) {
        catalogue.has_normals |= self.uses_normals;
        catalogue.has_texcoords |= !self.texcoords.is_empty();
        catalogue.position_decimals = catalogue.position_decimals.max(self.position_decimals);
        catalogue.texcoord_decimals = catalogue.texcoord_decimals.max(self.texcoord_decimals);
    }

    /// Finishes the columns; if `lacks_texcoords`, faces refer to texture coordinates that the file does not have, and
    /// are stored without.
    ///
    /// # Errors
    /// Those of the writers.
    pub(super) fn finish(mut self, lacks_texcoords: bool, findings: &mut Findings) -> Result<(StoredPiece, u64)> {
        self.flush_faces()?;
        findings.merge(self.findings);
        let Self { positions, colours, texcoords, faces, .. } = self;
        // Both wait for the disk; run them in parallel.
        let (faces, rest) = both(
            2,
            || faces.finish().and_then(|faces| if lacks_texcoords { without_texcoords(faces) } else { Ok(faces) }),
            || -> Result<_> {
                Ok((positions.finish()?, colours.map(ColumnWriter::finish).transpose()?, texcoords.finish()?))
            },
        );
        let (positions, colours, texcoords) = rest?;
        Ok((StoredPiece { positions, colours, texcoords, faces: faces? }, self.triangles))
    }
}

/// Rewrites the faces of a file without texture coordinates.
fn without_texcoords(faces: FaceBlocks) -> Result<FaceBlocks> {
    let mut writer = FaceWriter::create(&faces.path().with_extension("bare.blk"))?;
    let (file, mut bytes, mut block_faces) = (faces.open()?, Vec::new(), Vec::new());
    for block in faces.blocks() {
        faces.read_block(&file, block, &mut bytes, &mut block_faces)?;
        for face in &mut block_faces {
            face.texcoords = [PieceTexcoord::NONE; 3];
        }
        writer.append(&block_faces)?;
    }
    // NOTE: the other file stays, since another process may read it; no record names it, so it goes with the next step.
    writer.finish()
}

fn append_uncoloured(colours: &mut ColumnWriter<[f32; 3]>, mut count: u64) -> Result<()> {
    let none = [[f32::NAN; 3]; COLOUR_BUFFER];
    while count > 0 {
        let now = count.min(COLOUR_BUFFER as u64);
        colours.append(&none[..now as usize])?;
        count -= now;
    }
    Ok(())
}
