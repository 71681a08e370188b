//! Makes the tiles of a level: each is read, gets its skirt, is painted, compared with the input, and encoded.

use std::path::Path;
use std::sync::Mutex;

use serde::{Deserialize, Serialize};

use super::colours::{ColourError, ColourMeter};
use super::copy::{CopiedCharts, Uncopied};
use super::cut::CutLevel;
use super::figures::TileRecord;
use super::mesh::TileMesh;
use super::paint::{BareTile, PaintedTile};
use super::raw::RawDraft;
use super::scene::TileScene;
use super::settings::TileSettings;
use super::skirt::{LEVELS_APART, SkirtShape};
use super::tree::TileId;
use crate::bake::{Original, PAINTER_BYTES, PatchBaker, PatchSettings};
use crate::base::lock::lock;
use crate::base::{Progress, Result, WorkLimits};
use crate::image::stored::TexelReader;
use crate::job::Recalled;
use crate::os::content::Content;
use crate::surface::cells::SurfaceCells;

/// Memory of a triangle of a tile while it is made, in bytes, and of a texel.
const FACE_BYTES: u64 = 700;
const TEXEL_BYTES: u64 = 8;
/// Memory of a thread that compares the colours of tiles with those of the input, in bytes.
const METER_BYTES: u64 = 10 << 20;

/// What the tiles of a level are made of.
pub struct LevelPlan<'a> {
    /// Where the pyramid lies.
    pub scene: &'a TileScene,
    /// How tiles are made.
    pub settings: &'a TileSettings,
    /// Number of the level.
    pub number: u32,
    /// Number of the coarsest level.
    pub coarsest: u32,
    /// What a surface that faces away counts as farther.
    pub away: f64,
    /// The tiles, ascending.
    pub nodes: &'a [TileId],
    /// Their triangles.
    pub triangles: &'a CutLevel,
    /// Width of the image of each, if it is known.
    pub widths: &'a [Option<u32>],
    /// The surface of the input.
    pub input: &'a Original,
    /// The finished tiles of the level below, which these are baked from; `None` if they are from the input.
    pub below: Option<&'a Original>,
    /// The surfaces of the levels that may be neighbours; `None` for that of the input.
    pub others: Vec<Option<&'a SurfaceCells>>,
}

impl LevelPlan<'_> {
    /// Memory of the tile at an index while it is made, in bytes.
    pub fn tile_bytes(&self, index: usize) -> u64 {
        let texels = u64::from(self.settings.side) * u64::from(self.settings.side);
        let of_texel = TEXEL_BYTES + self.settings.format.encoder_bytes();
        self.triangles.len(index) * FACE_BYTES + texels * of_texel
    }
}

/// A tile that is not written yet.
#[derive(Debug, Serialize, Deserialize)]
pub struct MadeTile {
    /// What is recorded of it.
    pub record: TileRecord,
    /// What the next coarser level is baked from.
    pub raw: Option<RawDraft>,
    /// Its file.
    pub glb: Vec<u8>,
}

impl Recalled for MadeTile {
    /// The node that it should be.
    type Context<'a> = TileId;

    fn locate(&mut self, _: &Path, _: &TileId) {}

    fn is_sound(&self, node: &TileId) -> bool {
        self.record.node == *node
            && self.record.content == Content::of_bytes(&self.glb)
            && self.raw.as_ref().is_none_or(RawDraft::is_sound)
    }
}

/// Makes the tiles of a level, on several threads.
pub struct TileCrew<'a> {
    plan: &'a LevelPlan<'a>,
    /// What tiles are painted from.
    source: &'a Original,
    skirt: SkirtShape<'a>,
    baker: PatchBaker<'a>,
    readers: Mutex<Vec<TexelReader<'a>>>,
    meter: ColourMeter<'a>,
}

impl<'a> TileCrew<'a> {
    /// Memory of a thread that makes tiles of up to `faces` triangles, in bytes.
    pub fn worker_bytes(faces: u64, side: u32) -> u64 {
        faces * FACE_BYTES + u64::from(side) * u64::from(side) * TEXEL_BYTES + PAINTER_BYTES + METER_BYTES
    }

    /// Memory for all tiles under way within limits, in bytes.
    pub fn budget(limits: WorkLimits) -> u64 {
        limits.work_bytes.saturating_sub(limits.threads as u64 * (PAINTER_BYTES + METER_BYTES))
    }

    /// Prepares what tiles are made with.
    pub fn new(plan: &'a LevelPlan<'a>, limits: WorkLimits, progress: &'a dyn Progress) -> Self {
        let (scene, texel) = (plan.scene, plan.scene.texel_of(plan.number));
        let most = (limits.work_bytes / 2 / PAINTER_BYTES) as usize;
        let settings = PatchSettings {
            texel,
            away: plan.away,
            side: plan.settings.side,
            painters: limits.threads.clamp(1, most.max(1)),
        };
        let skirt = SkirtShape {
            lattice: scene.lattice(plan.number),
            texel,
            coarsest_texel: scene.texel_of((plan.number + LEVELS_APART).min(plan.coarsest)),
            scene_origin: scene.origin,
            others: plan.others.iter().map(|other| other.unwrap_or(&plan.input.surface)).collect(),
        };
        let source = plan.below.unwrap_or(plan.input);
        let baker = PatchBaker::new(source, &settings, progress);
        let meter = ColourMeter::new(plan.input, texel, plan.away, plan.nodes.len());
        Self { plan, source, skirt, baker, readers: Mutex::default(), meter }
    }

    /// Makes the tile at an index.
    ///
    /// # Errors
    /// If the job was stopped; on failed reads and damaged files.
    pub fn make(&self, index: usize) -> Result<MadeTile> {
        let SkirtShape { lattice, scene_origin, .. } = self.skirt;
        let mesh = TileMesh::read(self.plan.triangles, index, lattice)?;
        let origin = scene_origin + lattice.position(mesh.middle);
        let painted = self.paint(&mesh, self.plan.widths[index])?;
        let is_last = self.plan.number == self.plan.coarsest;
        let raw = if is_last { None } else { RawDraft::of(&mesh, &painted, origin) };
        let is_measured = self.meter.is_measured(index);
        let colours = if is_measured { self.meter.measure(&mesh, origin, &painted)? } else { ColourError::default() };
        let glb = painted.content.to_glb(self.plan.settings.is_compressed);
        let record = TileRecord {
            node: self.plan.nodes[index],
            bounds: painted.content.bounds(),
            faces: painted.content.triangles.len() as u64,
            texels: painted.texels,
            covered: painted.painted.covered,
            colourless: painted.painted.colourless,
            charts: painted.charts,
            is_reduced: painted.is_reduced,
            colours,
            content: Content::of_bytes(&glb),
        };
        Ok(MadeTile { record, raw, glb })
    }

    fn paint(&self, mesh: &TileMesh, width: Option<u32>) -> Result<PaintedTile> {
        let settings = self.plan.settings;
        let strips = self.skirt.strips(mesh)?;
        let SkirtShape { lattice, scene_origin, .. } = self.skirt;
        let tile = BareTile { mesh, strips: &strips, lattice, scene_origin };
        if !settings.has_colour {
            return Ok(tile.plain());
        }
        // The finest level keeps the texels of the input where it can.
        if self.plan.number > 0 {
            return tile.paint(&self.baker, settings.format);
        }
        match CopiedCharts::new(mesh, self.source, settings.side, width) {
            Ok(charts) => {
                let reader = lock(&self.readers).pop();
                let mut reader = reader.unwrap_or_else(|| self.source.reader());
                let painted = tile.copy(&charts, &mut reader, settings.format)?;
                lock(&self.readers).push(reader);
                Ok(painted)
            }
            Err(Uncopied::NoTexels) => tile.paint(&self.baker, settings.format),
            Err(Uncopied::TooMany) => Ok(PaintedTile { is_reduced: true, ..tile.paint(&self.baker, settings.format)? }),
        }
    }
}
