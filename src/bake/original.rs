//! The surface of the input, kept until its colours are baked.
//!
//! ```text
//! mesh as it was read ── partition ──▶ cells with trees ──▶ bake-surface.cells
//! image files ── decode ──▶ tiles ──▶ bake-image-000003.texels
//! ```

use std::path::Path;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::prism::Shown;
use super::settings::BakePlace;
use super::steps::{BakeStep, SURFACE};
use crate::base::id::TiVec;
use crate::base::{Findings, Progress, Result};
use crate::geometry::triangle::{area, texture_area};
use crate::image::decode::DecodePlan;
use crate::image::stored::{Beyond, StoredImage, TexelReader, decode_within};
use crate::image::textures::TextureImages;
use crate::job::{Recalled, Step, StepKey, WorkFolder};
use crate::model::id::ImageId;
use crate::model::{Catalogue, StoredMesh};
use crate::os::mmap;
use crate::read::SCAN;
use crate::surface::cell::{Cell, CellFace, CellView};
use crate::surface::cells::{SurfaceCells, SurfacePlace};

/// Texels of a surface without images, for each of its triangles.
pub const TEXELS_OF_FACE: f64 = 8.0;
/// Texels that a triangle shows at most: 262,144 images of 2048 × 2048. With more, its texture coordinates are taken to be
/// wrong, and it shows no image: others would get hardly any texels for its sake.
const SHOWN_TEXELS_MAX: f64 = (1u64 << 40) as f64;
/// Steps for a factor of two, and factors of two from 1 downwards and upwards, in which lengths of texels are counted: all
/// that double precision has.
const STEPS: f64 = 32.0;
const OCTAVES: f64 = 1100.0;
/// The surface of the input.
#[derive(Debug, Serialize, Deserialize)]
pub struct OriginalSurface {
    pub(super) surface: SurfaceCells,
}

impl Recalled for OriginalSurface {
    type Context<'a> = ();

    fn locate(&mut self, folder: &Path, (): &()) {
        self.surface.locate(folder);
    }

    fn is_sound(&self, (): &()) -> bool {
        self.surface.is_sound()
    }
}

impl OriginalSurface {
    /// Diagonal of the smallest box around it.
    pub fn diagonal(&self) -> f64 {
        self.surface.bounds.diagonal()
    }

    /// Recalls the surface that an earlier process kept.
    ///
    /// # Errors
    /// Those of [`WorkFolder::recall`].
    pub fn recall(work: &WorkFolder) -> Result<Option<Self>> {
        work.recall(&SURFACE, &())
    }

    /// Recalls the surface, or prepares it from the mesh as it was read.
    ///
    /// # Errors
    /// On a full disk, failed reads and writes, and damaged files.
    pub fn prepare(
        mesh: &StoredMesh,
        catalogue: &Catalogue,
        images: &TextureImages,
        place: &BakePlace<'_>,
    ) -> Result<Self> {
        let BakePlace { work, limits, progress } = *place;
        if let Some(surface) = Self::recall(work)? {
            return Ok(surface);
        }
        let place = SurfacePlace { folder: work.path(), name: "bake", limits, progress };
        let surface = Self { surface: SurfaceCells::make(mesh, catalogue, images, &place)? };
        work.keep(Step::new(SURFACE).from([SCAN]), surface.surface.path(), &surface)?;
        Ok(surface)
    }
}

/// The surface of the input and its images, ready to be searched.
#[derive(Debug, Serialize, Deserialize)]
pub struct Original {
    /// Its cells.
    pub surface: SurfaceCells,
    pub(super) images: TiVec<ImageId, Option<StoredImage>>,
    plain: Vec<[u8; 3]>,
    /// The plain colour that shows instead of each image, where that could not be decoded.
    instead: TiVec<ImageId, Option<[u8; 3]>>,
    /// Pixels of each image in its file.
    pixels: TiVec<ImageId, f64>,
    /// Length of a texel's side, half of the surface that shows images has longer ones; what has no image counts as if
    /// each triangle had [`TEXELS_OF_FACE`].
    pub median_texel: f64,
    /// Area of the surface.
    pub area: f64,
    /// Number of its triangles.
    pub face_count: u64,
}

impl Recalled for Original {
    type Context<'a> = ();

    fn locate(&mut self, folder: &Path, (): &()) {
        self.surface.locate(folder);
        self.images.iter_mut().flatten().for_each(|image| image.locate(folder));
    }

    fn is_sound(&self, (): &()) -> bool {
        self.surface.is_sound()
            && self.images.iter().flatten().all(StoredImage::is_sound)
            && self.pixels.len() == self.images.len()
            && self.instead.len() == self.images.len()
    }
}

/// Where the colours of a triangle come from.
#[derive(Debug, Clone, Copy)]
pub enum TexelSource<'a> {
    /// From an image.
    Image(&'a StoredImage),
    /// They are all the same.
    Plain([u8; 3]),
    /// It has none, or those of its vertices.
    Nothing,
}

/// How often lengths occur: of texels by area, of edges by number.
pub struct LengthHistogram {
    /// Weight of each range of lengths, [`STEPS`] of them for a factor of two.
    weights: Vec<f64>,
}

impl Default for LengthHistogram {
    fn default() -> Self {
        Self { weights: vec![0.0; 2 * (OCTAVES * STEPS) as usize] }
    }
}

impl LengthHistogram {
    /// Adds a length.
    pub fn add(&mut self, length: f64, weight: f64) {
        let step = (libm::log2(length) * STEPS).floor() + OCTAVES * STEPS;
        let step = step.clamp(0.0, (self.weights.len() - 1) as f64) as usize;
        self.weights[step] += weight;
    }

    /// The length below which this share of them lies; `None` if there are none.
    pub fn quantile(&self, share: f64) -> Option<f64> {
        let wanted = share * self.weights.iter().sum::<f64>();
        let mut below = 0.0;
        let step = self.weights.iter().position(|weight| {
            below += weight;
            below >= wanted && wanted > 0.0
        })?;
        Some(libm::exp2((step as f64 + 0.5 - OCTAVES * STEPS) / STEPS))
    }
}

/// A decoded image, or why there is none.
#[derive(Debug, Serialize, Deserialize)]
struct DecodedImage {
    stored: Option<StoredImage>,
    findings: Findings,
}

impl Recalled for DecodedImage {
    type Context<'a> = ();

    fn locate(&mut self, folder: &Path, (): &()) {
        self.stored.iter_mut().for_each(|stored| stored.locate(folder));
    }

    fn is_sound(&self, (): &()) -> bool {
        self.stored.iter().all(StoredImage::is_sound) && self.findings.are_plain()
    }
}

impl Original {
    /// A surface whose images are stored already, and whose texels are about `texel` long.
    pub fn of_stored(surface: SurfaceCells, images: TiVec<ImageId, Option<StoredImage>>, texel: f64) -> Self {
        let pixels = |image: &Option<StoredImage>| {
            image.as_ref().map_or(0.0, |image| image.size().map(f64::from).iter().product())
        };
        Self {
            pixels: images.iter().map(pixels).collect(),
            instead: vec![None; images.len()].into(),
            images,
            plain: Vec::new(),
            median_texel: texel,
            area: surface.area(),
            face_count: surface.face_count(),
            surface,
        }
    }

    /// Decodes the images that a surface shows, of those that its materials have.
    ///
    /// # Errors
    /// On a full disk, failed reads and writes; an image that cannot be decoded is noted.
    pub fn open(
        surface: OriginalSurface,
        images: &TextureImages,
        place: &BakePlace<'_>,
        findings: &mut Findings,
    ) -> Result<Self> {
        let BakePlace { work, limits, progress } = *place;
        let surface = surface.surface;
        let mut are_shown: TiVec<ImageId, bool> = vec![false; images.files.len()].into();
        for shown in surface.cells.iter().flat_map(|cell| &cell.images) {
            if let Some(is_shown) = are_shown.get_mut(shown.image) {
                *is_shown = true;
            }
        }
        let shown: Vec<ImageId> = are_shown.keys().filter(|&image| are_shown[image]).collect();
        progress.begin("decode", shown.len() as u64, "images");
        let mut original = Self {
            images: vec![None; images.files.len()].into(),
            plain: images.plain.clone(),
            instead: images.plain_of_files(),
            pixels: vec![0.0; images.files.len()].into(),
            median_texel: 0.0,
            area: surface.area(),
            face_count: surface.face_count(),
            surface,
        };
        let files = shown.iter().map(|&image| (image, &*images.files[image].path));
        let decode = |image: ImageId, plan| decoded(image, &images.files[image].path, plan, work);
        decode_within(limits.work_bytes, files, decode, |image, decoded: DecodedImage| {
            progress.advance(1);
            progress.check_stopped()?;
            findings.merge(decoded.findings);
            let size = decoded.stored.as_ref().map_or([0; 2], StoredImage::full_size);
            original.pixels[image] = size.map(f64::from).iter().product();
            original.images[image] = decoded.stored;
            Ok(())
        })?;
        original.median_texel = original.find_median_texel(progress, findings)?;
        mmap::release_freed_memory();
        Ok(original)
    }

    /// Pixels of all images that are shown.
    pub fn image_pixels(&self) -> f64 {
        self.pixels.iter().sum()
    }

    /// What an id stands for.
    #[inline]
    pub fn source(&self, image: ImageId) -> TexelSource<'_> {
        if let Some(Some(stored)) = self.images.get(image) {
            return TexelSource::Image(stored);
        }
        self.plain_colour(image).map_or(TexelSource::Nothing, TexelSource::Plain)
    }

    /// Where the colours of a triangle of a cell come from: those of its vertices come before a plain one.
    pub fn source_of(&self, view: &CellView, face: u32) -> TexelSource<'_> {
        let vertices = view.faces[face as usize].vertices;
        let is_coloured = |vertex: u32| view.colours.get(vertex as usize).is_some_and(|colour| colour[3] > 0);
        match self.source(self.image_of(&view.faces[face as usize])) {
            TexelSource::Plain(_) if vertices.into_iter().any(is_coloured) => TexelSource::Nothing,
            source => source,
        }
    }

    /// The image that a triangle shows; none if its texture coordinates are too large to be right.
    #[inline]
    pub fn image_of(&self, face: &CellFace) -> ImageId {
        let texels = |pixels: &f64| texture_area(face.texcoords) * pixels;
        let is_too_large = self.pixels.get(face.image).map(texels).is_some_and(|texels| texels > SHOWN_TEXELS_MAX);
        if is_too_large { ImageId::NONE } else { face.image }
    }

    /// A reader of its images.
    pub fn reader(&self) -> TexelReader<'_> {
        TexelReader::new(&self.images)
    }

    /// The steps that recorded its images.
    pub fn image_steps(&self) -> Vec<StepKey> {
        let images = self.images.iter_enumerated().filter(|(_, stored)| stored.is_some());
        images.map(|(image, _)| BakeStep::Image(image).key()).collect()
    }

    /// Whether an image, a material or a vertex has a colour.
    pub fn has_colour(&self) -> bool {
        !self.images.is_empty() || !self.plain.is_empty() || self.surface.cells.iter().any(Cell::has_colours)
    }

    /// What a triangle of a cell shows.
    pub(super) fn shown(&self, view: &CellView, face: u32) -> Shown {
        let CellFace { vertices, texcoords, .. } = view.faces[face as usize];
        let image = self.image_of(&view.faces[face as usize]);
        if let TexelSource::Image(_) = self.source(image) {
            let repeats = texcoords.iter().flatten().any(|&at| at > 1.0);
            return Shown::Image(image, texcoords, if repeats { Beyond::Repeat } else { Beyond::Edge });
        }
        let plain = self.plain_colour(image).map(|colour| Vec3::from_array(colour.map(f32::from)));
        let [a, b, c] = vertices.map(|vertex| view.colours.get(vertex as usize).copied());
        match (a.zip(b).zip(c), plain) {
            (Some(((a, b), c)), plain) => Shown::Vertices([a, b, c], plain),
            (None, Some(colour)) => Shown::Plain(colour),
            (None, None) => Shown::Nothing,
        }
    }

    /// Length of a texel's side on a triangle of this area that shows an image; `None` where it shows none.
    #[inline]
    pub(super) fn texel_of(&self, shown: &Shown, area: f64) -> Option<f64> {
        let Shown::Image(image, texcoords, _) = *shown else { return None };
        let texel = (area / (texture_area(texcoords) * self.pixels.get(image)?)).sqrt();
        texel.is_normal().then_some(texel)
    }

    fn find_median_texel(&self, progress: &dyn Progress, findings: &mut Findings) -> Result<f64> {
        let mut lengths = LengthHistogram::default();
        for cell in &self.surface.cells {
            progress.check_stopped()?;
            let view = cell.view()?;
            for number in 0..view.faces.len() as u32 {
                let area = area(view.triangle(number));
                if self.image_of(&view.faces[number as usize]) != view.faces[number as usize].image {
                    findings.note("repeated_images", || {
                        let place = view.triangle(number)[0] + view.origin;
                        format!("a triangle at {place} shows more than 2⁴⁰ texels, so its image is ignored")
                    });
                }
                if let Some(texel) = self.texel_of(&self.shown(&view, number), area) {
                    lengths.add(texel, area);
                }
            }
        }
        let without = (self.area / (TEXELS_OF_FACE * self.face_count as f64)).sqrt();
        Ok(lengths.quantile(0.5).unwrap_or(if without.is_normal() { without } else { 1.0 }))
    }

    /// The plain colour that an id stands for, or that shows instead of its image.
    #[inline]
    fn plain_colour(&self, image: ImageId) -> Option<[u8; 3]> {
        match image.index().checked_sub(self.images.len()) {
            Some(number) => self.plain.get(number).copied(),
            None => self.instead[image],
        }
    }
}

/// Recalls an image, or decodes it.
fn decoded(
    image: ImageId,
    path: &Path,
    plan: std::result::Result<DecodePlan, String>,
    work: &WorkFolder,
) -> Result<DecodedImage> {
    let key = BakeStep::Image(image).key();
    if let Some(decoded) = work.recall::<DecodedImage>(&key, &())? {
        return Ok(decoded);
    }
    let mut findings = Findings::default();
    let file = work.path().join(format!("{}.texels", key.name()));
    let stored = StoredImage::decode(path, plan, &file, &mut findings)?;
    let decoded = DecodedImage { stored, findings };
    work.keep(Step::new(key).from([SURFACE]), decoded.stored.iter().map(StoredImage::path), &decoded)?;
    Ok(decoded)
}
