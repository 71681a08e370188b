//! The outside world: mapped files, durable files, and what the system says of memory and bytes moved.

pub mod durable;
pub mod mmap;
pub mod system;
pub mod timeline;
