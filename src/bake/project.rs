//! Finds closest places of the original for all samples of a region at once.
//!
//! ```text
//!   original     ─╲__╱──╲       each triangle of the original is projected onto the plane of a triangle of the patch;
//!                ╎      ╎       only samples no farther than `reach` beside its projection can be that near to it
//!   patch     ─+─+──+──+─+──
//! ```
//! That is a few operations for each triangle and sample, where a search takes hundreds. A texel with a sample that finds
//! nothing within [`Projector::reach`] is left to that search; what the others find is the same.
//!
//! # Memory
//! 32 bytes for four samples of a region, and 300 for each of [`NEAR_MAX`] triangles.

use glam::{DVec2, Vec2, Vec4};

use super::closest::ClosestPlaces;
use super::nearby::Nearby;
use super::patch_surface::PatchSurface;
use super::plane::Plane;
use super::plane_view::{PlaneView, Shadow};
use super::prism::{BOUND_MARGIN, FourPlaces, NearTriangle, Shown, larger};
use super::raster::{IN_GUTTER, NOBODY, Owners, TexelRect};
use crate::base::Result;
use crate::geometry::boxtree::Bounds;
use crate::unwrap::PlacedChart;

/// Side of a region in texels, and the least side down to which one is divided that too many triangles are near.
const REGION: usize = 32;
const REGION_MIN: usize = 4;
/// Triangles near a region at most.
const NEAR_MAX: usize = 4096;
/// How far closest places are looked for: in deviations of the patch, and at least and at most in texels and in sides of
/// a square as large as a triangle of the original.
const REACH: f64 = 2.5;
const REACH_TEXELS: f64 = 1.0;
const REACH_SIDES: f64 = 1.0;

/// The samples of a texel in the gutter: its middle alone.
const GUTTER_LANES: &[[Vec4; 2]] = &[[Vec4::ZERO; 2]];

/// Four samples side by side, and the closest triangle of each.
#[derive(Clone, Copy)]
struct FourSamples {
    /// How far it is, and counts as farther if it faces away.
    distance: Vec4,
    /// Its number.
    triangle: [u32; 4],
}

/// Where the samples of a texel are.
#[derive(Clone, Copy)]
struct TexelSlot {
    /// Number of the triangle of the patch in the region; [`NOBODY`] if the texel has none.
    run: u32,
    /// Index of its first samples.
    first: u32,
    is_gutter: bool,
    /// The largest distance of a sample.
    farthest: f32,
}

/// A triangle of the patch in a region.
struct FaceTexels {
    /// Its index in the chart.
    face: u32,
    plane: Plane,
    /// The texels that belong to it lie in this.
    rect: TexelRect,
}

/// Finds closest places.
pub(super) struct Projector {
    /// Closest places are no farther.
    reach: f64,
    /// A triangle that faces away counts as this much farther.
    away: f32,
    /// Places of the samples from the middle of a texel, four side by side; the last ones are repeated.
    lanes: Vec<[Vec4; 2]>,
    /// Samples of a texel.
    each: usize,
    nearby: Nearby,
    /// Numbers of the triangles near a run.
    near: Vec<usize>,
    /// Number of the run of each triangle of the chart.
    run_of: Vec<u32>,
    runs: Vec<FaceTexels>,
    /// How each of them is looked at; `None` without area, or texels.
    views: Vec<Option<PlaneView>>,
    slots: Vec<TexelSlot>,
    samples: Vec<FourSamples>,
}

impl Projector {
    /// Finds places for texels `texel` long that are sampled at the places of a pattern, on a patch that is about `away`
    /// off; a triangle that faces away counts as so much farther. `side` is that of a square as large as a triangle of the
    /// original.
    pub fn new(texel: f64, away: f64, side: f64, pattern: &[Vec2]) -> Self {
        let four = |four: &[Vec2]| {
            let at = |lane: usize| four[lane.min(four.len() - 1)];
            let [a, b, c, d] = [at(0), at(1), at(2), at(3)];
            [Vec4::new(a.x, b.x, c.x, d.x), Vec4::new(a.y, b.y, c.y, d.y)]
        };
        Self {
            reach: (REACH * away).min(REACH_SIDES * side).max(REACH_TEXELS * texel),
            away: away as f32,
            lanes: pattern.chunks(4).map(four).collect(),
            each: pattern.len(),
            nearby: Nearby::default(),
            near: Vec::new(),
            run_of: Vec::new(),
            runs: Vec::new(),
            views: Vec::new(),
            slots: Vec::new(),
            samples: Vec::new(),
        }
    }

    /// Calls `hear` with each texel of a part of a chart all samples of which find a place within reach.
    ///
    /// # Errors
    /// On failed reads, and those of `hear`.
    pub fn project(
        &mut self,
        part: &ChartPart<'_>,
        closest: &mut ClosestPlaces<'_>,
        hear: &mut dyn FnMut(SeenTexel<'_>) -> Result<()>,
    ) -> Result<()> {
        self.run_of.clear();
        self.run_of.resize(part.chart.faces.len(), NOBODY);
        part.rect.squares(REGION).try_for_each(|region| self.project_region(part, region, closest, hear))
    }

    fn project_region(
        &mut self,
        part: &ChartPart<'_>,
        region: TexelRect,
        closest: &mut ClosestPlaces<'_>,
        hear: &mut dyn FnMut(SeenTexel<'_>) -> Result<()>,
    ) -> Result<()> {
        let Some(bounds) = self.begin(part, region) else { return Ok(()) };
        if !self.gather(bounds, closest)? {
            let side = region.size().into_iter().max().unwrap_or(0).div_ceil(2);
            if side < REGION_MIN {
                return Ok(());
            }
            return region.squares(side).try_for_each(|quarter| self.project_region(part, quarter, closest, hear));
        }
        self.look(region);
        for number in 0..self.runs.len() {
            self.project_run(number, region);
        }
        self.tell(region, hear)
    }

    /// Gathers the triangles within reach of a box; returns whether there are at most [`NEAR_MAX`].
    fn gather(&mut self, bounds: Bounds, closest: &mut ClosestPlaces<'_>) -> Result<bool> {
        let Self { nearby, reach, .. } = self;
        let middle = 0.5 * (bounds.low + bounds.high);
        nearby.begin(middle);
        closest.visit_meeting(bounds.grown(*reach), |corners, shown| {
            nearby.add(corners.map(|corner| corner - middle), shown);
            nearby.len() > NEAR_MAX
        })?;
        Ok(nearby.len() <= NEAR_MAX)
    }

    /// Finds the triangles of the patch in a region; returns a box around its samples, if it has any.
    fn begin(&mut self, part: &ChartPart<'_>, region: TexelRect) -> Option<Bounds> {
        let Self { reach, run_of, runs, slots, samples, lanes, .. } = self;
        runs.clear();
        slots.clear();
        let (mut bounds, mut count, mut step) = (Bounds::EMPTY, 0, 0.0_f64);
        for texel in region.texels() {
            let owner = part.owners.owner(texel);
            let mut slot = TexelSlot {
                run: NOBODY,
                first: count as u32,
                is_gutter: owner & IN_GUTTER != 0,
                farthest: *reach as f32,
            };
            if owner != NOBODY {
                let face = owner & !IN_GUTTER;
                let run = &mut run_of[face as usize];
                if *run == NOBODY {
                    let (number, flat) = part.chart.faces[face as usize];
                    *run = runs.len() as u32;
                    let plane = Plane::new(flat, part.patch.corners(number));
                    step = step.max(plane.steps[0].length() + plane.steps[1].length());
                    runs.push(FaceTexels { face, plane, rect: TexelRect { first: texel, end: texel } });
                }
                let [column, row] = texel;
                let own = &mut runs[*run as usize];
                if let Some(place) = own.plane.extended(DVec2::new(column as f64 + 0.5, row as f64 + 0.5)) {
                    slot.run = *run;
                    count += if slot.is_gutter { 1 } else { lanes.len() };
                    own.rect = own.rect.with(texel);
                    bounds = bounds.with(Bounds { low: place, high: place });
                }
            }
            slots.push(slot);
        }
        runs.iter().for_each(|run| run_of[run.face as usize] = NOBODY);
        samples.clear();
        samples.resize(count, FourSamples { distance: Vec4::splat(self.reach as f32), triangle: [NOBODY; 4] });
        // The samples of a texel lie within half a step of its middle.
        (count > 0).then(|| bounds.grown(0.5 * step))
    }

    /// Prepares to look at the triangles of the patch.
    fn look(&mut self, region: TexelRect) {
        let Self { runs, views, nearby, .. } = self;
        views.clear();
        views.extend(runs.iter().map(|run| PlaneView::of(&run.plane, run.rect, nearby.middle(), region)));
    }

    /// Projects what is near a triangle of the patch onto its plane.
    fn project_run(&mut self, number: usize, region: TexelRect) {
        let Self { views, nearby, near, slots, samples, lanes, .. } = self;
        let reach = self.reach as f32;
        let Some(view) = &views[number] else { return };
        let mut screen = Screen { view, run: number as u32, width: region.size()[0], slots, samples, lanes };
        nearby.find_near(view.origin, view.radius + reach, near);
        for &number in near.iter() {
            let triangle = nearby.triangle(number);
            if let Some(shadow) = view.shadow(triangle, reach) {
                let away = if triangle.faces_away(view.normal) { self.away } else { 0.0 };
                screen.ask(&Asked { triangle, number: number as u32, away, shadow });
            }
        }
    }

    /// Hands over the texels of which all samples have found a place.
    fn tell(&mut self, region: TexelRect, hear: &mut dyn FnMut(SeenTexel<'_>) -> Result<()>) -> Result<()> {
        let Self { views, nearby, slots, samples, lanes, .. } = self;
        for (slot, texel) in slots.iter().zip(region.texels()).filter(|(slot, _)| slot.run != NOBODY) {
            let (each, lanes) = if slot.is_gutter { (1, GUTTER_LANES) } else { (self.each, &**lanes) };
            let samples = &samples[slot.first as usize..][..lanes.len()];
            let Some(view) = &views[slot.run as usize] else { continue };
            if samples.iter().all(|four| !four.triangle.contains(&NOBODY)) {
                let at = [0, 1].map(|axis| texel[axis] - region.first[axis]);
                hear(SeenTexel { texel, at, slot, each, samples, lanes, view, nearby })?;
            }
        }
        Ok(())
    }
}

/// A part of a chart.
pub(super) struct ChartPart<'a> {
    pub chart: &'a PlacedChart,
    pub patch: &'a PatchSurface<'a>,
    pub owners: &'a Owners,
    /// Its texels.
    pub rect: TexelRect,
}

/// A texel all samples of which have found a place.
pub(super) struct SeenTexel<'a> {
    /// Its column and row.
    pub texel: [usize; 2],
    /// The same from the corner of the region.
    at: [usize; 2],
    slot: &'a TexelSlot,
    each: usize,
    samples: &'a [FourSamples],
    lanes: &'a [[Vec4; 2]],
    view: &'a PlaneView,
    nearby: &'a Nearby,
}

impl SeenTexel<'_> {
    /// Whether it lies in the gutter, where it has one sample.
    pub fn is_gutter(&self) -> bool {
        self.slot.is_gutter
    }

    /// Calls `hear` with what is shown at the closest place of each sample, and the place's barycentric weights.
    ///
    /// # Errors
    /// Those of `hear`.
    pub fn samples(&self, mut hear: impl FnMut(&Shown, [f32; 3]) -> Result<()>) -> Result<()> {
        for (number, (four, lanes)) in self.samples.iter().zip(self.lanes).enumerate() {
            let Some(triangles) = self.nearby.four(four.triangle) else { continue };
            let places = FourPlaces::new(triangles, &self.view.points(self.at, lanes));
            let count = self.each - 4 * number;
            let mut shown = triangles.iter().enumerate().take(count);
            shown.try_for_each(|(lane, triangle)| hear(&triangle.shown, places.weights(lane)))?;
        }
        Ok(())
    }
}

/// A triangle of the original that is asked for its distances.
struct Asked<'a> {
    triangle: &'a NearTriangle,
    number: u32,
    /// What it counts as farther.
    away: f32,
    shadow: Shadow,
}

/// The samples of a triangle of the patch.
struct Screen<'a> {
    view: &'a PlaneView,
    run: u32,
    /// Width of the region.
    width: usize,
    slots: &'a mut [TexelSlot],
    samples: &'a mut [FourSamples],
    lanes: &'a [[Vec4; 2]],
}

impl Screen<'_> {
    /// Asks a triangle for its distances from the samples that it may be closest to.
    fn ask(&mut self, asked: &Asked<'_>) {
        let Shadow { rect, low, high, off } = asked.shadow;
        let [of_column, of_row] = self.view.rate_recips;
        let beside = |at: usize, axis: usize| larger(low[axis] - (at + 1) as i32 as f32, at as i32 as f32 - high[axis]);
        for row in rect.first[1]..rect.end[1] {
            let least = larger(beside(row, 1) * of_row, off);
            let line = &mut self.slots[row * self.width..][rect.first[0]..rect.end[0]];
            for (slot, column) in line.iter_mut().zip(rect.first[0]..) {
                if slot.run != self.run {
                    continue;
                }
                // Whatever is seen of it lies at least this far from the texel.
                let least = larger(beside(column, 0) * of_column, least) + asked.away;
                if least * BOUND_MARGIN >= slot.farthest {
                    continue;
                }
                let lanes = if slot.is_gutter { GUTTER_LANES } else { self.lanes };
                let mut farthest = 0.0_f32;
                for (four, lanes) in self.samples[slot.first as usize..].iter_mut().zip(lanes) {
                    let points = self.view.points([column, row], lanes);
                    let distance = asked.triangle.distances(&points, four.distance - asked.away) + asked.away;
                    let is_nearer = distance.cmplt(four.distance);
                    if is_nearer.any() {
                        four.distance = four.distance.min(distance);
                        (0..4).filter(|&lane| is_nearer.test(lane)).for_each(|lane| four.triangle[lane] = asked.number);
                    }
                    farthest = larger(four.distance.max_element(), farthest);
                }
                slot.farthest = farthest;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use proptest::prelude::*;

    use super::*;
    use crate::bake::testing::{counted_distance, point};
    use crate::base::id::TiVec;
    use crate::mesh::id::{FaceId, LocalVertex};
    use crate::unwrap::{ChartRoom, Triangles};

    proptest! {
        #[test]
        fn what_is_within_reach_is_found(
            soup in prop::collection::vec(prop::array::uniform3(point()), 1..60),
            patch in prop::array::uniform3(point()),
            flat in prop::array::uniform3(prop::array::uniform2(6.0..26.0)),
            texel in 0.02..0.4,
            away in 0.0..0.5,
            samples in 1_usize..3,
        ) {
            let pattern: Vec<Vec2> = [Vec2::ZERO, Vec2::splat(0.25), Vec2::splat(-0.25)].into_iter().take(samples + 1).collect();
            let positions: TiVec<LocalVertex, DVec3> = patch.to_vec().into();
            let corners = [0, 1, 2].map(LocalVertex::new);
            let vertices: TiVec<FaceId, [LocalVertex; 3]> = vec![corners].into();
            let surface = PatchSurface {
                triangles: Triangles { positions: &positions, vertices: &vertices },
                origin: DVec3::new(5.0, -7.0, 2.0),
            };
            let flat = flat.map(DVec2::from_array);
            let room = ChartRoom { corner: [0; 2], size: [32; 2], is_turned: false, cells: Vec::new() };
            let chart = PlacedChart { image: 0, faces: vec![(FaceId::new(0), flat)], room };
            let region = TexelRect { first: [0; 2], end: [32; 2] };
            let part = ChartPart { chart: &chart, patch: &surface, owners: &Owners::of(&chart, region), rect: region };
            let mut projector = Projector::new(texel, away, 1.0, &pattern);
            projector.run_of = vec![NOBODY];
            let Some(bounds) = projector.begin(&part, region) else { return Ok(()) };
            let middle = 0.5 * (bounds.low + bounds.high);
            projector.nearby.begin(middle);
            let corners_of = |triangle: &[DVec3; 3]| triangle.map(|corner| corner + surface.origin - middle);
            soup.iter().for_each(|triangle| projector.nearby.add(corners_of(triangle), Shown::Nothing));
            projector.look(region);
            prop_assume!(projector.views[0].as_ref().is_some_and(|view| view.radius < 100.0));
            projector.project_run(0, region);

            let run = &projector.runs[0];
            let counted = |point: DVec3, triangle: &[DVec3; 3]| {
                let corners = corners_of(triangle).map(|corner| corner + middle);
                counted_distance(point, corners, run.plane.normal, away)
            };
            for (slot, [column, row]) in projector.slots.iter().zip(region.texels()).filter(|(slot, _)| slot.run == 0) {
                let own = if slot.is_gutter { &[Vec2::ZERO] } else { &pattern[..] };
                for (lane, step) in own.iter().enumerate() {
                    let place = DVec2::new(column as f64 + 0.5, row as f64 + 0.5) + step.as_dvec2();
                    let point = run.plane.place(place);
                    let least = soup.iter().map(|triangle| counted(point, triangle)).fold(f64::INFINITY, f64::min);
                    let found = projector.samples[slot.first as usize].triangle[lane];
                    if least < projector.reach - 1e-3 {
                        prop_assert!(found != NOBODY, "{least} within {}", projector.reach);
                    }
                    if found != NOBODY {
                        let distance = counted(point, &soup[found as usize]);
                        prop_assert!(distance <= least + 1e-3, "{distance} instead of {least}");
                        prop_assert!(distance <= projector.reach + 1e-3);
                    }
                }
            }
        }
    }
}
