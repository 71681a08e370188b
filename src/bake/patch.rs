//! One patch of the result: unwrapped, painted, encoded.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::density::texel_lengths;
use super::original::Original;
use super::paint::Painted;
use super::painters::Painters;
use super::patch_surface::PatchSurface;
use crate::base::id::TiVec;
use crate::base::{Progress, Result};
use crate::file::codec;
use crate::image::encode::encode;
use crate::job::Recalled;
use crate::mesh::ClusterMesh;
use crate::mesh::id::{FaceId, LocalVertex, Wedge};
use crate::model::StoredPiece;
use crate::model::id::PartId;
use crate::model::image_format::ImageFormat;
use crate::partition::ClusterSource;
use crate::unwrap::{ImageSize, Triangles, UnwrapSettings, Unwrapped, unwrap};

/// A baked image in the work folder.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct BakedImage {
    /// Its file.
    #[serde(with = "codec::path")]
    pub path: PathBuf,
    /// Width and height in texels.
    pub size: [u32; 2],
}

/// What was baked of a patch.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct BakedPatch {
    pub images: Vec<BakedImage>,
    pub pieces: Vec<StoredPiece>,
    pub charts: u64,
    /// Charts that were made smaller to fit an image.
    pub shrunk: u64,
    /// Texels that charts cover, and those of them without colour.
    pub covered: u64,
    pub colourless: u64,
}

impl BakedPatch {
    /// Adds what was baked of a further part; pieces are added separately.
    pub(super) fn add(&mut self, other: Self) {
        self.images.extend(other.images);
        self.charts += other.charts;
        self.shrunk += other.shrunk;
        self.covered += other.covered;
        self.colourless += other.colourless;
    }
}

impl Recalled for BakedPatch {
    type Context<'a> = ();

    fn locate(&mut self, folder: &Path, (): &()) {
        self.pieces.iter_mut().for_each(|piece| piece.locate(folder));
        for image in &mut self.images {
            if let Some(name) = image.path.file_name() {
                image.path = folder.join(name);
            }
        }
    }

    fn is_sound(&self, (): &()) -> bool {
        self.pieces.iter().all(StoredPiece::is_sound) && self.images.iter().all(|image| image.path.is_file())
    }
}

/// Unwraps and paints patches.
pub struct PatchBaker<'a> {
    original: &'a Original,
    /// Length of a texel's side where the original has its median.
    pub(super) texel: f64,
    /// Largest side of an image in texels.
    side: u32,
    painters: Painters<'a>,
}

/// How patches are baked.
#[derive(Debug, Clone, Copy)]
pub struct PatchSettings {
    /// Length of a texel's side where the original has its median, in the mesh's unit of length.
    pub texel: f64,
    /// What a surface that faces away counts as farther, in the same unit.
    pub away: f64,
    /// Largest side of an image in texels.
    pub side: u32,
    /// Threads that paint an image.
    pub painters: usize,
}

/// An image that was painted.
pub struct PaintedImage {
    /// Red, green and blue of each texel, row by row from the top.
    pub rgb: Vec<u8>,
    /// Width and height.
    pub size: [usize; 2],
    /// What was painted.
    pub painted: Painted,
}

/// A patch with its texture coordinates, before it is stored.
pub(super) struct TexturedPatch {
    pub source: ClusterSource,
    pub mesh: ClusterMesh,
    pub baked: BakedPatch,
}

impl<'a> PatchBaker<'a> {
    /// Prepares to bake patches of a mesh that lies near an original.
    pub fn new(original: &'a Original, settings: &PatchSettings, progress: &'a dyn Progress) -> Self {
        let PatchSettings { texel, away, side, painters } = *settings;
        Self { original, texel, side, painters: Painters::new(original, texel, away, painters, progress) }
    }

    /// Largest side of an image in texels.
    pub fn side(&self) -> u32 {
        self.side
    }

    /// Unwraps a patch; texels are `coarser` times as long as they are elsewhere.
    ///
    /// # Errors
    /// If the job is to stop; on failed reads.
    pub fn unwrap(&self, patch: &PatchSurface<'_>, coarser: f64) -> Result<Unwrapped> {
        self.unwrap_within(patch, coarser, self.side)
    }

    /// The same, into images with sides of at most `side` texels.
    ///
    /// # Errors
    /// If the job is to stop; on failed reads.
    pub fn unwrap_within(&self, patch: &PatchSurface<'_>, coarser: f64, side: u32) -> Result<Unwrapped> {
        let mut texels = texel_lengths(self.original, patch, self.texel)?;
        texels.iter_mut().for_each(|texel| *texel *= coarser);
        unwrap(patch.triangles, &UnwrapSettings { texels: &texels, side })
    }

    /// Paints an image of a patch.
    ///
    /// # Errors
    /// If the job was stopped, and on failed reads.
    pub fn paint(&self, patch: &PatchSurface<'_>, unwrapped: &Unwrapped, number: usize) -> Result<PaintedImage> {
        let charts = unwrapped.charts.iter().filter(|chart| chart.image as usize == number);
        let (mut canvas, painted) = self.painters.paint(patch, charts, unwrapped.images[number])?;
        canvas.fill();
        Ok(PaintedImage { rgb: canvas.rgb, size: canvas.size, painted })
    }

    /// Bakes a patch; the names of its images begin with `name`.
    ///
    /// # Errors
    /// On a full disk, failed reads and writes.
    pub(super) fn bake(
        &self,
        source: ClusterSource,
        format: ImageFormat,
        folder: &Path,
        name: &str,
    ) -> Result<TexturedPatch> {
        let mesh = &source.mesh;
        let triangles = Triangles { positions: &mesh.positions, vertices: &mesh.corner_vertices };
        let patch = PatchSurface { triangles, origin: source.origin };
        let unwrapped = self.unwrap(&patch, 1.0)?;
        let mut baked =
            BakedPatch { charts: unwrapped.charts.len() as u64, shrunk: unwrapped.shrunk, ..BakedPatch::default() };
        for (number, &ImageSize { width, height }) in unwrapped.images.iter().enumerate() {
            let PaintedImage { rgb, size, painted } = self.paint(&patch, &unwrapped, number)?;
            let path = folder.join(image_name(name, number, format));
            encode(&rgb, size, format, &path)?;
            baked.images.push(BakedImage { path, size: [width, height] });
            baked.covered += painted.covered;
            baked.colourless += painted.colourless;
        }
        let mesh = textured(mesh, &unwrapped);
        Ok(TexturedPatch { source, mesh, baked })
    }
}

fn image_name(patch: &str, number: usize, format: ImageFormat) -> String {
    let ending = format.ending();
    if number == 0 { format!("{patch}.{ending}") } else { format!("{patch}-{}.{ending}", number + 1) }
}

/// The mesh with the texture coordinates of its charts; the part of a face is the number of its image.
fn textured(mesh: &ClusterMesh, unwrapped: &Unwrapped) -> ClusterMesh {
    let mut out = ClusterMesh {
        positions: mesh.positions.clone(),
        flags: mesh.flags.clone(),
        copied_from: mesh.copied_from.clone(),
        ..ClusterMesh::default()
    };
    let mut wedge_of: TiVec<LocalVertex, Wedge> = mesh.per_vertex(Wedge::NONE);
    let mut used: Vec<LocalVertex> = Vec::new();
    for chart in &unwrapped.charts {
        let size = unwrapped.images[chart.image as usize];
        for (face, corners) in &chart.faces {
            let mut wedges = [Wedge::NONE; 3];
            for ((wedge, &vertex), corner) in wedges.iter_mut().zip(&mesh.corner_vertices[*face]).zip(corners) {
                if wedge_of[vertex] == Wedge::NONE {
                    wedge_of[vertex] = out.push_wedge(vertex, size.texcoord(*corner));
                    used.push(vertex);
                }
                *wedge = wedge_of[vertex];
            }
            push_face(&mut out, mesh, *face, wedges, PartId::new(chart.image));
        }
        // A vertex has one texture coordinate in each chart.
        used.drain(..).for_each(|vertex| wedge_of[vertex] = Wedge::NONE);
    }
    out.wedge_moved = vec![true; out.wedge_vertex.len()].into();
    out
}

fn push_face(out: &mut ClusterMesh, mesh: &ClusterMesh, face: FaceId, wedges: [Wedge; 3], part: PartId) {
    let new = out.push_face(wedges, part);
    out.deviations[new] = mesh.deviations[face];
}
