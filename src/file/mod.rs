//! Records in the files of a work folder: what they look like, and the one writer behind all of them.
//!
//! In: records in order. Out: read-only windows of them. Invariant: a file has a header that identifies it; it is
//! written once, synced and renamed. A file that can be opened is complete.
//!
//! # Files
//! `docs/reference/work-folder.md` describes every byte.

pub mod header;
pub mod codec;
pub mod name;
pub mod varint;
pub mod decimal;
pub mod float;
pub mod record_file;
pub mod record;
pub mod column;
pub mod packed;
pub mod positions;
pub mod buckets;

pub use column::{Column, ColumnWriter, Segment};
pub use header::FORMAT_VERSION;
pub use packed::{PackedBlocks, PackedColumn, PackedWriter, RecordBounds};
pub use positions::{EncodedRun, PositionRunWriter, PositionRuns};
pub use record_file::RecordFile;
