//! Cells: neighbouring triangles of a mesh, with what they show and a search tree, in one file.
//!
//! ```text
//! | header 64 B | cell 0: positions 24 B, pairs 64 B, tilted boxes 64 B, faces 40 B each, colours 4 B, padded to 8 | …
//! ```
//! In: clusters of a partition. Out: [`Cell`]s that are opened one by one. Invariant: a cell depends on its cluster
//! alone.
//!
//! # Memory
//! 440 bytes a face while a cell is made; afterwards about 150 bytes a cell. A cell that is being read takes the pages
//! that are touched, at most 75 bytes a face, or 83 with tilted boxes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::base::Result;
use crate::base::id::{TiSlice, TiVec};
use crate::file::{RecordFile, Segment};
use crate::geometry::boxtree::Bounds;
use crate::geometry::tilted::TiltedBox;
use crate::geometry::triangle::{area, perimeter, texture_area};
use crate::geometry::triangle_tree::{self, Answer, Pair, Question, Tree, TreeView};
use crate::image::textures::TextureImages;
use crate::mesh::id::{FaceId, LocalVertex};
use crate::model::id::ImageId;
use crate::os::mmap::MappedRecords;
use crate::partition::ClusterSource;

/// Memory of a face of a cell while the cell is made, in bytes.
pub const FACE_BYTES: u64 = 440;

/// A triangle of a cell.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct CellFace {
    /// Indices of three vertices of the cell.
    pub vertices: [u32; 3],
    /// Texture image of the mesh, or none.
    pub image: ImageId,
    /// Texture coordinates, shifted by whole numbers so that the least lie between 0 and 1; zeros without a texture
    /// image.
    pub texcoords: [[f32; 2]; 3],
}

/// A texture image that some triangles show.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ShownImage {
    /// The image, or none.
    pub image: ImageId,
    /// Sum of the triangles' areas in texture space.
    pub texture_area: f64,
}

/// A cell: neighbouring triangles.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Cell {
    /// Positions are relative to this.
    pub origin: DVec3,
    /// The smallest box around its triangles.
    pub bounds: Bounds,
    /// Sum of the areas of its faces, in their order.
    pub area: f64,
    /// Sum of the lengths of their sides, in their order.
    pub side_length: f64,
    /// The texture images that its triangles show, ascending.
    pub images: Vec<ShownImage>,
    positions: Segment<DVec3>,
    pairs: Segment<Pair>,
    tilted: Segment<TiltedBox>,
    faces: Segment<CellFace>,
    colours: Segment<[u8; 4]>,
}

/// A cell that is being read.
#[derive(Debug)]
pub struct CellView {
    /// Its origin.
    pub origin: DVec3,
    /// Positions of its vertices, relative to the origin.
    pub positions: MappedRecords<DVec3>,
    /// Its triangles, in the order of the tree.
    pub faces: MappedRecords<CellFace>,
    /// Colour of each vertex, the fourth byte 0 where it has none; empty without colours.
    pub colours: MappedRecords<[u8; 4]>,
    pairs: MappedRecords<Pair>,
    tilted: MappedRecords<TiltedBox>,
}

impl Cell {
    /// Number of vertices.
    pub fn vertex_count(&self) -> u64 {
        self.positions.len()
    }

    /// Number of triangles.
    pub fn face_count(&self) -> u64 {
        self.faces.len()
    }

    /// Bytes of its records: what an open one takes at most.
    pub fn bytes(&self) -> u64 {
        let trees = self.pairs.bytes() + self.tilted.bytes();
        self.positions.bytes() + trees + self.faces.bytes() + self.colours.bytes()
    }

    /// Whether its vertices have colours.
    pub fn has_colours(&self) -> bool {
        !self.colours.is_empty()
    }

    /// Path of its file.
    pub fn path(&self) -> &Path {
        self.faces.path()
    }

    /// Sets the folder of the file of a recalled value.
    pub fn locate(&mut self, folder: &Path) {
        self.positions.locate(folder);
        self.pairs.locate(folder);
        self.tilted.locate(folder);
        self.faces.locate(folder);
        self.colours.locate(folder);
    }

    /// Reports whether a recalled and located value is consistent with its file.
    pub fn is_sound(&self) -> bool {
        self.positions.is_sound()
            && self.pairs.is_sound()
            && self.tilted.is_sound()
            && self.faces.is_sound()
            && self.colours.is_sound()
    }

    /// Opens the cell for reading.
    ///
    /// # Errors
    /// On failed reads.
    pub fn view(&self) -> Result<CellView> {
        Ok(CellView {
            origin: self.origin,
            positions: self.positions.window(0..self.positions.len())?,
            faces: self.faces.window(0..self.faces.len())?,
            pairs: self.pairs.window(0..self.pairs.len())?,
            tilted: self.tilted.window(0..self.tilted.len())?,
            colours: self.colours.window(0..self.colours.len())?,
        })
    }
}

impl CellView {
    /// Corners of a triangle, relative to the origin.
    #[inline]
    pub fn triangle(&self, face: u32) -> [DVec3; 3] {
        let [a, b, c] = self.faces[face as usize].vertices;
        [self.positions[a as usize], self.positions[b as usize], self.positions[c as usize]]
    }

    /// Answer of the cell's tree to a question, whose point is relative to the origin.
    pub fn ask(&self, question: &Question) -> Answer {
        self.tree().ask(question, |face| self.triangle(face))
    }

    /// The cell's tree.
    pub fn tree(&self) -> TreeView<'_> {
        TreeView { pairs: &self.pairs, tilted: &self.tilted, count: self.faces.len() }
    }
}

/// A cell before it is written to the file.
pub struct CellDraft {
    origin: DVec3,
    bounds: Bounds,
    area: f64,
    side_length: f64,
    /// Area in texture space by texture image.
    shown: BTreeMap<ImageId, f64>,
    positions: Vec<DVec3>,
    pairs: Vec<Pair>,
    tilted: Vec<TiltedBox>,
    faces: Vec<CellFace>,
    colours: Vec<[u8; 4]>,
}

impl CellDraft {
    /// A cell of some triangles; `colours` are those of the vertices, or empty. Positions are relative to `origin`.
    pub fn new(origin: DVec3, positions: Vec<DVec3>, faces: &[CellFace], colours: Vec<[u8; 4]>) -> Self {
        let corners = |face: &CellFace| face.vertices.map(|vertex| positions[vertex as usize]);
        let Tree { pairs, tilted, order } =
            triangle_tree::build(faces.len(), |number| corners(&faces[number as usize]));
        let faces: Vec<CellFace> = order.into_iter().map(|number| faces[number as usize]).collect();
        let (mut bounds, mut shown) = (Bounds::EMPTY, BTreeMap::new());
        let (mut all_area, mut side_length) = (0.0, 0.0);
        for face in &faces {
            let triangle = corners(face);
            bounds = bounds.with(Bounds::around(triangle));
            all_area += area(triangle);
            side_length += perimeter(triangle);
            *shown.entry(face.image).or_default() += texture_area(face.texcoords);
        }
        let bounds = Bounds { low: bounds.low + origin, high: bounds.high + origin };
        Self { origin, bounds, area: all_area, side_length, shown, positions, pairs, tilted, faces, colours }
    }

    /// Its part of six times the enclosed volume, divided by six, from the common apex of the tetrahedra.
    fn volume(&self, apex: DVec3) -> f64 {
        let of_face = |face: &CellFace| {
            let [a, b, c] = face.vertices.map(|vertex| self.positions[vertex as usize] + self.origin - apex);
            a.dot(b.cross(c)) / 6.0
        };
        self.faces.iter().map(of_face).sum()
    }

    /// Number of triangles.
    pub fn face_count(&self) -> u64 {
        self.faces.len() as u64
    }
}

/// Makes cells from clusters.
pub struct CellMaker<'a> {
    /// What each part of the mesh shows.
    pub images: &'a TextureImages,
}

impl CellMaker<'_> {
    /// Makes a cell; `colours` are those of the vertices, or empty.
    pub fn draft(&self, source: &ClusterSource, colours: Vec<[u8; 4]>) -> CellDraft {
        let mesh = &source.mesh;
        // Triangles that were left out have left their vertices.
        let mut is_used: TiVec<LocalVertex, bool> = vec![false; mesh.positions.len()].into();
        mesh.face_ids().flat_map(|face| mesh.vertices(face)).for_each(|vertex| is_used[vertex] = true);
        let mut count = 0;
        let number = |&is_used: &bool| {
            count += u32::from(is_used);
            count.saturating_sub(1)
        };
        let numbers: TiVec<LocalVertex, u32> = is_used.iter().map(number).collect();
        let face = |face: FaceId| {
            let (image, texcoords) = self.texture(source, face);
            CellFace { vertices: mesh.vertices(face).map(|vertex| numbers[vertex]), image, texcoords }
        };
        let faces: Vec<CellFace> = mesh.face_ids().map(face).collect();
        let positions = used(&is_used, &mesh.positions.raw);
        CellDraft::new(source.origin, positions, &faces, used(&is_used, &colours))
    }

    /// Texture image and texture coordinates of a face; its part's plain colour if it has no texture coordinates.
    fn texture(&self, source: &ClusterSource, face: FaceId) -> (ImageId, [[f32; 2]; 3]) {
        let part = source.mesh.parts[face];
        let image = self.images.of_part[part];
        let [a, b, c] = source.mesh.uv_triangle(face).map(|uv| self.images.placed(part, uv));
        let low = a.min(b).min(c).floor();
        if image == ImageId::NONE || !(a + b + c).is_finite() || self.images.plain_colour(image).is_some() {
            return (self.images.plain_of(part), [[0.0; 2]; 3]);
        }
        (image, [a, b, c].map(|uv| (uv - low).as_vec2().to_array()))
    }
}

/// The values of vertices that triangles use; none if there are none.
fn used<T: Copy>(is_used: &TiSlice<LocalVertex, bool>, values: &[T]) -> Vec<T> {
    values.iter().zip(is_used).filter(|(_, is_used)| **is_used).map(|(value, _)| *value).collect()
}

/// Writes cells one after the other.
pub struct CellWriter {
    path: PathBuf,
    file: RecordFile,
    cells: Vec<Cell>,
    /// Common apex of the tetrahedra that the volume is summed over.
    apex: DVec3,
    volume: f64,
}

impl CellWriter {
    /// Begins the file of the cells; the volume that they enclose is summed over tetrahedra with a common apex.
    ///
    /// # Errors
    /// If it cannot be created.
    pub fn create(path: &Path, apex: DVec3) -> Result<Self> {
        Ok(Self { path: path.to_owned(), file: RecordFile::create(path)?, cells: Vec::new(), apex, volume: 0.0 })
    }

    /// Writes a cell, if it has triangles.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn append(&mut self, draft: CellDraft) -> Result<()> {
        let positions = self.put(&draft.positions)?;
        let pairs = self.put(&draft.pairs)?;
        let tilted = self.put(&draft.tilted)?;
        let faces = self.put(&draft.faces)?;
        let colours = self.put(&draft.colours)?;
        self.volume += draft.volume(self.apex);
        if !draft.faces.is_empty() {
            let shown = |(image, texture_area)| ShownImage { image, texture_area };
            self.cells.push(Cell {
                origin: draft.origin,
                bounds: draft.bounds,
                area: draft.area,
                side_length: draft.side_length,
                images: draft.shown.into_iter().map(shown).collect(),
                positions,
                pairs,
                tilted,
                faces,
                colours,
            });
        }
        Ok(())
    }

    fn put<T: Pod>(&mut self, records: &[T]) -> Result<Segment<T>> {
        let bytes: &[u8] = bytemuck::cast_slice(records);
        let padding = bytes.len().next_multiple_of(8) - bytes.len();
        let begin = self.file.put(bytes)?;
        self.file.put(&[0; 8][..padding])?;
        Ok(Segment::new(self.path.clone(), begin, records.len() as u64))
    }

    /// Completes the file; returns the cells and the volume that they enclose.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn finish(self) -> Result<(Vec<Cell>, f64)> {
        self.file.finish(*b"cells   ", 0, self.cells.len() as u64)?;
        Ok((self.cells, self.volume))
    }
}

/// Texture coordinate at a point of a triangle.
pub fn texcoord_of(texcoords: &[[f32; 2]; 3], weights: [f64; 3]) -> [f32; 2] {
    [0, 1].map(|axis| (0..3).map(|corner| f64::from(texcoords[corner][axis]) * weights[corner]).sum::<f64>() as f32)
}
