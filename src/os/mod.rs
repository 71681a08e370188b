//! The operating system: mapped files, durable files, signals, and figures about memory and I/O.

pub mod content;
pub mod durable;
pub mod mmap;
pub mod path;
#[cfg(feature = "cli")]
pub mod signals;
pub mod system;
pub mod timeline;
