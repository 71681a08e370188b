//! Lends the clusters of a partition to other processes, and does them there.
//!
//! ```text
//! partition ── divide ──▶ tasks of a stage ──▶ other processes: work ──▶ results, pieces ──▶ lent: read one by one
//! ```
//! In: what is to be done to each cluster. Out: the same results that this process would record. Which phases lend what,
//! they say themselves.

mod divide;
mod lent;
mod work;

pub use divide::{Lendable, lend};
pub use lent::LentClusters;
pub use work::{LentWork, details_of, encoded};
