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

use glam::{DVec2, DVec3, Vec2, Vec3, Vec4};

use super::closest::ClosestPlaces;
use super::nearby::Nearby;
use super::patch_surface::PatchSurface;
use super::plane::Plane;
use super::prism::{BOUND_MARGIN, FourPlaces, FourPoints, NearTriangle, Shown};
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
struct Run {
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
    runs: Vec<Run>,
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
        let bounds = self.begin(part, region);
        if self.runs.is_empty() {
            return Ok(());
        }
        if !self.gather(bounds, closest)? {
            let side = region.size().into_iter().max().unwrap_or(0).div_ceil(2);
            if side < REGION_MIN {
                return Ok(());
            }
            return region.squares(side).try_for_each(|quarter| self.project_region(part, quarter, closest, hear));
        }
        for number in 0..self.runs.len() {
            self.project_run(number, region);
        }
        self.tell(region, hear)
    }

    /// Gathers the triangles within reach of a box; returns whether there are at most [`NEAR_MAX`].
    fn gather(&mut self, bounds: Bounds, closest: &mut ClosestPlaces<'_>) -> Result<bool> {
        let Self { nearby, reach, .. } = self;
        let middle = 0.5 * (bounds.low + bounds.high);
        let within = bounds.grown(*reach);
        nearby.begin(middle);
        closest.visit_meeting(within, |corners, shown| {
            if within.between_sq(Bounds::around(corners)) == 0.0 {
                nearby.add(corners.map(|corner| corner - middle), shown());
            }
            nearby.len() > NEAR_MAX
        })?;
        Ok(nearby.len() <= NEAR_MAX)
    }

    /// Finds the triangles of the patch in a region; returns a box around its texels.
    fn begin(&mut self, part: &ChartPart<'_>, region: TexelRect) -> Bounds {
        let Self { reach, run_of, runs, slots, samples, lanes, .. } = self;
        runs.clear();
        slots.clear();
        let (mut bounds, mut count) = (Bounds::EMPTY, 0);
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
                    runs.push(Run { face, plane, rect: TexelRect { first: texel, end: texel } });
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
        bounds
    }

    /// Projects what is near a triangle of the patch onto its plane.
    fn project_run(&mut self, number: usize, region: TexelRect) {
        let Self { runs, nearby, near, slots, samples, lanes, .. } = self;
        let reach = self.reach as f32;
        let Some(view) = View::of(&runs[number], nearby.middle(), region) else { return };
        let mut screen = Screen { view: &view, run: number as u32, width: region.size()[0], slots, samples, lanes };
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
        let Self { runs, nearby, slots, samples, lanes, .. } = self;
        let views: Vec<Option<View>> = runs.iter().map(|run| View::of(run, nearby.middle(), region)).collect();
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
    view: &'a View,
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

/// How a triangle of the patch is looked at. Places are from the middle of the region, columns and rows from its corner.
struct View {
    /// The place in the middle of the texels, and its column and row.
    origin: Vec3,
    at: Vec2,
    /// Steps of one column and one row.
    steps: [Vec3; 2],
    /// Columns and rows grow along these.
    growth: [Vec3; 2],
    normal: Vec3,
    /// All texels lie within this of the origin.
    radius: f32,
    /// The texels.
    rect: TexelRect,
}

impl View {
    /// `None` if the triangle has no area, or no texel.
    fn of(run: &Run, middle: DVec3, region: TexelRect) -> Option<Self> {
        let Run { plane, rect, .. } = run;
        if rect.size().contains(&0) {
            return None;
        }
        let corner = DVec2::new(region.first[0] as f64, region.first[1] as f64);
        let [low, high] = [rect.first, rect.end].map(|[column, row]| DVec2::new(column as f64, row as f64));
        let at = 0.5 * (low + high);
        let [right, below] = plane.steps;
        // The inverse of the steps, as a map from the plane to the image.
        let [rr, rb, bb] = [right.dot(right), right.dot(below), below.dot(below)];
        let inverse = (rr * bb - rb * rb).recip();
        let growth = [(right * bb - below * rb) * inverse, (below * rr - right * rb) * inverse];
        let sides = [right * (high.x - low.x), below * (high.y - low.y)];
        let radius = 0.5 * (sides[0] + sides[1]).length().max((sides[0] - sides[1]).length());
        let view = Self {
            origin: (plane.place(at) - middle).as_vec3(),
            at: (at - corner).as_vec2(),
            steps: plane.steps.map(|step| step.as_vec3()),
            growth: growth.map(|growth| growth.as_vec3()),
            normal: plane.normal.as_vec3(),
            radius: radius as f32,
            rect: rect.from(region.first),
        };
        let is_sound = view.growth.iter().all(|growth| growth.is_finite()) && view.origin.is_finite();
        is_sound.then_some(view)
    }

    /// Where a triangle is seen; `None` if no texel lies within `reach` of it.
    fn shadow(&self, triangle: &NearTriangle, reach: f32) -> Option<Shadow> {
        let from = triangle.corners.map(|corner| corner - self.origin);
        let above = from.map(|from| from.dot(self.normal));
        let (lowest, highest) = (above[0].min(above[1]).min(above[2]), above[0].max(above[1]).max(above[2]));
        let off = lowest.max(-highest).max(0.0);
        let at = from.map(|from| self.at + Vec2::new(from.dot(self.growth[0]), from.dot(self.growth[1])));
        let (low, high) = (at[0].min(at[1]).min(at[2]), at[0].max(at[1]).max(at[2]));
        let range = |axis: usize| {
            let margin = reach * self.growth[axis].length();
            let first = ((low[axis] - margin).max(0.0) as usize).max(self.rect.first[axis]);
            let end = ((high[axis] + margin).max(-1.0) + 1.0) as usize;
            (first, end.min(self.rect.end[axis]))
        };
        let [(left, right), (top, bottom)] = [range(0), range(1)];
        let is_near = off < reach && left < right && top < bottom;
        is_near.then_some(Shadow { rect: TexelRect { first: [left, top], end: [right, bottom] }, low, high, off })
    }

    /// The places of four samples of a texel.
    #[inline]
    fn points(&self, [column, row]: [usize; 2], [x, y]: &[Vec4; 2]) -> FourPoints {
        let from = Vec2::new(column as f32 + 0.5, row as f32 + 0.5) - self.at;
        let (x, y) = (*x + from.x, *y + from.y);
        let [right, below] = self.steps;
        FourPoints {
            x: x * right.x + y * below.x + self.origin.x,
            y: x * right.y + y * below.y + self.origin.y,
            z: x * right.z + y * below.z + self.origin.z,
        }
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

/// Where a triangle of the original is seen, if it is projected onto the plane of one of the patch.
struct Shadow {
    /// The texels within reach.
    rect: TexelRect,
    /// Columns and rows that it covers.
    low: Vec2,
    high: Vec2,
    /// It is at least this far from the plane.
    off: f32,
}

/// The samples of a triangle of the patch.
struct Screen<'a> {
    view: &'a View,
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
        let [of_column, of_row] = self.view.growth.map(|growth| growth.length_recip());
        let beside = |at: usize, axis: usize| (low[axis] - (at + 1) as f32).max(at as f32 - high[axis]);
        for row in rect.first[1]..rect.end[1] {
            let least = off.max(beside(row, 1) * of_row);
            for column in rect.first[0]..rect.end[0] {
                let slot = &mut self.slots[row * self.width + column];
                // Whatever is seen of it lies at least this far from the texel.
                let least = least.max(beside(column, 0) * of_column) + asked.away;
                if slot.run != self.run || least * BOUND_MARGIN >= slot.farthest {
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
                    farthest = farthest.max(four.distance.max_element());
                }
                slot.farthest = farthest;
            }
        }
    }
}
