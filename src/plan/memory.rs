//! Memory budget of a run, number of threads that fit it, and predicted memory of each phase.
//!
//! ```text
//! peak = fixed + max(scan, partition, simplify, write), never more than the budget: permits enforce it
//! ```

use serde::Serialize;

use crate::base::bytes::MIB;
use crate::base::{Error, MemoryBudget, Result, bytes};
use crate::options::SimplifyOptions;
use crate::os::system;
use crate::partition::numbering::{RANK_BYTES, window_bytes};
use crate::partition::weight::{ORDINARY_BYTES, limit_bytes};
use crate::passes::sample;
use crate::read::{self, ScanOptions};
use crate::remesh::cvd;
use crate::simplify::Anchor;
use crate::write::share_bytes_max;

/// Minimum memory of a thread for its work.
const THREAD_BYTES: u64 = 32 * MIB;
/// Memory of a chunk's text; also of a third of a parsed chunk, as exporters write it.
const CHUNK_TEXT_BYTES: u64 = read::CHUNK_BYTES;
/// Factor by which a cluster may exceed the requested size.
const CLUSTER_EXCESS: f64 = 1.3;
/// Memory of the partition's buffers that the allocator keeps while clusters are simplified.
const KEPT_BYTES: u64 = 12 * MIB;
/// A histogram and its filled cells (24 MiB) or buffers of vertices or faces by cell (12 MiB), and windows in flight.
const PARTITION_BYTES: u64 = 36 * MIB;
/// Memory for each face of the result while it is grouped by part and turned into text.
const WRITE_FACE_BYTES: u64 = 64;

/// Predicted memory by phase in bytes; each includes the fixed memory of the process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct MemoryForecast {
    /// Reading the input.
    pub scan: u64,
    /// Partitioning.
    pub partition: u64,
    /// Simplifying clusters, several at a time.
    pub simplify: u64,
    /// Baking textures, if they are baked.
    pub bake: Option<u64>,
    /// Writing the result.
    pub write: u64,
    /// Largest of these.
    pub peak: u64,
}

/// Inputs of a forecast.
#[derive(Debug, Clone, Copy)]
pub struct Sizes {
    /// Triangles of the input.
    pub faces: u64,
    /// Vertices of the input.
    pub vertices: u64,
    /// Target number of triangles.
    pub target: u64,
    /// Approximate number of triangles of a cluster.
    pub cluster_faces: u64,
    /// Settings of the remeshing, if there is one.
    pub remesh: Option<cvd::CvdSettings>,
    /// Whether faces have texture coordinates.
    pub is_textured: bool,
    /// Whether the distance from the input is bounded.
    pub is_bounded: bool,
    /// Bytes that the metric keeps for an ordinary face, beyond those of every cluster.
    pub metric_face_bytes: u64,
}

impl Sizes {
    /// The sizes of a run on `faces` faces and `vertices` vertices, with texture coordinates.
    pub fn of(faces: u64, vertices: u64, options: &SimplifyOptions) -> Self {
        Self {
            faces,
            vertices,
            target: options.most_faces(faces),
            cluster_faces: options.cluster_faces,
            remesh: options.remesh,
            is_textured: true,
            is_bounded: options.target.max_error.is_some(),
            // Settings that a metric does not have are refused before planning.
            metric_face_bytes: options.cost(true).map_or(0, |cost| cost.extra_face_bytes()),
        }
    }
}

/// Predicts the memory of a run.
pub fn forecast(sizes: &Sizes, budget: MemoryBudget, threads: usize) -> MemoryForecast {
    let work = budget.for_work();
    let scan = scan_options(budget, threads);
    let scan = (scan.threads + 3 * scan.chunks_in_flight) as u64 * CHUNK_TEXT_BYTES;
    // All ranks or two windows; a later pass, whose mesh is small, has a sample beside one window.
    let (ranks, window) = (RANK_BYTES * sizes.vertices, window_bytes(work));
    let sample = if sample::fits_beside_cutting(0, work) { sample::SAMPLE_BYTES } else { 0 };
    let ranks = ranks.min(2 * window).max(ranks.min(window) + sample);
    let partition = PARTITION_BYTES + ranks + sizes.vertices / 8 + sizes.faces / 32;
    let cluster_faces = (sizes.cluster_faces.min(sizes.faces) as f64 * CLUSTER_EXCESS) as u64;
    let metric = cluster_faces * sizes.metric_face_bytes;
    let cluster = in_work(cluster_faces * ORDINARY_BYTES, metric, sizes.remesh.is_some(), sizes.is_bounded);
    let at_once = (threads as u64).min(sizes.faces.div_ceil(sizes.cluster_faces.max(1)).max(1));
    let simplify = cluster * at_once + KEPT_BYTES;
    let write = (sizes.target * WRITE_FACE_BYTES).min(2 * share_bytes_max(threads)) + sizes.target / 4 + KEPT_BYTES;
    let [scan, partition, simplify, write] =
        [scan, partition, simplify, write].map(|bytes| MemoryBudget::FIXED_BYTES + bytes.min(work));
    let peak = scan.max(partition).max(simplify).max(write);
    MemoryForecast { scan, partition, simplify, bake: None, write, peak }
}

impl MemoryForecast {
    /// The same with a bake whose work takes `work_bytes` of memory.
    pub fn with_bake(self, work_bytes: Option<u64>) -> Self {
        let bake = work_bytes.map(|bytes| MemoryBudget::FIXED_BYTES + bytes);
        Self { bake, peak: self.peak.max(bake.unwrap_or(0)), ..self }
    }
}

/// Memory of a cluster that takes `bytes` once it is loaded, while it is remeshed or its edges collapse. The metric, of
/// `metric` bytes, exists only in the latter case.
fn in_work(bytes: u64, metric: u64, is_remeshed: bool, is_bounded: bool) -> u64 {
    let remeshed = if is_remeshed { bytes * cvd::GROWTH / 2 } else { 0 };
    let collapsing = bytes + metric;
    remeshed.max(if is_bounded { Anchor::with_room(collapsing) } else { collapsing })
}

/// Memory of the heaviest cluster after loading, when clusters should have `cluster_faces` faces.
///
/// # Errors
/// [`Error::Usage`] for settings that the metric does not have.
pub fn heaviest_bytes(options: &SimplifyOptions, cluster_faces: u64) -> Result<u64> {
    let metric = options.cost(true)?.extra_face_bytes() * cluster_faces;
    Ok(in_work(limit_bytes(cluster_faces), metric, options.remesh.is_some(), options.target.max_error.is_some()))
}

/// The budget that the user gave, or half of the machine's memory.
///
/// # Errors
/// [`Error::Budget`] below the floor.
pub fn budget_of(memory: Option<u64>) -> Result<MemoryBudget> {
    let floor = MemoryBudget::FLOOR_BYTES;
    let half = system::memory_bytes().map_or(1 << 30, |bytes| bytes / 2).max(floor);
    let bytes = memory.unwrap_or(half);
    if bytes < floor {
        let message = format!("`memory: {}`: at least {} are needed", bytes::display(bytes), bytes::display(floor));
        return Err(Error::Budget { needed: Some(floor), message });
    }
    Ok(MemoryBudget { bytes })
}

/// The budget of a run, which must hold one cluster.
///
/// # Errors
/// [`Error::Budget`] with the budget that would suffice.
pub fn choose_budget(options: &SimplifyOptions) -> Result<MemoryBudget> {
    let budget = budget_of(options.limits.memory)?;
    let cluster = heaviest_bytes(options, options.cluster_faces)?;
    if cluster > budget.for_work() {
        let most = budget.for_work() * options.cluster_faces / cluster;
        let needed = cluster + MemoryBudget::FIXED_BYTES + MIB;
        let message = format!(
            "{} cannot hold a cluster of {} triangles; give `cluster_faces: {most}` or `memory: {}`",
            bytes::display(budget.bytes),
            options.cluster_faces,
            bytes::display(needed),
        );
        return Err(Error::Budget { needed: Some(needed), message });
    }
    Ok(budget)
}

/// Number of threads: those asked for, or one for each processor, limited by the budget.
pub fn choose_threads(threads: Option<usize>, budget: MemoryBudget) -> usize {
    let wanted = threads.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
    wanted.min((budget.for_work() / THREAD_BYTES).max(1) as usize)
}

/// Options that share the budget among the scan's chunks.
pub fn scan_options(budget: MemoryBudget, threads: usize) -> ScanOptions {
    let fitting = (budget.for_work() / read::ORDINARY_BYTES) as usize;
    let chunks_in_flight = (threads * 2).min(fitting).max(1);
    let catalogue_bytes = budget.for_work() - chunks_in_flight as u64 * read::ORDINARY_BYTES;
    ScanOptions { threads, chunks_in_flight, catalogue_bytes }
}

/// Bytes a face that each metric keeps beyond those of every cluster, as the tests of budgets expect them.
#[cfg(test)]
pub const METRIC_FACE_BYTES: [(crate::options::MetricChoice, u64); 7] = [
    (crate::options::MetricChoice::Qem, 0),
    (crate::options::MetricChoice::QemAttributes, 0),
    (crate::options::MetricChoice::Qem1997, 0),
    (crate::options::MetricChoice::Oblique, 62),
    (crate::options::MetricChoice::Curvature, 12),
    (crate::options::MetricChoice::Terrain, 187),
    (crate::options::MetricChoice::Sharpness, 0),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::{Limits, Target};

    const CITY: Sizes = Sizes {
        faces: 4_313_336,
        vertices: 2_160_000,
        target: 431_334,
        cluster_faces: 250_000,
        remesh: None,
        is_textured: true,
        is_bounded: false,
        metric_face_bytes: 0,
    };

    #[test]
    fn the_forecast_stays_within_the_budget_and_does_not_grow_with_the_input() {
        let budget = MemoryBudget { bytes: 256 * MIB };
        let large = Sizes { faces: CITY.faces * 100, vertices: CITY.vertices * 100, target: CITY.target, ..CITY };
        for sizes in [CITY, large] {
            assert!(forecast(&sizes, budget, 8).peak <= budget.bytes);
        }
        assert_eq!(forecast(&CITY, budget, 2).simplify, forecast(&large, budget, 2).simplify);
    }

    #[test]
    fn more_threads_take_more_memory_until_the_budget_is_used() {
        let budget = MemoryBudget { bytes: 1024 * MIB };
        let peaks = [1, 2, 4, 64].map(|threads| forecast(&CITY, budget, threads).simplify);
        assert!(peaks.is_sorted() && peaks[0] < peaks[2], "{peaks:?}");
        assert_eq!(peaks[3], budget.bytes);
    }

    #[test]
    fn an_impossible_budget_is_refused_with_one_that_would_do() {
        let options = SimplifyOptions {
            limits: Limits { memory: Some(128 * MIB), ..Limits::default() },
            cluster_faces: 1_000_000,
            ..Default::default()
        };
        let words = choose_budget(&options).unwrap_err().to_string();
        assert!(words.contains("`cluster_faces: ") && words.contains("`memory: 410 MiB`"), "{words}");
        assert!(budget_of(Some(1)).is_err());
    }

    #[test]
    fn the_forecast_counts_what_each_metric_keeps() {
        let budget = MemoryBudget { bytes: 1024 * MIB };
        for (metric, extra) in METRIC_FACE_BYTES {
            let options = SimplifyOptions { target: Target::ratio(0.1), metric: Some(metric), ..Default::default() };
            let sizes = Sizes { cluster_faces: CITY.cluster_faces, ..Sizes::of(CITY.faces, CITY.vertices, &options) };
            let more = forecast(&sizes, budget, 2).simplify - forecast(&CITY, budget, 2).simplify;
            assert_eq!(more, 2 * 325_000 * extra, "{metric:?}");
        }
    }

    #[test]
    fn a_budget_holds_a_cluster_with_what_each_metric_keeps() {
        let bytes = |options: &SimplifyOptions| heaviest_bytes(options, 100_000).unwrap();
        for (metric, extra) in METRIC_FACE_BYTES {
            let options = SimplifyOptions { metric: Some(metric), ..Default::default() };
            assert_eq!(bytes(&options), limit_bytes(100_000) + 100_000 * extra, "{metric:?}");
            let bounded = SimplifyOptions { target: options.clone().target.within(0.1), ..options.clone() };
            assert_eq!(bytes(&bounded), Anchor::with_room(bytes(&options)), "{metric:?}");
            // Cells are built before the metric is created.
            let remeshed = SimplifyOptions { remesh: Some(cvd::CvdSettings::default()), ..options.clone() };
            assert_eq!(bytes(&remeshed), bytes(&options).max(limit_bytes(100_000) * cvd::GROWTH / 2), "{metric:?}");
        }
    }
}
