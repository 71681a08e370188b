//! Distances from the points of one mesh to another mesh, with normals and textures at those points.
//!
//! In: two meshes in cells. Out: distributions, the positions of the largest distances, and a record for each point by
//! area for the comparison of textures. Invariant: points are processed in their order, so sums do not depend on
//! threads.
//!
//! Points by area come first, or the vertices if distances are taken at vertices. Of the other vertices and points on
//! edges only those matter that lie farther than the largest distance found before, so the search for most of them ends
//! at the first triangle that is near enough.
//!
//! # Memory
//! In each thread a batch of points (3 MiB), a cell of one mesh and the touched pages of a few of the other.
//!
//! # Files
//! `measure-samples.col`, 56 bytes a point by area, if both meshes show texture images; `measure-filtered.col`, 12
//! bytes, if the original's colours are filtered.

use glam::DVec3;

use super::cells::MeasuredMesh;
use super::distribution::Distribution;
use super::filter::{FilteredColour, TexelFilter, TexelMiddle};
use super::options::Resources;
use super::points::{Batch, SamplePoint, Sampling};
use super::search::{Closest, Farthest, Found, Search, VIEWS, texcoord_at};
use super::texture_pair::{OriginalSide, TexturePair};
use crate::base::bytes::MIB;
use crate::base::ordered::map_in_order;
use crate::base::{Progress, Result};
use crate::file::{Column, ColumnWriter};
use crate::geometry::triangle::unit_normal;
use crate::measure::figures::{FarPoint, WORST_PLACES};
use crate::model::id::ImageId;

/// Memory of a thread for each cell that it keeps open, and for its batch of points.
const CELL_BYTES: u64 = 6 * MIB;
/// Maximum number of points searched to the end where searches are abandoned: in total, and per batch.
const PROBES: usize = 1024;
const PROBES_OF_BATCH: usize = 16;
/// Largest angle between two normals, in degrees.
const ANGLE_MAX: f64 = 180.0;

/// Result of one direction.
#[derive(Debug)]
pub struct Direction {
    /// Distances of points by area.
    pub distances: Distribution,
    /// Angles between normals at points by area, in degrees.
    pub angles: Distribution,
    /// Points by area whose normals differ by more than 90°.
    pub flipped: u64,
    /// Positions of the largest distances in different cells, the largest first.
    pub worst: Vec<FarPoint>,
    /// Number of points whose search was abandoned.
    pub cut: u64,
    /// Upper bound of all distances.
    pub bound: f64,
    /// Texture pairs at points by area.
    pub textures: Option<Column<TexturePair>>,
    /// Filtered colours of the original for each pair.
    pub filtered: Option<Column<FilteredColour>>,
}

/// What is measured: from the points of one mesh to another, which has a triangle at least.
#[derive(Debug, Clone, Copy)]
pub struct Way<'a> {
    /// The mesh with the points.
    pub from: &'a MeasuredMesh,
    /// The mesh whose closest points are searched.
    pub to: &'a MeasuredMesh,
    /// Which of them is the original.
    pub original: OriginalSide,
    /// The points.
    pub sampling: &'a Sampling<'a>,
    /// How the original's colours are filtered.
    pub filter: Option<&'a TexelFilter<'a>>,
}

/// A point by area with its results.
struct MeasuredPoint {
    place: FarPoint,
    cosine: f64,
    texture: TexturePair,
}

struct PointResult {
    cell: usize,
    samples: Vec<MeasuredPoint>,
    /// Filtered colour of each sample; empty if they are not filtered.
    filtered: Vec<FilteredColour>,
    farthest: Option<FarPoint>,
    bound_sq: f64,
    cut: u64,
}

/// Measures one way.
///
/// `limit` is a length that no distance exceeds by much. `see_point` is called with each point by area, in order.
///
/// # Errors
/// On a full disk, failed reads and writes.
pub fn measure(
    way: &Way<'_>,
    limit: f64,
    resources: &Resources,
    see_point: &mut dyn FnMut(&FarPoint),
    progress: &dyn Progress,
) -> Result<Direction> {
    let Way { from, to, sampling, filter, .. } = *way;
    let batches = sampling.batches();
    progress.begin("compare", batches.len() as u64, "batches");
    let have_images = [from, to].iter().all(|mesh| !mesh.images.files.is_empty());
    let path = |name: &str| from.folder().join(name);
    let mut textures =
        have_images.then(|| ColumnWriter::create(&path("measure-samples.col"), *b"samples ")).transpose()?;
    let mut filtered = filter.map(|_| ColumnWriter::create(&path("measure-filtered.col"), *b"filtered")).transpose()?;
    let mut distances = Distribution::new(limit);
    let mut angles = Distribution::new(ANGLE_MAX);
    let (mut flipped, mut cut, mut bound_sq) = (0, 0, 0.0f64);
    let mut farthest: Vec<Option<FarPoint>> = vec![None; from.surface.cells.len()];
    let fitting = resources.work_bytes / (CELL_BYTES * (VIEWS as u64 + 2));
    let threads = resources.threads.min(fitting.max(1) as usize);
    let (by_area, others): (Vec<Batch>, Vec<Batch>) =
        batches.into_iter().partition(|batch| batch.kind == sampling.measured());
    let probes = (PROBES / by_area.len().max(1)).clamp(1, PROBES_OF_BATCH);
    map_in_order(
        by_area.iter(),
        threads,
        threads * 2,
        |batch| look_by_area(way, batch, probes),
        |outcome| {
            progress.advance(1);
            progress.check_stopped()?;
            cut += outcome.cut;
            bound_sq = bound_sq.max(outcome.bound_sq);
            let mut records = Vec::with_capacity(outcome.samples.len());
            for sample in &outcome.samples {
                see_point(&sample.place);
                distances.add(sample.place.distance);
                angles.add(libm::acos(sample.cosine.clamp(-1.0, 1.0)).to_degrees());
                flipped += u64::from(sample.cosine < 0.0);
                records.push(sample.texture);
                keep_farther(&mut farthest[outcome.cell], sample.place);
            }
            textures.as_mut().map_or(Ok(()), |textures| textures.append(&records))?;
            filtered.as_mut().map_or(Ok(()), |colours| colours.append(&outcome.filtered))
        },
    )?;
    let known = farthest.clone();
    // With fewer positions than are reported, any further one is reported.
    let told = worst_of(known.iter().copied()).get(WORST_PLACES - 1).map_or(0.0, |place| place.distance);
    map_in_order(
        others.iter(),
        threads,
        threads * 2,
        |batch| {
            let known = known[batch.cell].map_or(0.0, |place| place.distance).max(told);
            look_for_farthest(way, batch, known)
        },
        |outcome| {
            progress.advance(1);
            progress.check_stopped()?;
            cut += outcome.cut;
            bound_sq = bound_sq.max(outcome.bound_sq);
            if let Some(place) = outcome.farthest {
                keep_farther(&mut farthest[outcome.cell], place);
            }
            Ok(())
        },
    )?;
    let worst = worst_of(farthest.into_iter());
    let bound = worst.first().map_or(0.0, |place| place.distance).max(bound_sq.sqrt());
    let textures = textures.map(ColumnWriter::finish).transpose()?;
    let filtered = filtered.map(ColumnWriter::finish).transpose()?;
    Ok(Direction { distances, angles, flipped, worst, cut, bound, textures, filtered })
}

/// The positions that are reported, the farthest first.
fn worst_of(farthest: impl Iterator<Item = Option<FarPoint>>) -> Vec<FarPoint> {
    let mut worst: Vec<FarPoint> = farthest.flatten().collect();
    worst.sort_by(|a, b| b.distance.total_cmp(&a.distance));
    worst.truncate(WORST_PLACES);
    worst
}

fn keep_farther(most: &mut Option<FarPoint>, place: FarPoint) {
    if most.is_none_or(|most| place.distance > most.distance) {
        *most = Some(place);
    }
}

fn look_by_area(way: &Way<'_>, batch: &Batch, probes: usize) -> Result<PointResult> {
    let Way { from, to, original, sampling, filter } = *way;
    let view = from.surface.cells[batch.cell].view()?;
    let points = sampling.points(batch, &view);
    let positions: Vec<DVec3> = points.iter().map(|point| point.position).collect();
    let mut search = Search::new(&to.surface);
    let mut samples = Vec::with_capacity(points.len());
    let mut middles = Vec::new();
    let (spoken, bound_sq) = search.nearest(&positions, probes)?;
    for (number, found) in spoken {
        if !found.distance_sq.is_finite() {
            continue;
        }
        let SamplePoint { position, face, weights } = points[number];
        let closest = search.closest(position, &found)?;
        let own = view.faces[face as usize];
        if filter.is_some() {
            middles.push(match original {
                OriginalSide::Own => TexelMiddle::of_face(position, &view, face),
                OriginalSide::Other => TexelMiddle::from(&closest),
            });
        }
        samples.push(MeasuredPoint {
            place: place(position, &found, &closest),
            cosine: unit_normal(view.triangle(face)).dot(closest.normal),
            texture: TexturePair {
                closest: closest.position.to_array(),
                image: own.image,
                other_image: closest.image,
                texcoord: if own.image == ImageId::NONE { [0.0; 2] } else { texcoord_at(&own.texcoords, weights) },
                other_texcoord: closest.texcoord,
                other_density: closest.density,
                zero: 0,
            },
        });
    }
    // For a point that lies on the mesh, its rounding is not a distance.
    let bound_sq = if search.cut_count() > 0 { bound_sq } else { 0.0 };
    let filtered = filter.map_or(Ok(Vec::new()), |filter| filter.colours(&middles))?;
    Ok(PointResult { cell: batch.cell, samples, filtered, farthest: None, bound_sq, cut: search.cut_count() })
}

/// The farthest vertex, or point on edges, of a batch; recorded only if it is farther than what is known.
fn look_for_farthest(way: &Way<'_>, batch: &Batch, known: f64) -> Result<PointResult> {
    let Way { from, to, sampling, .. } = *way;
    let view = from.surface.cells[batch.cell].view()?;
    let positions: Vec<DVec3> = sampling.points(batch, &view).iter().map(|point| point.position).collect();
    let mut search = Search::new(&to.surface);
    let Farthest { point, bound_sq } = search.farthest(&positions, known * known)?;
    let farthest = match point {
        Some((number, found)) => Some(place(positions[number], &found, &search.closest(positions[number], &found)?)),
        None => None,
    };
    let bound_sq = if search.cut_count() > 0 { bound_sq } else { 0.0 };
    Ok(PointResult {
        cell: batch.cell,
        samples: Vec::new(),
        filtered: Vec::new(),
        farthest,
        bound_sq,
        cut: search.cut_count(),
    })
}

fn place(position: DVec3, found: &Found, closest: &Closest) -> FarPoint {
    FarPoint { distance: found.distance_sq.sqrt(), position: position.to_array(), closest: closest.position.to_array() }
}
