//! Gives the mesh of a tile its texture: unwrapped into one image, painted with the colours of the input.

use std::collections::HashMap;

use foldhash::fast::FixedState;
use glam::{DVec2, DVec3, IVec3};

use super::copy::CopiedCharts;
use super::glb::{TileContent, TileVertex};
use super::lattice::Lattice;
use super::mesh::TileMesh;
use super::one_image::{PaintedPatch, paint_in_one};
use super::skirt::Strip;
use crate::bake::{Painted, PaintedImage, PatchBaker, PatchSurface};
use crate::base::Result;
use crate::base::id::TiVec;
use crate::image::encode::encode_in_memory;
use crate::image::stored::TexelReader;
use crate::mesh::id::{FaceId, LocalVertex};
use crate::model::image_format::ImageFormat;
use crate::unwrap::{Triangles, Unwrapped};

/// A painted tile.
pub struct PaintedTile {
    /// What its file holds.
    pub content: TileContent,
    /// Texels of its image.
    pub texels: u64,
    /// What was painted.
    pub painted: Painted,
    /// Charts.
    pub charts: u64,
    /// Whether its texels are longer than those of the level.
    pub is_reduced: bool,
    /// Its image; `None` for a tile without texture.
    pub image: Option<PaintedImage>,
    /// Texture coordinates, with (0, 0) at the lower left, of the faces of the mesh that have some.
    pub texcoords: Vec<(FaceId, [[f32; 2]; 3])>,
}

/// A tile before it is painted.
pub struct BareTile<'a> {
    /// Its mesh.
    pub mesh: &'a TileMesh,
    /// Its skirt.
    pub strips: &'a [Strip],
    /// The lattice of its level.
    pub lattice: Lattice,
    /// Origin of the scene, in the coordinates of the input.
    pub scene_origin: DVec3,
}

impl BareTile<'_> {
    /// The tile without texture.
    pub fn plain(&self) -> PaintedTile {
        let mut builder = ContentBuilder::new(self);
        let corners = |face: FaceId| [0, 1, 2].map(|corner| (self.mesh.faces[face][corner], DVec2::ZERO));
        self.mesh.faces.keys().for_each(|face| builder.add_face(face, 0, corners(face)));
        PaintedTile {
            content: builder.finish(None),
            texels: 0,
            painted: Painted::default(),
            charts: 0,
            is_reduced: false,
            image: None,
            texcoords: Vec::new(),
        }
    }

    /// Paints the tile with the colours that the original shows there.
    ///
    /// # Errors
    /// If the job was stopped, and on failed reads.
    pub fn paint(&self, baker: &PatchBaker<'_>, format: ImageFormat) -> Result<PaintedTile> {
        let Self { mesh, lattice, scene_origin, .. } = *self;
        let triangles = Triangles { positions: &mesh.positions, vertices: &mesh.faces };
        let patch = PatchSurface { triangles, origin: scene_origin + lattice.position(mesh.middle) };
        let PaintedPatch { unwrapped, image, is_reduced } = paint_in_one(baker, &patch)?;
        let Some(image) = image else { return Ok(self.plain()) };
        Ok(PaintedTile { is_reduced, ..self.with_image(&unwrapped, image, format)? })
    }

    /// Copies the texels of the original.
    ///
    /// # Errors
    /// On failed reads.
    pub fn copy(
        &self,
        charts: &CopiedCharts,
        reader: &mut TexelReader<'_>,
        format: ImageFormat,
    ) -> Result<PaintedTile> {
        if charts.unwrapped.images.is_empty() {
            return Ok(self.plain());
        }
        self.with_image(&charts.unwrapped, charts.paint(reader)?, format)
    }

    fn with_image(&self, unwrapped: &Unwrapped, image: PaintedImage, format: ImageFormat) -> Result<PaintedTile> {
        let bytes = encode_in_memory(&image.rgb, image.size, format, "an image of a tile")?;
        let size = DVec2::from(image.size.map(|side| side as f64));
        let mut builder = ContentBuilder::new(self);
        let mut texcoords = Vec::with_capacity(self.mesh.faces.len());
        for (chart, charted) in unwrapped.charts.iter().enumerate() {
            for &(face, flat) in &charted.faces {
                let corners = [0, 1, 2].map(|corner| (self.mesh.faces[face][corner], flat[corner] / size));
                builder.add_face(face, chart as u32, corners);
                texcoords.push((face, corners.map(|(_, at)| DVec2::new(at.x, 1.0 - at.y).as_vec2().to_array())));
            }
        }
        let content = builder.finish(Some((bytes, format)));
        let texels = image.size.map(|side| side as u64).iter().product();
        let charts = unwrapped.charts.len() as u64;
        Ok(PaintedTile {
            content,
            texels,
            painted: image.painted,
            charts,
            is_reduced: false,
            image: Some(image),
            texcoords,
        })
    }
}

/// Numbers the vertices of a tile: one for each vertex of the mesh and chart, and those of the skirt.
struct ContentBuilder<'a> {
    tile: &'a BareTile<'a>,
    content: TileContent,
    numbers: HashMap<(LocalVertex, u32), u32, FixedState>,
    /// Numbers of the vertices of each face.
    of_face: TiVec<FaceId, [u32; 3]>,
}

/// Number of no vertex.
const NO_VERTEX: u32 = u32::MAX;

impl<'a> ContentBuilder<'a> {
    fn new(tile: &'a BareTile<'a>) -> Self {
        let middle = tile.lattice.position(tile.mesh.middle);
        Self {
            tile,
            content: TileContent { step: tile.lattice.step, middle, ..TileContent::default() },
            numbers: HashMap::default(),
            of_face: vec![[NO_VERTEX; 3]; tile.mesh.faces.len()].into(),
        }
    }

    fn add_face(&mut self, face: FaceId, chart: u32, corners: [(LocalVertex, DVec2); 3]) {
        let Self { tile, content, numbers, of_face } = self;
        let number = |(vertex, texcoord): (LocalVertex, DVec2)| {
            *numbers.entry((vertex, chart)).or_insert_with(|| {
                let place = tile.mesh.places[vertex] - tile.mesh.middle;
                content.vertices.push(TileVertex { place, texcoord });
                content.vertices.len() as u32 - 1
            })
        };
        of_face[face] = corners.map(number);
        content.triangles.push(of_face[face]);
    }

    /// Adds the skirt, which shows what the border shows.
    fn add_skirt(&mut self) {
        let Self { tile, content, of_face, .. } = self;
        let mut feet: HashMap<(u32, IVec3), u32, FixedState> = HashMap::default();
        for strip in tile.strips {
            let corners = of_face[strip.edge.face];
            let ends = [corners[strip.edge.corner], corners[(strip.edge.corner + 1) % 3]];
            if ends.contains(&NO_VERTEX) {
                continue;
            }
            let mut foot = |end: usize| {
                let place = strip.feet[end] - tile.mesh.middle;
                *feet.entry((ends[end], place)).or_insert_with(|| {
                    let texcoord = content.vertices[ends[end] as usize].texcoord;
                    content.vertices.push(TileVertex { place, texcoord });
                    content.vertices.len() as u32 - 1
                })
            };
            let below = [foot(0), foot(1)];
            content.triangles.push([ends[1], ends[0], below[0]]);
            content.triangles.push([ends[1], below[0], below[1]]);
            content.skirt_triangles += 2;
        }
    }

    fn finish(mut self, image: Option<(Vec<u8>, ImageFormat)>) -> TileContent {
        self.add_skirt();
        self.content.settle();
        TileContent { image, ..self.content }
    }
}
