//! Bakes the patches of a result, and puts the textured mesh together.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::arithmetic;
use super::catalogue::image_catalogue;
use super::closest::FINDER_BYTES;
use super::crew::{BAKE, PatchCrew, piece_path};
use super::original::{Original, OriginalSurface};
use super::painters::PAINTER_BYTES;
use super::patch::{BakedImage, BakedPatch, PatchBaker, PatchSettings};
use super::settings::{BakePlace, BakeSettings};
use super::steps::{BakeStep, PATCHES, SURFACE};
use crate::base::ordered::map_in_order;
use crate::base::{Error, Findings, Permits, Result, WorkLimits, bytes};
use crate::image::textures::TextureImages;
use crate::job::{Recalled, Step, StepKey};
use crate::lend::{Lendable, LentItem, LentResults, encoded, lend};
use crate::model::{Catalogue, StoredMesh, StoredPiece};
use crate::os::system;
use crate::partition::{self, ClusterId, Partition, PartitionOptions, PieceContent, TextureScale, write_shared};

/// Share of an image that charts are taken to fill, when the size of a patch is chosen.
const FILL: f64 = 0.55;
/// Share of an image that the charts of a patch take, about; patches differ.
const IMAGE_SHARE: f64 = 0.6;
/// Smallest and largest number of triangles of a patch.
const PATCH_FACES: [u64; 2] = [256, 50_000];
/// A surface that faces away counts as farther by this many deviations of the result.
const AWAY_DEVIATIONS: f64 = 1.0;
/// Bytes of a texel of an image, and of a triangle of a patch.
const TEXEL_BYTES: f64 = 4.3;
const FACE_BYTES: u64 = 600;
/// Texels of the largest image, about, for each of one that is as large as the mean.
const LARGEST: f64 = 1.8;
/// Bytes of a texel in a file, about, that the disk must have room for.
const IMAGE_TEXEL_BYTES: f64 = 0.5;

/// The textured result.
#[derive(Debug)]
pub struct Baked {
    /// The mesh; the parts of its faces are those of the catalogue.
    pub mesh: StoredMesh,
    /// A part and a material for each image, which lie in the work folder.
    pub catalogue: Catalogue,
    /// What was baked.
    pub figures: BakedFigures,
    /// Images that could not be read, or not whole; texels without colour.
    pub findings: Findings,
}

/// What was baked.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BakedFigures {
    /// Images.
    pub images: u64,
    /// Texels of all images.
    pub texels: u64,
    /// Texels that charts cover.
    pub covered: u64,
    /// Texels where the original has no colour.
    pub colourless: u64,
    /// Charts.
    pub charts: u64,
    /// Charts that were made smaller, because they would not fit an image.
    pub shrunk: u64,
    /// Length of a texel's side, in the mesh's unit of length.
    pub texel: f64,
}

/// The partition of the result into patches.
#[derive(Serialize, Deserialize)]
struct PatchCut {
    partition: Partition,
    patch_faces: u64,
}

impl Recalled for PatchCut {
    type Context<'a> = &'a StoredMesh;

    fn locate(&mut self, folder: &Path, _: &&StoredMesh) {
        self.partition.locate(folder);
    }

    fn is_sound(&self, mesh: &&StoredMesh) -> bool {
        self.partition.is_sound(mesh, self.patch_faces)
    }
}

/// Bakes textures for a simplified mesh from the surface of the input.
///
/// # Errors
/// On a full disk, failed reads and writes, and damaged files.
pub fn bake(
    surface: OriginalSurface,
    images: &TextureImages,
    result: &Unbaked<'_>,
    settings: &BakeSettings,
    place: &BakePlace<'_>,
) -> Result<Baked> {
    let Unbaked { catalogue, .. } = *result;
    let mut findings = Findings::default();
    let original = Original::open(surface, images, place, &mut findings)?;
    let baking = Baking::new(result, &original, settings, place)?;
    let (mesh, figures, files) = baking.run()?;
    findings.count("colourless_texels", figures.colourless);
    findings.count("shrunk_charts", figures.shrunk);
    Ok(Baked { mesh, catalogue: image_catalogue(catalogue, &files, place.work.path()), figures, findings })
}

/// A simplified mesh that gets new textures.
#[derive(Clone, Copy)]
pub struct Unbaked<'a> {
    /// The mesh.
    pub mesh: &'a StoredMesh,
    /// Parts and materials of the input.
    pub catalogue: &'a Catalogue,
    /// The step that recorded the mesh.
    pub step: &'a StepKey,
}

/// A bake under way.
struct Baking<'a> {
    result: Unbaked<'a>,
    original: &'a Original,
    /// With the decimals of the input, and no part.
    catalogue: Catalogue,
    of_patches: PatchSettings,
    settings: BakeSettings,
    patch_faces: u64,
    /// Memory of all patches in flight, in bytes.
    patch_bytes: u64,
    place: BakePlace<'a>,
}

/// What a worker hands over.
enum Ready {
    Baked(ClusterId, Box<(BakedPatch, PieceContent)>),
    /// Recorded before, and whether the progress knows of it.
    Known(BakedPatch, bool),
    /// Too many triangles to load at once.
    Heavy(ClusterId),
}

impl<'a> Baking<'a> {
    fn new(
        result: &Unbaked<'a>,
        original: &'a Original,
        settings: &BakeSettings,
        place: &BakePlace<'a>,
    ) -> Result<Self> {
        let texel = original.median_texel / settings.texels.sqrt();
        let all = original.area / (texel * texel);
        let patch_faces = patch_faces(all, result.mesh.face_count(), settings.side);
        let away = AWAY_DEVIATIONS * settings.deviation;
        let painters = painter_count(settings.side, place.limits);
        let of_patches = PatchSettings { texel, away, side: settings.side, painters };
        let patch_bytes = place.limits.work_bytes.saturating_sub(painters as u64 * PAINTER_BYTES);
        let catalogue = Catalogue {
            position_decimals: result.catalogue.position_decimals,
            texcoord_decimals: result.catalogue.texcoord_decimals,
            ..Catalogue::default()
        };
        refuse_too_many_texels(all, settings.texels, place.work.path())?;
        let (result, settings, place) = (*result, *settings, *place);
        Ok(Self { result, original, catalogue, of_patches, settings, patch_faces, patch_bytes, place })
    }

    fn cut(&self) -> Result<Partition> {
        if let Some(PatchCut { partition, .. }) = self.place.work.recall(&PATCHES, &self.result.mesh)? {
            return Ok(partition);
        }
        let options = PartitionOptions {
            cluster_faces: self.patch_faces,
            pass: 0,
            weld: false,
            drop_doubles: false,
            drop_texcoords: true,
            threads: self.place.limits.threads,
            work_bytes: self.place.limits.work_bytes,
        };
        self.place.progress.begin("partition", 0, "");
        let partition =
            partition::partition(self.result.mesh, &self.catalogue, self.place.work.path(), "bake-patches", &options)?;
        let patches = PatchCut { partition, patch_faces: self.patch_faces };
        let step =
            Step::new(PATCHES).from([self.result.step.clone(), SURFACE]).of_size(patches.partition.filled_count());
        self.place.work.keep(step, patches.partition.files(), &patches)?;
        Ok(patches.partition)
    }

    fn run(&self) -> Result<(StoredMesh, BakedFigures, Vec<BakedImage>)> {
        let partition = self.cut()?;
        let scale = TextureScale::none(&self.catalogue);
        let crew = PatchCrew {
            baker: PatchBaker::new(self.original, &self.of_patches, self.place.progress),
            partition: &partition,
            mesh: self.result.mesh,
            catalogue: &self.catalogue,
            scale: &scale,
            format: self.settings.format,
        };
        let permits = Permits::new(self.patch_bytes);
        self.place.progress.begin("bake", partition.total_faces(), "faces");
        let lent = self.lend(&crew)?;
        let (mut mesh, mut figures) = (StoredMesh::default(), BakedFigures::default());
        figures.texel = crew.baker.texel;
        let mut files = Vec::new();
        let folder = self.place.work.path();
        let work = |cluster: ClusterId| {
            self.place.progress.check_stopped()?;
            if let Some(baked) = self.place.work.recall::<BakedPatch>(&BakeStep::Patch(cluster).key(), &())? {
                return Ok(Ready::Known(baked, false));
            }
            if let Some((baked, is_told)) = lent.result(folder, cluster, &())? {
                return Ok(Ready::Known(baked, is_told));
            }
            if partition.weight(cluster).is_none() {
                return Ok(Ready::Heavy(cluster));
            }
            let _permit = permits.take(patch_bytes(self.settings.side, &partition, cluster));
            let (baked, content) = crew.bake(cluster, folder)?;
            Ok(Ready::Baked(cluster, Box::new((baked, content))))
        };
        let clusters = partition.clusters().filter(|&cluster| partition.face_count(cluster) > 0);
        map_in_order(clusters, self.place.limits.threads, self.place.limits.threads + 1, work, |ready| {
            let mut is_told = false;
            let mut baked = match ready {
                Ready::Known(baked, told) => {
                    is_told = told;
                    baked
                }
                Ready::Baked(cluster, patch) => {
                    let (mut baked, content) = *patch;
                    baked.pieces.push(content.write(&piece_path(folder, cluster, 0))?.commit()?);
                    self.record(cluster, baked)?
                }
                Ready::Heavy(cluster) => self.record(cluster, crew.bake_in_blocks(cluster, folder)?)?,
            };
            if !is_told {
                self.place.progress.advance(baked.pieces.iter().map(|piece| piece.faces.len()).sum());
            }
            baked.pieces.iter_mut().for_each(|piece| piece.faces.raise_parts(files.len() as u32));
            figures.charts += baked.charts;
            figures.shrunk += baked.shrunk;
            figures.covered += baked.covered;
            figures.colourless += baked.colourless;
            files.extend(baked.images);
            mesh.pieces.extend(baked.pieces);
            Ok(())
        })?;
        write_shared(&partition, self.place.work.path(), "bake-patches", &mut mesh)?;
        figures.images = files.len() as u64;
        figures.texels = files.iter().map(|image| image.size.map(u64::from).iter().product::<u64>()).sum();
        Ok((mesh, figures, files))
    }

    /// Has patches baked by other processes, if the job has any; returns what they did, now or before.
    fn lend(&self, crew: &PatchCrew<'_>) -> Result<LentResults<ClusterId>> {
        let partition = crew.partition;
        let what = Lendable {
            kind: BAKE,
            items: LentItem::clusters_of(partition),
            prefix: BakeStep::PREFIX_OF_PATCHES.to_owned(),
            parent: Some(PATCHES),
            arithmetic: &|| arithmetic::checksum(self.settings.format),
            is_counted: true,
            is_read_whole: false,
        };
        let PatchSettings { texel, away, side, .. } = self.of_patches;
        let (mesh, format, original) = (self.result.mesh, self.settings.format, self.original);
        let details = (original, mesh, partition, &self.catalogue, [texel, away], side, format, self.patch_faces);
        lend(self.place.work, &what, || encoded(&details), self.place.progress)
    }

    fn record(&self, cluster: ClusterId, baked: BakedPatch) -> Result<BakedPatch> {
        let files = baked.pieces.iter().flat_map(StoredPiece::files);
        let files: Vec<&Path> = files.chain(baked.images.iter().map(|image| image.path.as_path())).collect();
        let faces = baked.pieces.iter().map(|piece| piece.faces.len()).sum();
        self.place.work.keep(
            Step::new(BakeStep::Patch(cluster).key()).from([PATCHES]).of_size(faces),
            files,
            &baked,
        )?;
        Ok(baked)
    }
}

/// Refuses images that the disk cannot hold, before any of them is baked.
fn refuse_too_many_texels(texels: f64, share: f64, folder: &Path) -> Result<()> {
    match system::free_disk_bytes(folder) {
        Ok(free) if texels * IMAGE_TEXEL_BYTES > free as f64 => Err(Error::NoSpace {
            path: folder.to_owned(),
            message: format!(
                "the new images would have about {:.0} million texels, and {} are free; give `texels` below {share}",
                texels / 1e6,
                bytes::display(free),
            ),
        }),
        _ => Ok(()),
    }
}

/// Number of triangles of a patch, if `faces` triangles have `texels` texels in images of this side.
pub fn patch_faces(texels: f64, faces: u64, side: u32) -> u64 {
    let room = IMAGE_SHARE * FILL * f64::from(side) * f64::from(side);
    ((faces as f64 * room / texels) as u64).clamp(PATCH_FACES[0], PATCH_FACES[1])
}

/// What is baked in all.
#[derive(Debug, Clone, Copy)]
pub struct BakeSize {
    /// Texels of all images.
    pub texels: u64,
    /// Images.
    pub images: u64,
    /// Triangles of the result.
    pub faces: u64,
}

impl BakeSize {
    /// Memory that `threads` threads take for images of this side at most, in bytes, if it is there.
    pub fn expected_bytes(self, side: u32, threads: usize) -> u64 {
        let of_image = |count: u64| count as f64 / self.images.max(1) as f64;
        let largest = LARGEST * TEXEL_BYTES * of_image(self.texels);
        let faces = (FACE_BYTES as f64 * of_image(self.faces)) as u64;
        let patch = canvas_bytes(side).min(largest as u64) + faces + FINDER_BYTES;
        threads as u64 * PAINTER_BYTES + self.images.min(threads as u64) * patch
    }
}

/// Least memory of a bake with images of this side, in bytes.
pub fn image_bytes(side: u32) -> u64 {
    canvas_bytes(side) + FINDER_BYTES + PAINTER_BYTES
}

/// Memory of a patch that is being baked, beside that of the painters, in bytes.
pub(super) fn patch_bytes(side: u32, partition: &Partition, cluster: ClusterId) -> u64 {
    canvas_bytes(side) + FACE_BYTES * partition.face_count(cluster) + FINDER_BYTES
}

/// Painters of images of this side.
pub(super) fn painter_count(side: u32, limits: WorkLimits) -> usize {
    let most = (limits.work_bytes.saturating_sub(canvas_bytes(side) + FINDER_BYTES) / PAINTER_BYTES) as usize;
    most.clamp(1, limits.threads.max(1))
}

/// Memory of an image of this side that is being baked, in bytes.
fn canvas_bytes(side: u32) -> u64 {
    (TEXEL_BYTES * f64::from(side) * f64::from(side)) as u64
}
