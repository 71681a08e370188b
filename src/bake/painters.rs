//! Paints the charts of an image on several threads.
//!
//! ```text
//! charts ── blocks ──▶ whichever painter is free ──▶ canvas
//! ```
//! One image is painted at a time, by all painters, so that the last image takes as many threads as the first. The colour
//! of a texel depends on its block alone.

use std::sync::Mutex;

use rayon::prelude::*;

use super::canvas::AtlasCanvas;
use super::original::Original;
use super::paint::{ChartPainter, Painted};
use super::patch_surface::PatchSurface;
use super::raster::TexelRect;
use super::sharpen::SampleBlock;
use crate::base::lock::lock;
use crate::base::pool::in_parallel;
use crate::base::{Progress, Result};
use crate::unwrap::{ImageSize, PlacedChart};

/// Memory of a painter in bytes, about.
pub const PAINTER_BYTES: u64 = 16 << 20;

/// Painters that share an image.
pub(super) struct Painters<'a> {
    painters: Mutex<Vec<ChartPainter<'a>>>,
    progress: &'a dyn Progress,
}

impl<'a> Painters<'a> {
    /// `count` painters with texels that are `texel` long where the original has its median; a surface that faces away
    /// counts as `away` farther.
    pub fn new(original: &'a Original, texel: f64, away: f64, count: usize, progress: &'a dyn Progress) -> Self {
        let painters = (0..count).map(|_| ChartPainter::new(original, texel, away)).collect();
        Self { painters: Mutex::new(painters), progress }
    }

    /// Paints an image of a patch.
    ///
    /// # Errors
    /// If the job was stopped, and on failed reads.
    pub fn paint<'c>(
        &self,
        patch: &PatchSurface<'_>,
        charts: impl Iterator<Item = &'c PlacedChart> + Send,
        size: ImageSize,
    ) -> Result<(AtlasCanvas, Painted)> {
        let painters: &mut Vec<ChartPainter<'_>> = &mut lock(&self.painters);
        let each = painters.first().map_or(1, ChartPainter::samples_of_texel);
        let of_chart = |chart: &'c PlacedChart| {
            SampleBlock::of(TexelRect::around(chart, size), each).map(move |block| (chart, block))
        };
        let blocks = Mutex::new(charts.flat_map(of_chart));
        let canvas = Mutex::new(AtlasCanvas::new([size.width as usize, size.height as usize]));
        let paint_blocks = |painter: &mut ChartPainter<'_>| {
            painter.begin(patch);
            loop {
                let Some((chart, block)) = lock(&blocks).next() else { return Ok(painter.take_painted()) };
                self.progress.check_stopped()?;
                painter.paint(chart, patch, &block, &canvas)?;
            }
        };
        let sum = |a: Painted, b: Painted| Ok(a.plus(b));
        let painted = in_parallel(|| {
            painters.par_iter_mut().with_max_len(1).map(paint_blocks).try_reduce(Painted::default, sum)
        })?;
        Ok((canvas.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner()), painted))
    }
}
