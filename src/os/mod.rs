//! The outside world: mapped files, durable files, and what the system says of memory.

pub mod durable;
pub mod mmap;
pub mod system;
