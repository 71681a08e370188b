//! Bakes the patches of a result, and puts the textured mesh together.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::catalogue::image_catalogue;
use super::original::{Original, OriginalSurface};
use super::painters::PAINTER_BYTES;
use super::patch::{BakedImage, BakedPatch, PatchBaker, PatchSettings, TexturedPatch};
use super::settings::{BakePlace, BakeSettings};
use super::steps::{BakeStep, PATCHES, SURFACE};
use crate::base::ordered::map_in_order;
use crate::base::{Error, Findings, Permits, Result, WorkLimits, bytes};
use crate::job::{Recalled, Step, StepKey};
use crate::mesh::ClusterMesh;
use crate::model::{Catalogue, StoredMesh, StoredPiece};
use crate::os::system;
use crate::partition::{
    self, ClusterId, ClusterSource, Partition, PartitionOptions, TextureScale, cluster, heavy, write_shared,
};

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

/// Bakes textures for a simplified mesh from the surface of the input.
///
/// # Errors
/// On a full disk, failed reads and writes, and damaged files.
pub fn bake(
    surface: OriginalSurface,
    result: &Unbaked<'_>,
    settings: &BakeSettings,
    place: &BakePlace<'_>,
) -> Result<Baked> {
    let Unbaked { catalogue, .. } = *result;
    let mut findings = Findings::default();
    let original = Original::open(surface, catalogue, place, &mut findings)?;
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
    /// With the decimals of the input, and no part.
    catalogue: Catalogue,
    baker: PatchBaker<'a>,
    settings: BakeSettings,
    patch_faces: u64,
    /// Memory of all patches in flight, in bytes.
    patch_bytes: u64,
    place: BakePlace<'a>,
}

/// What a worker hands over.
enum Ready {
    Baked(ClusterId, Box<TexturedPatch>),
    Recalled(BakedPatch),
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
        let WorkLimits { threads, work_bytes } = place.limits;
        let most = (work_bytes.saturating_sub(canvas_bytes(settings.side)) / PAINTER_BYTES) as usize;
        let count = most.clamp(1, threads.max(1));
        let of_patches = PatchSettings { texel, away, side: settings.side, painters: count };
        let baker = PatchBaker::new(original, &of_patches, place.progress);
        let patch_bytes = work_bytes.saturating_sub(count as u64 * PAINTER_BYTES);
        let catalogue = Catalogue {
            position_decimals: result.catalogue.position_decimals,
            texcoord_decimals: result.catalogue.texcoord_decimals,
            ..Catalogue::default()
        };
        refuse_too_many_texels(all, settings.texels, place.work.path())?;
        Ok(Self { result: *result, catalogue, baker, settings: *settings, patch_faces, patch_bytes, place: *place })
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
        let canvas_bytes = canvas_bytes(self.settings.side);
        let permits = Permits::new(self.patch_bytes);
        self.place.progress.begin("bake", partition.total_faces(), "faces");
        let (mut mesh, mut figures) = (StoredMesh::default(), BakedFigures::default());
        figures.texel = self.baker.texel;
        let mut files = Vec::new();
        let work = |cluster: ClusterId| {
            self.place.progress.check_stopped()?;
            if let Some(baked) = self.place.work.recall::<BakedPatch>(&BakeStep::Patch(cluster).key(), &())? {
                return Ok(Ready::Recalled(baked));
            }
            if partition.weight(cluster).is_none() {
                return Ok(Ready::Heavy(cluster));
            }
            let _permit = permits.take(canvas_bytes + FACE_BYTES * partition.face_count(cluster));
            let source = cluster::load(&partition, self.result.mesh, &self.catalogue, &scale, cluster)?;
            let patch = self.baker.bake(
                source,
                self.settings.format,
                self.place.work.path(),
                BakeStep::Patch(cluster).key().name(),
            )?;
            Ok(Ready::Baked(cluster, Box::new(patch)))
        };
        let clusters = partition.clusters().filter(|&cluster| partition.face_count(cluster) > 0);
        map_in_order(clusters, self.place.limits.threads, self.place.limits.threads + 1, work, |ready| {
            let first_image = files.len() as u32;
            let baked = match ready {
                Ready::Recalled(baked) => baked,
                Ready::Baked(cluster, patch) => {
                    let mut baked = BakedPatch::default();
                    self.store(*patch, &partition, cluster, first_image, &mut baked)?;
                    self.record(cluster, baked)?
                }
                Ready::Heavy(cluster) => {
                    let mut baked = BakedPatch::default();
                    let mut take = |source: ClusterSource| {
                        let name = format!("{}-{}", BakeStep::Patch(cluster).key().name(), baked.pieces.len());
                        let patch = self.baker.bake(source, self.settings.format, self.place.work.path(), &name)?;
                        let first_image = first_image + baked.images.len() as u32;
                        self.store(patch, &partition, cluster, first_image, &mut baked)
                    };
                    heavy::load_in_blocks(&partition, self.result.mesh, &self.catalogue, &scale, cluster, &mut take)?;
                    self.record(cluster, baked)?
                }
            };
            self.place.progress.advance(baked.pieces.iter().map(|piece| piece.faces.len()).sum());
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

    /// Writes the piece of a patch, whose images have numbers from `first_image` on.
    fn store(
        &self,
        patch: TexturedPatch,
        partition: &Partition,
        cluster: ClusterId,
        first_image: u32,
        baked: &mut BakedPatch,
    ) -> Result<()> {
        let TexturedPatch { source, mut mesh, baked: own } = patch;
        number_parts(&mut mesh, first_image);
        let scale = TextureScale::none(&self.catalogue);
        let name = format!("{}-{}.piece", BakeStep::Patch(cluster).key().name(), baked.pieces.len());
        let path = self.place.work.path().join(name);
        let pending = source.write(&mesh, partition, &self.catalogue, &scale, None, &path)?;
        baked.pieces.push(pending.commit()?);
        baked.images.extend(own.images);
        baked.charts += own.charts;
        baked.shrunk += own.shrunk;
        baked.covered += own.covered;
        baked.colourless += own.colourless;
        Ok(())
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
        let patch = canvas_bytes(side).min(largest as u64) + (FACE_BYTES as f64 * of_image(self.faces)) as u64;
        threads as u64 * PAINTER_BYTES + self.images.min(threads as u64) * patch
    }
}

/// Least memory of a bake with images of this side, in bytes.
pub fn image_bytes(side: u32) -> u64 {
    canvas_bytes(side) + PAINTER_BYTES
}

/// Memory of an image of this side that is being baked, in bytes.
fn canvas_bytes(side: u32) -> u64 {
    (TEXEL_BYTES * f64::from(side) * f64::from(side)) as u64
}

fn number_parts(mesh: &mut ClusterMesh, first_image: u32) {
    mesh.parts.iter_mut().for_each(|part| *part = part.plus(first_image));
}
