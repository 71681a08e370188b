//! Gives a tile of the finest level the texels of the input as they are.
//!
//! ```text
//! faces that show neighbouring texels of an image ── a chart: its texels, and GUTTER of their neighbours ── copied
//! faces of one plain colour                       ── a block of that colour
//! ```
//! Charts are moved by whole texels, and turned by a quarter at most, so that no texel is mixed of others.

use std::collections::{BTreeMap, HashMap};

use foldhash::fast::FixedState;
use glam::DVec2;

use super::mesh::TileMesh;
use crate::bake::{AtlasCanvas, Original, Painted, PaintedImage, TexelSource};
use crate::base::Result;
use crate::base::id::TiVec;
use crate::image::stored::{Beyond, PixelLine, TexelReader};
use crate::mesh::forest::DisjointSets;
use crate::mesh::id::FaceId;
use crate::model::id::ImageId;
use crate::unwrap::{FlatChart, GUTTER, PlacedChart, TexelRow, Unwrapped, pack, room};

/// Side of a block of one colour in texels.
const BLOCK: f64 = 2.0;

/// Where the texels of a chart come from.
#[derive(Debug, Clone, Copy, PartialEq)]
enum ChartSource {
    /// From an image: the column and row of its upper left corner, and what is shown beyond the image.
    Image(ImageId, [i64; 2], Beyond),
    /// They are all the same.
    Plain([u8; 3]),
}

/// Charts of a tile in one image.
pub struct CopiedCharts {
    /// Where they lie.
    pub unwrapped: Unwrapped,
    /// The source of each face's chart.
    source_of: TiVec<FaceId, Option<ChartSource>>,
}

/// Why a tile cannot have the texels of the input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Uncopied {
    /// They do not fit one image.
    TooMany,
    /// Some faces show the colours of their vertices, or none.
    NoTexels,
}

impl CopiedCharts {
    /// The charts of a tile, in an image with sides of up to `side` texels; `width` is that of the image, if it is known.
    pub fn new(
        mesh: &TileMesh,
        original: &Original,
        side: u32,
        width: Option<u32>,
    ) -> std::result::Result<Self, Uncopied> {
        let mut charts = ChartList { mesh, room: room(side), flat: Vec::new(), sources: Vec::new() };
        let mut plain: BTreeMap<[u8; 3], Vec<FaceId>> = BTreeMap::new();
        let mut images: BTreeMap<ImageId, Vec<FaceId>> = BTreeMap::new();
        for (face, shown) in mesh.shown.iter_enumerated() {
            match original.source(shown.image) {
                TexelSource::Image(_) => images.entry(shown.image).or_default().push(face),
                TexelSource::Plain(colour) => plain.entry(colour).or_default().push(face),
                TexelSource::Nothing => return Err(Uncopied::NoTexels),
            }
        }
        plain.into_iter().for_each(|(colour, faces)| charts.add_block(colour, &faces));
        for (image, faces) in images {
            let TexelSource::Image(stored) = original.source(image) else { continue };
            let size = DVec2::from(stored.size().map(f64::from));
            connected(mesh, &faces).into_iter().try_for_each(|faces| charts.add_image(image, size, faces))?;
        }
        let ChartList { flat, sources, .. } = charts;
        let mut source_of: TiVec<FaceId, Option<ChartSource>> = vec![None; mesh.faces.len()].into();
        for (chart, source) in flat.iter().zip(sources) {
            chart.faces.iter().for_each(|(face, _)| source_of[*face] = Some(source));
        }
        let unwrapped = pack(flat, side, width);
        if unwrapped.images.len() > 1 || unwrapped.shrunk > 0 {
            return Err(Uncopied::TooMany);
        }
        Ok(Self { unwrapped, source_of })
    }

    /// Width of the image.
    pub fn width(&self) -> Option<u32> {
        self.unwrapped.images.first().map(|size| size.width)
    }

    /// Copies the texels.
    ///
    /// # Errors
    /// On failed reads.
    pub fn paint(&self, reader: &mut TexelReader<'_>) -> Result<PaintedImage> {
        let size = self.unwrapped.images.first().map_or([0; 2], |size| [size.width, size.height]);
        let mut canvas = AtlasCanvas::new(size.map(|side| side as usize));
        let mut covered = 0;
        for chart in &self.unwrapped.charts {
            let Some(source) = chart.faces.first().and_then(|(face, _)| self.source_of[*face]) else { continue };
            covered += covered_texels(chart, source);
            for TexelRow { first, own, count } in chart.room.rows() {
                let row = canvas.set_row(first, count);
                match source {
                    ChartSource::Plain(colour) => row.fill(colour),
                    ChartSource::Image(id, corner, beyond) => {
                        let from = [0, 1].map(|axis| corner[axis] + i64::from(own[axis]) - i64::from(GUTTER));
                        let line = if chart.room.is_turned { PixelLine::Upwards } else { PixelLine::Rightwards };
                        reader.copy(id, from, line, beyond, row)?;
                    }
                }
            }
        }
        canvas.fill();
        Ok(PaintedImage { rgb: canvas.rgb, size: canvas.size, painted: Painted { covered, colourless: 0 } })
    }
}

/// Texels that the triangles of a chart cover, about; not more than it takes of the image, if some lie on others.
fn covered_texels(chart: &PlacedChart, source: ChartSource) -> u64 {
    if let ChartSource::Plain(_) = source {
        return (BLOCK * BLOCK) as u64;
    }
    let doubled_area = |&(_, [a, b, c]): &(FaceId, [DVec2; 3])| (b - a).perp_dot(c - a).abs();
    let area = 0.5 * chart.faces.iter().map(doubled_area).sum::<f64>();
    let taken = chart.room.rows().map(|row| row.count as u64).sum();
    (area.round() as u64).min(taken)
}

/// A corner of a face, by its place and its texture coordinate.
type ShownCorner = [u32; 5];

/// Divides faces of one image into parts whose faces share edges with the same texture coordinates.
fn connected(mesh: &TileMesh, faces: &[FaceId]) -> Vec<Vec<FaceId>> {
    let corner = |face: FaceId, at: usize| -> ShownCorner {
        let [x, y, z] = mesh.places[mesh.faces[face][at]].to_array().map(i32::cast_unsigned);
        let [across, up] = mesh.shown[face].texcoords[at].map(f32::to_bits);
        [x, y, z, across, up]
    };
    let mut sets = DisjointSets::<FaceId>::new(faces.len());
    // Most edges are shared by two faces.
    let edges = 3 * faces.len() / 2;
    let mut known: HashMap<[u32; 10], FaceId, FixedState> =
        HashMap::with_capacity_and_hasher(edges, FixedState::default());
    for (number, &face) in FaceId::first(faces.len()).zip(faces) {
        let corners = [0, 1, 2].map(|at| corner(face, at));
        for at in 0..3 {
            let [a, b] = [corners[at], corners[(at + 1) % 3]];
            let ends = if a <= b { [a, b] } else { [b, a] };
            let mut edge = [0; 10];
            edge.copy_from_slice(ends.as_flattened());
            let other = *known.entry(edge).or_insert(number);
            sets.join(other, number);
        }
    }
    let mut parts: BTreeMap<FaceId, Vec<FaceId>> = BTreeMap::new();
    for (number, &face) in FaceId::first(faces.len()).zip(faces) {
        parts.entry(sets.root(number)).or_default().push(face);
    }
    parts.into_values().collect()
}

/// Charts before they are packed.
struct ChartList<'a> {
    mesh: &'a TileMesh,
    /// Longest side of a chart in texels.
    room: f64,
    flat: Vec<FlatChart>,
    /// The source of each.
    sources: Vec<ChartSource>,
}

impl ChartList<'_> {
    /// Adds a block of one colour, in the middle of which all its faces lie.
    fn add_block(&mut self, colour: [u8; 3], faces: &[FaceId]) {
        let middle = [DVec2::splat(0.5 * BLOCK); 3];
        let faces = faces.iter().map(|&face| (face, middle)).collect();
        self.flat.push(FlatChart { faces, size: DVec2::splat(BLOCK) });
        self.sources.push(ChartSource::Plain(colour));
    }

    /// Adds a part of an image of this size in texels; one that is too long is divided.
    fn add_image(&mut self, image: ImageId, size: DVec2, faces: Vec<FaceId>) -> std::result::Result<(), Uncopied> {
        let shown = &self.mesh.shown;
        // In texels from the upper left corner of the image.
        let place = |at: [f32; 2]| DVec2::new(f64::from(at[0]), 1.0 - f64::from(at[1])) * size;
        let corners = |face: FaceId| shown[face].texcoords.map(place);
        let mut pending = vec![faces];
        while let Some(faces) = pending.pop() {
            let all = || faces.iter().flat_map(|&face| corners(face));
            let low = all().fold(DVec2::INFINITY, DVec2::min).floor();
            let high = all().fold(DVec2::NEG_INFINITY, DVec2::max).ceil();
            let length = high - low;
            let fits = length.max_element() <= self.room;
            if !fits {
                let axis = usize::from(length.y > length.x);
                let middle = |face: FaceId| corners(face).iter().map(|corner| corner[axis]).sum::<f64>();
                let mean = faces.iter().map(|&face| middle(face)).sum::<f64>() / faces.len() as f64;
                let (below, above): (Vec<FaceId>, Vec<FaceId>) = faces.iter().partition(|&&face| middle(face) < mean);
                if below.is_empty() || above.is_empty() {
                    return Err(Uncopied::TooMany);
                }
                pending.extend([below, above]);
                continue;
            }
            let repeats = faces.iter().any(|&face| shown[face].texcoords.iter().flatten().any(|&at| at > 1.0));
            let beyond = if repeats { Beyond::Repeat } else { Beyond::Edge };
            // The second axis of a flat chart points up.
            let upwards = |corner: DVec2| DVec2::new(corner.x - low.x, high.y - corner.y);
            let placed = faces.iter().map(|&face| (face, corners(face).map(upwards))).collect();
            self.flat.push(FlatChart { faces: placed, size: length });
            self.sources.push(ChartSource::Image(image, [low.x as i64, low.y as i64], beyond));
        }
        Ok(())
    }
}
