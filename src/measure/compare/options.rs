//! Options of a comparison, and the resources that it may use.

use std::path::PathBuf;

use serde::Serialize;

use crate::base::WorkLimits;
use crate::read::ScanOptions;

/// Default number of points by area on each surface.
pub const SAMPLES: u64 = 1_000_000;

/// Options of a comparison.
#[derive(Debug, Clone)]
pub struct CompareOptions {
    /// Where distances are taken on each surface.
    pub spread: Spread,
    /// Seed of the points.
    pub seed: u64,
    /// Length of the texels as which the original's colours are compared; `None`: at points.
    pub texel: Option<f64>,
    /// Folder for the two work folders.
    pub work: PathBuf,
    /// What the comparison may use.
    pub resources: Resources,
}

/// Resources of a comparison; they do not change the numbers.
#[derive(Debug, Clone, Copy)]
pub struct Resources {
    /// Threads, at least 1.
    pub threads: usize,
    /// Memory in bytes.
    pub work_bytes: u64,
    /// How the meshes are read.
    pub scan: ScanOptions,
}

impl Resources {
    /// Threads and memory for work in flight.
    pub fn limits(&self) -> WorkLimits {
        WorkLimits { threads: self.threads, work_bytes: self.work_bytes }
    }
}

/// Where distances are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Spread {
    /// At this many points by area, at points on edges and at vertices; all figures but the largest distance are of the
    /// points by area.
    Area(u64),
    /// At vertices alone, as in many papers: a result that leaves vertices in place has no error there.
    Vertices,
}

impl Spread {
    /// Number of points by area; `None` if distances are taken at vertices.
    pub fn by_area(self) -> Option<u64> {
        match self {
            Self::Area(count) => Some(count),
            Self::Vertices => None,
        }
    }
}
