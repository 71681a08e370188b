//! What is unwrapped, and how.

use std::ops::Range;

use glam::{DVec2, DVec3};

use super::image_size::{CELL, ImageSize};
use crate::base::id::TiSlice;
use crate::mesh::id::{FaceId, LocalVertex};

/// The triangles of a patch.
#[derive(Debug, Clone, Copy)]
pub struct Triangles<'a> {
    /// Position of each vertex.
    pub positions: &'a TiSlice<LocalVertex, DVec3>,
    /// Vertices of each triangle, counter-clockwise.
    pub vertices: &'a TiSlice<FaceId, [LocalVertex; 3]>,
}

impl Triangles<'_> {
    /// Corners of a triangle.
    #[inline]
    pub fn corners(&self, face: FaceId) -> [DVec3; 3] {
        self.vertices[face].map(|vertex| self.positions[vertex])
    }
}

/// How to unwrap.
#[derive(Debug, Clone, Copy)]
pub struct UnwrapSettings<'a> {
    /// Length of a texel's side on each triangle, in the mesh's unit of length; those of a chart get their mean.
    pub texels: &'a TiSlice<FaceId, f64>,
    /// Largest side of an image, in texels; at least 64.
    pub side: u32,
}

/// A chart in its image.
#[derive(Debug, Clone)]
pub struct PlacedChart {
    /// Number of the image.
    pub image: u32,
    /// Its triangles, each with the places of its corners in texels from the upper left corner of the image, downwards.
    pub faces: Vec<(FaceId, [DVec2; 3])>,
    /// What it takes of the image.
    pub room: ChartRoom,
}

/// The texels that a chart takes of its image, with its gutter.
#[derive(Debug, Clone, Default)]
pub struct ChartRoom {
    /// Column and row of the upper left corner of the box around them.
    pub corner: [u32; 2],
    /// Width and height of that box before the chart was turned.
    pub size: [u32; 2],
    /// Whether it was turned by a quarter, so that what was above is on the right.
    pub is_turned: bool,
    /// Rows of square cells in that box, as it lies in the image: the row and its columns.
    pub cells: Vec<(u32, Range<u32>)>,
}

/// Neighbouring texels of a row of an image.
#[derive(Debug, Clone, Copy)]
pub struct TexelRow {
    /// Column and row of the first one in the image.
    pub first: [usize; 2],
    /// The same in the box of the chart before it was turned: there, the others follow on the right, or above if the
    /// chart was turned.
    pub own: [u32; 2],
    /// Number of texels.
    pub count: usize,
}

impl ChartRoom {
    /// All texels, row by row.
    pub fn rows(&self) -> impl Iterator<Item = TexelRow> + '_ {
        let row_of = |row: u32, columns: &Range<u32>| {
            let column = columns.start * CELL;
            TexelRow {
                first: [self.corner[0] + column, self.corner[1] + row].map(|at| at as usize),
                own: if self.is_turned { [row, self.size[1] - 1 - column] } else { [column, row] },
                count: (columns.len() as u32 * CELL) as usize,
            }
        };
        let rows =
            self.cells.iter().flat_map(|(row, columns)| (row * CELL..(row + 1) * CELL).map(move |row| (row, columns)));
        rows.map(move |(row, columns)| row_of(row, columns))
    }
}

/// Charts in their images.
#[derive(Debug, Clone, Default)]
pub struct Unwrapped {
    /// The charts.
    pub charts: Vec<PlacedChart>,
    /// Size of each image.
    pub images: Vec<ImageSize>,
    /// Charts that were made smaller, because they would not fit an image.
    pub shrunk: u64,
}
