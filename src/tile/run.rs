//! Builds the pyramid once its levels are known: tree, tiles of each level, tileset.

use std::path::Path;
use std::sync::Mutex;

use glam::DMat4;
use serde::{Deserialize, Serialize};

use super::chain::Level;
use super::colours::{ColourError, ColourMeter};
use super::copy::{CopiedCharts, Uncopied};
use super::cut::{CutLevel, cut};
use super::deviation::TilePlan;
use super::figures::{LevelFigures, TileRecord};
use super::mesh::TileMesh;
use super::node_counts::{LevelTiles, count};
use super::paint::{BareTile, PaintedTile};
use super::raw::{RawPlace, RawTile};
use super::scene::TileScene;
use super::settings::{TilePlace, TileSettings};
use super::skirt::{LEVELS_APART, SkirtShape};
use super::steps::TileStep;
use super::tileset::{ListedLevel, ListedTile, TilesetDocument, tile_name};
use super::tree::{TileId, TileTree};
use super::triangles::LevelTriangles;
use crate::bake::{Original, PAINTER_BYTES, PatchBaker, PatchSettings, SURFACE};
use crate::base::id::TiVec;
use crate::base::lock::lock;
use crate::base::ordered::map_in_order;
use crate::base::{Error, Permits, Result};
use crate::image::stored::TexelReader;
use crate::job::{Recalled, Step};
use crate::os::content::Content;
use crate::os::durable::{DurableFile, make_folders};
use crate::surface::cells::SurfaceCells;

/// Memory of a triangle of a tile while it is made, in bytes, and of a texel.
const FACE_BYTES: u64 = 700;
const TEXEL_BYTES: u64 = 8;
/// Memory of a thread that compares the colours of tiles with those of the input, in bytes.
const METER_BYTES: u64 = 10 << 20;

/// A pyramid under way.
pub struct Pyramid<'a> {
    /// The surface of the input, and its images.
    pub original: &'a Original,
    /// Where it lies.
    pub scene: &'a TileScene,
    /// How tiles are made.
    pub settings: &'a TileSettings,
    /// From the scene to the world.
    pub transform: DMat4,
    /// Whether the input was moved, as onto the earth, when it was read.
    pub is_moved: bool,
    /// Where it is built.
    pub place: TilePlace<'a>,
}

/// A level that is cut into tiles.
#[derive(Serialize, Deserialize)]
struct CutRecord {
    tiles: LevelTiles,
    triangles: CutLevel,
    /// How far each tile lies from the input, in the mesh's unit of length.
    deviations: Vec<f64>,
}

impl Recalled for CutRecord {
    type Context<'a> = &'a TileTree;

    fn locate(&mut self, folder: &Path, _: &&TileTree) {
        self.triangles.locate(folder);
    }

    fn is_sound(&self, tree: &&TileTree) -> bool {
        self.tiles.is_sound(tree) && self.triangles.is_sound() && self.triangles.cell_count() == self.tiles.tiles.len()
    }
}

impl Recalled for TileTree {
    type Context<'a> = ();

    fn is_sound(&self, (): &()) -> bool {
        self.is_tree()
    }
}

impl Pyramid<'_> {
    /// Memory of a thread that makes tiles, in bytes.
    pub fn worker_bytes(faces: u64, side: u32) -> u64 {
        faces * FACE_BYTES + u64::from(side) * u64::from(side) * TEXEL_BYTES + PAINTER_BYTES + METER_BYTES
    }

    /// Cuts the levels into tiles, writes these and at last the tileset.
    ///
    /// # Errors
    /// If the job was stopped; on a full disk, failed reads and writes, and damaged files.
    pub fn build(&self, levels: &[Level]) -> Result<Vec<LevelFigures>> {
        let tree = self.tree()?;
        let (mut listed, mut figures): (Vec<ListedLevel>, Vec<LevelFigures>) = (Vec::new(), Vec::new());
        let mut done: Option<TilesOfLevel> = None;
        for (level, number) in levels.iter().zip(0..) {
            let below = listed.last().map(|below| &below.tiles);
            let cut = self.cut(level, number, &tree, below)?;
            make_folders(&self.place.output.join(number.to_string()))?;
            let tiles = self.write_tiles(levels, number, &cut, done.take())?;
            let errors: Vec<f64> = cut.deviations.iter().map(|&deviation| self.error_of(number, deviation)).collect();
            let coarsest = figures.last().map_or(0.0, |below| below.geometric_error);
            let error = errors.iter().copied().fold(coarsest, f64::max);
            let texel = self.scene.texel_of(number);
            let own = LevelFigures { level: number, texel, geometric_error: error, ..LevelFigures::default() };
            figures.push(own.of_tiles(&level.mesh, &tiles.records));
            let listed_tile =
                |(record, error): (&TileRecord, f64)| ListedTile { node: record.node, bounds: record.bounds, error };
            let files = tiles.records.iter().zip(errors).filter(|(record, _)| !record.is_empty());
            let list = files.map(listed_tile).collect();
            listed.push(ListedLevel { tiles: cut.tiles, listed: list });
            done = Some(tiles);
        }
        let document = TilesetDocument {
            tree: &tree,
            levels: &listed,
            transform: self.transform,
            error_factor: self.settings.error_factor,
            origin: (!self.is_moved).then_some(self.scene.origin),
        };
        self.place.work.sync()?;
        for (name, json) in document.files() {
            self.write(&self.place.output.join(name), json.to_string().as_bytes())?;
        }
        Ok(figures)
    }

    fn tree(&self) -> Result<TileTree> {
        let step = Step::new(TileStep::Tree.key()).from([SURFACE]);
        self.place.work.once(step, &(), || TileTree::plant(&self.original.surface, self.scene, &self.settings.limits()))
    }

    fn surface<'s>(&'s self, level: &'s Level) -> &'s SurfaceCells {
        level.surface.as_deref().unwrap_or(&self.original.surface)
    }

    fn triangles<'s>(&'s self, level: &'s Level, number: u32) -> LevelTriangles<'s> {
        LevelTriangles {
            surface: self.surface(level),
            scene: self.scene,
            level: number,
            original: (number == 0 && self.settings.has_colour).then_some(self.original),
        }
    }

    fn cut(&self, level: &Level, number: u32, tree: &TileTree, below: Option<&LevelTiles>) -> Result<CutRecord> {
        let TilePlace { work, limits, progress, .. } = self.place;
        let key = TileStep::Cut { level: number }.key();
        if let Some(cut) = work.recall::<CutRecord>(&key, &tree)? {
            return Ok(cut);
        }
        progress.begin("cut", 0, "");
        let source = self.triangles(level, number);
        let counts = count(&source, tree, limits, progress)?;
        let mut is_too_large: TiVec<TileId, bool> = vec![false; tree.nodes.len()].into();
        let path = work.path().join(format!("{}.buckets", key.name()));
        let mut record = loop {
            let tiles = LevelTiles::choose(&counts, tree, &self.settings.limits(), &is_too_large, below);
            let triangles = cut(&source, tree, &tiles, &path, limits, progress)?;
            let record = CutRecord { tiles, triangles, deviations: Vec::new() };
            let found = self.too_large(&record, number, tree)?;
            if found.is_empty() {
                break record;
            }
            found.into_iter().for_each(|tile| is_too_large[tile] = true);
        };
        record.deviations = if number == 0 {
            vec![0.0; record.tiles.tiles.len()]
        } else {
            let plan = TilePlan { tree, tiles: &record.tiles, scene: self.scene };
            plan.deviations([source.surface, &self.original.surface], self.scene.texel_of(number), limits, progress)?
        };
        let of_surface = match level.mesh.pass {
            0 => SURFACE,
            pass => TileStep::Surface { pass }.key(),
        };
        let step = Step::new(key).from([TileStep::Tree.key(), of_surface]).of_size(record.tiles.tiles.len() as u64);
        work.keep(step, [path.as_path()], &record)?;
        Ok(record)
    }

    /// Tiles that have too many triangles, or texels that do not fit one image, and that can be divided.
    fn too_large(&self, cut: &CutRecord, number: u32, tree: &TileTree) -> Result<Vec<TileId>> {
        let TilePlace { limits, progress, .. } = self.place;
        let copies = number == 0 && self.settings.has_colour;
        let mut found = Vec::new();
        let fits = |index: usize| {
            progress.check_stopped()?;
            let mesh = self.load(&cut.triangles, index, number)?;
            if mesh.faces_with_skirt() > self.settings.faces {
                return Ok((index, false));
            }
            let charts = copies.then(|| CopiedCharts::new(&mesh, self.original, self.settings.side));
            Ok((index, charts.and_then(std::result::Result::err) != Some(Uncopied::TooMany)))
        };
        let can_be_divided = |&index: &usize| tree.children(cut.tiles.tiles[index]).is_some();
        let all = (0..cut.tiles.tiles.len()).filter(can_be_divided);
        map_in_order(all, limits.threads, limits.threads + 1, fits, |(index, fits)| {
            found.extend((!fits).then(|| cut.tiles.tiles[index]));
            Ok(())
        })?;
        Ok(found)
    }

    fn load(&self, triangles: &CutLevel, index: usize, number: u32) -> Result<TileMesh> {
        let mut own = Vec::with_capacity(triangles.len(index) as usize);
        triangles.read(index, |block| {
            own.extend_from_slice(block);
            Ok(())
        })?;
        Ok(TileMesh::join(&own, self.scene.lattice(number)))
    }

    /// Writes the tiles of a level, which are baked from those of the level below.
    fn write_tiles(
        &self,
        levels: &[Level],
        number: u32,
        cut: &CutRecord,
        mut below: Option<TilesOfLevel>,
    ) -> Result<TilesOfLevel> {
        let TilePlace { work, limits, progress, output } = self.place;
        let nodes = &cut.tiles.tiles;
        progress.begin("tile", nodes.len() as u64, "tiles");
        let mut known: Vec<Option<TileRecord>> = Vec::with_capacity(nodes.len());
        for &node in nodes {
            let key = TileStep::Tile { level: number, tile: node }.key();
            known.push(work.recall::<TileRecord>(&key, &&*output.join(tile_name(number, node)))?);
        }
        let is_done = known.iter().all(Option::is_some);
        let original = match &mut below {
            Some(below) if !is_done && self.settings.has_colour => Some(self.join(below, number)?),
            _ => None,
        };
        let crew = TileCrew::new(self, original.as_ref().unwrap_or(self.original), levels, number, nodes.len());
        let permits =
            Permits::new(limits.work_bytes.saturating_sub(limits.threads as u64 * (PAINTER_BYTES + METER_BYTES)));
        let texels = u64::from(self.settings.side) * u64::from(self.settings.side);
        let is_last = number as usize + 1 == levels.len();
        let make = |index: usize| {
            let node = nodes[index];
            if let Some(record) = known[index] {
                return Ok((record, None));
            }
            progress.check_stopped()?;
            let of_texel = TEXEL_BYTES + self.settings.format.encoder_bytes();
            let _permit = permits.take(cut.triangles.len(index) * FACE_BYTES + texels * of_texel);
            let mesh = self.load(&cut.triangles, index, number)?;
            let painted = crew.make(&mesh)?;
            let place = RawPlace { work, node, index, scene: self.scene, level: number };
            let raw = if is_last { None } else { RawTile::keep(&mesh, &painted, &place)? };
            let record = TileRecord {
                colours: crew.measure(index, &mesh, &painted)?,
                ..self.write_tile(node, &painted, &output.join(tile_name(number, node)))?
            };
            let key = TileStep::Tile { level: number, tile: node }.key();
            let step = Step::new(key).from([TileStep::Cut { level: number }.key()]).of_size(record.faces);
            work.keep(step.that_outlasts(), [], &record)?;
            Ok((record, raw))
        };
        let mut all = TilesOfLevel { records: Vec::with_capacity(nodes.len()), raws: Vec::with_capacity(nodes.len()) };
        map_in_order(0..nodes.len(), limits.threads, limits.threads + 1, make, |(record, raw)| {
            progress.advance(1);
            all.records.push(record);
            all.raws.push(raw);
            Ok(())
        })?;
        below.iter().flat_map(|below| &below.raws).flatten().for_each(RawTile::remove);
        Ok(all)
    }

    /// The surface that the tiles of a level are baked from: the finished tiles of the level below.
    fn join(&self, below: &mut TilesOfLevel, number: u32) -> Result<Original> {
        let work = self.place.work;
        for (record, raw) in below.records.iter().zip(&mut below.raws) {
            if raw.is_none() && record.texels > 0 {
                let key = TileStep::Raw { level: number - 1, tile: record.node }.key();
                *raw = work.recall(&key, &())?;
            }
            if raw.is_none() && record.texels > 0 {
                let message = "what is needed of a finished tile is gone; `resume: never` starts over".into();
                return Err(Error::Damaged { path: work.path().to_owned(), message });
            }
        }
        Ok(RawTile::join(&below.raws, self.scene.texel_of(number)))
    }

    fn write_tile(&self, node: TileId, tile: &PaintedTile, path: &Path) -> Result<TileRecord> {
        let bytes = tile.content.to_glb(self.settings.is_compressed);
        if !tile.content.triangles.is_empty() {
            self.write(path, &bytes)?;
        }
        Ok(TileRecord {
            node,
            bounds: tile.content.bounds(),
            faces: tile.content.triangles.len() as u64,
            texels: tile.texels,
            covered: tile.painted.covered,
            colourless: tile.painted.colourless,
            charts: tile.charts,
            is_reduced: tile.is_reduced,
            colours: ColourError::default(),
            content: Content::of_bytes(&bytes),
        })
    }

    /// Writes a file of the result under its final name, durably.
    fn write(&self, path: &Path, bytes: &[u8]) -> Result<()> {
        let mut file = DurableFile::create_outside(path, self.place.work.number(), 0)?;
        file.write(bytes)?;
        file.commit()?;
        Ok(())
    }

    /// Geometric error of a tile by itself.
    fn error_of(&self, number: u32, deviation: f64) -> f64 {
        if number == 0 { 0.0 } else { self.settings.error_factor * self.scene.texel_of(number).max(deviation) }
    }
}

/// The finished tiles of a level, and what those of the next one are baked from.
struct TilesOfLevel {
    records: Vec<TileRecord>,
    raws: Vec<Option<RawTile>>,
}

/// Makes the tiles of a level on several threads.
struct TileCrew<'a> {
    pyramid: &'a Pyramid<'a>,
    original: &'a Original,
    skirt: SkirtShape<'a>,
    /// Whether texels are copied where they can be.
    copies: bool,
    baker: PatchBaker<'a>,
    readers: Mutex<Vec<TexelReader<'a>>>,
    meter: ColourMeter<'a>,
}

impl<'a> TileCrew<'a> {
    fn new(pyramid: &'a Pyramid<'a>, original: &'a Original, levels: &'a [Level], number: u32, tiles: usize) -> Self {
        let Pyramid { scene, place: TilePlace { limits, progress, .. }, .. } = *pyramid;
        let (level, lattice, texel) = (&levels[number as usize], scene.lattice(number), scene.texel_of(number));
        let most = (limits.work_bytes / 2 / PAINTER_BYTES) as usize;
        let settings = PatchSettings {
            texel,
            away: level.mesh.to_input.rms.max(level.mesh.from_input.rms).max(lattice.step),
            side: pyramid.settings.side,
            painters: limits.threads.clamp(1, most.max(1)),
        };
        let coarsest = (number + LEVELS_APART).min(levels.len() as u32 - 1);
        let near = number.saturating_sub(LEVELS_APART)..=coarsest;
        let others = near.filter(|&other| other != number).map(|other| pyramid.surface(&levels[other as usize]));
        let skirt = SkirtShape {
            lattice,
            texel,
            coarsest_texel: scene.texel_of(coarsest),
            scene_origin: scene.origin,
            others: others.collect(),
        };
        let baker = PatchBaker::new(original, &settings, progress);
        let meter = ColourMeter::new(pyramid.original, texel, settings.away, tiles);
        Self { pyramid, original, skirt, copies: number == 0, baker, readers: Mutex::default(), meter }
    }

    /// How far the colours of a tile are from those of the input, if it is one of those that are measured.
    fn measure(&self, index: usize, mesh: &TileMesh, tile: &PaintedTile) -> Result<ColourError> {
        if !self.meter.is_measured(index) {
            return Ok(ColourError::default());
        }
        let SkirtShape { lattice, scene_origin, .. } = self.skirt;
        self.meter.measure(mesh, scene_origin + lattice.position(mesh.middle), tile)
    }

    fn make(&self, mesh: &TileMesh) -> Result<PaintedTile> {
        let settings = self.pyramid.settings;
        let strips = self.skirt.strips(mesh)?;
        let SkirtShape { lattice, scene_origin, .. } = self.skirt;
        let tile = BareTile { mesh, strips: &strips, lattice, scene_origin };
        if !settings.has_colour {
            return Ok(tile.plain());
        }
        if !self.copies {
            return tile.paint(&self.baker, settings.format);
        }
        match CopiedCharts::new(mesh, self.original, settings.side) {
            Ok(charts) => {
                let reader = lock(&self.readers).pop();
                let mut reader = reader.unwrap_or_else(|| self.original.reader());
                let painted = tile.copy(&charts, &mut reader, settings.format)?;
                lock(&self.readers).push(reader);
                Ok(painted)
            }
            Err(Uncopied::NoTexels) => tile.paint(&self.baker, settings.format),
            Err(Uncopied::TooMany) => Ok(PaintedTile { is_reduced: true, ..tile.paint(&self.baker, settings.format)? }),
        }
    }
}
