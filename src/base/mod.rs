//! Vocabulary of all phases: errors, sizes in bytes, the memory budget, progress and findings.
//!
//! This module knows no mesh files, clusters or costs; every other module may import it.

pub mod budget;
pub mod bytes;
pub mod cache;
pub mod chance;
pub mod counts;
pub mod duration;
pub mod error;
pub mod findings;
pub mod id;
pub mod json_path;
pub mod lock;
pub mod ordered;
pub mod pool;
pub mod progress;
pub mod quantity;
pub mod records;
pub mod recycled;
pub mod threads;
pub mod ticker;

pub use budget::{Allowance, MemoryBudget, Permit, Permits, WorkLimits};
pub use counts::{counted, grouped};
pub use error::{Error, ErrorKind, Result};
pub use findings::Findings;
pub use lock::lock;
pub use progress::{Progress, Silent};
