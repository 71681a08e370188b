//! Builds the pyramid once its levels are known: tree, tiles of each level, tileset.

use std::path::Path;

use glam::DMat4;
use serde::{Deserialize, Serialize};

use super::chain::Level;
use super::copy::{CopiedCharts, Uncopied};
use super::crew::{LevelPlan, MadeTile, TileCrew};
use super::cut::{CutLevel, cut};
use super::deviation::TilePlan;
use super::figures::{LevelFigures, TileRecord};
use super::mesh::TileMesh;
use super::node_counts::{LevelTiles, count};
use super::raw::RawTile;
use super::scene::TileScene;
use super::settings::{TilePlace, TileSettings};
use super::skirt::LEVELS_APART;
use super::steps::TileStep;
use super::tileset::{ListedLevel, ListedTile, TilesetDocument, tile_name};
use super::tree::{TileId, TileTree};
use super::triangles::LevelTriangles;
use crate::bake::{Original, SURFACE};
use crate::base::id::TiVec;
use crate::base::ordered::map_in_order;
use crate::base::{Error, Permits, Result, bytes};
use crate::job::{Recalled, Step};
use crate::lend::LentResults;
use crate::os::durable::{DurableFile, make_folders, remove_waiting};
use crate::os::system;
use crate::surface::cells::SurfaceCells;

/// Bytes of a texel of a finished tile while the next level is baked from its image at half of its size.
const RAW_TEXEL_BYTES: f64 = 3.0 / 4.0;

/// A surface with more texels than these by the pixels of its images repeats them; rounding and folds leave a few.
const REPEATED: f64 = 1.1;

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
    /// Width of the image of each tile whose texels of the input were found to fit one.
    widths: Vec<Option<u32>>,
    /// How far each tile lies from the input, in the mesh's unit of length.
    deviations: Vec<f64>,
}

impl Recalled for CutRecord {
    type Context<'a> = &'a TileTree;

    fn locate(&mut self, folder: &Path, _: &&TileTree) {
        self.triangles.locate(folder);
    }

    fn is_sound(&self, tree: &&TileTree) -> bool {
        let tiles = self.tiles.tiles.len();
        self.tiles.is_sound(tree)
            && self.triangles.is_sound()
            && [self.triangles.cell_count(), self.widths.len(), self.deviations.len()] == [tiles; 3]
    }
}

impl Recalled for TileTree {
    type Context<'a> = ();

    fn is_sound(&self, (): &()) -> bool {
        self.is_tree()
    }
}

impl Pyramid<'_> {
    /// Cuts the levels into tiles, writes these and at last the tileset.
    ///
    /// # Errors
    /// If the job was stopped; on a full disk, failed reads and writes, and damaged files.
    pub fn build(&self, levels: &[Level]) -> Result<Vec<LevelFigures>> {
        let TilePlace { work, output, .. } = self.place;
        // What a process left that was killed while it wrote.
        remove_waiting(output, work.number());
        let tree = self.tree(levels)?;
        let (mut listed, mut figures): (Vec<ListedLevel>, Vec<LevelFigures>) = (Vec::new(), Vec::new());
        let mut done: Option<TilesOfLevel> = None;
        for (level, number) in levels.iter().zip(0..) {
            let below = listed.last().map(|below| &below.tiles);
            let cut = self.cut(level, number, &tree, below)?;
            let folder = output.join(number.to_string());
            make_folders(&folder)?;
            remove_waiting(&folder, work.number());
            let tiles = self.write_tiles(levels, number, &cut, done.take())?;
            let errors: Vec<f64> = cut.deviations.iter().map(|&deviation| self.error_of(number, deviation)).collect();
            let coarsest = figures.last().map_or(0.0, |below| below.geometric_error);
            let error = errors.iter().copied().fold(coarsest, f64::max);
            let texel = self.scene.texel_of(number);
            let own = LevelFigures { level: number, texel, geometric_error: error, ..LevelFigures::default() };
            figures.push(own.of_tiles(&level.mesh, &tiles.records, self.settings.faces));
            let listed_tile =
                |(record, error): (&TileRecord, f64)| ListedTile { node: record.node, bounds: record.bounds, error };
            let files = tiles.records.iter().zip(errors).filter(|(record, _)| !record.is_empty());
            let list = files.map(listed_tile).collect();
            listed.push(ListedLevel { tiles: cut.tiles, listed: list });
            done = Some(tiles);
        }
        if listed.iter().all(|level| level.listed.is_empty()) {
            return Ok(figures);
        }
        let document = TilesetDocument {
            tree: &tree,
            levels: &listed,
            transform: self.transform,
            error_factor: self.settings.error_factor,
            bare_root_error: self.settings.error_factor * self.scene.texel_of(levels.len() as u32),
            origin: (!self.is_moved).then_some(self.scene.origin),
        };
        work.sync()?;
        document.write(|name, text| self.write(&output.join(name), text.as_bytes()))?;
        Ok(figures)
    }

    fn tree(&self, levels: &[Level]) -> Result<TileTree> {
        let step = Step::new(TileStep::Tree.key()).from([SURFACE]);
        self.place.work.once(step, &(), || {
            self.refuse_small_disk(levels)?;
            TileTree::plant(&self.original.surface, self.scene, &self.settings.limits())
        })
    }

    /// Refuses a surface whose texels the disk cannot hold: one that repeats an image shows more than the image has.
    fn refuse_small_disk(&self, levels: &[Level]) -> Result<()> {
        let TilePlace { work, progress, .. } = self.place;
        let (true, Some(finest)) = (self.settings.has_colour, levels.first()) else { return Ok(()) };
        let texels = self.triangles(finest, 0).texels(progress)?;
        let repeats = texels > REPEATED * self.original.image_pixels();
        let why = if repeats { ", since texture coordinates repeat images" } else { "" };
        match system::free_disk_bytes(work.path()) {
            Ok(free) if texels * RAW_TEXEL_BYTES > free as f64 => Err(Error::NoSpace {
                path: work.path().to_owned(),
                message: format!(
                    "level 0 would have about {:.1} million texels{why}; {} are free: simplify with `textures: bake` and \
                     fewer `texels` first, and tile the result",
                    texels / 1e6,
                    bytes::display(free),
                ),
            }),
            _ => Ok(()),
        }
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
            let widths = vec![None; tiles.tiles.len()];
            let mut record = CutRecord { tiles, triangles, widths, deviations: Vec::new() };
            let found = self.too_large(&mut record, number, tree, below)?;
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

    /// Tiles that have too many triangles, are too wide, or whose texels do not fit one image, and that can be divided;
    /// notes the widths of the images of the others.
    fn too_large(
        &self,
        cut: &mut CutRecord,
        number: u32,
        tree: &TileTree,
        below: Option<&LevelTiles>,
    ) -> Result<Vec<TileId>> {
        let TilePlace { limits, progress, .. } = self.place;
        let copies = number == 0 && self.settings.has_colour;
        let CutRecord { tiles, triangles, widths, .. } = cut;
        let mut found = Vec::new();
        let fits = |index: usize| {
            progress.check_stopped()?;
            let mesh = TileMesh::read(triangles, index, self.scene.lattice(number))?;
            if mesh.faces_with_skirt() > self.settings.faces || mesh.is_wide() {
                return Ok((index, false, None));
            }
            if !copies {
                return Ok((index, true, None));
            }
            let charts = CopiedCharts::new(&mesh, self.original, self.settings.side, None);
            let width = charts.as_ref().ok().and_then(CopiedCharts::width);
            Ok((index, charts.err() != Some(Uncopied::TooMany), width))
        };
        let can_be_divided = |&index: &usize| LevelTiles::parts(tree, below, tiles.tiles[index]).is_some();
        let all = (0..tiles.tiles.len()).filter(can_be_divided);
        map_in_order(all, limits.threads, limits.threads + 1, fits, |(index, fits, width)| {
            widths[index] = width;
            found.extend((!fits).then(|| tiles.tiles[index]));
            Ok(())
        })?;
        Ok(found)
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
        let joined = match &mut below {
            Some(below) if !is_done && self.settings.has_colour => Some(self.join(below, number)?),
            _ => None,
        };
        let plan = self.plan(levels, number, cut, joined.as_ref());
        let missing: Vec<TileId> =
            nodes.iter().zip(&known).filter(|(_, known)| known.is_none()).map(|(&node, _)| node).collect();
        let lent = if is_done { LentResults::default() } else { plan.lend(&missing, work, progress)? };
        let crew = TileCrew::new(&plan, limits, progress);
        let permits = Permits::new(TileCrew::budget(limits));
        let make = |index: usize| {
            if let Some(record) = known[index] {
                return Ok(ReadyTile { record, raw: None, is_told: false });
            }
            progress.check_stopped()?;
            let _permit = permits.take(plan.tile_bytes(index));
            if let Some((made, is_told)) = lent.result::<MadeTile>(work.path(), nodes[index], &nodes[index])? {
                return self.keep(number, index, made, is_told);
            }
            self.keep(number, index, crew.make(index)?, false)
        };
        let mut all = TilesOfLevel { records: Vec::with_capacity(nodes.len()), raws: Vec::with_capacity(nodes.len()) };
        map_in_order(0..nodes.len(), limits.threads, limits.threads + 1, make, |ready| {
            progress.advance(u64::from(!ready.is_told));
            all.records.push(ready.record);
            all.raws.push(ready.raw);
            Ok(())
        })?;
        if let Some(below) = &below {
            work.sync_before_removal()?;
            below.raws.iter().flatten().for_each(RawTile::remove);
        }
        lent.remove(work.path());
        Ok(all)
    }

    /// What the tiles of a level are made of; `joined` are those of the level below.
    fn plan<'s>(
        &'s self,
        levels: &'s [Level],
        number: u32,
        cut: &'s CutRecord,
        joined: Option<&'s Original>,
    ) -> LevelPlan<'s> {
        let (mesh, coarsest) = (&levels[number as usize].mesh, levels.len() as u32 - 1);
        let near = number.saturating_sub(LEVELS_APART)..=(number + LEVELS_APART).min(coarsest);
        let others = near.filter(|&other| other != number).map(|other| levels[other as usize].surface.as_deref());
        LevelPlan {
            scene: self.scene,
            settings: self.settings,
            number,
            coarsest,
            away: mesh.to_input.rms.max(mesh.from_input.rms).max(self.scene.lattice(number).step),
            nodes: &cut.tiles.tiles,
            triangles: &cut.triangles,
            widths: &cut.widths,
            input: self.original,
            below: joined,
            others: others.collect(),
        }
    }

    /// Writes a tile, and records it.
    fn keep(&self, level: u32, index: usize, made: MadeTile, is_told: bool) -> Result<ReadyTile> {
        let (work, MadeTile { record, raw, glb }) = (self.place.work, made);
        let node = record.node;
        let raw = raw.map(|raw| raw.keep(work, level, node, index)).transpose()?.flatten();
        if !record.is_empty() {
            self.write(&self.place.output.join(tile_name(level, node)), &glb)?;
        }
        let step = Step::new(TileStep::Tile { level, tile: node }.key()).from([TileStep::Cut { level }.key()]);
        work.keep(step.of_size(record.faces).that_outlasts(), [], &record)?;
        Ok(ReadyTile { record, raw, is_told })
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

/// A tile that is written.
struct ReadyTile {
    record: TileRecord,
    raw: Option<RawTile>,
    /// Whether the progress knows of it.
    is_told: bool,
}
