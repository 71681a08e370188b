//! The outside world: mapped files, durable files, signals, and what the system says of memory and bytes moved.

pub mod durable;
pub mod mmap;
pub mod path;
pub mod signals;
pub mod system;
pub mod timeline;
