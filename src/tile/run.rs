//! Builds the pyramid once its levels are known: tree, tiles of each level, tileset.

use std::path::Path;
use std::sync::Mutex;

use glam::DMat4;
use serde::{Deserialize, Serialize};

use super::census::{LevelTiles, count};
use super::chain::Level;
use super::cut::{CutLevel, Cutting};
use super::mesh::TileMesh;
use super::paint::{BareTile, PaintedTile};
use super::scene::Scene;
use super::settings::{TilePlace, TileSettings};
use super::skirt::strips;
use super::steps::TileStep;
use super::tileset::{ListedLevel, ListedTile, TilesetDocument, tile_name};
use super::tree::{TileId, TileTree};
use crate::bake::{Original, PatchBaker, PatchSettings, SURFACE};
use crate::base::error::escape_path;
use crate::base::lock::lock;
use crate::base::ordered::map_in_order;
use crate::base::{Error, Permits, Result};
use crate::geometry::boxtree::Bounds;
use crate::job::{Recalled, Step};
use crate::os::content::Content;
use crate::os::durable::{DurableFile, make_folders};
use crate::surface::cells::SurfaceCells;

/// Length of a skirt in texels of its level.
const SKIRT_TEXELS: f64 = 2.0;
/// Memory of a triangle of a tile while it is made, in bytes, and of a texel.
const FACE_BYTES: u64 = 700;
const TEXEL_BYTES: u64 = 8;

/// What was written of a tile.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TileRecord {
    /// Its node.
    pub node: TileId,
    /// The smallest box around it, relative to the origin of the scene.
    pub bounds: Bounds,
    /// Triangles, those of the skirt included.
    pub faces: u64,
    /// Texels of its image.
    pub texels: u64,
    /// Texels that charts cover, and those of them without colour.
    pub covered: u64,
    /// Texels without colour.
    pub colourless: u64,
    /// Charts.
    pub charts: u64,
    /// The file.
    pub content: Content,
}

/// What was built of a level.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct LevelFigures {
    /// Number of the level; 0 is the finest.
    pub level: u32,
    /// Tiles.
    pub tiles: u64,
    /// Triangles of its mesh.
    pub mesh_faces: u64,
    /// Triangles of its tiles, with those that cuts add and those of the skirts.
    pub faces: u64,
    /// Most triangles of a tile.
    pub faces_max: u64,
    /// Texels of all images.
    pub texels: u64,
    /// Most texels of an image.
    pub texels_max: u64,
    /// Share of the images that charts cover.
    pub fill: f64,
    /// Texels without colour.
    pub colourless: u64,
    /// Charts.
    pub charts: u64,
    /// Length of a texel's side, in the mesh's unit of length.
    pub texel: f64,
    /// Distance within which 99 % of the level lies from the input, in the same unit.
    pub to_input_p99: f64,
    /// Distance within which 99 % of the input lies from the level.
    pub from_input_p99: f64,
    /// Geometric error.
    pub geometric_error: f64,
    /// Bytes of the files.
    pub bytes: u64,
}

/// A pyramid under way.
pub struct Pyramid<'a> {
    /// The surface of the input, and its images.
    pub original: &'a Original,
    /// Where it lies.
    pub scene: &'a Scene,
    /// How tiles are made.
    pub settings: &'a TileSettings,
    /// From the scene to the world.
    pub transform: DMat4,
    /// Where it is built.
    pub place: TilePlace<'a>,
}

/// A level that is cut into tiles.
#[derive(Serialize, Deserialize)]
struct CutRecord {
    tiles: LevelTiles,
    triangles: CutLevel,
}

impl Recalled for CutRecord {
    type Context<'a> = &'a TileTree;

    fn locate(&mut self, folder: &Path, _: &&TileTree) {
        self.triangles.locate(folder);
    }

    fn is_sound(&self, tree: &&TileTree) -> bool {
        self.tiles.is_sound(tree)
            && self.triangles.is_sound()
            && self.triangles.cell_count() == self.tiles.tiles.len()
    }
}

impl Recalled for TileTree {
    type Context<'a> = ();

    fn is_sound(&self, (): &()) -> bool {
        self.is_tree()
    }
}

impl Recalled for TileRecord {
    /// The file that it should be.
    type Context<'a> = &'a Path;

    fn is_sound(&self, path: &&Path) -> bool {
        Content::of(path).is_ok_and(|content| content == self.content)
    }
}

impl Pyramid<'_> {
    /// Cuts the levels into tiles, writes these and at last the tileset.
    ///
    /// # Errors
    /// If the job was stopped; on a full disk, failed reads and writes, and damaged files.
    pub fn build(&self, levels: &[Level]) -> Result<Vec<LevelFigures>> {
        let tree = self.tree()?;
        let (mut listed, mut figures): (Vec<ListedLevel>, Vec<LevelFigures>) = (Vec::new(), Vec::new());
        for (level, number) in levels.iter().zip(0..) {
            let below = listed.last().map(|below| &below.tiles);
            let CutRecord { tiles, triangles } = self.cut(level, number, &tree, below)?;
            make_folders(&self.place.output.join(number.to_string()))?;
            let records = self.write_tiles(level, number, &tiles, &triangles)?;
            let error = if number == 0 { 0.0 } else { self.error_of(level, number).max(figures[number as usize - 1].geometric_error) };
            figures.push(self.figures(level, number, &records, error));
            let list = records.iter().map(|&TileRecord { node, bounds, .. }| ListedTile { node, bounds }).collect();
            listed.push(ListedLevel { tiles, listed: list, error });
        }
        let document = TilesetDocument { tree: &tree, levels: &listed, transform: self.transform }.to_json();
        let path = self.place.output.join("tileset.json");
        self.place.work.sync()?;
        self.write(&path, document.to_string().as_bytes())?;
        Ok(figures)
    }

    fn tree(&self) -> Result<TileTree> {
        let step = Step::new(TileStep::Tree.key()).from([SURFACE]);
        self.place.work.once(step, &(), || {
            TileTree::plant(&self.original.surface, self.scene, self.scene.texel, &self.settings.limits())
        })
    }

    fn surface<'s>(&'s self, level: &'s Level) -> &'s SurfaceCells {
        level.surface.as_deref().unwrap_or(&self.original.surface)
    }

    fn cut(&self, level: &Level, number: u32, tree: &TileTree, below: Option<&LevelTiles>) -> Result<CutRecord> {
        let TilePlace { work, limits, progress, .. } = self.place;
        let key = TileStep::Cut { level: number }.key();
        if let Some(cut) = work.recall::<CutRecord>(&key, &tree)? {
            return Ok(cut);
        }
        progress.begin("cut", 0, "");
        let surface = self.surface(level);
        let counts = count(surface, tree, self.scene, number, limits, progress)?;
        let texel = self.scene.texel_of(number);
        let tiles = LevelTiles::choose(&counts, tree, texel, &self.settings.limits(), below);
        let path = work.path().join(format!("{}.buckets", key.name()));
        let cutting = Cutting { tree, tiles: &tiles, scene: self.scene, level: number };
        let triangles = cutting.cut(surface, &path, limits, progress)?;
        let record = CutRecord { tiles, triangles };
        let of_surface = match level.mesh.pass {
            0 => SURFACE,
            pass => TileStep::Surface { pass }.key(),
        };
        let step = Step::new(key).from([TileStep::Tree.key(), of_surface]).of_size(record.tiles.tiles.len() as u64);
        work.keep(step, [path.as_path()], &record)?;
        Ok(record)
    }

    fn write_tiles(
        &self,
        level: &Level,
        number: u32,
        tiles: &LevelTiles,
        triangles: &CutLevel,
    ) -> Result<Vec<TileRecord>> {
        let TilePlace { work, limits, progress, output } = self.place;
        progress.begin("tile", tiles.tiles.len() as u64, "tiles");
        let lattice = self.scene.lattice(number);
        let settings = PatchSettings {
            texel: self.scene.texel_of(number),
            away: level.mesh.to_input.rms.max(level.mesh.from_input.rms).max(lattice.step),
            side: self.settings.side,
            painters: 1,
        };
        let bakers: Mutex<Vec<PatchBaker<'_>>> = Mutex::new(Vec::new());
        let permits = Permits::new(limits.work_bytes);
        let texels = u64::from(self.settings.side) * u64::from(self.settings.side);
        let make = |index: usize| {
            let node = tiles.tiles[index];
            let path = output.join(tile_name(number, node));
            let key = TileStep::Tile { level: number, tile: node }.key();
            if let Some(record) = work.recall::<TileRecord>(&key, &&*path)? {
                return Ok(record);
            }
            progress.check_stopped()?;
            let count = triangles.len(index);
            let _permit = permits.take(count * FACE_BYTES + texels * TEXEL_BYTES);
            let mut own = Vec::with_capacity(count as usize);
            triangles.read(index, |block| {
                own.extend_from_slice(block);
                Ok(())
            })?;
            let mesh = TileMesh::join(&own, lattice);
            drop(own);
            let strips = strips(&mesh, lattice, SKIRT_TEXELS * settings.texel);
            let tile = BareTile { mesh: &mesh, strips: &strips, lattice, scene_origin: self.scene.origin };
            let painted = if self.settings.has_colour {
                let baker = lock(&bakers).pop();
                let baker = baker.unwrap_or_else(|| PatchBaker::new(self.original, &settings, progress));
                let painted = tile.paint(&baker, self.settings.format)?;
                lock(&bakers).push(baker);
                painted
            } else {
                tile.plain()
            };
            let record = self.write_tile(node, &painted, &path)?;
            let step = Step::new(key).from([TileStep::Cut { level: number }.key()]).of_size(record.faces);
            work.keep(step.that_outlasts(), [], &record)?;
            Ok(record)
        };
        let mut records = Vec::with_capacity(tiles.tiles.len());
        map_in_order(0..tiles.tiles.len(), limits.threads, limits.threads + 1, make, |record| {
            progress.advance(1);
            records.push(record);
            Ok(())
        })?;
        Ok(records)
    }

    fn write_tile(&self, node: TileId, tile: &PaintedTile, path: &Path) -> Result<TileRecord> {
        let bytes = tile.content.to_glb();
        self.write(path, &bytes)?;
        Ok(TileRecord {
            node,
            bounds: tile.content.bounds(),
            faces: tile.content.triangles.len() as u64,
            texels: tile.texels,
            covered: tile.painted.covered,
            colourless: tile.painted.colourless,
            charts: tile.charts,
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

    /// Geometric error of a level by itself.
    fn error_of(&self, level: &Level, number: u32) -> f64 {
        self.settings.error_factor * self.scene.texel_of(number).max(level.mesh.deviation())
    }

    fn figures(&self, level: &Level, number: u32, records: &[TileRecord], error: f64) -> LevelFigures {
        let sum = |of: fn(&TileRecord) -> u64| records.iter().map(of).sum::<u64>();
        let most = |of: fn(&TileRecord) -> u64| records.iter().map(of).max().unwrap_or(0);
        LevelFigures {
            level: number,
            tiles: records.len() as u64,
            mesh_faces: level.mesh.faces,
            faces: sum(|tile| tile.faces),
            faces_max: most(|tile| tile.faces),
            texels: sum(|tile| tile.texels),
            texels_max: most(|tile| tile.texels),
            fill: sum(|tile| tile.covered) as f64 / sum(|tile| tile.texels).max(1) as f64,
            colourless: sum(|tile| tile.colourless),
            charts: sum(|tile| tile.charts),
            texel: self.scene.texel_of(number),
            to_input_p99: level.mesh.to_input.p99,
            from_input_p99: level.mesh.from_input.p99,
            geometric_error: error,
            bytes: sum(|tile| tile.content.bytes),
        }
    }
}

/// Refuses a folder that holds anything, unless a job of ours was writing it.
///
/// # Errors
/// [`Error::Usage`].
pub fn refuse_filled_folder(output: &Path, may_hold_tiles: bool) -> Result<()> {
    let refused = |words: String| Err(Error::Usage(format!("{}: {words}", escape_path(output))));
    match std::fs::read_dir(output).map(|mut entries| entries.next().is_none()) {
        Ok(is_empty) if is_empty || may_hold_tiles => Ok(()),
        Ok(_) => refused("holds files; choose a new or empty folder, or `force`".into()),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(()),
        Err(error) => refused(format!("the output is a folder for tiles: {error}")),
    }
}
