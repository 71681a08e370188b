//! Bakes the patches of a result, and puts the textured mesh together.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::original::{Original, OriginalSurface};
use super::patch::{BakedImage, BakedPatch, PatchBaker, TexturedPatch};
use super::texels::StoredImage;
use super::{BakeLimits, BakeSettings, PATCH, PATCHES, SURFACE};
use crate::base::ordered::map_in_order;
use crate::base::{Findings, Permits, Progress, Result};
use crate::image::textures::TextureImages;
use crate::job::{Recalled, Step, StepKey, WorkFolder};
use crate::mesh::ClusterMesh;
use crate::model::catalogue::{Material, MaterialDefinition, Part, TextureStatement};
use crate::model::id::{FileId, ImageId, MaterialId, PartId};
use crate::model::{Catalogue, StoredMesh, StoredPiece};
use crate::os::mmap;
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
const REACH_DEVIATIONS: f64 = 1.0;
/// Bytes of a texel of an image, and of a triangle of a patch.
const TEXEL_BYTES: f64 = 4.3;
const FACE_BYTES: u64 = 600;
/// Bytes that a worker takes besides.
const WORKER_BYTES: u64 = 16 << 20;

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
struct Patches {
    partition: Partition,
    patch_faces: u64,
}

impl Recalled for Patches {
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

/// The catalogue that the passes see: materials with an image are one.
pub fn geometry_catalogue(catalogue: &Catalogue, images: &TextureImages) -> Catalogue {
    let mut plain = catalogue.clone();
    for (part, &image) in plain.parts.iter_mut().zip(&images.of_part) {
        if image != ImageId::NONE {
            part.material = None;
        }
    }
    plain.has_texcoords = false;
    plain
}

/// Bakes textures for a simplified mesh from the surface of the input; `after` is the step that recorded the mesh.
///
/// # Errors
/// On a full disk, failed reads and writes, and damaged files.
pub fn bake(
    surface: OriginalSurface,
    mesh: &StoredMesh,
    catalogue: &Catalogue,
    after: &StepKey,
    settings: &BakeSettings,
    work: &WorkFolder,
    limits: &BakeLimits,
    progress: &dyn Progress,
) -> Result<Baked> {
    let mut findings = Findings::default();
    let mut images = TextureImages::find(catalogue, &mut findings);
    images.add_plain_colours(catalogue);
    let original = Original::open(surface, &images, work, limits, &mut findings, progress)?;
    mmap::release_freed_memory();
    let baking = Baking::new(mesh, catalogue, &original, settings, work, limits, progress)?;
    let (mesh, figures, files) = baking.run(after)?;
    findings.count("colourless_texels", figures.colourless);
    findings.count("shrunk_charts", figures.shrunk);
    for stored in original.images.iter().flatten().map(StoredImage::path) {
        let _ = std::fs::remove_file(stored);
    }
    Ok(Baked { mesh, catalogue: image_catalogue(catalogue, &files, work.path()), figures, findings })
}

/// A bake under way.
struct Baking<'a> {
    mesh: &'a StoredMesh,
    /// With the decimals of the input, and no part.
    catalogue: Catalogue,
    baker: PatchBaker<'a>,
    patch_faces: u64,
    work: &'a WorkFolder,
    limits: &'a BakeLimits,
    progress: &'a dyn Progress,
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
        mesh: &'a StoredMesh,
        catalogue: &Catalogue,
        original: &'a Original,
        settings: &BakeSettings,
        work: &'a WorkFolder,
        limits: &'a BakeLimits,
        progress: &'a dyn Progress,
    ) -> Result<Self> {
        let texel = original.median_texel / settings.texels.sqrt();
        let all = original.area / (texel * texel);
        let room = IMAGE_SHARE * FILL * f64::from(settings.side) * f64::from(settings.side);
        let faces = mesh.face_count();
        let patch_faces = (faces as f64 * room / all) as u64;
        let baker = PatchBaker {
            original,
            settings: *settings,
            texel,
            reach: std::env::var("REACH")
                .ok()
                .and_then(|t| t.parse().ok())
                .unwrap_or(REACH_DEVIATIONS * settings.deviation),
        };
        let catalogue = Catalogue {
            position_decimals: catalogue.position_decimals,
            texcoord_decimals: catalogue.texcoord_decimals,
            ..Catalogue::default()
        };
        let patch_faces = patch_faces.clamp(PATCH_FACES[0], PATCH_FACES[1]);
        Ok(Self { mesh, catalogue, baker, patch_faces, work, limits, progress })
    }

    fn cut(&self, after: &StepKey) -> Result<Partition> {
        if let Some(Patches { partition, .. }) = self.work.recall(&PATCHES, &self.mesh)? {
            return Ok(partition);
        }
        let options = PartitionOptions {
            cluster_faces: self.patch_faces,
            pass: 0,
            weld: false,
            drop_doubles: false,
            drop_texcoords: false,
            threads: self.limits.threads,
            work_bytes: self.limits.work_bytes,
        };
        self.progress.begin("partition", 0, "");
        let partition = partition::partition(self.mesh, &self.catalogue, self.work.path(), "bake-patches", &options)?;
        let patches = Patches { partition, patch_faces: self.patch_faces };
        let step = Step::new(PATCHES).from([after.clone(), SURFACE]).of_size(patches.partition.filled_count());
        self.work.keep(step, patches.partition.files(), &patches)?;
        Ok(patches.partition)
    }

    fn run(&self, after: &StepKey) -> Result<(StoredMesh, BakedFigures, Vec<BakedImage>)> {
        let partition = self.cut(after)?;
        let scale = TextureScale::none(&self.catalogue);
        let canvas_bytes = image_bytes(self.baker.settings.side);
        let permits = Permits::new(self.limits.work_bytes);
        self.progress.begin("bake", partition.total_faces(), "faces");
        let (mut mesh, mut figures) = (StoredMesh::default(), BakedFigures::default());
        figures.texel = self.baker.texel;
        let mut files = Vec::new();
        let work = |cluster: ClusterId| {
            self.progress.check_stopped()?;
            if let Some(baked) = self.work.recall::<BakedPatch>(&patch_key(cluster), &())? {
                return Ok(Ready::Recalled(baked));
            }
            if partition.weight(cluster).is_none() {
                return Ok(Ready::Heavy(cluster));
            }
            let _permit = permits.take(canvas_bytes + FACE_BYTES * partition.face_count(cluster));
            let source = cluster::load(&partition, self.mesh, &self.catalogue, &scale, cluster)?;
            let patch = self.baker.bake(source, self.work.path(), patch_key(cluster).name())?;
            Ok(Ready::Baked(cluster, Box::new(patch)))
        };
        let clusters = partition.clusters().filter(|&cluster| partition.face_count(cluster) > 0);
        map_in_order(clusters, self.limits.threads, self.limits.threads + 1, work, |ready| {
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
                        let name = format!("{}-{}", patch_key(cluster).name(), baked.pieces.len());
                        let patch = self.baker.bake(source, self.work.path(), &name)?;
                        let first_image = first_image + baked.images.len() as u32;
                        self.store(patch, &partition, cluster, first_image, &mut baked)
                    };
                    heavy::load_in_blocks(&partition, self.mesh, &self.catalogue, &scale, cluster, &mut take)?;
                    self.record(cluster, baked)?
                }
            };
            self.progress.advance(baked.pieces.iter().map(|piece| piece.faces.len()).sum());
            figures.charts += baked.charts;
            figures.shrunk += baked.shrunk;
            figures.covered += baked.covered;
            figures.colourless += baked.colourless;
            files.extend(baked.images);
            mesh.pieces.extend(baked.pieces);
            Ok(())
        })?;
        write_shared(&partition, self.work.path(), "bake-patches", &mut mesh)?;
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
        let name = format!("{}-{}.piece", patch_key(cluster).name(), baked.pieces.len());
        let path = self.work.path().join(name);
        let pending = source.write(&mesh, partition, &self.catalogue, &scale, None, &path)?;
        baked.pieces.push(pending.commit()?);
        baked.images.extend(own.images);
        baked.charts += own.charts;
        baked.shrunk += own.shrunk;
        baked.covered += own.covered;
        baked.colourless += own.colourless;
        baked.first_image = first_image;
        Ok(())
    }

    fn record(&self, cluster: ClusterId, baked: BakedPatch) -> Result<BakedPatch> {
        let files = baked.pieces.iter().flat_map(StoredPiece::files);
        let files: Vec<&Path> = files.chain(baked.images.iter().map(|image| image.path.as_path())).collect();
        let faces = baked.pieces.iter().map(|piece| piece.faces.len()).sum();
        self.work.keep(Step::new(patch_key(cluster)).from([PATCHES]).of_size(faces), files, &baked)?;
        Ok(baked)
    }
}

/// Memory of a worker that bakes an image of this side, in bytes.
pub fn image_bytes(side: u32) -> u64 {
    (TEXEL_BYTES * f64::from(side) * f64::from(side)) as u64 + WORKER_BYTES
}

fn patch_key(cluster: ClusterId) -> StepKey {
    StepKey::numbered(format!("{PATCH}{:06}", cluster.number()))
}

fn number_parts(mesh: &mut ClusterMesh, first_image: u32) {
    mesh.parts.iter_mut().for_each(|part| *part = part.plus(first_image));
}

/// A catalogue with a part and a material for each image.
fn image_catalogue(input: &Catalogue, images: &[BakedImage], folder: &Path) -> Catalogue {
    let material_of = |image: &BakedImage| {
        let name = image.path.file_name().map(|name| name.as_encoded_bytes().to_vec()).unwrap_or_default();
        let stem = image.path.file_stem().map(|stem| stem.as_encoded_bytes().to_vec()).unwrap_or_default();
        let map = TextureStatement { key_and_options: b"map_Kd".to_vec(), name };
        let statements = vec![b"Ka 1 1 1".to_vec(), b"Kd 1 1 1".to_vec(), b"Ks 0 0 0".to_vec(), b"illum 1".to_vec()];
        let definition = MaterialDefinition { folder: folder.to_owned(), statements, textures: vec![map] };
        Material { name: stem.clone(), output_name: stem, definition: Some(definition) }
    };
    let part =
        |material: MaterialId| Part { file: FileId::new(0), object: None, group: None, material: Some(material) };
    let materials: crate::base::id::TiVec<MaterialId, Material> = images.iter().map(material_of).collect();
    let parts: crate::base::id::TiVec<PartId, Part> = materials.keys().map(part).collect();
    Catalogue {
        files: input.files.clone(),
        folders: vec![folder.to_owned()],
        materials,
        parts,
        has_normals: input.has_normals,
        has_texcoords: true,
        position_decimals: input.position_decimals,
        texcoord_decimals: input.texcoord_decimals.max(6),
        ..Catalogue::default()
    }
}
