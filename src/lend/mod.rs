//! Lends items of a phase to other processes, and does them there.
//!
//! ```text
//! items ── divide ──▶ tasks of a stage ──▶ other processes: work ──▶ results, files ──▶ lent: read one by one
//! ```
//! An item is a file, a cluster, a patch or a tile. In: what is to be done to each. Out: the same results that this
//! process would record. Which phases lend what, they say themselves.

mod divide;
mod lent;
mod work;

pub use divide::{ITEMS_MIN, Lendable, LentItem, Uncounted, lend};
pub use lent::LentResults;
pub use work::{LentResult, LentWork, details_of, encoded};
