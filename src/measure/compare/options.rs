//! How two meshes are compared, and what that may use.

use std::path::PathBuf;

use serde::Serialize;

use crate::scan::ScanOptions;

/// Points by area on each surface, if not said otherwise.
pub const SAMPLES: u64 = 1_000_000;

/// How meshes are compared.
#[derive(Debug, Clone)]
pub struct CompareOptions {
    /// Where distances are taken on each surface.
    pub spread: Spread,
    /// Seed of the points.
    pub seed: u64,
    /// Folder for the two work folders.
    pub work: PathBuf,
    /// What the comparison may use.
    pub resources: Resources,
}

/// What a comparison may use; it does not change the numbers.
#[derive(Debug, Clone, Copy)]
pub struct Resources {
    /// Threads, at least 1.
    pub threads: usize,
    /// Memory in bytes.
    pub work_bytes: u64,
    /// How the meshes are read.
    pub scan: ScanOptions,
}

/// Where distances are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Spread {
    /// At so many points by area, at points on edges and at vertices; all but the largest distance is of the points by area.
    Area(u64),
    /// At vertices alone, as in many papers: what leaves vertices where they were errs by nothing there.
    Vertices,
}

impl Spread {
    /// Points by area; nothing where there are none.
    pub fn by_area(self) -> Option<u64> {
        match self {
            Self::Area(count) => Some(count),
            Self::Vertices => None,
        }
    }
}
