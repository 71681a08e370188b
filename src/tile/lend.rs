//! Has tiles of a level made by other processes, and makes them there.
//!
//! A tile is handed over as a whole: its file and what the next level is baked from lie in the results of its task.

use std::path::Path;

use serde::Deserialize;

use super::chain::LEVELS_MAX;
use super::crew::{LevelPlan, MadeTile, TileCrew};
use super::cut::CutLevel;
use super::scene::TileScene;
use super::settings::TileSettings;
use super::steps::TileStep;
use super::tree::TileId;
use crate::bake::{Original, arithmetic};
use crate::base::{Progress, Result, WorkLimits};
use crate::job::stage::{Stage, StageTask};
use crate::job::{Recalled, WorkFolder};
use crate::lend::{Lendable, LentItem, LentResult, LentResults, LentWork, details_of, encoded, lend};
use crate::model::StoredPiece;
use crate::surface::cells::SurfaceCells;

/// Kind of the stages whose tasks are done by [`do_task`].
pub const TILE: &str = "tile";

/// What a process that does tasks of a stage needs; the fields are those of [`LevelPlan`].
#[derive(Deserialize)]
struct TileDetails {
    scene: TileScene,
    settings: TileSettings,
    /// Number of the level, and of the coarsest one.
    numbers: [u32; 2],
    away: f64,
    nodes: Vec<TileId>,
    triangles: CutLevel,
    widths: Vec<Option<u32>>,
    input: Original,
    below: Option<Original>,
    others: Vec<Option<SurfaceCells>>,
}

impl Recalled for TileDetails {
    type Context<'a> = ();

    fn locate(&mut self, folder: &Path, (): &()) {
        self.triangles.locate(folder);
        self.input.locate(folder, &());
        self.below.iter_mut().for_each(|below| below.locate(folder, &()));
        self.others.iter_mut().flatten().for_each(|other| other.locate(folder));
    }

    fn is_sound(&self, (): &()) -> bool {
        self.triangles.is_sound()
            && [self.triangles.cell_count(), self.widths.len()] == [self.nodes.len(); 2]
            && self.nodes.is_sorted()
            && self.input.is_sound(&())
            && self.below.iter().all(|below| below.is_sound(&()))
            && self.others.iter().flatten().all(SurfaceCells::is_sound)
            && (64..=16384).contains(&self.settings.side)
            && self.numbers[0] <= self.numbers[1]
            && self.numbers[1] < LEVELS_MAX
            && self.scene.is_sound()
            && self.away >= 0.0
            && self.away.is_finite()
            && [Some(&self.input), self.below.as_ref()]
                .into_iter()
                .flatten()
                .all(|of| of.median_texel.is_normal() && of.median_texel > 0.0)
    }
}

impl LentResult for MadeTile {
    // A tile is no piece of a mesh.
    fn add_piece(&mut self, _: StoredPiece) {}
}

impl LevelPlan<'_> {
    /// Has tiles made by other processes, if the job has any; returns what they made, now or before.
    pub fn lend(&self, tiles: &[TileId], work: &WorkFolder, progress: &dyn Progress) -> Result<LentResults<TileId>> {
        let level = self.number;
        let what = Lendable {
            kind: TILE,
            items: one_by_one(tiles),
            prefix: TileStep::prefix_of_tiles(level),
            parent: Some(TileStep::Cut { level }.key()),
            arithmetic: &|| arithmetic::checksum(self.settings.format),
            is_counted: true,
            is_read_whole: false,
        };
        let Self { scene, settings, away, nodes, triangles, widths, input, below, others, .. } = self;
        let numbers = [level, self.coarsest];
        let details = (scene, settings, numbers, away, nodes, triangles, widths, input, below, others);
        lend(work, &what, || encoded(&details), progress)
    }
}

/// Tiles as the phase counts them.
fn one_by_one(tiles: &[TileId]) -> Vec<LentItem<TileId>> {
    tiles.iter().map(|&item| LentItem { item, size: 1 }).collect()
}

/// Does a task of a stage of tiles, within limits of memory and threads.
///
/// # Errors
/// [`Error::Changed`](crate::base::Error::Changed) on a machine that computes something else.
/// [`Error::Damaged`](crate::base::Error::Damaged) if the stage holds none; on a full disk, failed reads and writes, and
/// damaged files.
pub fn do_task(stage: &Stage, task: &StageTask, limits: WorkLimits, progress: &dyn Progress) -> Result<()> {
    let details: TileDetails = details_of(stage)?;
    stage.check_arithmetic(arithmetic::checksum(details.settings.format)?)?;
    let plan = LevelPlan {
        scene: &details.scene,
        settings: &details.settings,
        number: details.numbers[0],
        coarsest: details.numbers[1],
        away: details.away,
        nodes: &details.nodes,
        triangles: &details.triangles,
        widths: &details.widths,
        input: &details.input,
        below: details.below.as_ref(),
        others: details.others.iter().map(Option::as_ref).collect(),
    };
    let crew = TileCrew::new(&plan, limits, progress);
    // Every item is one of the nodes.
    let index = |tile: TileId| plan.nodes.binary_search(&tile).unwrap_or_default();
    let work = LentWork {
        items: one_by_one(plan.nodes),
        has_pieces: false,
        bytes: &|tile| plan.tile_bytes(index(tile)),
        work: &|tile| Ok((crew.make(index(tile))?, None)),
    };
    work.run(stage, task, WorkLimits { work_bytes: TileCrew::budget(limits), ..limits }, progress)
}
